"""A step of the tracking tasks, compiled: loads, predicted starts and ends of steps of a range of lanes.

A step is `step`, and where it leaves lanes to the solver for all cases, that and `finish`; each works on lanes first to
last - 1, and lanes do not see each other. Chains in the plane and arms in space differ in the shapes of arrays, in
`Rules.dimension`, and in what is measured of them (measuring.py).
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from rj_gym.core.columns import ANGLE, ERROR, FORCE, STEP, TARGET, TARGET_FRAME, TENSIONS, TIP, TIP_FRAME
from rj_gym.core.episodes import Observation
from rj_gym.tracking.formulas import REFUSED, finite, pull_tendons, reward_terms, rotation_vector, settle_tendons
from rj_gym.tracking.hardware import Hardware, HardwareRules
from rj_gym.tracking.measuring import measure, observe_lanes
from rollingjoint.compiled import (
    PENDING,
    Floats,
    Integers,
    Pinned,
    PinnedBatch,
    PinnedHinges,
    Singles,
    call_range,
    kernel,
    machine_code,
    part,
    singles_at,
    unpin,
)

PREDICTABLE = 0.2  # rad: how far a joint may turn in a predicted start


class Rules(NamedTuple):
    """Numbers that all lanes share; scales are those of the settings."""

    dimension: int  # coordinates of a position, 2 or 3
    action_scale: float  # mm
    length: float  # of the mechanism, mm
    command_scale: float  # mm
    error_scale: float  # mm
    angle_scale: float  # rad
    highest_tension: float  # N
    force_scale: float  # N
    effort: float
    smoothness: float
    failure_penalty: float
    precision: float
    orientation: bool  # whether targets have a frame
    observe_tensions: bool
    observe_target: bool  # and the errors
    observe_load: bool
    neutral_lengths: Annotated[Floats, "m"]  # mm
    low: Annotated[Singles, "entries"]  # of the observation
    high: Annotated[Singles, "entries"]
    first_seen: int  # of the moving links, those before it are not observed
    force_column: int  # of a load table, the first of the force
    hardware: HardwareRules


class Course(NamedTuple):
    """What is fixed when an episode begins; series have one entry where nothing changes over time."""

    targets: Annotated[Floats, "B", "1 or T + 1 targets", "d or d + 9"]  # mm; rotation matrices with `orientation`
    forces: Annotated[Floats, "B", "1 or T + 1 forces", "d"]  # N
    stiffnesses: Annotated[Floats, "B", "m"]  # N/mm
    actuator_offsets: Annotated[Floats, "B", "m"]  # mm
    noise: Annotated[Floats, "B", "0, 1 or T + 1", "measured links", "errors"]  # mm, rad


class RunningEpisodes(NamedTuple):
    """Where running episodes are. A pose has 3 numbers in the plane (mm, mm, rad), 4 x 4 in space (row by row, mm)."""

    angles: Annotated[Floats, "B", "J"]  # joint angles of the last usable equilibrium, rad
    responses: Annotated[Floats, "B or 0 responses", "J", "m"]  # its d angle / d command, rad/mm
    poses: Annotated[Floats, "B", "n", "pose numbers"]  # its poses
    actions: Annotated[Floats, "B", 2, "m"]  # the last action and the one before, within [-1, 1]
    readings: Annotated[Floats, "B", "columns"]  # see rj_gym/core/columns.py
    tip_rates: Annotated[Floats, "0 or B", 2, "m"]  # d tip / d command, where it is asked for


class Inputs(NamedTuple):
    """What goes into a step and into its solve."""

    actions: Annotated[Floats, "B", "m"]  # not yet clipped
    starts: Annotated[Floats, "B", "J"]  # joint angles from which the solver starts, rad
    commands: Annotated[Floats, "B", "m"]  # tendon lengths, mm
    loads: Annotated[Floats, "B", "rows", "load columns"]  # the force that changes in the last row


class Solved(NamedTuple):
    """The parts of the solver's results that the task reads."""

    joint_angles: Annotated[Floats, "B", "J"]
    poses: Annotated[Floats, "B", "n", "pose numbers"]
    tensions: Annotated[Floats, "B", "m"]
    lengths: Annotated[Floats, "B", "m"]
    responses: Annotated[Floats, "B or 0 responses", "J", "m"]
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
    solver: int  # address of the solver's machine code (rollingjoint.compiled.call_range); 0: every lane is left to
    problem: int  # `finish`; and of what it works on


