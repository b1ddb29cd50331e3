"""Loads on chains in space: the columns of their load tables, and their energy, forces and stiffness at a pose.

Symbols as in docs/theory.md, section 11: a axis, c contact, x point of a load, B = a × (x - c). All tensors have
leading axes, and all results have derivatives by all inputs.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

from rollingjoint.differentiable.loads import AnyLoads
from rollingjoint.load import SPATIAL_LOAD_COLUMNS


class SpatialLoads(AnyLoads):
    """Load tables in space; points and vectors have a last axis of 3.

    Args:
        table: columns load.SPATIAL_LOAD_COLUMNS.
        n_joints: of the chain.
    """

    columns = SPATIAL_LOAD_COLUMNS
    turning = ("bx", "by", "bz", "nx", "ny", "nz")

    def __init__(self, table: Tensor, n_joints: int) -> None:
        super().__init__(table, n_joints)
        self.points, self.dead, self.moments, self.body, self.couples, self.anchors = map(self._vector, "pfmbna")
        self.has_moments = self._acts(("mx", "my", "mz"))

    def of_links_in_space(self, values: Tensor) -> Tensor:
        """Vectors or matrices (..., n, 3 or 9) of the loaded links, (..., rows, 3 or 9)."""
        links = self.links.expand(*values.shape[:-2], -1)[..., None]
        return values.gather(-2, links.expand(*links.shape[:-1], values.shape[-1]))

    def vector_sums(self, vectors: Tensor) -> Tensor:
        """Sum of vectors (..., rows, 3) over the loads beyond every joint, (..., J, 3)."""
        return self.beyond.mT @ vectors

    def without_potential(self) -> Tensor:
        """Where a load has no potential: it turns with its link, or is a moment, (...)."""
        return super().without_potential() | (self.moments != 0).any(-1).any(-1)

    def _vector(self, letter: str) -> Tensor:
        first = self.columns.index(f"{letter}x")
        return self.table[..., first : first + 3]


@dataclass(frozen=True)
class SpatialLoadsAtPose:
    """Loads on a chain in space at one pose.

    Args:
        loads: load tables.
        positions, rotations: of every link, (..., n, 3) [mm] and (..., n, 3, 3).
        link_angles: sum of the joint angles below every link, (..., n) [rad].
        contacts: contact points, (..., J, 3) [mm].
        axes: of the joints, (..., J, 3).
    """

    loads: SpatialLoads
    positions: Tensor
    rotations: Tensor
    link_angles: Tensor
    contacts: Tensor
    axes: Tensor

    @cached_property
    def _turns(self) -> Tensor:
        """Rotations of the loaded links, (..., rows, 3, 3)."""
        return self.loads.of_links_in_space(self.rotations.flatten(-2)).unflatten(-1, (3, 3))

    @cached_property
    def _points(self) -> Tensor:
        """x, (..., rows, 3) [mm]."""
        return self.loads.of_links_in_space(self.positions) + self._turned(self.loads.points)

    @cached_property
    def _followers(self) -> Tensor:
        """Forces that turn with their links, (..., rows, 3) [N]."""
        return self._turned(self.loads.body)

    @cached_property
    def _couples(self) -> Tensor:
        """Moments that turn with their links, (..., rows, 3) [N·mm]."""
        return self._turned(self.loads.couples)

    @cached_property
    def _fixed(self) -> Tensor:
        """Forces of fixed direction and of springs, (..., rows, 3) [N]."""
        loads, x = self.loads, self._points
        dead = loads.dead.expand_as(x)
        return dead + loads.springs[..., None] * (loads.anchors - x) if loads.pull else dead

    @cached_property
    def _all_forces(self) -> Tensor:
        return self._fixed + self._followers if self.loads.follow else self._fixed

    @cached_property
    def _levers(self) -> Tensor:
        """x - c of every load beyond every joint, 0 for other loads, (..., rows, J, 3) [mm]."""
        return (self._points[..., :, None, :] - self.contacts[..., None, :, :]) * self.loads.beyond[..., None]

    @cached_property
    def _rates(self) -> Tensor:
        """B, likewise."""
        return torch.linalg.cross(self.axes[..., None, :, :], self._levers)

    @cached_property
    def forces(self) -> Tensor:
        """Sums of the forces beyond every joint, (..., J, 3) [N]."""
        return self.loads.vector_sums(self._all_forces)

    @cached_property
    def couples(self) -> Tensor:
        """Moment of the loads beyond every joint about its contact, (..., J, 3) [N·mm]; without torsion springs."""
        loads = self.loads
        moments = torch.linalg.cross(self._levers, self._all_forces[..., None, :]).sum(-3)
        if loads.has_moments:
            moments = moments + loads.vector_sums(loads.moments)
        return moments + loads.vector_sums(self._couples) if loads.follow else moments

    @cached_property
    def _twists(self) -> Tensor:
        return self.loads.twists(self.link_angles)

    @cached_property
    def moments(self) -> Tensor:
        """Moment of the loads beyond every joint about its axis, (..., J) [N·mm]."""
        moments = _dot(self.axes, self.couples)
        return moments - self.loads.twisting(self._twists) if self.loads.twist else moments

    def stiffness(self) -> Tensor:
        """Contribution of the loads to H, (..., J, J), without the moving contact of each joint itself."""
        loads, axes = self.loads, self.axes
        w = torch.linalg.cross(self._rates, self._fixed[..., None, :]).sum(-3)
        below = (w @ axes.mT).tril()  # H_im = -w_i · a_m for m <= i
        H = -below - below.tril(-1).mT
        if loads.pull:
            sprung = self._rates * loads.springs[..., None, None]
            H = H + sprung.movedim(-2, -1).flatten(-3, -2).mT @ self._rates.movedim(-2, -1).flatten(-3, -2)
        if loads.follow:
            H = H - self._following().triu(1)
        if loads.has_moments:
            turned = torch.linalg.cross(axes[..., None, :, :], axes[..., :, None, :])  # a_m × a_i
            H = H - _dot(turned, loads.vector_sums(loads.moments)[..., :, None, :]).tril(-1)
        return H + loads.twisting_stiffness() if loads.twist else H

    def _following(self) -> Tensor:
        """Rate of the moment of followers about joint i as joint m > i turns, (..., J, J)."""
        loads, axes, contacts = self.loads, self.axes, self.contacts
        forces = loads.vector_sums(self._followers)
        moments = torch.linalg.cross(self._levers, self._followers[..., None, :]).sum(-3)
        turning = torch.linalg.cross(axes, moments + loads.vector_sums(self._couples))
        arms = contacts[..., None, :, :] - contacts[..., :, None, :]  # from the contact of i to the one of m
        moved = torch.linalg.cross(arms, torch.linalg.cross(axes, forces)[..., None, :, :])
        return _dot(axes[..., :, None, :], turning[..., None, :, :] + moved)

    def energies(self) -> Tensor:
        """Potential energy of every row, (..., rows) [N·mm]; followers and moments have none."""
        loads, x = self.loads, self._points
        work = -_dot(loads.dead, x)
        if loads.pull:
            work = work + 0.5 * loads.springs * (loads.anchors - x).square().sum(-1)
        return work + 0.5 * loads.torsions * self._twists.square() if loads.twist else work

    def _turned(self, vectors: Tensor) -> Tensor:
        """Vectors of the loaded links in the base frame, (..., rows, 3)."""
        return (self._turns @ vectors[..., None])[..., 0]


def _dot(a: Tensor, b: Tensor) -> Tensor:
    return (a * b).sum(-1)
