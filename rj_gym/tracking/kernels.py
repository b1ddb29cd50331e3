"""A step of the tracking tasks, compiled: motors, loads, predicted starts and ends of steps of a range of lanes.

A step is `step`, and where it leaves lanes to the general solver, that and `finish`; each works on lanes first to
last - 1, and lanes do not see each other. Chains in the plane and arms in space differ in the shapes of arrays
(arrays.py), in `Rules.dimension`, and in their measurements (measuring.py). A motor's position q and the tendon's
command p (readings, after TENSIONS) are different things: the agent moves and reads q. The formulas of play and
friction between them are in rollingjoint/transmission; motors.py moves motors.
"""

from __future__ import annotations

import math

import numpy as np

from rj_gym.core.columns import (
    ANGLE,
    EFFORT,
    ERROR,
    FAILURE,
    FORCE,
    ORIENTATION,
    REWARD,
    SMOOTHNESS,
    STATUS,
    STEP,
    STICKING,
    TARGET,
    TARGET_FRAME,
    TENSIONS,
    TIP,
    TIP_FRAME,
    TRACKING,
    WORK,
)
from rj_gym.core.episodes import Observation
from rj_gym.tracking.arrays import TaskArrays
from rj_gym.tracking.measuring import measure, observe_lanes, rotation_vector
from rj_gym.tracking.motors import AT_LIMIT, move_motors, revise_pulls, settle_motors
from rollingjoint.compiled import (
    PENDING,
    Pinned,
    PinnedBatch,
    PinnedContacts,
    PinnedHinges,
    borrow,
    call_range,
    kernel,
    machine_code,
    part,
    singles_at,
    unpin,
    unstretched_length,
)

REFUSED = -1  # returned by a step instead of a number of lanes
REVISIONS = 8  # of a lane's pulls in a step, at most: one or two in almost all
PREDICTABLE = 0.2  # rad: how far a joint may turn in a predicted start


class StepKernels:
    """The kernels below, for the arrays of an episode buffer; addresses point to observations (B, entries).

    Raises:
        InvalidInput: arrays that are not as declared.
    """

    def __init__(self, arrays: TaskArrays) -> None:
        self._pinned = Pinned(arrays)
        self.pins = self._pinned.address_for(TaskArrays)
        self._step = machine_code(step, int, int, int, int)
        self._finish = machine_code(finish, int, int, int, int)
        self._revise = machine_code(revise, int, int, int)
        self._observe = machine_code(observe, int, int)

    def step(self, address: int, first: int, last: int) -> int:
        """One step of lanes; how many of them are left to the general solver, or REFUSED: see `step`."""
        remaining: int = self._step(self.pins, address, first, last)
        return remaining

    def finish(self, address: int, first: int, last: int) -> None:
        """End the step of lanes of which some were left to the general solver."""
        self._finish(self.pins, address, first, last)

    def revise(self, first: int, last: int) -> int:
        """How many lanes have to be solved anew, PENDING, since pulls end in another way: see motors.py."""
        wrong: int = self._revise(self.pins, first, last)
        return wrong

    def observe(self, observations: Observation) -> None:
        """Fill the observations of all lanes, (B, entries), anew."""
        self._observe(self.pins, observations.ctypes.data)


@kernel(nogil=True, short_loops=True, title="the environments")
def step(pins, observation, first, last):
    """One step of lanes, into the observations (B, entries) at an address, float32.

    Returns how many lanes the solver has left to LaneSolver.solve_the_rest; if any, `finish` remains to be done after
    that. REFUSED, and no change, where an action is not finite.
    """
    rules, course, state, hardware, inputs, solved, solver, problem = unpin(pins, TaskArrays)
    if not _finite(inputs.actions, first, last):
        return REFUSED
    _prepare(rules, course, state, hardware, inputs, first, last)
    remaining = _solve(rules, solver, problem, first, last)
    if remaining < 0:  # no memory: the general solver has enough, or raises
        remaining = last - first
        for lane in range(first, last):
            solved.status[lane] = PENDING
    if remaining == 0 and rules.hardware.limits_pulls:
        for lane in range(first, last):
            remaining += _solve_pulls(rules, course, state, hardware, inputs, solved, solver, problem, lane)
    if remaining == 0:
        _finish(rules, course, state, hardware, solved, observation, first, last)
    return remaining


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


@part(inline=True)
def _finite(values, first, last):
    """Whether no value of these lanes is NaN or infinite."""
    fine = True
    for lane in range(first, last):
        for j in range(values.shape[1]):
            fine &= math.isfinite(values[lane, j])
    return fine


@part(inline=True)
def _prepare(rules, course, state, hardware, inputs, first, last):
    """Begin a step: tendons are pulled, the load moves on; fill commands, starts and loads."""
    forces, readings, loads = course.forces, state.readings, inputs.loads
    times, row = forces.shape[1], loads.shape[1] - 1
    for lane in range(first, last):
        _pull_tendons(rules, course, state, hardware, inputs, lane)
        _predict(state, inputs, course, lane)
        now = min(int(readings[lane, STEP]), times - 1)
        for axis in range(rules.dimension):
            loads[lane, row, rules.force_column + axis] = readings[lane, FORCE + axis] = forces[lane, now, axis]


