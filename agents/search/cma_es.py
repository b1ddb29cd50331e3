"""CMA-ES: a normal distribution that moves, stretches and turns towards the better half of its samples.

Source: Hansen, "The CMA evolution strategy: a tutorial" (2016); once it has settled, again with twice the population:
Auger and Hansen, "A restart CMA evolution strategy with increasing population size" (2005). By the package cma.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np

from agents.runs.checks import check_fields, integer, number
from agents.search.optimiser import Array, Derivatives, Evaluated, Setup


@dataclass
class CmaEs:
    """CMA-ES in the box.

    Args:
        population: designs of a generation; 0: 4 + 3 ln d, rounded down.
        spread: first standard deviation in every coordinate, of a box that is 2 wide.
    """

    setup: Setup
    population: Annotated[int, integer(0, 10_000)] = 0
    spread: Annotated[float, number(1e-3, 2.0)] = 0.5

    wants: ClassVar[Derivatives] = ""

    def __post_init__(self) -> None:
        check_fields(self)
        self.generator = self.setup.generator
        size = max(self.population or 4 + int(3 * np.log(self.setup.dimensions)), 4)
        self.strategy = self._strategy(np.zeros(self.setup.dimensions), size)

    def ask(self, most: int) -> Array:
        """The next generation, (B, d), or as much of it as the budget leaves."""
        stopped = self.strategy.stop(check=True, ignore_list=("maxiter", "maxfevals", "timeout"))
        if stopped:
            centre = self.generator.uniform(-1.0, 1.0, self.setup.dimensions)
            self.strategy = self._strategy(centre, 2 * self.strategy.popsize)
        return np.clip(np.array(self.strategy.ask()), -1.0, 1.0)[:most]

    def tell(self, evaluated: Evaluated) -> None:
        """Adapt; a generation cut short by the end of the budget is ignored."""
        if len(evaluated) == self.strategy.popsize:
            self.strategy.tell(list(evaluated.x), evaluated.cost.tolist())

    def _strategy(self, centre: Array, population: int) -> Any:
        import cma

        options = {
            "bounds": [-1.0, 1.0],
            "popsize": population,
            "randn": lambda *shape: self.generator.standard_normal(shape),
            "seed": np.nan,  # numpy's global generator stays as it is
            "maxstd_boundrange": np.inf,
            "verbose": -9,
        }
        return cma.CMAEvolutionStrategy(centre, self.spread, options)
