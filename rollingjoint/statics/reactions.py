"""Forces and moments that the hinges of arms carry, for bearings and pins."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from rollingjoint.chain.equilibrium import HingeEquilibrium
from rollingjoint.chain.hinge import HingeChain
from rollingjoint.chain.spatial import SpatialChain
from rollingjoint.chain.stacks import designs_of
from rollingjoint.chain.status import Status
from rollingjoint.errors import InvalidInput
from rollingjoint.kernels.hinge_solve import reactions_of

Array = NDArray[np.float64]


def hinge_reactions(equilibrium: HingeEquilibrium) -> Array:
    """Force and moment that every hinge of an arm carries, on the link above and about the hinge, (n - 1, 6) [N, N·mm].

    Each along the directions of the hinge's frame in the link below (`hinge_frames`), its axis last: the first two
    forces press the pin against its bearing, the third is along the pin, the first two moments tilt it, and the third
    is the spring's. After a step with friction tendons pull with the tensions of their gaps.

    Args:
        equilibrium: one, or a batch: (B, n - 1, 6). Rows without valid inputs are NaN.
    Raises:
        InvalidInput: not of an arm, or of one whose tendons are not exact.
    Source: docs/theory.md, section 11.
    """
    if not isinstance(equilibrium, HingeEquilibrium):
        hint = "The reactions of chains in space are `equilibrium.reactions`."
        raise InvalidInput("equilibrium", equilibrium, "a HingeEquilibrium", hint)
    rows, angles = np.shape(equilibrium.status), equilibrium.joint_angles
    count = int(np.prod(rows))
    arms = equilibrium.mechanism
    hinges = tuple(map(_hinges, arms)) if isinstance(arms, tuple) else _hinges(arms)
    chain, designs = designs_of(hinges, count)
    valid = np.reshape(equilibrium.status, count) != int(Status.INVALID_INPUT)
    loads = np.where(valid[:, None, None], equilibrium.loads.reshape(count, *equilibrium.loads.shape[-2:]), 0.0)
    reactions = np.empty((count, angles.shape[-1], 6))
    tensions = np.ascontiguousarray(equilibrium.gap_tensions.reshape(count, *equilibrium.gap_tensions.shape[-2:]))
    reactions_of(chain, designs, tensions, loads, np.ascontiguousarray(angles.reshape(count, -1)), reactions)
    reactions[~valid] = np.nan
    return reactions.reshape(*angles.shape, 6)


def hinge_frames(arm: HingeChain) -> Array:
    """Directions of the reactions, rows, in the links below, (n - 1, 3, 3): two across the axis of every hinge, and it.

    Raises:
        InvalidInput: an arm whose tendons are not exact.
    """
    return np.array([joint.frame for joint in _hinges(arm).joints])


@lru_cache(maxsize=256)
def _hinges(arm: HingeChain) -> SpatialChain:
    """The arm as a chain of hinges in space."""
    if arm.model != "exact":
        raise InvalidInput("tendon model", arm.model, "'exact': other models tell no forces of tendons between beads")
    return SpatialChain.from_arm(arm)
