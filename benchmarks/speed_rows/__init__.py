"""Rows of the speed page, one module per kind; `python benchmarks/speed.py` measures them."""
