"""Designs drawn without feedback: at random, the baseline of all other methods, or as a Latin hypercube."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

from agents.runs.checks import check_fields, integer
from agents.search.optimiser import Array, Derivatives, Evaluated, Setup


@dataclass
class RandomSearch:
    """Independent uniform designs, `batch` at a time."""

    setup: Setup
    batch: Annotated[int, integer(1, 100_000)] = 50

    wants: ClassVar[Derivatives] = ""

    def __post_init__(self) -> None:
        check_fields(self)
        self.generator = self.setup.generator

    def ask(self, most: int) -> Array:
        """The next designs, (B, d)."""
        return self.generator.uniform(-1.0, 1.0, (min(self.batch, most), self.setup.dimensions))

    def tell(self, evaluated: Evaluated) -> None:
        """Ignored."""


@dataclass
class LatinHypercube:
    """One Latin hypercube of the whole budget, `batch` designs at a time.

    Every coordinate's range is cut into one strip per design, and every strip holds one.
    """

    setup: Setup
    batch: Annotated[int, integer(1, 100_000)] = 50

    wants: ClassVar[Derivatives] = ""

    def __post_init__(self) -> None:
        check_fields(self)
        self.remaining: Array | None = None

    def ask(self, most: int) -> Array:
        """The next designs, (B, d); the first call, whose `most` is the budget, draws them all."""
        if self.remaining is None:
            from scipy.stats.qmc import LatinHypercube as Sampler

            self.remaining = 2.0 * Sampler(self.setup.dimensions, rng=self.setup.generator).random(most) - 1.0
        count = min(self.batch, most)
        designs, self.remaining = self.remaining[:count], self.remaining[count:]
        return designs

    def tell(self, evaluated: Evaluated) -> None:
        """Ignored."""
