"""The model of a recorded rig: its motors go along their recorded positions, and load cells and tips are predicted.

    q(t - delay) → play → p → equilibrium at lengths p + offset → T, tip;   load cell: T exp(ν ζ)

The formulas are those of rollingjoint.transmission. Without friction in the holes and without limits the equilibria do
not depend on each other and are solved in one batch. Friction forgets within a few millimetres: runs are cut into parts
that overlap, and all parts of all rigs are solved side by side, step by step. With limits the runs stay whole.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rollingjoint.friction import FrictionState
from rollingjoint.identify.beliefs import RigSpace
from rollingjoint.identify.recording import RigRecording
from rollingjoint.load import Load
from rollingjoint.statics.solve import solve_lengths_batch
from rollingjoint.transmission import at_limit, play_step, sheath_direction, sheath_ratio, unstretched_length

Array = NDArray[np.float64]
Limits = tuple[float, float]

WIDEST_PLAY = 6.0  # mm: after a way of this much, it does not matter where in its play a tendon began
PART, WARM = 50, 15  # steps of a part of a run, and steps before it in which friction comes to its state
_SHARE = 0.5  # of the way of a motor in a run, where that is shorter


class RigPrediction(NamedTuple):
    """Predictions for K rigs in E runs of T steps: tensions (K, E, T, m) [N], tips (K, E, T, d) [mm].

    `ok` (K, E, T) is False where there is no equilibrium; the next step goes on from the last one.
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
        self._rubs, self._limited = "mu" in space.kinds or space.mechanism.has_friction, limits != (0.0, np.inf)

    def _is_settled(self) -> NDArray[np.bool_]:
        """Whether every motor has gone far enough for its tendon to be at a known place in the play, (E, T)."""
        if "play" not in self.space.kinds:
            return np.ones(self.t.shape, bool)
        low, high = np.minimum.accumulate(self.motors, axis=1), np.maximum.accumulate(self.motors, axis=1)
        way, whole = high - low, np.ptp(self.motors, axis=1, keepdims=True)
        return np.asarray((way >= np.minimum(WIDEST_PLAY, _SHARE * whole)).all(axis=-1))

    def predict(self, vectors: Array) -> RigPrediction:
        """Predictions for rigs as vectors, (K, P)."""
        motors = self._moved_motors(vectors)
        half, sheath, offsets = (
            np.stack([self.space.value(vector, name) for vector in vectors])[:, None]
            for name in ("play", "sheath", "offsets")
        )
        half = 0.5 * half
        chains = self._chains(vectors)
        if self._limited:
            return self._step_by_step(chains, motors, half, sheath, offsets)
        tendons = _through_play(motors, half)
        solve = self._in_parts if self._rubs else self._all_at_once
        tensions, tips, ok = solve(chains, tendons + offsets[:, :, None])
        return self._read(tensions, tips, ok, motors, tendons, half, sheath)

    def lengths(self, vectors: Array) -> Array:
        """Unstretched lengths of the tendons behind the play, for rigs without limits, (K, E, T, m) [mm]."""
        half, offsets = (
            np.stack([self.space.value(vector, name) for vector in vectors])[:, None] for name in ("play", "offsets")
        )
        return _through_play(self._moved_motors(vectors), 0.5 * half) + offsets[:, :, None]

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

    def _all_at_once(self, chains: list[Any], lengths: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        shape, d = lengths.shape[:3], self.space.mechanism.dimension
        tensions, tips, ok = np.empty(lengths.shape), np.empty((*shape, d)), np.empty(shape, bool)
        for chain in {id(chain): chain for chain in chains}.values():
            rows = [k for k, each in enumerate(chains) if each is chain]
            solved = solve_lengths_batch(chain, lengths[rows].reshape(-1, lengths.shape[3]), self.loads)
            tensions[rows] = np.asarray(solved.tensions).reshape(len(rows), *lengths.shape[1:])
            tips[rows] = np.asarray(solved.tip).reshape(len(rows), *shape[1:], -1)[..., :d]
            ok[rows] = np.asarray(solved.ok).reshape(len(rows), *shape[1:])
        return tensions, tips, ok

    def _in_parts(self, chains: list[Any], lengths: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        """The same with friction in the holes."""
        (rigs, runs, steps, m), d = lengths.shape, self.space.mechanism.dimension
        tensions, tips, ok = (
            np.empty(lengths.shape),
            np.empty((rigs, runs, steps, d)),
            np.empty(lengths.shape[:3], bool),
        )
        firsts = np.arange(0, steps, PART)
        mechanisms = tuple(chain for chain in chains for _ in range(runs * len(firsts)))
        angles: Any = None
        history: Any = None
        for step in range(-WARM, min(PART, steps)):
            at = np.clip(firsts + step, 0, steps - 1)
            flat = lengths[:, :, at].reshape(-1, m)
            solved = solve_lengths_batch(mechanisms, flat, self.loads, angles, history=history)
            fine, (angles, history) = np.asarray(solved.ok), _remembered(solved, angles, history)
            if step >= 0:
                kept = firsts + step < steps
                parts = rigs, runs, len(firsts)
                tensions[:, :, at[kept]] = np.asarray(solved.tensions).reshape(*parts, m)[:, :, kept]
                tips[:, :, at[kept]] = np.asarray(solved.tip).reshape(*parts, -1)[:, :, kept, :d]
                ok[:, :, at[kept]] = fine.reshape(parts)[:, :, kept]
        return tensions, tips, ok

    def _step_by_step(
        self, chains: list[Any], motors: Array, half: Array, sheath: Array, offsets: Array
    ) -> RigPrediction:
        (rigs, runs, steps, m), d = motors.shape, self.space.mechanism.dimension
        mechanisms = tuple(chain for chain in chains for _ in range(runs))
        stiffnesses = np.stack([chain.stiffnesses for chain in chains])[:, None]
        tensions, tips, ok = np.empty(motors.shape), np.empty((rigs, runs, steps, d)), np.empty(motors.shape[:3], bool)
        tendons, p = np.empty(motors.shape), motors[:, :, 0]
        low, high = self.limits
        angles: Any = None
        history: Any = None
        for step in range(steps):
            p = play_step(p, motors[:, :, step], half)
            flat = (p + offsets).reshape(-1, m)
            solved = solve_lengths_batch(mechanisms, flat, self.loads, angles, self.limits, history)
            fine, (angles, history) = np.asarray(solved.ok), _remembered(solved, angles, history)
            T = np.asarray(solved.tensions).reshape(rigs, runs, m)
            free = unstretched_length(np.asarray(solved.lengths).reshape(rigs, runs, m), T, stiffnesses) - offsets
            gives_way = at_limit(T, low, high) & fine.reshape(rigs, runs, 1) & ((low > 0.0) | (low < T))
            p = np.where(gives_way, free, p)
            tensions[:, :, step], ok[:, :, step], tendons[:, :, step] = T, fine.reshape(rigs, runs), p
            tips[:, :, step] = np.asarray(solved.tip).reshape(rigs, runs, -1)[..., :d]
        return self._read(tensions, tips, ok, motors, tendons, half, sheath)

    def _read(
        self, tensions: Array, tips: Array, ok: Any, motors: Array, tendons: Array, half: Array, sheath: Array
    ) -> RigPrediction:
        place = sheath_direction(tendons, motors, half[:, :, None])
        return RigPrediction(tensions * sheath_ratio(sheath[:, :, None], place), tips, ok)


def _through_play(motors: Array, half: Array) -> Array:
    """Tendons behind plays of half widths (K, 1, m) where motors go along (K, E, T, m) [mm]."""
    tendons, p = np.empty(motors.shape), motors[:, :, 0]
    for step in range(motors.shape[2]):
        tendons[:, :, step] = p = play_step(p, motors[:, :, step], half)
    return tendons


def _remembered(solved: Any, angles: Array | None, history: Any) -> tuple[Array, Any]:
    """Joint angles and friction after a step, those before it where it has no equilibrium."""
    fine = np.asarray(solved.ok)
    angles = _kept(fine, np.asarray(solved.joint_angles), angles)
    if not any(chain.has_friction for chain in dict.fromkeys(solved.mechanism)):
        return angles, None
    before = history or (None,) * len(solved.friction_state)
    return angles, FrictionState(*(_kept(fine, *each) for each in zip(solved.friction_state, before, strict=True)))


def _kept(fine: NDArray[np.bool_], new: Array, old: Array | None) -> Array:
    """New rows where they are fine, old ones elsewhere."""
    return new if old is None else np.where(fine.reshape(-1, *(1,) * (new.ndim - 1)), new, old)


def _padded(values: Array, count: int) -> Array:
    """Rows up to a count, the last one repeated."""
    return np.concatenate([values, np.repeat(values[-1:], count - len(values), axis=0)])


def _earlier(t: Array, motors: Array, delay: float) -> Array:
    """Positions a delay before the times, (T, m)."""
    return np.stack([np.interp(t - delay, t, column) for column in motors.T], axis=1)
