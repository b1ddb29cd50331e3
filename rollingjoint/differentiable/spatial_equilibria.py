"""Differentiable equilibria of chains in space: results of the solvers."""

from __future__ import annotations

import math
from functools import cached_property

import torch
from torch import Tensor

from rollingjoint.chain.contact_line import friction_quadratic
from rollingjoint.chain.spatial_equilibrium import FRICTION, PRESSURE_ANGLE, as_pressure_angle
from rollingjoint.checks import as_friction
from rollingjoint.differentiable.equilibria import Equilibria
from rollingjoint.differentiable.newton import freed
from rollingjoint.differentiable.spatial_statics import SpatialState

_NEGLIGIBLE = 1e-12  # of the normal force: a smaller force along the line needs no friction


class SpatialEquilibria(Equilibria):
    """Equilibria of a batch of chains in space.

    Names, shapes and units as in `rollingjoint.SpatialEquilibrium`, with any leading axes; all else as in the plane.
    """

    @property
    def _spatial(self) -> SpatialState:
        assert isinstance(self._state, SpatialState)
        return self._state

    @cached_property
    def poses(self) -> Tensor:
        """(..., n, 4, 4) of every link [mm]."""
        state = self._spatial
        above = torch.cat([state.rotations, state.positions[..., None]], -1)
        last = torch.tensor([0.0, 0.0, 0.0, 1.0], dtype=above.dtype, device=above.device)
        return self._shown(torch.cat([above, last.expand(*above.shape[:-2], 1, 4)], -2))

    @property
    def tip(self) -> Tensor:
        """(..., 3) origin of the last link [mm]."""
        return self.poses[..., -1, :3, 3]

    @property
    def arc_lengths(self) -> Tensor:
        """(..., n - 1) contact on both surfaces [mm]; NaN at joints without surfaces."""
        return torch.where(self._spatial.planes.hinges, torch.nan, self._shown(self._s))

    @property
    def contact_points(self) -> Tensor:
        """(..., n - 1, 3) middle of the contact line, or the point of a hinge [mm]."""
        return self._shown(self._spatial.contacts)

    @property
    def contact_tangents(self) -> Tensor:
        """(..., n - 1, 3) unit tangents."""
        return self._shown(self._spatial.tangents)

    @cached_property
    def reactions(self) -> Tensor:
        """(..., n - 1, 6) force on the link above and its moment about the contact, along tangent, normal and axis."""
        return self._shown(self._spatial.reactions)

    @property
    def contact_forces(self) -> Tensor:
        """(..., n - 1, 2) on the distal link, along tangent and normal [N]."""
        return self.reactions[..., :2]

    def tip_compliance(self, added_stiffness: Tensor) -> Tensor:
        """(..., 3, 3) deflection of the tip per force on it [mm/N].

        Args:
            added_stiffness: of the joints beside `stiffness`, (..., n - 1, n - 1) [N·mm/rad].
        """
        arms = self.tip[..., None, :] - self.contact_points
        rates = torch.linalg.cross(self._shown(self._spatial.axes), arms) * self.free_joints[..., None]
        ok = self.ok[..., None]
        H = freed(self.stiffness + added_stiffness, ~self.free_joints | ~ok)
        return rates.mT @ torch.linalg.solve_ex(H, rates)[0]

    @property
    def pressing_margins(self) -> Tensor:
        """(..., n - 1) normal force on the contact [N]; negative: the links separate. inf at hinges."""
        return self._bounded(self.reactions[..., 1])

    @property
    def tilting_margins(self) -> Tensor:
        """(..., n - 1) twice the smaller force at an end of the contact line [N]; negative: that end lifts."""
        return self._bounded(2.0 * self._ends[0].amin(-1))

    @property
    def friction_required(self) -> Tensor:
        """(..., n - 1) smallest coefficient of friction with which the contact line can carry the reaction.

        inf where an end of the line lifts; 0 at hinges. Source: docs/theory.md, section 11.
        """
        normal, side = self._ends
        carried = (normal > 0.0).all(-1) & ~self._spatial.planes.hinges
        normal, side = (torch.where(carried[..., None], part, unit) for part, unit in ((normal, 1.0), (side, 0.0)))
        required = _least_friction(normal, side, torch.where(carried, self.reactions[..., 2], 0.0))
        return torch.where(self._spatial.planes.hinges, 0.0, torch.where(carried, required, torch.inf))

    def slip_margins(self, friction: float = FRICTION) -> Tensor:
        """(..., n - 1) (friction - friction_required) × normal force [N]; negative: the links slip."""
        friction = as_friction(friction)
        return self._bounded((friction - self.friction_required) * self.reactions[..., 1].abs())

    def tooth_margins(self, pressure_angle: float = PRESSURE_ANGLE) -> Tensor:
        """(..., n - 1) normal less separating force at the worse end, spur teeth carrying all tangential force [N].

        Negative means that they climb out of mesh; pressure_angle: of their flanks, from 0 to below π/2 [rad].
        """
        angle, (normal, side) = as_pressure_angle(pressure_angle), self._ends
        return self._bounded((normal - side.abs() * math.tan(angle)).amin(-1))

    @property
    def strap_forces(self) -> Tensor:
        """(..., n - 1, 2) tension across the contact that keeps each end of its line from lifting [N]."""
        return torch.where(self._spatial.planes.hinges[..., None], 0.0, torch.relu(-self._ends[0]))

    @property
    def _ends(self) -> tuple[Tensor, Tensor]:
        """Normal and tangential forces at both ends of the contact lines that carry the reactions, (..., n - 1, 2)."""
        along, pressing, about_tangent, about_normal = (self.reactions[..., k] for k in (0, 1, 3, 4))
        widths = self._spatial.planes.half_widths
        tilt, twist = about_tangent / widths, about_normal / widths
        normal = 0.5 * torch.stack([pressing - tilt, pressing + tilt], -1)
        return normal, 0.5 * torch.stack([along + twist, along - twist], -1)

    def _bounded(self, margins: Tensor) -> Tensor:
        """The margins of contacts, inf at hinges."""
        return torch.where(self._spatial.planes.hinges, torch.inf, margins)


def _least_friction(normal: Tensor, side: Tensor, axial: Tensor) -> Tensor:
    """As chain.contact_line.least_friction, where both ends press: normal, side (..., 2), axial (...) [N].

    The cases are told apart anew, since roots of 0 have no finite derivatives.
    """
    alpha, beta, c = normal.square(), side.square(), axial.square()
    low = (beta / alpha).amax(-1)
    room = (low[..., None] * alpha - beta).detach().clamp(min=0.0).sqrt().sum(-1)
    (first, second), (b, d) = alpha.unbind(-1), beta.unbind(-1)
    inside = axial.detach().abs() <= room + _NEGLIGIBLE * normal.detach().sum(-1)
    root = _root(*friction_quadratic(first, second, b, d, c), inside)
    squared = torch.where(inside, low, torch.maximum(root, low))
    positive = squared.detach() > 0.0
    return torch.where(positive, torch.where(positive, squared, 1.0).sqrt(), 0.0)


def _root(A: Tensor, B: Tensor, C: Tensor, inside: Tensor) -> Tensor:
    """The smaller root of A x² - B x + C; 1 where it is not asked for."""
    A, B, C = (torch.where(inside, unit, part) for part, unit in ((A, 0.0), (B, 1.0), (C, 1.0)))
    square = B.square() - 4.0 * A * C
    positive = square.detach() > 0.0
    return 2.0 * C / (B + torch.where(positive, torch.where(positive, square, 1.0).sqrt(), 0.0))
