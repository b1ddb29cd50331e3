"""Equilibria of spatial hinge chains: what a solve returns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rollingjoint.kernels.shared.batch import stiffness_of
from rollingjoint.kernels.shared.rubbed import begin_histories, rubbed_stiffness_of
from rollingjoint.load import SPATIAL_LOAD_COLUMNS, check_table
from rollingjoint.solution import Solution, parts
from rollingjoint.spatial.chain import HingeChain

Array = NDArray[np.float64]


@parts(tendon_torques="torques")
@dataclass(frozen=True, eq=False, repr=False)
class HingeEquilibrium(Solution):
    """One equilibrium, or many with a leading axis B on every array.

    Attributes, beside those of Solution:
        tendon_torques: (n - 1, m) d residual / d tension at the motor [mm]; tendon_rates unless there is friction or
            the tendons are end couples.
        escapes: unstable equilibria that the solver met and left downhill. Not 0: the arm has buckled, and where it
            buckled to is one of several.
    """

    mechanism: HingeChain | tuple[HingeChain, ...]
    tendon_torques: Array
    escapes: int | NDArray[np.int64]

    @property
    def tip(self) -> Array:
        """Origin of the last link: the middle of the last distal face, (3,) [mm]."""
        return self.poses[..., -1, :3, 3]

    @property
    def positions(self) -> Array:
        """Origins of the links, (n, 3) [mm]; hinge i is at the origin of link i."""
        return self.poses[..., :3, 3]

    @property
    def rotations(self) -> Array:
        """Rotation matrices of the links, (n, 3, 3)."""
        return self.poses[..., :3, :3]

    @property
    def torques_per_tension(self) -> Array:
        """(n - 1, m) d residual / d tension at the motor [mm]."""
        return self.tendon_torques

    @property
    def pose_jacobian(self) -> Array:
        """(n, 6, n - 1) d link poses (x, y, z, rotation vector), base frame, / d joint angles [mm/rad, 1]."""
        n = self.poses.shape[-3]
        arm = self.positions[..., :, None, :] - self.positions[..., None, :-1, :]
        return self._twists(arm) * np.tri(n, n - 1, -1)[:, None]  # hinge i moves link k > i

    def point_jacobian(self, link: int, point: Sequence[float] | None = None) -> Array:
        """(6, n - 1) d (x, y, z, rotation vector) of a body point [mm], default the link's origin, / d joint angles."""
        body = np.zeros(3) if point is None else np.asarray(point, float)
        at = self.positions[..., link, :] + self.rotations[..., link, :, :] @ body
        jacobian = self._twists(at[..., None, :] - self.positions[..., :-1, :])
        return jacobian * (np.arange(jacobian.shape[-1]) < link)

    def _twists(self, arm: Array) -> Array:
        """Velocity at the end of an arm from every hinge, (..., n - 1, 3), and angular velocity, (..., 6, n - 1)."""
        chain, designs = self._designs
        axes = chain.axes[designs].reshape(*self.joint_angles.shape, 3)
        axes = (self.rotations[..., :-1, :, :] @ axes[..., None])[..., 0]
        axes = np.broadcast_to(axes[..., None, :, :] if arm.ndim > axes.ndim else axes, arm.shape)
        return np.swapaxes(np.concatenate([np.cross(axes, arm), axes], axis=-1), -1, -2)

    def _shapes(self, n_joints: int, n_tendons: int) -> dict[str, tuple[int, ...]]:
        more = {"poses": (n_joints + 1, 4, 4), "tendon_torques": (n_joints, n_tendons), "escapes": ()}
        return super()._shapes(n_joints, n_tendons) | more

    @staticmethod
    def _check_loads(loads: Array, n_links: int) -> None:
        check_table(loads, SPATIAL_LOAD_COLUMNS, n_links)

    _fill_stiffness = staticmethod(stiffness_of)
    _fill_rubbed_stiffness = staticmethod(rubbed_stiffness_of)
    _begin_histories = staticmethod(begin_histories)
