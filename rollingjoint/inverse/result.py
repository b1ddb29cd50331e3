"""Results of the inverse: an equilibrium, how near it is to the target, and the limits that bind."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.chain.solution import stacked
from rollingjoint.chain.status import codes_of
from rollingjoint.errors import InvalidInput
from rollingjoint.inverse.aims import contact_force_of, stiffness_along, unit_direction

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


_AT_LIMIT = 1e-6  # of a limit, or N, or rad: so near a tension, or an angle, is at it


class ReachStatus(IntEnum):
    """How a search ended."""

    REACHED = 0
    OUT_OF_REACH = 1
    NOT_CONVERGED = 2
    NO_EQUILIBRIUM = 3
    INVALID_INPUT = 4
    BEYOND_LIMITS = 5

    @property
    def message(self) -> str:
        """Meaning and remedy, one line."""
        return _MESSAGES[self]


_MESSAGES = {
    ReachStatus.REACHED: "reached",
    ReachStatus.OUT_OF_REACH: "out of reach: the nearest equilibrium found; widen limits that bind, or try more starts",
    ReachStatus.NOT_CONVERGED: "not converged: the best equilibrium found; try more starts",
    ReachStatus.NO_EQUILIBRIUM: "no stable equilibrium found: are the loads too large for the tension limits?",
    ReachStatus.INVALID_INPUT: "invalid numbers: NaN, beyond 1e12, a pushing tendon, limits out of order",
    ReachStatus.BEYOND_LIMITS: "no equilibrium found that keeps the joint limits, or the cap on wall forces",
}


def limits_reached(tensions: Array, low: ArrayLike, high: ArrayLike) -> tuple[Mask, Mask]:
    """Whether tensions are at the lowest, and at the highest one."""
    low, high = np.asarray(low), np.asarray(high)
    room = _AT_LIMIT * np.where(np.isfinite(high), np.maximum(high, 1.0), 0.0)
    return np.asarray(tensions <= low + _AT_LIMIT * np.maximum(low, 1.0)), np.asarray(tensions >= high - room)


@dataclass(frozen=True, eq=False, repr=False)
class Reach:
    """An equilibrium near a target, or many with a leading axis B.

    Attributes:
        equilibrium: of these lengths or tensions, as solve_lengths or solve_tensions return it.
        lengths: unstretched tendon lengths that hold it, (m,) [mm].
        distance: from the target [mm]: of the tip, or the root of the mean square over the links, a turn of 1 rad
            counted as `lever` mm.
        status: ReachStatus, or (B,) integers.
        tension_limits: lowest and highest, numbers or (m,) [N].
        from_rest: whether a solver that starts at rest ends here; where not, start it at equilibrium.joint_angles.
        iterations: Gauss-Newton steps of all starts.
        joint_limits: that were given, (2, n - 1) [rad]; None: the mechanism's.
    """

    equilibrium: Any
    lengths: Array
    distance: float | Array
    status: ReachStatus | NDArray[np.int64]
    tension_limits: tuple[ArrayLike, ArrayLike]
    from_rest: bool | Mask
    iterations: int | NDArray[np.int64]
    joint_limits: Array | None = None

    @property
    def tensions(self) -> Array:
        """(m,) [N]."""
        return np.asarray(self.equilibrium.tensions)

    @property
    def at_lowest(self) -> Mask:
        """(m,) True for tendons at their lowest tension."""
        return limits_reached(self.tensions, *self.tension_limits)[0]

    @property
    def at_highest(self) -> Mask:
        """(m,) True for tendons at their highest tension."""
        return limits_reached(self.tensions, *self.tension_limits)[1]

    @property
    def tip(self) -> Array:
        """Origin of the last link at the equilibrium, (2,) or (3,) [mm]."""
        return np.asarray(self.equilibrium.tip)

    @property
    def joint_angles(self) -> Array:
        """(n - 1,) [rad]."""
        return np.asarray(self.equilibrium.joint_angles)

    @property
    def joints_at_limit(self) -> Mask:
        """(n - 1,) True for joints at the end of their range, or at a limit that was given, or beyond."""
        held = ~np.asarray(self.equilibrium.free_joints)
        if self.joint_limits is None:
            return held
        low, high = self.joint_limits
        return held | (self.joint_angles <= low + _AT_LIMIT) | (self.joint_angles >= high - _AT_LIMIT)

    @property
    def contact_force(self) -> float:
        """Sum of the normal forces with which the last link presses on walls, of a single reach [N]."""
        return contact_force_of(self._single("contact_force"))

    def tip_stiffness(self, direction: ArrayLike) -> float:
        """Force per displacement of the tip along a direction, (2 or 3,), of a single reach [N/mm].

        The tip is free to move across it, all lengths are held, and no tendon yields. Infinite where joints at their
        limits leave it no way to move.
        """
        single = self._single("tip_stiffness")
        return stiffness_along(single, unit_direction("direction", direction, self.tip.shape[-1]))

    @property
    def ok(self) -> bool | Mask:
        """True where the target is reached."""
        reached = codes_of(self.status) == int(ReachStatus.REACHED)
        return bool(reached) if reached.ndim == 0 else reached

    @property
    def binding(self) -> str:
        """The limits that bind, in words, of a single reach; empty if there are none."""
        parts = [
            f"{what} {', '.join(map(str, np.flatnonzero(mask)))} at {where}"
            for what, mask, where in (
                ("tendon", self.at_lowest, "the lowest tension"),
                ("tendon", self.at_highest, "the highest tension"),
                ("joint", self.joints_at_limit, "its limit"),
            )
            if np.any(mask)
        ]
        return "; ".join(parts)

    def _single(self, what: str) -> Any:
        """The equilibrium; InvalidInput where there are many."""
        if np.ndim(self.distance):
            raise InvalidInput(what, f"of {np.size(self.distance)} rows", "a single reach", "Take one: row(i).")
        return self.equilibrium

    def row(self, index: int) -> Reach:
        """One of many."""
        distance, status, rest, count = (
            np.asarray(values)[index].item() for values in (self.distance, self.status, self.from_rest, self.iterations)
        )
        equilibrium, limits = self.equilibrium.row(index), self.tension_limits
        lengths, status = self.lengths[index], ReachStatus(status)
        return Reach(equilibrium, lengths, distance, status, limits, rest, count, self.joint_limits)

    def with_rows(self, rows: NDArray[np.int64], others: Sequence[Reach]) -> Reach:
        """Many, of which those of some rows are replaced by single ones."""
        if not len(rows):
            return self
        equilibria = self.equilibrium.with_rows(rows, stacked([other.equilibrium for other in others]))
        names = "lengths", "distance", "status", "from_rest", "iterations"
        arrays: dict[str, Any] = {name: np.array(getattr(self, name)) for name in names}
        for name, array in arrays.items():
            array[rows] = [getattr(other, name) for other in others]
        return replace(self, equilibrium=equilibria, **arrays)

    def __repr__(self) -> str:
        codes = codes_of(self.status)
        if codes.ndim:
            values, counts = np.unique(codes, return_counts=True)
            counted = ", ".join(f"{n} {ReachStatus(code).name}" for code, n in zip(values, counts, strict=True))
            return f"<Reach, {codes.size} rows: {counted or 'none'}>"
        point = ", ".join(f"{x:.3f}" for x in self.tip)
        return f"<Reach: {ReachStatus(int(codes)).name}, tip at ({point}) mm, {float(self.distance):.3g} mm off>"
