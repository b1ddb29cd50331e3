"""Intervals from a two-level bootstrap: training seeds and episodes are both resampled.

A learned controller has S runs, one per training seed, and all controllers drive the same E episodes. A resample draws
S of the runs and E of the episodes, with replacement; the episodes are the same for all controllers and runs, so that
differences are paired. Intervals are those between percentiles of the resampled statistic. A statistic of several runs
is the mean over the runs of the statistic over their episodes.

A single run has an interval over episodes alone. Where runs differ much more than the mean over the episodes is
uncertain, percentiles of few runs are narrow: 95 % intervals then cover the true mean in about 75 % of all cases with 3
runs, 88 % with 5, 90 % with 10; elsewhere in 93 to 96 % (measured in tests/agents/results/test_statistics.py).

Source: Owen, The pigeonhole bootstrap, Annals of Applied Statistics 1, 2007; interquartile means and probabilities of
improvement as in Agarwal et al., Deep reinforcement learning at the edge of the statistical precipice, NeurIPS 2021.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.checks import as_floats, as_integer, as_number
from rollingjoint.errors import InvalidInput

Array = NDArray[np.float64]
HIGH = 95  # the percentile in tables, next to mean and median


class Interval(NamedTuple):
    """A statistic, and the ends of its interval."""

    value: float
    low: float
    high: float

    def is_separate_from(self, other: Interval) -> bool:
        """Whether the two intervals have no point in common."""
        return self.high < other.low or other.high < self.low

    @property
    def sign(self) -> int:
        """-1 or 1 where the whole interval is below or above zero, else 0."""
        return int(self.low > 0) - int(self.high < 0)


@dataclass(frozen=True)
class Summary:
    """The distribution of a controller's errors [mm]: mean, interquartile mean, median, 95th percentile."""

    mean: Interval
    iqm: Interval
    median: Interval
    p95: Interval


@dataclass(frozen=True)
class Comparison:
    """One controller against another in the same episodes.

    Args:
        difference: mean error of the first minus the second's [mm].
        ratio: the first one's mean error over the second one's, minus 1; NaN where the second one's is zero.
        improvement: probability that the first one's error is smaller in an episode; equal errors count half.
        runs_better, runs: number of the first one's runs with a mean error below the second's; number of all its runs.
    """

    difference: Interval
    ratio: Interval
    improvement: Interval
    runs_better: int
    runs: int


