"""The tendon lengths, or tensions, that bring a mechanism to a target: one target, many, or all solutions for one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.chain.chain import AnyChain, check_chain
from rollingjoint.chain.solution import Solution
from rollingjoint.checks import as_integer, as_number, as_positive, seen_as_vector
from rollingjoint.errors import InvalidInput
from rollingjoint.inverse.aims import Aims
from rollingjoint.inverse.goal import Goal
from rollingjoint.inverse.result import Reach, ReachStatus
from rollingjoint.inverse.searches import CLOSE, EXACT, TOLERANCE, Searches, first_of, preferred_tensions
from rollingjoint.inverse.starts import nearest_sample, samples_of
from rollingjoint.inverse.steps import HeldPose, Move, Situation, approach, step_to
from rollingjoint.inverse.warm import reach_from
from rollingjoint.load import Load
from rollingjoint.statics.among import ORIGIN, Around, walls_of
from rollingjoint.statics.inputs import Start, angles_of, broadcast_limits, joint_limits_of, tension_limits_of
from rollingjoint.transmission import unstretched_length

Array = NDArray[np.float64]

STARTS = 24  # that a search tries before it gives up
_BY_SOLVES = 1e-5  # mm: a nearer target is reached with a history or among walls, where derivatives have kinks
_ONWARDS = 2  # times that all solutions go on from where their searches ended, to the preferred tensions


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
    lever, starts = checked_lever(lever), as_integer("starts", starts, 1)
    if (start is None or type(start) is Reach) and inputs == "lengths" and np.shape(tip) == (mechanism.dimension,):
        limits, near = broadcast_limits(tension_limits, mechanism.n_tendons), TOLERANCE
        target = seen_as_vector("tip", tip, mechanism.dimension, "coordinates")
        preferred, known = preferred_tensions(prefer, *limits), getattr(start, "equilibrium", None)
        if known is None:
            every, near = tension_limits_of(tension_limits, mechanism.n_tendons), EXACT * float(mechanism.length)
            known = nearest_sample(mechanism, table, every, target)
        if known is not None:
            equilibrium, lengths, distance, steps = reach_from(mechanism, target, table, limits, preferred, known)
            if distance <= near:
                return Reach(equilibrium, lengths, distance, ReachStatus.REACHED, limits, True, steps)
    goal = Goal.of(mechanism, tip, lever, single=True)
    search = Searches.of(mechanism, goal, table[None], tension_limits, inputs, prefer)
    angles_of(mechanism, start.equilibrium if isinstance(start, Reach) else start, None)  # as those of one solve
    result = search.run(start, starts).row(0)
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
        suffices = (
            not situation.aims and situation.surroundings is None and within is not None and _within(plain, within)
        )
        if suffices or plain.status is ReachStatus.INVALID_INPUT:
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
        order = np.argsort(np.where(inside, goal.distances(samples), np.inf))[: min(CLOSE, int(inside.sum()))]
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
    first = first_of(mechanism)
    goal = Goal.of(first, tips, checked_lever(lever), single=False)
    search = Searches.of(mechanism, goal, loads, tension_limits, inputs, prefer)
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
    search = Searches.of(mechanism, goal, tables, tension_limits, inputs, prefer)
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


def checked_lever(lever: float | None) -> float | None:
    """The lever; InvalidInput unless it is None or a number from 0."""
    return None if lever is None else as_number("lever", lever, 0.0)


def checked_wall_force(cap: float) -> float:
    """The cap on normal forces of walls; InvalidInput unless it is a positive number, or inf."""
    return np.inf if cap == np.inf else as_positive("wall_force", cap, "a positive number [N], or inf")
