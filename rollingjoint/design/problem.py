"""A design problem: a space, objectives and limits; its cost, which a search minimises, and its gradient."""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields
from functools import cached_property
from typing import TypeVar

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from torch import Tensor

from rollingjoint.chain.chain import AnyChain
from rollingjoint.checks import as_floats, as_integer, as_number, as_positive
from rollingjoint.design.box import DesignBox
from rollingjoint.design.comparison import measure
from rollingjoint.design.objectives import Measured, Objective, check_fits, checked_measure
from rollingjoint.design.sweeps import shared_sweeps
from rollingjoint.errors import InvalidInput

Array = NDArray[np.float64]
Result = TypeVar("Result")

FAILED = 100.0
"""Cost of a design without an equilibrium, and violation of a vector that is not finite."""

_CHUNK = 1024  # most designs that are solved together; measured, docs/design.md
_FARTHEST = 1e6  # entries of vectors and margins are clipped to this


@dataclass(frozen=True)
class Term:
    """An objective in the cost: weight × value / scale, with a minus where more is better.

    Raises:
        InvalidInput: numbers that are not finite, a negative weight, a scale that is not above 0.
    """

    objective: Objective
    weight: float = 1.0
    scale: float = 1.0

    def __post_init__(self) -> None:
        as_number("weight", self.weight, 0.0, allowed="a weight of 0 or more")
        as_positive("scale", self.scale, "a scale above 0")

    @property
    def factor(self) -> float:
        """Cost per unit of the objective."""
        return (-1.0 if self.objective.maximise else 1.0) * self.weight / self.scale


@dataclass(frozen=True)
class Limit:
    """Bounds of an objective; violated by the excess over the bound's size (or over 1, if that is 0).

    Raises:
        InvalidInput: NaN, bounds in the wrong order.
    """

    objective: Objective
    low: float = -math.inf
    high: float = math.inf

    def __post_init__(self) -> None:
        if not self.low <= self.high or not (math.isfinite(self.low) or math.isfinite(self.high)):
            raise InvalidInput("limit", (self.low, self.high), "low <= high, at least one of them finite")

    def slacks(self, values: Tensor) -> list[Tensor]:
        """Slack of values to each finite bound, relative to its size, (B,) each; negative where it is violated."""
        sides = ((values - self.low, self.low), (self.high - values, self.high))
        return [distance / (abs(bound) or 1.0) for distance, bound in sides if math.isfinite(bound)]


@dataclass(frozen=True, eq=False)
class Evaluation:
    """An evaluation of designs, in the order of the input.

    Attributes:
        x: vectors of the designs, (B, d).
        values: of the objectives, physical, (B, terms); meaningless where not `ok`.
        limited: of the objectives with limits, (B, limits).
        margins: of the space, (B, margins), 0 or more for a design that can be built.
        violation: sum of the violations of margins, limits and the box, (B,), 0 or more.
        ok: every equilibrium was found, (B,).
        feasible: ok and no violation, (B,).
        cost: the number that a search minimises, (B,), always finite.
        worth: the sum of the terms, without the penalty, or `FAILED`, (B,).
        constraints: the margins, then the relative slack of every limit, (B, constraints), 0 or more where satisfied.
    """

    x: Array
    values: Array
    limited: Array
    margins: Array
    violation: Array
    ok: NDArray[np.bool_]
    cost: Array
    worth: Array
    constraints: Array

    @property
    def feasible(self) -> NDArray[np.bool_]:
        """Rows that are ok and have no violation."""
        return self.ok & (self.violation == 0)


