"""Equilibria of any mechanism: solvers and derivatives.

Modules:
    among: checked surroundings.
    batch: checked inputs of many solves, and their solution.
    inputs: checked inputs: starts and histories, limits of tensions.
    least_squares: tendon lengths in the least-squares sense.
    loop: paths back and forth, and the hysteresis in them.
    parts: steps that would pass through an obstacle, done again in parts.
    problem: prepared problems, checked once.
    reactions: forces and moments of the hinges of arms.
    sensitivity: derivatives of equilibria.
    slot: memory for one solve.
    solve: the solvers.
    trace: paths, step after step.
"""
