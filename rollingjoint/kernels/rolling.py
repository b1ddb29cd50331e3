"""Planar rolling chains: their arrays, the tables of their joints, gaps, poses, residual and contact forces.

Functions of states take arrays of floats, one configuration, or of SIMD lanes, eight configurations side by side; the
shapes below hold for both. Only the joints' tables are looked up one by one. Symbols as in docs/theory.md: c contact
point, F external force.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from rollingjoint._numba.jit import kernel, part
from rollingjoint._numba.layout import Floats, Integers
from rollingjoint._numba.simd import any_lane, where
from rollingjoint.kernels import formulas
from rollingjoint.kernels.arrays import TendonLaw, empty_arrays
from rollingjoint.kernels.chain import register
from rollingjoint.kernels.formulas import formula
from rollingjoint.kernels.joints import (
    BUCKET_ENDS,
    COS,
    CX,
    CY,
    GX,
    GY,
    N_COEFFICIENTS,
    PX,
    PY,
    SIN,
    evaluate_rows,
    gap_rates,
    locate,
    normal,
    straight_gap,
)
from rollingjoint.kernels.tendons import fill_residual
from rollingjoint.kernels.vectors import choose

# Columns of State.pose
X, Y, THETA, C, S = range(5)
# Columns of State.sums: sums over all loads beyond a joint (F force, x point, b follower force, k spring)
FX, FY, TURN, X_DOT_F, BX, BY, X_DOT_B, K, KX, KY, K_XX = range(11)


class Chain(NamedTuple):
    """Planar rolling chains of n links, J = n - 1 joints and m tendons: D designs of one topology.

    `design` takes one of them out; its arrays have no leading D.
    """

    joints: Annotated[Floats, "D", "J", 3]  # smallest and largest angle, buckets per radian
    buckets: Annotated[Integers, "D", "J", BUCKET_ENDS]  # first and last cell of every bucket
    cells: Annotated[Floats, "cells", 4]  # smallest and largest angle, middle, 2 / width
    coefficients: Annotated[Floats, "cells", N_COEFFICIENTS, 8]  # State.joint in powers of a cell's coordinate, -1 to 1
    arc_coefficients: Annotated[Floats, "cells", N_COEFFICIENTS]  # arc length, likewise
    holes: Annotated[Floats, "D", "J", "m", 4]  # x, y of the hole on the proximal link, x, y on the distal link
    channels: Annotated[Floats, "D", "m"]  # constant length inside the links
    directions: Annotated[Floats, "D", "J", "m", 4]  # unit x, y along the channel below a gap, and of the one above it
    tendon_joints: Annotated[Integers, "m"]  # number of joints a tendon crosses
    standing: Annotated[Floats, "D", "standing", "columns"]  # load table of the springs that belong to the mechanism


class State(NamedTuple):
    """Quantities of one configuration."""

    angle: Annotated[Floats, "J"]
    joint: Annotated[Floats, "J", 8]
    gap: Annotated[Floats, "J", "m", 5]  # g, g', g'', direction of the segment in the proximal link's frame
    pose: Annotated[Floats, "n", 5]
    contact: Annotated[Floats, "J", 4]  # contact point and its rate d / d angle, world frame
    sums: Annotated[Floats, "J", "sums"]  # 11; 4 where only dead forces and moments act
    length: Annotated[Floats, "m"]
    tension: Annotated[Floats, "m"]
    elastic: Annotated[Floats, "m"]  # d tension / d length
    residual: Annotated[Floats, "J"]


class RollingResults(NamedTuple):
    """Outputs of B lanes; those with B or 0 lanes are left out where they have none."""

    joint_angles: Annotated[Floats, "B", "J"]
    poses: Annotated[Floats, "B", "n", 3]
    contacts: Annotated[Floats, "B or 0", "J", 4]  # point and unit tangent, world frame
    tensions: Annotated[Floats, "B", "m"]
    lengths: Annotated[Floats, "B", "m"]
    rates: Annotated[Floats, "B or 0", "J", "m"]  # d length / d joint angle
    elastic: Annotated[Floats, "B", "m"]  # d tension / d length
    contact_forces: Annotated[Floats, "B or 0", "J", 2]
    responses: Annotated[Floats, "B or none", "J", "m"]  # d joint angle / d command; zero from the general solver
    residual: Annotated[Floats, "B"]
    iterations: Annotated[Integers, "B"]
    status: Annotated[Integers, "B"]


class BatchArrays(NamedTuple):
    """Equilibria to be solved as a batch, and where they go."""

    chain: Chain  # a stack
    designs: Annotated[Integers, "B"]  # index of each lane's design in the stack
    laws: Annotated[TendonLaw, "B"]
    loads: Annotated[Floats, "B", "rows", "columns"]
    starts: Annotated[Floats, "B", "J"]  # joint angles to start from, rad
    results: RollingResults


class PinnedBatch(NamedTuple):
    """A batch as kernels take it that are called again and again."""

    batch: BatchArrays
    memory: Annotated[Floats, "words"]  # scratch space of a batch of one row; else empty


def new_results(
    n_lanes: int, n_joints: int, n_tendons: int, contacts: bool = True, responses: bool = False
) -> RollingResults:
    """Empty outputs, with or without contacts, rates and contact forces, and responses."""
    detailed = n_lanes if contacts else 0
    shapes = (
        (n_lanes, n_joints),
        (n_lanes, n_joints + 1, 3),
        (detailed, n_joints, 4),
        (n_lanes, n_tendons),
        (n_lanes, n_tendons),
        (detailed, n_joints, n_tendons),
        (n_lanes, n_tendons),
        (detailed, n_joints, 2),
        (n_lanes if responses else 0, n_joints, n_tendons),
        (n_lanes,),
    )
    return RollingResults(*empty_arrays(shapes, n_lanes), np.empty(n_lanes, np.int64), np.empty(n_lanes, np.int64))


@part
def new_state(n_joints, n_tendons):
    """An empty State of floats."""
    return State(
        np.zeros(n_joints),
        np.zeros((n_joints, 8)),
        np.zeros((n_joints, n_tendons, 5)),
        np.zeros((n_joints + 1, 5)),
        np.zeros((n_joints, 4)),
        np.zeros((n_joints, 11)),
        np.zeros(n_tendons),
        np.zeros(n_tendons),
        np.zeros(n_tendons),
        np.zeros(n_joints),
    )


@formula(formulas.design, Chain)
def design(chain, which):
    """One design of a stack."""
    return Chain(
        chain.joints[which],
        chain.buckets[which],
        chain.cells,
        chain.coefficients,
        chain.arc_coefficients,
        chain.holes[which],
        chain.channels[which],
        chain.directions[which],
        chain.tendon_joints,
        chain.standing[which],
    )


@part
def evaluate_joints(chain, state):
    """Fill state.joint at state.angle; one configuration."""
    evaluate_rows(chain.joints, chain, state)


@part(inline=True)
def arc_length(chain, i, phi):
    """s of joint i at angle phi, clipped to the joint's limits [mm]."""
    low, high = chain.joints[i, 0], chain.joints[i, 1]
    cell, u = locate(chain.joints, chain.buckets, chain.cells, i, min(max(phi, low), high))
    s = 0.0
    for k in range(N_COEFFICIENTS - 1, -1, -1):
        s = s * u + chain.arc_coefficients[cell, k]
    return s


