"""What is measured of planar chains and goes into observations, and their privileged state, compiled.

Arguments are those of kernels.py; functions over lanes work on first to last - 1.
"""

from __future__ import annotations

import math

import numpy as np

from rj_gym.core.columns import FORCE, LINK, STEP, TARGET, TIP
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
from rollingjoint.compiled import part

BLOCK = 16  # lanes whose angles are turned together
ROUND = 1.5 * 2.0**52  # added and taken away again, it rounds to a whole number


@part(inline=True)
def measure(rules, course, state, hardware, first, last):
    """What is measured at the end of a step, and the privileged state."""
    readings, moving, axes = state.readings, state.poses.shape[1] - 1, hardware.errors.shape[1]
    for lane in range(first, last):
        measure_tendons(rules, hardware, readings, lane)
        if rules.hardware.late:
            date_picture(rules, hardware, readings, lane)
            _keep_picture(state, hardware, lane)
        if axes > 0:
            x, y, _ = _seen(rules, course, state, hardware, lane, moving - 1)
            hardware.errors[lane, 0] = readings[lane, TARGET] - x
            hardware.errors[lane, 1] = readings[lane, TARGET + 1] - y
        remember(hardware, readings, lane)
        if rules.hardware.privileged_low.size > 0:
            _tell_truth(rules, course, state, hardware, lane)


@part(inline=True)
def _keep_picture(state, hardware, lane):
    """Keep the true pose for pictures that come later, and show the one that comes now."""
    poses, pictures, slot = state.poses, hardware.pictures, picture_slot(hardware, state.readings, lane)
    for i in range(pictures.shape[2]):
        pictures[lane, slot, i] = poses[lane, 1 + i // 3, i % 3]
    show_picture(hardware, lane)


@part(inline=True)
def _seen(rules, course, state, hardware, lane, k):
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
def _tell_truth(rules, course, state, hardware, lane):
    """The privileged state; the order is that of privileged_entries."""
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
    within_bounds(rules, readings, lane)


@part(inline=True)
def observe_links(rules, course, state, hardware, observation, first, last):
    """The first entries of observations: measured poses of the moving links, a block of lanes at a time."""
    per_length, unseen = 1 / rules.length, rules.first_seen
    moving = state.poses.shape[1] - 1 - unseen
    memory, size = np.empty(3 * BLOCK * moving), BLOCK * moving
    angles, cosines, sines = memory[:size], memory[size : 2 * size], memory[2 * size :]
    for start in range(first, last, BLOCK):
        stop = min(start + BLOCK, last)
        for lane in range(start, stop):
            for k in range(moving):
                x, y, angle = _seen(rules, course, state, hardware, lane, unseen + k)
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
def observe_rest(rules, course, state, hardware, observation, first, last):
    """The other entries of observations, and all within their bounds; the order is that of observation_entries."""
    readings, low, high = state.readings, rules.low, rules.high
    per_length, per_error, per_force = 1 / rules.length, 1 / rules.error_scale, 1 / rules.force_scale
    links, m = state.poses.shape[1] - 1, state.actions.shape[2]
    seen = links - rules.first_seen
    for lane in range(first, last):
        entry = _observe_tendons(rules, readings, hardware, observation, lane, 4 * seen, m)
        if rules.observe_target:
            target_x, target_y = readings[lane, TARGET], readings[lane, TARGET + 1]
            observation[lane, entry] = target_x * per_length
            observation[lane, entry + 1] = target_y * per_length
            entry += 2
            if seen > 0:
                x, y, _ = _seen(rules, course, state, hardware, lane, links - 1)
                observation[lane, entry] = (target_x - x) * per_error
                observation[lane, entry + 1] = (target_y - y) * per_error
                entry += 2
        if rules.observe_load:
            observation[lane, entry] = readings[lane, FORCE] * per_force
            observation[lane, entry + 1] = readings[lane, FORCE + 1] * per_force
            for k in range(links):
                observation[lane, entry + 2 + k] = 1.0 if readings[lane, LINK] == k + 1 else 0.0
            entry += 2 + links
        if rules.hardware.active:
            observe_instruments(rules, hardware, readings, observation, lane, entry)
        for entry in range(low.size):
            observation[lane, entry] = min(max(observation[lane, entry], low[entry]), high[entry])


@part(inline=True)
def _observe_tendons(rules, readings, hardware, observation, lane, entry, m):
    """Fill commands and tensions from this entry on, measured ones where they are; returns the entry after them."""
    neutral_lengths, per_command, per_tension = (
        rules.neutral_lengths,
        1 / rules.command_scale,
        1 / rules.highest_tension,
    )
    for j in range(m):
        command, tension = sensed(rules, hardware, readings, lane, j)
        observation[lane, entry + j] = (command - neutral_lengths[j]) * per_command
        if rules.observe_tensions:
            observation[lane, entry + m + j] = tension * per_tension
    return entry + (2 * m if rules.observe_tensions else m)
