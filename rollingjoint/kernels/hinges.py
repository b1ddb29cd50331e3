"""Arms of beads on elastic hinges: their arrays, poses, gaps and tendon lengths.

Symbols as in docs/theory.md: a axis, c hinge. Functions of states serve floats and lanes alike.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from rollingjoint._numba.borrowed import borrow
from rollingjoint._numba.jit import part
from rollingjoint._numba.layout import Floats, Integers
from rollingjoint._numba.simd import where
from rollingjoint.kernels import formulas
from rollingjoint.kernels.arrays import TendonLaw
from rollingjoint.kernels.chain import register
from rollingjoint.kernels.elementary import sine_and_cosine
from rollingjoint.kernels.formulas import formula
from rollingjoint.kernels.vectors import dot, in_space, plus, times

EXACT, LINEAR, END_COUPLE = range(3)  # tendon models

# Columns of HingeState.pose: rotation matrix row by row, then the origin
PX, PY, PZ = 9, 10, 11
# Columns of a load table: body point, world force, world moment, body force, body moment, spring's stiffness and
# anchor, torsion spring (torsion_springs.py)
SPATIAL_LOAD_COLUMNS = (
    "link",
    *(f"{what}{axis}" for what in ("p", "f", "m", "b", "n") for axis in "xyz"),
    *("k", "ax", "ay", "az", "torsion", "rest", "other"),
)
LINK, POINT, FORCE, MOMENT, BODY_FORCE, BODY_MOMENT, SPRING, ANCHOR, TORSION, REST, OTHER = map(
    SPATIAL_LOAD_COLUMNS.index, ("link", "px", "fx", "mx", "bx", "nx", "k", "ax", "torsion", "rest", "other")
)
N_COLUMNS = len(SPATIAL_LOAD_COLUMNS)
N_DEAD = MOMENT  # columns of the table of dead loads of lanes: as in a load table up to the force
# Columns of HingeState.sums, sums over all loads beyond a hinge: dead force F, x outer F row by row, dead moment;
# follower force B, moment of follower loads about the origin; moment of torsion springs about the hinge
F, XF, M, B, TB, TWIST, N_SUMS = 0, 3, 12, 15, 18, 21, 22
N_DEAD_SUMS = M
# Columns of Hinges.turns: the segment of a tendon at angle 0, the same in the frames of the links below and above its
# hinge; its change per sin and per 1 - cos in the frame below, and in the frame above; 1 where the channels below
# and above are in line and across the axis, so that both turns are half the angle
IN_BELOW, IN_ABOVE, HALVES, N_TURNS = 3, 9, 15, 16
# Columns of HingeState.held, sums over all springs beyond a hinge: k, k x, and k x outer x as xx, xy, xz, yy, yz, zz
K, KX, KXX, N_HELD = 0, 1, 4, 10


class Hinges(NamedTuple):
    """Chains of J hinges and m tendons: D designs of one topology; `design` takes one out, without the D.

    Link 0 is the base; hinge i carries link i + 1 and lies at the origin of link i; z axes of links point to the tip.
    """

    joints: Annotated[Floats, "D", "J", 3]  # smallest, largest and rest angle
    axes: Annotated[Floats, "D", "J", 3]  # unit axis in the link below
    springs: Annotated[Floats, "D", "J"]  # N·mm/rad
    spacings: Annotated[Floats, "D", "J"]  # from hinge i to the origin of link i + 1
    gaps: Annotated[Floats, "D", "J", "m", 5]  # G, B, C of gap² = G - 2 (B cos + C sin); gap and slope at angle 0
    channels: Annotated[Floats, "D", "m"]  # constant length inside the beads
    ends: Annotated[Floats, "D", "m", 2]  # hole of the last bead
    model: Annotated[Integers, "D"]  # EXACT, LINEAR or END_COUPLE
    tendon_joints: Annotated[Integers, "m"]  # number of hinges a tendon crosses
    turns: Annotated[Floats, "D", "J", "m", N_TURNS]  # segment from the hole below to the hole above
    standing: Annotated[Floats, "D", "standing", N_COLUMNS] = np.zeros((1, 0, N_COLUMNS))  # load table of its springs


class HingeState(NamedTuple):
    """Quantities of one configuration; axes and poses in the base frame."""

    angle: Annotated[Floats, "J"]
    residual: Annotated[Floats, "J"]
    pose: Annotated[Floats, "n", 12]
    axis: Annotated[Floats, "J", 3]
    gap: Annotated[Floats, "J", "m", 3]  # g, g', g''
    torque: Annotated[Floats, "J", "m"]  # moment about the hinge per tension; g' unless the model is END_COUPLE
    sums: Annotated[Floats, "J", "sums"]  # N_SUMS; N_DEAD_SUMS where only dead forces act
    held: Annotated[Floats, "J", "held"]  # N_HELD; 0 where no springs act
    length: Annotated[Floats, "m"]
    tension: Annotated[Floats, "m"]
    elastic: Annotated[Floats, "m"]  # d tension / d length


class HingeResults(NamedTuple):
    """Outputs of B lanes."""

    joint_angles: Annotated[Floats, "B", "J"]
    poses: Annotated[Floats, "B", "n", 4, 4]
    tensions: Annotated[Floats, "B", "m"]
    lengths: Annotated[Floats, "B", "m"]
    rates: Annotated[Floats, "B", "J", "m"]  # d length / d joint angle
    torques: Annotated[Floats, "B", "J", "m"]  # d residual / d tension
    elastic: Annotated[Floats, "B", "m"]  # d tension / d length
    residual: Annotated[Floats, "B"]
    iterations: Annotated[Integers, "B"]
    status: Annotated[Integers, "B"]
    escapes: Annotated[Integers, "B"]  # unstable equilibria that were left on the way


class HingeBatchArrays(NamedTuple):
    """Inputs and results of a batch."""

    chain: Hinges  # a stack
    designs: Annotated[Integers, "B"]  # index of each lane's design in the stack
    laws: Annotated[TendonLaw, "B"]
    loads: Annotated[Floats, "B", "rows", N_COLUMNS]
    starts: Annotated[Floats, "B", "J"]  # joint angles to start from, rad
    results: HingeResults


class PinnedHinges(NamedTuple):
    """A batch for kernels that are called repeatedly."""

    batch: HingeBatchArrays
    memory: Annotated[Floats, "words"]  # scratch space of a batch of one row; else empty


def new_hinge_results(n_lanes: int, n_joints: int, n_tendons: int) -> HingeResults:
    """Empty outputs."""
    crossing = (n_lanes, n_joints, n_tendons)
    shapes = ((n_lanes, n_joints), (n_lanes, n_joints + 1, 4, 4), *2 * ((n_lanes, n_tendons),), *2 * (crossing,))
    numbers = map(np.empty, (*shapes, (n_lanes, n_tendons), (n_lanes,)))
    return HingeResults(*numbers, *(np.empty(n_lanes, np.int64) for _ in range(3)))


@part
def new_hinge_state(n_joints, n_tendons):
    """An empty HingeState."""
    return HingeState(
        np.zeros(n_joints),
        np.zeros(n_joints),
        np.zeros((n_joints + 1, 12)),
        np.zeros((n_joints, 3)),
        np.zeros((n_joints, n_tendons, 3)),
        np.zeros((n_joints, n_tendons)),
        np.zeros((n_joints, N_SUMS)),
        np.zeros((n_joints, N_HELD)),
        np.zeros(n_tendons),
        np.zeros(n_tendons),
        np.zeros(n_tendons),
    )


@formula(formulas.design, Hinges)
def design(chain, which):
    """One design of a stack, without reference counts."""
    chain = borrow(chain)
    return Hinges(
        chain.joints[which],
        chain.axes[which],
        chain.springs[which],
        chain.spacings[which],
        chain.gaps[which],
        chain.channels[which],
        chain.ends[which],
        chain.model[which],
        chain.tendon_joints,
        chain.turns[which],
        chain.standing[which],
    )


@part(inline=True)
def turned(pose, k, vector):
    """A vector of link k's frame in the base frame."""
    return dot(in_space(pose, k, 0), vector), dot(in_space(pose, k, 3), vector), dot(in_space(pose, k, 6), vector)


