"""The formulas of the arm's task, compiled: what it has of its own beside core/kernels.py.

A step is `prepare`, the solve, and `finish`; each works on lanes first to last - 1, and lanes do not see each other.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from rj_gym.core.kernels import (
    ERROR,
    FORCE,
    REFUSED,
    REWARD,
    STEP,
    TARGET,
    TENSIONS,
    TIP,
    finite,
    pull_tendons,
    reward_terms,
    settle_tendons,
)
from rollingjoint.compiled import Floats, Integers, Singles, borrow, carve, kernel, part
from rollingjoint.load import SPATIAL_LOAD_COLUMNS

FX = SPATIAL_LOAD_COLUMNS.index("fx")

# Columns of the readings after those of every task: direction of gravity; angle between tip and target frame, and its
# term of the reward; rotation matrices of both, row by row.
GRAVITY, ANGLE, ORIENTATION, TIP_FRAME, TARGET_FRAME, OWN = 0, 3, 4, 5, 14, 23


class Rules(NamedTuple):
    """Numbers that all lanes share; scales are FlexibleArmConfig's."""

    action_scale: float  # mm
    length: float  # of the arm, mm
    command_scale: float  # mm
    error_scale: float  # mm
    angle_scale: float  # rad
    highest_tension: float  # N
    payload_scale: float  # N
    effort: float
    smoothness: float
    failure_penalty: float
    orientation: bool
    observe_tensions: bool
    observe_target: bool  # and the errors
    observe_load: bool  # gravity and payload
    neutral_lengths: Annotated[Floats, "m"]  # mm
    low: Annotated[Singles, "entries"]  # of the observation
    high: Annotated[Singles, "entries"]


class Course(NamedTuple):
    """What is fixed when an episode begins; series have one entry where nothing changes over time."""

    targets: Annotated[Floats, "B", "1 or T + 1 targets", "3 or 12"]  # mm, and rotation matrices with `orientation`
    forces: Annotated[Floats, "B", "1 or T + 1 forces", 3]  # N
    stiffnesses: Annotated[Floats, "B", "m"]  # N/mm
    actuator_offsets: Annotated[Floats, "B", "m"]  # mm
    noise: Annotated[Floats, "B", "0 or T + 1", 6]  # mm, rad


class RunningEpisodes(NamedTuple):
    """Where running episodes are."""

    angles: Annotated[Floats, "B", "J"]  # hinge angles of the last usable equilibrium, rad
    poses: Annotated[Floats, "B", "n", 4, 4]  # its poses, mm
    actions: Annotated[Floats, "B", 2, "m"]  # the last action and the one before, within [-1, 1]
    readings: Annotated[Floats, "B", "columns"]  # TENSIONS + 2 m + OWN, named above


class Inputs(NamedTuple):
    """What goes into a step and into its solve."""

    actions: Annotated[Floats, "B", "m"]  # not yet clipped
    starts: Annotated[Floats, "B", "J"]  # hinge angles from which the solver starts, rad
    commands: Annotated[Floats, "B", "m"]  # tendon lengths, mm
    loads: Annotated[Floats, "B", "rows", 20]  # weights, and in the last row the payload


class Solved(NamedTuple):
    """The parts of the solver's results that the task reads."""

    joint_angles: Annotated[Floats, "B", "J"]
    poses: Annotated[Floats, "B", "n", 4, 4]
    tensions: Annotated[Floats, "B", "m"]
    lengths: Annotated[Floats, "B", "m"]
    status: Annotated[Integers, "B"]


@kernel(nogil=True)
def prepare(rules, course, state, inputs, first, last):
    """Begin a step of lanes: commands, starts and loads.

    Returns how many lanes remain to be solved, all of them. REFUSED, and nothing done, where an action is not finite.
    """
    if not finite(inputs.actions, first, last):
        return REFUSED
    payload, times = inputs.loads.shape[1] - 1, course.forces.shape[1]
    for lane in range(first, last):
        pull_tendons(rules, course, state, inputs, lane)
        for i in range(state.angles.shape[1]):
            inputs.starts[lane, i] = state.angles[lane, i]
        now = min(int(state.readings[lane, STEP]), times - 1)
        for axis in range(3):
            force = course.forces[lane, now, axis]
            inputs.loads[lane, payload, FX + axis] = state.readings[lane, FORCE + axis] = force
    return last - first


@kernel(nogil=True)
def finish(rules, course, state, solved, observation, first, last):
    """End a step after the solve: state, readings and the flat observation (B x entries,), float32."""
    _settle(course, state, solved, first, last)
    _measure_error(rules, course, state, first, last)
    reward_terms(rules, state, first, last)
    if rules.orientation:
        _reward_orientation(rules, state, first, last)
    _observe(rules, course, state, observation, first, last)


