"""Plans over a receding horizon, compiled: costs of stages, and moves that lower their sum, episode by episode.

The commands of the tendons at stage s are those of now and the moves d_1 ... d_s. A stage costs, with its equilibrium,

    fade^(s-1) (|tip - target|² + stiffen² (high - largest tension)² + keep² |excess|²) + damping² |d_s|²,

where the excess is how far tensions are beyond their limits.

Every stage is expanded about its equilibrium by the implicit function theorem: exact rates, Gauss-Newton squares. The
moves within their bounds that minimise the expanded sum come from a sweep backwards and one forwards.
Source: Tassa, Mansard and Todorov, Control-limited differential dynamic programming, ICRA 2014; here the state is the
commands, and a move changes it by itself.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from agents.controllers.kernels import ROUNDING, eliminate
from rollingjoint.compiled import Floats, Integers, kernel, part

SINGULAR = 1e-12  # a smaller pivot is none
LOST = 1e9  # mm²: cost of a stage without a usable equilibrium
USABLE = 1  # the largest status of a stable equilibrium
AT_LIMIT = 1e-12  # rad: so near to its limit a joint is at it
EASED, DAMPED = 0.2, 10.0  # factors of the damping after a better plan, and after one that was no better
FIRST_DAMPING, NEGLIGIBLE = 0.1, 1e-6  # of the diagonal, the first one; mm²/mm²: a smaller one is none


class Stages(NamedTuple):
    """The model at the stages of B plans over N steps; R = B x (N + 1) rows, stage 0 is now."""

    commands: Annotated[Floats, "R", "m"]  # mm
    starts: Annotated[Floats, "R", "J"]  # joint angles to start from, rad
    stiffnesses: Annotated[Floats, "R", "m"]  # of the tendons, N/mm
    joints: Annotated[Floats, "J", 3]  # smallest and largest angle, rad
    status: Annotated[Integers, "R"]
    angles: Annotated[Floats, "R", "J"]  # rad
    H: Annotated[Floats, "R", "J", "J"]  # N·mm/rad; overwritten
    torques: Annotated[Floats, "R", "J", "m"]  # d residual / d tension, mm
    rates: Annotated[Floats, "R", "J", "m"]  # d length / d joint angle, mm/rad
    elastic: Annotated[Floats, "R", "m"]  # d tension / d length, N/mm
    lengths: Annotated[Floats, "R", "m"]  # mm
    tips: Annotated[Floats, "R", "d"]  # mm
    levers: Annotated[Floats, "R", "d", "J"]  # d tip / d joint angle, mm/rad


class Goals(NamedTuple):
    """What B plans are for."""

    targets: Annotated[Floats, "B", "N", "d"]  # of the tip at every stage, mm
    tips: Annotated[Floats, "B", "d"]  # where it is taken to be now, mm
    tensions: Annotated[Floats, "B", "m"]  # now, N
    low: Annotated[Floats, "B", "m"]  # their limits, N
    high: Annotated[Floats, "B", "m"]
    level: Annotated[Floats, "B"]  # of their mean, N; NaN: the largest is to be at its limit


class Plans(NamedTuple):
    """The best plans of B episodes so far, their expansions, and the next ones to try."""

    moves: Annotated[Floats, "B", "N", "m"]  # mm
    trial: Annotated[Floats, "B", "N", "m"]  # mm
    cost: Annotated[Floats, "B"]  # mm²
    damping: Annotated[Floats, "B"]  # more of it after plans that were no better, mm²/mm²
    tip_offsets: Annotated[Floats, "B", "d"]  # of the tip from the model's, which stay, mm
    tension_offsets: Annotated[Floats, "B", "m"]  # N
    slopes: Annotated[Floats, "B", "N", "m"]  # half the derivatives of the cost by the commands of a stage
    hessians: Annotated[Floats, "B", "N", "m", "m"]
    angles: Annotated[Floats, "B", "N", "J"]  # rad
    turns: Annotated[Floats, "B", "N", "J", "m"]  # d joint angles / d commands, rad/mm


class SweepScratch(NamedTuple):
    """Room for one episode."""

    turns: Annotated[Floats, "N", "J", "m"]
    slopes: Annotated[Floats, "N", "m"]
    hessians: Annotated[Floats, "N", "m", "m"]
    joint_system: Annotated[Floats, "J", "J + m"]
    system: Annotated[Floats, "m", "2 m + 1"]
    tip_by: Annotated[Floats, "d", "m"]
    tensions_by: Annotated[Floats, "m", "m"]
    row: Annotated[Floats, "m"]  # derivatives of a residual
    steps: Annotated[Floats, "N", "m"]
    gains: Annotated[Floats, "N", "m", "m"]
    value: Annotated[Floats, "m", "m"]
    before: Annotated[Floats, "m", "m"]
    slope: Annotated[Floats, "m"]
    held: Annotated[Floats, "m"]
    change: Annotated[Floats, "m"]


@part
def _new_scratch(N, J, m, d):
    return SweepScratch(
        np.empty((N, J, m)), np.empty((N, m)), np.empty((N, m, m)), np.empty((J, J + m)), np.empty((m, 2 * m + 1)),
        np.empty((d, m)), np.empty((m, m)), np.empty(m), np.empty((N, m)), np.empty((N, m, m)), np.empty((m, m)),
        np.empty((m, m)), np.empty(m), np.empty(m), np.empty(m),
    )  # fmt: skip


@kernel(nogil=True, short_loops=True, title="predictive control")
def improve(stages, goals, plans, weights, begins, ends):
    """Take the solved trial plans over where they cost less, and put the next trial into commands and starts.

    Args:
        weights: stiffen, damping, keep, fade, and the largest move [mm].
        begins: whether the trials are the first plans of a step. ends: whether there is no next trial.
    """
    n_episodes, N, m = plans.moves.shape
    scratch = _new_scratch(N, stages.angles.shape[1], m, stages.tips.shape[1])
    for b in range(n_episodes):
        now = b * (N + 1)
        if begins:
            _begin(stages, goals, plans, now, b)
        cost = 0.0
        for s in range(N):
            cost += _expand(stages, goals, plans, weights, now + 1 + s, b, s, scratch)
        if begins or cost < plans.cost[b]:
            plans.cost[b] = cost
            eased = 1.0 if begins else EASED
            plans.damping[b] = eased * plans.damping[b] if plans.damping[b] > NEGLIGIBLE else 0.0
            _take_over(stages, plans, now, b, scratch)
        else:
            plans.damping[b] = max(DAMPED * plans.damping[b], FIRST_DAMPING * _mean_diagonal(plans.hessians[b]))
        if not ends:
            _sweep_back(plans, weights, b, scratch)
            _sweep_forth(stages, plans, weights, now, b, scratch)


@part
def _begin(stages, goals, plans, now, b):
    """Offsets of tip and tensions from the model's, as they are now."""
    usable = stages.status[now] <= USABLE
    for axis in range(goals.tips.shape[1]):
        plans.tip_offsets[b, axis] = goals.tips[b, axis] - stages.tips[now, axis] if usable else 0.0
    for j in range(goals.tensions.shape[1]):
        plans.tension_offsets[b, j] = goals.tensions[b, j] - _tension(stages, now, j) if usable else 0.0


