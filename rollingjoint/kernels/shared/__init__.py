"""Kernels that both families use.

Modules:
    arrays: status codes and the tendon law.
    bounds: joint angles between the limits of their joints.
    formulas: the formulas that each family registers: energy, residual and stiffness.
    lane: whether the inputs of a lane can be solved with, and its stiffness.
    linear: small dense linear algebra on the free joints.
    long_chain: Newton steps in O(n).
    newton: Newton's method with a line search.
    relaxation: the overdamped motion, where Newton's method does not converge.
    tendons: tensions and their energy from the lengths.
    tolerances: the numbers by which iterations stop.
"""