@dataclass(frozen=True)
class Problem:
    """A design space with the objectives and limits of its designs.

    The cost of a design is the sum of its terms plus penalty × (v + v²) of its violation v: an exact penalty, with a
    feasible minimum if `penalty` is larger than the gain from a unit of violation. A design without an equilibrium
    costs `FAILED` in place of the terms, and its gradient is the gradient of the penalty.

    Args:
        space: of the designs.
        objectives: the terms of the cost.
        limits: limits on objectives, in addition to the margins of the space.
        penalty: of a unit of violation, above 0.
    Raises:
        InvalidInput: neither an objective nor a limit, an objective of other chains, a penalty that is not above 0.
    """

    space: DesignBox
    objectives: tuple[Term, ...]
    limits: tuple[Limit, ...] = ()
    penalty: float = 10.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "objectives", tuple(self.objectives))
        object.__setattr__(self, "limits", tuple(self.limits))
        if not self.objectives and not self.limits:
            raise InvalidInput("objectives", self.objectives, "at least one Term")
        for objective in self.distinct:
            check_fits(objective, self.space.tensors)
        as_positive("penalty", self.penalty, "a penalty above 0")

    @property
    def dimensions(self) -> int:
        """Length of a vector."""
        return self.space.dimensions

    @cached_property
    def distinct(self) -> tuple[Objective, ...]:
        """The objectives of terms and limits, each once."""
        judges = [term.objective for term in self.objectives] + [limit.objective for limit in self.limits]
        return tuple(dict.fromkeys(judges))

    def evaluate(self, x: ArrayLike, threads: int = 1) -> Evaluation:
        """The evaluation of designs; a row does not depend on the others beyond rounding.

        Args:
            x: vectors, (B, d), any numbers; beyond [-1, 1] a design counts as at the border, and violates the box.
            threads: number of Python threads.
        Raises:
            InvalidInput: x without d columns, threads below 1.
        """
        rows = self._rows(x)
        return _evaluation(rows, _chunked(self._without_gradient, rows, threads))

    def with_gradient(self, x: ArrayLike, threads: int = 1) -> tuple[Evaluation, Array]:
        """The evaluation of designs, and the gradient of their cost, (B, d).

        Args:
            x, threads: as for `evaluate`.
        Raises:
            InvalidInput: as for `evaluate`.
        """
        rows = self._rows(x)
        judged = _chunked(self._with_gradient, rows, threads)
        gradient = np.concatenate([part.numpy() for _, part in judged])
        return _evaluation(rows, [evaluation for evaluation, _ in judged]), gradient

    def with_jacobian(self, x: ArrayLike) -> tuple[Evaluation, Array]:
        """The evaluation of designs, and the Jacobian of worth and constraints, (B, 1 + constraints, d).

        Args:
            x: as for `evaluate`.
        Raises:
            InvalidInput: as for `evaluate`.
        """
        rows = self._rows(x)
        judged = _chunked(self._with_jacobian, rows, 1)
        return _evaluation(rows, [evaluation for evaluation, _ in judged]), np.concatenate([part for _, part in judged])

    def against(self, mechanism: AnyChain) -> Array:
        """Values of the objectives for a given mechanism, for comparison with designs; raises as `measure`."""
        return measure(mechanism, [term.objective for term in self.objectives])

    def _rows(self, x: ArrayLike) -> Array:
        rows = as_floats("x", x, f"designs, (B, {self.dimensions})")
        if rows.ndim != 2 or rows.shape[1] != self.dimensions or not len(rows):
            raise InvalidInput("shape of x", rows.shape, f"(B, {self.dimensions}), at least one row")
        return rows

    def _without_gradient(self, x: Tensor) -> _EvaluationTensors:
        with torch.no_grad():
            return self._tensors(x)

    def _with_gradient(self, x: Tensor) -> tuple[_EvaluationTensors, Tensor]:
        leaf = x.clone().requires_grad_()
        with torch.enable_grad():
            judged = self._tensors(leaf)
            (gradient,) = torch.autograd.grad(judged.cost.sum(), leaf)
        return judged.detached(), torch.nan_to_num(gradient, nan=0.0, posinf=0.0, neginf=0.0)

    def _with_jacobian(self, x: Tensor) -> tuple[_EvaluationTensors, Array]:
        """Each row is repeated once per output, so that one backward pass is enough."""
        bounds = [bound for limit in self.limits for bound in (limit.low, limit.high)]
        count = 1 + len(self.space.margin_names) + sum(map(math.isfinite, bounds))
        leaf = x.repeat_interleave(count, 0).requires_grad_()
        with torch.enable_grad():
            judged = self._tensors(leaf)
            parts = torch.cat([judged.worth[:, None], judged.constraints], 1)
            outputs = parts.view(len(x), count, count).diagonal(dim1=1, dim2=2)
            (gradient,) = torch.autograd.grad(outputs.sum(), leaf)
        jacobian = torch.nan_to_num(gradient, nan=0.0).view(len(x), count, -1)
        return judged.detached()[::count], jacobian.numpy()

    def _tensors(self, x: Tensor) -> _EvaluationTensors:
        """The evaluation of designs as tensors."""
        finite = torch.isfinite(x).all(-1)
        vector = torch.where(finite[:, None], x, 0.0).clamp(-_FARTHEST, _FARTHEST)
        chain = self.space.chain(vector)
        margins = torch.nan_to_num(self.space.margins(vector), nan=-1.0).clamp(-_FARTHEST, _FARTHEST)
        with shared_sweeps():
            measured_by_objective = {objective: checked_measure(objective, chain) for objective in self.distinct}
        ok = finite
        for measured in measured_by_objective.values():
            ok = ok & measured.ok & torch.isfinite(measured.values)
        values, limited = (
            _columns([measured_by_objective[entry.objective] for entry in entries], ok)
            for entries in (self.objectives, self.limits)
        )
        slacks = [slack for limit, column in zip(self.limits, limited.T, strict=True) for slack in limit.slacks(column)]
        constraints = torch.cat([margins, *(torch.where(ok, slack, 0.0)[:, None] for slack in slacks)], 1)
        violated = torch.relu(-constraints).sum(-1) + torch.relu(vector.abs() - 1.0).sum(-1)
        violation = torch.where(finite, violated, FAILED)
        factors = torch.tensor([term.factor for term in self.objectives], dtype=torch.float64)
        worth = torch.where(ok, values @ factors, FAILED)
        cost = worth + self.penalty * (violation + violation.square())
        return _EvaluationTensors(values, limited, margins, violation, ok, cost, worth, constraints)


