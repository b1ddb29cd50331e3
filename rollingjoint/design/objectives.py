"""Objectives of a design: bending shapes, tip travel and rotation, tendon travel.

Every objective solves its equilibria for all designs and cases in one call. Where one of them fails, `ok` is False and
the value is finite but meaningless, without a gradient. Objectives with lateral forces are in loads.py.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple, Protocol

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from torch import Tensor

from rollingjoint.chain.rolling import RollingChain
from rollingjoint.checks import as_floats, as_integer, as_number, as_positive
from rollingjoint.design.sweeps import swept
from rollingjoint.differentiable import DifferentiableChain, solve_tensions
from rollingjoint.differentiable.equilibria import Equilibria
from rollingjoint.differentiable.parameters import ChainTensors
from rollingjoint.errors import InvalidInput
from rollingjoint.load import WorldForce
from rollingjoint.statics.solve import solve_tensions as solve_compiled

_SMALLEST_ROTATION = 1e-6  # rad; smaller rotations of the tip count as this

Rows = tuple[tuple[float, ...], ...]


class Measured(NamedTuple):
    """Values of an objective, (B,), differentiable and finite; ok, (B,): True if every equilibrium exists."""

    values: Tensor
    ok: Tensor


class Objective(Protocol):
    """A number that describes a design; one of your own is a frozen dataclass of numbers with these members.

    One of chains in space has an attribute `tensors` of its class: DifferentiableSpatialChain.
    """

    @property
    def name(self) -> str:
        """Name in tables."""

    @property
    def unit(self) -> str:
        """Unit of its values."""

    @property
    def maximise(self) -> bool:
        """Whether more is better."""

    def measure(self, chain: Any) -> Measured:
        """The objective of every design of a chain with one leading axis, of the design space's class.

        Returns:
            Measured: values, float64 (B,), differentiable and finite; ok, booleans (B,): every equilibrium exists.
        """


def check_fits(objective: Objective, tensors: type[ChainTensors]) -> None:
    """Raise InvalidInput unless the objective is one of such chains: in the plane, unless it says so."""
    wanted = getattr(objective, "tensors", DifferentiableChain)
    if wanted is not tensors:
        raise InvalidInput("objective", objective.name, f"one of a {tensors.__name__}, not of a {wanted.__name__}")


def checked_measure(objective: Objective, chain: ChainTensors) -> Measured:
    """What the objective measures; InvalidInput unless that is Measured with a value and ok of every design."""
    found = objective.measure(chain)
    shape = tuple(chain.batch)
    if isinstance(found, tuple) and len(found) == 2 and all(isinstance(part, Tensor) for part in found):
        values, ok = found
        if tuple(values.shape) == tuple(ok.shape) == shape and values.dtype == torch.float64 and ok.dtype == torch.bool:
            return Measured(values, ok)
    allowed = f"Measured(values, ok): tensors of float64 and of booleans, both of shape {shape}"
    parts = found if isinstance(found, tuple) else (found,)
    described = [f"{part.dtype} {tuple(part.shape)}" if isinstance(part, Tensor) else part for part in parts]
    raise InvalidInput(f"what {objective.name}.measure returns", described, allowed)


@dataclass(frozen=True)
class BendingShapes:
    """Root mean square distance of the link origins from desired positions over a family of inputs [mm].

    Solved: the equilibrium under each pair of tensions and a dead force at the origin of the tip link, from s = 0.
    Measured: the distance of the origin of every moving link from its desired position, over all links and inputs.
    Source: docs/theory.md, section 3.

    Args:
        tensions: of the tendons in every case, (K, m) [N].
        positions: desired link origins, the base's first, (K, n, 2) [mm].
        forces: on the tip in every case, (K, 2) [N]; default none.
    Raises:
        InvalidInput: no case, numbers that are not finite, tendons that push or are all slack, shapes that disagree.
    """

    tensions: Rows
    positions: tuple[Rows, ...]
    forces: Rows = ()
    name: ClassVar[str] = "bending_shapes"
    unit: ClassVar[str] = "mm"
    maximise: ClassVar[bool] = False

    def __post_init__(self) -> None:
        tensions = checked_tensions("BendingShapes tensions", self.tensions)
        cases = len(tensions)
        forces = self.forces if len(self.forces) else np.zeros((cases, 2))
        freeze(
            self,
            tensions=tensions,
            positions=checked_rows("BendingShapes positions", self.positions, (cases, None, 2)),
            forces=checked_rows("BendingShapes forces", forces, (cases, 2)),
        )

    @classmethod
    def of(cls, mechanism: RollingChain, tensions: ArrayLike, forces: ArrayLike = ()) -> BendingShapes:
        """The shapes of a given mechanism.

        Raises:
            InvalidInput: as the class.
            SolverError: the mechanism has no stable equilibrium in one of the cases.
        """
        rows = checked_tensions("BendingShapes tensions", tensions)
        pushes = checked_rows(
            "BendingShapes forces", forces if np.size(forces) else np.zeros((len(rows), 2)), (len(rows), 2)
        )
        shapes = [
            solve_compiled(mechanism, row, [WorldForce(-1, (float(x), float(y)))]).require().poses[:, :2]
            for row, (x, y) in zip(rows, pushes, strict=True)
        ]
        return cls(_nested(rows), _nested(np.array(shapes)), _nested(pushes))

    def measure(self, chain: DifferentiableChain) -> Measured:
        """The root mean square distance of every design, (B,) [mm]."""
        desired, forces = constant(self.positions, chain), constant(self.forces, chain)
        if desired.shape[1] != chain.n_links:
            raise InvalidInput("links of the wanted shapes", desired.shape[1], f"{chain.n_links}, as the designs have")
        loads = tip_loads(forces, chain) if bool(forces.any()) else ()
        equilibria = solve_tensions(chain[:, None], constant(self.tensions, chain), loads)
        miss = (equilibria.poses[..., :2] - desired)[..., 1:, :].flatten(1)
        return Measured(torch.linalg.vector_norm(miss, dim=-1) / (miss.shape[-1] / 2) ** 0.5, equilibria.ok.all(-1))


@dataclass(frozen=True)
class _RatioSweep:
    """A sweep of the two tendons' tensions at a constant sum, the logarithm of their ratio in equal steps.

    TipTravel explains its fields. More tendons are pairs, left and right, which are all swept alike.
    """

    tension: float = 10.0
    ratio: float = 3.0
    cases: int = 9

    def __post_init__(self) -> None:
        as_integer("cases", self.cases, 2, 10_000)
        as_positive("tension", self.tension, "a sum of tensions above 0 [N]")
        as_number("ratio", self.ratio, np.nextafter(1.0, 2.0), allowed="a ratio of tensions above 1")

    @property
    def tensions(self) -> NDArray[np.float64]:
        """Left and right tension of every case, (cases, 2) [N]."""
        ratios = float(self.ratio) ** np.linspace(-1.0, 1.0, self.cases)
        return self.tension * np.stack([ratios, np.ones_like(ratios)], -1) / (1.0 + ratios[:, None])

    def _swept(self, chain: DifferentiableChain) -> Equilibria:
        pairs = max(chain.n_tendons // 2, 1)
        return swept(chain, np.tile(self.tensions, (1, pairs)))


@dataclass(frozen=True)
class TipTravel(_RatioSweep):
    """Length of the tip's path over a sweep of tension ratios [mm], the workspace of a mechanism with two tendons.

    Solved: the equilibrium without loads under each pair of tensions; only their ratio matters for it.
    Measured: the sum of the chords between the tip's positions. A joint that has run to the end of its surface is held
    there and turns no further: such equilibria count, and the path ends where no joint is left to move.
    Source: docs/theory.md, sections 3 and 5.

    Args:
        tension: sum of the tensions of the left and the right tendon, of every pair where there are several [N].
        ratio: largest ratio of the left to the right tension, and of the right to the left; above 1.
        cases: number of tension pairs, both ends included, 2 or more.
    Raises:
        InvalidInput: numbers outside these ranges.
    """

    name: ClassVar[str] = "tip_travel"
    unit: ClassVar[str] = "mm"
    maximise: ClassVar[bool] = True

    def measure(self, chain: DifferentiableChain) -> Measured:
        """The length of every design's path, (B,) [mm]."""
        equilibria = self._swept(chain)
        return Measured(torch.linalg.vector_norm(equilibria.tip.diff(dim=1), dim=-1).sum(-1), equilibria.ok.all(-1))


