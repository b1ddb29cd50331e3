"""Chains in space with contacts: their arrays, poses, gaps and tendon lengths.

A joint is a planar map of one angle, tabulated, in a plane that is fixed in its links. Loads and solvers are those of
arms (spatial_loads.py, hinge_solve.py). Symbols as in docs/theory.md, section 11: a axis, c contact.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from rollingjoint._numba.borrowed import borrow
from rollingjoint._numba.jit import kernel, part
from rollingjoint._numba.layout import Floats, Integers
from rollingjoint._numba.simd import any_lane, where
from rollingjoint.kernels import formulas
from rollingjoint.kernels.arrays import TendonLaw
from rollingjoint.kernels.chain import register
from rollingjoint.kernels.formulas import formula
from rollingjoint.kernels.hinges import N_COLUMNS, N_HELD, N_SUMS, PX, B, F, HingeState, turned
from rollingjoint.kernels.joints import (
    BUCKET_ENDS,
    COS,
    CX,
    CY,
    GX,
    GY,
    N_COEFFICIENTS,
    SIN,
    evaluate_rows,
    gap_rates,
    straight_gap,
)
from rollingjoint.kernels.joints import PX as POLE_X
from rollingjoint.kernels.joints import PY as POLE_Y
from rollingjoint.kernels.vectors import about, choose, dot, in_space, minus, plus, times

MIDDLE, SHIFT = range(2)  # columns of ContactJoints.offsets


class ContactJoints(NamedTuple):
    """Chains of J joints and m tendons: D designs of one topology; `design` takes one out, without the D.

    Link 0 is the base; joint i carries link i + 1; z axes of links point to the tip.
    """

    joints: Annotated[Floats, "D", "J", 3]  # smallest and largest angle, rest angle of the spring
    axes: Annotated[Floats, "D", "J", 3]  # unit axis in the link below
    springs: Annotated[Floats, "D", "J"]  # N·mm/rad
    frames: Annotated[Floats, "D", "J", 9]  # lateral and axial direction and axis in the links, row by row
    offsets: Annotated[Floats, "D", "J", 2]  # along the axis: contact, origin of the link above
    lookup: Annotated[Floats, "D", "J", 3]  # smallest and largest angle of the table, buckets per radian
    buckets: Annotated[Integers, "D", "J", BUCKET_ENDS]  # this and the next two as in rolling.Chain
    cells: Annotated[Floats, "cells", 4]
    coefficients: Annotated[Floats, "cells", N_COEFFICIENTS, 8]
    holes: Annotated[Floats, "D", "J", "m", 6]  # below and above a gap, in the directions of frames
    directions: Annotated[Floats, "D", "J", "m", 6]  # unit channels below and above it, likewise
    channels: Annotated[Floats, "D", "m"]  # constant length inside the links
    tendon_joints: Annotated[Integers, "m"]  # number of joints a tendon crosses
    standing: Annotated[Floats, "D", "standing", N_COLUMNS]  # load table of its springs


class ContactState(NamedTuple):
    """Quantities of one configuration; axes, poses, contacts and normals in the base frame."""

    angle: Annotated[Floats, "J"]
    residual: Annotated[Floats, "J"]
    pose: Annotated[Floats, "n", 12]  # as HingeState.pose
    axis: Annotated[Floats, "J", 3]
    joint: Annotated[Floats, "J", 8]  # rows of the tables
    contact: Annotated[Floats, "J", 3]
    normal: Annotated[Floats, "J", 3]  # of the contact, over the relative curvature
    gap: Annotated[Floats, "J", "m", 3]  # g, g', g''
    direction: Annotated[Floats, "J", "m", 3]  # of the gaps, in the directions of frames
    sums: Annotated[Floats, "J", "sums"]  # as HingeState.sums
    held: Annotated[Floats, "J", "held"]  # as HingeState.held
    length: Annotated[Floats, "m"]
    tension: Annotated[Floats, "m"]
    elastic: Annotated[Floats, "m"]  # d tension / d length


class ContactResults(NamedTuple):
    """Outputs of B lanes."""

    joint_angles: Annotated[Floats, "B", "J"]
    poses: Annotated[Floats, "B", "n", 4, 4]
    tensions: Annotated[Floats, "B", "m"]
    lengths: Annotated[Floats, "B", "m"]
    rates: Annotated[Floats, "B", "J", "m"]  # d length / d joint angle
    torques: Annotated[Floats, "B", "J", "m"]  # d residual / d tension
    elastic: Annotated[Floats, "B", "m"]  # d tension / d length
    contacts: Annotated[Floats, "B", "J", 3]
    reactions: Annotated[Floats, "B", "J", 6]  # force and moment at the contact, along tangent, normal and axis
    residual: Annotated[Floats, "B"]
    iterations: Annotated[Integers, "B"]
    status: Annotated[Integers, "B"]
    escapes: Annotated[Integers, "B"]  # unstable equilibria that were left on the way


class ContactBatchArrays(NamedTuple):
    """Inputs and results of a batch."""

    chain: ContactJoints  # a stack
    designs: Annotated[Integers, "B"]  # index of each lane's design in the stack
    laws: Annotated[TendonLaw, "B"]
    loads: Annotated[Floats, "B", "rows", N_COLUMNS]
    starts: Annotated[Floats, "B", "J"]  # joint angles to start from, rad
    results: ContactResults


class PinnedContacts(NamedTuple):
    """A batch for kernels that are called repeatedly."""

    batch: ContactBatchArrays
    memory: Annotated[Floats, "words"]  # scratch space of a batch of one row; else empty


def new_contact_results(n_lanes: int, n_joints: int, n_tendons: int) -> ContactResults:
    """Empty outputs."""
    joints, tendons = (n_lanes, n_joints), (n_lanes, n_tendons)
    shapes = joints, (n_lanes, n_joints + 1, 4, 4), tendons, tendons, *2 * ((*joints, n_tendons),), tendons
    numbers = map(np.empty, (*shapes, (*joints, 3), (*joints, 6), (n_lanes,)))
    return ContactResults(*numbers, *(np.empty(n_lanes, np.int64) for _ in range(3)))


@part
def new_contact_state(n_joints, n_tendons):
    """An empty ContactState."""
    return ContactState(
        np.zeros(n_joints),
        np.zeros(n_joints),
        np.zeros((n_joints + 1, 12)),
        np.zeros((n_joints, 3)),
        np.zeros((n_joints, 8)),
        np.zeros((n_joints, 3)),
        np.zeros((n_joints, 3)),
        np.zeros((n_joints, n_tendons, 3)),
        np.zeros((n_joints, n_tendons, 3)),
        np.zeros((n_joints, N_SUMS)),
        np.zeros((n_joints, N_HELD)),
        np.zeros(n_tendons),
        np.zeros(n_tendons),
        np.zeros(n_tendons),
    )


@formula(formulas.design, ContactJoints)
def design(chain, which):
    """One design of a stack, without reference counts."""
    chain = borrow(chain)
    return ContactJoints(
        chain.joints[which],
        chain.axes[which],
        chain.springs[which],
        chain.frames[which],
        chain.offsets[which],
        chain.lookup[which],
        chain.buckets[which],
        chain.cells,
        chain.coefficients,
        chain.holes[which],
        chain.directions[which],
        chain.channels[which],
        chain.tendon_joints,
        chain.standing[which],
    )


@formula(formulas.evaluate_geometry, ContactJoints)
def geometry_of(chain, state):
    """Fill rows of the tables, poses, axes, contacts, normals, gaps and tendon lengths."""
    evaluate_rows(chain.lookup, chain, state)
    evaluate_geometry(chain.frames, chain.offsets, chain.holes, chain.channels, chain.tendon_joints, state)


@part(inline=True)
def evaluate_geometry(frames, offsets, holes, channels, tendon_joints, state):
    """As `geometry_of`, from state.joint; the arrays are of a ContactJoints or of lanes."""
    pose, axis, contact, joint, length = state.pose, state.axis, state.contact, state.joint, state.length
    zero = 0.0 * state.angle[0]
    for j in range(length.size):
        length[j] = channels[j]
    for entry in range(12):
        pose[0, entry] = zero + 1.0 if entry == 0 or entry == 4 or entry == 8 else zero
    for i in range(state.angle.size):
        lateral, axial = turned(pose, i, in_space(frames, i, 0)), turned(pose, i, in_space(frames, i, 3))
        along, origin = about(lateral, axial), in_space(pose, i, PX)
        middle, shift = offsets[i, MIDDLE], offsets[i, SHIFT]
        at = plus(plus(times(lateral, joint[i, CX]), times(axial, joint[i, CY])), times(along, middle))
        above = plus(plus(times(lateral, joint[i, GX]), times(axial, joint[i, GY])), times(along, shift))
        normal = minus(times(axial, joint[i, POLE_X]), times(lateral, joint[i, POLE_Y]))
        cos, sin = joint[i, COS], joint[i, SIN]
        turned_lateral = plus(times(lateral, cos), times(axial, sin))
        turned_axial = minus(times(axial, cos), times(lateral, sin))
        for row in range(3):
            axis[i, row], state.normal[i, row] = along[row], normal[row]
            contact[i, row], pose[i + 1, PX + row] = origin[row] + at[row], origin[row] + above[row]
            for column in range(3):
                pose[i + 1, 3 * row + column] = (
                    turned_lateral[row] * frames[i, column]
                    + turned_axial[row] * frames[i, 3 + column]
                    + along[row] * frames[i, 6 + column]
                )
        for j in range(length.size):
            if i < tendon_joints[j]:
                _evaluate_crossing(holes[i], state, i, j)
                length[j] += state.gap[i, j, 0]


@part(inline=True)
def _evaluate_crossing(holes, state, i, j):
    """Fill length, rates and direction of a gap; holes: of the joint, (m, 6)."""
    gap, joint, x, y = state.gap, state.joint, holes[j, 3], holes[j, 4]
    cos, sin = joint[i, COS], joint[i, SIN]
    below = in_space(holes, j, 0)
    above = joint[i, GX] + cos * x - sin * y, joint[i, GY] + sin * x + cos * y, holes[j, 5]
    length, direction, per_length, closed = straight_gap(below, above)
    if any_lane(closed):
        ex, ey = tangent(joint, i)
        direction = choose(closed, (-ey, ex, 0.0), direction)
    contact, pole = (joint[i, CX], joint[i, CY]), (joint[i, POLE_X], joint[i, POLE_Y])
    in_plane = gap_rates(1.0, below[:2], length, direction[:2], per_length, contact, pole)
    gap[i, j, 0], (gap[i, j, 1], gap[i, j, 2]) = length, in_plane
    for a in range(3):
        state.direction[i, j, a] = direction[a]


@part(inline=True)
def tangent(joint, i):
    """Unit tangent of the surface below at the contact, in the directions of frames; lateral where no contact moves."""
    x, y = joint[i, POLE_X], joint[i, POLE_Y]  # against the tangent: the angle falls as s grows
    size = math.sqrt(x * x + y * y)
    rolls = size > 0.0
    nonzero = where(rolls, size, 1.0)
    return where(rolls, -x / nonzero, 1.0), where(rolls, -y / nonzero, 0.0)


@formula(formulas.pivot, ContactState)
def pivot(state, i):
    """The contact."""
    return in_space(state.contact, i, 0)


@formula(formulas.axis, HingeState, ContactState)
def axis(state, i):
    """The axis of a joint in space."""
    return in_space(state.axis, i, 0)


@formula(formulas.origin, HingeState, ContactState)
def origin(state, k):
    """The origin of a link in space."""
    return in_space(state.pose, k, PX)


@formula(formulas.frame, HingeState, ContactState)
def frame(state, k):
    """The first columns of its pose."""
    (a, b, c), (d, e, f), (g, h, i) = in_space(state.pose, k, 0), in_space(state.pose, k, 3), in_space(state.pose, k, 6)
    return a, b, c, d, e, f, g, h, i


@formula(formulas.torque, ContactState)
def torque(state, i, j):
    """g'."""
    return state.gap[i, j, 1]


