"""The mechanism behind the motors of a simulated rig: play, sheaths, friction in the holes, a load."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from agents.rig.protocols import Array
from rollingjoint import Status, solve_lengths, solve_tensions
from rollingjoint.chain.chain import AnyChain
from rollingjoint.load import Load
from rollingjoint.transmission import play_step, sheath_direction, sheath_ratio, unstretched_length

START_TENSION = 3.0  # N


class Plant:
    """A mechanism whose motors stand at q and whose tendons at p, both unstretched lengths (m,) [mm].

    Args:
        mechanism: with friction in its holes or not.
        play: widths [mm]. sheath: coefficients. offsets: true length minus p [mm]; numbers or (m,).
        loads: on the mechanism. start_tension: in the beginning, of all tendons [N].
        noise: standard deviation of load cells [N]. seed: of that.

    Attributes:
        lost: how often no equilibrium was found; the mechanism then stays as it was.
    """

    def __init__(
        self,
        mechanism: AnyChain,
        play: ArrayLike = 0.0,
        sheath: ArrayLike = 0.0,
        offsets: ArrayLike = 0.0,
        loads: Sequence[Load] = (),
        start_tension: float = START_TENSION,
        noise: float = 0.1,
        seed: int = 0,
    ) -> None:
        m = mechanism.n_tendons
        self.mechanism, self.loads = mechanism, loads
        self.half = 0.5 * np.broadcast_to(np.asarray(play, float), (m,))
        self.sheath, self.offsets = (np.broadcast_to(np.asarray(each, float), (m,)) for each in (sheath, offsets))
        self.noise, self._rng, self.lost = noise, np.random.default_rng(seed), 0
        self._at: Any = solve_tensions(mechanism, np.full(m, start_tension))
        self.p: Array = unstretched_length(self._at.lengths, start_tension, mechanism.stiffnesses) - self.offsets
        self.q: Array = self.p.copy()
        self._solved: bytes | None = None

    def move(self, q: Array) -> None:
        """Motors go to q on a straight way; tendons follow through the play."""
        self.p, self.q = play_step(self.p, q, self.half), np.array(q, float)

    def carry(self, loads: Sequence[Load]) -> None:
        """Put other loads on the mechanism, where it stands."""
        self.loads, self._solved = loads, None

    def settle(self) -> Any:
        """The equilibrium."""
        key = self.p.tobytes()
        if key != self._solved:
            history = self._at if self.mechanism.has_friction else None
            found = solve_lengths(self.mechanism, self.p + self.offsets, self.loads, start=self._at, history=history)
            if found.status <= Status.AT_LIMIT:
                self._at = found
            else:
                self.lost += 1
            self._solved = key
        return self._at

    def saved(self) -> tuple[Any, ...]:
        """The state, for `restore`."""
        return self.p, self.q, self._at, self._solved

    def restore(self, state: tuple[Any, ...]) -> None:
        """Go back to a saved state."""
        self.p, self.q, self._at, self._solved = state

    @property
    def motor_tensions(self) -> Array:
        """Tensions before the sheaths, (m,) [N]."""
        place = sheath_direction(self.p, self.q, self.half)
        return np.asarray(self.settle().tensions * sheath_ratio(self.sheath, place))

    def weighed(self) -> Array:
        """What load cells at the motors show, (m,) [N]."""
        noise = self.noise * self._rng.standard_normal(len(self.p))
        return np.maximum(self.motor_tensions + noise, 0.0)

    @property
    def tip(self) -> Array:
        """Place of the tip [mm]."""
        return np.asarray(self.settle().tip[: self.mechanism.dimension])
