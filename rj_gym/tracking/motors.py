"""Motors in a step of the tracking tasks, compiled: how they move, and where limits of tension stop them.

Arguments are as in kernels.py; the formulas of play, sheaths and limits are in rollingjoint/transmission.

Where limits act at motors, a pull of a step ends in one of two ways. Its tendon moves, up to the tension
`pull_limit` behind the sheath, which the solver takes as the upper limit of that tendon; or its tendon stays,
since that would be a higher tension already, and the motor stops in its play or where it is. Which of them it is
follows from the equilibrium of all tendons: the solver starts from a guess, and `revise_pulls` has it solve anew where
that was wrong. All other motors hold any tension.
"""

from __future__ import annotations

import math

from rj_gym.core.columns import STEP, TENSIONS
from rj_gym.tracking.arrays import (
    ASKED,
    BOUND,
    GOAL,
    IN_PLAY,
    LIMIT,
    MOTOR,
    MOVES,
    NEXT_GOAL,
    NEXT_MOTOR,
    STAYS,
    STOP,
)
from rollingjoint.chain.status import Status
from rollingjoint.compiled import motor_yield, paid_out, part, play_step, pull_end, pull_limit, unstretched_length

AT_LIMIT = int(Status.AT_LIMIT)  # the last status of a usable equilibrium


@part(inline=True)
def move_motors(rules, hardware, state, offsets, inputs, lane):
    """Where a world has motors: move them by the actions that are due; fill commands [mm] and highest tensions [N]."""
    readings, motors, half, past = state.readings, hardware.motors, hardware.half_play, hardware.past
    commands = inputs.commands
    m, times, now = commands.shape[1], hardware.past.shape[1], int(state.readings[lane, STEP])
    limit, dead_band = rules.hardware.rate_limit, rules.hardware.dead_band
    for j in range(m):
        p = readings[lane, TENSIONS + m + j]
        if now > 0:
            past[lane, (now - 1) % times, j] = state.actions[lane, 0, j]
            due = past[lane, (now - 1 - rules.hardware.action_delay + times) % times, j]
            goal = motors[lane, GOAL, j] - rules.action_scale * due
            q = motors[lane, MOTOR, j]
            way = goal - q if dead_band <= 0.0 else play_step(q, goal, dead_band) - q
            q += min(max(way, -limit), limit)
            motors[lane, NEXT_MOTOR, j], motors[lane, NEXT_GOAL, j] = q, goal
            p = play_step(p, q, half[lane, j])
        motors[lane, ASKED, j] = p
        commands[lane, j] = p + offsets[lane, j]
    if hardware.limits.shape[0] > 0:
        _bound_tensions(rules, hardware, readings, offsets, inputs, lane)


@part(inline=True)
def _bound_tensions(rules, hardware, readings, offsets, inputs, lane):
    """Fill the highest tensions; of motors with limits, by a guess of how pulls end."""
    motors, limits, m = hardware.motors, hardware.limits, inputs.commands.shape[1]
    for j in range(m):
        if rules.hardware.limits_pulls:
            limits[lane, BOUND, j], limits[lane, STOP, j] = math.inf, MOVES
            if readings[lane, STEP] > 0.0 and _pulls(hardware, readings, lane, j):
                bound = _bound(hardware, lane, j)
                if readings[lane, TENSIONS + j] <= bound:
                    limits[lane, BOUND, j] = bound
                else:
                    motors[lane, ASKED, j] = readings[lane, TENSIONS + m + j]
                    inputs.commands[lane, j] = motors[lane, ASKED, j] + offsets[lane, j]
        inputs.highest[lane, j] = limits[lane, BOUND, j]


@part(inline=True)
def _pulls(hardware, readings, lane, j):
    """Whether a motor would pull its tendon in, beyond the play, in this step."""
    p, q = readings[lane, TENSIONS + hardware.motors.shape[2] + j], hardware.motors[lane, NEXT_MOTOR, j]
    return q < hardware.motors[lane, MOTOR, j] and q + hardware.half_play[lane, j] < p


@part(inline=True)
def _bound(hardware, lane, j):
    """The tension behind the sheath at which a motor that pulls stops [N]."""
    return pull_limit(hardware.limits[lane, LIMIT, j], hardware.sheath[lane, j], hardware.half_play[lane, j])


@part(inline=True)
def revise_pulls(course, hardware, readings, inputs, solved, lane):
    """Whether pulls of a lane end in another way than its equilibrium was solved for; inputs are changed then."""
    if hardware.limits.shape[0] == 0 or solved.status[lane] > AT_LIMIT or readings[lane, STEP] == 0.0:
        return False
    motors, limits, offsets, m = hardware.motors, hardware.limits, course.actuator_offsets, solved.tensions.shape[1]
    wrong = False
    for j in range(m):
        if not _pulls(hardware, readings, lane, j):
            continue
        before, tension, bound = readings[lane, TENSIONS + m + j], solved.tensions[lane, j], _bound(hardware, lane, j)
        asked = motors[lane, ASKED, j]
        if limits[lane, BOUND, j] == math.inf:
            if tension < bound:
                limits[lane, BOUND, j], asked = bound, motors[lane, NEXT_MOTOR, j] + hardware.half_play[lane, j]
        elif tension >= bound:
            free = unstretched_length(solved.lengths[lane, j], tension, course.stiffnesses[lane, j])
            if paid_out(free - offsets[lane, j], before):
                limits[lane, BOUND, j], asked = math.inf, before
        if asked != motors[lane, ASKED, j]:
            motors[lane, ASKED, j], wrong = asked, True
            inputs.commands[lane, j], inputs.highest[lane, j] = asked + offsets[lane, j], limits[lane, BOUND, j]
    return wrong


@part(inline=True)
def settle_motors(rules, hardware, readings, lane):
    """End the motors' step. Where a tendon gives way at a limit, the motor moves along."""
    motors, m, begins = hardware.motors, hardware.motors.shape[2], readings[lane, STEP] == 0.0
    stops = rules.hardware.limits_pulls and not begins
    for j in range(m):
        if stops:
            _stop_motor(hardware, readings, lane, j)
        p = readings[lane, TENSIONS + m + j]
        shift = p - motors[lane, ASKED, j]
        q, goal = motor_yield(motors[lane, NEXT_MOTOR, j], motors[lane, NEXT_GOAL, j], shift)
        if begins:
            q = goal = p + hardware.starts[lane, j]
        motors[lane, MOTOR, j], motors[lane, GOAL, j] = q, goal


@part(inline=True)
def _stop_motor(hardware, readings, lane, j):
    """Where the tendon of a motor that pulls stays: end the pull where its limit does, in the play or at once."""
    motors, limits = hardware.motors, hardware.limits
    q, goal = motors[lane, MOTOR, j], motors[lane, NEXT_MOTOR, j]
    if goal >= q or limits[lane, BOUND, j] < math.inf:
        return
    half, nu = hardware.half_play[lane, j], hardware.sheath[lane, j]
    tension, limit = readings[lane, TENSIONS + j], limits[lane, LIMIT, j]
    end = pull_end(motors[lane, ASKED, j], q, goal, tension, limit, nu, half)
    if end > goal:
        motors[lane, NEXT_MOTOR, j] = motors[lane, NEXT_GOAL, j] = end
        limits[lane, STOP, j] = STAYS if end == q else IN_PLAY
