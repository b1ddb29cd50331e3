"""The protocol of an optimiser: it asks for designs to be evaluated and is told the results.

An optimiser is deterministic: with the same setup, settings and answers it asks for the same designs. So an interrupted
search is resumed by telling a new optimiser the content of the journal, which brings it to the state of the old one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Derivatives = Literal["", "gradient", "jacobian"]


@dataclass(frozen=True)
class Setup:
    """The search space and the seed of an optimiser.

    Args:
        dimensions: d of the box [-1, 1]^d that is searched.
        names: of the measured values of a design, objectives first, then limits.
        seed: of all random numbers.
    """

    dimensions: int
    names: tuple[str, ...] = ()
    seed: int = 0

    @property
    def generator(self) -> np.random.Generator:
        """A new random generator of this seed."""
        return np.random.default_rng(self.seed)


@dataclass(frozen=True, eq=False)
class Evaluated:
    """Evaluated designs; rows are designs, all values are finite.

    Args:
        x: (B, d), in the box.
        cost: (B,), to be minimised; designs that fail or break a limit have a high one.
        measured: (B, m) physical values, in the order of Setup.names; of no meaning where not `ok`.
        ok: (B,) the design can be built and all its equilibria were found.
        feasible: (B,) it keeps all limits, too.
        worth, constraints: (B,), (B, c) the cost without penalty; the constraints, 0 or more where kept.
        gradient: (B, d) of the cost, for optimisers that want it.
        jacobian: (B, 1 + c, d) of worth and constraints, likewise.
    """

    x: Array
    cost: Array
    measured: Array
    ok: Mask
    feasible: Mask
    worth: Array | None = None
    constraints: Array | None = None
    gradient: Array | None = None
    jacobian: Array | None = None

    def __len__(self) -> int:
        return len(self.x)

    @classmethod
    def of(cls, evaluation: Any, **derivatives: Array) -> Evaluated:
        """The same from an Evaluation of rollingjoint.design."""
        names = ["x", "cost", "ok", "feasible", *(["worth", "constraints"] if "jacobian" in derivatives else [])]
        columns: dict[str, Any] = {name: getattr(evaluation, name) for name in names} | derivatives
        return cls(measured=np.hstack([evaluation.values, evaluation.limited]), **columns)

    @classmethod
    def whole(cls, parts: Sequence[Evaluated]) -> Evaluated:
        """The batch that the parts are of."""
        columns: dict[str, Any] = {}
        for field in fields(cls):
            column = [getattr(part, field.name) for part in parts]
            columns[field.name] = None if column[0] is None else np.concatenate(column)
        return cls(**columns)

    @classmethod
    def joined(cls, batches: Sequence[Evaluated]) -> Evaluated:
        """The designs of all batches, without gradients."""
        names = ("x", "cost", "measured", "ok", "feasible")
        return cls(*(np.concatenate([getattr(batch, name) for batch in batches]) for name in names))


class Optimiser(Protocol):
    """Searches the box. A dataclass: its first field is `setup`, the others are settings with defaults.

    Failed designs, broken limits, equal costs and populations without one valid design raise no errors.
    """

    @property
    def wants(self) -> Derivatives:
        """The derivatives that `tell` needs: the "gradient" of the cost, the "jacobian" of its parts, "" for none."""

    def ask(self, most: int) -> Array:
        """Designs to be evaluated next, (B, d) in the box, 1 <= B <= most; `most` is the rest of the budget."""

    def tell(self, evaluated: Evaluated) -> None:
        """Receive the results of the designs that were asked for last, in their order."""
