"""Equilibria of a batch by Newton's method in torch, each row with its own design; no tables are built.

Every row descends its energy; one that gets stuck is left to the compiled solver. Friction has no energy: every Newton
step is judged by the work of the holes with the grips at its beginning. Source: docs/theory.md, sections 7 and 9.

The public functions at the end are the rules that `side_by_side` goes by as well; nothing in them reads a number back.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import torch
from torch import Tensor

from rollingjoint.differentiable.geometry import Geometry
from rollingjoint.differentiable.loads import Loads
from rollingjoint.differentiable.looking import may_look, seen
from rollingjoint.differentiable.slip import frozen_work
from rollingjoint.differentiable.statics import ChainState, Law
from rollingjoint.kernels.shared.tolerances import (
    MAX_STEP,
    NEGLIGIBLE,
    RELATIVE_GOAL,
    RESIDUAL_FLOOR,
    RESIDUAL_GOAL,
    ROUNDING,
    SMALLEST_PIVOT,
)

_MOST_STEPS = 60
_SMALLEST_STEP = 1.0 / 256
_ARMIJO = 1e-4
_AT_END = 1e-13  # rad
_WORTH = 64  # rows; half of the batch and this many must have converged before the others go on alone


def minimise(
    geometry: Geometry, law: Law, loads: Loads, s: Tensor, steps: int | None = None
) -> tuple[Tensor, Tensor, Tensor]:
    """Stable equilibria from contacts s, (..., J) [mm]: with `steps` so many Newton steps of all rows, no more or less.

    Returns:
        contacts (..., J) at the equilibria; whether each joint is held at the end of a surface, (..., J); whether each
        row has converged, (...).
    """
    problem = _Equations(geometry, law, loads, _Bounds(geometry, s))
    s = torch.minimum(torch.maximum(s, problem.bounds.first), problem.bounds.last)
    current = problem.at(s)
    follow = loads.without_potential().expand(current.energy.shape)  # such forces have no energy
    begin = problem, current, torch.ones_like(current.energy), follow
    current, stuck = _descended(*begin, _MOST_STEPS if steps is None else steps, steps is None)
    held = problem.bounds.held(current.phi, current.residual)
    arrived = (current.worst(held) <= current.goal) & ~stuck
    return current.s, held, arrived & _definite(current.H, held)


def _descended(
    problem: _Equations, current: _Iterate, alpha: Tensor, stuck: Tensor, most: int, looking: bool
) -> tuple[_Iterate, Tensor]:
    """The rows after at most `most` steps, and which of them are stuck, (...); alpha (...) scales the first step.

    Looking, it ends when no row is left, and when few of many are, they go on alone, which does not change their
    results; else every row takes part in every step.
    """
    for taken in range(most):
        held = problem.bounds.held(current.phi, current.residual)
        active = ~((current.worst(held) <= current.goal) | stuck)
        left = int(active.sum()) if looking else active.numel()
        if left == 0:
            break
        if 2 * left <= active.numel() - _WORTH:
            rest = problem.chosen(active), current.chosen(active), alpha[active], stuck[active]
            part, ended = _descended(*rest, most - taken, looking)
            return current.put(active, part), stuck.index_put((active,), ended)
        current, alpha, stuck = _tried(problem, current, alpha, stuck, held, active)
    return current, stuck


def _tried(
    problem: _Equations, current: _Iterate, alpha: Tensor, stuck: Tensor, held: Tensor, active: Tensor
) -> tuple[_Iterate, Tensor, Tensor]:
    """The active rows after one step, or where they were if it makes nothing better; alpha and stuck after it."""
    law, bounds = problem.law, problem.bounds
    step = _step(current, bounds, held, law.history is None)
    phi = bounds.clip(current.phi + alpha[..., None] * step)
    trial = problem.at(bounds.contacts(phi, current, alpha[..., None] * step))
    better = active & trial.improves(current, held, law)
    current = current.replaced(trial, better)
    alpha = torch.where(better | ~active, 1.0, 0.5 * alpha)
    return current, alpha, stuck | (alpha < _SMALLEST_STEP)


class _Iterate(NamedTuple):
    """Every row at its current angles: (...) and (..., J), the stiffness (..., J, J)."""

    s: Tensor
    phi: Tensor
    kappa: Tensor
    residual: Tensor
    H: Tensor
    energy: Tensor
    rounding: Tensor  # of the energy
    goal: Tensor  # largest residual at rest
    distal: Tensor  # lengths, states before they are limited, grips: of friction, (..., m, J)
    reached: Tensor
    grips: Tensor

    def worst(self, held: Tensor) -> Tensor:
        """Largest residual of a free joint."""
        return largest_free(self.residual, held)

    def improves(self, before: _Iterate, held: Tensor, law: Law) -> Tensor:
        """Whether these rows are better than those before; with friction its work is part of the energy."""
        fall = before.energy - self.energy
        if law.friction is not None and law.history is not None:
            moved = self.distal - before.distal
            fall = fall - frozen_work(law.friction.presliding, before.grips, before.reached, moved)
        slope, noise = (before.residual * (self.phi - before.phi)).sum(-1), before.rounding + self.rounding
        return torch.isfinite(fall) & improves(fall, slope, noise, self.worst(held), before.worst(held))

    def replaced(self, other: _Iterate, where: Tensor) -> _Iterate:
        """These rows, those of `other` in the places of a mask, (...)."""
        if seen(where.all(), False):
            return other
        pairs = zip(self, other, strict=True)
        return _Iterate(*(torch.where(where[(..., *(None,) * (a.ndim - where.ndim))], b, a) for a, b in pairs))

    def chosen(self, mask: Tensor) -> _Iterate:
        """The rows of a mask (...), with one leading axis, (A, ...)."""
        return _Iterate(*(values[mask] for values in self))

    def put(self, mask: Tensor, part: _Iterate) -> _Iterate:
        """These rows, those of a mask (...) replaced by the part."""
        return _Iterate(*(values.index_put((mask,), new) for values, new in zip(self, part, strict=True)))


class _Bounds:
    """The ends of the surfaces, as contacts and as angles; the angle falls as the contact moves on."""

    def __init__(self, geometry: Geometry, like: Tensor) -> None:
        self._geometry = geometry
        self.first, self.last = (side.expand_as(like) for side in geometry.limits)
        self.largest, self.smallest = (geometry.contact(side).angles for side in (self.first, self.last))

    def held(self, phi: Tensor, moment: Tensor) -> Tensor:
        """Joints at an end that a moment pushes outwards."""
        return pressed(phi, self.smallest, self.largest, moment)

    def clip(self, phi: Tensor) -> Tensor:
        """The angles, within the ends."""
        return within(phi, self.smallest, self.largest)

    def contacts(self, phi: Tensor, current: _Iterate, step: Tensor) -> Tensor:
        """Contacts near the angles phi: two corrections, which near rest are exact; exactly an end at an end."""
        s = self._geometry.contacts(phi, current.s + step / current.kappa, 2)
        return torch.where(phi <= self.smallest, self.last, torch.where(phi >= self.largest, self.first, s))


class _Equations(NamedTuple):
    """What stays the same from step to step."""

    geometry: Geometry
    law: Law
    loads: Loads
    bounds: _Bounds

    def at(self, s: Tensor) -> _Iterate:
        """The rows with their contacts at s."""
        contact = self.geometry.contact(s)
        phi = contact.angles
        state = ChainState(self.geometry.routes, self.law, self.loads, phi, contact.joints(phi))
        energy, magnitude = state.energy
        H = state.stiffness.expand(*phi.shape, phi.shape[-1])
        goal = residual_goal(state.force_scale)
        rubbing = state.rubbing
        none = phi.new_zeros(*phi.shape[:-1], 0, 0)
        friction = (none, none, none) if rubbing is None else (rubbing.distal, rubbing.reached, rubbing.grips)
        return _Iterate(s, phi, contact.kappa, state.residual, H, energy, ROUNDING * magnitude, goal, *friction)

    def chosen(self, mask: Tensor) -> _Equations:
        """The problem of the rows of a mask (...), which get one leading axis, (A)."""

        def rows(values: Tensor, axes: int = 1) -> Tensor:
            return values.expand(*mask.shape, *values.shape[values.ndim - axes :])[mask]

        surfaces, routes = self.geometry.joints, self.geometry.routes
        joints = replace(
            surfaces,
            limits=rows(surfaces.limits, 3),
            borders=rows(surfaces.borders, 3),
            pieces=rows(surfaces.pieces, 4),
        )
        geometry = Geometry(joints, routes.each(rows))
        loads = Loads(rows(self.loads.table, 2), routes.crosses.shape[-1])
        bounds = _Bounds(geometry, rows(self.bounds.first))
        return _Equations(geometry, self.law.each(rows), loads, bounds)


def _step(current: _Iterate, bounds: _Bounds, held: Tensor, symmetric: bool) -> Tensor:
    """Newton's step of the free joints, (..., J) [rad]; a joint at an end that it pushes outwards is held, too."""
    step = _newton(current.H, current.residual, held, symmetric)
    outwards = held | bounds.held(current.phi, -step)
    if seen((outwards != held).any(), True):
        step = _newton(current.H, current.residual, outwards, symmetric)
    return shortened(step)


