"""The whole chain at given contacts: poses, tendons, residual, stiffness, energy, contact forces.

The plane is the complex plane: x + iy. Symbols as in docs/theory.md, sections 2 to 5: c contact point, e tangent,
F force, r residual, H stiffness. Everything has leading axes and is differentiable by everything.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

from rollingjoint.differentiable.friction import DifferentiableFriction, FrictionStates
from rollingjoint.differentiable.geometry import Contact, Geometry, turned
from rollingjoint.differentiable.loads import Loads, LoadsAtPose, cross, dot
from rollingjoint.differentiable.slip import FrictionAtPose, GapsAtPose
from rollingjoint.differentiable.transmission import limited_tension

_CLOSED_GAP = 1e-9  # mm; below it the gap's direction is the contact normal


@dataclass(frozen=True)
class Law:
    """Tendon law, (..., m) each: tension at the motor = clip(stiffness × (length - command), low, high).

    With friction and the history that a step starts from, the gaps have tensions of their own.
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
        found = [tensor.shape[:-1] for tensor in numbers]
        return found if self.history is None else [*found, *self.history.leading]

    def each(self, change: Callable[[Tensor, int], Tensor]) -> Law:
        """The law with every tensor changed, by a function that also gets the number of its own axes."""
        command, stiffness, low, high = (change(row, 1) for row in self.rows)
        friction = None if self.friction is None else self.friction.each(lambda tensor: change(tensor, 1))
        history = None if self.history is None else self.history.each(change)
        return Law(command, stiffness, low, high, self.prescribed, friction, history)

    def where(self, good: Tensor) -> Law:
        """The law; in rows that are not good, (...), a constant that can be solved with."""
        command, stiffness, low, high = (torch.where(good[..., None], row, 1.0) for row in self.rows)
        friction = None if self.friction is None else self.friction.where(good)
        history = None if self.history is None else self.history.where(self.history.usable())
        return Law(command, stiffness, low, high, self.prescribed, friction, history)

    def of(self, lengths: Tensor) -> tuple[Tensor, Tensor]:
        """Tensions [N], and d tension / d length [N/mm]."""
        if self.prescribed:
            return self.low, torch.zeros_like(lengths)
        pull = self.stiffness * (lengths - self.command)
        tensions = limited_tension(pull, self.low, self.high)
        return tensions, torch.where((pull > self.low) & (pull < self.high), self.stiffness, 0.0)


