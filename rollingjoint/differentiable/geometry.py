"""Geometry of a chain: where surfaces touch, where holes are. The plane is the complex plane: x + iy."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property

import torch
from torch import Tensor

from rollingjoint.differentiable.design import DifferentiableChain
from rollingjoint.differentiable.looking import seen
from rollingjoint.differentiable.surface import Place, Surfaces, as_complex


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

    def moved(self, by: Tensor) -> Contact:
        """The contacts so much further on, (..., J)."""
        return Contact(self.place.moved(by[..., None]))


@dataclass(frozen=True)
class Geometry:
    """What does not depend on the pose: surfaces of the joints, holes, channels.

    Attributes:
        joints: (..., J, 2) surfaces: child below, parent above.
        below, above: complex, (..., m, J) holes at the two ends of every gap, in the frames of their links [mm].
        crosses: whether tendon j crosses joint i, (m, J), 1 or 0.
        channels: length of every tendon inside the links, (..., m) [mm].
        along: unit vectors of the channels, parent to child hole, complex (..., m, n); y where there is none.
    """

    joints: Surfaces
    below: Tensor
    above: Tensor
    crosses: Tensor
    channels: Tensor
    along: Tensor

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
        along = safe / safe.abs()
        return cls(surfaces.joints(), holes[..., :-1, 1], holes[..., 1:, 0], crosses, channels, along)

    def detach(self) -> Geometry:
        """The geometry as a constant."""
        return Geometry(*(getattr(self, field.name).detach() for field in fields(self)))

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