@part(inline=True)
def evaluate_gap(holes, i, j, joint, gap):
    """Fill gap[i, j]: length of the straight tendon segment, its first two derivatives in the angle, its direction."""
    x, y = holes[i, j, 2], holes[i, j, 3]
    above = (
        joint[i, GX] + joint[i, COS] * x - joint[i, SIN] * y,
        joint[i, GY] + joint[i, SIN] * x + joint[i, COS] * y,
    )
    below, contact, pole = (holes[i, j, 0], holes[i, j, 1]), (joint[i, CX], joint[i, CY]), (joint[i, PX], joint[i, PY])
    length, direction, per_length, closed = straight_gap(below, above)
    if any_lane(closed):
        direction = choose(closed, normal(joint, i), direction)
    gap[i, j, 0], (gap[i, j, 3], gap[i, j, 4]) = length, direction
    gap[i, j, 1], gap[i, j, 2] = gap_rates(1.0, below, length, direction, per_length, contact, pole)


@formula(formulas.evaluate_geometry, Chain)
def evaluate_geometry(chain, state):
    """Fill joints, gaps, tendon lengths, poses and contacts."""
    evaluate_joints(chain, state)
    evaluate_poses(chain.holes, chain.channels, chain.tendon_joints, state)


@part(inline=True)
def evaluate_poses(holes, channels, tendon_joints, state):
    """Fill gaps, tendon lengths, poses and contacts from state.joint."""
    pose, joint, contact, angle = state.pose, state.joint, state.contact, state.angle
    gap, length = state.gap, state.length
    for j in range(length.size):
        length[j] = channels[j]
    zero = 0.0 * angle[0]
    x, y, theta, cos, sin = zero, zero, zero, zero + 1.0, zero
    pose[0, X], pose[0, Y], pose[0, THETA], pose[0, C], pose[0, S] = x, y, theta, cos, sin
    for i in range(angle.size):
        for j in range(length.size):
            if i < tendon_joints[j]:
                evaluate_gap(holes, i, j, joint, gap)
                length[j] += gap[i, j, 0]
        contact[i, 0] = x + cos * joint[i, CX] - sin * joint[i, CY]
        contact[i, 1] = y + sin * joint[i, CX] + cos * joint[i, CY]
        contact[i, 2] = cos * joint[i, PX] - sin * joint[i, PY]
        contact[i, 3] = sin * joint[i, PX] + cos * joint[i, PY]
        x, y = x + cos * joint[i, GX] - sin * joint[i, GY], y + sin * joint[i, GX] + cos * joint[i, GY]
        cos, sin = cos * joint[i, COS] - sin * joint[i, SIN], sin * joint[i, COS] + cos * joint[i, SIN]
        theta = theta + angle[i]
        pose[i + 1, X], pose[i + 1, Y], pose[i + 1, THETA], pose[i + 1, C], pose[i + 1, S] = x, y, theta, cos, sin