@part(inline=True)
def placed(pose, k, point):
    """A body point of link k in the base frame."""
    return plus(turned(pose, k, point), in_space(pose, k, PX))


@formula(formulas.evaluate_geometry, Hinges)
def geometry_of(chain, state):
    """`evaluate_geometry` of a chain."""
    exact = chain.model == EXACT
    evaluate_geometry(chain.axes, chain.spacings, chain.gaps, chain.channels, exact, chain.tendon_joints, state)


@part(inline=True)
def evaluate_hinges(joints, springs, state):
    """Energy of the hinges' springs."""
    energy = 0.0 * state.angle[0]
    for i in range(state.angle.size):
        turn = state.angle[i] - joints[i, 2]
        energy = energy + 0.5 * springs[i] * (turn * turn)
    return energy


@part(inline=True)
def evaluate_geometry(axes, spacings, gaps, channels, exact, tendon_joints, state):
    """Fill poses, axes, gaps, torques and tendon lengths; the arrays are of a Hinges or of lanes."""
    pose, axis, angle, length = state.pose, state.axis, state.angle, state.length
    zero = 0.0 * angle[0]
    for j in range(length.size):
        length[j] = channels[j]
    for entry in range(12):
        pose[0, entry] = zero + 1.0 if entry == 0 or entry == 4 or entry == 8 else zero
    for i in range(angle.size):
        sin, cos = sine_and_cosine(angle[i])
        x, y, z = in_space(axes, i, 0)
        axis[i, 0], axis[i, 1], axis[i, 2] = turned(pose, i, (x, y, z))
        versine = 1.0 - cos
        columns = (
            (cos + versine * x * x, versine * x * y + sin * z, versine * x * z - sin * y),
            (versine * x * y - sin * z, cos + versine * y * y, versine * y * z + sin * x),
            (versine * x * z + sin * y, versine * y * z - sin * x, cos + versine * z * z),
        )
        for column in range(3):
            turned_column = turned(pose, i, columns[column])
            for row in range(3):
                pose[i + 1, 3 * row + column] = turned_column[row]
        origin = plus(in_space(pose, i, PX), times(turned(pose, i, columns[2]), spacings[i]))
        pose[i + 1, PX], pose[i + 1, PX + 1], pose[i + 1, PX + 2] = origin
        for j in range(length.size):
            if i < tendon_joints[j]:
                _evaluate_gap(gaps, exact, state, i, j, sin, cos)
                length[j] += state.gap[i, j, 0]


