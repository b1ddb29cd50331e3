"""Searches of many targets side by side, from starts that are nearest: tensions and joint angles by the kernel."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint._numba.jit import machine_code
from rollingjoint._numba.layout import Floats
from rollingjoint.chain.batch import solve_batch
from rollingjoint.chain.chain import AnyChain, check_chain
from rollingjoint.checks import as_choice
from rollingjoint.errors import InvalidInput
from rollingjoint.inverse.goal import Goal
from rollingjoint.inverse.result import Reach, ReachStatus
from rollingjoint.inverse.starts import sampled, samples_of
from rollingjoint.inverse.steps import Situation
from rollingjoint.kernels import inverse as kernels
from rollingjoint.kernels.arrays import LARGEST_INPUT, TendonLaw
from rollingjoint.load import Load
from rollingjoint.statics.batch import Batch, prescribed
from rollingjoint.statics.inputs import Start, start_of, tension_limits_of
from rollingjoint.threads import run_in_threads
from rollingjoint.transmission import unstretched_length

Array = NDArray[np.float64]
Rows = NDArray[np.int64]

PREFERENCES = ("tension", "margins", "stiffness")
"""Values of `prefer`."""
INPUTS = ("lengths", "tensions")
TOLERANCE = 1e-6  # mm: a nearer target is reached
CLOSE = 4  # starts within joint limits that are tried
_LEVELS, _STRIDE = 16, 5  # of the tensions of starts; from one level to the next that is tried
_FARTHER = 1.5  # factor from one start of a level to the next, squared
_WAVE, _GROWTH, _MOST_STARTS = 4096, 4, 16384  # searches before what they reach are starts; factor to the next; of them
_NEAR_ONLY = 7  # so many starts are tried last, from each level's on, only where a search has come near
_ONWARDS = 8  # times that searches which have not converged go on
_PREFERRED = 2  # starts; searches from later ones keep to the tensions with which they begin
_NEAR, EXACT = 1e-3, 1e-10  # of a mechanism's length: a search that ends between them goes on from there
_LEAST = 0.1  # N: a preferred tension is not lower, or the highest tension is lower
_NEAREST = (
    Annotated[Floats, "B", "coordinates"],
    Annotated[Floats, "B"],
    Annotated[Floats, "B", "J"],
    Annotated[Floats, "B", "m"],
)


@dataclass(frozen=True)
class Searches:
    """Searches of B rows."""

    batch: Batch
    goal: Goal
    tables: Array  # (B, rows, columns)
    limits: Array  # (2, m) N
    inputs: str
    preferred: Array  # (m,) N

    @classmethod
    def of(
        cls,
        mechanism: AnyChain | Sequence[AnyChain],
        goal: Goal,
        loads: Sequence[Load] | Array,
        tension_limits: tuple[ArrayLike, ArrayLike],
        inputs: str,
        prefer: str,
    ) -> Searches:
        """The searches, inputs checked."""
        as_choice("inputs", inputs, INPUTS)
        first = first_of(mechanism)
        limits = tension_limits_of(tension_limits, first.n_tendons)
        batch = Batch.of(mechanism, "tensions", np.zeros((len(goal.points), first.n_tendons)))
        preferred = np.asarray(preferred_tensions(prefer, *limits))
        return cls(batch, goal, batch.tables(loads), limits, inputs, preferred)

    def situation(self, row: int, joint_limits: Array | None) -> Situation:
        """The mechanism, loads and limits of a row, for a search by solves."""
        every = self.batch.mechanism
        chain = every[row] if isinstance(every, tuple) else every
        return Situation(chain, self.tables[row], self.limits, self.preferred, joint_limits=joint_limits)

    def run(self, start: Start | Reach, starts: int, ranks: Rows | None = None) -> Reach:
        """The best results of searches from up to `starts` starts each.

        start: the first one, or None. ranks: of the starts of the only searches, 0 the nearest, (B,).
        """
        best = _Best.none(len(self.goal.points), self.batch.chains[0])
        samples = first = values = None
        horizons: list[Array] = []
        for attempt in range(starts):
            if attempt == max(1 + _LEVELS, starts - _NEAR_ONLY):
                best.over[best.distance > _NEAR * self.goal.size] = True
            rows = np.flatnonzero((best.distance > TOLERANCE) & ~best.over)
            if len(rows) == 0:
                break
            if attempt == 0 and start is not None:
                ends = self._searched(rows, *self._given(start), False)
            else:
                if samples is None:
                    samples, horizons = self._samples(), [np.full(len(best.distance), -1.0)]
                level = 0 if len(horizons) == 1 else 1 + _STRIDE * (attempt - 1) % _LEVELS
                if level == 0 and ranks is None:
                    ends = self._in_waves(samples(0), rows, horizons[0])
                else:
                    begin = self._nearest(samples(level), rows, horizons[level])
                    for rank in range(0 if ranks is None else int(ranks.max(initial=0))):
                        later = rows[ranks > rank]  # type: ignore[operator]
                        for values_of, nearer in zip(begin, self._nearest(samples(0), later, horizons[0]), strict=True):
                            values_of[later] = nearer
                    ends = self._searched(rows, *begin, attempt >= _PREFERRED)
                if level == 0:
                    best.over[rows] |= np.isinf(horizons[0][rows])
                    horizons += [horizons[0].copy() for _ in range(_LEVELS)]
                else:
                    horizons[level] *= _FARTHER
            solution, tried_values = self._kept(best, rows, ends)
            between = (best.distance > EXACT * self.goal.size) & (best.distance < _NEAR * self.goal.size)
            near = rows[between[rows]]
            if len(near):  # the preferred tensions hardly matter; those that it has got keep the search from sliding
                self._kept(best, near, self._searched(near, best.angles[near], best.tensions[near], True))
            if attempt == 0 and len(rows) == len(best.distance):
                first, values = solution, tried_values
        for _ in range(_ONWARDS):
            rows = np.flatnonzero((best.outcome == kernels.STOPPED) & (best.distance > TOLERANCE))
            if len(rows) == 0:
                break
            self._kept(best, rows, self._searched(rows, best.angles[rows], best.tensions[rows], False))
        chain = self.batch.chains[0]
        if first is None:  # no rows
            first, values = self._solve(np.arange(0), best.inputs, chain, None), best.inputs
        changed = np.flatnonzero(np.any(values != best.inputs, axis=1) | ~best.from_rest)
        if len(changed):
            first = first.with_rows(changed, self._solve(changed, best.inputs[changed], chain, best.starts[changed]))
        return self._reach(best, replace(first, mechanism=self.batch.mechanism))

    def _in_waves(self, samples: Any, rows: Rows, horizon: Array) -> _Ends:
        """Searches of all rows from the nearest starts; what the first ones reach are starts of those after them."""
        parts: list[_Ends] = []
        pool, first = samples, 0
        while first < len(rows) or not parts:
            wave = rows[first : max(_WAVE, _GROWTH * first)]
            parts.append(self._searched(wave, *self._nearest(pool, wave, horizon), False))
            first += len(wave)
            if first <= _MOST_STARTS and first < len(rows):
                ok = parts[-1].outcome == kernels.REACHED
                more = self.goal.take(wave).coordinates, parts[-1].angles, parts[-1].tensions
                pool = _starts(*(np.concatenate([old, new[ok]]) for old, new in zip(pool[1:], more, strict=True)))
        return _Ends(*map(np.concatenate, zip(*parts, strict=True)))

    def _given(self, start: Start | Reach) -> tuple[Array, Array]:
        """Joint angles and tensions of a start that a caller gives."""
        solution: Any = start.equilibrium if isinstance(start, Reach) else start
        angles = self.batch.starts(start_of(solution, None))
        tensions = np.array(np.broadcast_to(getattr(solution, "tensions", self.preferred), self.batch.inputs.shape))
        return angles, tensions

    def _samples(self) -> Callable[[int], kernels.Starts]:
        """The starts of a level of tensions, from 1 on; 0: all.

        Equilibria under the loads, or, where those of the rows differ, of each sample under those of another row.
        """
        chain, tables = self.batch.chains[0], self.tables[np.all(np.abs(self.tables) <= LARGEST_INPUT, axis=(1, 2))]
        if len(tables) and (tables != tables[0]).any():
            solution = sampled(chain, tables, *self.limits)
        else:
            solution = samples_of(chain, tables[0] if len(tables) else self.tables[0] * 0.0, *self.limits)
        arrays = self.goal.coordinates_of(solution), solution.joint_angles, solution.tensions

        @functools.cache
        def of_level(level: int) -> kernels.Starts:
            if level == 0:
                return _starts(*arrays)
            means = np.log(np.maximum(solution.tensions, np.finfo(float).tiny)).mean(axis=1)
            chosen = np.array_split(np.argsort(means, kind="stable"), _LEVELS)[level - 1]
            return _starts(*(values[chosen] for values in arrays))

        return of_level

    def _nearest(self, samples: Any, rows: Rows, horizon: Array) -> tuple[Array, Array]:
        """Joint angles and tensions of the nearest start beyond those that were tried, of the rows."""
        angles, tensions = np.zeros((len(rows), samples.angles.shape[1])), np.zeros((len(rows), self.limits.shape[1]))
        beyond = horizon[rows]
        work = partial(_code(kernels.take_nearest, kernels.Starts, *_NEAREST), samples)
        arrays = self.goal.take(rows).coordinates, beyond, angles, tensions
        run_in_threads(lambda first, last: work(*arrays, first, last), len(rows), angles.shape[1])
        horizon[rows] = beyond
        return angles, tensions

    def _searched(self, rows: Rows, angles: Array, tensions: Array, keeps: bool) -> _Ends:
        """Where searches of some rows end, from these joint angles and tensions.

        keeps: whether the tensions of the start are the preferred ones.
        """
        goal = self.goal.take(rows)
        low, high, preferred = (np.repeat(row[None], len(rows), axis=0) for row in (*self.limits, self.preferred))
        iterations, outcome = np.zeros((2, len(rows)), int)
        ends = _Ends(angles.copy(), tensions.copy(), np.zeros_like(low), np.zeros(len(rows)), iterations, outcome)
        arrays = kernels.InverseRows(
            self.batch.designs[rows],
            self.tables[rows],
            low,
            high,
            tensions.copy() if keeps else preferred,
            goal.links,
            goal.points,
            goal.frames,
            np.array([goal.lever]),
            np.array([goal.size]),
            *ends,
        )
        kind: Any = type(self.batch.arrays)
        search = partial(_code(kernels.reach_rows, kind, kernels.InverseRows), self.batch.arrays)
        run_in_threads(partial(search, arrays), len(rows), angles.shape[1], abandon=True)
        return ends

    def _kept(self, best: _Best, rows: Rows, ends: _Ends) -> Any:
        """Equilibria from rest where searches of some rows ended, and their inputs; keeps what is better."""
        goal, chain = self.goal.take(rows), self.batch.chains[0]
        found, values = ends.outcome <= kernels.STOPPED, ends.tensions
        if self.inputs == "lengths":
            values = unstretched_length(ends.lengths, ends.tensions, self.batch.per_row("stiffnesses")[rows])
        values = np.where(found[:, None], values, best.inputs[rows])
        solution = self._solve(rows, values, chain, None)
        off = np.where(solution.ok & found, goal.distances(solution), np.inf)
        where_ended = values, ends.angles, ends.tensions
        best.take(rows, np.arange(len(rows)), (*where_ended, off, ends.outcome), True)
        elsewhere = np.flatnonzero(found & (off > ends.distance + TOLERANCE))
        if len(elsewhere):
            where = rows[elsewhere]
            other = self._solve(where, values[elsewhere], chain, ends.angles[elsewhere])
            nearer = np.where(other.ok, goal.take(elsewhere).distances(other), np.inf)
            again = np.full(len(rows), np.inf)
            again[elsewhere] = np.where(nearer < off[elsewhere] - TOLERANCE, nearer, np.inf)
            best.take(where, elsewhere, (*where_ended, again, ends.outcome), False)
        best.iterations[rows] += ends.iterations
        best.over[rows] |= ends.outcome == kernels.INVALID
        return solution, values

    def _solve(self, rows: Rows, values: Array, mechanism: Any, starts: Array | None) -> Any:
        """The equilibria of some rows under lengths or tensions; starts: joint angles, default at rest."""
        batch = self.batch
        if self.inputs == "tensions":
            law = prescribed(values)
        else:
            low, high = (np.repeat(limit[None], len(rows), axis=0) for limit in self.limits)
            law = TendonLaw(values, batch.per_row("stiffnesses")[rows], low, high)
        phi = batch.per_row("neutral_angles")[rows] if starts is None else starts
        return solve_batch(batch.kind, mechanism, batch.arrays, batch.designs[rows], law, self.tables[rows], phi)

    def _reach(self, best: _Best, solution: Any) -> Reach:
        """The results; solution: the equilibria of the best inputs."""
        distance = np.where(np.isfinite(best.distance), best.distance, np.inf)
        status = np.where(best.outcome == kernels.NEAREST, ReachStatus.OUT_OF_REACH, ReachStatus.NOT_CONVERGED)
        status = np.where(best.outcome == kernels.REACHED, ReachStatus.NOT_CONVERGED, status)
        status = np.where(distance <= TOLERANCE, ReachStatus.REACHED, status)
        status = np.where(np.isinf(distance), ReachStatus.NO_EQUILIBRIUM, status)
        status = np.where(best.outcome == kernels.INVALID, ReachStatus.INVALID_INPUT, status)
        lengths = best.inputs
        if self.inputs == "tensions":
            lengths = unstretched_length(solution.lengths, solution.tensions, self.batch.per_row("stiffnesses"))
        low, high = self.limits
        return Reach(solution, lengths, distance, status, (low, high), best.from_rest, best.iterations)


class _Ends(NamedTuple):
    """Where R searches ended."""

    angles: Array  # (R, J) rad
    tensions: Array  # (R, m) N
    lengths: Array  # (R, m) of the tendons, mm
    distance: Array  # (R,) mm
    iterations: Rows
    outcome: Rows


def _starts(points: Array, angles: Array, tensions: Array) -> kernels.Starts:
    """Starts in the order of the coordinate along which they are farthest apart."""
    axis = int(np.argmax(np.ptp(points, axis=0))) if len(points) else 0
    order = np.argsort(points[:, axis], kind="stable")
    return kernels.Starts(np.array([axis]), points[order], angles[order], tensions[order])


@dataclass(frozen=True)
class _Best:
    """The best results of B rows so far."""

    inputs: Array  # (B, m) lengths [mm] or tensions [N]
    starts: Array  # (B, J) joint angles from which their equilibria are found [rad]
    angles: Array  # (B, J) where the search ended [rad]
    tensions: Array  # (B, m) likewise [N]
    distance: Array  # (B,) mm; infinite: no equilibrium
    outcome: Rows
    from_rest: NDArray[np.bool_]
    iterations: Rows
    over: NDArray[np.bool_]  # no other start is worth a try

    @classmethod
    def none(cls, count: int, chain: AnyChain) -> _Best:
        """No results: at rest."""
        lengths, rest = (np.repeat(row[None], count, axis=0) for row in (chain.neutral_lengths, chain.neutral_angles))
        outcome, iterations, rested = np.full(count, kernels.LOST), np.zeros(count, int), np.ones(count, bool)
        distance = np.full(count, np.inf)
        return cls(lengths, rest, rest.copy(), np.zeros_like(lengths), distance, outcome, rested, iterations, ~rested)

    def take(self, rows: Rows, places: Rows, results: tuple[NDArray[Any], ...], from_rest: bool) -> None:
        """Keep the results at some places, for these rows, where they are nearer to the target than those so far."""
        inputs, angles, tensions, distance, outcome = (values[places] for values in results)
        better = (distance < self.distance[rows]) | ((outcome == kernels.INVALID) & np.isinf(self.distance[rows]))
        kept = rows[better]
        self.inputs[kept], self.distance[kept], self.outcome[kept] = inputs[better], distance[better], outcome[better]
        self.angles[kept], self.tensions[kept], self.from_rest[kept] = angles[better], tensions[better], from_rest
        if not from_rest:
            self.starts[kept] = angles[better]


def preferred_tensions(prefer: str, low: ArrayLike, high: ArrayLike) -> ArrayLike:
    """The tensions that are preferred, numbers or (m,) [N]."""
    if prefer == "tension":
        if type(low) is float and type(high) is float:
            return max(low, min(_LEAST, high)) if abs(low) < np.inf else 0.0
        return np.where(np.isfinite(low), np.maximum(low, np.minimum(_LEAST, high)), 0.0)
    as_choice("prefer", prefer, PREFERENCES)
    low, high = np.asarray(low, float), np.asarray(high, float)
    if np.isposinf(high).any():
        raise InvalidInput(
            "tension_limits", (low.tolist(), high.tolist()), f'a finite highest tension with prefer="{prefer}"'
        )
    return high.copy() if prefer == "stiffness" else 0.5 * (low + high)


@functools.cache
def _code(kernel: Any, *kinds: Any) -> Callable[..., None]:
    """Machine code of a kernel for arguments of these classes, and a range of rows."""
    return machine_code(kernel, *kinds, int, int)


def first_of(mechanism: AnyChain | Sequence[AnyChain]) -> AnyChain:
    """The mechanism, or the first one; InvalidInput for anything else."""
    try:
        first = mechanism[0] if isinstance(mechanism, Sequence) else mechanism
    except IndexError:
        raise InvalidInput("mechanism", mechanism, "one mechanism, or one per row") from None
    check_chain(first)
    return first
