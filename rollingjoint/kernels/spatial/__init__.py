"""Kernels of spatial hinge chains. Importing the package registers their formulas for kernels.shared.

Modules:
    arrays: the arrays of a chain, its state and its results, grouped by name.
    batch: the solver, lane by lane.
    chain: poses, tendons, loads, residual and stiffness at one configuration.
    rubbed: the solver of steps with friction, lane by lane.
    solve: one equilibrium from one start.
    springs: springs to fixed points: forces, energy, stiffness.
    turns: what friction needs: how far tendons turn at the holes of the beads.
    vectors: vectors in space, as three numbers.
"""

from rollingjoint.kernels.spatial import chain as chain
from rollingjoint.kernels.spatial import turns as turns
