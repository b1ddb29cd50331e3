"""Kernels that both families use.

Modules:
    arrays: status codes and the tendon law.
    batch: the solver for all cases and the stiffness that it leaves, row by row.
    block_formulas: what a family registers for its lanes.
    bounds: joint angles between the limits of their joints.
    chain: energy, stiffness and its generators of a chain at one configuration.
    descent: the slow, sure way to an equilibrium, where Newton's method ends without one.
    elementary: elementary functions of numbers and SIMD lanes alike.
    formulas: the formulas that each family registers: energy, residual and stiffness.
    friction: capstan friction with memory: tensions, slip and their rates.
    lane: whether the inputs of a lane can be solved with, and its stiffness.
    lanes: Newton's method in eight lanes side by side, or in a single one.
    linear: small dense linear algebra on the free joints.
    long_chain: Newton steps in O(n).
    long_lu: Newton steps in O(n) with friction.
    newton: Newton's method with a line search.
    relaxation: the overdamped motion, where Newton's method does not converge.
    rubbed: steps with friction for all cases, histories and stiffness, row by row.
    rubbed_block: steps with friction in lanes.
    rubbed_chain: a chain with friction, and its steps.
    settle: one equilibrium from one start, with fallbacks.
    tendons: tensions and their energy from the lengths, and the balance at a joint.
    tolerances: the numbers by which iterations stop.
    vectors: vectors of the plane and of space.
"""
