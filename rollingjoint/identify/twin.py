"""The model of a recorded rig: its motors go along their recorded positions, and load cells and tips are predicted.

    q(t - delay) → play → p → equilibrium at lengths p + offset → T, tip;   load cell: T exp(ν ζ)

The formulas are those of rollingjoint.transmission. Without friction in the holes and without limits the equilibria do
not depend on each other and are solved in one batch; else step by step, all rigs and runs of a step in one batch.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rollingjoint.identify.beliefs import RigSpace
from rollingjoint.identify.recording import RigRecording
from rollingjoint.load import Load
from rollingjoint.statics.solve import solve_lengths_batch
from rollingjoint.transmission import at_limit, play_step, sheath_direction, sheath_ratio, unstretched_length

Array = NDArray[np.float64]
Limits = tuple[float, float]

WIDEST_PLAY = 6.0  # mm: after a way of this much, it does not matter where in its play a tendon began
_SHARE = 0.5  # of the way of a motor in a run, where that is shorter


class Prediction(NamedTuple):
    """Predictions for K rigs in E runs of T steps: tensions (K, E, T, m) [N], tips (K, E, T, d) [mm].

    `ok` (K, E, T) is False from the first step without an equilibrium on.
    """

    tensions: Array
    tips: Array
    ok: NDArray[np.bool_]


class RigModel:
    """A recording and the rigs that may have made it.

    Args:
        recording: as thinned. space: of the rigs.
        loads: known loads that acted all the time.
        limits: of the tension behind the sheath, at which motors give way [N]; rigs have (0, inf).
        first: step of every run from which readings count; None: where every motor has gone through its play.
    """

    def __init__(
        self,
        recording: RigRecording,
        space: RigSpace,
        loads: Sequence[Load] = (),
        limits: Limits = (0.0, np.inf),
        first: int | None = None,
    ) -> None:
        self.space, self.loads, self.limits = space, loads, limits
        longest = max(len(run.t) for run in recording.runs)
        self.t, self.motors, self.tensions, self.tips = (
            np.stack([_padded(getattr(run, name), longest) for run in recording.runs])
            for name in ("t", "motors", "tensions", "tips")
        )
        self.counts = np.stack([np.arange(longest) < len(run.t) for run in recording.runs])
        self.counts &= self._is_settled() if first is None else np.arange(longest) >= first
        self.tips = self.tips[..., : space.mechanism.dimension]
        self._steps_depend = "mu" in space.kinds or space.mechanism.has_friction or limits != (0.0, np.inf)

    def _is_settled(self) -> NDArray[np.bool_]:
        """Whether every motor has gone far enough for its tendon to be at a known place in the play, (E, T)."""
        if "play" not in self.space.kinds:
            return np.ones(self.t.shape, bool)
        low, high = np.minimum.accumulate(self.motors, axis=1), np.maximum.accumulate(self.motors, axis=1)
        way, whole = high - low, np.ptp(self.motors, axis=1, keepdims=True)
        return np.asarray((way >= np.minimum(WIDEST_PLAY, _SHARE * whole)).all(axis=-1))

    def predict(self, vectors: Array) -> Prediction:
        """Predictions for rigs as vectors, (K, P)."""
        motors = self._moved_motors(vectors)
        half, sheath, offsets = (
            np.stack([self.space.value(vector, name) for vector in vectors])[:, None]
            for name in ("play", "sheath", "offsets")
        )
        half = 0.5 * half
        chains = self._chains(vectors)
        follow = self._step_by_step if self._steps_depend else self._all_at_once
        return follow(chains, motors, half, sheath, offsets)

    def _chains(self, vectors: Array) -> list[Any]:
        """The mechanism of every rig; equal ones are the same object."""
        shaping = [name for name in self.space.kinds if name not in ("play", "sheath", "offsets", "delay")]
        chains: dict[bytes, Any] = {}
        listed = []
        for vector in vectors:
            key = b"".join(self.space.fields(vector)[name].tobytes() for name in shaping)
            if key not in chains:
                chains[key] = self.space.chain(vector)
            listed.append(chains[key])
        return listed

    def _moved_motors(self, vectors: Array) -> Array:
        """Where motors were as tensions and tips were read, (K, E, T, m)."""
        if "delay" not in self.space.kinds:
            return np.broadcast_to(self.motors, (len(vectors), *self.motors.shape))
        by_delay: dict[float, Array] = {}
        delays = [float(self.space.value(vector, "delay")[0]) for vector in vectors]
        for delay in delays:
            if delay not in by_delay:
                by_delay[delay] = np.stack([_earlier(*run, delay) for run in zip(self.t, self.motors, strict=True)])
        return np.stack([by_delay[delay] for delay in delays])

    def _all_at_once(self, chains: list[Any], motors: Array, half: Array, sheath: Array, offsets: Array) -> Prediction:
        tendons = np.empty_like(motors)
        p = motors[:, :, 0]
        for step in range(motors.shape[2]):
            p = play_step(p, motors[:, :, step], half)
            tendons[:, :, step] = p
        shape, d = motors.shape[:3], self.space.mechanism.dimension
        tensions, tips, ok = np.empty(motors.shape), np.empty((*shape, d)), np.empty(shape, bool)
        lengths = tendons + offsets[:, :, None]
        for chain in {id(chain): chain for chain in chains}.values():
            rows = [k for k, each in enumerate(chains) if each is chain]
            flat = lengths[rows].reshape(-1, motors.shape[3])
            solved = solve_lengths_batch(chain, flat, self.loads, tension_limits=self.limits)
            tensions[rows] = np.asarray(solved.tensions).reshape(len(rows), *motors.shape[1:])
            tips[rows] = np.asarray(solved.tip).reshape(len(rows), *shape[1:], -1)[..., :d]
            ok[rows] = np.asarray(solved.ok).reshape(len(rows), *shape[1:])
        return self._read(tensions, tips, ok, motors, tendons, half, sheath)

    def _step_by_step(self, chains: list[Any], motors: Array, half: Array, sheath: Array, offsets: Array) -> Prediction:
        (rigs, runs, steps, m), d = motors.shape, self.space.mechanism.dimension
        mechanisms = tuple(chain for chain in chains for _ in range(runs))
        stiffnesses = np.stack([chain.stiffnesses for chain in chains])[:, None]
        tensions, tips, ok = np.empty(motors.shape), np.empty((rigs, runs, steps, d)), np.empty(motors.shape[:3], bool)
        tendons, p, state = np.empty(motors.shape), motors[:, :, 0], None
        rubs = any(chain.has_friction for chain in chains)
        low, high = self.limits
        alive = np.ones((rigs, runs), bool)
        for step in range(steps):
            p = play_step(p, motors[:, :, step], half)
            flat = (p + offsets).reshape(-1, m)
            past = state if rubs else None
            solved = solve_lengths_batch(mechanisms, flat, self.loads, state, self.limits, past)
            alive &= np.asarray(solved.ok).reshape(rigs, runs)
            state = solved
            T = np.asarray(solved.tensions).reshape(rigs, runs, m)
            free = unstretched_length(np.asarray(solved.lengths).reshape(rigs, runs, m), T, stiffnesses) - offsets
            p = np.where(at_limit(T, low, high) & ((low > 0.0) | (T > low)), free, p)
            tensions[:, :, step], tips[:, :, step], ok[:, :, step] = (
                T,
                np.asarray(solved.tip).reshape(rigs, runs, -1)[..., :d],
                alive,
            )
            tendons[:, :, step] = p
        return self._read(tensions, tips, ok, motors, tendons, half, sheath)

    def _read(
        self, tensions: Array, tips: Array, ok: Any, motors: Array, tendons: Array, half: Array, sheath: Array
    ) -> Prediction:
        place = sheath_direction(tendons, motors, half[:, :, None])
        return Prediction(tensions * sheath_ratio(sheath[:, :, None], place), tips, ok)


def _padded(values: Array, count: int) -> Array:
    """Rows up to a count, the last one repeated."""
    return np.concatenate([values, np.repeat(values[-1:], count - len(values), axis=0)])


def _earlier(t: Array, motors: Array, delay: float) -> Array:
    """Positions a delay before the times, (T, m)."""
    return np.stack([np.interp(t - delay, t, column) for column in motors.T], axis=1)
