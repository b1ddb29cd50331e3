"""The result of a plan: lengths over time, where they lead, and what hinders them."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rollingjoint.inverse.result import limits_reached

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


class PlanStatus(IntEnum):
    """How a step of a plan ended."""

    FOLLOWED = 0
    MISSED = 1
    DETOUR = 2
    SNAPPED = 3
    NO_EQUILIBRIUM = 4

    @property
    def message(self) -> str:
        """Meaning and remedy, one line."""
        return _MESSAGES[self]


_MESSAGES = {
    PlanStatus.FOLLOWED: "followed",
    PlanStatus.MISSED: "missed: the nearest equilibrium within the limits, without a snap; widen limits that bind",
    PlanStatus.DETOUR: "detour: off the path, on the way to another pose for this target",
    PlanStatus.SNAPPED: "snapped: the mechanism jumps to another pose in this step; try a path around it",
    PlanStatus.NO_EQUILIBRIUM: "no stable equilibrium: the plan goes on from the step before",
}


@dataclass(frozen=True, eq=False, repr=False)
class Plan:
    """Commands along a path, K steps, and the equilibria that they lead to, one after the other.

    Attributes:
        equilibria: of every step, in the frame of the base.
        lengths: commanded, (K, m) [mm]. times: (K,) [s].
        targets: where every step should lead, (K, ...), as the path of the caller. waypoints: steps of the path itself.
        distance: from the target, (K,) [mm], a turn of 1 rad counted as `lever` mm.
        status: (K,) of every step, PlanStatus.
        at_rate: (K, m) True where the rate of a tendon is at its limit.
        tension_limits: lowest and highest, (m,) each [N]. wall_force_limit: cap on the normal force of a contact [N].
        prefer: which of many solutions is planned. solves: of all attempts.
    """

    equilibria: Any
    lengths: Array
    times: Array
    targets: Array
    waypoints: NDArray[np.int64]
    distance: Array
    status: NDArray[np.int64]
    at_rate: Mask
    tension_limits: tuple[Array, Array]
    wall_force_limit: float
    prefer: str
    solves: int

    @property
    def ok(self) -> bool:
        """Whether all steps lead where they should, without a snap."""
        return bool((self.status == PlanStatus.FOLLOWED).all())

    @property
    def snapped(self) -> Mask:
        """(K,) True for steps in which the mechanism snaps."""
        return np.asarray(self.status == PlanStatus.SNAPPED)

    @property
    def tensions(self) -> Array:
        """(K, m) [N]."""
        return np.asarray(self.equilibria.tensions)

    @property
    def tip(self) -> Array:
        """(K, 2 or 3) origin of the last link, in the frame of the base [mm]."""
        return np.asarray(self.equilibria.tip)

    @property
    def stability(self) -> Array:
        """(K,) smallest eigenvalue of the stiffness [N·mm/rad]; it falls to 0 where the mechanism snaps."""
        return np.asarray(self.equilibria.smallest_eigenvalue)

    @property
    def wall_force(self) -> Array:
        """(K,) largest normal force of a contact with a wall [N]; 0 without walls."""
        walls = self.equilibria.walls
        return np.zeros(len(self.times)) if walls is None else np.asarray(walls.normals.max(axis=1, initial=0.0))

    @property
    def binding(self) -> str:
        """The limits that bind in any step that misses its target, in words; empty if there are none."""
        missed = self.status == PlanStatus.MISSED
        at_lowest, at_highest = limits_reached(self.tensions[missed], *self.tension_limits)
        parts = [
            f"tendon {', '.join(map(str, np.flatnonzero(mask.any(axis=0))))} at {where}"
            for mask, where in (
                (at_lowest, "the lowest tension"),
                (at_highest, "the highest tension"),
                (self.at_rate[missed], "the highest rate"),
            )
            if mask.any()
        ]
        held = ~np.asarray(self.equilibria.free_joints)[missed]
        if held.any():
            parts.append(f"joint {', '.join(map(str, np.flatnonzero(held.any(axis=0))))} at its limit")
        if (self.wall_force[missed] >= (1.0 - 1e-6) * self.wall_force_limit).any():
            parts.append("a wall at its highest force")
        return "; ".join(parts)

    def __repr__(self) -> str:
        values, counts = np.unique(self.status, return_counts=True)
        counted = ", ".join(f"{n} {PlanStatus(code).name}" for code, n in zip(values, counts, strict=True))
        return f"<Plan, {len(self.times)} steps in {self.times[-1] - self.times[0]:.3g} s: {counted}>"
