"""Differentiable equilibria of chains in space among walls."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import torch
from torch import Tensor

from rollingjoint.differentiable.spatial_contact import ContactsInSpace
from rollingjoint.differentiable.spatial_equilibria import SpatialEquilibria
from rollingjoint.differentiable.spatial_statics import SpatialState
from rollingjoint.differentiable.statics import ChainState
from rollingjoint.differentiable.walled import Among, PinnedWalls, WalledEquilibria, WalledState


@dataclass(frozen=True)
class SpatialWalledState(SpatialState):
    """The chain in space among walls at joint angles phi; among: the walls, with the candidates that press."""

    among: Among

    @cached_property
    def _frame(self) -> tuple[Tensor, Tensor]:
        """Rotation (..., 1, 3, 3) and place (..., 1, 3) of the base among the walls."""
        place, (x, y, z) = self.among.base[..., None, :3], self.among.base[..., 3:].unbind(-1)
        zero = torch.zeros_like(x)
        skew = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).unflatten(-1, (3, 3))
        return torch.linalg.matrix_exp(skew)[..., None, :, :], place

    def _in_world(self, vectors: Tensor) -> Tensor:
        """Vectors of the frame of the base, (..., k, 3), in that of the walls."""
        return (self._frame[0] @ vectors[..., None])[..., 0]

    def _in_base(self, vectors: Tensor) -> Tensor:
        """Vectors of the frame of the walls, (..., k, 3), in that of the base."""
        return (self._frame[0].mT @ vectors[..., None])[..., 0]

    @cached_property
    def _places(self) -> Tensor:
        """Origins of the links among the walls, (..., n, 3) [mm]."""
        return self._frame[1] + self._in_world(self.positions)

    @cached_property
    def world_poses(self) -> Tensor:
        """Poses of the links among the walls, (B, n, 12): rotation matrix row by row, origin."""
        poses = torch.cat([(self._frame[0] @ self.rotations).flatten(-2), self._places], -1)
        return poses.reshape(-1, *poses.shape[-2:])

    @cached_property
    def contact(self) -> ContactsInSpace:
        """Contact with the walls, rows flattened."""
        problem: Any = self.among.problem
        contacts: ContactsInSpace = problem.at(self.world_poses)
        return contacts

    def recalled(self, chosen: Any, memory: Any) -> Any:
        """A memory of this pose, which has its gradients already."""
        return memory

    def rows(self, values: Tensor) -> Tensor:
        """Values (B, ...) with the axes of the batch."""
        return values.reshape((*self.among.base.shape[:-1], *values.shape[1:]))

    @cached_property
    def wall_forces(self) -> Tensor:
        """On every link, force and moment about its origin, base frame, (..., n, 6) [N, N·mm]."""
        force, outer = self.rows(self.contact.forces).split([3, 9], -1)
        moment = _moment(outer) - torch.linalg.cross(self._places, force)
        return torch.cat([self._in_base(force), self._in_base(moment)], -1)

    @cached_property
    def _beyond(self) -> tuple[Tensor, Tensor]:
        """Sums over the links beyond every joint: force, (..., J, 3), and point outer force, (..., J, 9)."""
        force, outer = _sums(self.rows(self.contact.forces)).split([3, 9], -1)
        return force, outer

    @cached_property
    def _joints(self) -> tuple[Tensor, Tensor]:
        """Axes and contacts of the joints among the walls, (..., J, 3)."""
        return self._in_world(self.axes), self._frame[1] + self._in_world(self.contacts)

    @property
    def _couples(self) -> Tensor:
        """Moment of the walls beyond every joint about its contact, in the frame of the walls, (..., J, 3)."""
        force, outer = self._beyond
        return _moment(outer) - torch.linalg.cross(self._joints[1], force)

    @cached_property
    def residual(self) -> Tensor:
        """r, (..., J) [N·mm]."""
        return super().residual - (self._joints[0] * self._couples).sum(-1)

    @property
    def outer_forces(self) -> Tensor:
        """Forces of loads and walls beyond every joint, (..., J, 3) [N]."""
        return super().outer_forces + self._in_base(self._beyond[0])

    @property
    def outer_couples(self) -> Tensor:
        """Moments of loads and walls beyond every joint about its contact, (..., J, 3) [N·mm]."""
        return super().outer_couples + self._in_base(self._couples)

    @cached_property
    def stiffness(self) -> Tensor:
        """H = dr/dphi, (..., J, J) [N·mm/rad]."""
        problem: Any = self.among.problem
        rates, (axes, contacts), (force, outer) = self.rows(problem.rates(self.world_poses)), self._joints, self._beyond
        twists = torch.cat([torch.linalg.cross(contacts, axes), axes], -1)
        joints = torch.arange(axes.shape[-2])
        later = torch.maximum(joints[:, None], joints)
        beyond = _sums(rates.flatten(-2)).unflatten(-1, (6, 6))[..., later, :, :]
        H = super().stiffness + torch.einsum("...ia,...imab,...mb->...im", twists, beyond, twists)
        along = (axes * force).sum(-1, keepdim=True)  # as of loads of constant direction: Σ (a × (x - c)) × f
        swung = (outer.unflatten(-1, (3, 3)) @ axes[..., None])[..., 0] - along * contacts
        trace = outer[..., ::4].sum(-1, keepdim=True) - (contacts * force).sum(-1, keepdim=True)
        below = ((swung - trace * axes) @ axes.mT).tril()
        return H - below - below.tril(-1).mT


class SpatialWalledEquilibria(WalledEquilibria, SpatialEquilibria):
    """Equilibria of a batch of chains in space among walls; as `SpatialEquilibria`, with contact as WalledEquilibria.

    wall_forces are (..., n, 6), forces and moments about the origins of the links, base frame [N, N·mm]. After a step
    with friction, `stiffness` is the derivative of this step's moments; `rollingjoint.SpatialEquilibrium` has that at
    the beginning of the next.
    """

    @property
    def wall_memory(self) -> Any:
        """What contact remembers, for the next step, with one axis of all rows."""
        memory, poses = super().wall_memory, self.walled.world_poses
        reached = memory.poses + poses - poses.detach()
        return memory._replace(poses=torch.where(self.ok.reshape(-1, 1, 1), reached, memory.poses))

    @property
    def insertion_force(self) -> Tensor:
        """(...) force that drives the base forwards against the walls, along its z axis [N]."""
        return -self.wall_forces[..., 2].sum(-1)

    @property
    def wall_states(self) -> Tensor:
        """(..., candidates, 3) friction states, tangential, in the frame of the walls: a shorter one than 1 sticks."""
        return self._of_candidates("states") * (self.wall_normals.detach() > 0.0)[..., None]


def _sums(values: Tensor) -> Tensor:
    """Sums of values (..., n, k) over the links beyond every joint, (..., J, k)."""
    return values.flip(-2).cumsum(-2).flip(-2)[..., 1:, :]


def _moment(outer: Tensor) -> Tensor:
    """Sum of points × forces, (..., 3), of the sum of points outer forces, (..., 9)."""
    xy, xz, yx, yz, zx, zy = (outer[..., k] for k in (1, 2, 3, 5, 6, 7))
    return torch.stack([yz - zy, zx - xz, xy - yx], -1)


def state_among(state: ChainState, among: Among | PinnedWalls | None) -> ChainState:
    """The state, among walls if there are any."""
    if among is None:
        return state
    kind: Any = SpatialWalledState if isinstance(state, SpatialState) else WalledState
    named = {field.name: getattr(state, field.name) for field in fields(state)}
    walled: ChainState = kind(**named, among=among)
    return walled