def _newton(H: Tensor, residual: Tensor, held: Tensor, symmetric: bool) -> Tensor:
    """-H⁻¹ r on the free joints; where H is not definite, with its eigenvalues replaced by their magnitudes.

    Where nobody looks which rows these are, theirs is a step down the gradient, no longer than the stiffness admits.

    Friction and follower forces make H nonsymmetric; it is its symmetric part that is then definite or not.
    """
    free, right = freed(H, held), torch.where(held, 0.0, -residual)
    even = free if symmetric else 0.5 * (free + free.mT)
    factor, failed = torch.linalg.cholesky_ex(even)
    if symmetric:
        step = torch.cholesky_solve(right[..., None], factor)[..., 0]
    else:
        step = torch.linalg.solve_ex(free, right[..., None])[0][..., 0]
    bad = failed > 0
    if not may_look():
        return torch.where(bad[..., None], right / even.abs().sum(-1).amax(-1, keepdim=True).clamp(min=1e-300), step)
    if bool(bad.any()):
        values, vectors = torch.linalg.eigh(torch.nan_to_num(even[bad]))
        values = torch.maximum(values.abs(), 1e-6 * values.abs().amax(-1, keepdim=True).clamp(min=1e-300))
        step = step.clone()
        step[bad] = (vectors @ ((vectors.mT @ right[bad][..., None]) / values[..., None]))[..., 0]
    return step


def _definite(H: Tensor, held: Tensor) -> Tensor:
    """Whether H over the free joints is positive definite beyond rounding, (...)."""
    factor, failed = torch.linalg.cholesky_ex(freed(0.5 * (H + H.mT), held))
    return (failed == 0) & definite(H, held, factor.diagonal(dim1=-2, dim2=-1).square()) | held.all(-1)


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
    """H with the rows and columns of held joints those of the identity."""
    either = held[..., :, None] | held[..., None, :]
    return torch.where(either, 0.0, H) + torch.diag_embed(held.to(H.dtype))


def definite(H: Tensor, held: Tensor, pivots: Tensor) -> Tensor:
    """Whether H over the free joints, of these pivots (..., J), is positive definite beyond rounding, (...)."""
    size = largest_free(H.diagonal(dim1=-2, dim2=-1), held)
    return (torch.where(held, torch.inf, pivots).amin(-1) > SMALLEST_PIVOT * size) & (size >= NEGLIGIBLE)
