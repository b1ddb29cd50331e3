"""Newton's method on many rows in torch: an iteration for every solver, and the equilibria of a batch of designs.

`LineSearches.advanced` is the iteration; an `EnergyProblem` defines the rest: the place of trials, and the course where
the stiffness is not definite. No number is read back from a device here.

`minimise` solves a batch in which every row has a separate design; no tables are built. Every row descends its energy;
a row that gets stuck is left to the compiled solver. Friction has no energy: every Newton step is judged by the work of
the holes with the grips at its beginning. Source: docs/theory.md, sections 7 and 9.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple, Protocol

import torch
from torch import Tensor

from rollingjoint.differentiable.geometry import Geometry
from rollingjoint.differentiable.loads import AnyLoads
from rollingjoint.differentiable.looking import may_look, seen
from rollingjoint.differentiable.slip import frozen_work
from rollingjoint.differentiable.spatial_statics import state_at
from rollingjoint.differentiable.statics import ChainState, Law
from rollingjoint.kernels.arrays import (
    MAX_STEP,
    NEGLIGIBLE,
    RELATIVE_GOAL,
    RESIDUAL_FLOOR,
    RESIDUAL_GOAL,
    ROUNDING,
    SMALLEST_PIVOT,
)

_MAX_STEPS = 60
_ARMIJO = 1e-4
_AT_END = 1e-13  # rad
_WORTH = 64  # rows; half of the batch and at least these must have converged before the remaining rows go on alone

Origin = tuple[Tensor, ...]
"""Memory of a problem of the pose where a line search began; joint angles, (..., J) [rad], come first."""


class EnergyProblem(Protocol):
    """Chains in search of equilibria, as the iteration sees them."""

    @property
    def limits(self) -> tuple[Tensor, Tensor]:
        """Smallest and largest angle of every joint, (..., J) each or with fewer rows [rad]."""

    @property
    def shortest(self) -> float:
        """The smallest part of a step that is tried."""

    @property
    def helps(self) -> bool:
        """Whether rows go on where the stiffness is not definite."""

    def step(self, state: ChainState, held: Tensor) -> tuple[Tensor, Tensor]:
        """Newton's step of the free joints, (..., J) [rad]; whether the stiffness is definite, (...)."""

    def trial(self, origin: Origin, step: Tensor) -> Tensor:
        """The next point to evaluate, (..., J), one step from the origin."""

    def work(self, before: Origin, after: Origin) -> Tensor | float:
        """Work of the step between them against friction, which has no energy, (...) [N·mm]."""


