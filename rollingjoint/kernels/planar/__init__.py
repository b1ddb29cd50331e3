"""Kernels of planar rolling chains. Importing the package registers their formulas for kernels.shared.

Modules:
    arrays: the arrays of a chain, its state and its results, grouped by name.
    batch: the solver for all cases, lane by lane.
    block: the memory of eight lanes side by side.
    block_formulas: what the driver of eight lanes calls, with friction or without.
    chain: poses, tendons, residual and stiffness at one configuration.
    forward: kinematics without statics.
    joint: one rolling joint: its table, and the tendon gaps across it.
    loads: what the rows of a load table do: energy, sums, stiffness, for one configuration and side by side.
    rubbed: the solver of steps with friction, lane by lane.
    side_by_side: the solver of eight lanes side by side, and of a single one.
    solve: one equilibrium from one start, one step with friction.
    steps_side_by_side: the solver of eight lanes with friction.
    turns: what friction needs: how far tendons turn at their holes, and what presses the links together.
"""

from rollingjoint.kernels.planar import chain as chain
from rollingjoint.kernels.planar import turns as turns
