"""The formulas of the planar tracking task, compiled: loads, predicted starts and observations of a range of lanes.

A step is `step`, and where it leaves lanes to the solver for all cases, that and `finish`; each works on lanes first to
last - 1, and lanes do not see each other.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from rj_gym.core.kernels import (
    ERROR,
    FORCE,
    LINK,
    REFUSED,
    STEP,
    TARGET,
    TENSIONS,
    TIP,
    finite,
    pull_tendons,
    reward_terms,
    settle_tendons,
)
from rollingjoint.compiled import (
    PENDING,
    BatchArrays,
    Floats,
    Integers,
    Singles,
    borrow,
    call_range,
    carve,
    kernel,
    unpin,
)
from rollingjoint.load import LOAD_COLUMNS

FX, FY = LOAD_COLUMNS.index("fx"), LOAD_COLUMNS.index("fy")

BLOCK = 16  # lanes whose angles are turned together
PREDICTABLE = 0.2  # rad: how far a joint may turn in a predicted start
ROUND = 1.5 * 2.0**52  # added and taken away again, it rounds to a whole number


class Rules(NamedTuple):
    """Numbers that all lanes share; scales are TrackingConfig's."""

    action_scale: float  # mm
    length: float  # of the mechanism, mm
    command_scale: float  # mm
    error_scale: float  # mm
    highest_tension: float  # N
    force_scale: float  # N
    effort: float
    smoothness: float
    failure_penalty: float
    observe_tensions: bool
    observe_target: bool
    observe_load: bool
    neutral_lengths: Annotated[Floats, "m"]  # mm
    low: Annotated[Singles, "entries"]  # of the observation
    high: Annotated[Singles, "entries"]


class Course(NamedTuple):
    """What is fixed when an episode begins; series have one entry where nothing changes over time."""

    targets: Annotated[Floats, "B", "1 or T + 1 targets", 2]  # mm
    forces: Annotated[Floats, "B", "1 or T + 1 forces", 2]  # N
    stiffnesses: Annotated[Floats, "B", "m"]  # N/mm
    actuator_offsets: Annotated[Floats, "B", "m"]  # mm
    noise: Annotated[Floats, "B", "0 or T + 1", "moving", 3]  # mm, mm, rad


class RunningEpisodes(NamedTuple):
    """Where running episodes are."""

    angles: Annotated[Floats, "B", "J"]  # joint angles of the last usable equilibrium, rad
    responses: Annotated[Floats, "B", "J", "m"]  # its d angle / d command, rad/mm
    poses: Annotated[Floats, "B", "n", 3]  # its poses, mm, mm, rad
    actions: Annotated[Floats, "B", 2, "m"]  # the last action and the one before, within [-1, 1]
    readings: Annotated[Floats, "B", "columns"]  # TENSIONS + 2 m, named above


class Inputs(NamedTuple):
    """What goes into a step and into its solve."""

    actions: Annotated[Floats, "B", "m"]  # not yet clipped
    starts: Annotated[Floats, "B", "J"]  # joint angles from which the solver starts, rad
    commands: Annotated[Floats, "B", "m"]  # tendon lengths, mm
    loads: Annotated[Floats, "B", 1, len(LOAD_COLUMNS)]


class Solved(NamedTuple):
    """The parts of the solver's Results that the task reads."""

    joint_angles: Annotated[Floats, "B", "J"]
    poses: Annotated[Floats, "B", "n", 3]
    tensions: Annotated[Floats, "B", "m"]
    lengths: Annotated[Floats, "B", "m"]
    responses: Annotated[Floats, "B", "J", "m"]
    status: Annotated[Integers, "B"]


class TaskArrays(NamedTuple):
    """Everything that the kernels below work on."""

    rules: Rules
    course: Course
    state: RunningEpisodes
    inputs: Inputs
    solved: Solved


@kernel(nogil=True)
def step(pins, solver, problem, observation, first, last):
    """One step of lanes, into the flat observation (B x entries,), float32.

    Returns how many lanes the solver has left to PinnedRange.solve_the_rest (`solver` and `problem` are its entry and
    pins); if any, `finish` remains to be done after that. REFUSED, and nothing done, where an action is not finite.
    """
    rules, course, state, inputs, solved = unpin(pins, TaskArrays)
    if not finite(inputs.actions, first, last):
        return REFUSED
    _prepare(rules, course, state, inputs, first, last)
    left = last - first if solver == 0 else call_range(solver, problem, BatchArrays, first, last)
    if left < 0:  # no memory: the solver for all cases has what it needs, or raises
        left = last - first
        for lane in range(first, last):
            solved.status[lane] = PENDING
    if left == 0:
        _finish(rules, course, state, solved, observation, first, last)
    return left


