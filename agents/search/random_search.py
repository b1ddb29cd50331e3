"""Designs drawn evenly from the box: what every other method has to beat."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from agents.runs.checks import check_fields, integer
from agents.search.optimiser import Array, Derivatives, Evaluated, Setup


@dataclass
class RandomSearch:
    """Independent uniform designs, `batch` at a time."""

    setup: Setup
    batch: int = 50

    wants: ClassVar[Derivatives] = ""

    def __post_init__(self) -> None:
        check_fields(self, batch=integer(1))
        self.generator = self.setup.generator

    def ask(self, most: int) -> Array:
        """The next designs, (B, d)."""
        return self.generator.uniform(-1.0, 1.0, (min(self.batch, most), self.setup.dimensions))

    def tell(self, evaluated: Evaluated) -> None:
        """Nothing is learnt."""
