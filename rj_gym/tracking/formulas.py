"""The formulas of the tracking tasks, compiled: pulled tendons, friction's history, rewards, rotations of frames.

Those of lanes work on arrays that have the lane first; lanes do not see each other.
"""

from __future__ import annotations

import math

from rj_gym.core.columns import (
    ANGLE,
    EFFORT,
    ERROR,
    FAILURE,
    ORIENTATION,
    REWARD,
    SMOOTHNESS,
    STATUS,
    STEP,
    STICKING,
    TENSIONS,
    TRACKING,
    WORK,
)
from rj_gym.tracking.hardware import move_motors, settle_motors
from rollingjoint.chain.status import Status
from rollingjoint.compiled import borrow, kernel, part, unstretched_length

AT_LIMIT = int(Status.AT_LIMIT)  # the last status of a usable equilibrium

REFUSED = -1  # what a step returns instead of a number of lanes


@kernel(short_loops=True, title="the environments")
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


@kernel(nogil=True, short_loops=True, title="the environments")
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
    """The terms of the reward, and their sum."""
    readings, actions = state.readings, state.actions
    m = actions.shape[2]
    own = TENSIONS + 2 * m
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
        if rules.orientation:
            readings[lane, own + ORIENTATION] = -readings[lane, own + ANGLE] / rules.angle_scale
            readings[lane, REWARD] += readings[lane, own + ORIENTATION]


@part
def rotation_vector(E):
    """Rotation vector of a rotation matrix (3, 3) [rad] and its length, at most pi: (x, y, z, angle).

    Exact to rounding near 0 and pi, too. Source: as rollingjoint.chain.se3.rotation_vector.
    """
    sx, sy, sz = E[2, 1] - E[1, 2], E[0, 2] - E[2, 0], E[1, 0] - E[0, 1]
    sine, cosine = 0.5 * math.sqrt(sx * sx + sy * sy + sz * sz), 0.5 * (E[0, 0] + E[1, 1] + E[2, 2] - 1.0)
    angle = math.atan2(sine, cosine)
    if cosine >= -0.5:
        scale = 0.5 * (angle / sine if sine > 1e-8 else 1.0)
        return scale * sx, scale * sy, scale * sz, angle
    k = 0
    for i in range(1, 3):
        if E[i, i] > E[k, k]:
            k = i
    x, y, z = 0.5 * (E[0, k] + E[k, 0]), 0.5 * (E[1, k] + E[k, 1]), 0.5 * (E[2, k] + E[k, 2])
    x, y, z = x - (cosine if k == 0 else 0.0), y - (cosine if k == 1 else 0.0), z - (cosine if k == 2 else 0.0)
    scale = angle / math.sqrt(x * x + y * y + z * z)
    if x * sx + y * sy + z * sz < 0.0:
        scale = -scale
    return scale * x, scale * y, scale * z, angle


@part
def turn_frame(R, wx, wy, wz):
    """Turn a rotation matrix (3, 3) by a rotation vector of the base frame [rad], in place."""
    square = wx * wx + wy * wy + wz * wz
    angle = math.sqrt(square)
    a = math.sin(angle) / angle if angle > 1e-4 else 1.0 - square / 6.0
    b = (1.0 - math.cos(angle)) / square if angle > 1e-4 else 0.5 - square / 24.0
    for column in range(3):
        x, y, z = R[0, column], R[1, column], R[2, column]
        ux, uy, uz = wy * z - wz * y, wz * x - wx * z, wx * y - wy * x
        R[0, column] = x + a * ux + b * (wy * uz - wz * uy)
        R[1, column] = y + a * uy + b * (wz * ux - wx * uz)
        R[2, column] = z + a * uz + b * (wx * uy - wy * ux)