class StepKernels:
    """The kernels below, for the arrays of an episode buffer; addresses are those of observations (B, entries).

    Raises:
        InvalidInput: arrays that are not as declared.
    """

    def __init__(self, arrays: TaskArrays) -> None:
        self._pinned = Pinned(arrays)
        self._pins = self._pinned.address_for(TaskArrays)
        self._step, self._finish, self._observe = _machine_code()

    def step(self, address: int, first: int, last: int) -> int:
        """One step of lanes; how many of them are left to the solver for all cases, or REFUSED: see `step`."""
        left: int = self._step(self._pins, address, first, last)
        return left

    def finish(self, address: int, first: int, last: int) -> None:
        """End the step of lanes of which some were left to the solver for all cases."""
        self._finish(self._pins, address, first, last)

    def observe(self, observations: Observation) -> None:
        """Fill the observations of all lanes, (B, entries), anew."""
        self._observe(self._pins, observations.ctypes.data)


@kernel(nogil=True, short_loops=True, title="the environments")
def step(pins, observation, first, last):
    """One step of lanes, into the observations (B, entries) at an address, float32.

    Returns how many lanes the solver has left to PinnedRange.solve_the_rest; if any, `finish` remains to be done after
    that. REFUSED, and nothing done, where an action is not finite.
    """
    rules, course, state, hardware, inputs, solved, solver, problem = unpin(pins, TaskArrays)
    if not finite(inputs.actions, first, last):
        return REFUSED
    _prepare(rules, course, state, hardware, inputs, first, last)
    left = _solve(rules, solver, problem, first, last)
    if left < 0:  # no memory: the solver for all cases has what it needs, or raises
        left = last - first
        for lane in range(first, last):
            solved.status[lane] = PENDING
    if left == 0:
        _finish(rules, course, state, hardware, solved, observation, first, last)
    return left


@kernel(nogil=True, short_loops=True, title="the environments")
def finish(pins, observation, first, last):
    """End a step after the solve: state, readings and the observations at an address."""
    rules, course, state, hardware, _, solved, _, _ = unpin(pins, TaskArrays)
    _finish(rules, course, state, hardware, solved, observation, first, last)


@kernel(short_loops=True, title="the environments")
def observe(pins, observation):
    """Fill the observations at an address anew."""
    rules, course, state, hardware, _, _, _, _ = unpin(pins, TaskArrays)
    vectors = singles_at(observation, (state.readings.shape[0], rules.low.size))
    observe_lanes(rules, course, state, hardware, vectors, 0, vectors.shape[0])


def _machine_code():
    """The machine code of step, finish and observe."""
    each = (step, (int, int, int, int)), (finish, (int, int, int, int)), (observe, (int, int))
    return tuple(machine_code(kernel, *kinds) for kernel, kinds in each)


@part(inline=True)
def _prepare(rules, course, state, hardware, inputs, first, last):
    """Begin a step: tendons are pulled, the load moves on; fill commands, starts and loads."""
    forces, readings, loads = course.forces, state.readings, inputs.loads
    times, row = forces.shape[1], loads.shape[1] - 1
    for lane in range(first, last):
        pull_tendons(rules, course, state, hardware, inputs, lane)
        _predict(state, inputs, course, lane)
        now = min(int(readings[lane, STEP]), times - 1)
        for axis in range(rules.dimension):
            loads[lane, row, rules.force_column + axis] = readings[lane, FORCE + axis] = forces[lane, now, axis]