@part(inline=True)
def _tension(stages, row, j):
    """The tension of an elastic tendon that could push [N]."""
    return stages.stiffnesses[row, j] * (stages.lengths[row, j] - stages.commands[row, j])


@part
def _expand(stages, goals, plans, weights, row, b, s, scratch):
    """The cost of a stage; fills its half slope and half hessian by the commands, and the turns of its joints."""
    stiffen, damping, keep, fade, _ = weights
    weight = fade**s
    m, cost = plans.trial.shape[2], 0.0
    usable = stages.status[row] <= USABLE and _fill_turns(stages, row, scratch.joint_system, scratch.turns[s])
    _fill_rates(stages, row, usable, scratch, s)
    slope, hessian = scratch.slopes[s], scratch.hessians[s]
    for i in range(m):
        slope[i] = 0.0
        for k in range(m):
            hessian[i, k] = 0.0
        cost += damping**2 * plans.trial[b, s, i] ** 2
    if usable:
        for axis in range(goals.tips.shape[1]):
            off = stages.tips[row, axis] + plans.tip_offsets[b, axis] - goals.targets[b, s, axis]
            cost += _add(off, weight, scratch.tip_by[axis], slope, hessian)
    else:
        cost += LOST
    least, place, mean = math.inf, 0, 0.0
    for j in range(m):
        tension = _tension(stages, row, j) + plans.tension_offsets[b, j]
        mean += tension / m
        if goals.high[b, j] - tension < least:
            least, place = goals.high[b, j] - tension, j
        beyond = min(tension - goals.low[b, j], 0.0) + max(tension - goals.high[b, j], 0.0)
        if beyond != 0.0:
            cost += _add(beyond, weight * keep**2, scratch.tensions_by[j], slope, hessian)
    if math.isnan(goals.level[b]):
        return cost + _add(-least, weight * stiffen**2, scratch.tensions_by[place], slope, hessian)
    for i in range(m):
        scratch.row[i] = 0.0
        for j in range(m):
            scratch.row[i] += scratch.tensions_by[j, i] / m
    return cost + _add(mean - goals.level[b], weight * stiffen**2, scratch.row, slope, hessian)


