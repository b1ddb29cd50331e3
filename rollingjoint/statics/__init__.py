"""Equilibria of any family: solvers and derivatives.

Modules:
    batch: inputs of many solves, checked, and their solution.
    families: the families that there are.
    least_squares: lengths met in the least-squares sense.
    sensitivity: derivatives of equilibria.
    solve: the solvers.
"""
