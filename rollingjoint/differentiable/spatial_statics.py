"""The whole chain in space at given joint angles: poses, residual, stiffness, energy, and reactions of the contacts.

A joint is a map of the plane in a plane that is fixed in its links; gaps, tendons and their law are as in the plane,
with one number more per gap. Symbols as in docs/theory.md, section 11.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

from rollingjoint.differentiable.friction import DifferentiableFriction
from rollingjoint.differentiable.geometry import Contact, Geometry, Planes
from rollingjoint.differentiable.loads import AnyLoads
from rollingjoint.differentiable.slip import FrictionAtPose, GapsAtPose
from rollingjoint.differentiable.spatial_loads import SpatialLoads, SpatialLoadsAtPose
from rollingjoint.differentiable.statics import ChainState, Law


def state_at(geometry: Geometry, law: Law, loads: AnyLoads, phi: Tensor, contact: Contact) -> ChainState:
    """The chain of a geometry at joint angles phi, (..., J) [rad], where its surfaces touch at `contact`."""
    joints = contact.joints(phi)
    if geometry.planes is None:
        return ChainState(geometry.routes, law, loads, phi, joints)
    return SpatialState(geometry.routes, law, loads, phi, geometry.planes.joints(joints), geometry.planes)


def gap_heights(geometry: Geometry, s: Tensor) -> Tensor:
    """Lowest height of all gaps over the tangents of the contacts at arc lengths s (..., J), (...) [mm]."""
    contact = geometry.contact(s)
    phi = contact.angles
    crosses = geometry.routes.crosses
    no_pulls = torch.zeros(len(crosses), dtype=phi.dtype, device=phi.device)
    loads = SpatialLoads(phi.new_zeros(0, len(SpatialLoads.columns)), phi.shape[-1])
    return state_at(geometry, Law.constant(no_pulls), loads, phi, contact).crossing


@dataclass(frozen=True)
class SpatialState(ChainState):
    """The chain in space at joint angles phi; vectors in the base frame have a last axis of 3.

    Args:
        planes: of the joints.
    """

    planes: Planes

    @cached_property
    def _placed(self) -> tuple[Tensor, Tensor]:
        """Rotation and position of every link, (..., n, 3, 3) and (..., n, 3)."""
        turn, origin, frames = self.joints.turn[..., None], self.joints.origin[..., None], self.planes.frames
        lateral, axial, axis = frames.expand(*turn.shape[:-1], 3, 3).unbind(-2)
        turned = [turn.real * lateral - turn.imag * axial, turn.imag * lateral + turn.real * axial, axis]
        turns = frames.mT @ torch.stack(turned, -2)
        shifts = origin.real * lateral + origin.imag * axial + self.planes.shifts[..., None] * axis
        rotation = torch.eye(3, dtype=turns.dtype, device=turns.device).expand(*turns.shape[:-3], 3, 3)
        rotations, steps = [rotation], []
        for i in range(turns.shape[-3]):
            steps.append(rotation @ shifts[..., i, :, None])
            rotation = rotation @ turns[..., i, :, :]
            rotations.append(rotation)
        positions = torch.cumsum(torch.stack(steps, -3)[..., 0], -2)
        return torch.stack(rotations, -3), torch.nn.functional.pad(positions, (0, 0, 1, 0))

    @property
    def rotations(self) -> Tensor:
        """Of every link, (..., n, 3, 3)."""
        return self._placed[0]

    @property
    def positions(self) -> Tensor:
        """Origin of every link, (..., n, 3) [mm]."""
        return self._placed[1]

    @cached_property
    def directions(self) -> Tensor:
        """Lateral and axial direction and axis of every joint, rows, (..., J, 3, 3)."""
        return self.planes.frames @ self.rotations[..., :-1, :, :].mT

    @property
    def axes(self) -> Tensor:
        """Of the joints, (..., J, 3)."""
        return self.directions[..., 2, :]

    @cached_property
    def contacts(self) -> Tensor:
        """Middles of the contact lines, (..., J, 3) [mm]."""
        return self.positions[..., :-1, :] + self._in_space(self.joints.touching, self.planes.middles)

    @property
    def tangents(self) -> Tensor:
        """Unit tangents of the contacts, (..., J, 3)."""
        return self._in_space(self.joints.tangent)

    def _in_space(self, point: Tensor, along: Tensor | None = None) -> Tensor:
        """Vectors with complex parts (..., J) in the planes of the joints and parts along their axes, (..., J, 3)."""
        return (_vectors(point, along)[..., None, :] @ self.directions)[..., 0, :]

    @property
    def _heights(self) -> Tensor:
        """Heights of the gaps over the contacts' tangents, or their widths along the axes, (..., m, J) [mm]."""
        assert self.routes.aside is not None
        return torch.where(self.planes.hinges[..., None, :], torch.inf, super()._heights + self.routes.aside.abs())

    def rubbing_under(self, friction: DifferentiableFriction) -> FrictionAtPose:
        """This friction at this pose; turns in space have no sign."""
        (length, direction, per_length), lever = self._gaps, self._levers
        leads, aside = self.routes.leads, self.routes.aside
        assert leads is not None and aside is not None
        crosses, turn = self.routes.crosses, self.joints.turn[..., None, :]
        segment = _vectors(direction, aside * per_length)
        moved = 1j * lever * per_length
        above = turn * torch.complex(leads[..., 1, 0], leads[..., 1, 1])
        below, below_rate = _turn_between(leads[..., 0, :], segment, _vectors(moved))
        up, up_rate = _turn_between(_vectors(above, leads[..., 1, 2]), segment, _vectors(moved - 1j * direction))
        turns = (below, up, below_rate, up_rate)
        gaps = GapsAtPose(length * crosses, self.rates, *turns, crosses, self.tensions, self.elastic)
        return FrictionAtPose(friction, self.law.history, gaps)

    @cached_property
    def acting(self) -> SpatialLoadsAtPose:  # type: ignore[override]
        """The loads at this pose."""
        assert isinstance(self.loads, SpatialLoads)
        place = self.positions, self.rotations, self.link_angles
        return SpatialLoadsAtPose(self.loads, *place, self.contacts, self.axes)

    @cached_property
    def _sprung(self) -> Tensor:
        """Moments of the springs of the joints, (..., J) [N·mm]."""
        return self.planes.stiffnesses * (self.phi - self.planes.rests)

    @cached_property
    def residual(self) -> Tensor:
        """r, (..., J) [N·mm]."""
        return self._sprung + self._torques.sum(-2) - self.moments

    @cached_property
    def _own_stiffness(self) -> Tensor:
        """Stiffness from springs, gaps and the moving contact at every joint alone, (..., J)."""
        return super()._own_stiffness + self.planes.stiffnesses

    @property
    def _pole_stiffness(self) -> Tensor:
        """Stiffness from the moment arms of the loads, which change with the moving contacts, (..., J)."""
        normal = self._in_space(1j * self.joints.pole)
        return (normal * self.outer_forces).sum(-1)

    @property
    def outer_couples(self) -> Tensor:
        """Moments about every contact on the links beyond it that no tendon exerts, (..., J, 3) [N·mm]."""
        return self.acting.couples

    @cached_property
    def reactions(self) -> Tensor:
        """Force and moment about the contact on the link above, along tangent, normal and axis, (..., J, 6)."""
        _, direction, per_length = self._gaps
        aside, entry = self.routes.aside, self.routes.entry
        assert aside is not None and entry is not None
        pulls, arm = self._pulls, self.routes.below - self.joints.touching[..., None, :]
        in_plane, along = pulls * direction, pulls * aside * per_length
        force = in_plane.sum(-2), along.sum(-2)
        moment = (
            (1j * (entry * in_plane - along * arm)).sum(-2),
            (arm.real * in_plane.imag - arm.imag * in_plane.real).sum(-2),
        )
        parts = []
        for (plane, axial), loads in ((force, self.outer_forces), (moment, self.outer_couples)):
            lateral, vertical, about = (self.directions @ loads[..., None])[..., 0].unbind(-1)
            turned = self.joints.tangent.conj() * (plane - torch.complex(lateral, vertical))
            parts += [turned.real, turned.imag, axial - about]
        return torch.stack(parts, -1)

    @property
    def contact_forces(self) -> Tensor:
        """On the distal link, along the child surface's tangent and normal, (..., J, 2) [N]."""
        return self.reactions[..., :2]

    @cached_property
    def energy(self) -> tuple[Tensor, Tensor]:
        """Potential energy, and the sum of its terms' magnitudes, (...) [N·mm]; followers, moments have none."""
        energy, magnitude = super().energy
        springs = (0.5 * self._sprung * (self.phi - self.planes.rests)).sum(-1)
        return energy + springs, magnitude + springs

    @property
    def _besides_tendons(self) -> Tensor:
        """Sum of the magnitudes of the moments at every joint that no tendon exerts, (..., J)."""
        return super()._besides_tendons + self._sprung.abs()


def _vectors(plane: Tensor, along: Tensor | None = None) -> Tensor:
    """Vectors (..., 3) with complex parts in a plane and parts along its axis, 0 unless given."""
    along = torch.zeros_like(plane.real) if along is None else along
    return torch.stack(torch.broadcast_tensors(plane.real, plane.imag, along), -1)


def _turn_between(channel: Tensor, segment: Tensor, rate: Tensor) -> tuple[Tensor, Tensor]:
    """Angle between a channel and a segment, unit vectors (..., 3), and its rate; 0 where they are in line."""
    channel, segment = torch.broadcast_tensors(channel, segment)
    across, along = torch.linalg.cross(channel, segment), (channel * segment).sum(-1)
    aside = across.detach().square().sum(-1) > 0.0
    side = torch.where(aside[..., None], across, 1.0).square().sum(-1).sqrt()
    turned = (across * torch.linalg.cross(channel, rate.expand_as(channel))).sum(-1)
    angle_rate = along * turned / side - side * (channel * rate).sum(-1)
    return torch.where(aside, torch.atan2(side, along), 0.0), torch.where(aside, angle_rate, 0.0)
