"""The formulas of the planar tracking task, compiled: loads, predicted starts and ends of steps of a range of lanes.

A step is `step`, and where it leaves lanes to the solver for all cases, that and `finish`; each works on lanes first to
last - 1, and lanes do not see each other.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from rj_gym.core.columns import ERROR, FORCE, STEP, TARGET, TENSIONS, TIP
from rj_gym.core.hardware import Hardware, HardwareRules
from rj_gym.core.kernels import REFUSED, finite, pull_tendons, reward_terms, settle_tendons
from rj_gym.planar.measuring import measure, observe_links, observe_rest
from rollingjoint.compiled import (
    PENDING,
    Floats,
    Integers,
    PinnedBatch,
    Singles,
    call_range,
    kernel,
    part,
    singles_at,
    unpin,
)
from rollingjoint.load import LOAD_COLUMNS

FX, FY = LOAD_COLUMNS.index("fx"), LOAD_COLUMNS.index("fy")

PREDICTABLE = 0.2  # rad: how far a joint may turn in a predicted start


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
    precision: float
    observe_tensions: bool
    observe_target: bool
    observe_load: bool
    neutral_lengths: Annotated[Floats, "m"]  # mm
    low: Annotated[Singles, "entries"]  # of the observation
    high: Annotated[Singles, "entries"]
    first_seen: int  # of the moving links, those before it are not observed
    hardware: HardwareRules


class Course(NamedTuple):
    """What is fixed when an episode begins; series have one entry where nothing changes over time."""

    targets: Annotated[Floats, "B", "1 or T + 1 targets", 2]  # mm
    forces: Annotated[Floats, "B", "1 or T + 1 forces", 2]  # N
    stiffnesses: Annotated[Floats, "B", "m"]  # N/mm
    actuator_offsets: Annotated[Floats, "B", "m"]  # mm
    noise: Annotated[Floats, "B", "0, 1 or T + 1", "moving", 3]  # mm, mm, rad


class RunningEpisodes(NamedTuple):
    """Where running episodes are."""

    angles: Annotated[Floats, "B", "J"]  # joint angles of the last usable equilibrium, rad
    responses: Annotated[Floats, "B", "J", "m"]  # its d angle / d command, rad/mm
    poses: Annotated[Floats, "B", "n", 3]  # its poses, mm, mm, rad
    actions: Annotated[Floats, "B", 2, "m"]  # the last action and the one before, within [-1, 1]
    readings: Annotated[Floats, "B", "columns"]  # see rj_gym/core/columns.py
    tip_rates: Annotated[Floats, "0 or B", 2, "m"]  # d tip / d command, where it is asked for


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
    contacts: Annotated[Floats, "B or 0", "J", 4]
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


@kernel(nogil=True, short_loops=True, title="the planar environments")
def step(pins, observation, first, last):
    """One step of lanes, into the observations (B, entries) at an address, float32.

    Returns how many lanes the solver has left to PinnedRange.solve_the_rest; if any, `finish` remains to be done after
    that. REFUSED, and nothing done, where an action is not finite.
    """
    rules, course, state, hardware, inputs, solved, solver, problem = unpin(pins, TaskArrays)
    if not finite(inputs.actions, first, last):
        return REFUSED
    _prepare(rules, course, state, hardware, inputs, first, last)
    left = last - first if solver == 0 else call_range(solver, problem, PinnedBatch, first, last)
    if left < 0:  # no memory: the solver for all cases has what it needs, or raises
        left = last - first
        for lane in range(first, last):
            solved.status[lane] = PENDING
    if left == 0:
        _finish(rules, course, state, hardware, solved, observation, first, last)
    return left


@kernel(nogil=True, short_loops=True, title="the planar environments")
def finish(pins, observation, first, last):
    """End a step after the solve: state, readings and the observations at an address."""
    rules, course, state, hardware, _, solved, _, _ = unpin(pins, TaskArrays)
    _finish(rules, course, state, hardware, solved, observation, first, last)


@kernel(short_loops=True, title="the planar environments")
def observe(pins, observation):
    """Fill the observations at an address anew."""
    rules, course, state, hardware, _, _, _, _ = unpin(pins, TaskArrays)
    vectors = singles_at(observation, (state.readings.shape[0], rules.low.size))
    observe_links(rules, course, state, hardware, vectors, 0, vectors.shape[0])
    observe_rest(rules, course, state, hardware, vectors, 0, vectors.shape[0])


@part(inline=True)
def _prepare(rules, course, state, hardware, inputs, first, last):
    """Begin a step: tendons are pulled, the load moves on; fill commands, starts and loads."""
    forces, readings, loads = course.forces, state.readings, inputs.loads
    times = forces.shape[1]
    for lane in range(first, last):
        pull_tendons(rules, course, state, hardware, inputs, lane)
        _predict(state, inputs, course, lane)
        now = min(int(readings[lane, STEP]), times - 1)
        loads[lane, 0, FX] = readings[lane, FORCE] = forces[lane, now, 0]
        loads[lane, 0, FY] = readings[lane, FORCE + 1] = forces[lane, now, 1]


@part(inline=True)
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


@part(inline=True)
def _finish(rules, course, state, hardware, solved, observation, first, last):
    """End a step: state, readings, the observations."""
    vectors = singles_at(observation, (state.readings.shape[0], rules.low.size))
    _settle(rules, course, state, hardware, solved, first, last)
    _measure_error(course, state, first, last)
    reward_terms(rules, state, first, last)
    if rules.hardware.active:
        measure(rules, course, state, hardware, first, last)
    observe_links(rules, course, state, hardware, vectors, first, last)
    observe_rest(rules, course, state, hardware, vectors, first, last)


@part(inline=True)
def _settle(rules, course, state, hardware, solved, first, last):
    """Take over equilibria. A lane without a usable one keeps its pose, tensions and commands."""
    angles, responses, poses = state.angles, state.responses, state.poses
    new_angles, new_poses = solved.joint_angles, solved.poses
    n_joints, m = angles.shape[1], responses.shape[2]
    for lane in range(first, last):
        if not settle_tendons(rules, course, state, hardware, solved, lane):
            continue
        if state.tip_rates.shape[0] > 0:
            _keep_tip_rates(state, solved, lane)
        for i in range(n_joints):
            angles[lane, i] = new_angles[lane, i]
            for j in range(m):
                responses[lane, i, j] = solved.responses[lane, i, j]
        for k in range(n_joints + 1):
            for axis in range(3):
                poses[lane, k, axis] = new_poses[lane, k, axis]


@part(inline=True)
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


@part(inline=True)
def _keep_tip_rates(state, solved, lane):
    """How the tip moves with the commands: every joint turns what lies beyond it about its contact."""
    rates, poses, contacts, responses = state.tip_rates, solved.poses, solved.contacts, solved.responses
    tip, m = poses.shape[1] - 1, rates.shape[2]
    for j in range(m):
        rates[lane, 0, j] = rates[lane, 1, j] = 0.0
        for i in range(tip):
            rates[lane, 0, j] -= (poses[lane, tip, 1] - contacts[lane, i, 1]) * responses[lane, i, j]
            rates[lane, 1, j] += (poses[lane, tip, 0] - contacts[lane, i, 0]) * responses[lane, i, j]
