"""Compiled kernels: arrays in, arrays and an integer status out. Nothing here raises.

Importing the package registers the formulas of both classes of chains (formulas.py).

Modules, in the order in which they build on each other:
    arrays, elementary, vectors: status codes, tolerances, the tendon law; functions of numbers, lanes and vectors.
    formulas: the names of what a class of chains brings.
    linear, long_chain, long_lu, bounds: dense algebra on the free joints, steps in O(n), limits of joints.
    tendons, friction: tensions and their energy; capstan friction with memory.
    newton, descent, settle: Newton's method, the slow way where it fails, one equilibrium from one start.
    chain, rubbed_chain: energy, stiffness and generators of a chain; the same with friction.
    rolling, planar_loads, rolling_solve: planar rolling chains, loads in the plane, one equilibrium.
    hinges, spatial_loads, hinge_solve: arms of hinges, loads in space, one equilibrium.
    turns: turns of tendons at their holes, of both.
    lanes, rubbed_block: Newton's method in eight SIMD lanes or a single one, without and with friction.
    rolling_lanes, hinge_lanes: lanes of both.
    batch, rubbed: the solver for all cases, row by row, without and with friction.
"""

from rollingjoint.kernels import hinge_solve as hinge_solve
from rollingjoint.kernels import rolling_solve as rolling_solve
from rollingjoint.kernels import turns as turns
