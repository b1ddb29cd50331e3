"""The designs of a search as points, and how a chosen one bends."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from agents.search.optimiser import Array, Mask
from agents.search.outcome import Search, plain_number, words
from agents.search.pictures import RATIOS, TENSION
from agents.search.problem import against, reference
from rollingjoint import Equilibrium, RollingChain, solve_tensions
from rollingjoint.checks import as_integer, as_number
from rollingjoint.errors import InvalidInput

SHOWN = 4000  # designs with a point in a scatter plot, besides the Pareto set and the archive
KINDS = ("feasible", "archive", "Pareto set")
LARGEST_RATIO = max(RATIOS)


@dataclass(frozen=True)
class Design:
    """A design of a search, or the reference mechanism.

    Args:
        title: its name. mechanism: the chain.
        values: its measured values, (k,). row: in the search; None of the reference.
    """

    title: str
    mechanism: RollingChain
    values: Array
    row: int | None = None

    def bent(self, share: float) -> Equilibrium:
        """Its equilibrium without load under two tensions of 10 N together.

        Args:
            share: from -1, where the right tendon pulls three times as hard as the left one, to 1, the other way round.
        Raises:
            InvalidInput: another share.
        """
        ratio = LARGEST_RATIO ** as_number("bend", share, -1.0, 1.0)
        return solve_tensions(self.mechanism, (TENSION * ratio / (1 + ratio), TENSION / (1 + ratio)))


@dataclass(frozen=True)
class DesignPoints:
    """Feasible designs over two of the measured quantities.

    Args:
        rows: of the designs in the search, (K,). x, y: their values, (K,).
        kinds: places in KINDS, the last that holds, (K,).
    """

    rows: NDArray[np.int64]
    x: Array
    y: Array
    kinds: NDArray[np.int64]

    def nearest(self, x: float, y: float) -> int:
        """The row of the design nearest to this place, distances in shares of the points' extents."""
        spans = [max(float(np.ptp(values)), 1e-12) for values in (self.x, self.y)]
        return int(self.rows[np.hypot((self.x - x) / spans[0], (self.y - y) / spans[1]).argmin()])


class Designs:
    """The designs of a search.

    Args:
        search: its finished runs.
    """

    def __init__(self, search: Search) -> None:
        self.search = search

    @classmethod
    def read(cls, folder: Path) -> Designs:
        """The designs in a folder of rj search; raises RunFolderError where no run in it is finished."""
        return cls(Search.read(folder))

    @property
    def name(self) -> str:
        """The name of the search."""
        return self.search.name

    @property
    def quantities(self) -> list[str]:
        """The measured quantities with units: objectives first, then limits."""
        return [f"{words(name)} [{unit}]" for name, unit in zip(self.search.names, self.search.units, strict=True)]

    @property
    def axes(self) -> tuple[int, int]:
        """The quantities to begin with: two objectives, the archive's axes where there is one, or the first two."""
        if len(self.search.problem.objectives) < 2 and self.search.archive is not None:
            across, up = self.search.archive.columns
            return across, up
        return 0, min(1, len(self.quantities) - 1)

    def points(self, across: int, up: int) -> DesignPoints:
        """Designs over two quantities, given as places in `quantities`."""
        rows, values = self._rows, self.search.everything.measured[self._rows]
        kinds = np.where(self.search.front[rows], 2, np.where(self._archived[rows], 1, 0))
        return DesignPoints(rows, values[:, across], values[:, up], kinds)

    def design(self, row: int) -> Design:
        """The design in a row of the search; raises InvalidInput for another row, MechanismError if it is none."""
        everything = self.search.everything
        row = as_integer("design", row, 0, len(everything) - 1)
        mechanism = self.search.problem.space.mechanism(everything.x[row])
        return Design(f"design {row}", mechanism, everything.measured[row], row)

    @property
    def best(self) -> int:
        """The row of the best design: feasible, with the least cost."""
        costs = np.where(self.search.everything.feasible, self.search.everything.cost, np.inf)
        return int(costs.argmin())

    @cached_property
    def reference(self) -> Design:
        """The mechanism that the search compares with; raises InvalidInput unless it is planar with two tendons."""
        mechanism = reference(self.search.config)
        if not isinstance(mechanism, RollingChain) or mechanism.n_tendons != 2:
            allowed = "a search of planar chains with two tendons, which this room bends"
            raise InvalidInput("search", self.name, allowed, "rj search prints designs of others.")
        values = np.array(against(self.search.config, self.search.problem))
        return Design(words(mechanism.name or "reference"), mechanism, values)

    def compared(self, designs: Sequence[Design]) -> list[list[str]]:
        """The measured values of designs: a row per quantity, its name and the value of every design."""
        return [
            [quantity, *(plain_number(design.values[place]) for design in designs)]
            for place, quantity in enumerate(self.quantities)
        ]

    @cached_property
    def _archived(self) -> Mask:
        archived = np.zeros(len(self.search.everything), bool)
        if self.search.archive is not None:
            cells = self.search.archive.designs
            archived[cells[cells >= 0]] = True
        return archived

    @cached_property
    def _rows(self) -> NDArray[np.int64]:
        """The designs that have a point: the Pareto set, the archive, and evenly of the other feasible ones."""
        marked = self.search.front | self._archived
        others = np.flatnonzero(self.search.everything.feasible & ~marked)
        every = max(1, -(-len(others) // SHOWN))
        return np.sort(np.concatenate([np.flatnonzero(marked), others[::every]]))
