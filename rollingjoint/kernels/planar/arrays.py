"""The arrays that kernels share, grouped by name.

A kernel on states takes arrays of floats, one configuration, or arrays of Lanes, eight configurations side by side
(simd.py); the shapes below hold for both.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from rollingjoint._numba.borrowed import borrow, carve, pinned_floats, pinned_integers
from rollingjoint._numba.jit import part
from rollingjoint.kernels.shared.arrays import TendonLaw

N_COEFFICIENTS = 10  # polynomial coefficients per cell of a joint table
BUCKETS = 64  # equal parts of a joint's angles in which cells are looked up
EDGES = BUCKETS + 1
_MANY_LANES = 1024

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

    joints: np.ndarray  # (D, J, 3): smallest and largest angle, buckets per radian
    buckets: np.ndarray  # (D, J, BUCKETS + 1): first cell of every bucket, and the last cell
    cells: np.ndarray  # (cells, 4): smallest and largest angle, middle, 2 / width
    coefficients: np.ndarray  # (cells, 10, 8): State.joint in ascending powers of the cell's coordinate in [-1, 1]
    arc_coefficients: np.ndarray  # (cells, 10): arc length, likewise
    holes: np.ndarray  # (D, J, m, 4): x, y of the hole on the proximal link, x, y on the distal link
    channels: np.ndarray  # (D, m): constant length inside the links
    tendon_joints: np.ndarray  # (m,): number of joints a tendon crosses
    standing: np.ndarray  # (D, rows, columns): load table of the springs that belong to the mechanism


class State(NamedTuple):
    """Everything evaluated at one configuration."""

    angle: np.ndarray  # (J,)
    joint: np.ndarray  # (J, 8)
    gap: np.ndarray  # (J, m, 5): g, g', g'', direction of the segment in the proximal link's frame
    pose: np.ndarray  # (n, 5)
    contact: np.ndarray  # (J, 4): contact point and its rate d / d angle, world frame
    sums: np.ndarray  # (J, 11); (J, 4) where only dead forces and moments act
    length: np.ndarray  # (m,)
    tension: np.ndarray  # (m,)
    elastic: np.ndarray  # (m,): d tension / d length
    residual: np.ndarray  # (J,)


class Results(NamedTuple):
    """Outputs of B lanes; those with B or 0 lanes are left out where they have none."""

    joint_angles: np.ndarray  # (B, J)
    poses: np.ndarray  # (B, n, 3)
    contacts: np.ndarray  # (B or 0, J, 4) point and unit tangent, world frame
    tensions: np.ndarray  # (B, m)
    lengths: np.ndarray  # (B, m)
    rates: np.ndarray  # (B or 0, J, m) d length / d joint angle
    elastic: np.ndarray  # (B, m) d tension / d length
    contact_forces: np.ndarray  # (B or 0, J, 2)
    responses: np.ndarray  # (B or 0, J, m) d joint angle / d command; zero from the solver for all cases
    residual: np.ndarray  # (B,)
    iterations: np.ndarray  # (B,)
    status: np.ndarray  # (B,)


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
    numbers = map(np.empty, shapes) if n_lanes < _MANY_LANES else _in_one_piece(shapes)
    return Results(*numbers, np.empty(n_lanes, np.int64), np.empty(n_lanes, np.int64))


def _in_one_piece(shapes: Sequence[tuple[int, ...]]) -> Iterator[np.ndarray]:
    """Empty arrays in one allocation: the system hands out large memory in large pages, which is much faster."""
    ends = list(itertools.accumulate(math.prod(shape) for shape in shapes))
    memory = np.empty(ends[-1])
    for shape, end in zip(shapes, ends, strict=True):
        yield memory[end - math.prod(shape) : end].reshape(shape)


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


@part(inline=True)
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
        chain.tendon_joints,
        chain.standing[which],
    )


@part(inline=True)
def state_size(n_joints, n_tendons, n_sums):
    """How many numbers a State takes."""
    return n_joints * (10 + 5 * n_tendons + 4 + n_sums) + 5 * (n_joints + 1) + 3 * n_tendons


@part(inline=True)
def carve_state(memory, at, n_joints, n_tendons, n_sums):
    """A State in borrowed memory, from element `at` on."""
    angle = at
    joint = angle + n_joints
    gap = joint + 8 * n_joints
    pose = gap + 5 * n_joints * n_tendons
    contact = pose + 5 * (n_joints + 1)
    sums = contact + 4 * n_joints
    tendons = sums + n_sums * n_joints
    return State(
        carve(memory, angle, (n_joints,)),
        carve(memory, joint, (n_joints, 8)),
        carve(memory, gap, (n_joints, n_tendons, 5)),
        carve(memory, pose, (n_joints + 1, 5)),
        carve(memory, contact, (n_joints, 4)),
        carve(memory, sums, (n_joints, n_sums)),
        carve(memory, tendons, (n_tendons,)),
        carve(memory, tendons + n_tendons, (n_tendons,)),
        carve(memory, tendons + 2 * n_tendons, (n_tendons,)),
        carve(memory, tendons + 3 * n_tendons, (n_joints,)),
    )


@part(inline=True)
def borrow_chain(chain):
    """The chain without reference counts."""
    return Chain(
        borrow(chain.joints),
        borrow(chain.buckets),
        borrow(chain.cells),
        borrow(chain.coefficients),
        borrow(chain.arc_coefficients),
        borrow(chain.holes),
        borrow(chain.channels),
        borrow(chain.tendon_joints),
        borrow(chain.standing),
    )


@part(inline=True)
def borrow_results(results):
    """The results without reference counts."""
    return Results(
        borrow(results.joint_angles),
        borrow(results.poses),
        borrow(results.contacts),
        borrow(results.tensions),
        borrow(results.lengths),
        borrow(results.rates),
        borrow(results.elastic),
        borrow(results.contact_forces),
        borrow(results.responses),
        borrow(results.residual),
        borrow(results.iterations),
        borrow(results.status),
    )


@part(inline=True)
def borrow_state(state):
    """The state without reference counts."""
    return State(
        borrow(state.angle),
        borrow(state.joint),
        borrow(state.gap),
        borrow(state.pose),
        borrow(state.contact),
        borrow(state.sums),
        borrow(state.length),
        borrow(state.tension),
        borrow(state.elastic),
        borrow(state.residual),
    )


@part(inline=True)
def pinned_problem(pins):
    """(chain, designs, laws, loads, starts, results) from their addresses, pinned in this order."""
    chain = Chain(
        pinned_floats(pins, 0, 3),
        pinned_integers(pins, 1, 3),
        pinned_floats(pins, 2, 2),
        pinned_floats(pins, 3, 3),
        pinned_floats(pins, 4, 2),
        pinned_floats(pins, 5, 4),
        pinned_floats(pins, 6, 2),
        pinned_integers(pins, 7, 1),
        pinned_floats(pins, 8, 3),
    )
    designs = pinned_integers(pins, 9, 1)
    laws = TendonLaw(
        pinned_floats(pins, 10, 2), pinned_floats(pins, 11, 2), pinned_floats(pins, 12, 2), pinned_floats(pins, 13, 2)
    )
    loads, starts = pinned_floats(pins, 14, 3), pinned_floats(pins, 15, 2)
    results = Results(
        pinned_floats(pins, 16, 2),
        pinned_floats(pins, 17, 3),
        pinned_floats(pins, 18, 3),
        pinned_floats(pins, 19, 2),
        pinned_floats(pins, 20, 2),
        pinned_floats(pins, 21, 3),
        pinned_floats(pins, 22, 2),
        pinned_floats(pins, 23, 3),
        pinned_floats(pins, 24, 3),
        pinned_floats(pins, 25, 1),
        pinned_integers(pins, 26, 1),
        pinned_integers(pins, 27, 1),
    )
    return chain, designs, laws, loads, starts, results