class LineSearches(NamedTuple):
    """The line searches of all rows, (...); a row that neither runs nor has arrived is left to another solver."""

    running: Tensor
    arrived: Tensor
    x: Tensor  # to be evaluated next, (..., J): joint angles, or contacts
    held: Tensor  # joints at an end of their surfaces where the line search began, (..., J)
    origin: Origin
    residual: Tensor  # at the origin, (..., J)
    step: Tensor  # from the origin, (..., J)
    energy: Tensor  # at the origin
    magnitude: Tensor
    worst: Tensor
    part: Tensor  # of the step that is tried

    @classmethod
    def begun(cls, x: Tensor, origin: Origin, running: Tensor) -> LineSearches:
        """Searches from these points in the running rows. The first evaluation is always accepted."""
        none, nothing = torch.zeros_like(running), torch.zeros_like(x)
        zero, unit = torch.zeros_like(x[..., 0]), torch.ones_like(x[..., 0])
        never = torch.zeros_like(x, dtype=torch.bool)
        return cls(running, none, x, never, origin, nothing, nothing, unit * torch.inf, zero, zero, unit)

    def advanced(self, problem: EnergyProblem, state: ChainState, point: Origin) -> LineSearches:
        """The next points of every row, from the state at its points: another step, a shorter one, or the end."""
        (low, high), r, phi = problem.limits, state.residual, point[0]
        held = pressed(phi, low, high, r)
        worst, (energy, magnitude) = largest_free(r, held), state.energy
        slope = (self.residual * (phi - self.origin[0])).sum(-1)
        fall, noise = self.energy - energy - problem.work(self.origin, point), ROUNDING * (self.magnitude + magnitude)
        accepted = improves(fall, slope, noise, worst, self.worst) & self.running
        full_step, definite = problem.step(state, held)
        at_rest = accepted & (worst <= residual_goal(state.force_scale))

        part = torch.where(accepted, 1.0, 0.5 * self.part)
        running = self.running & ~at_rest & (part >= problem.shortest)
        if not problem.helps:
            running = running & (definite | ~accepted)
        taken = accepted[..., None]
        origin = tuple(_where(accepted, *pair) for pair in zip(point, self.origin, strict=True))
        step = torch.where(taken, full_step, self.step)
        return LineSearches(
            running,
            self.arrived | at_rest & definite,
            torch.where(running[..., None], problem.trial(origin, part[..., None] * step), self.x),
            torch.where(taken, held, self.held),
            origin,
            torch.where(taken, r, self.residual),
            step,
            torch.where(accepted, energy, self.energy),
            torch.where(accepted, magnitude, self.magnitude),
            torch.where(accepted, worst, self.worst),
            part,
        )

    def chosen(self, mask: Tensor) -> LineSearches:
        """The rows of a mask (...), with one leading axis, (A, ...)."""
        origin = tuple(values[mask] for values in self.origin)
        return LineSearches(**{name: getattr(self, name)[mask] for name in _OF_ROWS}, origin=origin)

    def put(self, mask: Tensor, part: LineSearches) -> LineSearches:
        """All rows, with the rows of a mask (...) replaced by the part."""
        pairs = zip(self.origin, part.origin, strict=True)
        origin = tuple(values.index_put((mask,), new) for values, new in pairs)
        rows = {name: getattr(self, name).index_put((mask,), getattr(part, name)) for name in _OF_ROWS}
        return LineSearches(**rows, origin=origin)


_OF_ROWS = [name for name in LineSearches._fields if name != "origin"]


def minimise(
    geometry: Geometry, law: Law, loads: AnyLoads, s: Tensor, steps: int | None = None
) -> tuple[Tensor, Tensor, Tensor]:
    """Stable equilibria from contacts s, (..., J) [mm]; `steps`: exact number of Newton steps of all rows.

    Returns:
        contacts (..., J) at the equilibria; whether each joint is held at the end of a surface, (..., J); whether each
        row has converged, (...).
    """
    problem = _DesignProblem.of(geometry, law, loads, s)
    s = within(s, problem.first, problem.last)
    potential = ~loads.without_potential().expand(s.shape[:-1])  # follower forces have none
    search = LineSearches.begun(s, problem.nowhere(s), potential)
    search = _descended(problem, search, 1 + (_MAX_STEPS if steps is None else steps), steps is None)
    return search.x, search.held, search.arrived


def _descended(problem: _DesignProblem, search: LineSearches, count: int, looking: bool) -> LineSearches:
    """The rows after at most `count` evaluations.

    With `looking` it ends when no row runs; few remaining rows go on alone, which does not change their results.
    Otherwise every row takes part in every evaluation.
    """
    for evaluations in range(1, count + 1):
        search = search.advanced(problem, *problem.at(search.x))
        running = search.running
        remaining = int(running.sum()) if looking else running.numel()
        if remaining == 0:
            break
        if 2 * remaining <= running.numel() - _WORTH:
            part = _descended(problem.chosen(running), search.chosen(running), count - evaluations, looking)
            return search.put(running, part)
    return search


