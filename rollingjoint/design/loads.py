"""Objectives under a lateral force at the tip: stiffness, load capacity, peak tension.

The force is perpendicular to the axis of the tip link in the pose without load, and keeps its direction (a dead load
at the link's origin). Cases with a load start from the pose without load.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor

from rollingjoint.checks import as_integer, as_number, as_positive
from rollingjoint.design.objectives import (
    Measured,
    Rows,
    checked_tensions,
    constant,
    freeze,
    tip_loads,
)
from rollingjoint.differentiable import DifferentiableChain, solve_lengths, solve_tensions
from rollingjoint.differentiable.equilibria import Equilibria

_SMALLEST_MOVE = 1e-6  # mm; smaller deflections of the tip count as this
_STIFFEST = 1e9  # N·mm/rad; the eigenvalue of a chain with all joints held


@dataclass(frozen=True)
class LateralStiffness:
    """Lateral force over the deflection of the tip at given tensions, the least over poses and sides [N/mm].

    Solved: the equilibrium without load under each pair of tensions; under the same, constant tensions, the
    equilibrium with a force on either side of the tip. Measured: the force over the displacement of the tip along it
    (a secant). Joints at the end of a surface do not yield; a pose in which all joints are held counts as a deflection
    of 1e-6 mm.
    Source: docs/theory.md, sections 3 and 5.

    Args:
        tensions: of the tendons in every pose, (P, m) [N].
        force: size of the force [N], above 0.
    Raises:
        InvalidInput: no pose, tendons that push or are all slack, a force that is not above 0.
    """

    tensions: Rows = ((5.0, 5.0), (7.0, 3.0), (3.0, 7.0))
    force: float = 0.1
    name: ClassVar[str] = "lateral_stiffness"
    unit: ClassVar[str] = "N/mm"
    maximise: ClassVar[bool] = True

    def __post_init__(self) -> None:
        freeze(self, tensions=checked_tensions("LateralStiffness tensions", self.tensions))
        as_positive("LateralStiffness force", self.force, "a force above 0 [N]")

    def measure(self, chain: DifferentiableChain) -> Measured:
        """The least stiffness of every design, (B,) [N/mm]."""
        tensions = constant(self.tensions, chain)
        free = solve_tensions(chain[:, None], tensions)
        push = _sides(free)  # (B, P, 2, 2)
        loads = tip_loads(self.force * push, chain)
        loaded = solve_tensions(chain[:, None, None], tensions[:, None], loads, starts=free.joint_angles[:, :, None])
        moved = ((loaded.tip - free.tip[:, :, None]) * push).sum(-1)
        ok = free.ok.all(-1) & loaded.ok.flatten(1).all(-1)
        return Measured((self.force / moved.clamp(min=_SMALLEST_MOVE)).flatten(1).amin(-1), ok)


@dataclass(frozen=True)
class PeakTension:
    """Largest tension when a lateral force acts on the mechanism with its tendons held [N].

    Solved: the equilibrium without load under the given tensions; then the tendons are locked at their unstretched
    lengths l - tension / stiffness there, and the equilibrium with the force on either side has elastic tendons of
    these lengths. Measured: the largest tension over sides and tendons. Tendons may go slack.
    Source: docs/theory.md, section 4.

    Args:
        tensions: of the tendons without load, (m,) [N].
        force: size of the force [N], not negative.
    Raises:
        InvalidInput: tendons that push or are all slack, a negative force.
    """

    tensions: tuple[float, ...] = (5.0, 5.0)
    force: float = 0.5
    name: ClassVar[str] = "peak_tension"
    unit: ClassVar[str] = "N"
    maximise: ClassVar[bool] = False

    def __post_init__(self) -> None:
        freeze(self, tensions=checked_tensions("PeakTension tensions", (self.tensions,))[0])
        as_number("PeakTension force", self.force, 0.0, allowed="a force of 0 or more [N]")

    def measure(self, chain: DifferentiableChain) -> Measured:
        """The largest tension of every design, (B,) [N]."""
        free = solve_tensions(chain, constant(self.tensions, chain))
        locked = free.lengths - free.tensions / chain[:].stiffnesses
        loads = tip_loads(self.force * _sides(free), chain)
        loaded = solve_lengths(chain[:, None], locked[:, None], loads, starts=free.joint_angles[:, None])
        return Measured(loaded.tensions.flatten(1).amax(-1), free.ok & loaded.ok.all(-1))


@dataclass(frozen=True)
class LoadCapacity:
    """Largest lateral force at the tip before a contact separates, slips or nears the end of its surface [N].

    Solved: the equilibria under the given tensions, which are held, without load and with the force on either side at
    equal levels up to `force`. Measured: the load at which the first of these margins of a joint falls below zero, by
    linear interpolation between the levels, the lesser of both sides:

    - the normal contact force;
    - friction × normal - |tangential| contact force;
    - the distance of the contact from either end of the surfaces, less `reserve`.

    A level without a stable equilibrium (snap-through) is not a failed design but beyond its capacity: there the
    smallest eigenvalue of the stiffness counts as the negative of its value without load, and its zero in between is
    the capacity. 0 where a margin is negative without load; `force` where none ever is: neither has a gradient.
    Source: docs/theory.md, section 5.

    Args:
        tensions: of the tendons, (m,) [N].
        force: highest level [N], above 0.
        levels: number of levels above 0.
        friction: coefficient of friction, above 0.
        reserve: least distance of the contacts from the ends of the surfaces [mm], not negative.
    Raises:
        InvalidInput: numbers outside these ranges; tendons that push or are all slack.
    """

    tensions: tuple[float, ...] = (5.0, 5.0)
    force: float = 4.0
    levels: int = 8
    friction: float = 0.3
    reserve: float = 1.0
    name: ClassVar[str] = "load_capacity"
    unit: ClassVar[str] = "N"
    maximise: ClassVar[bool] = True

    def __post_init__(self) -> None:
        freeze(self, tensions=checked_tensions("LoadCapacity tensions", (self.tensions,))[0])
        as_integer("LoadCapacity levels", self.levels, 1, 10_000)
        as_positive("LoadCapacity force", self.force, "a force above 0 [N]")
        as_positive("LoadCapacity friction", self.friction, "a coefficient above 0")
        as_number("LoadCapacity reserve", self.reserve, 0.0, allowed="a distance of 0 or more [mm]")

    def measure(self, chain: DifferentiableChain) -> Measured:
        """The capacity of every design, (B,) [N]."""
        tensions = constant(self.tensions, chain)
        free = solve_tensions(chain[:, None, None], tensions)  # (B, 1, 1)
        forces = self.force / self.levels * torch.arange(1, self.levels + 1).to(tensions)
        pushes = forces[:, None] * _sides(free)[:, 0, 0, :, None]  # (B, 2, levels, 2)
        chain = chain[:, None, None]
        loaded = solve_tensions(chain, tensions, tip_loads(pushes, chain), starts=free.joint_angles)
        without = self._margins(free, chain)
        failed = torch.ones_like(without)  # margins of a level without an equilibrium: only the last counts
        failed[..., -1] = -1.0
        failed = failed * torch.cat([torch.ones_like(without[..., :-1]), without[..., -1:]], -1)
        with_load = torch.where(loaded.ok[..., None], self._margins(loaded, chain), failed)
        series = torch.cat([without.expand(-1, 2, -1, -1), with_load], 2)
        return Measured(self.force / self.levels * _first_zero(series).flatten(1).amin(-1), free.ok[:, 0, 0])

    def _margins(self, equilibria: Equilibria, chain: DifferentiableChain) -> Tensor:
        """The margins, (..., 4 J + 1): N, N, mm, mm, and last the smallest eigenvalue [N·mm/rad]."""
        s, breaks = equilibria.arc_lengths, chain.breaks
        first = torch.maximum(breaks[..., :-1, 1, 0], breaks[..., 1:, 0, 0])
        last = torch.minimum(breaks[..., :-1, 1, -1], breaks[..., 1:, 0, -1])
        stable = equilibria.smallest_eigenvalue.clamp(max=_STIFFEST)[..., None]
        ends = s - first - self.reserve, last - s - self.reserve
        return torch.cat([equilibria.pressing_margins, equilibria.slip_margins(self.friction), *ends, stable], -1)


def _sides(free: Equilibria) -> Tensor:
    """Unit vectors to both sides of the tip link, (..., 2 sides, 2)."""
    angle = free.poses[..., -1, 2]
    right = torch.stack([torch.cos(angle), torch.sin(angle)], -1)
    return torch.stack([right, -right], -2)


def _first_zero(series: Tensor) -> Tensor:
    """Step at which a series over the second last axis first falls below zero; the last step if it never does.

    Between the entries by linear interpolation; 0 where the first entry is negative.
    """
    steps = series.shape[-2] - 1
    below = series < 0
    after = below.to(torch.int8).argmax(-2, keepdim=True)
    high, low = (series.gather(-2, place) for place in ((after - 1).clamp(min=0), after))
    crossing = (after > 0) & below.any(-2, keepdim=True)
    drop = torch.where(crossing, high - low, 1.0)
    between = (after - 1).to(series) + high / drop
    ends = torch.where(below.any(-2, keepdim=True), 0.0, float(steps)).to(series)
    return torch.where(crossing, between, ends)[..., 0, :]
