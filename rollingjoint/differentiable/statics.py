"""The whole chain at given joint angles: poses, tendons, residual, stiffness, energy, contact forces.

The plane is the complex plane: x + iy. Symbols as in docs/theory.md, sections 2 to 5: c contact point, e tangent,
F force, r residual, H stiffness. All tensors have leading axes, and all results have derivatives by all inputs; no
number is read back from a device.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

from rollingjoint.differentiable.formulas import at_limit, elastic_tension, gap_rates, straight_gap
from rollingjoint.differentiable.friction import DifferentiableFriction, FrictionStates
from rollingjoint.differentiable.geometry import Joints, Routes, turned
from rollingjoint.differentiable.loads import AnyLoads, Loads, LoadsAtPose, cross, dot
from rollingjoint.differentiable.slip import FrictionAtPose, GapsAtPose


@dataclass(frozen=True)
class Law:
    """Tendon law, (..., m) each: tension at the motor = clip(stiffness × (length - command), low, high).

    With friction and the history before a step, tensions differ from gap to gap.
    """

    command: Tensor
    stiffness: Tensor
    low: Tensor
    high: Tensor
    prescribed: bool = False  # tensions are given: low is high
    friction: DifferentiableFriction | None = None
    history: FrictionStates | None = None

    @classmethod
    def constant(cls, tensions: Tensor) -> Law:
        """The law of given tensions."""
        return cls(torch.zeros_like(tensions), torch.ones_like(tensions), tensions, tensions, True)

    @property
    def rows(self) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Command, stiffness, minimum and maximum tension."""
        return self.command, self.stiffness, self.low, self.high

    @property
    def leading(self) -> list[torch.Size]:
        """The leading axes of every tensor."""
        numbers = self.rows if self.friction is None else (*self.rows, *self.friction.tensors)
        axes = [tensor.shape[:-1] for tensor in numbers]
        return axes if self.history is None else [*axes, *self.history.leading]

    def each(self, change: Callable[[Tensor, int], Tensor]) -> Law:
        """The law with every tensor changed, by a function of the tensor and its number of trailing axes."""
        command, stiffness, low, high = (change(row, 1) for row in self.rows)
        friction = None if self.friction is None else self.friction.each(lambda tensor: change(tensor, 1))
        history = None if self.history is None else self.history.each(change)
        return Law(command, stiffness, low, high, self.prescribed, friction, history)

    def where(self, good: Tensor) -> Law:
        """The law; in rows that are not good, (...), a valid constant."""
        command, stiffness, low, high = (torch.where(good[..., None], row, 1.0) for row in self.rows)
        friction = None if self.friction is None else self.friction.where(good)
        history = None if self.history is None else self.history.where(self.history.usable())
        return Law(command, stiffness, low, high, self.prescribed, friction, history)

    def of(self, lengths: Tensor) -> tuple[Tensor, Tensor]:
        """Tensions [N], and d tension / d length [N/mm]."""
        if self.prescribed:
            return self.low, torch.zeros_like(lengths)
        tensions = elastic_tension(lengths, self.command, self.stiffness, self.low, self.high)
        return tensions, torch.where(at_limit(tensions, self.low, self.high), 0.0, self.stiffness)


