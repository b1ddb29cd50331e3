"""What `python benchmarks/guard.py` compares, one module per kind of row.

The modules that run inside a checkout use public names only, so that they run in checkouts whose modules differ:
child, solves, episodes, names, files, speed_work. The others import neither checkout.
"""
