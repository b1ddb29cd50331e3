"""Everything that touches the inside of numba; README.md beside this file has its invariants."""