@formula(formulas.own_stiffness, ContactJoints)
def own_stiffness(chain, state, i):
    """The spring of a joint, and its contact, which moves as it turns, and with it the lever of the loads beyond it."""
    return chain.springs[i] + dot(in_space(state.normal, i, 0), load_force(state, i))


@part(inline=True)
def fill_reaction(frames, offsets, holes, tendon_joints, state, tension, load, couple, i, reaction):
    """Fill force and moment on the distal link about the contact of joint i, (6,): along tangent, normal and axis.

    tension: of every tendon in the gap, (m,). load, couple: force and moment about the contact of all loads beyond it.
    """
    joint, axis = state.joint, in_space(state.axis, i, 0)
    lateral, axial = turned(state.pose, i, in_space(frames, i, 0)), turned(state.pose, i, in_space(frames, i, 3))
    force = -dot(lateral, load), -dot(axial, load), -dot(axis, load)
    moment = -dot(lateral, couple), -dot(axial, couple), -dot(axis, couple)
    contact = joint[i, CX], joint[i, CY], offsets[i, MIDDLE]
    for j in range(tension.size):
        if i < tendon_joints[j]:
            pull = times(in_space(state.direction[i], j, 0), tension[j])
            arm = minus(in_space(holes[i], j, 0), contact)
            force, moment = plus(force, pull), plus(moment, about(arm, pull))
    ex, ey = tangent(joint, i)
    reaction[0], reaction[1], reaction[2] = ex * force[0] + ey * force[1], ex * force[1] - ey * force[0], force[2]
    reaction[3], reaction[4] = ex * moment[0] + ey * moment[1], ex * moment[1] - ey * moment[0]
    reaction[5] = moment[2]