@dataclass(frozen=True)
class _DesignProblem:
    """The problem of a batch of designs; x are contacts s. The angle falls as the contact moves on."""

    shortest: ClassVar[float] = 1.0 / 256
    helps: ClassVar[bool] = True
    geometry: Geometry
    law: Law
    loads: AnyLoads
    first: Tensor  # ends of the surfaces, (..., J) mm
    last: Tensor
    limits: tuple[Tensor, Tensor]

    @classmethod
    def of(cls, geometry: Geometry, law: Law, loads: AnyLoads, like: Tensor) -> _DesignProblem:
        """The problem with the rows of contacts (..., J)."""
        first, last = (side.expand_as(like) for side in geometry.limits)
        largest, smallest = (geometry.contact(side).angles for side in (first, last))
        return cls(geometry, law, loads, first, last, (smallest, largest))

    @property
    def _rubs(self) -> bool:
        return self.law.friction is not None and self.law.history is not None

    def nowhere(self, s: Tensor) -> Origin:
        """An origin before the first evaluation at s, (..., J)."""
        gaps = s.new_zeros(*s.shape[:-1], *self.geometry.routes.crosses.shape)
        return torch.zeros_like(s), s, torch.ones_like(s), *([gaps] * 3 if self._rubs else [])

    def at(self, s: Tensor) -> tuple[ChainState, Origin]:
        """The chains with their contacts at s; joint angles, s, kappa, and the terms of the work of friction."""
        contact = self.geometry.contact(s)
        phi = contact.angles
        state = state_at(self.geometry, self.law, self.loads, phi, contact)
        rubbing = state.rubbing
        friction = () if rubbing is None else (rubbing.distal, rubbing.reached, rubbing.grips)
        return state, (phi, s, contact.kappa, *friction)

    def step(self, state: ChainState, held: Tensor) -> tuple[Tensor, Tensor]:
        """See EnergyProblem; a joint at an end that its step pushes outwards is held, too."""
        r = state.residual
        H = state.stiffness.expand(*r.shape, r.shape[-1])
        step, definite = _newton(H, r, held, not self._rubs)
        outwards = held | pressed(state.phi, *self.limits, -step)
        if seen((outwards != held).any(), True):
            step, _ = _newton(H, r, outwards, not self._rubs)
        return shortened(step), definite

    def trial(self, origin: Origin, step: Tensor) -> Tensor:
        """See EnergyProblem: two corrections, which near rest are exact; exactly an end at an end."""
        (phi, s, kappa), (smallest, largest) = origin[:3], self.limits
        phi = within(phi + step, smallest, largest)
        s = self.geometry.contacts(phi, s + step / kappa, 2)
        return torch.where(phi <= smallest, self.last, torch.where(phi >= largest, self.first, s))

    def work(self, before: Origin, after: Origin) -> Tensor | float:
        """See EnergyProblem."""
        if self.law.friction is None or not self._rubs:
            return 0.0
        distal, reached, grips = before[3:]
        return frozen_work(self.law.friction.presliding, grips, reached, after[3] - distal)

    def chosen(self, mask: Tensor) -> _DesignProblem:
        """The problem of the rows of a mask (...), which get one leading axis, (A)."""

        def rows(values: Tensor, axes: int = 1) -> Tensor:
            return values.expand(*mask.shape, *values.shape[values.ndim - axes :])[mask]

        surfaces = self.geometry.joints
        joints = replace(
            surfaces,
            limits=rows(surfaces.limits, 3),
            borders=rows(surfaces.borders, 3),
            pieces=rows(surfaces.pieces, 4),
        )
        loads = type(self.loads)(rows(self.loads.table, 2), self.geometry.routes.crosses.shape[-1])
        geometry = replace(self.geometry.each(rows), joints=joints)
        return _DesignProblem.of(geometry, self.law.each(rows), loads, rows(self.first))