@dataclass(frozen=True)
class Bootstrap:
    """Resamples of E episodes, the same for everything that is computed with them.

    Args:
        episodes: E. resamples: R. seed: of the draws. level: share of the resamples between the ends of an interval.
    Raises:
        InvalidInput: a number out of range.
    """

    episodes: int
    resamples: int = 10_000
    seed: int = 0
    level: float = 0.95

    def __post_init__(self) -> None:
        as_integer("episodes", self.episodes, 1, 2**31 - 1)
        as_integer("resamples", self.resamples, 1, 10**6)
        as_integer("seed", self.seed, 0)
        as_number("level", self.level, 0.0, 1.0)

    def summary(self, errors: ArrayLike) -> Summary:
        """Mean, interquartile mean, median and 95th percentile of errors (S, E) or (E,) [mm].

        Raises:
            InvalidInput: another number of episodes, or numbers that are not finite.
        """
        values = self._checked("errors", errors)
        shares = self._run_shares(len(values), 0)
        resampled = np.zeros((3, self.resamples))
        for run, share in zip(values, shares.T, strict=True):
            resampled += share * np.stack(_order_statistics(run, self._counts))
        exact = np.mean([_order_statistics(run, np.ones((len(run), 1), np.int32)) for run in values], axis=0)[:, 0]
        iqm, median, p95 = (self._interval(*pair) for pair in zip(exact, resampled, strict=True))
        return Summary(self.mean(values), iqm, median, p95)

    def mean(self, values: ArrayLike) -> Interval:
        """The mean of values (S, E) or (E,), such as shares of episodes or regrets; raises as `summary` does."""
        checked = self._checked("values", values)
        return self._interval(float(checked.mean()), self._means(checked, 0))

    def change(self, now: ArrayLike, before: ArrayLike) -> Interval:
        """Mean error of one controller's runs in one world over that in another, minus 1; raises as `summary` does.

        Both are (S, E) or (E,), of the same runs and of episodes with the same seeds: they are resampled together.
        """
        ours, theirs = self._checked("now", now), self._checked("before", before)
        exact = float(_ratio(ours.mean(), theirs.mean()))
        return self._interval(exact, _ratio(self._means(ours, 0), self._means(theirs, 0)))

    def compare(self, own: ArrayLike, other: ArrayLike) -> Comparison:
        """Errors of one controller (S, E) or (E,) against another's, both [mm]; raises as `summary` does."""
        ours, theirs = self._checked("own", own), self._checked("other", other)
        means = self._means(ours, 0), self._means(theirs, 1)
        exact = float(ours.mean()), float(theirs.mean())
        better = (ours[:, None] < theirs) + 0.5 * (ours[:, None] == theirs)  # (S, T, E)
        pairs = self._run_shares(len(ours), 0)[:, :, None] * self._run_shares(len(theirs), 1)[:, None]  # (R, S, T)
        flat = better.reshape(-1, self.episodes), pairs.reshape(self.resamples, -1)
        return Comparison(
            difference=self._interval(exact[0] - exact[1], means[0] - means[1]),
            ratio=self._interval(float(_ratio(*exact)), _ratio(*means)),
            improvement=self._interval(float(better.mean()), self._weighted(*flat)),
            runs_better=int(np.sum(ours.mean(axis=1) < exact[1])),
            runs=len(ours),
        )

    @cached_property
    def _counts(self) -> NDArray[np.signedinteger[Any]]:
        """The number of times that every episode is in every resample, (E, R)."""
        smallest = np.int16 if self.episodes < 2**15 else np.int32  # half the time of the larger one
        rng = np.random.default_rng([self.seed, 0])
        drawn = rng.integers(0, self.episodes, (self.resamples, self.episodes), dtype=np.int32)
        counts = np.empty((self.episodes, self.resamples), smallest)
        for place, row in enumerate(drawn):
            counts[:, place] = np.bincount(row, minlength=self.episodes)
        return counts

    def _run_shares(self, runs: int, controller: int) -> Array:
        """The share of every run in every resample, (R, S); runs of two controllers are drawn independently."""
        rng = np.random.default_rng([self.seed, 1 + controller])
        return rng.multinomial(runs, np.full(runs, 1 / runs), self.resamples) / runs

    def _means(self, values: Array, controller: int) -> Array:
        """The mean of values (S, E) in every resample, (R,)."""
        return self._weighted(values, self._run_shares(len(values), controller))

    def _weighted(self, values: Array, shares: Array) -> Array:
        """The mean of values (S, E) in every resample, runs with these shares (R, S), (R,)."""
        weights = self._weights / np.float32(self.episodes)
        middle = values.mean()  # taken out, since the product is of single precision
        return middle + np.einsum("rs,sr->r", shares, ((values - middle).astype(np.float32) @ weights).astype(float))

    @cached_property
    def _weights(self) -> NDArray[np.float32]:
        return self._counts.astype(np.float32)

    def _interval(self, value: float, resampled: Array) -> Interval:
        ends = 50 * (1 - self.level), 50 * (1 + self.level)
        low, high = np.percentile(resampled, ends)
        return Interval(float(value), float(low), float(high))

    def _checked(self, what: str, values: ArrayLike) -> Array:
        allowed = f"finite numbers of shape (runs, {self.episodes}) or ({self.episodes},)"
        checked = np.atleast_2d(as_floats(what, values, allowed))
        if checked.ndim != 2 or checked.shape[1] != self.episodes or not len(checked):
            raise InvalidInput(what, checked.shape, allowed)
        if not np.isfinite(checked).all():
            raise InvalidInput(what, "NaN or infinity", allowed)
        return checked


def _order_statistics(values: Array, counts: NDArray[np.signedinteger[Any]]) -> tuple[Array, Array, Array]:
    """Interquartile mean, median and 95th percentile of values (E,), each taken counts (E, R) times, (R,) each.

    With the values in order, resample r holds C(i) = counts[0, r] + ... + counts[i, r] values up to the i-th: its k-th
    smallest value (from 0) is the first one with C > k. The interquartile mean leaves out E // 4 values at both ends;
    percentiles are interpolated, as numpy.percentile does.
    """
    size, order = len(values), np.argsort(values, kind="stable")
    places = {share: (size - 1) * share / 100 for share in (50, HIGH)}
    ranks = [rank for place in places.values() for rank in (int(place), min(int(place) + 1, size - 1))]
    cut = size // 4
    reached, previous = np.zeros_like(counts[0]), np.full_like(counts[0], cut)
    smaller, total = np.zeros((len(ranks), counts.shape[1]), np.int32), np.zeros(counts.shape[1])
    for place in order:
        reached = reached + counts[place]
        for below, rank in zip(smaller, ranks, strict=True):
            below += reached <= rank
        middle = np.clip(reached, cut, size - cut)
        total += values[place] * (middle - previous)
        previous = middle
    ranked = values[order][smaller]
    parts = [place - int(place) for place in places.values()]
    percentiles = [ranked[2 * i] + part * (ranked[2 * i + 1] - ranked[2 * i]) for i, part in enumerate(parts)]
    return total / (size - 2 * cut), percentiles[0], percentiles[1]


def _ratio(value: ArrayLike, reference: ArrayLike) -> Array:
    """value / reference - 1, NaN where the reference is zero."""
    above, below = np.asarray(value, float), np.asarray(reference, float)
    return np.divide(above, below, out=np.full(above.shape, np.nan), where=below != 0) - 1