@part(inline=True)
def _pull_tendons(rules, course, state, hardware, inputs, lane):
    """Count the step, and turn its action into commands: at 1 it pulls a tendon in by action_scale [mm]."""
    offsets, readings, taken = course.actuator_offsets, state.readings, state.actions
    actions, commands = inputs.actions, inputs.commands
    m = actions.shape[1]
    readings[lane, STEP] += 1.0
    for j in range(m):
        taken[lane, 1, j] = taken[lane, 0, j]
        taken[lane, 0, j] = min(max(actions[lane, j], -1.0), 1.0)
    if rules.hardware.active:
        move_motors(rules, hardware, state, offsets, inputs, lane)
        return
    for j in range(m):
        believed = readings[lane, TENSIONS + m + j] - rules.action_scale * taken[lane, 0, j]
        commands[lane, j] = believed + offsets[lane, j]


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
    if rules.slips:
        return call_range(solver, problem, PinnedContacts, first, last)
    return call_range(solver, problem, PinnedHinges, first, last)


@part(inline=True)
def _solve_pulls(rules, course, state, hardware, inputs, solved, solver, problem, lane):
    """Solve a lane anew while its pulls end in another way; 1 where it is left, PENDING, else 0."""
    for _ in range(REVISIONS):
        if not revise_pulls(course, hardware, state.readings, inputs, solved, lane):
            return 0
        if _solve(rules, solver, problem, lane, lane + 1) != 0:
            solved.status[lane] = PENDING
            return 1
    return 0


@kernel(nogil=True, short_loops=True, title="the environments")
def revise(pins, first, last):
    """Change the inputs of lanes with pulls that end in another way, which are PENDING then; returns their number."""
    _, course, state, hardware, inputs, solved, _, _ = unpin(pins, TaskArrays)
    wrong = 0
    for lane in range(first, last):
        if revise_pulls(course, hardware, state.readings, inputs, solved, lane):
            solved.status[lane] = PENDING
            wrong += 1
    return wrong


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
    numbers = 3 if rules.dimension == 2 else 12  # the last row of a pose in space is constant
    for lane in range(first, last):
        if not _settle_tendons(rules, course, state, hardware, solved, lane):
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
            for number in range(numbers):
                poses[lane, k, number] = new_poses[lane, k, number]


@part(inline=True)
def _settle_tendons(rules, course, state, hardware, solved, lane):
    """Take over status, tensions and commands of a lane; returns whether its equilibrium is a usable one.

    Where a tension is at a limit the motor holds or gives way and its command follows, l_cmd = l - tension / k, so
    that commands never wind up; elsewhere that is the command itself.
    """
    readings, tensions, lengths = state.readings, solved.tensions, solved.lengths
    stiffnesses, offsets = course.stiffnesses, course.actuator_offsets
    m = tensions.shape[1]
    readings[lane, STATUS] = solved.status[lane]
    valid = solved.status[lane] <= AT_LIMIT
    if valid:
        for j in range(m):
            unstretched = unstretched_length(lengths[lane, j], tensions[lane, j], stiffnesses[lane, j])
            readings[lane, TENSIONS + j] = tensions[lane, j]
            readings[lane, TENSIONS + m + j] = unstretched - offsets[lane, j]
        if rules.hardware.active:
            settle_motors(rules, hardware, readings, lane)
    return valid


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


@part(inline=True)
def _measure_angle(course, state, lane, now):
    """Frames of the tip and of the target, and the angle between them."""
    readings, poses, targets = state.readings, state.poses, course.targets
    tip, first_own = poses.shape[1] - 1, TENSIONS + 2 * state.actions.shape[2]
    for i in range(9):
        readings[lane, first_own + TIP_FRAME + i] = poses[lane, tip, 4 * (i // 3) + i % 3]
        readings[lane, first_own + TARGET_FRAME + i] = targets[lane, now, 3 + i]
    E = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            E[i, j] = _row_product(readings, lane, first_own + TARGET_FRAME + 3 * i, first_own + TIP_FRAME + 3 * j)
    _, _, _, readings[lane, first_own + ANGLE] = rotation_vector(E)


@part(inline=True)
def _row_product(readings, lane, first, second):
    product = 0.0
    for k in range(3):
        product += readings[lane, first + k] * readings[lane, second + k]
    return product


@part(inline=True)
def _keep_tip_rates(state, solved, lane):
    """How the tip moves with the commands: every joint turns the links beyond it about its contact."""
    rates, poses, contacts, responses = state.tip_rates, solved.poses, solved.contacts, solved.responses
    tip, m = poses.shape[1] - 1, rates.shape[2]
    for j in range(m):
        rates[lane, 0, j] = rates[lane, 1, j] = 0.0
        for i in range(tip):
            rates[lane, 0, j] -= (poses[lane, tip, 1] - contacts[lane, i, 1]) * responses[lane, i, j]
            rates[lane, 1, j] += (poses[lane, tip, 0] - contacts[lane, i, 0]) * responses[lane, i, j]


@part(inline=True)
def reward_terms(rules, state, first, last):
    """The terms of the reward, and their sum."""
    readings, actions = state.readings, state.actions
    m = actions.shape[2]
    first_own = TENSIONS + 2 * m
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
            readings[lane, first_own + ORIENTATION] = -readings[lane, first_own + ANGLE] / rules.angle_scale
            readings[lane, REWARD] += readings[lane, first_own + ORIENTATION]


@kernel(short_loops=True, title="the environments")
def all_finite(values):
    """Whether no value (B, m) is NaN or infinite."""
    return _finite(borrow(values), 0, len(values))


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


def friction_columns(n_joints: int, n_tendons: int) -> int:
    """Number of columns of readings about friction."""
    return STICKING + 2 * n_joints * n_tendons