@dataclass(frozen=True)
class TipRotation(_RatioSweep):
    """Range of the tip's angle over a sweep of tension ratios [rad], the dexterity of a mechanism with two tendons.

    Solved: as for `TipTravel`, which has the arguments. Measured: the largest less the smallest angle of the tip link.
    """

    name: ClassVar[str] = "tip_rotation"
    unit: ClassVar[str] = "rad"
    maximise: ClassVar[bool] = True

    def measure(self, chain: DifferentiableChain) -> Measured:
        """The range of every design, (B,) [rad]."""
        equilibria = self._swept(chain)
        return Measured(_range(equilibria.poses[..., -1, 2]), equilibria.ok.all(-1))


@dataclass(frozen=True)
class TendonTravel(_RatioSweep):
    """Travel of a motor over a sweep of tension ratios [mm, or mm/rad].

    Solved: as for `TipTravel`. Measured: the range of the unstretched length l - tension / stiffness for the
    tendon that moves most. A mechanism that does not bend needs hardly any travel: use it as a limit together with
    `TipRotation`, or per radian of the tip's range.
    Source: docs/theory.md, section 4.

    Args:
        tension, ratio, cases: as for `TipTravel`.
        per_radian: divide by the range of the tip's angle.
    Raises:
        InvalidInput: numbers outside their ranges.
    """

    per_radian: bool = False
    name: ClassVar[str] = "tendon_travel"
    maximise: ClassVar[bool] = False

    @property
    def unit(self) -> str:
        """Unit of its values."""
        return "mm/rad" if self.per_radian else "mm"

    def measure(self, chain: DifferentiableChain) -> Measured:
        """The travel of every design, (B,)."""
        equilibria = self._swept(chain)
        unstretched = equilibria.lengths - equilibria.tensions / chain[:, None].stiffnesses
        travel = _range(unstretched.mT).amax(-1)
        if self.per_radian:
            travel = travel / _range(equilibria.poses[..., -1, 2]).clamp(min=_SMALLEST_ROTATION)
        return Measured(travel, equilibria.ok.all(-1))


