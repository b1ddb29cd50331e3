"""Kernels that both families use."""