@part(inline=True)
def _evaluate_gap(gaps, exact, state, i, j, sin, cos):
    """Fill length, rates and torque of a gap: gap² = G - 2 (B cos + C sin), or linear in the angle."""
    gap = state.gap
    if exact:
        b, c = gaps[i, j, 1], gaps[i, j, 2]
        along = b * cos + c * sin
        square = gaps[i, j, 0] - 2.0 * along
        gap[i, j, 0] = math.sqrt(where(square > 0.0, square, 0.0))
        inverse = 1.0 / gap[i, j, 0]
        gap[i, j, 1] = (b * sin - c * cos) * inverse
        gap[i, j, 2] = (along - gap[i, j, 1] * gap[i, j, 1]) * inverse
    else:
        gap[i, j, 1], gap[i, j, 2] = gaps[i, j, 4], 0.0 * state.angle[i]
        gap[i, j, 0] = gaps[i, j, 3] + gap[i, j, 1] * state.angle[i]
    state.torque[i, j] = gap[i, j, 1]


@formula(formulas.torque, HingeState)
def torque(state, i, j):
    """g', or the torque of an end couple."""
    return state.torque[i, j]


@formula(formulas.pivot, HingeState)
def pivot(state, i):
    """The hinge, at the origin of the link below."""
    return in_space(state.pose, i, PX)


@formula(formulas.own_stiffness, Hinges)
def own_stiffness(chain, state, i):
    """The spring of a hinge."""
    return chain.springs[i]


register(Hinges)
