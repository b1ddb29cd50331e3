"""Compiled kernels: arrays in, arrays and an integer status out. Kernels do not raise.

Importing the package registers the formulas of all classes of chains (formulas.py).

Modules:
    arrays: status codes, the tendon law, tolerances.
    batch: the general solver and the stiffness of its solutions, row by row.
    bounds: joint angles between the limits of their joints.
    chain: energy, stiffness and its generators of a chain at one configuration.
    contact_lanes: chains in space with contacts in lanes.
    contacts: chains in space with contacts: arrays, poses, gaps, tendon lengths.
    descent: the slow, sure way to an equilibrium, where Newton's method ends without one.
    elementary: elementary functions of numbers and SIMD lanes alike.
    formulas: the names of the formulas that a class of chains brings.
    friction: capstan friction with memory: tensions, slip and their rates.
    gaps: gaps between outlines and obstacles, ways along them, and the law of a gap.
    hinge_lanes: arms in lanes, without and with friction.
    hinge_solve: one equilibrium of a chain in space, one step with friction, and the place of results.
    hinges: arms: arrays, poses, gaps, tendon lengths.
    inverse: tensions and equilibria that bring links where they should be.
    joints: rolling joints: rows of their tables, gaps between holes.
    lanes: Newton's method in eight SIMD lanes side by side, or in a single one.
    linear: small dense linear algebra on the free joints.
    long_chain: Newton steps in O(n).
    long_lu: Newton steps in O(n) with friction.
    lumens: points in lumens: pieces of the centre line, gaps and ways.
    newton: Newton's method with a line search.
    passing: whether a planar chain has passed through a wall.
    passing_in_space: whether a chain in space has passed through a wall.
    planar_loads: loads in the plane: energy, sums, stiffness.
    rolling: planar rolling chains: arrays, joint tables, gaps, poses, residual, contact forces.
    rolling_lanes: planar chains in lanes, without and with friction.
    rolling_solve: one equilibrium of a planar chain, one step with friction, and the place of results.
    rubbed: steps with friction of the general solver, histories and stiffness, row by row.
    rubbed_block: steps with friction in lanes.
    rubbed_chain: a chain with friction, and its steps.
    seen_walls: walls as seen from the base.
    settle: one equilibrium from one start, with fallbacks.
    spatial_lanes: lanes of chains in space: all that arms and chains with contacts share.
    spatial_loads: loads in space: energy, sums, stiffness, and the residual.
    spatial_wall_contacts: contact of an outline with walls in space, its energy and its sums.
    spatial_walled_chain: a chain in space among walls.
    spatial_walls: arrays of walls and outlines in space, and walls as seen from the base.
    tendons: tensions and their energy from the lengths, and the balance at a joint.
    torsion_springs: springs between two links, in the plane and in space.
    turns: turns of tendons at their holes, and the forces that press links together.
    vectors: vectors of the plane and of space.
    wall_contacts: contact of an outline with walls, its energy and its sums.
    walled_chain: a planar chain among walls.
    walled_lanes: planar chains among walls in a lane of their own.
    walled_solve: equilibria among walls, row by row, and what contacts remember.
    walls: arrays of walls and outlines.
"""

from rollingjoint.kernels import hinge_solve as hinge_solve
from rollingjoint.kernels import rolling_solve as rolling_solve
from rollingjoint.kernels import turns as turns
