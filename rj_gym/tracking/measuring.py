"""Measurements, observations and the privileged state, compiled.

Arguments are as in kernels.py; functions over lanes work on first to last - 1. Of a chain in the plane every moving
link can be measured, of an arm in space the tip alone.
"""

from __future__ import annotations

import math

import numpy as np

from rj_gym.core.columns import FORCE, GRAVITY, LINK, STEP, TARGET, TARGET_FRAME, TENSIONS, TIP
from rj_gym.tracking.arrays import AGE, GAIN, LAG_TENSION, LIMIT, MOTOR, NEW, OFFSET, POSITION, TAKEN, TENSION
from rollingjoint.compiled import part, sheath_direction, sheath_ratio

BLOCK = 16  # lanes with angles turned together
ROUND = 1.5 * 2.0**52  # added and taken away again, it rounds to a whole number


@part(inline=True)
def measure(rules, course, state, hardware, first, last):
    """Where a world has sensors: fill the measurements at the end of a step, and the privileged state."""
    readings = state.readings
    for lane in range(first, last):
        _measure_tendons(rules, hardware, readings, lane)
        if rules.hardware.late:
            _date_picture(rules, hardware, readings, lane)
            _keep_picture(rules, state, hardware, lane)
        if hardware.errors.shape[1] > 0:
            if rules.dimension == 2:
                _measure_link_error(rules, course, state, hardware, lane)
            else:
                _measure_tip_error(rules, course, state, hardware, lane)
        _remember(hardware, readings, lane)
        if rules.hardware.privileged_low.size > 0:
            if rules.dimension == 2:
                _tell_chain(rules, course, state, hardware, lane)
            else:
                _tell_arm(rules, course, state, hardware, lane)
            _within_bounds(rules, readings, lane)


@part(inline=True)
def _measure_tendons(rules, hardware, readings, lane):
    """Fill measured motor positions and tensions."""
    motors, measured, now = hardware.motors, hardware.measured, int(readings[lane, STEP])
    m, positions, tensions = motors.shape[2], hardware.encoder_noise, hardware.tension_noise
    for j in range(m):
        p, q, tension = readings[lane, TENSIONS + m + j], motors[lane, MOTOR, j], readings[lane, TENSIONS + j]
        if hardware.sheath[lane, j] > 0.0 and not rules.hardware.cells_at_tendons:
            direction = sheath_direction(p, q, hardware.half_play[lane, j])
            tension *= sheath_ratio(hardware.sheath[lane, j], direction)
        if hardware.cells.shape[0] > 0:
            tension = hardware.cells[lane, GAIN, j] * tension + hardware.cells[lane, OFFSET, j]
        if positions.shape[1] > 0:
            q += positions[lane, min(now, positions.shape[1] - 1), j]
        if tensions.shape[1] > 0:
            tension += tensions[lane, min(now, tensions.shape[1] - 1), j]
        if tensions.shape[1] > 0 or hardware.cells.shape[0] > 0:
            tension = max(tension, 0.0)
        measured[lane, POSITION, j] = _rounded(q, rules.hardware.encoder_resolution)
        measured[lane, TENSION, j] = _rounded(tension, rules.hardware.tension_resolution)


@part(inline=True)
def _rounded(value, resolution):
    return value if resolution <= 0.0 else resolution * math.floor(value / resolution + 0.5)


