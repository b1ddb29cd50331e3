"""The arrays of spatial hinge chains; tendon laws, status codes and tolerances are those of every family."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rollingjoint._numba.borrowed import borrow
from rollingjoint._numba.jit import part

EXACT, LINEAR, END_COUPLE = range(3)  # tendon models

# Columns of HingeState.pose: rotation matrix row by row, then the origin
PX, PY, PZ = 9, 10, 11
# Columns of a load table: body point, world force, world moment, body force, body moment, spring's stiffness and anchor
SPATIAL_LOAD_COLUMNS = (
    "link",
    *(f"{what}{axis}" for what in ("p", "f", "m", "b", "n") for axis in "xyz"),
    *("k", "ax", "ay", "az"),
)
LINK, POINT, FORCE, MOMENT, BODY_FORCE, BODY_MOMENT, SPRING, ANCHOR = map(
    SPATIAL_LOAD_COLUMNS.index, ("link", "px", "fx", "mx", "bx", "nx", "k", "ax")
)
N_COLUMNS = len(SPATIAL_LOAD_COLUMNS)
# Columns of HingeState.sums, sums over all loads beyond a hinge: dead force F, x outer F row by row, dead moment;
# follower force B, moment of follower loads about the origin
F, XF, M, B, TB, N_SUMS = 0, 3, 12, 15, 18, 21
# Columns of HingeState.held, sums over all springs beyond a hinge: k, k x, and k x outer x as xx, xy, xz, yy, yz, zz
K, KX, KXX, N_HELD = 0, 1, 4, 10


class Hinges(NamedTuple):
    """Chains of J hinges and m tendons: D designs of one topology; `hinge_design` takes one out, without the D.

    Link 0 is the base; hinge i carries link i + 1 and lies at the origin of link i, whose z axis points to the tip.
    """

    joints: np.ndarray  # (D, J, 3): smallest, largest and rest angle
    axes: np.ndarray  # (D, J, 3): unit axis in the link below
    springs: np.ndarray  # (D, J): N·mm/rad
    spacings: np.ndarray  # (D, J): from hinge i to the origin of link i + 1
    gaps: np.ndarray  # (D, J, m, 5): G, B, C of gap² = G - 2 (B cos + C sin); gap and slope at angle 0
    channels: np.ndarray  # (D, m): constant length inside the beads
    ends: np.ndarray  # (D, m, 2): hole of the last bead
    model: np.ndarray  # (D,): EXACT, LINEAR or END_COUPLE
    tendon_joints: np.ndarray  # (m,): number of hinges a tendon crosses


class HingeState(NamedTuple):
    """Everything evaluated at one configuration; axes and poses in the base frame."""

    angle: np.ndarray  # (J,)
    residual: np.ndarray  # (J,)
    pose: np.ndarray  # (J + 1, 12)
    axis: np.ndarray  # (J, 3)
    gap: np.ndarray  # (J, m, 3): g, g', g''
    torque: np.ndarray  # (J, m): moment about the hinge per tension; g' unless the model is END_COUPLE
    sums: np.ndarray  # (J, N_SUMS)
    held: np.ndarray  # (J, N_HELD)
    length: np.ndarray  # (m,)
    tension: np.ndarray  # (m,)
    elastic: np.ndarray  # (m,): d tension / d length


class HingeResults(NamedTuple):
    """Outputs of B lanes."""

    joint_angles: np.ndarray  # (B, J)
    poses: np.ndarray  # (B, J + 1, 4, 4)
    tensions: np.ndarray  # (B, m)
    lengths: np.ndarray  # (B, m)
    rates: np.ndarray  # (B, J, m) d length / d joint angle
    torques: np.ndarray  # (B, J, m) d residual / d tension
    elastic: np.ndarray  # (B, m) d tension / d length
    residual: np.ndarray  # (B,)
    iterations: np.ndarray  # (B,)
    status: np.ndarray  # (B,)
    escapes: np.ndarray  # (B,) unstable equilibria that were left on the way


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


@part(inline=True)
def hinge_design(chain, which):
    """One design of a stack, without reference counts."""
    return Hinges(
        borrow(chain.joints)[which],
        borrow(chain.axes)[which],
        borrow(chain.springs)[which],
        borrow(chain.spacings)[which],
        borrow(chain.gaps)[which],
        borrow(chain.channels)[which],
        borrow(chain.ends)[which],
        chain.model[which],
        borrow(chain.tendon_joints),
    )


@part(inline=True)
def borrow_hinge_state(state):
    """The state without reference counts."""
    return HingeState(
        borrow(state.angle),
        borrow(state.residual),
        borrow(state.pose),
        borrow(state.axis),
        borrow(state.gap),
        borrow(state.torque),
        borrow(state.sums),
        borrow(state.held),
        borrow(state.length),
        borrow(state.tension),
        borrow(state.elastic),
    )


@part(inline=True)
def borrow_hinge_results(results):
    """The results without reference counts."""
    return HingeResults(
        borrow(results.joint_angles),
        borrow(results.poses),
        borrow(results.tensions),
        borrow(results.lengths),
        borrow(results.rates),
        borrow(results.torques),
        borrow(results.elastic),
        borrow(results.residual),
        borrow(results.iterations),
        borrow(results.status),
        borrow(results.escapes),
    )
