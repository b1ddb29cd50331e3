"""The arrays that kernels share, grouped by name.

A kernel on states takes arrays of floats, one configuration, or of SIMD lanes, eight configurations side by side
(simd.py); the shapes below hold for both.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from rollingjoint._numba.jit import part
from rollingjoint._numba.layout import Floats, Integers
from rollingjoint.kernels.shared import formulas
from rollingjoint.kernels.shared.arrays import TendonLaw, empty_arrays
from rollingjoint.kernels.shared.formulas import formula

N_COEFFICIENTS = 10  # polynomial coefficients per cell of a joint table
BUCKETS = 64  # equal parts of a joint's angles in which cells are looked up
BUCKET_ENDS = 2 * BUCKETS

# Columns of State.joint, in the proximal link's frame: cos and sin of the angle, contact point, origin of the distal
# link, rate d contact point / d angle
COS, SIN, CX, CY, GX, GY, PX, PY = range(8)
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
    """Everything evaluated at one configuration."""

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


class Results(NamedTuple):
    """Outputs of B lanes; those with B or 0 lanes are left out where they have none."""

    joint_angles: Annotated[Floats, "B", "J"]
    poses: Annotated[Floats, "B", "n", 3]
    contacts: Annotated[Floats, "B or 0", "J", 4]  # point and unit tangent, world frame
    tensions: Annotated[Floats, "B", "m"]
    lengths: Annotated[Floats, "B", "m"]
    rates: Annotated[Floats, "B or 0", "J", "m"]  # d length / d joint angle
    elastic: Annotated[Floats, "B", "m"]  # d tension / d length
    contact_forces: Annotated[Floats, "B or 0", "J", 2]
    responses: Annotated[Floats, "B or none", "J", "m"]  # d joint angle / d command; zero from the solver for all cases
    residual: Annotated[Floats, "B"]
    iterations: Annotated[Integers, "B"]
    status: Annotated[Integers, "B"]


class BatchArrays(NamedTuple):
    """Equilibria to be solved as a batch, and where they go."""

    chain: Chain  # a stack
    designs: Annotated[Integers, "B"]  # which of the stacked designs each lane has
    laws: Annotated[TendonLaw, "B"]
    loads: Annotated[Floats, "B", "rows", "columns"]
    starts: Annotated[Floats, "B", "J"]  # joint angles to start from, rad
    results: Results


class PinnedBatch(NamedTuple):
    """A batch as kernels take it that are called again and again."""

    batch: BatchArrays
    memory: Annotated[Floats, "words"]  # in which a batch of one row is solved; empty for others


def new_results(n_lanes: int, n_joints: int, n_tendons: int, contacts: bool = True, responses: bool = False) -> Results:
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
    return Results(*empty_arrays(shapes, n_lanes), np.empty(n_lanes, np.int64), np.empty(n_lanes, np.int64))


def aligned(values: np.ndarray) -> np.ndarray:
    """A copy that begins at a multiple of 64 bytes, so that a table's row of eight numbers lies in one cache line."""
    memory = np.empty(values.nbytes + 64, np.uint8)
    start = -memory.ctypes.data % 64
    copy = memory[start : start + values.nbytes].view(values.dtype).reshape(values.shape)
    copy[...] = values
    return copy


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