@part(inline=True)
def _date_picture(rules, hardware, readings, lane):
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
def _keep_picture(rules, state, hardware, lane):
    """Keep the true poses for pictures that come later, and show the one that comes now."""
    poses, pictures, slot = state.poses, hardware.pictures, _picture_slot(hardware, state.readings, lane)
    numbers, link = poses.shape[2], 1 if rules.dimension == 2 else poses.shape[1] - 1
    for i in range(pictures.shape[2]):
        pictures[lane, slot, i] = poses[lane, link + i // numbers, i % numbers]
    _show_picture(hardware, lane)


@part(inline=True)
def _picture_slot(hardware, readings, lane):
    """Where in the ring a task keeps the true pose of this step."""
    return int(readings[lane, STEP]) % (hardware.pictures.shape[1] - 1)


@part(inline=True)
def _show_picture(hardware, lane):
    """Take the picture that comes now out of the ring, as the one that is seen."""
    pictures, shown = hardware.pictures, hardware.pictures.shape[1] - 1
    if hardware.picture[lane, NEW] == 1:
        taken = hardware.picture[lane, TAKEN] % shown
        for i in range(pictures.shape[2]):
            pictures[lane, shown, i] = pictures[lane, taken, i]


@part(inline=True)
def _measure_link_error(rules, course, state, hardware, lane):
    """Target minus measured place of the last link, of a chain."""
    x, y, _ = _seen_link(rules, course, state, hardware, lane, state.poses.shape[1] - 2)
    hardware.errors[lane, 0] = state.readings[lane, TARGET] - x
    hardware.errors[lane, 1] = state.readings[lane, TARGET + 1] - y


@part(inline=True)
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
def _remember(hardware, readings, lane):
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
def _tell_chain(rules, course, state, hardware, lane):
    """The privileged state of a chain, in the order of observation.privileged_entries."""
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
    at = _tendon_truth(rules, hardware, course, readings, lane, at + moving)
    for axis in range(2):
        for j in range(m):
            readings[lane, at + axis * m + j] = state.tip_rates[lane, axis, j]


@part(inline=True)
def _tell_arm(rules, course, state, hardware, lane):
    """The privileged state of an arm, in the order of observation.privileged_entries."""
    readings, poses, place = state.readings, state.poses, rules.hardware.privileged_at
    tip, first_own = poses.shape[1] - 1, TENSIONS + 2 * state.actions.shape[2]
    for axis in range(3):
        readings[lane, place + axis] = readings[lane, TIP + axis] / rules.length
        for column in range(2):
            readings[lane, place + 3 + 3 * column + axis] = poses[lane, tip, 4 * axis + column]
        error = readings[lane, TARGET + axis] - readings[lane, TIP + axis]
        readings[lane, place + 9 + axis] = error / rules.error_scale
        readings[lane, place + 12 + axis] = readings[lane, first_own + GRAVITY + axis]
    readings[lane, place + 15] = _payload(readings, lane, first_own) / rules.force_scale
    place += 16
    for i in range(state.angles.shape[1]):
        readings[lane, place + i] = state.angles[lane, i]
    _tendon_truth(rules, hardware, course, readings, lane, place + state.angles.shape[1])


@part(inline=True)
def _payload(readings, lane, first_own):
    """The payload at the tip [N]."""
    payload = 0.0
    for axis in range(3):
        payload += readings[lane, first_own + GRAVITY + axis] * readings[lane, FORCE + axis]
    return payload


@part(inline=True)
def _tendon_truth(rules, hardware, course, readings, lane, at):
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
        if h.tells_limits:
            readings[lane, at + (7 * m if h.friction else 6 * m) + j] = hardware.limits[lane, LIMIT, j]
    at += (6 + (1 if h.friction else 0) + (1 if h.tells_limits else 0)) * m
    readings[lane, at] = readings[lane, STEP] / h.steps
    return at + 1


@part(inline=True)
def _within_bounds(rules, readings, lane):
    """Clip the privileged numbers to their bounds."""
    at, low, high = rules.hardware.privileged_at, rules.hardware.privileged_low, rules.hardware.privileged_high
    for k in range(low.size):
        readings[lane, at + k] = min(max(readings[lane, at + k], np.float64(low[k])), np.float64(high[k]))


@part(inline=True)
def observe_lanes(rules, course, state, hardware, observation, first, last):
    """Observations (B, entries) within their bounds; in the order of the task's entries."""
    if rules.dimension == 2:
        _observe_links(rules, course, state, hardware, observation, first, last)
        for lane in range(first, last):
            _observe_chain(rules, course, state, hardware, observation, lane)
    else:
        _observe_arms(rules, course, state, hardware, observation, first, last)


@part(inline=True)
def _observe_chain(rules, course, state, hardware, observation, lane):
    """The entries of a chain after its links' poses."""
    readings, links = state.readings, state.poses.shape[1] - 1
    per_length, per_error, per_force = 1 / rules.length, 1 / rules.error_scale, 1 / rules.force_scale
    links_shown = links - rules.first_seen
    entry = _observe_tendons(rules, readings, hardware, observation, lane, 4 * links_shown)
    if rules.observe_target:
        target_x, target_y = readings[lane, TARGET], readings[lane, TARGET + 1]
        observation[lane, entry] = target_x * per_length
        observation[lane, entry + 1] = target_y * per_length
        entry += 2
        if links_shown > 0:
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


@part(inline=True)
def _observe_arms(rules, course, state, hardware, observation, first, last):
    """All entries of arms."""
    readings, first_own = state.readings, TENSIONS + 2 * rules.neutral_lengths.size
    is_shown = rules.first_seen < state.poses.shape[1] - 1
    at, R = np.empty(3), np.empty((3, 3))
    for lane in range(first, last):
        entry = 0
        if is_shown:
            _see_tip(rules, course, state, hardware, lane, at, R)
            for axis in range(3):
                observation[lane, axis] = at[axis] / rules.length
            entry = _write_columns(R, observation, lane, 3) if rules.orientation else 3
        entry = _observe_tendons(rules, readings, hardware, observation, lane, entry)
        if rules.observe_target:
            entry = _observe_frames(rules, readings, observation, lane, entry, at, R, is_shown)
        if rules.observe_load:
            for axis in range(3):
                observation[lane, entry + axis] = readings[lane, first_own + GRAVITY + axis]
            observation[lane, entry + 3] = _payload(readings, lane, first_own) / rules.force_scale
            entry += 4
        _end_observation(rules, hardware, readings, observation, lane, entry)


@part(inline=True)
def _end_observation(rules, hardware, readings, observation, lane, entry):
    """The picture's age and past readings from this entry on, and all entries within their bounds."""
    if rules.hardware.active:
        _observe_instruments(rules, hardware, readings, observation, lane, entry)
    for place in range(rules.low.size):
        observation[lane, place] = min(max(observation[lane, place], rules.low[place]), rules.high[place])


@part(inline=True)
def _observe_instruments(rules, hardware, readings, observation, lane, entry):
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
def _observe_tendons(rules, readings, hardware, observation, lane, entry):
    """Fill commands and tensions from this entry on, measured ones where they are; returns the entry after them."""
    neutral_lengths, m = rules.neutral_lengths, rules.neutral_lengths.size
    per_command, per_tension = 1 / rules.command_scale, 1 / rules.highest_tension
    for j in range(m):
        command, tension = _sensed(rules, hardware, readings, lane, j)
        observation[lane, entry + j] = (command - neutral_lengths[j]) * per_command
        if rules.observe_tensions:
            observation[lane, entry + m + j] = tension * per_tension
    return entry + (2 * m if rules.observe_tensions else m)


@part(inline=True)
def _sensed(rules, hardware, readings, lane, j):
    """Position [mm] and tension [N] of a tendon as they are observed: measured, or where all is plain the true ones."""
    m = rules.neutral_lengths.size
    if rules.hardware.active:
        return hardware.measured[lane, POSITION, j], hardware.measured[lane, TENSION, j]
    return readings[lane, TENSIONS + m + j], readings[lane, TENSIONS + j]


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
def _observe_frames(rules, readings, observation, lane, entry, at, R, is_shown):
    """Fill the target and, where the tip is measured, the errors; returns the entry after them."""
    first_own = TENSIONS + 2 * rules.neutral_lengths.size
    for axis in range(3):
        observation[lane, entry + axis] = readings[lane, TARGET + axis] / rules.length
    entry += 3
    aim, E = np.empty((3, 3)), np.empty((3, 3))
    if rules.orientation:
        for i in range(9):
            aim[i // 3, i % 3] = readings[lane, first_own + TARGET_FRAME + i]
        entry = _write_columns(aim, observation, lane, entry)
    if not is_shown:
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


@part
def rotation_vector(E):
    """Rotation vector of a rotation matrix (3, 3) [rad] and its length, at most pi: (x, y, z, angle).

    Exact to rounding near 0 and pi, too. Source: as rollingjoint.chain.se3.rotation_vector.
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
