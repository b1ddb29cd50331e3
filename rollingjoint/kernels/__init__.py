"""Compiled kernels: arrays in, arrays and an integer status out. Nothing here raises.

Modules:
    shared: Newton's method, linear algebra, the tendon law: what both families use. It knows neither.
    planar: the formulas of rolling chains, and their solvers.
    spatial: the formulas of hinge chains, and their solver.
"""