@part(inline=True)
def _add(off, weight, by, slope, hessian):
    """Add a residual with these derivatives to half the slope and half the hessian; returns its cost."""
    for i in range(slope.size):
        pull = weight * by[i]
        slope[i] += pull * off
        for k in range(slope.size):
            hessian[i, k] += pull * by[k]
    return weight * off * off


@part
def _fill_turns(stages, row, system, turns):
    """Fill d joint angles / d commands, joints at a limit held; False where the stiffness is singular."""
    J, m = turns.shape
    for i in range(J):
        free = _is_free(stages, row, i)
        for k in range(J):
            coupled = free and _is_free(stages, row, k)
            system[i, k] = stages.H[row, i, k] if coupled else (1.0 if i == k else 0.0)
        for j in range(m):
            system[i, J + j] = stages.torques[row, i, j] * stages.elastic[row, j] if free else 0.0
    if not eliminate(system, J, SINGULAR):
        return False
    for i in range(J):
        for j in range(m):
            turns[i, j] = system[i, J + j]
    return True


@part(inline=True)
def _is_free(stages, row, i):
    """Whether a joint is between its limits."""
    return stages.joints[i, 0] + AT_LIMIT < stages.angles[row, i] < stages.joints[i, 1] - AT_LIMIT


@part
def _fill_rates(stages, row, usable, scratch, s):
    """Fill derivatives of tip and tensions by the commands; where there is no equilibrium the pose is held."""
    turns = scratch.turns[s]
    J, m = turns.shape
    if not usable:
        for i in range(J):
            for j in range(m):
                turns[i, j] = 0.0
    for k in range(m):
        for axis in range(stages.tips.shape[1]):
            scratch.tip_by[axis, k] = 0.0
            for i in range(J):
                scratch.tip_by[axis, k] += stages.levers[row, axis, i] * turns[i, k]
        for j in range(m):
            longer = -1.0 if j == k else 0.0
            for i in range(J):
                longer += stages.rates[row, i, j] * turns[i, k]
            scratch.tensions_by[j, k] = stages.stiffnesses[row, j] * longer


@part
def _take_over(stages, plans, now, b, scratch):
    """The trial becomes the best plan."""
    plans.moves[b] = plans.trial[b]
    plans.slopes[b], plans.hessians[b], plans.turns[b] = scratch.slopes, scratch.hessians, scratch.turns
    for s in range(plans.angles.shape[1]):
        plans.angles[b, s] = stages.angles[now + 1 + s]


@part
def _mean_diagonal(hessians):
    """The mean of the diagonals."""
    total, (N, m) = 0.0, hessians.shape[:2]
    for s in range(N):
        for i in range(m):
            total += hessians[s, i, i] / (N * m)
    return total


