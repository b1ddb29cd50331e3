"""The formulas of the arm's task, compiled: what it has of its own beside core/kernels.py.

Each kernel works on lanes first to last - 1, and lanes do not see each other.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from rj_gym.arm.columns import ANGLE, ORIENTATION, TARGET_FRAME, TIP_FRAME
from rj_gym.arm.measuring import measure, observe_all
from rj_gym.arm.rotations import rotation_vector
from rj_gym.core.columns import ERROR, FORCE, REWARD, STEP, TARGET, TENSIONS, TIP
from rj_gym.core.hardware import Hardware, HardwareRules
from rj_gym.core.kernels import REFUSED, finite, pull_tendons, reward_terms, settle_tendons
from rollingjoint.compiled import (
    PENDING,
    Floats,
    Integers,
    PinnedHinges,
    Singles,
    call_range,
    kernel,
    part,
    unpin,
)
from rollingjoint.load import SPATIAL_LOAD_COLUMNS

N_COLUMNS, FX = len(SPATIAL_LOAD_COLUMNS), SPATIAL_LOAD_COLUMNS.index("fx")


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
    precision: float
    orientation: bool
    observe_tensions: bool
    observe_target: bool  # and the errors
    observe_load: bool  # gravity and payload
    observe_tip: bool
    neutral_lengths: Annotated[Floats, "m"]  # mm
    low: Annotated[Singles, "entries"]  # of the observation
    high: Annotated[Singles, "entries"]
    hardware: HardwareRules


class Course(NamedTuple):
    """What is fixed when an episode begins; series have one entry where nothing changes over time."""

    targets: Annotated[Floats, "B", "1 or T + 1 targets", "3 or 12"]  # mm, and rotation matrices with `orientation`
    forces: Annotated[Floats, "B", "1 or T + 1 forces", 3]  # N
    stiffnesses: Annotated[Floats, "B", "m"]  # N/mm
    actuator_offsets: Annotated[Floats, "B", "m"]  # mm
    noise: Annotated[Floats, "B", "0, 1 or T + 1", 6]  # mm, rad


class RunningEpisodes(NamedTuple):
    """Where running episodes are."""

    angles: Annotated[Floats, "B", "J"]  # hinge angles of the last usable equilibrium, rad
    poses: Annotated[Floats, "B", "n", 4, 4]  # its poses, mm
    actions: Annotated[Floats, "B", 2, "m"]  # the last action and the one before, within [-1, 1]
    readings: Annotated[Floats, "B", "columns"]  # see rj_gym/core/columns.py, and above


class Inputs(NamedTuple):
    """What goes into a step and into its solve."""

    actions: Annotated[Floats, "B", "m"]  # not yet clipped
    starts: Annotated[Floats, "B", "J"]  # hinge angles from which the solver starts, rad
    commands: Annotated[Floats, "B", "m"]  # tendon lengths, mm
    loads: Annotated[Floats, "B", "rows", N_COLUMNS]  # weights, and in the last row the payload


class Solved(NamedTuple):
    """The parts of the solver's results that the task reads."""

    joint_angles: Annotated[Floats, "B", "J"]
    poses: Annotated[Floats, "B", "n", 4, 4]
    tensions: Annotated[Floats, "B", "m"]
    lengths: Annotated[Floats, "B", "m"]
    status: Annotated[Integers, "B"]


class TaskArrays(NamedTuple):
    """Everything that the kernels below work on."""

    rules: Rules
    course: Course
    state: RunningEpisodes
    hardware: Hardware
    inputs: Inputs
    solved: Solved
    solver: int  # a PinnedRange's entry and pins; 0: every lane is left to its solve_the_rest
    problem: int


@kernel(nogil=True, short_loops=True, title="the arm's environments")
def step(pins, observation, first, last):
    """One step of lanes, into the observations (B, entries) at an address, float32.

    Returns how many lanes the solver has left to PinnedRange.solve_the_rest; if any, `finish` remains to be done after
    that. REFUSED, and nothing done, where an action is not finite.
    """
    rules, course, state, hardware, inputs, solved, solver, problem = unpin(pins, TaskArrays)
    if not finite(inputs.actions, first, last):
        return REFUSED
    _prepare(rules, course, state, hardware, inputs, first, last)
    left = last - first if solver == 0 else call_range(solver, problem, PinnedHinges, first, last)
    if left < 0:  # no memory: the solver for all cases has what it needs, or raises
        left = last - first
        for lane in range(first, last):
            solved.status[lane] = PENDING
    if left == 0:
        _finish(rules, course, state, hardware, solved, observation, first, last)
    return left


@kernel(nogil=True, short_loops=True, title="the arm's environments")
def finish(pins, observation, first, last):
    """End a step after the solve: state, readings and the observations at an address."""
    rules, course, state, hardware, _, solved, _, _ = unpin(pins, TaskArrays)
    _finish(rules, course, state, hardware, solved, observation, first, last)


@kernel(short_loops=True, title="the arm's environments")
def observe(pins, observation):
    """Fill the observations at an address anew."""
    rules, course, state, hardware, _, _, _, _ = unpin(pins, TaskArrays)
    observe_all(rules, course, state, hardware, observation, 0, state.readings.shape[0])


@part(inline=True)
def _prepare(rules, course, state, hardware, inputs, first, last):
    """Fill in commands, starts and loads."""
    payload, times = inputs.loads.shape[1] - 1, course.forces.shape[1]
    for lane in range(first, last):
        pull_tendons(rules, course, state, hardware, inputs, lane)
        for i in range(state.angles.shape[1]):
            inputs.starts[lane, i] = state.angles[lane, i]
        now = min(int(state.readings[lane, STEP]), times - 1)
        for axis in range(3):
            force = course.forces[lane, now, axis]
            inputs.loads[lane, payload, FX + axis] = state.readings[lane, FORCE + axis] = force


@part(inline=True)
def _finish(rules, course, state, hardware, solved, observation, first, last):
    _settle(rules, course, state, hardware, solved, first, last)
    _measure_error(rules, course, state, first, last)
    reward_terms(rules, state, first, last)
    if rules.orientation:
        _reward_orientation(rules, state, first, last)
    if rules.hardware.active:
        measure(rules, course, state, hardware, first, last)
    observe_all(rules, course, state, hardware, observation, first, last)


@part(inline=True)
def _settle(rules, course, state, hardware, solved, first, last):
    """Take over equilibria. A lane without a usable one keeps its pose, tensions and commands."""
    angles, poses = state.angles, state.poses
    for lane in range(first, last):
        if not settle_tendons(rules, course, state, hardware, solved, lane):
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
