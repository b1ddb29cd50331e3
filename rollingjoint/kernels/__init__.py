"""Compiled kernels: arrays in, arrays and an integer status out. Nothing here raises."""
