"""Formulas that every tracking task shares, compiled.

Kernels work on lanes first to last - 1 of arrays that have the lane first; lanes do not see each other.
"""

from __future__ import annotations

import math

from rj_gym.core.columns import (
    EFFORT,
    ERROR,
    FAILURE,
    REWARD,
    SMOOTHNESS,
    STATUS,
    STEP,
    STICKING,
    TENSIONS,
    TRACKING,
    WORK,
)
from rj_gym.core.hardware import move_motors, settle_motors
from rollingjoint.chain.status import Status
from rollingjoint.compiled import borrow, kernel, next_uniform, part, unstretched_length

AT_LIMIT = int(Status.AT_LIMIT)  # the last status of a usable equilibrium

REFUSED = -1  # what a step returns instead of a number of lanes


@kernel(short_loops=True, title="what all environments share")
def all_finite(values):
    """Whether no value (B, m) is NaN or infinite."""
    return finite(borrow(values), 0, len(values))


@part(inline=True)
def finite(values, first, last):
    """Whether no value of these lanes is NaN or infinite."""
    fine = True
    for lane in range(first, last):
        for j in range(values.shape[1]):
            fine &= math.isfinite(values[lane, j])
    return fine


@kernel(short_loops=True, title="what all environments share")
def fill_uniforms(sources, rows):
    """Fill rows (B, K) with numbers in [0, 1) from bit generators: (B, 2), next_double and the state it works on."""
    for row in range(len(rows)):
        entry, source = sources[row, 0], sources[row, 1]
        for column in range(rows.shape[1]):
            rows[row, column] = next_uniform(entry, source)


@part(inline=True)
def pull_tendons(rules, course, state, hardware, inputs, lane):
    """Count the step, and turn its action into commands: at 1 it pulls a tendon in by action_scale [mm]."""
    offsets, readings, taken = course.actuator_offsets, state.readings, state.actions
    actions, commands = inputs.actions, inputs.commands
    m = actions.shape[1]
    readings[lane, STEP] += 1.0
    for j in range(m):
        taken[lane, 1, j] = taken[lane, 0, j]
        taken[lane, 0, j] = min(max(actions[lane, j], -1.0), 1.0)
    if rules.hardware.active:
        move_motors(rules, hardware, state, offsets, commands, lane)
        return
    for j in range(m):
        believed = readings[lane, TENSIONS + m + j] - rules.action_scale * taken[lane, 0, j]
        commands[lane, j] = believed + offsets[lane, j]


@part(inline=True)
def settle_tendons(rules, course, state, hardware, solved, lane):
    """Take over status, tensions and commands of a lane; returns whether its equilibrium is a usable one.

    Where a tension is at a limit the motor holds or gives way and its command follows, l_cmd = l - tension / k, so
    that commands never wind up; elsewhere that is the command itself.
    """
    readings, tensions, lengths = state.readings, solved.tensions, solved.lengths
    stiffnesses, offsets = course.stiffnesses, course.actuator_offsets
    m = tensions.shape[1]
    readings[lane, STATUS] = solved.status[lane]
    usable = solved.status[lane] <= AT_LIMIT
    if usable:
        for j in range(m):
            unstretched = unstretched_length(lengths[lane, j], tensions[lane, j], stiffnesses[lane, j])
            readings[lane, TENSIONS + j] = tensions[lane, j]
            readings[lane, TENSIONS + m + j] = unstretched - offsets[lane, j]
        if rules.hardware.active:
            settle_motors(hardware, readings, lane)
    return usable


def friction_columns(n_joints: int, n_tendons: int) -> int:
    """How many columns of readings say what friction did."""
    return STICKING + 2 * n_joints * n_tendons


@kernel(nogil=True, short_loops=True, title="what all environments share")
def keep_history(friction, crossed, status, readings, first, last):
    """End steps with friction: where one stands, the next goes on from it; elsewhere the history stays as it was.

    crossed: (B, m) number of joints that a tendon crosses.
    """
    friction, crossed, status, readings = borrow(friction), borrow(crossed), borrow(status), borrow(readings)
    before, after = friction.before, friction.after
    n_joints, m = before.states.shape[1], before.states.shape[2]
    at = readings.shape[1] - (STICKING + 2 * n_joints * m)
    for lane in range(first, last):
        readings[lane, at + WORK] = 0.0
        if status[lane] > AT_LIMIT:
            continue
        readings[lane, at + WORK] = friction.work[lane]
        place = at + STICKING
        for i in range(n_joints):
            before.angles[lane, i], before.rolling[lane, i] = after.angles[lane, i], after.rolling[lane, i]
            for j in range(m):
                z = after.states[lane, i, j]
                before.states[lane, i, j] = z
                before.slips[lane, i, j], before.grips[lane, i, j] = after.slips[lane, i, j], after.grips[lane, i, j]
                readings[lane, place] = 1.0 if i < crossed[lane, j] and abs(z) < 1.0 else 0.0
                readings[lane, place + n_joints * m] = friction.tension[lane, i, j]
                place += 1


@part(inline=True)
def reward_terms(rules, state, first, last):
    """The terms of the reward that every task has, and their sum."""
    readings, actions = state.readings, state.actions
    m = actions.shape[2]
    for lane in range(first, last):
        effort = change = 0.0
        for j in range(m):
            effort += (readings[lane, TENSIONS + j] / rules.highest_tension) ** 2
            change += (actions[lane, 0, j] - actions[lane, 1, j]) ** 2
        tracking = -readings[lane, ERROR] / rules.error_scale
        if rules.precision > 0.0:
            tracking -= rules.precision * readings[lane, ERROR] / (readings[lane, ERROR] + 1.0)
        effort *= -rules.effort / m
        change *= -rules.smoothness / m
        failure = 0.0 if readings[lane, STATUS] <= AT_LIMIT else -rules.failure_penalty
        readings[lane, TRACKING], readings[lane, EFFORT] = tracking, effort
        readings[lane, SMOOTHNESS], readings[lane, FAILURE] = change, failure
        readings[lane, REWARD] = tracking + effort + change + failure