@part
def _sweep_back(plans, weights, b, scratch):
    """Fill the steps and gains of all moves: the best ones for the expanded costs of the stages from each on."""
    damping, limit = weights[1], weights[4]
    N, m = plans.moves.shape[1:]
    value, slope, before, change = scratch.value, scratch.slope, scratch.before, scratch.change
    value[:], slope[:] = 0.0, 0.0
    for s in range(N - 1, -1, -1):
        trace = 0.0
        for i in range(m):
            slope[i] += plans.slopes[b, s, i]
            for k in range(m):
                value[i, k] += plans.hessians[b, s, i, k]
            trace += value[i, i]
        more = damping**2 + plans.damping[b] + ROUNDING * trace
        move, step, gain = plans.moves[b, s], scratch.steps[s], scratch.gains[s]
        _bounded_step(value, more, slope, damping**2, move, limit, step, gain, scratch)
        for i in range(m):  # costs at the beginning of the move: a change x of the commands there is followed by gain x
            change[i] = slope[i]
            for k in range(m):
                change[i] += value[i, k] * step[k] + gain[k, i] * (slope[k] + damping**2 * move[k] + more * step[k])
                for j in range(m):
                    change[i] += gain[k, i] * value[k, j] * step[j]
        for i in range(m):
            for k in range(m):
                entry = value[i, k]
                for j in range(m):
                    entry += gain[j, i] * value[j, k] + value[i, j] * gain[j, k]
                    entry += more * gain[j, i] * gain[j, k]
                    for c in range(m):
                        entry += gain[j, i] * value[j, c] * gain[c, k]
                before[i, k] = entry
        for i in range(m):
            slope[i] = change[i]
            for k in range(m):
                value[i, k] = 0.5 * (before[i, k] + before[k, i])


@part
def _bounded_step(value, more, slope, effort, move, limit, step, gain, scratch):
    """The step of a move within its bounds, and its gains over the commands; entries that would leave stop there.

    Entries that the minimum would take beyond the bounds stop there, and the others are chosen again.
    """
    system, held, m = scratch.system, scratch.held, step.size
    step[:], held[:] = 0.0, 0.0
    for _ in range(m):
        stopped = False
        for i in range(m):
            for c in range(2 * m + 1):
                system[i, c] = 0.0
            if held[i] > 0.0:
                system[i, i] = 1.0
                continue
            system[i, m] = -slope[i] - effort * move[i]
            for k in range(m):
                if held[k] > 0.0:
                    system[i, m] -= value[i, k] * step[k]
                else:
                    system[i, k] = value[i, k] + (more if i == k else 0.0)
                system[i, m + 1 + k] = -value[i, k]
        if not eliminate(system, m, SINGULAR):
            break
        for i in range(m):
            if held[i] == 0.0:
                step[i] = min(max(system[i, m], -limit - move[i]), limit - move[i])
                if step[i] != system[i, m]:
                    held[i], stopped = 1.0, True
        if not stopped:
            break
    for i in range(m):
        for k in range(m):
            gain[i, k] = 0.0 if held[i] > 0.0 else system[i, m + 1 + k]


@part
def _sweep_forth(stages, plans, weights, now, b, scratch):
    """Fill the trial: steps, and gains over how far the commands are from those of the best plan."""
    limit, (N, m), change = weights[4], plans.moves.shape[1:], scratch.change
    change[:] = 0.0
    for s in range(N):
        for i in range(m):
            scratch.row[i] = scratch.steps[s, i]
            for k in range(m):
                scratch.row[i] += scratch.gains[s, i, k] * change[k]
        for i in range(m):
            plans.trial[b, s, i] = min(max(plans.moves[b, s, i] + scratch.row[i], -limit), limit)
        row = now + 1 + s
        for i in range(m):
            stages.commands[row, i] = stages.commands[row - 1, i] + plans.trial[b, s, i]
            change[i] += plans.trial[b, s, i] - plans.moves[b, s, i]
        for i in range(stages.starts.shape[1]):
            angle = plans.angles[b, s, i]
            for k in range(m):
                angle += plans.turns[b, s, i, k] * change[k]
            stages.starts[row, i] = min(max(angle, stages.joints[i, 0]), stages.joints[i, 1])
