"""Derivatives of an equilibrium by the implicit function theorem: dphi/dx = -H⁻¹ dr/dx.

Joints whose contact is at the end of a surface stay there. Every function takes one Equilibrium or a batch.
Source: docs/theory.md, sections 4 and 5.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rollingjoint.equilibrium import Equilibrium
from rollingjoint.errors import InvalidInput
from rollingjoint.load import link_index

Array = NDArray[np.float64]


def dlengths_dtensions(equilibrium: Equilibrium) -> Array:
    """d tendon lengths / d tensions, (m, m) [mm/N]: symmetric, negative semidefinite where the equilibrium is stable.

    Raises:
        SolverError: when the equilibrium is not stable.
    """
    return np.swapaxes(equilibrium.tendon_rates, -1, -2) @ _dangles_dtensions(equilibrium)


def dposes_dtensions(equilibrium: Equilibrium) -> Array:
    """d link poses / d tensions, (n, 3, m) [mm/N, rad/N], the other tensions held.

    Raises:
        SolverError: when the equilibrium is not stable.
    """
    return _dposes(equilibrium, _dangles_dtensions(equilibrium))


def dposes_dlengths(equilibrium: Equilibrium) -> Array:
    """d link poses / d commanded lengths, (n, 3, m) [mm/mm, rad/mm]; zero for a slack or yielding tendon.

    Raises:
        SolverError: when the equilibrium is not stable.
    """
    return _dposes(equilibrium, _dangles_dlengths(equilibrium))


def dtensions_dlengths(equilibrium: Equilibrium) -> Array:
    """d tensions / d commanded lengths, (m, m) [N/mm]; a row or column of zeros for a slack or yielding tendon.

    Raises:
        SolverError: when the equilibrium is not stable.
    """
    k = equilibrium.tendon_stiffness[..., :, None]
    dlengths = np.swapaxes(equilibrium.tendon_rates, -1, -2) @ _dangles_dlengths(equilibrium)
    return k * (dlengths - np.eye(k.shape[-2]))


def dposes_dload(equilibrium: Equilibrium, link: int, point: tuple[float, float] = (0.0, 0.0)) -> Array:
    """d link poses / d (fx, fy, moment) acting on a body point of a link, (n, 3, 3) [mm/N, rad/N, mm/(N·mm), ...].

    Args:
        equilibrium: under given tensions or given lengths; the other input stays as it was given.
        link: where the load acts, -1 is the tip.
        point: body point [mm].
    Raises:
        SolverError: when the equilibrium is not stable.
        InvalidInput: a link that does not exist.
    """
    link = link_index(link, equilibrium.poses.shape[-2])
    pose = equilibrium.poses[..., link, :]
    cos, sin = np.cos(pose[..., 2]), np.sin(pose[..., 2])
    where = pose[..., :2] + np.stack([cos * point[0] - sin * point[1], sin * point[0] + cos * point[1]], axis=-1)
    arm = where[..., None, :] - equilibrium.contact_points
    torque = np.stack([-arm[..., 1], arm[..., 0], np.ones_like(arm[..., 0])], axis=-1)
    torque[..., link:, :] = 0.0
    return _dposes(equilibrium, _respond(equilibrium, equilibrium.stiffness, torque))


def _dangles_dtensions(equilibrium: Equilibrium) -> Array:
    rates, k = equilibrium.tendon_rates, equilibrium.tendon_stiffness
    tension_stiffness = equilibrium.stiffness - (rates * k[..., None, :]) @ np.swapaxes(rates, -1, -2)
    return _respond(equilibrium, tension_stiffness, -rates)


def _dangles_dlengths(equilibrium: Equilibrium) -> Array:
    return _respond(
        equilibrium, equilibrium.stiffness, equilibrium.tendon_rates * equilibrium.tendon_stiffness[..., None, :]
    )


def joint_response(equilibrium: Equilibrium, stiffness: Array, torque: Array) -> Array:
    """Change of the joint angles under joint torques, (n - 1, k) both [rad, N·mm], joints at a limit held.

    Raises:
        numpy.linalg.LinAlgError: the stiffness of the free joints is singular.
    """
    free = equilibrium.free_joints
    both = free[..., :, None] & free[..., None, :]
    held = np.where(both, stiffness, 0.0) + np.eye(free.shape[-1]) * ~free[..., None, :]
    return np.asarray(np.linalg.solve(held, np.where(free[..., :, None], torque, 0.0)), float)


def _respond(equilibrium: Equilibrium, stiffness: Array, torque: Array) -> Array:
    """joint_response of a stable equilibrium."""
    try:
        return joint_response(equilibrium.require(), stiffness, torque)
    except np.linalg.LinAlgError:
        raise InvalidInput(
            "equilibrium",
            equilibrium.status,
            "a stiffness that can be inverted",
            "With the tensions held it is singular.",
        ) from None


def _dposes(equilibrium: Equilibrium, dangles: Array) -> Array:
    """Chain d joint angles (n - 1, k) to d link poses (n, 3, k)."""
    arm = equilibrium.poses[..., :, None, :2] - equilibrium.contact_points[..., None, :, :]
    n = equilibrium.poses.shape[-2]
    moves = np.tri(n, n - 1, -1)  # joint i moves link k > i
    jacobian = np.stack([-arm[..., 1] * moves, arm[..., 0] * moves, np.broadcast_to(moves, arm.shape[:-1])], axis=-2)
    return jacobian @ dangles[..., None, :, :]