@dataclass(frozen=True)
class _EvaluationTensors:
    """Some rows of an evaluation, as tensors."""

    values: Tensor
    limited: Tensor
    margins: Tensor
    violation: Tensor
    ok: Tensor
    cost: Tensor
    worth: Tensor
    constraints: Tensor

    def detached(self) -> _EvaluationTensors:
        """The rows as constants."""
        return _EvaluationTensors(*(getattr(self, field.name).detach() for field in fields(self)))

    def __getitem__(self, rows: slice) -> _EvaluationTensors:
        """Some of the rows."""
        return _EvaluationTensors(*(getattr(self, field.name)[rows] for field in fields(self)))


def _chunked(work: Callable[[Tensor], Result], rows: Array, threads: int) -> list[Result]:
    """The results of `work` for chunks of the rows, on `threads` threads."""
    threads = as_integer("threads", threads, 1, allowed="a whole number, 1 or more")
    chunks = torch.as_tensor(rows).split(min(_CHUNK, -(-len(rows) // threads)))
    if threads == 1:
        return [work(chunk) for chunk in chunks]
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(work, chunks))


def _columns(measured: list[Measured], ok: Tensor) -> Tensor:
    """Values side by side, (B, columns); finite constants where not ok."""
    if not measured:
        return torch.zeros(len(ok), 0, dtype=torch.float64)
    columns = torch.stack([entry.values for entry in measured], -1)
    return torch.where(ok[:, None], columns, torch.nan_to_num(columns.detach(), posinf=0.0, neginf=0.0))


def _evaluation(x: Array, parts: list[_EvaluationTensors]) -> Evaluation:
    """The rows of all chunks."""
    names = [field.name for field in fields(_EvaluationTensors)]
    return Evaluation(x, **{name: np.concatenate([getattr(part, name).numpy() for part in parts]) for name in names})
