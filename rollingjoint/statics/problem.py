"""Prepared problems: a mechanism and its loads checked once, for many solves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.chain.batch import solve_one
from rollingjoint.chain.chain import Chain, check_chain, read_only
from rollingjoint.checks import as_choice, seen_as_vector
from rollingjoint.errors import InvalidInput
from rollingjoint.load import Load
from rollingjoint.statics.among import ORIGIN, Around, base_of, has_wall_friction, walls_of
from rollingjoint.statics.batch import solve_one_among
from rollingjoint.statics.inputs import History, Start, angles_of, checked_history, tension_limits_of
from rollingjoint.statics.slot import Law, Slot, full_law

Array = NDArray[np.float64]
S = TypeVar("S")

GIVEN = ("lengths", "tensions")


class Problem(Generic[S]):
    """A mechanism under fixed loads; `solve` finds its equilibria, and `prepare` makes it.

    Any number of threads may solve one problem at once. Pickles hold the arguments of its constructor.

    Attributes:
        mechanism: the RollingChain or HingeChain. given: "lengths" or "tensions".
        loads: load table, (rows, columns), read-only. tension_limits: minimum and maximum, (2, m) [N].
        walls: arrays of its surroundings, or None.
    """

    def __init__(self, mechanism: Chain[S], given: str, loads: Array, tension_limits: Array, walls: Any = None) -> None:
        self.mechanism, self.given = mechanism, given
        self.loads, self.tension_limits = read_only(loads), read_only(tension_limits)
        self.walls = walls
        self._rubs = mechanism.has_friction or (walls is not None and has_wall_friction(walls))
        self._n_tendons = mechanism.n_tendons
        self._spares: list[Slot] = []

    def solve(self, values: ArrayLike, start: Start = None, history: History = None, base: ArrayLike = ORIGIN) -> S:
        """The equilibrium that solve_lengths or solve_tensions finds, to the last bit.

        Args:
            values: tendon lengths [mm] or tensions [N], (m,), whichever is given.
            start: joint angles (n - 1,) [rad] or an equilibrium to start from; default s = 0, or hinges at rest.
            history: for a mechanism with friction, the equilibrium before this step, or its friction_state. Default
                start: its joint angles.
            base: pose of the base among the surroundings, x, y [mm], angle [rad]; in space x, y, z [mm], and after them
                a rotation vector [rad] if it is turned.
        Returns:
            Equilibrium or HingeEquilibrium; look at its status.
        Raises:
            InvalidInput: wrong shapes or types.
        """
        command = seen_as_vector(self.given, values, self._n_tendons, "one per tendon")
        angles = angles_of(self.mechanism, start, history)
        if history is not None and self._rubs:
            return self._step(command, angles, (start, history), base)
        spares = self._spares
        try:
            slot = spares.pop()  # in one step, whichever threads come together
        except IndexError:
            slot = self._new_slot()
        if self.given == "lengths":
            slot.law.command[...] = command  # [:] takes half as long again
        else:
            slot.law.low[...] = slot.law.high[...] = command
        slot.start[...] = angles
        if self.walls is not None:
            slot.enter_way(base_of(base, self.mechanism.dimension), start, history)
        equilibrium: S | None = slot.solve(self.mechanism, self.loads, start is not None or history is not None)
        spares.append(slot)  # not after an interrupt: a thread that was abandoned may still be writing into it
        return equilibrium or self._step(command, angles, (start, history), base)

    def __repr__(self) -> str:
        return f"<Problem of {self.mechanism.name!r}: {self.given} given, {len(self.loads)} rows of loads>"

    def __reduce__(self) -> tuple[Any, ...]:
        """The arguments of the constructor: addresses have no meaning in another process."""
        return _restored, (self.mechanism, self.given, self.loads, self.tension_limits, self.walls)

    def _step(self, command: Array, angles: Array, before: tuple[Start, History], base: ArrayLike) -> S:
        """A step with friction, or one among walls that passes through one as a whole."""
        law, loads, history = full_law(self._law(command), self._n_tendons), self.loads.copy(), before[1]
        equilibrium: S
        if self.walls is not None:
            equilibrium = solve_one_among(self.mechanism, law, loads, angles, before, self.walls, base)
        else:
            past = checked_history(self.mechanism, history, None)
            equilibrium = solve_one(self.mechanism, law, loads, angles.copy(), past)
        return equilibrium

    def _law(self, command: ArrayLike) -> Law:
        if self.given == "tensions":
            return 0.0, 1.0, command, command
        low, high = self.tension_limits
        return command, self.mechanism.stiffnesses, low, high

    def _new_slot(self) -> Slot:
        slot = Slot(self.mechanism, len(self.loads), self.walls)
        slot.enter(self._law(0.0), self.loads, self.mechanism.neutral_angles)
        return slot


def prepare(
    mechanism: Chain[S],
    loads: Sequence[Load] = (),
    given: str = "lengths",
    tension_limits: tuple[ArrayLike, ArrayLike] = (0.0, np.inf),
    surroundings: Around = None,
) -> Problem[S]:
    """A problem that is checked once, for many solves under the same loads.

    `prepare(mechanism, loads).solve(lengths)` is `solve_lengths(mechanism, lengths, loads)`, and with given="tensions"
    it is solve_tensions. Other loads are another problem: prepare again.

    Args:
        mechanism: a RollingChain or a HingeChain.
        loads: external loads.
        given: "lengths" (elastic tendons) or "tensions".
        tension_limits: minimum and maximum tendon tension, numbers or (m,) [N]; only where lengths are given.
        surroundings: walls around the mechanism; None: none.
    Raises:
        InvalidInput: wrong types, a load on a link that does not exist, tension limits where tensions are given.
    """
    check_chain(mechanism)
    as_choice("given", given, GIVEN)
    limits = tension_limits_of(tension_limits, mechanism.n_tendons)
    if given == "tensions" and (limits[0].any() or not np.isposinf(limits[1]).all()):
        raise InvalidInput("tension_limits", tension_limits, '(0, inf) with given="tensions"')
    walls = None if surroundings is None else walls_of(surroundings, mechanism)
    return Problem(mechanism, given, mechanism.load_table(loads), limits, walls)


def _restored(mechanism: Chain[S], given: str, loads: Array, tension_limits: Array, walls: Any = None) -> Problem[S]:
    return Problem(mechanism, given, loads, tension_limits, walls)