@part(inline=True)
def load_force(state, i):
    """Sum of all forces beyond joint i, a vector."""
    return plus(in_space(state.sums, i, F), in_space(state.sums, i, B))


register(ContactJoints)


@kernel(short_loops=True, title="the geometry of chains in space")
def spatial_poses_of(chain, angles, poses, lengths):
    """Fill poses (B, n, 4, 4) and tendon lengths (B, m) at joint angles, (B, J), clipped to the joints' limits."""
    n_lanes, n_joints = angles.shape
    mechanism, state = design(chain, 0), new_contact_state(n_joints, chain.tendon_joints.size)
    for lane in range(n_lanes):
        for i in range(n_joints):
            state.angle[i] = min(max(angles[lane, i], mechanism.joints[i, 0]), mechanism.joints[i, 1])
        geometry_of(mechanism, state)
        store_poses(state, poses, lane)
        for j in range(lengths.shape[1]):
            lengths[lane, j] = state.length[j]


@part(inline=True)
def store_poses(state, poses, lane):
    """Copy the poses of all links, as 4 x 4 matrices."""
    for k in range(state.pose.shape[0]):
        for a in range(3):
            for b in range(3):
                poses[lane, k, a, b] = state.pose[k, 3 * a + b]
            poses[lane, k, a, 3], poses[lane, k, 3, a] = state.pose[k, PX + a], 0.0
        poses[lane, k, 3, 3] = 1.0
