"""Motors and sensors between the agent and the tendons, compiled: play, friction, noise, late pictures, past readings.

A motor's position q and the tendon's command p (readings, after TENSIONS) are different things here: the agent moves
and reads q. What lies between them is rollingjoint/transmission. Every function works on one lane.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from rj_gym.core.columns import STEP, TENSIONS
from rollingjoint.compiled import (
    Floats,
    Integers,
    Singles,
    motor_yield,
    part,
    play_step,
    sheath_direction,
    sheath_ratio,
)

# Rows of Hardware.motors [mm]: where motors are, where they are going; both after a step that stands; the position that
# the step asks of the tendon.
MOTOR, GOAL, NEXT_MOTOR, NEXT_GOAL, ASKED, MOTOR_ROWS = range(6)
POSITION, TENSION, SENSED = range(3)  # rows of Hardware.measured [mm, N]
TAKEN, NEW = range(2)  # columns of Hardware.picture: the step it is from, and whether it came in this step

LAG_TENSION = 2.0  # N: unit of past tensions
AGE = 10.0  # steps: unit of the age of a picture


class HardwareRules(NamedTuple):
    """Numbers that all lanes share; settings are SensingConfig's and ActuationConfig's."""

    active: bool
    rate_limit: float  # mm
    action_delay: int  # steps
    encoder_resolution: float  # mm
    tension_resolution: float  # N
    late: bool
    period: int  # steps
    picture_delay: int  # steps
    lags: Annotated[Integers, "lags"]  # steps
    stiffnesses: Annotated[Floats, "m"]  # of the nominal tendons, N/mm
    friction: bool  # whether tendons can rub in their holes
    steps: int  # of an episode
    privileged_at: int  # first column of readings
    privileged_low: Annotated[Singles, "K"]
    privileged_high: Annotated[Singles, "K"]


class Hardware(NamedTuple):
    """Motors and sensors of lanes; none where they are not active. Up to `phase`: what is fixed in an episode."""

    half_play: Annotated[Floats, "lanes", "m"]  # mm
    sheath: Annotated[Floats, "lanes", "m"]
    starts: Annotated[Floats, "lanes", "m"]  # q - p at the start, mm
    friction: Annotated[Floats, "lanes", "m"]  # coefficients, in the holes of links
    encoder_noise: Annotated[Floats, "lanes", "0 or T + 1 positions", "m"]  # mm
    tension_noise: Annotated[Floats, "lanes", "0 or T + 1 tensions", "m"]  # N
    phase: Annotated[Integers, "lanes"]  # of the pictures, steps
    motors: Annotated[Floats, "lanes", 5, "m"]  # MOTOR_ROWS
    measured: Annotated[Floats, "lanes", 2, "m"]  # SENSED
    pictures: Annotated[Floats, "lanes", "depth", "pose"]  # true poses: a ring over steps, and the one that is seen
    picture: Annotated[Integers, "lanes", 2]
    errors: Annotated[Floats, "lanes", "0 or d"]  # target minus measured tip, mm
    past: Annotated[Floats, "lanes", "times", "width"]  # action, position, tension (m each), error: a ring over steps


@part(inline=True)
def move_motors(rules, hardware, state, offsets, commands, lane):
    """Move motors by the actions that are due, and tendons with them: fill commands [mm]."""
    readings, motors, half, past = state.readings, hardware.motors, hardware.half_play, hardware.past
    m, times, now = commands.shape[1], hardware.past.shape[1], int(state.readings[lane, STEP])
    limit = rules.hardware.rate_limit
    for j in range(m):
        p = readings[lane, TENSIONS + m + j]
        if now > 0:
            past[lane, (now - 1) % times, j] = state.actions[lane, 0, j]
            due = past[lane, (now - 1 - rules.hardware.action_delay + times) % times, j]
            goal = motors[lane, GOAL, j] - rules.action_scale * due
            q = motors[lane, MOTOR, j]
            q += min(max(goal - q, -limit), limit)
            motors[lane, NEXT_MOTOR, j], motors[lane, NEXT_GOAL, j] = q, goal
            p = play_step(p, q, half[lane, j])
        motors[lane, ASKED, j] = p
        commands[lane, j] = p + offsets[lane, j]


@part(inline=True)
def settle_motors(hardware, readings, lane):
    """End the motors' step. At a tension limit, where the command follows the tendon, its motor moves along."""
    motors, m, begins = hardware.motors, hardware.motors.shape[2], readings[lane, STEP] == 0.0
    for j in range(m):
        p = readings[lane, TENSIONS + m + j]
        shift = p - motors[lane, ASKED, j]
        q, goal = motor_yield(motors[lane, NEXT_MOTOR, j], motors[lane, NEXT_GOAL, j], shift)
        if begins:
            q = goal = p + hardware.starts[lane, j]
        motors[lane, MOTOR, j], motors[lane, GOAL, j] = q, goal


@part(inline=True)
def measure_tendons(rules, hardware, readings, lane):
    """Fill measured motor positions and tensions."""
    motors, measured, now = hardware.motors, hardware.measured, int(readings[lane, STEP])
    m, positions, tensions = motors.shape[2], hardware.encoder_noise, hardware.tension_noise
    for j in range(m):
        p, q, tension = readings[lane, TENSIONS + m + j], motors[lane, MOTOR, j], readings[lane, TENSIONS + j]
        if hardware.sheath[lane, j] > 0.0:
            direction = sheath_direction(p, q, hardware.half_play[lane, j])
            tension *= sheath_ratio(hardware.sheath[lane, j], direction)
        if positions.shape[1] > 0:
            q += positions[lane, min(now, positions.shape[1] - 1), j]
        if tensions.shape[1] > 0:
            tension = max(tension + tensions[lane, min(now, tensions.shape[1] - 1), j], 0.0)
        measured[lane, POSITION, j] = _rounded(q, rules.hardware.encoder_resolution)
        measured[lane, TENSION, j] = _rounded(tension, rules.hardware.tension_resolution)