@dataclass(frozen=True)
class ChainState:
    """The chain at joint angles phi, (..., J) [rad].

    Args:
        geometry: of the mechanisms.
        law: of their tendons.
        loads: that act.
        phi: joint angles.
        contact: where the surfaces touch at these angles; whoever differentiates passes one that depends on them.
    """

    geometry: Geometry
    law: Law
    loads: Loads
    phi: Tensor
    contact: Contact

    @cached_property
    def _turns(self) -> Tensor:
        return turned(self.phi)

    @cached_property
    def _origins(self) -> Tensor:
        """Origin of the link above every joint in the frame of the link below, complex (..., J)."""
        points = self.contact.points
        return points[..., 0] - self._turns * points[..., 1]

    @cached_property
    def link_angles(self) -> Tensor:
        """(..., n) [rad]."""
        return torch.nn.functional.pad(torch.cumsum(self.phi, -1), (1, 0))

    @cached_property
    def rotations(self) -> Tensor:
        """exp(i angle) of every link, complex (..., n)."""
        return turned(self.link_angles)

    @cached_property
    def positions(self) -> Tensor:
        """Origin of every link, complex (..., n) [mm]."""
        steps = torch.cumsum(self.rotations[..., :-1] * self._origins, -1)
        return torch.cat([torch.zeros_like(steps[..., :1]), steps], -1)

    @cached_property
    def contacts(self) -> Tensor:
        """Contact points, complex (..., J) [mm]."""
        return self.positions[..., :-1] + self.rotations[..., :-1] * self.contact.points[..., 0]

    @cached_property
    def tangents(self) -> Tensor:
        """Unit tangents of the contacts, complex (..., J)."""
        return self.rotations[..., :-1] * self.contact.tangents

    @cached_property
    def _gaps(self) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Of every gap its length; direction and J r in the frame of the link below; is it open; (..., m, J)."""
        below, above = self.geometry.below, self.geometry.above
        v = self._origins[..., None, :] + self._turns[..., None, :] * above - below
        is_open = v.detach().abs() > _CLOSED_GAP
        normal = (1j * self.contact.tangents)[..., None, :]
        safe = torch.where(is_open, v, normal)
        length = safe.abs()
        direction = safe / length
        return (
            torch.where(is_open, length, 0.0),
            direction,
            1j * (below + v - self.contact.points[..., None, :, 0]),
            is_open,
        )

    @cached_property
    def crossing(self) -> Tensor:
        """Lowest height of a gap over the contact's tangent, (...) [mm]: negative where holes have changed places."""
        length, direction, _, _ = self._gaps
        height = length * dot((1j * self.contact.tangents)[..., None, :], direction)
        return torch.where(self.geometry.crosses > 0, height, 0.0).flatten(-2).amin(-1)

    @cached_property
    def lengths(self) -> Tensor:
        """Tendon lengths, (..., m) [mm]."""
        return self.geometry.channels + (self._gaps[0] * self.geometry.crosses).sum(-1)

    @cached_property
    def rates(self) -> Tensor:
        """d length / d joint angle, (..., m, J) [mm/rad]."""
        _, direction, moves, _ = self._gaps
        return dot(direction, moves) * self.geometry.crosses

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
        """What this friction is at this pose."""
        length, direction, moves, is_open = self._gaps
        along, up = self.geometry.along[..., :-1], self._turns[..., None, :] * self.geometry.along[..., 1:]
        rate = torch.where(is_open, cross(direction, moves) / torch.where(is_open, length, 1.0), 0.0)
        below, above = (torch.atan2(cross(a, b), dot(a, b)) for a, b in ((along, direction), (direction, up)))
        crosses = self.geometry.crosses
        turns = (below, above, rate, 1.0 - rate)
        gaps = GapsAtPose(length * crosses, self.rates, *turns, crosses, self.tensions, self.elastic)
        return FrictionAtPose(friction, self.law.history, gaps)

    @property
    def elastic(self) -> Tensor:
        """d tension / d length, (..., m) [N/mm]: 0 for a prescribed tension, a slack or a yielding tendon."""
        return self._law[1]

    @cached_property
    def _acting(self) -> LoadsAtPose:
        return LoadsAtPose(self.loads, self.positions, self.rotations, self.link_angles, self.contacts)

    @property
    def moments(self) -> Tensor:
        """M: moment of the loads beyond every joint about its contact, (..., J) [N·mm]."""
        return self._acting.moments

    @cached_property
    def residual(self) -> Tensor:
        """r, (..., J) [N·mm]."""
        return (self.gap_tensions * self.rates).sum(-2) - self.moments

    @cached_property
    def stiffness(self) -> Tensor:
        """H = dr/dphi, (..., J, J) [N·mm/rad]: symmetric unless follower forces or friction act."""
        H = torch.diag_embed(self._own_stiffness)
        if self.rubbing is not None:
            H = H + (self.rates[..., None] * self.rubbing.slopes).sum(-3)
        elif not self.law.prescribed:
            H = H + (self.rates.mT * self.elastic[..., None, :]) @ self.rates
        return H + self._acting.stiffness() if self.loads.any else H

    @cached_property
    def _own_stiffness(self) -> Tensor:
        """What gaps and the moving pole add at every joint, (..., J)."""
        length, direction, moves, is_open = self._gaps
        along = dot(direction, moves)
        turn = (moves.abs().square() - along.square()) / torch.where(is_open, length, 1.0)
        rate = (self.contact.tangents / self.contact.kappa)[..., None, :]  # e / kappa
        second = torch.where(is_open, turn, 0.0) + dot(direction, 1j * (moves - rate))
        gaps = (self.gap_tensions * self.geometry.crosses * second).sum(-2)
        return gaps + cross(self.tangents, self._acting.forces) / self.contact.kappa

    @cached_property
    def contact_forces(self) -> Tensor:
        """On the distal link, along the child surface's tangent and normal, (..., J, 2) [N]."""
        pull = (self.gap_tensions * self.geometry.crosses * self._gaps[1]).sum(-2)
        force = self.rotations[..., :-1] * pull - self._acting.forces
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
        work = self._acting.energies()
        return pulled.sum(-1) + work.sum(-1), magnitude + work.abs().sum(-1)

    @cached_property
    def force_scale(self) -> Tensor:
        """Largest sum of the magnitudes of a joint's moments, every tension with a lever of at least 1 mm, (...)."""
        levers = self.rates.abs().clamp(min=1.0) * self.geometry.crosses
        return ((self.gap_tensions.abs() * levers).sum(-2) + self.moments.abs()).amax(-1)
