"""Loops: paths back and forth between two inputs, which open up under friction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.chain.chain import AnyChain
from rollingjoint.checks import as_choice, as_integer, as_vector
from rollingjoint.errors import InvalidInput
from rollingjoint.load import Load
from rollingjoint.statics.among import ORIGIN, Around
from rollingjoint.statics.solve import solve_tensions
from rollingjoint.statics.trace import trace

Array = NDArray[np.float64]

MIDDLE_TENSION = 3.0
"""Tension of every tendon in the middle of a loop unless another middle is given [N]."""
MOST_STEPS = 25_000
"""Largest product of cycles and steps of a loop: every equilibrium is kept."""


@dataclass(frozen=True, eq=False)
class Loop:
    """A path back and forth between two inputs; the figures are of its last cycle.

    Attributes:
        path: equilibria of all K steps: from the middle to the first end, then in every cycle to the second and back.
        shares: (K,) input of every step as a share of the swing: 0 in the middle, 1 and -1 at the ends.
        middle, swing: (m,) input in the middle, and from there to the first end, lengths [mm] or tensions [N].
        steps: steps from one end to the other.
        given: "lengths" or "tensions".
    """

    path: Any
    shares: Array
    middle: Array
    swing: Array
    steps: int
    given: str

    @property
    def ok(self) -> bool:
        """True if every step is a stable equilibrium."""
        return bool(np.all(self.path.ok))

    @property
    def inputs(self) -> Array:
        """(K, m) commanded lengths [mm] or tensions [N]."""
        return inputs_of(self.middle, self.swing, self.shares)

    @property
    def cycle(self) -> slice:
        """The last cycle in the path, both its ends included: 2 steps + 1 equilibria."""
        return slice(-2 * self.steps - 1, None)

    @property
    def branches(self) -> Array:
        """(2, steps + 1, 2 or 3) tip on the outward and the return branch, both in the outward order [mm]."""
        tips = self.path.tip[self.cycle]
        return np.stack([tips[: self.steps + 1], tips[: self.steps - 1 : -1]])

    @property
    def widths(self) -> Array:
        """(steps + 1,) distance of the tip between both branches at equal inputs [mm]."""
        outward, inward = self.branches
        return np.linalg.norm(outward - inward, axis=-1)

    @property
    def width(self) -> float:
        """The largest of the widths [mm]."""
        return float(self.widths.max())

    @property
    def width_in_the_middle(self) -> float:
        """The width at the input in the middle, or next to it on the outward branch [mm]."""
        return float(self.widths[self.steps // 2])

    @property
    def travel(self) -> float:
        """Distance of the tip between both ends [mm]."""
        outward, _ = self.branches
        return float(np.linalg.norm(outward[-1] - outward[0]))

    @property
    def dissipated_work(self) -> float:
        """Work of friction in a cycle [N·mm]."""
        return float(np.sum(self.path.dissipated_work[self.cycle][1:]))

    @property
    def motor_work(self) -> float:
        """Work of the motors in a cycle, by the trapezoidal rule [N·mm]."""
        tensions, lengths = self.path.tensions[self.cycle], self.path.lengths[self.cycle]
        return float(-np.sum(0.5 * (tensions[1:] + tensions[:-1]) * np.diff(lengths, axis=0)))

    @property
    def base_work(self) -> float:
        """Work of what moves the base among walls in a cycle, by the trapezoidal rule [N·mm]; 0 without walls."""
        if self.path.walls is None:
            return 0.0
        return base_work(self.path, self.cycle)

    @property
    def sticking(self) -> float:
        """Share of the links' holes that stick, mean over the cycle; 0 without friction."""
        if self.path.friction is None:
            return 0.0
        crossed = sum(self.path.mechanism.last_links)
        return float(np.sum(self.path.sticking[self.cycle][1:]) / (2 * self.steps * crossed))


