"""Geometry of a chain: where surfaces touch, how tendons run. The plane is the complex plane: x + iy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import torch
from torch import Tensor

from rollingjoint.differentiable.design import DifferentiableChain
from rollingjoint.differentiable.looking import seen
from rollingjoint.differentiable.surface import Place, Surfaces, as_complex


class Joints(NamedTuple):
    """Every joint at its angle phi, in the frame of the link below: complex (..., J) each."""

    turn: Tensor  # exp(i phi)
    touching: Tensor  # contact point, mm
    origin: Tensor  # of the link above, mm
    tangent: Tensor  # unit tangent e at the contact
    pole: Tensor  # rate of the contact point with the angle, e / kappa, mm/rad


@dataclass(frozen=True)
class Contact:
    """Where the surfaces of every joint touch; the place has (..., J, 2), child and parent."""

    place: Place

    @property
    def s(self) -> Tensor:
        """Arc lengths, (..., J) [mm]."""
        return self.place.s[..., 0]

    @cached_property
    def tangent_angles(self) -> Tensor:
        """In the frames of both links, (..., J, 2) [rad]."""
        return self.place.tangent_angle()

    @cached_property
    def angles(self) -> Tensor:
        """Joint angles, (..., J) [rad]."""
        return self.tangent_angles[..., 0] - self.tangent_angles[..., 1]

    @cached_property
    def kappa(self) -> Tensor:
        """Relative curvatures, (..., J) [1/mm]."""
        u = self.place.curvature()
        return u[..., 0] - u[..., 1]

    @cached_property
    def points(self) -> Tensor:
        """In the frames of both links, complex (..., J, 2) [mm]."""
        return self.place.point()

    @cached_property
    def tangents(self) -> Tensor:
        """Unit tangents in the frame of the link below, complex (..., J)."""
        return turned(self.tangent_angles[..., 0])

    def joints(self, phi: Tensor) -> Joints:
        """The joints at angles phi, (..., J) [rad]; whoever differentiates has contacts that depend on them."""
        turn, (below, above) = turned(phi), self.points.unbind(-1)
        return Joints(turn, below, below - turn * above, self.tangents, self.tangents / self.kappa)

    def moved(self, by: Tensor) -> Contact:
        """The contacts so much further on, (..., J)."""
        return Contact(self.place.moved(by[..., None]))


@dataclass(frozen=True)
class Routes:
    """How the tendons run through the links.

    Attributes:
        below, above: complex, (..., m, J) holes at the two ends of every gap, in the frames of their links [mm].
        crosses: whether tendon j crosses joint i, (m, J), 1 or 0.
        channels: length of every tendon inside the links, (..., m) [mm].
        along: unit vectors of the channels, parent to child hole, complex (..., m, n); y where there is none. Only
            friction asks for them: None where none can act.
    """

    below: Tensor
    above: Tensor
    crosses: Tensor
    channels: Tensor
    along: Tensor | None = None

    def each(self, change: Callable[[Tensor, int], Tensor]) -> Routes:
        """The same with every tensor that has leading axes changed, by a function that also gets its own axes."""
        along = None if self.along is None else change(self.along, 2)
        return Routes(change(self.below, 2), change(self.above, 2), self.crosses, change(self.channels, 1), along)


@dataclass(frozen=True)
class Geometry:
    """What does not depend on the pose.

    Attributes:
        joints: (..., J, 2) surfaces: child below, parent above.
        routes: of the tendons.
    """

    joints: Surfaces
    routes: Routes

    @classmethod
    def of(cls, design: DifferentiableChain) -> Geometry:
        """The geometry of a design."""
        surfaces = design.surfaces()
        holes = _holes(design, surfaces)
        links = torch.arange(design.n_links, device=design.device)
        passed = (links <= design.crossed[:, None]).to(torch.float64)
        through = holes[..., 1] - holes[..., 0]
        channels = (through.abs() * passed).sum(-1)
        crosses = (links[:-1] < design.crossed[:, None]).to(torch.float64)
        drilled = (passed > 0) & (through.detach().abs() > 0)
        safe = torch.where(drilled, through, 1j)
        routes = Routes(holes[..., :-1, 1], holes[..., 1:, 0], crosses, channels, safe / safe.abs())
        return cls(surfaces.joints(), routes)

    def detach(self) -> Geometry:
        """The geometry as a constant."""
        return Geometry(self.joints.detach(), self.routes.each(lambda tensor, _: tensor.detach()))

    @cached_property
    def limits(self) -> tuple[Tensor, Tensor]:
        """First and last arc length of every joint, (..., J) each [mm]."""
        return self.joints.common_range()

    def contact(self, s: Tensor) -> Contact:
        """The contacts at arc lengths s, (..., J)."""
        return Contact(self.joints.at(s[..., None].expand(*s.shape, 2)))

    def contacts(self, phi: Tensor, guess: Tensor, most: int = 60) -> Tensor:
        """Contacts s at joint angles phi, (..., J) [mm], constants; Newton's method from a guess, in a bracket."""
        low, high = self.limits
        low, high = low.expand_as(phi), high.expand_as(phi)
        s = torch.minimum(torch.maximum(guess, low), high)
        for _ in range(most):
            contact = self.contact(s)
            error = contact.angles - phi  # falls as s grows
            if seen((error.abs() <= 2e-15 * (1.0 + phi.abs())).all(), False):
                break
            low, high = torch.where(error > 0, s, low), torch.where(error > 0, high, s)
            newton = s - error / contact.kappa
            s = torch.where((newton >= low) & (newton <= high), newton, 0.5 * (low + high))
        return s


def _holes(design: DifferentiableChain, surfaces: Surfaces) -> Tensor:
    """Every hole in its link's frame, complex (..., m, n, 2) [mm]."""
    points = as_complex(design.holes)
    if not seen(design.on_surface.any(), True):
        return points
    arcs = torch.where(design.on_surface, design.hole_arcs, 0.0)
    return torch.where(design.on_surface, surfaces.several().at(arcs).point(), points)


def turned(angle: Tensor) -> Tensor:
    """exp(i angle): a product with it turns by the angle."""
    return torch.complex(torch.cos(angle), torch.sin(angle))