@kernel
def observe(rules, course, state, observation):
    """Fill the flat observation anew."""
    _observe(rules, course, state, observation, 0, observation.size // rules.low.size)


@part(inline=True)
def _settle(course, state, solved, first, last):
    """Take over equilibria. A lane without a usable one keeps its pose, tensions and commands."""
    angles, poses = state.angles, state.poses
    for lane in range(first, last):
        if not settle_tendons(course, state, solved, lane):
            continue
        for i in range(angles.shape[1]):
            angles[lane, i] = solved.joint_angles[lane, i]
        for k in range(poses.shape[1]):
            for row in range(3):
                for column in range(4):
                    poses[lane, k, row, column] = solved.poses[lane, k, row, column]


@part(inline=True)
def _measure_error(rules, course, state, first, last):
    """Tips, targets, the distances between them and, with orientation, the angles."""
    readings, poses, targets = state.readings, state.poses, course.targets
    tip, times, own = poses.shape[1] - 1, targets.shape[1], TENSIONS + 2 * state.actions.shape[2]
    E = np.empty((3, 3))
    for lane in range(first, last):
        now, square = min(int(readings[lane, STEP]), times - 1), 0.0
        for axis in range(3):
            readings[lane, TIP + axis] = poses[lane, tip, axis, 3]
            readings[lane, TARGET + axis] = targets[lane, now, axis]
            square += (readings[lane, TIP + axis] - readings[lane, TARGET + axis]) ** 2
        readings[lane, ERROR] = math.sqrt(square)
        if rules.orientation:
            for i in range(9):
                readings[lane, own + TIP_FRAME + i] = poses[lane, tip, i // 3, i % 3]
                readings[lane, own + TARGET_FRAME + i] = targets[lane, now, 3 + i]
            for i in range(3):
                for j in range(3):
                    E[i, j] = _row_product(readings, lane, own + TARGET_FRAME + 3 * i, own + TIP_FRAME + 3 * j)
            _, _, _, readings[lane, own + ANGLE] = rotation_vector(E)


@part(inline=True)
def _row_product(readings, lane, first, second):
    product = 0.0
    for k in range(3):
        product += readings[lane, first + k] * readings[lane, second + k]
    return product


@part(inline=True)
def _reward_orientation(rules, state, first, last):
    """The term of the orientation, added to the reward."""
    readings, own = state.readings, TENSIONS + 2 * state.actions.shape[2]
    for lane in range(first, last):
        readings[lane, own + ORIENTATION] = -readings[lane, own + ANGLE] / rules.angle_scale
        readings[lane, REWARD] += readings[lane, own + ORIENTATION]


@part
def rotation_vector(E):
    """Rotation vector of a rotation matrix (3, 3) [rad] and its length, at most pi: (x, y, z, angle).

    Exact to rounding near 0 and pi, too. Source: as rollingjoint.spatial.se3.rotation_vector.
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


@part(inline=True)
def _observe(rules, course, state, flat, first, last):
    """The observations, all entries within their bounds; the order is that of observation.arm_entries."""
    readings, poses, noise = state.readings, state.poses, course.noise
    m, times, tip = state.actions.shape[2], noise.shape[1], poses.shape[1] - 1
    own = TENSIONS + 2 * m
    observation = carve(borrow(flat), 0, (flat.size // rules.low.size, rules.low.size))
    R, aim, E, at = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    for lane in range(first, last):
        now = min(int(readings[lane, STEP]), times - 1)
        for axis in range(3):
            at[axis] = poses[lane, tip, axis, 3] + (noise[lane, now, axis] if times > 0 else 0.0)
            observation[lane, axis] = at[axis] / rules.length
        entry = 3
        if rules.orientation:
            for i in range(9):
                R[i // 3, i % 3] = poses[lane, tip, i // 3, i % 3]
                aim[i // 3, i % 3] = readings[lane, own + TARGET_FRAME + i]
            if times > 0:
                turn_frame(R, noise[lane, now, 3], noise[lane, now, 4], noise[lane, now, 5])
            entry = _write_columns(R, observation, lane, entry)
        for j in range(m):
            command = readings[lane, TENSIONS + m + j] - rules.neutral_lengths[j]
            observation[lane, entry + j] = command / rules.command_scale
        entry += m
        if rules.observe_tensions:
            for j in range(m):
                observation[lane, entry + j] = readings[lane, TENSIONS + j] / rules.highest_tension
            entry += m
        if rules.observe_target:
            for axis in range(3):
                observation[lane, entry + axis] = readings[lane, TARGET + axis] / rules.length
            entry += 3
            if rules.orientation:
                entry = _write_columns(aim, observation, lane, entry)
            for axis in range(3):
                observation[lane, entry + axis] = (readings[lane, TARGET + axis] - at[axis]) / rules.error_scale
            entry += 3
            if rules.orientation:
                for i in range(3):
                    for j in range(3):
                        E[i, j] = aim[i, 0] * R[j, 0] + aim[i, 1] * R[j, 1] + aim[i, 2] * R[j, 2]
                x, y, z, _ = rotation_vector(E)
                observation[lane, entry] = x / rules.angle_scale
                observation[lane, entry + 1] = y / rules.angle_scale
                observation[lane, entry + 2] = z / rules.angle_scale
                entry += 3
        if rules.observe_load:
            payload = 0.0
            for axis in range(3):
                observation[lane, entry + axis] = readings[lane, own + GRAVITY + axis]
                payload += readings[lane, own + GRAVITY + axis] * readings[lane, FORCE + axis]
            observation[lane, entry + 3] = payload / rules.payload_scale
        for place in range(rules.low.size):
            observation[lane, place] = min(max(observation[lane, place], rules.low[place]), rules.high[place])


@part(inline=True)
def _write_columns(R, observation, lane, entry):
    """Write the first two columns of a rotation matrix; returns the entry after them."""
    for column in range(2):
        for row in range(3):
            observation[lane, entry + 3 * column + row] = R[row, column]
    return entry + 6
