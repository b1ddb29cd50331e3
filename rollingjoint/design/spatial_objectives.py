"""Objectives of chains in space: stiffness of the tip, its reach, and the margins of the contact lines.

Every objective solves its equilibria for all designs and cases in one call. Where one of them fails, `ok` is False and
the value is finite but meaningless, without a gradient.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor

from rollingjoint.design.objectives import Measured, Rows, checked_rows, checked_tensions, constant, freeze, tip_loads
from rollingjoint.differentiable import DifferentiableSpatialChain, SpatialEquilibria, solve_tensions

MOST_FRICTION = 10.0
"""Coefficient of friction that counts where an end of a contact line lifts, where no friction is enough."""

_STIFFEST = 1e9  # N/mm; a tip that no force moves counts as this


@dataclass(frozen=True)
class _Poses:
    """Equilibria of all designs under every row of tensions and every force at the tip.

    Args:
        tensions: of the tendons in every pose, (P, m) [N].
        forces: dead forces at the origin of the tip link, (F, 3) [N]; every pose bears each of them alone.
    Raises:
        InvalidInput: no pose or force, tendons that push or are all slack, numbers that are not finite.
    """

    tensions: Rows
    forces: Rows = ((0.0, 0.0, 0.0),)
    tensors: ClassVar[type[DifferentiableSpatialChain]] = DifferentiableSpatialChain

    def __post_init__(self) -> None:
        name = type(self).__name__
        tensions = checked_tensions(f"{name} tensions", self.tensions)
        freeze(self, tensions=tensions, forces=checked_rows(f"{name} forces", self.forces, (None, 3)))

    def _solved(self, chain: DifferentiableSpatialChain) -> SpatialEquilibria:
        """The equilibria, (B, P, F)."""
        table = tip_loads(constant(self.forces, chain), chain)
        equilibria = solve_tensions(chain[:, None, None], constant(self.tensions, chain)[:, None], table)
        assert isinstance(equilibria, SpatialEquilibria)
        return equilibria


@dataclass(frozen=True)
class TipStiffness(_Poses):
    """Force over the deflection of the tip with the motors held, in the softest direction, the least over poses [N/mm].

    Solved: the equilibria of all poses and forces. Measured there: the smallest ratio of a small force at the origin of
    the tip link to the deflection along it, with elastic tendons whose motors stand still. Joints at their limits do
    not yield.
    Source: docs/theory.md, sections 5 and 11.
    """

    name: ClassVar[str] = "tip_stiffness"
    unit: ClassVar[str] = "N/mm"
    maximise: ClassVar[bool] = True

    def measure(self, chain: DifferentiableSpatialChain) -> Measured:
        """The least stiffness of every design, (B,) [N/mm]."""
        equilibria = self._solved(chain)
        stretch = chain[:, None, None].stiffnesses[..., None] * equilibria.tendon_rates.mT
        compliance = equilibria.tip_compliance(equilibria.tendon_rates @ stretch)
        softest = torch.linalg.eigvalsh(compliance)[..., -1]
        stiffness = 1.0 / softest.clamp(min=1.0 / _STIFFEST)
        return Measured(stiffness.flatten(1).amin(-1), equilibria.ok.flatten(1).all(-1))


@dataclass(frozen=True)
class TipReach(_Poses):
    """Least distance of the tip from its place at rest, over poses and forces [mm].

    Solved: the equilibria of all poses and forces, and the equilibrium under equal tensions of the same mean.
    """

    name: ClassVar[str] = "tip_reach"
    unit: ClassVar[str] = "mm"
    maximise: ClassVar[bool] = True

    def measure(self, chain: DifferentiableSpatialChain) -> Measured:
        """The least distance of every design, (B,) [mm]."""
        equilibria, tensions = self._solved(chain), constant(self.tensions, chain)
        straight = solve_tensions(chain, tensions.mean().expand(chain.n_tendons))
        away = torch.linalg.vector_norm(equilibria.tip - straight.tip[:, None, None], dim=-1)
        return Measured(away.flatten(1).amin(-1), equilibria.ok.flatten(1).all(-1) & straight.ok)


@dataclass(frozen=True)
class PressingMargin(_Poses):
    """Least normal force of a contact, over joints, poses and forces [N]; negative where links part."""

    name: ClassVar[str] = "pressing_margin"
    unit: ClassVar[str] = "N"
    maximise: ClassVar[bool] = True

    def measure(self, chain: DifferentiableSpatialChain) -> Measured:
        """The least margin of every design, (B,) [N]."""
        equilibria = self._solved(chain)
        return _least(equilibria, equilibria.pressing_margins)


@dataclass(frozen=True)
class TiltingMargin(_Poses):
    """Least tilting margin of a contact line, over joints, poses and forces [N]; negative where an end lifts."""

    name: ClassVar[str] = "tilting_margin"
    unit: ClassVar[str] = "N"
    maximise: ClassVar[bool] = True

    def measure(self, chain: DifferentiableSpatialChain) -> Measured:
        """The least margin of every design, (B,) [N]."""
        equilibria = self._solved(chain)
        return _least(equilibria, equilibria.tilting_margins)


@dataclass(frozen=True)
class ToothMargin(_Poses):
    """Least margin of spur teeth against climbing out of mesh, over joints, poses and forces [N].

    The teeth, at both ends of a contact line, have a pressure angle of 20° and carry all tangential force.
    """

    name: ClassVar[str] = "tooth_margin"
    unit: ClassVar[str] = "N"
    maximise: ClassVar[bool] = True

    def measure(self, chain: DifferentiableSpatialChain) -> Measured:
        """The least margin of every design, (B,) [N]."""
        equilibria = self._solved(chain)
        return _least(equilibria, equilibria.tooth_margins())


@dataclass(frozen=True)
class FrictionRequired(_Poses):
    """Largest coefficient of friction that a contact line needs, over joints, poses and forces.

    Where an end lifts, no friction is enough: it counts as 10, without a gradient; limit the tilting margin, too.
    """

    name: ClassVar[str] = "friction_required"
    unit: ClassVar[str] = "1"
    maximise: ClassVar[bool] = False

    def measure(self, chain: DifferentiableSpatialChain) -> Measured:
        """The largest coefficient of every design, (B,)."""
        equilibria = self._solved(chain)
        required = equilibria.friction_required.clamp(max=MOST_FRICTION)
        return Measured(required.flatten(1).amax(-1), equilibria.ok.flatten(1).all(-1))


@dataclass(frozen=True)
class PlacementError(_Poses):
    """Root mean square distance that the forces move the tip with the tensions held, over poses [mm].

    Solved: the equilibria of all poses and forces, and of all poses without a force.
    """

    forces: Rows = ((0.1, 0.0, 0.0), (0.0, 0.1, 0.0))
    name: ClassVar[str] = "placement_error"
    unit: ClassVar[str] = "mm"
    maximise: ClassVar[bool] = False

    def measure(self, chain: DifferentiableSpatialChain) -> Measured:
        """The root mean square distance of every design, (B,) [mm]."""
        equilibria = self._solved(chain)
        free = solve_tensions(chain[:, None], constant(self.tensions, chain))
        square = (equilibria.tip - free.tip[:, :, None]).square().sum(-1).flatten(1).mean(-1)
        return Measured(square.clamp(min=1e-24).sqrt(), equilibria.ok.flatten(1).all(-1) & free.ok.all(-1))


def _least(equilibria: SpatialEquilibria, margins: Tensor) -> Measured:
    """The least of finite margins of every design; hinges have none."""
    return Measured(margins.flatten(1).amin(-1), equilibria.ok.flatten(1).all(-1))
