"""Kernels of planar rolling chains."""
