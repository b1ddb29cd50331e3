"""MAP-Elites: the best design in every cell of an archive over two measured values.

Source: Mouret and Clune, "Illuminating search spaces by mapping elites" (2015); emitters that improve the archive by
CMA-ES: Fontaine et al., "Covariance matrix adaptation for the rapid illumination of behavior space" (GECCO 2020). By
the package ribs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from agents.runs.checks import check_fields, choice, integer, integers, number
from agents.search.optimiser import Array, Derivatives, Evaluated, Setup
from rollingjoint.checked_yaml import entries, point
from rollingjoint.errors import ConfigError


@dataclass
class MapElites:
    """An archive of unlike designs, filled by two CMA-ES emitters and one that mixes designs of the archive.

    Args:
        measures: names of the two measured values that define the kind of a design.
        ranges: (low, high) of each measure; designs outside count to the border cells.
        cells: of the archive along each.
        batch: designs of an emitter at a time.
        spread: first standard deviation of the CMA-ES emitters.
    """

    setup: Setup
    measures: Sequence[str]
    ranges: Sequence[Sequence[float]]
    cells: Annotated[Sequence[int], integers(1, 1000)] = (20, 20)
    batch: Annotated[int, integer(2, 10_000)] = 12
    spread: Annotated[float, number(1e-3, 2.0)] = 0.3

    wants: ClassVar[Derivatives] = ""

    def __post_init__(self) -> None:
        for what in ("measures", "ranges", "cells"):
            if len(entries(what, getattr(self, what))) != 2:
                raise ConfigError(what, getattr(self, what), "two entries, one per measure")
        for name in self.measures:
            choice(*self.setup.names)("measures", name)
        for low, high in (point("ranges", ends) for ends in self.ranges):
            number(1e-12)("ranges", high - low)
        check_fields(self)
        self.columns = [self.setup.names.index(name) for name in self.measures]
        self._fill()

    def _fill(self) -> None:
        from ribs.archives import GridArchive
        from ribs.emitters import EvolutionStrategyEmitter, IsoLineEmitter
        from ribs.schedulers import Scheduler

        d, seed = self.setup.dimensions, self.setup.seed
        ranges = [(low, high) for low, high in self.ranges]
        archive = GridArchive(solution_dim=d, dims=self.cells, ranges=ranges, seed=seed)
        box, start = [(-1.0, 1.0)] * d, np.zeros(d)
        improving = [
            EvolutionStrategyEmitter(
                archive, x0=start, sigma0=self.spread, bounds=box, batch_size=self.batch, seed=1000 * seed + place
            )
            for place in (1, 2)
        ]
        first = self.setup.generator.uniform(-1.0, 1.0, (self.batch, d))
        mixing = IsoLineEmitter(archive, initial_solutions=first, bounds=box, batch_size=self.batch, seed=1000 * seed)
        self.scheduler = Scheduler(archive, [*improving, mixing])

    def ask(self, most: int) -> Array:
        """The next designs of all emitters, (B, d), cut to the rest of the budget."""
        self.asked = self.scheduler.ask()
        return np.clip(self.asked[:most], -1.0, 1.0)

    def tell(self, evaluated: Evaluated) -> None:
        """Put the designs into the archive; failed ones, which have no valid values, into its first cell."""
        if len(evaluated) == len(self.asked):
            lowest = np.array([low for low, _ in self.ranges])
            kinds = np.where(evaluated.ok[:, None], evaluated.measured[:, self.columns], lowest)
            self.scheduler.tell(-evaluated.cost, kinds)
