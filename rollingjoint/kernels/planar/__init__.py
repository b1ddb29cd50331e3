"""Kernels of planar rolling chains. Importing the package registers their formulas for kernels.shared.

Modules:
    arrays: the arrays of a chain, its state and its results, grouped by name.
    block: the memory of eight lanes side by side.
    chain: poses, tendons, residual and stiffness at one configuration.
    forward: kinematics without statics.
    joint: one rolling joint: its table, and the tendon gaps across it.
    loads: what the rows of a load table do: energy, sums, stiffness, for one configuration and side by side.
    rubbed_block: steps with friction in lanes.
    side_by_side: chains in lanes, eight side by side or a single one.
    solve: one equilibrium from one start, one step with friction, and where their results go.
    turns: what friction needs: how far tendons turn at their holes, and what presses the links together.
"""

from rollingjoint.kernels.planar import chain as chain
from rollingjoint.kernels.planar import solve as solve
from rollingjoint.kernels.planar import turns as turns