@kernel(nogil=True)
def finish(pins, observation, first, last):
    """End a step after the solve: state, readings and the flat observation."""
    rules, course, state, _, solved = unpin(pins, TaskArrays)
    _finish(rules, course, state, solved, observation, first, last)


@kernel
def observe(pins, observation):
    """Fill the flat observation anew."""
    rules, course, state, _, _ = unpin(pins, TaskArrays)
    vectors = carve(borrow(observation), 0, (observation.size // rules.low.size, rules.low.size))
    _observe_links(rules, course, state, vectors, 0, vectors.shape[0])
    _observe(rules, course, state, vectors, 0, vectors.shape[0])


@kernel(inline="always")
def _prepare(rules, course, state, inputs, first, last):
    """Begin a step: tendons are pulled, the load moves on; fill commands, starts and loads."""
    forces, readings, loads = course.forces, state.readings, inputs.loads
    times = forces.shape[1]
    for lane in range(first, last):
        pull_tendons(rules, course, state, inputs, lane)
        _predict(state, inputs, course, lane)
        now = min(int(readings[lane, STEP]), times - 1)
        loads[lane, 0, FX] = readings[lane, FORCE] = forces[lane, now, 0]
        loads[lane, 0, FY] = readings[lane, FORCE + 1] = forces[lane, now, 1]


@kernel(inline="always")
def _predict(state, inputs, course, lane):
    """Start the solve on the tangent of the last equilibrium: that saves the first of about four Newton steps.

    A prediction that goes far is not to be trusted: the solve then starts from the last equilibrium itself.
    """
    angles, responses, starts = state.angles, state.responses, inputs.starts
    n_joints, m = angles.shape[1], responses.shape[2]
    farthest = 0.0
    for i in range(n_joints):
        turn = 0.0
        for j in range(m):
            held = state.readings[lane, TENSIONS + m + j] + course.actuator_offsets[lane, j]
            turn += responses[lane, i, j] * (inputs.commands[lane, j] - held)
        starts[lane, i] = angles[lane, i] + turn
        farthest = max(farthest, abs(turn))
    if not farthest < PREDICTABLE:
        for i in range(n_joints):
            starts[lane, i] = angles[lane, i]


@kernel(inline="always")
def _finish(rules, course, state, solved, observation, first, last):
    """End a step: state, readings, the flat observation."""
    vectors = carve(borrow(observation), 0, (observation.size // rules.low.size, rules.low.size))
    _settle(course, state, solved, first, last)
    _measure_error(course, state, first, last)
    reward_terms(rules, state, first, last)
    _observe_links(rules, course, state, vectors, first, last)
    _observe(rules, course, state, vectors, first, last)


@kernel(inline="always")
def _settle(course, state, solved, first, last):
    """Take over equilibria. A lane without a usable one keeps its pose, tensions and commands."""
    angles, responses, poses = state.angles, state.responses, state.poses
    new_angles, new_poses = solved.joint_angles, solved.poses
    n_joints, m = angles.shape[1], responses.shape[2]
    for lane in range(first, last):
        if not settle_tendons(course, state, solved, lane):
            continue
        for i in range(n_joints):
            angles[lane, i] = new_angles[lane, i]
            for j in range(m):
                responses[lane, i, j] = solved.responses[lane, i, j]
        for k in range(n_joints + 1):
            for axis in range(3):
                poses[lane, k, axis] = new_poses[lane, k, axis]


@kernel(inline="always")
def _measure_error(course, state, first, last):
    """Tips, targets and the distances between them."""
    readings, poses, targets = state.readings, state.poses, course.targets
    tip, times = poses.shape[1] - 1, targets.shape[1]
    for lane in range(first, last):
        now = min(int(readings[lane, STEP]), times - 1)
        for axis in range(2):
            readings[lane, TIP + axis] = poses[lane, tip, axis]
            readings[lane, TARGET + axis] = targets[lane, now, axis]
        x = readings[lane, TIP] - readings[lane, TARGET]
        y = readings[lane, TIP + 1] - readings[lane, TARGET + 1]
        readings[lane, ERROR] = math.sqrt(x * x + y * y)


@kernel(inline="always")
def _observe_links(rules, course, state, observation, first, last):
    """The first entries of observations: measured poses of the moving links, a block of lanes at a time."""
    poses, noise, readings, per_length = state.poses, course.noise, state.readings, 1 / rules.length
    moving, times = poses.shape[1] - 1, noise.shape[1]
    memory, size = np.empty(3 * BLOCK * moving), BLOCK * moving
    angles, cosines, sines = memory[:size], memory[size : 2 * size], memory[2 * size :]
    for start in range(first, last, BLOCK):
        stop = min(start + BLOCK, last)
        for lane in range(start, stop):
            for k in range(moving):
                x, y, angle = poses[lane, k + 1, 0], poses[lane, k + 1, 1], poses[lane, k + 1, 2]
                if times > 0:
                    now = min(int(readings[lane, STEP]), times - 1)
                    x, y, angle = x + noise[lane, now, k, 0], y + noise[lane, now, k, 1], angle + noise[lane, now, k, 2]
                observation[lane, 4 * k] = x * per_length
                observation[lane, 4 * k + 1] = y * per_length
                angles[(lane - start) * moving + k] = angle
        for i in range((stop - start) * moving):
            cosines[i], sines[i] = _cos_sin(angles[i])
        for lane in range(start, stop):
            for k in range(moving):
                observation[lane, 4 * k + 2] = cosines[(lane - start) * moving + k]
                observation[lane, 4 * k + 3] = sines[(lane - start) * moving + k]


@kernel(inline="always")
def _cos_sin(angle):
    """Cosine and sine to 1e-10, for angles to 1e4.

    Without a branch or a call, so that a loop over it becomes vector instructions: a third of the library's time.
    Taylor series of half the angle, reduced to [-pi/2, pi/2]; pi stands in two parts.
    """
    turns = (angle * (1 / math.pi) + ROUND) - ROUND
    half = 0.5 * ((angle - turns * 3.141592653468251) - turns * 1.2154201013012384e-10)
    z = half * half
    s = half * (1 + z * (-1 / 6 + z * (1 / 120 + z * (-1 / 5040 + z * (1 / 362880 - z * (1 / 39916800))))))
    odd = turns - 2.0 * ((0.5 * turns + ROUND) - ROUND)
    c = 1 + z * (-1 / 2 + z * (1 / 24 + z * (-1 / 720 + z * (1 / 40320 + z * (-1 / 3628800 + z * (1 / 479001600))))))
    sign = 1.0 - 2.0 * odd * odd
    return sign * (1 - 2 * s * s), sign * (2 * s * c)


@kernel(inline="always")
def _observe(rules, course, state, observation, first, last):
    """The other entries of observations, and all within their bounds; the order is that of observation_entries."""
    readings, poses, noise = state.readings, state.poses, course.noise
    low, high, neutral_lengths = rules.low, rules.high, rules.neutral_lengths
    per_length, per_error, per_command = 1 / rules.length, 1 / rules.error_scale, 1 / rules.command_scale
    per_tension, per_force = 1 / rules.highest_tension, 1 / rules.force_scale
    moving, m, times = poses.shape[1] - 1, state.actions.shape[2], noise.shape[1]
    for lane in range(first, last):
        x, y, entry = poses[lane, moving, 0], poses[lane, moving, 1], 4 * moving
        if times > 0:
            now = min(int(readings[lane, STEP]), times - 1)
            x, y = x + noise[lane, now, moving - 1, 0], y + noise[lane, now, moving - 1, 1]
        for j in range(m):
            command = readings[lane, TENSIONS + m + j] - neutral_lengths[j]
            observation[lane, entry + j] = command * per_command
        entry += m
        if rules.observe_tensions:
            for j in range(m):
                observation[lane, entry + j] = readings[lane, TENSIONS + j] * per_tension
            entry += m
        if rules.observe_target:
            target_x, target_y = readings[lane, TARGET], readings[lane, TARGET + 1]
            observation[lane, entry] = target_x * per_length
            observation[lane, entry + 1] = target_y * per_length
            observation[lane, entry + 2] = (target_x - x) * per_error
            observation[lane, entry + 3] = (target_y - y) * per_error
            entry += 4
        if rules.observe_load:
            observation[lane, entry] = readings[lane, FORCE] * per_force
            observation[lane, entry + 1] = readings[lane, FORCE + 1] * per_force
            for k in range(moving):
                observation[lane, entry + 2 + k] = 1.0 if readings[lane, LINK] == k + 1 else 0.0
        for entry in range(low.size):
            observation[lane, entry] = min(max(observation[lane, entry], low[entry]), high[entry])
