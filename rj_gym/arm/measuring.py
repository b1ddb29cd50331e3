"""What is measured of arms and goes into observations, and their privileged state, compiled.

Arguments are those of kernels.py; functions over lanes work on first to last - 1.
"""

from __future__ import annotations

import numpy as np

from rj_gym.arm.columns import GRAVITY, TARGET_FRAME
from rj_gym.arm.rotations import rotation_vector, turn_frame
from rj_gym.core.columns import FORCE, STEP, TARGET, TENSIONS, TIP
from rj_gym.core.hardware import (
    TAKEN,
    date_picture,
    measure_tendons,
    observe_instruments,
    picture_slot,
    remember,
    sensed,
    show_picture,
    tendon_truth,
    within_bounds,
)
from rollingjoint.compiled import part, singles_at


@part(inline=True)
def measure(rules, course, state, hardware, first, last):
    """What is measured at the end of a step, and the privileged state."""
    readings, R, at = state.readings, np.empty((3, 3)), np.empty(3)
    for lane in range(first, last):
        measure_tendons(rules, hardware, readings, lane)
        if rules.hardware.late:
            date_picture(rules, hardware, readings, lane)
            _keep_picture(state, hardware, lane)
        if hardware.errors.shape[1] > 0:
            _see(rules, course, state, hardware, lane, at, R)
            for axis in range(3):
                hardware.errors[lane, axis] = readings[lane, TARGET + axis] - at[axis]
        remember(hardware, readings, lane)
        if rules.hardware.privileged_low.size > 0:
            _tell_truth(rules, course, state, hardware, lane)


@part(inline=True)
def _keep_picture(state, hardware, lane):
    """Keep the true pose of the tip for pictures that come later, and show the one that comes now."""
    poses, pictures, slot = state.poses, hardware.pictures, picture_slot(hardware, state.readings, lane)
    tip = poses.shape[1] - 1
    for i in range(pictures.shape[2]):
        pictures[lane, slot, i] = poses[lane, tip, i // 4, i % 4]
    show_picture(hardware, lane)


@part(inline=True)
def _see(rules, course, state, hardware, lane, at, R):
    """Fill the measured position [mm] and rotation matrix of the tip."""
    poses, noise, pictures, now = state.poses, course.noise, hardware.pictures, int(state.readings[lane, STEP])
    tip, late = poses.shape[1] - 1, rules.hardware.late
    if late:
        now = hardware.picture[lane, TAKEN]
    for row in range(3):
        at[row] = pictures[lane, pictures.shape[1] - 1, 4 * row + 3] if late else poses[lane, tip, row, 3]
        for column in range(3):
            seen = pictures[lane, pictures.shape[1] - 1, 4 * row + column] if late else poses[lane, tip, row, column]
            R[row, column] = seen
    if noise.shape[1] > 0:
        now = min(now, noise.shape[1] - 1)
        for axis in range(3):
            at[axis] += noise[lane, now, axis]
        if rules.orientation:
            turn_frame(R, noise[lane, now, 3], noise[lane, now, 4], noise[lane, now, 5])


@part(inline=True)
def _tell_truth(rules, course, state, hardware, lane):
    """The privileged state; the order is that of observation.arm_privileged_entries."""
    readings, poses, place = state.readings, state.poses, rules.hardware.privileged_at
    tip, own = poses.shape[1] - 1, TENSIONS + 2 * state.actions.shape[2]
    for axis in range(3):
        readings[lane, place + axis] = readings[lane, TIP + axis] / rules.length
        for column in range(2):
            readings[lane, place + 3 + 3 * column + axis] = poses[lane, tip, axis, column]
        error = readings[lane, TARGET + axis] - readings[lane, TIP + axis]
        readings[lane, place + 9 + axis] = error / rules.error_scale
        readings[lane, place + 12 + axis] = readings[lane, own + GRAVITY + axis]
    readings[lane, place + 15] = _payload(readings, lane, own) / rules.payload_scale
    place += 16
    for i in range(state.angles.shape[1]):
        readings[lane, place + i] = state.angles[lane, i]
    tendon_truth(rules, hardware, course, readings, lane, place + state.angles.shape[1])
    within_bounds(rules, readings, lane)


@part(inline=True)
def _payload(readings, lane, own):
    """What hangs from the tip [N]."""
    payload = 0.0
    for axis in range(3):
        payload += readings[lane, own + GRAVITY + axis] * readings[lane, FORCE + axis]
    return payload


@part(inline=True)
def observe_all(rules, course, state, hardware, address, first, last):
    """The observations at an address, within their bounds, in the order of observation.arm_observation_entries."""
    readings, m = state.readings, state.actions.shape[2]
    own = TENSIONS + 2 * m
    observation = singles_at(address, (readings.shape[0], rules.low.size))
    R, at = np.empty((3, 3)), np.empty(3)
    for lane in range(first, last):
        entry = 0
        if rules.observe_tip:
            _see(rules, course, state, hardware, lane, at, R)
            for axis in range(3):
                observation[lane, axis] = at[axis] / rules.length
            entry = _write_columns(R, observation, lane, 3) if rules.orientation else 3
        entry = _observe_tendons(rules, readings, hardware, observation, lane, entry, m)
        if rules.observe_target:
            entry = _observe_target(rules, readings, observation, lane, entry, own, at, R)
        if rules.observe_load:
            for axis in range(3):
                observation[lane, entry + axis] = readings[lane, own + GRAVITY + axis]
            observation[lane, entry + 3] = _payload(readings, lane, own) / rules.payload_scale
            entry += 4
        if rules.hardware.active:
            observe_instruments(rules, hardware, readings, observation, lane, entry)
        for place in range(rules.low.size):
            observation[lane, place] = min(max(observation[lane, place], rules.low[place]), rules.high[place])


@part(inline=True)
def _observe_tendons(rules, readings, hardware, observation, lane, entry, m):
    """Fill commands and tensions from this entry on, measured ones where they are; returns the entry after them."""
    for j in range(m):
        command, tension = sensed(rules, hardware, readings, lane, j)
        observation[lane, entry + j] = (command - rules.neutral_lengths[j]) / rules.command_scale
        if rules.observe_tensions:
            observation[lane, entry + m + j] = tension / rules.highest_tension
    return entry + (2 * m if rules.observe_tensions else m)


@part(inline=True)
def _observe_target(rules, readings, observation, lane, entry, own, at, R):
    """Fill the target and, where the tip is measured, the errors; returns the entry after them."""
    for axis in range(3):
        observation[lane, entry + axis] = readings[lane, TARGET + axis] / rules.length
    entry += 3
    aim, E = np.empty((3, 3)), np.empty((3, 3))
    if rules.orientation:
        for i in range(9):
            aim[i // 3, i % 3] = readings[lane, own + TARGET_FRAME + i]
        entry = _write_columns(aim, observation, lane, entry)
    if not rules.observe_tip:
        return entry
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
    return entry


@part(inline=True)
def _write_columns(R, observation, lane, entry):
    """Write the first two columns of a rotation matrix; returns the entry after them."""
    for column in range(2):
        for row in range(3):
            observation[lane, entry + 3 * column + row] = R[row, column]
    return entry + 6