@dataclass(frozen=True)
class ChainState:
    """The chain at joint angles phi, (..., J) [rad].

    Args:
        routes: of the tendons.
        law: of the tendons.
        loads: that act.
        phi: joint angles.
        joints: at these angles, from surfaces (`Contact.joints`) or from tables (`TabulatedChain.at`).
    """

    routes: Routes
    law: Law
    loads: AnyLoads
    phi: Tensor
    joints: Joints

    @cached_property
    def link_angles(self) -> Tensor:
        """(..., n) [rad]."""
        return torch.nn.functional.pad(torch.cumsum(self.phi, -1), (1, 0))

    @cached_property
    def rotations(self) -> Tensor:
        """exp(i angle) of every link, complex (..., n)."""
        return turned(self.link_angles)

    @cached_property
    def _below(self) -> Tensor:
        """Rotations of the links below the joints, complex (..., J)."""
        return self.rotations[..., :-1]

    @cached_property
    def positions(self) -> Tensor:
        """Origin of every link, complex (..., n) [mm]."""
        return torch.nn.functional.pad(torch.cumsum(self._below * self.joints.origin, -1), (1, 0))

    @cached_property
    def contacts(self) -> Tensor:
        """Contact points, complex (..., J) [mm]."""
        return self.positions[..., :-1] + self._below * self.joints.touching

    @cached_property
    def tangents(self) -> Tensor:
        """Unit tangents of the contacts, complex (..., J)."""
        return self._below * self.joints.tangent

    @cached_property
    def _gaps(self) -> tuple[Tensor, Tensor, Tensor]:
        """Length, direction, 1 / length (0: closed) of every gap, (..., m, J) each."""
        joints, routes = self.joints, self.routes
        above = joints.origin[..., None, :] + joints.turn[..., None, :] * routes.above
        below_aside, aside = ((), ()) if routes.aside is None else ((0.0,), (routes.aside,))
        ends = (*_parts(routes.below), *below_aside), (*_parts(above), *aside)
        length, direction, per_length, closed = straight_gap(*ends)
        in_plane = torch.where(closed, (1j * joints.tangent)[..., None, :], torch.complex(*direction[:2]))
        return torch.where(closed, 0.0, length), in_plane, per_length

    @cached_property
    def _rates(self) -> tuple[Tensor, Tensor]:
        """g' [mm/rad] and g'' of every gap, (..., m, J) each."""
        length, direction, per_length = self._gaps
        below, along, contact, pole = map(_parts, (self.routes.below, direction, *self._pivots))
        rate, second = gap_rates(1.0, below, length, along, per_length, contact, pole)
        return rate, second

    @property
    def _pivots(self) -> tuple[Tensor, Tensor]:
        """Contacts and poles, for every tendon, (..., 1, J) each."""
        return self.joints.touching[..., None, :], self.joints.pole[..., None, :]

    @property
    def _levers(self) -> Tensor:
        """From the contact to the upper end of every gap, (..., m, J) [mm]."""
        length, direction, _ = self._gaps
        return self.routes.below + length * direction - self._pivots[0]

    @cached_property
    def crossing(self) -> Tensor:
        """Lowest height of a gap over the contact's tangent, (...) [mm]: negative where holes have changed places."""
        return torch.where(self.routes.crosses > 0, self._heights, torch.inf).flatten(-2).amin(-1)

    @property
    def _heights(self) -> Tensor:
        """Heights of the gaps over the contacts' tangents, (..., m, J) [mm]."""
        length, direction, _ = self._gaps
        return length * dot((1j * self.joints.tangent)[..., None, :], direction)

    @cached_property
    def lengths(self) -> Tensor:
        """Tendon lengths, (..., m) [mm]."""
        return self.routes.channels + (self._gaps[0] * self.routes.crosses).sum(-1)

    @cached_property
    def rates(self) -> Tensor:
        """g', d length / d joint angle, (..., m, J) [mm/rad]."""
        return self._rates[0] * self.routes.crosses

    @cached_property
    def _law(self) -> tuple[Tensor, Tensor]:
        return self.law.of(self.lengths)

    @property
    def tensions(self) -> Tensor:
        """At the motors, (..., m) [N]."""
        return self._law[0]

    @cached_property
    def gap_tensions(self) -> Tensor:
        """(..., m, J) [N]; without a step with friction (..., m, 1)."""
        return self.tensions[..., None] if self.rubbing is None else self.rubbing.tensions

    @cached_property
    def rubbing(self) -> FrictionAtPose | None:
        """Friction at this pose, if a step with friction leads to it."""
        if self.law.friction is None or self.law.history is None:
            return None
        return self.rubbing_under(self.law.friction)

    def rubbing_under(self, friction: DifferentiableFriction) -> FrictionAtPose:
        """This friction at this pose."""
        length, direction, per_length = self._gaps
        crosses, channels = self.routes.crosses, self.routes.along
        assert channels is not None
        along, up = channels[..., :-1], self.joints.turn[..., None, :] * channels[..., 1:]
        rate = dot(direction, self._levers) * per_length
        below, above = (torch.atan2(cross(a, b), dot(a, b)) for a, b in ((along, direction), (direction, up)))
        turns = (below, above, rate, 1.0 - rate)
        gaps = GapsAtPose(length * crosses, self.rates, *turns, crosses, self.tensions, self.elastic)
        return FrictionAtPose(friction, self.law.history, gaps)

    @property
    def elastic(self) -> Tensor:
        """d tension / d length, (..., m) [N/mm]: 0 for a prescribed tension, a slack or a yielding tendon."""
        return self._law[1]

    @cached_property
    def acting(self) -> LoadsAtPose:
        """The loads at this pose."""
        assert isinstance(self.loads, Loads)
        return LoadsAtPose(self.loads, self.positions, self.rotations, self.link_angles, self.contacts)

    @property
    def outer_forces(self) -> Tensor:
        """Forces on the links beyond every joint that no tendon exerts, complex (..., J), in space (..., J, 3) [N]."""
        return self.acting.forces

    @property
    def moments(self) -> Tensor:
        """M: moment of the loads beyond every joint about its contact, (..., J) [N·mm]."""
        return self.acting.moments

    @cached_property
    def _torques(self) -> Tensor:
        return self.gap_tensions * self.rates

    @cached_property
    def _pulls(self) -> Tensor:
        """Tensions of the gaps, 0 where a tendon does not cross a joint, (..., m, J) [N]."""
        return self.gap_tensions * self.routes.crosses

    @cached_property
    def residual(self) -> Tensor:
        """r, (..., J) [N·mm]."""
        return self._torques.sum(-2) - self.moments

    @cached_property
    def stiffness(self) -> Tensor:
        """H = dr/dphi, (..., J, J) [N·mm/rad]: symmetric unless follower forces or friction act."""
        H = torch.diag_embed(self._own_stiffness)
        if self.rubbing is not None or not self.law.prescribed:
            H = H + (self.rates[..., None] * self._slopes).sum(-3)
        return H + self.acting.stiffness() if self.loads.any else H

    @property
    def _slopes(self) -> Tensor:
        """d tension of every gap / d joint angle, (..., m, J or 1, J) [N/rad]."""
        if self.rubbing is not None:
            return self.rubbing.slopes
        return (self.elastic[..., None] * self.rates)[..., None, :]

    @cached_property
    def _own_stiffness(self) -> Tensor:
        """Stiffness from gaps and the moving pole at every joint alone, (..., J)."""
        return (self._pulls * self._rates[1]).sum(-2) + self._pole_stiffness

    @property
    def _pole_stiffness(self) -> Tensor:
        """Stiffness from the moment arms of the loads, which change with the moving contacts, (..., J)."""
        return cross(self._below * self.joints.pole, self.outer_forces)

    @cached_property
    def contact_forces(self) -> Tensor:
        """On the distal link, along the child surface's tangent and normal, (..., J, 2) [N]."""
        force = self._below * (self._pulls * self._gaps[1]).sum(-2) - self.outer_forces
        return torch.stack([dot(self.tangents, force), cross(self.tangents, force)], -1)

    @cached_property
    def energy(self) -> tuple[Tensor, Tensor]:
        """Potential energy, and the sum of its terms' magnitudes, (...) [N·mm]; follower forces, friction have none."""
        tension = self.tensions
        stretch = self.lengths - self.law.command
        pulled = tension * stretch - 0.5 * tension.square() / self.law.stiffness
        magnitude = (pulled.abs() + (tension * self.lengths).abs()).sum(-1)
        if not self.loads.any:
            return pulled.sum(-1), magnitude
        work = self.acting.energies()
        return pulled.sum(-1) + work.sum(-1), magnitude + work.abs().sum(-1)

    @cached_property
    def force_scale(self) -> Tensor:
        """Largest sum of the magnitudes of a joint's moments, every tension with a lever of at least 1 mm, (...)."""
        sizes = torch.maximum(self._torques.abs(), self._pulls)  # tendons only pull
        return (sizes.sum(-2) + self._besides_tendons).amax(-1)

    @property
    def _besides_tendons(self) -> Tensor:
        """Sum of the magnitudes of the moments at every joint that no tendon exerts, (..., J)."""
        return self.moments.abs()


def _parts(points: Tensor) -> tuple[Tensor, Tensor]:
    """Coordinates of points."""
    return points.real, points.imag
