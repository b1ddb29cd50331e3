"""Kernels that both families use.

Modules:
    arrays: status codes and the tendon law.
    bounds: joint angles between the limits of their joints.
    descent: the slow, sure way to an equilibrium, where Newton's method ends without one.
    elementary: elementary functions of numbers and SIMD lanes alike.
    formulas: the formulas that each family registers: energy, residual and stiffness.
    friction: capstan friction with memory: tensions, slip and their rates.
    lane: whether the inputs of a lane can be solved with, and its stiffness.
    linear: small dense linear algebra on the free joints.
    long_chain: Newton steps in O(n).
    long_lu: Newton steps in O(n) with friction.
    newton: Newton's method with a line search.
    relaxation: the overdamped motion, where Newton's method does not converge.
    rubbed_chain: a chain with friction, and its steps.
    rubbed_lanes: histories and stiffness of many chains with friction.
    settle: one equilibrium from one start, with fallbacks.
    tendons: tensions and their energy from the lengths.
    tolerances: the numbers by which iterations stop.
"""
