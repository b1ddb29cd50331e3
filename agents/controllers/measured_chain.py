"""A planar chain at its measured poses and tensions, and the load estimated from them."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from agents.evaluation.controller import Array, Seen
from rj_gym.core.tracking_task import TrackingTask
from rollingjoint.chain.equilibrium import Equilibrium
from rollingjoint.chain.rolling import RollingChain
from rollingjoint.load import LOAD_COLUMNS
from rollingjoint.statics.solve import solve_lengths_batch

_LINK, _FX, _MOMENT = (LOAD_COLUMNS.index(name) for name in ("link", "fx", "moment"))
_TURN = 1e-5  # rad, of central differences


class Measurement(Protocol):
    """A pose and tensions of the same moment, as Seen has them."""

    @property
    def joint_angles(self) -> Array:
        """(B, n - 1) [rad]."""

    @property
    def tensions(self) -> Array:
        """(B, m) [N]."""


class MeasuredChain:
    """A planar chain, of which the poses of all links are measured."""

    nominal_loads = ()
    stiffens = True  # nothing but tensions holds the links together

    def __init__(self, task: TrackingTask, episodes: int) -> None:
        self.mechanism: RollingChain = task.mechanism

    def unloaded(self, seen: Seen) -> Equilibrium:
        """The model at the measured pose and tensions, B rows."""
        return measured_equilibrium(self.mechanism, seen)

    def loaded(self, seen: Seen) -> tuple[Equilibrium, Array]:
        """The model under the estimated loads, and these, (B, 1, 11)."""
        measured = self.unloaded(seen)
        loads = estimated_loads(measured)
        commands = measured.lengths - measured.tensions / self.mechanism.stiffnesses
        return solve_lengths_batch(self.mechanism, commands, loads, measured), loads


def measured_equilibrium(mechanism: RollingChain, seen: Measurement) -> Equilibrium:
    """The model at the measured pose and tensions, B rows.

    The load is unknown: whatever the tendons leave unbalanced is taken as moments on the links that stay as they are.
    Commands are computed from pose and tensions, so actuator offsets do not enter. Tension limits are not applied:
    where a motor keeps a tension limit its command follows, and the law of the elastic tendon still holds.
    """
    moments = _joint_moments(mechanism, seen)
    loads = np.zeros((*moments.shape, len(LOAD_COLUMNS)))
    loads[..., _LINK] = np.arange(1, mechanism.n_links)
    loads[..., _MOMENT] = -np.diff(moments, axis=1, append=0.0)
    commands = mechanism.tendon_lengths(seen.joint_angles) - seen.tensions / mechanism.stiffnesses
    return solve_lengths_batch(mechanism, commands, loads, seen.joint_angles)


def estimated_loads(measured: Equilibrium, noise: float = 1.0) -> Array:
    """Load tables (B, 1, 11): the force at the origin of one link that explains best what the tendons leave unbalanced.

    Statics: the moment of a force at joint i is that about its contact point. For every link the force that explains
    the moments best is found by regularised least squares; the most likely link is chosen.

    Args:
        measured: from measured_equilibrium.
        noise: error of a joint moment that is as likely as a load of 1 N [N·mm]. It regularises forces along the
            chain, which have little moment.
    """
    moments = (measured.tendon_rates @ measured.tensions[..., None])[..., 0]
    arm = measured.poses[:, 1:, None, :2] - measured.contact_points[:, None]
    links = arm.shape[1]
    rows = np.stack([-arm[..., 1], arm[..., 0]], axis=-1) * np.tri(links)[..., None]  # joint i carries links k > i
    columns = np.swapaxes(rows, -1, -2)
    forces = np.linalg.solve(columns @ rows + noise**2 * np.eye(2), columns @ moments[:, None, :, None])
    left = moments[:, None] - (rows @ forces)[..., 0]
    unlikely = np.sum(left**2, axis=-1) + noise**2 * np.sum(forces[..., 0] ** 2, axis=-1)
    likeliest = unlikely.argmin(axis=1)
    loads = np.zeros((len(likeliest), 1, len(LOAD_COLUMNS)))
    loads[:, 0, _LINK] = 1 + likeliest
    loads[:, 0, _FX : _FX + 2] = forces[np.arange(len(likeliest)), likeliest, :, 0]
    return loads


def _joint_moments(mechanism: RollingChain, seen: Measurement) -> Array:
    """Moments that balance the measured tensions at the measured joint angles, (B, n - 1) [N·mm]."""
    turns = _TURN * np.eye(mechanism.n_joints)  # a joint's angle changes the tendons' gaps at this joint alone
    ahead, behind = (mechanism.tendon_lengths(seen.joint_angles[:, None] + turn) for turn in (turns, -turns))
    return ((ahead - behind) / (2 * _TURN) @ seen.tensions[..., None])[..., 0]
