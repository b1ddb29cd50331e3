"""The tendon lengths over time that lead a mechanism along a path of targets."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.chain.chain import AnyChain, check_chain
from rollingjoint.chain.solution import Solution, stacked
from rollingjoint.checks import as_floats, as_integer, as_positive
from rollingjoint.errors import InvalidInput
from rollingjoint.inverse.goal import Goal
from rollingjoint.inverse.result import Reach
from rollingjoint.inverse.search import all_solutions, checked_lever, checked_wall_force, reach
from rollingjoint.inverse.searches import PREFERENCES, preferred_tensions
from rollingjoint.inverse.steps import HeldPose, Move, Situation, approach, drive, step_to
from rollingjoint.load import Load
from rollingjoint.plan.path import among_walls, between, target_like
from rollingjoint.plan.result import Plan, PlanStatus
from rollingjoint.statics.among import ORIGIN, Around, bases_of, walls_of
from rollingjoint.statics.inputs import tension_limits_of
from rollingjoint.statics.solve import solve_tensions

Array = NDArray[np.float64]

RATE = 10.0  # mm/s
STARTS = 6
TOLERANCE = 1e-3  # mm
_STEP = 0.01  # of a mechanism's length
_TURN, _MOST_DETOURS = 0.05, 3  # rad: largest turn of a joint in a step of a detour; how many are tried
_OVER = 1e-3  # of the cap on wall forces: so much more is allowed in a detour
_SOONEST = 1e-9  # s: time of a step in which nothing moves


def plan_path(
    mechanism: AnyChain,
    path: ArrayLike,
    loads: Sequence[Load] = (),
    tension_limits: tuple[ArrayLike, ArrayLike] = (0.0, np.inf),
    *,
    times: ArrayLike | None = None,
    rate: ArrayLike = RATE,
    step: float | None = None,
    prefer: str = "tension",
    start: Solution | Reach | None = None,
    starts: int = STARTS,
    lever: float | None = None,
    surroundings: Around = None,
    base: ArrayLike = ORIGIN,
    wall_force: float = np.inf,
    tolerance: float = TOLERANCE,
) -> Plan:
    """The tendon lengths over time that lead the mechanism along a path, each step from the one before.

    Friction of the tendons and at walls goes on from step to step. Where the mechanism would snap to another pose, or
    miss targets, plans from other solutions for the first target and with other preferences are tried. If none of them
    follows the whole path, the one with the fewest misses drives to other poses at targets that it misses: off the path
    in more steps, as smoothly as it can, or with a snap. With times there is no such detour.

    Args:
        mechanism: a chain of any class.
        path: K targets, each as of `reach`; with surroundings in the frame of the walls.
        loads: external loads of all steps.
        tension_limits: minimum and maximum tendon tension, numbers or (m,) [N].
        times: when each target is due, (K,) [s]; default: as soon as the rates allow.
        rate: largest rate of the lengths, a number or (m,) [mm/s].
        step: largest distance between targets, further ones are put in between [mm]; default: a hundredth of the
            mechanism's length.
        prefer: which of many solutions, as of `reach`.
        start: an equilibrium or a Reach from which a straight line leads to the path; default: at the first target.
        starts: how many plans are tried.
        lever: mm that count as much as a turn of 1 rad; default: a tenth of the mechanism's length.
        surroundings: walls around the mechanism, a RollingChain; None: none. base: pose of its base among them, x, y
            [mm], angle [rad], (3,), or of every target, (K, 3).
        wall_force: largest normal force of a contact with a wall [N].
        tolerance: distance from the target up to which a step follows [mm].
    Raises:
        InvalidInput: wrong shapes or types, times that do not grow, a path or limits that are no numbers.
    Source: docs/planning.md.
    """
    check_chain(mechanism)
    task = _Targets.of(mechanism, path, times, start, base, lever, step, surroundings)
    limits = tension_limits_of(tension_limits, mechanism.n_tendons)
    if not ((limits[0] >= 0.0) & (limits[0] <= limits[1]) & np.isfinite(limits[0])).all():
        raise InvalidInput("tension_limits", limits.tolist(), "0 <= lowest <= highest")
    allowed = f"a positive number [mm/s], or {mechanism.n_tendons}, one per tendon"
    rates = as_floats("rate", rate, allowed)
    if rates.shape not in ((), (mechanism.n_tendons,)) or not (rates > 0.0).all():
        raise InvalidInput("rate", rate, allowed)
    cap = checked_wall_force(wall_force)
    near, count = as_positive("tolerance", tolerance, "a positive number [mm]"), as_integer("starts", starts, 1)
    walls = None if surroundings is None else walls_of(surroundings, mechanism)
    preferred_tensions(prefer, *limits)
    words = [prefer, *(word for word in PREFERENCES if word != prefer and np.isfinite(limits[1]).all())]
    situation = Situation(mechanism, loads, limits, np.zeros(mechanism.n_tendons), cap, walls, task.bases[0])
    best: _Way | None = None
    solves = 0
    for word, (begin, spent) in itertools.islice(_begins(task, situation, words, start, near), count):
        way = _follow(task, begin, word, rates, near, detours=False)
        solves += spent + way.solves
        if best is None or way.faults < best.faults:
            best = way
        if best.faults[0] == 0:
            break
    assert best is not None
    if best.faults[0] > 0:
        way = _follow(task, best.steps[0], best.prefer, rates, near, detours=True)
        solves += way.solves
        best = min(best, way, key=lambda each: each.faults)
    return _plan(task, best, (limits[0], limits[1]), cap, near, rates, solves)


@dataclass(frozen=True)
class _Targets:
    """Steps along a path: targets, (K, ...), goals, and poses of the base, (K, 3); times, (K,), or None."""

    mechanism: AnyChain
    targets: Array
    targets_here: Array  # in the frame of the base
    goal: Goal
    waypoints: NDArray[np.int64]
    bases: Array
    times: Array | None

    @classmethod
    def of(
        cls,
        mechanism: AnyChain,
        path: ArrayLike,
        times: ArrayLike | None,
        start: Any,
        base: ArrayLike,
        lever: float | None,
        step: float | None,
        surroundings: Around,
    ) -> _Targets:
        """The steps, inputs checked."""
        lever = checked_lever(lever)
        targets = as_floats("path", path, "targets, rows of one shape")
        if targets.ndim < 2 or not len(targets):
            raise InvalidInput("shape of the path", targets.shape, "(K, ...), a target or more")
        Goal.of(mechanism, targets, lever, single=False)
        due = None if times is None else as_floats("times", times, f"{len(targets)} numbers [s]")
        if due is not None and not (
            due.shape == (len(targets),) and np.isfinite(due).all() and (np.diff(due) > 0).all()
        ):
            raise InvalidInput("times", times, f"{len(targets)} finite numbers that grow [s], one per target")
        bases, shape = bases_of(base, len(targets)), targets.shape[1:]
        among = surroundings is not None
        if not among and bases.any():
            raise InvalidInput("base", base, "0, 0, 0 without surroundings")
        if isinstance(start, Reach | Solution):
            at = start.equilibrium if isinstance(start, Reach) else start
            bases = np.concatenate([[at.walls.base if at.walls is not None else bases[0]], bases])
            first = target_like(mechanism, at, shape)[None]
            targets = np.concatenate([among_walls(first, bases[:1], shape) if among else first, targets])
            due = None if due is None else np.concatenate([[min(0.0, due[0] - _SOONEST)], due])
        elif start is not None:
            raise InvalidInput("start", start, "an equilibrium or a Reach")
        size = _STEP * mechanism.length if step is None else as_positive("step", step, "a positive number [mm]")
        others = (bases,) if due is None else (bases, due)
        dense, places, (bases, *when) = between(mechanism, targets, lever, size, others)
        local = among_walls(dense, bases, shape, back=True) if among else dense
        goal = Goal.of(mechanism, local, lever, single=False)
        given = places if start is None else places[1:]
        return cls(mechanism, dense, local, goal, given, bases, when[0] if when else None)

    def goal_of(self, step: int) -> Goal:
        """The goal of one step."""
        return self.goal.take(np.array([step]))


@dataclass(frozen=True)
class _Way:
    """An attempt: its steps, and the targets that they are to reach."""

    steps: list[Move]
    numbers: list[int]
    prefer: str
    solves: int
    tolerance: float

    @property
    def faults(self) -> tuple[int, int, float]:
        """Targets that no step reaches, snaps, and the mean miss of all steps [mm]; less is better."""
        reached = {
            number for number, step in zip(self.numbers, self.steps, strict=True) if step.reaches(self.tolerance)
        }
        misses = [step.pose.distance for step in self.steps if step.ok]
        missed = self.numbers[-1] + 1 - len(reached)
        return missed, sum(step.snapped for step in self.steps), float(np.mean(misses)) if misses else np.inf


def _begins(
    task: _Targets, situation: Situation, words: list[str], start: Solution | Reach | None, near: float
) -> Iterator[tuple[str, tuple[Move, int]]]:
    """First steps, with the word of their preference: at the start, or at solutions for the first target."""
    goal, chain, limits = task.goal_of(0), task.mechanism, (situation.limits[0], situation.limits[1])
    target = task.targets_here[0]
    for word in words:
        here = replace(situation, preferred=np.asarray(preferred_tensions(word, *limits)))
        if start is not None:
            at = start.equilibrium if isinstance(start, Reach) else start
            pose = HeldPose(here, goal, at, np.zeros(chain.n_tendons))
            yield word, (Move(replace(pose, command=pose.held), False, 0), 0)
            continue
        lever = task.goal.lever
        found = all_solutions(chain, target, situation.loads, limits, prefer=word, starts=32, lever=lever)
        for one in found or [reach(chain, target, situation.loads, limits, prefer=word, lever=lever)]:
            at = one.equilibrium
            if situation.surroundings is not None:
                at = here.solve(one.lengths, one.joint_angles, None)
            step = Move(HeldPose(here, goal, at, one.lengths), False, 1)
            if situation.surroundings is not None:
                step = approach(step.pose, near)
            yield word, (step, step.solves)


def _follow(task: _Targets, first: Move, word: str, rates: Array, near: float, detours: bool) -> _Way:
    """All steps from the first one; detours: drives to another pose where a target is missed."""
    steps, numbers, at, solves = [first], [0], first.pose, 0
    for number in range(1, len(task.targets)):
        situation, goal = replace(at.situation, base=task.bases[number]), task.goal_of(number)
        span = np.inf if task.times is None else task.times[number] - task.times[number - 1]
        taken = [step_to(at, situation, goal, near, rates * span)]
        solves += taken[0].solves
        if detours and not taken[0].reaches(near):
            ways = [[step_to(at, situation, goal, near, rates * span, jumps=True)]]
            if span == np.inf:
                ways += _detours(task, number, word, replace(at, situation=situation), near)
            solves += sum(step.solves for way in ways for step in way)
            arrived = [way for way in ways if way[-1].reaches(near) and not any(map(_presses_too_hard, way))]
            if arrived:
                taken = min(arrived, key=lambda way: (sum(step.snapped for step in way), len(way)))
            elif not taken[0].ok:
                taken = ways[0]
        steps += taken
        numbers += [number] * len(taken)
        at = steps[-1].pose if steps[-1].ok else at
    return _Way(steps, numbers, word, solves, near)


def _detours(task: _Targets, number: int, word: str, at: HeldPose, near: float) -> list[list[Move]]:
    """Drives from a pose to the nearest solutions for a target, each in steps of _TURN at most."""
    goal, situation = task.goal_of(number), at.situation
    target = task.targets_here[number]
    limits = situation.limits[0], situation.limits[1]
    solutions = all_solutions(
        task.mechanism, target, situation.loads, limits, prefer=word, starts=32, lever=task.goal.lever
    )
    middle = np.where(np.isfinite(limits[1]), 0.5 * (limits[0] + limits[1]), 2.0 * limits[0] + 1.0)
    rest = solve_tensions(task.mechanism, middle, situation.loads)
    ways = []
    for one in sorted(solutions, key=lambda one: _turn(at.equilibrium, one))[:_MOST_DETOURS]:
        for stops in ([one], [rest, one]):
            way: list[Move] = []
            for stop in stops:
                last = way[-1].pose if way else at
                command = replace(last, equilibrium=stop.equilibrium if isinstance(stop, Reach) else stop).held
                way += drive(last, goal, command, int(np.ceil(_turn(last.equilibrium, stop) / _TURN)))
            if way and not way[-1].reaches(near):
                way.append(step_to(way[-1].pose, situation, goal, near))
            if way:
                ways.append(way)
                if way[-1].reaches(near):
                    break
    return ways


def _presses_too_hard(step: Move) -> bool:
    cap = step.pose.situation.wall_force
    return bool((step.pose.normals > cap * (1.0 + _OVER)).any())


def _turn(here: Any, there: Any) -> float:
    """Largest difference of their joint angles [rad]."""
    return float(np.abs(here.joint_angles - there.joint_angles).max(initial=0.0))


def _plan(
    task: _Targets, way: _Way, limits: tuple[Array, Array], cap: float, near: float, rates: Array, solves: int
) -> Plan:
    """The plan of the best attempt."""
    lengths = np.array([step.pose.command for step in way.steps])
    travel = np.abs(np.diff(lengths, axis=0))
    numbers = np.array(way.numbers)
    if task.times is None:
        times = np.concatenate([[0.0], np.cumsum(np.maximum((travel / rates).max(axis=1), _SOONEST))])
        at_rate = np.zeros(lengths.shape, bool)
    else:
        times = task.times[numbers]
        fast = travel >= (1.0 - 1e-9) * rates * np.diff(times)[:, None]
        at_rate = np.concatenate([np.zeros((1, lengths.shape[1]), bool), fast])
    ok, snapped = (np.array([getattr(step, name) for step in way.steps]) for name in ("ok", "snapped"))
    distance = np.array([step.pose.distance for step in way.steps])
    status = np.where(distance > near, PlanStatus.MISSED, PlanStatus.FOLLOWED)
    status[:-1][numbers[1:] == numbers[:-1]] = PlanStatus.DETOUR
    status = np.where(snapped, PlanStatus.SNAPPED, status)
    status = np.where(ok, status, PlanStatus.NO_EQUILIBRIUM)
    equilibria = stacked([step.pose.equilibrium for step in way.steps])
    return Plan(
        equilibria,
        lengths,
        times,
        task.targets[numbers],
        np.searchsorted(numbers, task.waypoints, side="right") - 1,
        distance,
        status,
        at_rate,
        limits,
        cap,
        way.prefer,
        solves,
    )