def _newton(H: Tensor, residual: Tensor, held: Tensor, symmetric: bool) -> tuple[Tensor, Tensor]:
    """-H⁻¹ r on the free joints; where H is not definite, with its eigenvalues replaced by their magnitudes.

    Without looks of the host these rows step down the gradient, no longer than the stiffness admits.

    Friction and follower forces make H nonsymmetric; then its symmetric part counts. Returns also whether H is
    definite, (...).
    """
    free, right = freed(H, held), torch.where(held, 0.0, -residual)
    even = free if symmetric else 0.5 * (free + free.mT)
    factor, bad, firm = factored(even, held)
    if symmetric:
        step = torch.cholesky_solve(right[..., None], factor)[..., 0]
    else:
        step = torch.linalg.solve_ex(free, right[..., None])[0][..., 0]
    firm = firm | held.all(-1)
    if not may_look():
        down = right / even.abs().sum(-1).amax(-1, keepdim=True).clamp(min=1e-300)
        return torch.where(bad[..., None], down, step), firm
    if bool(bad.any()):
        values, vectors = torch.linalg.eigh(torch.nan_to_num(even[bad]))
        values = torch.maximum(values.abs(), 1e-6 * values.abs().amax(-1, keepdim=True).clamp(min=1e-300))
        step = step.clone()
        step[bad] = (vectors @ ((vectors.mT @ right[bad][..., None]) / values[..., None]))[..., 0]
    return step, firm


def residual_goal(force_scale: Tensor) -> Tensor:
    """Largest residual at rest, (...) [N·mm]."""
    return (RELATIVE_GOAL * force_scale).clamp(RESIDUAL_FLOOR, RESIDUAL_GOAL)


def largest_free(values: Tensor, held: Tensor) -> Tensor:
    """Largest magnitude of values (..., J) over the free joints, (...)."""
    return torch.where(held, 0.0, values.abs()).amax(-1)


def improves(fall: Tensor, slope: Tensor, noise: Tensor, worst: Tensor, worst_before: Tensor) -> Tensor:
    """Whether a step is accepted, (...): by Armijo's rule; within the noise of the energy if the residual falls.

    Args:
        fall: of the energy [N·mm].
        slope: of the energy where the step began, along the whole step [N·mm].
        noise: rounding of the energies [N·mm].
        worst, worst_before: largest residual of a free joint after and before it [N·mm].
    """
    return (fall > noise) & (fall >= -_ARMIJO * slope) | (fall >= -noise) & (worst < worst_before)


def shortened(step: Tensor) -> Tensor:
    """The steps (..., J) [rad], at most MAX_STEP in every joint."""
    return step * (MAX_STEP / step.abs().amax(-1, keepdim=True).clamp(min=MAX_STEP))


def pressed(angles: Tensor, smallest: Tensor, largest: Tensor, moment: Tensor) -> Tensor:
    """Joints at an end of their surfaces that a moment pushes outwards, (..., J)."""
    return (angles <= smallest + _AT_END) & (moment > 0.0) | (angles >= largest - _AT_END) & (moment < 0.0)


def within(angles: Tensor, smallest: Tensor, largest: Tensor) -> Tensor:
    """The angles, within the ends of the surfaces."""
    return torch.minimum(torch.maximum(angles, smallest), largest)


def freed(H: Tensor, held: Tensor) -> Tensor:
    """H with the rows and columns of held joints replaced by the identity."""
    held_pair = held[..., :, None] | held[..., None, :]
    return torch.where(held_pair, 0.0, H) + torch.diag_embed(held.to(H.dtype))


def factored(free: Tensor, held: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Cholesky factor of a `freed` H; where there is none, (...); where H is definite beyond rounding, (...)."""
    factor, failed = torch.linalg.cholesky_ex(free)
    size = largest_free(free.diagonal(dim1=-2, dim2=-1), held)
    pivots = torch.where(held, torch.inf, factor.diagonal(dim1=-2, dim2=-1).square()).amin(-1)
    bad = failed > 0
    return factor, bad, ~bad & (pivots > SMALLEST_PIVOT * size) & (size >= NEGLIGIBLE)


def _where(mask: Tensor, new: Tensor, old: Tensor) -> Tensor:
    """New values (..., any) in the rows of a mask (...)."""
    return torch.where(mask[(..., *(None,) * (new.ndim - mask.ndim))], new, old)