@part(inline=True)
def sensed(rules, hardware, readings, lane, j):
    """Position [mm] and tension [N] of a tendon as they are observed: measured, or where all is plain the true ones."""
    m = rules.neutral_lengths.size
    if rules.hardware.active:
        return hardware.measured[lane, POSITION, j], hardware.measured[lane, TENSION, j]
    return readings[lane, TENSIONS + m + j], readings[lane, TENSIONS + j]


@part(inline=True)
def _rounded(value, resolution):
    return value if resolution <= 0.0 else resolution * math.floor(value / resolution + 0.5)


@part(inline=True)
def date_picture(rules, hardware, readings, lane):
    """Which step the observed picture is from, and whether it came just now."""
    picture, now = hardware.picture, int(readings[lane, STEP])
    if now == 0:
        picture[lane, TAKEN], picture[lane, NEW] = 0, 1
        return
    picture[lane, NEW] = 0
    if (now + hardware.phase[lane]) % rules.hardware.period == 0:
        taken = max(now - rules.hardware.picture_delay, 0)
        picture[lane, NEW] = 1 if taken > picture[lane, TAKEN] else 0
        picture[lane, TAKEN] = taken


@part(inline=True)
def picture_slot(hardware, readings, lane):
    """Where in the ring a task keeps the true pose of this step."""
    return int(readings[lane, STEP]) % (hardware.pictures.shape[1] - 1)


@part(inline=True)
def show_picture(hardware, lane):
    """Take the picture that comes now out of the ring, as the one that is seen."""
    pictures, shown = hardware.pictures, hardware.pictures.shape[1] - 1
    if hardware.picture[lane, NEW] == 1:
        taken = hardware.picture[lane, TAKEN] % shown
        for i in range(pictures.shape[2]):
            pictures[lane, shown, i] = pictures[lane, taken, i]


@part(inline=True)
def remember(hardware, readings, lane):
    """Put this step's readings into the ring; at the start of an episode, everywhere in it."""
    past, measured, errors, now = hardware.past, hardware.measured, hardware.errors, int(readings[lane, STEP])
    times, m = past.shape[1], measured.shape[2]
    first, last = (0, times) if now == 0 else (now % times, now % times + 1)
    for slot in range(first, last):
        for j in range(m):
            past[lane, slot, j] = 0.0
            past[lane, slot, m + j] = measured[lane, POSITION, j]
            past[lane, slot, 2 * m + j] = measured[lane, TENSION, j]
        for axis in range(errors.shape[1]):
            past[lane, slot, 3 * m + axis] = errors[lane, axis]


@part(inline=True)
def observe_instruments(rules, hardware, readings, observation, lane, entry):
    """Fill the age of the picture and past readings from this entry on."""
    if rules.hardware.late:
        observation[lane, entry] = (readings[lane, STEP] - hardware.picture[lane, TAKEN]) / AGE
        observation[lane, entry + 1] = hardware.picture[lane, NEW]
        entry += 2
    _observe_past(rules, hardware, readings, observation, lane, entry)


@part(inline=True)
def _observe_past(rules, hardware, readings, observation, lane, entry):
    """Fill past readings, lag by lag, from this entry on: actions; positions, tensions and errors then minus now."""
    past, lags, m, now = hardware.past, rules.hardware.lags, hardware.motors.shape[2], int(readings[lane, STEP])
    times, width, per_action = past.shape[1], past.shape[2], 1 / rules.action_scale
    for i in range(lags.size):
        then, slot = (now - lags[i] + times) % times, now % times
        for j in range(m):
            observation[lane, entry + j] = past[lane, then, j]
        for k in range(m, width):
            scale = per_action if k < 2 * m else (1 / LAG_TENSION if k < 3 * m else 1 / rules.error_scale)
            observation[lane, entry + k] = (past[lane, then, k] - past[lane, slot, k]) * scale
        entry += width


@part(inline=True)
def tendon_truth(rules, hardware, course, readings, lane, at):
    """Fill the privileged numbers of every tracking task from this column on; returns the column after them."""
    m, h = hardware.motors.shape[2], rules.hardware
    for j in range(m):
        readings[lane, at + j] = readings[lane, TENSIONS + m + j] - hardware.motors[lane, MOTOR, j]
        readings[lane, at + m + j] = hardware.half_play[lane, j]
        readings[lane, at + 2 * m + j] = hardware.sheath[lane, j]
        readings[lane, at + 3 * m + j] = readings[lane, TENSIONS + j] / rules.highest_tension
        readings[lane, at + 4 * m + j] = course.actuator_offsets[lane, j]
        readings[lane, at + 5 * m + j] = course.stiffnesses[lane, j] / h.stiffnesses[j]
        if h.friction:
            readings[lane, at + 6 * m + j] = hardware.friction[lane, j]
    at += 7 * m if h.friction else 6 * m
    readings[lane, at] = readings[lane, STEP] / h.steps
    return at + 1


@part(inline=True)
def within_bounds(rules, readings, lane):
    """Clip the privileged numbers to their bounds."""
    at, low, high = rules.hardware.privileged_at, rules.hardware.privileged_low, rules.hardware.privileged_high
    for k in range(low.size):
        readings[lane, at + k] = min(max(readings[lane, at + k], np.float64(low[k])), np.float64(high[k]))
