"""Kernels of spatial hinge chains."""
