"""Kernels of spatial hinge chains. Importing the package registers their formulas for kernels.shared.

Modules:
    arrays: the arrays of a chain, its state and its results, grouped by name.
    chain: poses, tendons, residual and stiffness at one configuration.
    lanes: chains in lanes, eight side by side or a single one.
    loads: what the rows of a load table do: energy, sums, stiffness, for one configuration and in lanes.
    rubbed_block: steps with friction in lanes.
    solve: one equilibrium from one start, one step with friction, and where their results go.
    turns: what friction needs: how far tendons turn at the holes of the beads.
"""

from rollingjoint.kernels.spatial import chain as chain
from rollingjoint.kernels.spatial import solve as solve
from rollingjoint.kernels.spatial import turns as turns