@part(inline=True)
def _predict(state, inputs, course, lane):
    """Start the solve on the tangent of the last equilibrium: that saves the first of about four Newton steps.

    A prediction that goes far is not to be trusted: the solve then starts from the last equilibrium itself, and so it
    does where the solver gives no responses.
    """
    angles, responses, starts = state.angles, state.responses, inputs.starts
    n_joints, m = angles.shape[1], responses.shape[2]
    farthest = math.inf
    if responses.shape[0] > 0:
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
def _solve(rules, solver, problem, first, last):
    """Solve lanes side by side; how many are left, all of them without a solver, -1 where it had no memory."""
    if solver == 0:
        return last - first
    if rules.dimension == 2:
        return call_range(solver, problem, PinnedBatch, first, last)
    return call_range(solver, problem, PinnedHinges, first, last)


@part(inline=True)
def _finish(rules, course, state, hardware, solved, observation, first, last):
    """End a step: state, readings, the observations."""
    vectors = singles_at(observation, (state.readings.shape[0], rules.low.size))
    _settle(rules, course, state, hardware, solved, first, last)
    _measure_error(rules, course, state, first, last)
    reward_terms(rules, state, first, last)
    if rules.hardware.active:
        measure(rules, course, state, hardware, first, last)
    observe_lanes(rules, course, state, hardware, vectors, first, last)


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
        if responses.shape[0] > 0:
            for i in range(n_joints):
                for j in range(m):
                    responses[lane, i, j] = solved.responses[lane, i, j]
        for k in range(n_joints + 1):
            for number in range(poses.shape[2]):
                poses[lane, k, number] = new_poses[lane, k, number]


@part(inline=True)
def _measure_error(rules, course, state, first, last):
    """Tips, targets, the distances between them and, with orientation, the angles."""
    readings, poses, targets = state.readings, state.poses, course.targets
    tip, times = poses.shape[1] - 1, targets.shape[1]
    for lane in range(first, last):
        now, square = min(int(readings[lane, STEP]), times - 1), 0.0
        for axis in range(rules.dimension):
            readings[lane, TIP + axis] = poses[lane, tip, axis if rules.dimension == 2 else 4 * axis + 3]
            readings[lane, TARGET + axis] = targets[lane, now, axis]
            square += (readings[lane, TIP + axis] - readings[lane, TARGET + axis]) ** 2
        readings[lane, ERROR] = math.sqrt(square)
        if rules.orientation:
            _measure_angle(course, state, lane, now)


@part
def _measure_angle(course, state, lane, now):
    """Frames of the tip and of the target, and the angle between them."""
    readings, poses, targets = state.readings, state.poses, course.targets
    tip, own = poses.shape[1] - 1, TENSIONS + 2 * state.actions.shape[2]
    for i in range(9):
        readings[lane, own + TIP_FRAME + i] = poses[lane, tip, 4 * (i // 3) + i % 3]
        readings[lane, own + TARGET_FRAME + i] = targets[lane, now, 3 + i]
    E = np.empty((3, 3))
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
def _keep_tip_rates(state, solved, lane):
    """How the tip moves with the commands: every joint turns what lies beyond it about its contact."""
    rates, poses, contacts, responses = state.tip_rates, solved.poses, solved.contacts, solved.responses
    tip, m = poses.shape[1] - 1, rates.shape[2]
    for j in range(m):
        rates[lane, 0, j] = rates[lane, 1, j] = 0.0
        for i in range(tip):
            rates[lane, 0, j] -= (poses[lane, tip, 1] - contacts[lane, i, 1]) * responses[lane, i, j]
            rates[lane, 1, j] += (poses[lane, tip, 0] - contacts[lane, i, 0]) * responses[lane, i, j]
