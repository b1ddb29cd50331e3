"""What is measured and goes into observations, and the privileged state, compiled.

Arguments are those of kernels.py; functions over lanes work on first to last - 1. Of a chain in the plane every moving
link can be measured, of an arm in space the tip alone.
"""

from __future__ import annotations

import math

import numpy as np

from rj_gym.core.columns import FORCE, GRAVITY, LINK, STEP, TARGET, TARGET_FRAME, TENSIONS, TIP
from rj_gym.tracking.formulas import rotation_vector, turn_frame
from rj_gym.tracking.hardware import (
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
from rollingjoint.compiled import part

BLOCK = 16  # lanes whose angles are turned together
ROUND = 1.5 * 2.0**52  # added and taken away again, it rounds to a whole number


@part(inline=True)
def measure(rules, course, state, hardware, first, last):
    """What is measured at the end of a step, and the privileged state."""
    readings = state.readings
    for lane in range(first, last):
        measure_tendons(rules, hardware, readings, lane)
        if rules.hardware.late:
            date_picture(rules, hardware, readings, lane)
            _keep_picture(rules, state, hardware, lane)
        if hardware.errors.shape[1] > 0:
            if rules.dimension == 2:
                _measure_link_error(rules, course, state, hardware, lane)
            else:
                _measure_tip_error(rules, course, state, hardware, lane)
        remember(hardware, readings, lane)
        if rules.hardware.privileged_low.size > 0:
            if rules.dimension == 2:
                _tell_chain(rules, course, state, hardware, lane)
            else:
                _tell_arm(rules, course, state, hardware, lane)
            within_bounds(rules, readings, lane)


@part(inline=True)
def _keep_picture(rules, state, hardware, lane):
    """Keep the true poses for pictures that come later, and show the one that comes now."""
    poses, pictures, slot = state.poses, hardware.pictures, picture_slot(hardware, state.readings, lane)
    numbers, link = poses.shape[2], 1 if rules.dimension == 2 else poses.shape[1] - 1
    for i in range(pictures.shape[2]):
        pictures[lane, slot, i] = poses[lane, link + i // numbers, i % numbers]
    show_picture(hardware, lane)


@part(inline=True)
def _measure_link_error(rules, course, state, hardware, lane):
    """Target minus measured place of the last link, of a chain."""
    x, y, _ = _seen_link(rules, course, state, hardware, lane, state.poses.shape[1] - 2)
    hardware.errors[lane, 0] = state.readings[lane, TARGET] - x
    hardware.errors[lane, 1] = state.readings[lane, TARGET + 1] - y


@part
def _measure_tip_error(rules, course, state, hardware, lane):
    """Target minus measured place of the tip, of an arm."""
    at, R = np.empty(3), np.empty((3, 3))
    _see_tip(rules, course, state, hardware, lane, at, R)
    for axis in range(3):
        hardware.errors[lane, axis] = state.readings[lane, TARGET + axis] - at[axis]


@part(inline=True)
def _seen_link(rules, course, state, hardware, lane, k):
    """Measured x, y [mm] and angle [rad] of moving link k, counted from 0."""
    poses, noise, now = state.poses, course.noise, int(state.readings[lane, STEP])
    x, y, angle = poses[lane, k + 1, 0], poses[lane, k + 1, 1], poses[lane, k + 1, 2]
    if rules.hardware.late:
        pictures, now = hardware.pictures, hardware.picture[lane, TAKEN]
        shown = pictures.shape[1] - 1
        x, y, angle = pictures[lane, shown, 3 * k], pictures[lane, shown, 3 * k + 1], pictures[lane, shown, 3 * k + 2]
    if noise.shape[1] > 0:
        now = min(now, noise.shape[1] - 1)
        x, y, angle = x + noise[lane, now, k, 0], y + noise[lane, now, k, 1], angle + noise[lane, now, k, 2]
    return x, y, angle


@part(inline=True)
def _see_tip(rules, course, state, hardware, lane, at, R):
    """Fill the measured position [mm] and rotation matrix of the tip."""
    poses, noise, pictures, now = state.poses, course.noise, hardware.pictures, int(state.readings[lane, STEP])
    tip, late = poses.shape[1] - 1, rules.hardware.late
    if late:
        now = hardware.picture[lane, TAKEN]
    for row in range(3):
        at[row] = pictures[lane, pictures.shape[1] - 1, 4 * row + 3] if late else poses[lane, tip, 4 * row + 3]
        for column in range(3):
            place = 4 * row + column
            R[row, column] = pictures[lane, pictures.shape[1] - 1, place] if late else poses[lane, tip, place]
    if noise.shape[1] > 0:
        now = min(now, noise.shape[1] - 1)
        for axis in range(3):
            at[axis] += noise[lane, now, 0, axis]
        if rules.orientation:
            turn_frame(R, noise[lane, now, 0, 3], noise[lane, now, 0, 4], noise[lane, now, 0, 5])


@part(inline=True)
def _tell_chain(rules, course, state, hardware, lane):
    """The privileged state of a chain; the order is that of PlanarTask.privileged_entries."""
    readings, poses, at = state.readings, state.poses, rules.hardware.privileged_at
    moving, m = poses.shape[1] - 1, state.actions.shape[2]
    for k in range(moving):
        readings[lane, at] = poses[lane, k + 1, 0] / rules.length
        readings[lane, at + 1] = poses[lane, k + 1, 1] / rules.length
        readings[lane, at + 2], readings[lane, at + 3] = _cos_sin(poses[lane, k + 1, 2])
        at += 4
    for axis in range(2):
        readings[lane, at + axis] = (readings[lane, TARGET + axis] - readings[lane, TIP + axis]) / rules.error_scale
        readings[lane, at + 2 + axis] = readings[lane, FORCE + axis] / rules.force_scale
    at += 4
    for k in range(moving):
        readings[lane, at + k] = 1.0 if readings[lane, LINK] == k + 1 else 0.0
    at = tendon_truth(rules, hardware, course, readings, lane, at + moving)
    for axis in range(2):
        for j in range(m):
            readings[lane, at + axis * m + j] = state.tip_rates[lane, axis, j]


@part(inline=True)
def _tell_arm(rules, course, state, hardware, lane):
    """The privileged state of an arm; the order is that of ArmTask.privileged_entries."""
    readings, poses, place = state.readings, state.poses, rules.hardware.privileged_at
    tip, own = poses.shape[1] - 1, TENSIONS + 2 * state.actions.shape[2]
    for axis in range(3):
        readings[lane, place + axis] = readings[lane, TIP + axis] / rules.length
        for column in range(2):
            readings[lane, place + 3 + 3 * column + axis] = poses[lane, tip, 4 * axis + column]
        error = readings[lane, TARGET + axis] - readings[lane, TIP + axis]
        readings[lane, place + 9 + axis] = error / rules.error_scale
        readings[lane, place + 12 + axis] = readings[lane, own + GRAVITY + axis]
    readings[lane, place + 15] = _payload(readings, lane, own) / rules.force_scale
    place += 16
    for i in range(state.angles.shape[1]):
        readings[lane, place + i] = state.angles[lane, i]
    tendon_truth(rules, hardware, course, readings, lane, place + state.angles.shape[1])


@part(inline=True)
def _payload(readings, lane, own):
    """What hangs from the tip [N]."""
    payload = 0.0
    for axis in range(3):
        payload += readings[lane, own + GRAVITY + axis] * readings[lane, FORCE + axis]
    return payload


@part(inline=True)
def observe_lanes(rules, course, state, hardware, observation, first, last):
    """Observations (B, entries) within their bounds; the order is that of the task's entries."""
    if rules.dimension == 2:
        _observe_links(rules, course, state, hardware, observation, first, last)
        for lane in range(first, last):
            _observe_chain(rules, course, state, hardware, observation, lane)
    else:
        _observe_arms(rules, course, state, hardware, observation, first, last)


@part(inline=True)
def _observe_chain(rules, course, state, hardware, observation, lane):
    """The entries of a chain after those of its links."""
    readings, links = state.readings, state.poses.shape[1] - 1
    per_length, per_error, per_force = 1 / rules.length, 1 / rules.error_scale, 1 / rules.force_scale
    seen = links - rules.first_seen
    entry = _observe_tendons(rules, readings, hardware, observation, lane, 4 * seen)
    if rules.observe_target:
        target_x, target_y = readings[lane, TARGET], readings[lane, TARGET + 1]
        observation[lane, entry] = target_x * per_length
        observation[lane, entry + 1] = target_y * per_length
        entry += 2
        if seen > 0:
            x, y, _ = _seen_link(rules, course, state, hardware, lane, links - 1)
            observation[lane, entry] = (target_x - x) * per_error
            observation[lane, entry + 1] = (target_y - y) * per_error
            entry += 2
    if rules.observe_load:
        observation[lane, entry] = readings[lane, FORCE] * per_force
        observation[lane, entry + 1] = readings[lane, FORCE + 1] * per_force
        for k in range(links):
            observation[lane, entry + 2 + k] = 1.0 if readings[lane, LINK] == k + 1 else 0.0
        entry += 2 + links
    _end_observation(rules, hardware, readings, observation, lane, entry)


@part
def _observe_arms(rules, course, state, hardware, observation, first, last):
    """All entries of arms."""
    readings, own = state.readings, TENSIONS + 2 * rules.neutral_lengths.size
    seen = rules.first_seen < state.poses.shape[1] - 1
    at, R = np.empty(3), np.empty((3, 3))
    for lane in range(first, last):
        entry = 0
        if seen:
            _see_tip(rules, course, state, hardware, lane, at, R)
            for axis in range(3):
                observation[lane, axis] = at[axis] / rules.length
            entry = _write_columns(R, observation, lane, 3) if rules.orientation else 3
        entry = _observe_tendons(rules, readings, hardware, observation, lane, entry)
        if rules.observe_target:
            entry = _observe_frames(rules, readings, observation, lane, entry, at, R, seen)
        if rules.observe_load:
            for axis in range(3):
                observation[lane, entry + axis] = readings[lane, own + GRAVITY + axis]
            observation[lane, entry + 3] = _payload(readings, lane, own) / rules.force_scale
            entry += 4
        _end_observation(rules, hardware, readings, observation, lane, entry)


@part(inline=True)
def _end_observation(rules, hardware, readings, observation, lane, entry):
    """The picture's age and past readings from this entry on, and all entries within their bounds."""
    if rules.hardware.active:
        observe_instruments(rules, hardware, readings, observation, lane, entry)
    for place in range(rules.low.size):
        observation[lane, place] = min(max(observation[lane, place], rules.low[place]), rules.high[place])


@part(inline=True)
def _observe_tendons(rules, readings, hardware, observation, lane, entry):
    """Fill commands and tensions from this entry on, measured ones where they are; returns the entry after them."""
    neutral_lengths, m = rules.neutral_lengths, rules.neutral_lengths.size
    per_command, per_tension = 1 / rules.command_scale, 1 / rules.highest_tension
    for j in range(m):
        command, tension = sensed(rules, hardware, readings, lane, j)
        observation[lane, entry + j] = (command - neutral_lengths[j]) * per_command
        if rules.observe_tensions:
            observation[lane, entry + m + j] = tension * per_tension
    return entry + (2 * m if rules.observe_tensions else m)


@part(inline=True)
def _observe_links(rules, course, state, hardware, observation, first, last):
    """The first entries of observations: measured poses of the moving links, a block of lanes at a time."""
    per_length, unseen = 1 / rules.length, rules.first_seen
    moving = state.poses.shape[1] - 1 - unseen
    memory, size = np.empty(3 * BLOCK * moving), BLOCK * moving
    angles, cosines, sines = memory[:size], memory[size : 2 * size], memory[2 * size :]
    for start in range(first, last, BLOCK):
        stop = min(start + BLOCK, last)
        for lane in range(start, stop):
            for k in range(moving):
                x, y, angle = _seen_link(rules, course, state, hardware, lane, unseen + k)
                observation[lane, 4 * k] = x * per_length
                observation[lane, 4 * k + 1] = y * per_length
                angles[(lane - start) * moving + k] = angle
        for i in range((stop - start) * moving):
            cosines[i], sines[i] = _cos_sin(angles[i])
        for lane in range(start, stop):
            for k in range(moving):
                observation[lane, 4 * k + 2] = cosines[(lane - start) * moving + k]
                observation[lane, 4 * k + 3] = sines[(lane - start) * moving + k]


@part(inline=True)
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


@part(inline=True)
def _observe_frames(rules, readings, observation, lane, entry, at, R, seen):
    """Fill the target and, where the tip is measured, the errors; returns the entry after them."""
    own = TENSIONS + 2 * rules.neutral_lengths.size
    for axis in range(3):
        observation[lane, entry + axis] = readings[lane, TARGET + axis] / rules.length
    entry += 3
    aim, E = np.empty((3, 3)), np.empty((3, 3))
    if rules.orientation:
        for i in range(9):
            aim[i // 3, i % 3] = readings[lane, own + TARGET_FRAME + i]
        entry = _write_columns(aim, observation, lane, entry)
    if not seen:
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
