"""The controllers of a benchmark in one of its worlds: intervals, comparisons, and whether learning pays."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from functools import cache, cached_property
from typing import Any

import numpy as np

from agents.evaluation.score import CLOSE_MM
from agents.results.record import BASELINE, POLICY, BenchmarkRecord, World
from agents.results.statistics import Bootstrap, Comparison, Interval, Summary

FEEDBACK = "jacobian feedback"

bootstrap = cache(Bootstrap)
"""The resamples of this many episodes, made once."""


class Verdict(StrEnum):
    """Whether learning pays in a world."""

    PAYS = "pays"
    NARROWLY = "pays narrowly"
    BEATS_FEEDBACK = "beats feedback only"
    NO_DIFFERENCE = "no clear difference"
    DOES_NOT = "does not pay"
    UNKNOWN = "not compared"


@dataclass(frozen=True)
class Standings:
    """The content of a table and its verdict; the best of a kind are chosen in the validation episodes.

    Args:
        record: the benchmark. world: one of its worlds, complete.
    """

    record: BenchmarkRecord
    world: World

    @cached_property
    def names(self) -> list[str]:
        """The controllers that drove in this world: trained, entered, compared with."""
        return self.record.names(world=self.world.name)

    @property
    def policy(self) -> str | None:
        """The best trained controller of those that drove in this world."""
        return self.record.best(POLICY, worlds=[self.world])

    @property
    def baseline(self) -> str | None:
        """The best controller that was not trained, of those that drove in this world."""
        return self.record.best(BASELINE, worlds=[self.world])

    def summary(self, name: str) -> Summary:
        """Mean, interquartile mean, median and 95th percentile of a controller's errors over the last 10 steps [mm]."""
        return self._once("summary", name, lambda: self._bootstrap.summary(self._errors(name)))

    def mean(self, name: str) -> Interval:
        """The mean of these errors [mm]."""
        return self.summary(name).mean

    def compare(self, one: str, other: str) -> Comparison:
        """One controller against another, over these errors."""
        errors = self._errors(one), self._errors(other)
        return self._once("comparison", f"{one}\n{other}", lambda: self._bootstrap.compare(*errors))

    def change(self, name: str, before: Standings) -> Interval | None:
        """How much larger a controller's mean error is here than in another world, minus 1.

        None where it did not drive there, in episodes of the same seeds.
        """
        if name not in before.names or self.world.seeds != before.world.seeds:
            return None
        return self._bootstrap.change(self._errors(name), before._errors(name))

    def runs(self, name: str) -> int:
        """Number of runs of a controller."""
        return len(self.record.controller(name).runs)

    def within(self, name: str) -> float:
        """Share of the episodes that end within 1 mm."""
        return float(np.mean(self._errors(name, "final") <= CLOSE_MM))

    def held(self, name: str) -> float:
        """Share of the episodes that are within 1 mm during all of the last 10 steps."""
        return float(self._errors(name, "held").mean())

    def regret(self, name: str) -> float | None:
        """Mean of error at the end minus floor [mm]; None where no floor is known."""
        floors = self.world.floors
        if floors is None or not len(self.world.known_floors):
            return None
        return float(np.nanmean(np.where(np.isfinite(floors), self._errors(name, "final") - floors, np.nan)))

    @property
    def verdict(self) -> Verdict:
        """Whether the best trained controller beats the best other one.

        "pays" asks for separate intervals of the two means; "pays narrowly" for an interval of the paired difference
        that excludes zero, as "does not pay" does on the other side.
        """
        policy, baseline = self.policy, self.baseline
        if policy is None or baseline is None:
            return Verdict.UNKNOWN
        sign = self.compare(policy, baseline).difference.sign
        if sign < 0:
            return Verdict.PAYS if self.mean(policy).is_separate_from(self.mean(baseline)) else Verdict.NARROWLY
        if FEEDBACK in self.names and self.compare(policy, FEEDBACK).difference.sign < 0:
            return Verdict.BEATS_FEEDBACK
        return Verdict.DOES_NOT if sign > 0 else Verdict.NO_DIFFERENCE

    def _errors(self, name: str, what: str = "last") -> Any:
        return self.record.controller(name).errors(self.world.name, what)

    @property
    def _bootstrap(self) -> Bootstrap:
        return bootstrap(self.world.episodes)

    @cached_property
    def _known(self) -> dict[tuple[str, str], Any]:
        return {}

    def _once(self, what: str, name: str, compute: Callable[[], Any]) -> Any:
        if (what, name) not in self._known:
            self._known[what, name] = compute()
        return self._known[what, name]