@part(inline=True)
def evaluate_residual(tendon_joints, state):
    """Fill r; returns the largest sum of its terms' magnitudes, every tension with a lever of at least 1 mm."""
    sums, contact = state.sums, state.contact
    scale = 0.0 * state.angle[0]
    for i in range(state.residual.size):
        moment = sums[i, TURN] - (contact[i, 0] * sums[i, FY] - contact[i, 1] * sums[i, FX])
        size = fill_residual(tendon_joints, state, i, 0.0, moment)
        scale = where(size > scale, size, scale)
    return scale


@formula(formulas.evaluate_residual, Chain)
def residual_of(chain, state):
    """`evaluate_residual` of a chain."""
    return evaluate_residual(chain.tendon_joints, state)


@formula(formulas.torque, State)
def torque(state, i, j):
    """g'."""
    return state.gap[i, j, 1]


@formula(formulas.pivot, State)
def pivot(state, i):
    """The contact."""
    return state.contact[i, 0], state.contact[i, 1], 0.0


@formula(formulas.axis, State)
def axis(state, i):
    """The normal of the plane."""
    return 0.0, 0.0, 1.0


@formula(formulas.origin, State)
def origin(state, k):
    """A point of the plane."""
    return state.pose[k, X], state.pose[k, Y], 0.0


@formula(formulas.frame, State)
def frame(state, k):
    """A turn in the plane."""
    cos, sin = state.pose[k, C], state.pose[k, S]
    return cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0


@formula(formulas.own_stiffness, Chain)
def moving_contact(chain, state, i):
    """The contact of a joint moves as it turns, and with it the lever of the loads beyond it."""
    return state.contact[i, 2] * state.sums[i, FY] - state.contact[i, 3] * state.sums[i, FX]


register(Chain)


@part(inline=True)
def contact_forces(tendon_joints, state, tension, i):
    """Contact force on the distal link of joint i along tangent and normal; the unit tangent in the world, x and y.

    tension: of every tendon in the gap, (m,).
    """
    cos, sin = state.pose[i, C], state.pose[i, S]
    fx, fy = -state.sums[i, FX], -state.sums[i, FY]
    for j in range(tendon_joints.size):
        if i < tendon_joints[j]:
            vx, vy = state.gap[i, j, 3], state.gap[i, j, 4]
            fx = fx + tension[j] * (cos * vx - sin * vy)
            fy = fy + tension[j] * (sin * vx + cos * vy)
    rx, ry = state.contact[i, 2], state.contact[i, 3]  # against the tangent: the angle falls as s grows
    per_length = -1.0 / math.sqrt(rx * rx + ry * ry)
    ex, ey = rx * per_length, ry * per_length
    return fx * ex + fy * ey, fy * ex - fx * ey, ex, ey


@kernel(short_loops=True, title="the geometry of planar chains")
def arc_lengths_of(chain, designs, phi, s):
    """Fill s at joint angles phi, (B, J) both, of every lane's design."""
    for lane in range(phi.shape[0]):
        mechanism = design(chain, designs[lane])
        for i in range(phi.shape[1]):
            s[lane, i] = arc_length(mechanism, i, phi[lane, i])


@kernel(short_loops=True, title="the geometry of planar chains")
def poses_of(chain, phi, poses, lengths):
    """Fill poses (B, n, 3) and tendon lengths (B, m) at joint angles phi, (B, J), clipped to the surface limits."""
    n_lanes, n_joints = phi.shape
    mechanism, n_tendons = design(chain, 0), chain.tendon_joints.size
    state = new_state(n_joints, n_tendons)
    for lane in range(n_lanes):
        for i in range(n_joints):
            state.angle[i] = min(max(phi[lane, i], mechanism.joints[i, 0]), mechanism.joints[i, 1])
        evaluate_joints(mechanism, state)
        evaluate_poses(mechanism.holes, mechanism.channels, mechanism.tendon_joints, state)
        for k in range(n_joints + 1):
            for column in range(3):
                poses[lane, k, column] = state.pose[k, column]
        for j in range(n_tendons):
            lengths[lane, j] = state.length[j]
