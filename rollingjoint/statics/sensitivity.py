"""Derivatives of an equilibrium by the implicit function theorem: dphi/dx = -H⁻¹ dr/dx.

Joints at a limit stay there. After a step with friction the derivatives hold for inputs and loads under which sticking
holes go on sticking, and sliding ones sliding. Every function takes one Solution or a batch; it raises SolverError
unless all are stable equilibria, and InvalidInput where their stiffness is singular, or after a step with rolling
resistance.
Source: docs/theory.md, sections 4, 5 and 9.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rollingjoint.chain.solution import Solution
from rollingjoint.checks import as_choice
from rollingjoint.errors import InvalidInput
from rollingjoint.load import link_index

Array = NDArray[np.float64]


def dlengths_dtensions(equilibrium: Solution) -> Array:
    """d tendon lengths / d tensions, (m, m) [mm/N]: symmetric and, where stable, negative semidefinite."""
    return np.swapaxes(equilibrium.tendon_rates, -1, -2) @ _dangles_dtensions(equilibrium)


def dposes_dtensions(equilibrium: Solution) -> Array:
    """d link poses / d tensions, (n, 3, m) [mm/N, rad/N], the other tensions held."""
    return _dposes(equilibrium, _dangles_dtensions(equilibrium))


def dposes_dlengths(equilibrium: Solution) -> Array:
    """d link poses / d commanded lengths, (n, 3, m) [mm/mm, rad/mm]; zero for a slack or yielding tendon."""
    return _dposes(equilibrium, _dangles_dlengths(equilibrium))


def dtensions_dlengths(equilibrium: Solution) -> Array:
    """d tensions / d commanded lengths, (m, m) [N/mm]; a row or column of zeros for a slack or yielding tendon."""
    return _dtensions(equilibrium, _dangles_dlengths(equilibrium))


def dtip_dtensions(equilibrium: Solution) -> Array:
    """d tip position / d tensions, (2 or 3, m) [mm/N], the others held: part of dposes_dtensions, at less cost."""
    return _tip_jacobian(equilibrium) @ _dangles_dtensions(equilibrium)


def tip_and_tensions_dlengths(equilibrium: Solution) -> tuple[Array, Array]:
    """d tip position / d commanded lengths, (2 or 3, m) [mm/mm], and d tensions / d commanded lengths, (m, m) [N/mm].

    Parts of dposes_dlengths and all of dtensions_dlengths, at the cost of one of them for a single link.
    """
    dangles = _dangles_dlengths(equilibrium)
    return _tip_jacobian(equilibrium) @ dangles, _dtensions(equilibrium, dangles)


def dposes_dload(equilibrium: Solution, link: int, point: Sequence[float] | None = None) -> Array:
    """d link poses / d (force, moment) acting on a body point of a link, (n, 3, 3) [mm/N, rad/N, mm/(N·mm), ...].

    Planar: (fx, fy, moment); spatial: (fx, fy, fz, mx, my, mz), (n, 6, 6).

    Args:
        equilibrium: under given tensions or given lengths, which stay constant.
        link: the link on which the load acts, -1 is the tip.
        point: body point [mm]; default: the origin.
    Raises:
        InvalidInput: a link that does not exist.
    """
    jacobian = equilibrium.point_jacobian(link_index(link, equilibrium.tendon_rates.shape[-2] + 1), point)
    torque = np.swapaxes(jacobian, -1, -2)
    return _dposes(equilibrium, _respond(equilibrium, equilibrium.stiffness, torque))


def dtip_dforce(equilibrium: Solution, given: str = "lengths") -> Array:
    """d tip position / d force on it, (2 or 3, 2 or 3) [mm/N], symmetric where springs and loads have a potential.

    Args:
        given: "lengths", which stay constant, with tensions that neither yield nor are given; or "tensions".
    """
    as_choice("given", given, ("lengths", "tensions"))
    stiffness = equilibrium.stiffness if given == "lengths" else _stiffness_at_tensions(equilibrium)
    jacobian = _tip_jacobian(equilibrium)
    return jacobian @ _respond(equilibrium, stiffness, np.swapaxes(jacobian, -1, -2))


def dposes_dbase(equilibrium: Solution) -> Array:
    """d link poses / d motion of the base among walls, (n, 3, 3) [1, mm/rad, rad/mm, 1], at given inputs.

    Poses are in the base frame; the base moves in its own frame: x, y, turn about its origin; in space, (n, 6, 6), x,
    y, z and the three of the turn. Zeros without walls.
    """
    return _dposes(equilibrium, _dangles_dbase(equilibrium))


def dinsertion_dtensions(equilibrium: Solution) -> Array:
    """d insertion force / d tensions, (m,) [1], the other tensions held."""
    return _dinsertion(equilibrium, _dangles_dtensions(equilibrium))


def dinsertion_dlengths(equilibrium: Solution) -> Array:
    """d insertion force / d commanded lengths, (m,) [N/mm]."""
    return _dinsertion(equilibrium, _dangles_dlengths(equilibrium))


def dinsertion_dbase(equilibrium: Solution) -> Array:
    """d insertion force / d motion of the base in its own frame, (3,): x, y, turn [N/mm, N/rad], at given inputs.

    In space (6,): x, y, z and the three of the turn.
    """
    n_joints = equilibrium.joint_angles.shape[-1]
    held = -equilibrium.wall_force_rates[..., -1, n_joints:]
    return held + _dinsertion(equilibrium, _dangles_dbase(equilibrium))


def _dangles_dbase(equilibrium: Solution) -> Array:
    return _respond(equilibrium, equilibrium.stiffness, -equilibrium.base_torques)


def _dinsertion(equilibrium: Solution, dangles: Array) -> Array:
    """Chain d joint angles (n - 1, k) to d insertion force (k,)."""
    rates = equilibrium.wall_force_rates[..., -1, None, : dangles.shape[-2]]
    return -(rates @ dangles)[..., 0, :]


def _stiffness_at_tensions(equilibrium: Solution) -> Array:
    torques, rates, k = equilibrium.torques_per_tension, equilibrium.tendon_rates, equilibrium.tendon_stiffness
    return np.asarray(equilibrium.stiffness - (torques * k[..., None, :]) @ np.swapaxes(rates, -1, -2))


def _dangles_dtensions(equilibrium: Solution) -> Array:
    return _respond(equilibrium, _stiffness_at_tensions(equilibrium), -equilibrium.torques_per_tension)


def _dangles_dlengths(equilibrium: Solution) -> Array:
    return _respond(
        equilibrium, equilibrium.stiffness, equilibrium.torques_per_tension * equilibrium.tendon_stiffness[..., None, :]
    )


def _dtensions(equilibrium: Solution, dangles: Array) -> Array:
    """Chain d joint angles / d commanded lengths (n - 1, m) to d tensions (m, m)."""
    k = equilibrium.tendon_stiffness[..., :, None]
    dlengths = np.swapaxes(equilibrium.tendon_rates, -1, -2) @ dangles
    return np.asarray(k * (dlengths - np.eye(k.shape[-2])), float)


def _tip_jacobian(equilibrium: Solution) -> Array:
    """(2 or 3, n - 1) d tip position / d joint angles [mm/rad]."""
    jacobian = equilibrium.point_jacobian(equilibrium.tendon_rates.shape[-2])
    return jacobian[..., : equilibrium.tip.shape[-1], :]


def joint_response(
    equilibrium: Solution, stiffness: Array, torque: Array, free: NDArray[np.bool_] | None = None
) -> Array:
    """Change of the joint angles under joint torques, (n - 1, k) both [rad, N·mm], joints at a limit held.

    free: (n - 1,) joints that are not held, in place of those that are at no limit.

    Raises:
        numpy.linalg.LinAlgError: the stiffness of the free joints is singular.
    """
    free = equilibrium.free_joints if free is None else free
    coupled = free[..., :, None] & free[..., None, :]
    held = np.where(coupled, stiffness, 0.0) + np.eye(free.shape[-1]) * ~free[..., None, :]
    return np.asarray(np.linalg.solve(held, np.where(free[..., :, None], torque, 0.0)), float)


def _respond(equilibrium: Solution, stiffness: Array, torque: Array) -> Array:
    """joint_response of a stable equilibrium."""
    _refuse_rolling(equilibrium)
    try:
        return joint_response(equilibrium.require(), stiffness, torque)
    except np.linalg.LinAlgError:
        raise InvalidInput(
            "equilibrium",
            equilibrium.status,
            "a stiffness that can be inverted",
            "At constant tensions it is singular.",
        ) from None


def _refuse_rolling(equilibrium: Solution) -> None:
    """Raise InvalidInput after a step with rolling resistance: its stiffness neglects the turning of normal forces."""
    every = equilibrium.mechanism if isinstance(equilibrium.mechanism, tuple) else (equilibrium.mechanism,)
    if equilibrium.friction is not None and any(chain.rolling_coefficients[0] > 0.0 for chain in every):
        raise InvalidInput("equilibrium", equilibrium, "one without rolling resistance", "Its stiffness is not exact.")


def _dposes(equilibrium: Solution, dangles: Array) -> Array:
    """Chain d joint angles (n - 1, k) to d link poses (n, 3, k)."""
    return equilibrium.pose_jacobian @ dangles[..., None, :, :]
