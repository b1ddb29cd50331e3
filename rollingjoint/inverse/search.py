"""The tendon lengths, or tensions, that bring a mechanism to a target: one target, many, or all solutions for one."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint._numba.jit import machine_code
from rollingjoint._numba.layout import Floats
from rollingjoint.chain.batch import solve_batch
from rollingjoint.chain.chain import AnyChain, check_chain
from rollingjoint.chain.solution import Solution
from rollingjoint.checks import as_choice, as_integer, as_number, as_positive, seen_as_vector
from rollingjoint.errors import InvalidInput
from rollingjoint.inverse.aims import Aims
from rollingjoint.inverse.goal import Goal
from rollingjoint.inverse.result import Reach, ReachStatus
from rollingjoint.inverse.starts import sampled, samples_of
from rollingjoint.inverse.steps import HeldPose, Move, Situation, approach, step_to
from rollingjoint.inverse.warm import reach_from
from rollingjoint.kernels import inverse as kernels
from rollingjoint.kernels.arrays import LARGEST_INPUT, TendonLaw
from rollingjoint.load import Load
from rollingjoint.statics.among import ORIGIN, Around, walls_of
from rollingjoint.statics.batch import Batch, prescribed
from rollingjoint.statics.inputs import (
    Start,
    angles_of,
    broadcast_limits,
    joint_limits_of,
    start_of,
    tension_limits_of,
)
from rollingjoint.threads import run_in_threads
from rollingjoint.transmission import unstretched_length

Array = NDArray[np.float64]
Rows = NDArray[np.int64]

PREFERENCES = ("tension", "margins", "stiffness")
"""Values of `prefer`."""
INPUTS = ("lengths", "tensions")
STARTS = 24  # that a search tries before it gives up
_FAR_STARTS = 12  # after so many only searches that have come near go on
TOLERANCE = 1e-6  # mm: a nearer target is reached
_BY_SOLVES = 1e-5  # mm: likewise with a history or among walls, where derivatives have kinks
_CLOSE, _FARTHER = 4, 1.5  # starts that are nearest one after the other; factor from one to the next beyond, squared
_PREFERRED = 2  # starts; later ones of a search that has come near keep to the tensions with which they begin
_ONWARDS = 2  # times that all solutions go on from where their searches ended, to the preferred tensions
_NEAR = 1e-3  # of a mechanism's length: a search that ends so near goes on from there
_LEAST = 0.1  # N: a preferred tension is not lower, or the highest tension is lower
_NEAREST = (
    Annotated[Floats, "B", "coordinates"],
    Annotated[Floats, "B"],
    Annotated[Floats, "B", "J"],
    Annotated[Floats, "B", "m"],
)


def reach(
    mechanism: AnyChain,
    tip: ArrayLike,
    loads: Sequence[Load] | Array = (),
    tension_limits: tuple[ArrayLike, ArrayLike] = (0.0, np.inf),
    *,
    inputs: str = "lengths",
    prefer: str = "tension",
    start: Start | Reach = None,
    starts: int = STARTS,
    lever: float | None = None,
    history: Solution | None = None,
    surroundings: Around = None,
    base: ArrayLike = ORIGIN,
    wall_force: float = np.inf,
    joint_limits: tuple[ArrayLike, ArrayLike] | None = None,
    stiffness: tuple[ArrayLike, float] | None = None,
    contact_force: float | None = None,
) -> Reach:
    """The tendon lengths, or tensions, that bring the mechanism to a target, or as near as the limits allow.

    `solve_lengths(mechanism, reach(...).lengths, loads, tension_limits=...)` is its equilibrium, with the same history,
    surroundings and base.

    Args:
        mechanism: a chain of any class.
        tip: target, in the form in which an equilibrium has it: `tip` (2 or 3,) [mm], the pose `poses[-1]` (3,) or
            (4, 4), the shape `positions` (n, 2 or 3), or all `poses`.
        loads: external loads, or their table, (rows, columns).
        tension_limits: minimum and maximum tendon tension, numbers or (m,) [N].
        inputs: "lengths" (elastic tendons, which may hold poses that tensions do not), or "tensions".
        prefer: which of many solutions: "tension", the least tensions (least squares from the lower limit, or 0.1 N);
            "margins", the tensions nearest the middle of the limits; "stiffness", those nearest the upper limit.
        start: joint angles, an equilibrium or a Reach to start from; default: the nearest of 1,024 equilibria.
        starts: how many starts are tried before the target counts as out of reach.
        lever: mm that count as much as a turn of 1 rad; default: a tenth of the mechanism's length.
        history: the equilibrium before, from which friction of the tendons and at walls goes on; the target is reached
            in one step from it. None: no friction. It takes the place of starts.
        surroundings, base: walls, and the pose of the base among them, as of solve_lengths; the target is in the frame
            of the base. wall_force: largest normal force of a contact with a wall [N].
        joint_limits: lowest and highest joint angles, numbers or (n - 1,) [rad], within those of the mechanism.
        stiffness: a direction, (2 or 3,), and the stiffness that the tip is to have along it [N/mm]; as
            `Reach.tip_stiffness`. None: any.
        contact_force: with which the last link is to press on walls, all its normal forces together [N]; the place of
            the tip counts along the wall alone. None: any.
    Raises:
        InvalidInput: wrong shapes or types, an unknown word, no upper limit with "margins" or "stiffness".
    Source: docs/inverse.md.
    """
    check_chain(mechanism)
    aims, within = Aims.of(mechanism, stiffness, contact_force), joint_limits_of(joint_limits, mechanism)
    if aims or any(each is not None for each in (history, surroundings, within)):
        if inputs != "lengths":
            raise InvalidInput(
                "inputs", inputs, "'lengths' beside a history, surroundings, joint limits or a stiffness"
            )
        if contact_force is not None and surroundings is None:
            raise InvalidInput("contact_force", contact_force, "surroundings beside it")
        first = {"prefer": prefer, "start": start, "starts": as_integer("starts", starts, 1), "lever": lever}
        ranges = tension_limits_of(tension_limits, mechanism.n_tendons)
        walls = None if surroundings is None else walls_of(surroundings, mechanism)
        cap = checked_wall_force(wall_force)
        slack = np.zeros(mechanism.n_tendons)
        situation = Situation(mechanism, loads, ranges, slack, cap, walls, base, within, aims)
        return _reach_by_solves(situation, tip, history, first, None)
    table = _table_of(mechanism, loads)
    if type(start) is Reach and inputs == "lengths" and np.shape(tip) == (mechanism.dimension,):
        limits = broadcast_limits(tension_limits, mechanism.n_tendons)
        target = seen_as_vector("tip", tip, mechanism.dimension, "coordinates")
        warm = reach_from(mechanism, target, table, limits, preferred_tensions(prefer, *limits), start.equilibrium)
        equilibrium, lengths, distance, steps = warm
        if distance <= TOLERANCE:
            return Reach(equilibrium, lengths, distance, ReachStatus.REACHED, limits, True, steps)
    goal = Goal.of(mechanism, tip, checked_lever(lever), single=True)
    search = _Searches.of(mechanism, goal, table[None], tension_limits, inputs, prefer)
    angles_of(mechanism, start.equilibrium if isinstance(start, Reach) else start, None)  # as those of one solve
    result = search.run(start, as_integer("starts", starts, 1)).row(0)
    if result.status is not ReachStatus.NOT_CONVERGED or inputs != "lengths":
        return result
    first = {"prefer": prefer, "start": start, "starts": starts, "lever": lever}
    return _reach_by_solves(search.situation(0, None), tip, None, first, result)


def _reach_by_solves(
    situation: Situation, tip: ArrayLike, history: Solution | None, first: dict[str, Any], plain: Reach | None
) -> Reach:
    """`reach` where every trial is a solve: from a history, or from solutions of plain searches, the best result.

    plain: that of a search without joint limits, walls and aims; None: it is not known.
    """
    chain, limits = situation.mechanism, (situation.limits[0], situation.limits[1])
    goal = Goal.of(chain, tip, checked_lever(first["lever"]), single=True)
    if situation.aims.contact_force is not None and goal.links.tolist() != [chain.n_links - 1]:
        raise InvalidInput("tip", tip, "the tip or its pose, no shape, beside contact_force")
    situation = replace(situation, preferred=np.asarray(preferred_tensions(first["prefer"], *limits)))
    near = TOLERANCE if situation.surroundings is None and history is None else _BY_SOLVES
    moves: list[Move] = []
    if history is not None:
        if not isinstance(history, Solution):
            raise InvalidInput("history", history, "an equilibrium")
        before = HeldPose(situation, goal, history, np.zeros(chain.n_tendons))
        moves.append(step_to(replace(before, command=before.held), situation, goal, near, jumps=True))
    else:
        plain = plain or reach(chain, tip, situation.loads, limits, **first)
        within = situation.joint_limits
        asks = situation.aims or situation.surroundings is not None
        if plain.status is ReachStatus.INVALID_INPUT or not (asks or within is None or not _within(plain, within)):
            return replace(plain, joint_limits=within)
        for command, angles in _begins(situation, plain, tip, goal, first):
            moves.append(approach(HeldPose(situation, goal, situation.solve(command, angles, None), command), near))
            if moves[-1].reaches(near) and moves[-1].pose.keeps_limits:
                break
    best = min(moves, key=lambda move: (not move.ok, not move.pose.keeps_limits, move.pose.square))
    at, command = best.pose.equilibrium, best.pose.command
    status = ReachStatus.REACHED if best.reaches(near) else ReachStatus.OUT_OF_REACH
    status = status if best.pose.keeps_limits else ReachStatus.BEYOND_LIMITS
    status = status if best.ok else ReachStatus.NO_EQUILIBRIUM
    again = situation.solve(command, None, history)
    from_rest = bool(again.ok) and float(goal.distances(again)[0]) <= best.pose.distance + near
    solves = sum(move.solves for move in moves)
    distance = best.pose.distance if best.ok else np.inf
    return Reach(at, command, distance, status, limits, from_rest, solves, situation.joint_limits)


def _begins(
    situation: Situation, plain: Reach, tip: ArrayLike, goal: Goal, first: dict[str, Any]
) -> Iterator[tuple[Array, Array]]:
    """Lengths and joint angles to begin at: those of plain searches, then of samples within the joint limits."""
    chain, loads, limits = situation.mechanism, situation.loads, (situation.limits[0], situation.limits[1])
    yield plain.lengths, plain.joint_angles
    if first["start"] is not None:
        return
    more = {"prefer": first["prefer"], "lever": first["lever"]}
    for one in all_solutions(chain, tip, loads, limits, **more)[: first["starts"]]:
        yield one.lengths, one.joint_angles
    if situation.joint_limits is not None:
        samples = samples_of(chain, _table_of(chain, loads), *limits)
        inside = _within(samples, situation.joint_limits)
        order = np.argsort(np.where(inside, goal.distances(samples), np.inf))[: min(_CLOSE, int(inside.sum()))]
        lengths = unstretched_length(samples.lengths, samples.tensions, chain.stiffnesses)
        yield from zip(lengths[order], samples.joint_angles[order], strict=True)


def reach_batch(
    mechanism: AnyChain | Sequence[AnyChain],
    tips: ArrayLike,
    loads: Sequence[Load] | Array = (),
    tension_limits: tuple[ArrayLike, ArrayLike] = (0.0, np.inf),
    *,
    inputs: str = "lengths",
    prefer: str = "tension",
    start: Start | Reach = None,
    starts: int = STARTS,
    lever: float | None = None,
    joint_limits: tuple[ArrayLike, ArrayLike] | None = None,
) -> Reach:
    """`reach`, row by row.

    Args:
        mechanism: the chain, or one per row, as of solve_lengths_batch.
        tips: targets, with a leading axis B.
        loads: shared by all rows, or a table (B, rows, columns).
        start: joint angles (B, n - 1), equilibria or a Reach of B rows.
        tension_limits, inputs, prefer, starts, lever, joint_limits: as of `reach`. Rows that end beyond the joint
            limits go on one by one, in tens of milliseconds; others that have not converged do not.
    Raises:
        InvalidInput: as `reach`, and another number of mechanisms, loads or starts than of targets.
    """
    first = _first(mechanism)
    goal = Goal.of(first, tips, checked_lever(lever), single=False)
    search = _Searches.of(mechanism, goal, loads, tension_limits, inputs, prefer)
    within, count = joint_limits_of(joint_limits, first), as_integer("starts", starts, 1)
    if within is not None and inputs != "lengths":
        raise InvalidInput("inputs", inputs, "'lengths' beside joint limits")
    many = replace(search.run(start, count), joint_limits=within)
    if within is None:
        return many
    rows = np.flatnonzero(~_within(many, within) & (many.status != ReachStatus.INVALID_INPUT))
    targets = np.asarray(tips, float)
    first_try = {"prefer": prefer, "start": None, "starts": count, "lever": lever}
    others = [
        _reach_by_solves(search.situation(row, within), targets[row], None, first_try, many.row(row))
        for row in rows.tolist()
    ]
    return many.with_rows(rows, others)


def all_solutions(
    mechanism: AnyChain,
    tip: ArrayLike,
    loads: Sequence[Load] | Array = (),
    tension_limits: tuple[ArrayLike, ArrayLike] = (0.0, np.inf),
    *,
    inputs: str = "lengths",
    prefer: str = "tension",
    starts: int = 64,
    apart: float = 1e-3,
    lever: float | None = None,
) -> list[Reach]:
    """The different equilibria at a target that searches from `starts` starts find, the preferred ones first.

    Args:
        starts: how many of the 1,024 starts are tried, the nearest first.
        apart: equilibria with a joint angle that differs by more are different [rad].
        mechanism, tip, loads, tension_limits, inputs, prefer, lever: as of `reach`.
    Raises:
        InvalidInput: as `reach`.
    """
    check_chain(mechanism)
    count, nearest = as_integer("starts", starts, 1), as_number("apart", apart, 0.0)
    table = _table_of(mechanism, loads)
    goal = Goal.of(mechanism, tip, checked_lever(lever), single=True).take(np.zeros(count, np.int64))
    tables = np.repeat(table[None], count, axis=0)
    search = _Searches.of(mechanism, goal, tables, tension_limits, inputs, prefer)
    many = search.run(None, 1, ranks=np.arange(count))
    for _ in range(_ONWARDS):
        many = search.run(many, 1)
    order = np.argsort(np.sum((many.tensions - search.preferred) ** 2, axis=1), kind="stable")
    solutions: list[Reach] = []
    for row in order[np.asarray(many.ok)[order]]:
        angles = many.joint_angles[row]
        if all(np.abs(angles - other.joint_angles).max(initial=0.0) > nearest for other in solutions):
            solutions.append(many.row(int(row)))
    return solutions


def _within(result: Any, joint_limits: Array) -> Any:
    """Whether the joint angles of a result, or of each row, are within limits."""
    return ((result.joint_angles >= joint_limits[0]) & (result.joint_angles <= joint_limits[1])).all(axis=-1)


def _table_of(mechanism: AnyChain, loads: Sequence[Load] | Array) -> Array:
    """The load table, (rows, columns); rows of batches have theirs already."""
    return loads if isinstance(loads, np.ndarray) else mechanism.load_table(loads)


def _first(mechanism: AnyChain | Sequence[AnyChain]) -> AnyChain:
    """The mechanism, or the first one; InvalidInput for anything else."""
    try:
        first = mechanism[0] if isinstance(mechanism, Sequence) else mechanism
    except IndexError:
        raise InvalidInput("mechanism", mechanism, "one mechanism, or one per row") from None
    check_chain(first)
    return first


def checked_lever(lever: float | None) -> float | None:
    """The lever; InvalidInput unless it is None or a number from 0."""
    return None if lever is None else as_number("lever", lever, 0.0)


def checked_wall_force(cap: float) -> float:
    """The cap on normal forces of walls; InvalidInput unless it is a positive number, or inf."""
    return np.inf if cap == np.inf else as_positive("wall_force", cap, "a positive number [N], or inf")


@dataclass(frozen=True)
class _Searches:
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
    ) -> _Searches:
        """The searches, inputs checked."""
        as_choice("inputs", inputs, INPUTS)
        first = _first(mechanism)
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
        for attempt in range(starts):
            if attempt == _FAR_STARTS:
                best.over[best.distance > _NEAR * self.goal.size] = True
            rows = np.flatnonzero((best.distance > TOLERANCE) & ~best.over)
            if len(rows) == 0:
                break
            if attempt == 0 and start is not None:
                angles, tensions = self._given(start)
            else:
                if samples is None:
                    samples = self._samples()
                    horizon = np.full(len(best.distance), -1.0)
                horizon *= 1.0 if attempt < _CLOSE else _FARTHER
                angles, tensions = self._nearest(samples, rows, horizon)
                for rank in range(0 if ranks is None else int(ranks.max(initial=0))):
                    later = rows[ranks > rank]  # type: ignore[operator]
                    angles[later], tensions[later] = self._nearest(samples, later, horizon)
                best.over[rows] |= np.isinf(horizon[rows])
            preferred = np.repeat(self.preferred[None], len(rows), axis=0)
            if attempt >= _PREFERRED:
                nearly = best.distance[rows] < _NEAR * self.goal.size
                preferred[nearly] = tensions[nearly]
            solution, tried_values = self._try(best, rows, angles, tensions, preferred)
            near = np.flatnonzero((best.distance > TOLERANCE) & (best.distance < _NEAR * self.goal.size))
            if len(near):  # the preferred tensions hardly matter; those that it has got keep the search from sliding
                self._try(best, near, best.angles[near].copy(), best.tensions[near].copy(), best.tensions[near].copy())
            if attempt == 0 and len(rows) == len(best.distance):
                first, values = solution, tried_values
        chain = self.batch.chains[0]
        if first is None:  # no rows
            first, values = self._solve(np.arange(0), best.inputs, chain, None), best.inputs
        changed = np.flatnonzero(np.any(values != best.inputs, axis=1) | ~best.from_rest)
        if len(changed):
            first = first.with_rows(changed, self._solve(changed, best.inputs[changed], chain, best.starts[changed]))
        return self._reach(best, replace(first, mechanism=self.batch.mechanism))

    def _given(self, start: Start | Reach) -> tuple[Array, Array]:
        """Joint angles and tensions of a start that a caller gives."""
        solution: Any = start.equilibrium if isinstance(start, Reach) else start
        angles = self.batch.starts(start_of(solution, None))
        tensions = np.array(np.broadcast_to(getattr(solution, "tensions", self.preferred), self.batch.inputs.shape))
        return angles, tensions

    def _samples(self) -> Any:
        """Equilibria under the loads, or, where those of the rows differ, of each sample under those of another row."""
        chain, tables = self.batch.chains[0], self.tables[np.all(np.abs(self.tables) <= LARGEST_INPUT, axis=(1, 2))]
        if len(tables) and (tables != tables[0]).any():
            solution = sampled(chain, tables, *self.limits)
        else:
            solution = samples_of(chain, tables[0] if len(tables) else self.tables[0] * 0.0, *self.limits)
        points = self.goal.coordinates_of(solution)
        order = int(np.argmax(np.ptp(points, axis=0))) if len(points) else 0
        places = np.argsort(points[:, order], kind="stable")
        angles, tensions = (values[places] for values in (solution.joint_angles, solution.tensions))
        return kernels.Starts(np.array([order]), points[places], angles, tensions)

    def _nearest(self, samples: Any, rows: Rows, horizon: Array) -> tuple[Array, Array]:
        """Joint angles and tensions of the nearest start beyond those that were tried, of the rows."""
        angles, tensions = np.zeros((len(rows), samples.angles.shape[1])), np.zeros((len(rows), self.limits.shape[1]))
        beyond = horizon[rows]
        work = partial(_code(kernels.take_nearest, kernels.Starts, *_NEAREST), samples)
        arrays = self.goal.take(rows).coordinates, beyond, angles, tensions
        run_in_threads(lambda first, last: work(*arrays, first, last), len(rows), angles.shape[1])
        horizon[rows] = beyond
        return angles, tensions

    def _try(self, best: _Best, rows: Rows, angles: Array, tensions: Array, preferred: Array) -> Any:
        """Search from starts of some rows, and keep what is better; returns equilibria from rest and their inputs.

        preferred: tensions, (R, m) [N]. angles and tensions are overwritten.
        """
        goal, chain = self.goal.take(rows), self.batch.chains[0]
        low, high = (np.repeat(limit[None], len(rows), axis=0) for limit in self.limits)
        lever, size = np.array([goal.lever]), np.array([goal.size])
        lengths, distance, (iterations, outcome) = (
            np.zeros_like(low),
            np.zeros(len(rows)),
            np.zeros((2, len(rows)), int),
        )
        arrays = kernels.InverseRows(
            self.batch.designs[rows],
            self.tables[rows],
            low,
            high,
            preferred,
            goal.links,
            goal.points,
            goal.frames,
            lever,
            size,
            angles,
            tensions,
            lengths,
            distance,
            iterations,
            outcome,
        )
        kind: Any = type(self.batch.arrays)
        search = partial(_code(kernels.reach_rows, kind, kernels.InverseRows), self.batch.arrays)
        run_in_threads(partial(search, arrays), len(rows), angles.shape[1], abandon=True)
        found = outcome <= kernels.STOPPED
        values = tensions
        if self.inputs == "lengths":
            values = unstretched_length(lengths, tensions, self.batch.per_row("stiffnesses")[rows])
        values = np.where(found[:, None], values, best.inputs[rows])
        solution = self._solve(rows, values, chain, None)
        off = np.where(solution.ok & found, goal.distances(solution), np.inf)
        best.take(rows, np.arange(len(rows)), (values, angles, tensions, off, outcome), True)
        elsewhere = np.flatnonzero(found & (off > distance + TOLERANCE))
        if len(elsewhere):
            where = rows[elsewhere]
            other = self._solve(where, values[elsewhere], chain, angles[elsewhere])
            nearer = np.where(other.ok, goal.take(elsewhere).distances(other), np.inf)
            again = np.full(len(rows), np.inf)
            again[elsewhere] = np.where(nearer < off[elsewhere] - TOLERANCE, nearer, np.inf)
            best.take(where, elsewhere, (values, angles, tensions, again, outcome), False)
        best.iterations[rows] += iterations
        best.over[rows] |= outcome == kernels.INVALID
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

    def take(self, rows: Rows, places: Rows, results: tuple[Array, ...], from_rest: bool) -> None:
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
