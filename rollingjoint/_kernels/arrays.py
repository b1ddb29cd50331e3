"""The arrays that kernels share, grouped by name."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rollingjoint._jit import kernel

N_COEFFICIENTS = 12  # polynomial coefficients per cell of a joint table
PHI, XC, YC, XP, YP = range(5)  # functions tabulated over s: relative angle, child point, parent point

# Columns of State.joint
ANGLE, KAPPA, CX, CY, EX, EY, COS, SIN, GX, GY = range(10)
# Columns of State.pose
X, Y, THETA, C, S = range(5)
# Columns of State.sums: sums over all loads beyond a joint (F force, x point, b follower force, k spring)
FX, FY, X_CROSS_F, X_DOT_F, MOMENT, BX, BY, X_DOT_B, K, KX, KY, K_XX = range(12)

# Status codes, the values of equilibrium.Status
CONVERGED, AT_LIMIT, INDETERMINATE, UNSTABLE, NOT_CONVERGED, INVALID_INPUT = range(6)


class Chain(NamedTuple):
    """A planar rolling chain of n links, J = n - 1 joints and m tendons."""

    cell_first: np.ndarray  # (J + 1,) first cell of each joint's table
    cells: np.ndarray  # (cells, 4): s and phi at both ends of a cell
    coefficients: np.ndarray  # (cells, 12, 5) ascending powers of the cell's coordinate in [-1, 1]
    angle_terms: int  # coefficients that the relative angle needs; the other ones are zero in every cell
    child_holes: np.ndarray  # (J, m, 2) hole on the proximal link
    parent_holes: np.ndarray  # (J, m, 2) hole on the distal link
    tendon_joints: np.ndarray  # (m,) number of joints a tendon crosses
    channels: np.ndarray  # (m,) constant length inside the links


class TendonLaw(NamedTuple):
    """tension = clip(stiffness (length - command), low, high); low = high prescribes the tension."""

    command: np.ndarray  # (m,)
    stiffness: np.ndarray  # (m,)
    low: np.ndarray  # (m,)
    high: np.ndarray  # (m,)


class State(NamedTuple):
    """Everything evaluated at one configuration."""

    joint: np.ndarray  # (J, 10)
    gap: np.ndarray  # (J, m, 3): g, g', g''
    pose: np.ndarray  # (n, 5)
    contact: np.ndarray  # (J, 4): contact point and unit tangent, world frame
    sums: np.ndarray  # (J, 12)
    length: np.ndarray  # (m,)
    tension: np.ndarray  # (m,)
    elastic: np.ndarray  # (m,): d tension / d length
    residual: np.ndarray  # (J,)


@kernel
def new_state(n_joints, n_tendons):
    """An empty State."""
    return State(
        np.zeros((n_joints, 10)),
        np.zeros((n_joints, n_tendons, 3)),
        np.zeros((n_joints + 1, 5)),
        np.zeros((n_joints, 4)),
        np.zeros((n_joints, 12)),
        np.zeros(n_tendons),
        np.zeros(n_tendons),
        np.zeros(n_tendons),
        np.zeros(n_joints),
    )
