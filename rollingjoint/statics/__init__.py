"""Equilibria of any mechanism: solvers and derivatives.

Modules:
    batch: checked inputs of many solves, and their solution.
    history: histories of steps with friction.
    least_squares: tendon lengths in the least-squares sense.
    limits: limits of tensions, checked.
    loop: paths back and forth, and the hysteresis in them.
    problem: prepared problems, checked once.
    sensitivity: derivatives of equilibria.
    slot: memory for one solve.
    solve: the solvers.
    trace: paths, step after step.
"""