def trace_loop(
    mechanism: AnyChain,
    swing: ArrayLike,
    middle: ArrayLike | None = None,
    loads: Sequence[Load] = (),
    given: str = "lengths",
    tension_limits: tuple[ArrayLike, ArrayLike] = (0.0, np.inf),
    cycles: int = 2,
    steps: int = 200,
    surroundings: Around = None,
    base: ArrayLike = ORIGIN,
    base_swing: ArrayLike = ORIGIN,
) -> Loop:
    """The loop of a mechanism that is driven to both sides of a middle.

    It begins in the middle, in the pose without friction, before any slip.

    Args:
        mechanism: a RollingChain or a HingeChain.
        swing: (m,) change of the inputs from the middle to the first end, lengths [mm] or tensions [N].
        middle: (m,) inputs in the middle; default: a tension of 3 N in every tendon, or the commanded lengths that
            give it.
        loads: external loads of all steps.
        given: "lengths" or "tensions".
        tension_limits: with lengths, minimum and maximum tendon tension, numbers or (m,) [N].
        cycles: number of cycles, 1 or more.
        steps: steps from one end to the other, 1 or more; cycles x steps is at most MOST_STEPS.
        surroundings: walls around the mechanism, a RollingChain; None: none. base: pose of its base among them in the
            middle, x, y [mm], angle [rad]. base_swing: its change from there to the first end.
    Raises:
        InvalidInput: wrong shapes or types, numbers that are not finite, too many steps.
    """
    as_choice("given", given, ("lengths", "tensions"))
    to_end = _per_tendon("swing", swing, mechanism)
    centre = _middle(mechanism, given) if middle is None else _per_tendon("middle", middle, mechanism)
    steps = as_integer("steps", steps, 1, MOST_STEPS)
    cycles = as_integer("cycles", cycles, 1, MOST_STEPS // steps)
    outward = np.linspace(1.0, -1.0, steps + 1)
    shares = np.concatenate(
        [np.linspace(0.0, 1.0, (steps + 1) // 2 + 1), *([outward[1:], outward[-2::-1]] * cycles)], axis=0
    )
    inputs = inputs_of(centre, to_end, shares)
    bases = inputs_of(_pose("base", base), _pose("base_swing", base_swing), shares)
    among: dict[str, Any] = {"surroundings": surroundings, "base": bases}
    path = trace(mechanism, inputs, loads, given=given, tension_limits=tension_limits, **among)
    return Loop(path, shares, centre, to_end, steps, given)


def inputs_of(middle: Array, swing: Array, shares: Array) -> Array:
    """(K, m) inputs at shares of the swing."""
    return middle + shares[:, None] * swing


def base_work(path: Any, steps: slice = slice(None)) -> float:
    """Work of what moves the base of a path among walls, by the trapezoidal rule [N·mm]."""
    bases, forces = path.walls.base[steps], -path.wall_forces[steps]
    x, y = np.moveaxis(path.poses[steps, :, :2], -1, 0)
    moment = (forces[..., 2] + x * forces[..., 1] - y * forces[..., 0]).sum(axis=-1)
    fx, fy, _ = np.moveaxis(forces.sum(axis=1), -1, 0)
    cos, sin = np.cos(bases[:, 2]), np.sin(bases[:, 2])
    driving = np.stack([cos * fx - sin * fy, sin * fx + cos * fy, moment], axis=-1)
    return float(np.sum(0.5 * (driving[1:] + driving[:-1]) * np.diff(bases, axis=0)))


def _pose(what: str, values: ArrayLike) -> Array:
    """The pose of a base or its change, finite, (3,)."""
    array = as_vector(what, values, 3, "x, y [mm] and angle [rad]")
    if not np.all(np.isfinite(array)):
        raise InvalidInput(what, values, "3 finite numbers: x, y [mm] and angle [rad]")
    return array


def _per_tendon(what: str, values: ArrayLike, mechanism: AnyChain) -> Array:
    """The values, finite, (m,)."""
    array = as_vector(what, values, mechanism.n_tendons, "one per tendon")
    if not np.all(np.isfinite(array)):
        raise InvalidInput(what, values, f"{mechanism.n_tendons} finite numbers, one per tendon")
    return array


def _middle(mechanism: AnyChain, given: str) -> Array:
    """Inputs that pull every tendon with the same tension."""
    tensions = np.full(mechanism.n_tendons, MIDDLE_TENSION)
    if given == "tensions":
        return tensions
    return solve_tensions(mechanism, tensions).require().lengths - tensions / mechanism.stiffnesses
