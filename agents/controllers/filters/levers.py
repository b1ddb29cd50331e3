"""Levers of the models, compiled, R rows side by side: see Levers in kernels.py."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from rollingjoint.compiled import Floats, kernel, part


class ArmLoads(NamedTuple):
    """Gravity and payload of an arm, R rows."""

    weights: Annotated[Floats, "J"]  # of the moving links, N
    centres: Annotated[Floats, "J", 3]  # where they act, in the frames of the links, mm
    gravity: Annotated[Floats, "R", 3]  # its direction
    by_turn: Annotated[Floats, "R", 3, 2]  # the derivative of that by the vector that turns it, 1/rad
    payloads: Annotated[Floats, "R"]  # N


@kernel(nogil=True, title="the controllers' filters")
def chain_levers(poses, contacts, links, levers):
    """Fill the levers of planar chains: of a force (2) [N] on one link each.

    poses: (R, n, 3) [mm, rad]. contacts: contact points, (R, J, 2) [mm]. links: the loaded ones, (R,).
    """
    n_rows, n_joints = contacts.shape[:2]
    for row in range(n_rows):
        x, y = poses[row, links[row], 0], poses[row, links[row], 1]
        for i in range(n_joints):
            carries = 1.0 if i < links[row] else 0.0
            levers.loads[row, i, 0] = carries * (contacts[row, i, 1] - y)
            levers.loads[row, i, 1] = carries * (x - contacts[row, i, 0])
            levers.tips[row, 0, i] = contacts[row, i, 1] - poses[row, n_joints, 1]
            levers.tips[row, 1, i] = poses[row, n_joints, 0] - contacts[row, i, 0]


@kernel(nogil=True, title="the controllers' filters")
def arm_levers(poses, pivots, axes, loads, levers):
    """Fill the levers of arms: of the vector that turns gravity (2) [rad] and of the payload [N].

    poses: (R, n, 4, 4) [mm]. pivots: where joints turn, (R, J, 3) [mm]. axes: of the joints, in the frames of the links
    below, (J, 3). loads: ArmLoads.
    """
    n_rows, n_joints = poses.shape[0], len(axes)
    axis, weight_moment, tip, moment = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for row in range(n_rows):
        weight = 0.0
        weight_moment[:] = 0.0  # sum of the weights beyond a joint times where they act, N mm
        for i in range(n_joints - 1, -1, -1):
            weight += loads.weights[i]
            for k in range(3):
                offset = axis[k] = 0.0
                for c in range(3):
                    offset += poses[row, i + 1, k, c] * loads.centres[i, c]
                    axis[k] += poses[row, i, k, c] * axes[i, c]
                weight_moment[k] += loads.weights[i] * (poses[row, i + 1, k, 3] + offset)
                tip[k] = poses[row, n_joints, k, 3] - pivots[row, i, k]
                moment[k] = weight_moment[k] - weight * pivots[row, i, k] + loads.payloads[row] * tip[k]
            for c in range(2):
                levers.loads[row, i, c] = _triple(axis, moment, loads.by_turn[row, :, c])
            levers.loads[row, i, 2] = _triple(axis, tip, loads.gravity[row])
            for k in range(3):
                levers.tips[row, k, i] = axis[(k + 1) % 3] * tip[(k + 2) % 3] - axis[(k + 2) % 3] * tip[(k + 1) % 3]


@kernel(nogil=True, title="the controllers' filters")
def tube_levers(poses, pivots, axes, levers):
    """Fill the levers of chains in space: of a force at the tip (3) [N]. Arguments as of arm_levers."""
    n_rows, n_joints = pivots.shape[:2]
    axis, tip = np.empty(3), np.empty(3)
    for row in range(n_rows):
        for i in range(n_joints):
            for k in range(3):
                tip[k], axis[k] = poses[row, n_joints, k, 3] - pivots[row, i, k], 0.0
                for c in range(3):
                    axis[k] += poses[row, i, k, c] * axes[i, c]
            for k in range(3):
                lever = axis[(k + 1) % 3] * tip[(k + 2) % 3] - axis[(k + 2) % 3] * tip[(k + 1) % 3]
                levers.loads[row, i, k] = levers.tips[row, k, i] = lever


@part
def _triple(a, b, c):
    """a · (b × c)."""
    value = 0.0
    for k in range(3):
        value += a[k] * (b[(k + 1) % 3] * c[(k + 2) % 3] - b[(k + 2) % 3] * c[(k + 1) % 3])
    return value


@kernel(nogil=True, title="the controllers' filters")
def turn_gravity(turns, gravity, by_turn):
    """Fill the directions (R, 3) to which vectors (R, 2) [rad] turn (0, 0, 1), and their derivatives, (R, 3, 2).

    A vector points where gravity leans, and is as long as the angle.
    """
    for row in range(len(turns)):
        angle = math.hypot(turns[row, 0], turns[row, 1])
        near = angle < 1e-4
        sinc = 1.0 - angle * angle / 6.0 if near else math.sin(angle) / angle
        bend = -1.0 / 3.0 if near else (math.cos(angle) - sinc) / (angle * angle)
        gravity[row, 2] = math.cos(angle)
        for k in range(2):
            gravity[row, k] = sinc * turns[row, k]
            by_turn[row, 2, k] = -sinc * turns[row, k]
            for c in range(2):
                by_turn[row, k, c] = bend * turns[row, k] * turns[row, c] + (sinc if k == c else 0.0)