def tip_loads(forces: Tensor, chain: ChainTensors) -> Tensor:
    """Load tables with one dead force at the origin of the tip link, (..., 1, columns), of forces (..., 2 or 3) [N]."""
    columns = chain.loads.columns
    first = columns.index("fx")
    place = first, len(columns) - first - forces.shape[-1]
    table = torch.nn.functional.pad(forces, place)[..., None, :]
    link = torch.zeros(table.shape[-1], dtype=table.dtype, device=table.device)
    link[columns.index("link")] = chain.n_links - 1
    return table + link


def constant(values: ArrayLike | Rows | tuple[Rows, ...], chain: ChainTensors) -> Tensor:
    """Numbers as a tensor on the device of a chain."""
    return torch.as_tensor(np.array(values, dtype=float), device=chain.device)


def checked_tensions(name: str, values: ArrayLike | Rows) -> NDArray[np.float64]:
    """Rows of tensions, (K, m) [N].

    Raises:
        InvalidInput: no row, numbers that are not finite, tendons that push, a row of slack tendons.
    """
    rows = checked_rows(name, values, (None, None))
    if (rows < 0).any() or not (rows.sum(-1) > 0).all():
        raise InvalidInput(name, values, "tensions of 0 or more [N], in every row one above 0")
    return rows


def checked_rows(name: str, values: object, shape: Sequence[int | None]) -> NDArray[np.float64]:
    """Finite numbers of a shape, where None is any size but 0; InvalidInput for anything else."""
    sizes = ", ".join("any" if size is None else str(size) for size in shape)
    allowed = f"finite numbers of shape ({sizes}), at least one"
    numbers = as_floats(name, values, allowed)
    fits = numbers.ndim == len(shape) and all(s in (None, n) for n, s in zip(numbers.shape, shape, strict=True))
    if not fits or numbers.size == 0 or not np.isfinite(numbers).all():
        raise InvalidInput(name, values, allowed)
    return numbers


def freeze(objective: object, **fields: NDArray[np.float64]) -> None:
    """Fields of a frozen dataclass as nested tuples, so that equal objectives are equal and have one hash."""
    for name, numbers in fields.items():
        object.__setattr__(objective, name, _nested(numbers))


def _nested(numbers: NDArray[np.float64]) -> tuple:  # type: ignore[type-arg]
    return tuple(row if np.ndim(row) == 0 else _nested(np.asarray(row)) for row in numbers.tolist())


def _range(values: Tensor) -> Tensor:
    """Largest less smallest along the last axis."""
    return values.amax(-1) - values.amin(-1)
