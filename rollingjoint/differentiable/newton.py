"""Equilibria of a batch by Newton's method in torch, each row with its own design; no tables are built.

Every row descends its energy; one that gets stuck is left to the compiled solver. Friction has no energy: every Newton
step is judged by the work of the holes with the grips at its beginning. Source: docs/theory.md, sections 7 and 9.
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
from rollingjoint.kernels.arrays import (
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
    current, stuck = _descended(*begin, _MOST_STEPS) if steps is None else _stepped(*begin, steps)
    held = problem.bounds.held(current.phi, current.residual)
    arrived = (current.worst(held) <= current.goal) & ~stuck
    return current.s, held, arrived & _definite(current.H, held)


def _descended(
    problem: _Equations, current: _Iterate, alpha: Tensor, stuck: Tensor, most: int
) -> tuple[_Iterate, Tensor]:
    """The rows after at most `most` steps, and which of them are stuck, (...); alpha (...) scales the first step.

    When few rows of many are left, they go on alone, which does not change their results.
    """
    for taken in range(most):
        held = problem.bounds.held(current.phi, current.residual)
        arrived = current.worst(held) <= current.goal
        active = ~(arrived | stuck)
        left = int(active.sum())
        if left == 0:
            break
        if 2 * left <= active.numel() - _WORTH:
            part = _descended(
                problem.chosen(active), current.chosen(active), alpha[active], stuck[active], most - taken
            )
            return current.put(active, part[0]), stuck.index_put((active,), part[1])
        current, alpha, stuck = _tried(problem, current, alpha, stuck, held, active)
    return current, stuck


def _stepped(
    problem: _Equations, current: _Iterate, alpha: Tensor, stuck: Tensor, steps: int
) -> tuple[_Iterate, Tensor]:
    """`_descended` in which every row takes part in every step, so that nobody has to look which rows are left."""
    for _ in range(steps):
        held = problem.bounds.held(current.phi, current.residual)
        active = ~((current.worst(held) <= current.goal) | stuck)
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
        return torch.where(held, 0.0, self.residual.abs()).amax(-1)

    def improves(self, before: _Iterate, held: Tensor, law: Law) -> Tensor:
        """Whether the energy falls by Armijo's rule; near rest, whether the residual does and the energy stays."""
        change = self.energy - before.energy
        if law.friction is not None and law.history is not None:
            moved = self.distal - before.distal
            change = change + frozen_work(law.friction.presliding, before.grips, before.reached, moved)
        slope = (before.residual * (self.phi - before.phi)).sum(-1)
        level = (change <= before.rounding) & (self.worst(held) < before.worst(held))
        return torch.isfinite(change) & ((change <= _ARMIJO * slope) & (slope < 0) | level)

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
        return (phi <= self.smallest) & (moment > 0) | (phi >= self.largest) & (moment < 0)

    def clip(self, phi: Tensor) -> Tensor:
        """The angles, within the ends."""
        return torch.minimum(torch.maximum(phi, self.smallest), self.largest)

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
        state = ChainState(self.geometry, self.law, self.loads, phi, contact)
        energy, magnitude = state.energy
        H = state.stiffness.expand(*phi.shape, phi.shape[-1])
        goal = (RELATIVE_GOAL * state.force_scale).clamp(RESIDUAL_FLOOR, RESIDUAL_GOAL)
        rubbing = state.rubbing
        none = phi.new_zeros(*phi.shape[:-1], 0, 0)
        friction = (none, none, none) if rubbing is None else (rubbing.distal, rubbing.reached, rubbing.grips)
        return _Iterate(s, phi, contact.kappa, state.residual, H, energy, ROUNDING * magnitude, goal, *friction)

    def chosen(self, mask: Tensor) -> _Equations:
        """The problem of the rows of a mask (...), which get one leading axis, (A)."""

        def rows(values: Tensor, axes: int = 1) -> Tensor:
            return values.expand(*mask.shape, *values.shape[values.ndim - axes :])[mask]

        whole, surfaces = self.geometry, self.geometry.joints
        joints = replace(
            surfaces,
            limits=rows(surfaces.limits, 3),
            borders=rows(surfaces.borders, 3),
            pieces=rows(surfaces.pieces, 4),
        )
        geometry = replace(
            whole,
            joints=joints,
            below=rows(whole.below, 2),
            above=rows(whole.above, 2),
            channels=rows(whole.channels),
            along=rows(whole.along, 2),
        )
        loads = Loads(rows(self.loads.table, 2), whole.crosses.shape[-1])
        bounds = _Bounds(geometry, rows(self.bounds.first))
        return _Equations(geometry, self.law.each(rows), loads, bounds)


def _step(current: _Iterate, bounds: _Bounds, held: Tensor, symmetric: bool) -> Tensor:
    """Newton's step of the free joints, (..., J) [rad]; a joint at an end that it pushes outwards is held, too."""
    step = _newton(current.H, current.residual, held, symmetric)
    outwards = held | bounds.held(current.phi, -step)
    if seen((outwards != held).any(), True):
        step = _newton(current.H, current.residual, outwards, symmetric)
    return step * (MAX_STEP / step.abs().amax(-1, keepdim=True).clamp(min=MAX_STEP))


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


def freed(H: Tensor, held: Tensor) -> Tensor:
    """H with the rows and columns of held joints those of the identity."""
    either = held[..., :, None] | held[..., None, :]
    return torch.where(either, 0.0, H) + torch.diag_embed(held.to(H.dtype))


def _definite(H: Tensor, held: Tensor) -> Tensor:
    """Whether H over the free joints is positive definite beyond rounding, (...)."""
    largest = torch.where(held[..., :, None] | held[..., None, :], 0.0, H.abs()).flatten(-2).amax(-1)
    factor, failed = torch.linalg.cholesky_ex(freed(0.5 * (H + H.mT), held))
    pivots = factor.diagonal(dim1=-2, dim2=-1).square()
    firm = torch.where(held, torch.inf, pivots).amin(-1) > SMALLEST_PIVOT * largest
    return (failed == 0) & firm & (largest >= NEGLIGIBLE) | held.all(-1)
