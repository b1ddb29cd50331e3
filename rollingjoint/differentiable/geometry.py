"""Geometry of a chain: contacts of surfaces, routes of tendons. The plane is the complex plane: x + iy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import torch
from torch import Tensor

from rollingjoint.differentiable.looking import seen
from rollingjoint.differentiable.surface import Place, Surfaces


class Joints(NamedTuple):
    """Every joint at its angle phi, in the frame of the link below: complex (..., J) each."""

    turn: Tensor  # exp(i phi)
    touching: Tensor  # contact point, mm
    origin: Tensor  # of the link above, mm
    tangent: Tensor  # unit tangent e at the contact
    pole: Tensor  # rate of the contact point with the angle, e / kappa, mm/rad


@dataclass(frozen=True)
class Contact:
    """Contact of the surfaces of every joint; the place has (..., J, 2), child and parent."""

    place: Place

    @property
    def s(self) -> Tensor:
        """Arc lengths, (..., J) [mm]."""
        return self.place.s[..., 0]

    @cached_property
    def tangent_angles(self) -> Tensor:
        """Tangent angles in the frames of both links, (..., J, 2) [rad]."""
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
        """Contact points in the frames of both links, complex (..., J, 2) [mm]."""
        return self.place.point()

    @cached_property
    def tangents(self) -> Tensor:
        """Unit tangents in the frame of the link below, complex (..., J)."""
        return turned(self.tangent_angles[..., 0])

    def joints(self, phi: Tensor) -> Joints:
        """The joints at angles phi, (..., J) [rad]; for derivatives the contacts must depend on phi."""
        turn, (below, above) = turned(phi), self.points.unbind(-1)
        return Joints(turn, below, below - turn * above, self.tangents, self.tangents / self.kappa)

    def moved(self, by: Tensor) -> Contact:
        """The contacts moved by this arc length, (..., J) [mm]."""
        return Contact(self.place.moved(by[..., None]))


@dataclass(frozen=True)
class Routes:
    """Routes of the tendons through the links, in the planes of the joints.

    Attributes:
        below, above: complex, (..., m, J) holes at the two ends of every gap, in the frames of their links [mm].
        crosses: whether tendon j crosses joint i, (m, J), 1 or 0.
        channels: length of every tendon inside the links, (..., m) [mm].
        along: unit vectors of the channels, parent to child hole, complex (..., m, n); y for an empty channel. Only
            friction needs them: None where no friction can act.
        aside: in space, along the axis of the joint, the upper hole from the lower one, (..., m, J) [mm]; in the plane
            None.
        entry: likewise the lower hole from the middle of the contact.
        leads: in space, unit vectors of the channels below and above every gap, in the directions of the plane and the
            axis, (..., m, J, 2, 3); only friction needs them.
    """

    below: Tensor
    above: Tensor
    crosses: Tensor
    channels: Tensor
    along: Tensor | None = None
    aside: Tensor | None = None
    entry: Tensor | None = None
    leads: Tensor | None = None

    def each(self, change: Callable[[Tensor, int], Tensor]) -> Routes:
        """The same with every tensor but `crosses` changed, by a function of it and its number of trailing axes."""
        parts = (self.along, 2), (self.aside, 2), (self.entry, 2), (self.leads, 4)
        gaps = (None if part is None else change(part, axes) for part, axes in parts)
        return Routes(change(self.below, 2), change(self.above, 2), self.crosses, change(self.channels, 1), *gaps)


@dataclass(frozen=True)
class Planes:
    """Planes of the joints of a chain in space, fixed in their links, and the springs of the joints.

    Attributes:
        frames: lateral and axial direction and axis, rows in the link below, (..., J, 3, 3).
        half_widths: of the contact lines, (..., J) [mm].
        middles, shifts: along the axis, the middle of the contact, and the origin of the link above, (..., J) [mm].
        stiffnesses, rests: of the torsion springs, (..., J) [N·mm/rad, rad].
        below, above: hinges in the planes of the links below and above, complex (..., J) [mm].
        hinges: whether a joint is a hinge, (J,).
    """

    frames: Tensor
    half_widths: Tensor
    middles: Tensor
    shifts: Tensor
    stiffnesses: Tensor
    rests: Tensor
    below: Tensor
    above: Tensor
    hinges: Tensor

    def each(self, change: Callable[[Tensor, int], Tensor]) -> Planes:
        """The same with every tensor but `hinges` changed, by a function of it and its number of trailing axes."""
        numbers = "half_widths", "middles", "shifts", "stiffnesses", "rests", "below", "above"
        return replace(
            self, frames=change(self.frames, 3), **{name: change(getattr(self, name), 1) for name in numbers}
        )

    def joints(self, joints: Joints) -> Joints:
        """The joints of surfaces, with the hinges in their places."""
        at_hinges = Joints(joints.turn, self.below, self.below - joints.turn * self.above, *_STILL)
        pairs = zip(at_hinges, joints, strict=True)
        return Joints(*(torch.where(self.hinges, hinge, contact) for hinge, contact in pairs))


_STILL = torch.tensor(1.0 + 0.0j, dtype=torch.complex128), torch.tensor(0.0j, dtype=torch.complex128)
"""Tangent and rate of the contact point of a hinge."""


@dataclass(frozen=True)
class Geometry:
    """Geometry that does not depend on the pose.

    Attributes:
        joints: (..., J, 2) surfaces: child below, parent above.
        routes: of the tendons.
        planes: of the joints, in space; in the plane None.
    """

    joints: Surfaces
    routes: Routes
    planes: Planes | None = None

    def detach(self) -> Geometry:
        """The geometry as a constant."""
        return replace(self.each(lambda tensor, _: tensor.detach()), joints=self.joints.detach())

    def each(self, change: Callable[[Tensor, int], Tensor]) -> Geometry:
        """The same surfaces, with every tensor of routes and planes changed."""
        planes = None if self.planes is None else self.planes.each(change)
        return Geometry(self.joints, self.routes.each(change), planes)

    @cached_property
    def limits(self) -> tuple[Tensor, Tensor]:
        """First and last arc length of every joint, (..., J) each [mm]."""
        return self.joints.common_range()

    def contact(self, s: Tensor) -> Contact:
        """The contacts at arc lengths s, (..., J)."""
        return Contact(self.joints.at(s[..., None].expand(*s.shape, 2)))

    def contacts(self, phi: Tensor, guess: Tensor, iterations: int = 60) -> Tensor:
        """Contacts s at joint angles phi, (..., J) [mm], constants; Newton's method from a guess, in a bracket."""
        low, high = self.limits
        low, high = low.expand_as(phi), high.expand_as(phi)
        s = torch.minimum(torch.maximum(guess, low), high)
        for _ in range(iterations):
            contact = self.contact(s)
            error = contact.angles - phi  # falls as s grows
            if seen((error.abs() <= 2e-15 * (1.0 + phi.abs())).all(), False):
                break
            low, high = torch.where(error > 0, s, low), torch.where(error > 0, high, s)
            newton = s - error / contact.kappa
            s = torch.where((newton >= low) & (newton <= high), newton, 0.5 * (low + high))
        return s


def turned(angle: Tensor) -> Tensor:
    """exp(i angle): a product with it turns by the angle."""
    return torch.complex(torch.cos(angle), torch.sin(angle))
