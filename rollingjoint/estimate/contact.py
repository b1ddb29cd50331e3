"""Contact with a wall of unknown direction, place and compliance, from the measurements of motors, with intervals.

The wall is flat, elastic and without friction; the chain meets it with its outline. All else that hides, and the
protocol, are those of the other estimators of rigs.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import logsumexp

from rollingjoint.chain.rolling import RollingChain
from rollingjoint.checks import as_floats, as_integer
from rollingjoint.errors import InvalidInput
from rollingjoint.estimate.arrays import Track
from rollingjoint.estimate.hidden import HiddenRanges
from rollingjoint.estimate.rig import VAGUE, Estimated, RigEstimator, RigSensors, Samples, resampled, whole
from rollingjoint.estimate.sampling import sample_in_boxes
from rollingjoint.estimate.wall import (
    DIRECTION,
    HELD,
    N_WALL,
    OFFSET,
    FollowedAmongWall,
    Touching,
    WallAround,
    WallRanges,
)
from rollingjoint.kernels.walled_solve import WallArrays
from rollingjoint.surroundings import Outline
from rollingjoint.transmission import play_step

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_BAD = 12.0  # more cost than that of the best fit: unlikely
_FAR = 1e6  # in standard deviations


class ContactSmoother(RigEstimator):
    """The estimator of rigs beside a wall, which they may touch: it fits the whole history, the wall's numbers too.

    Arguments are those of RigEstimator, but one link may be loaded besides, and:

    Args:
        wall: ranges of the wall's numbers.
        ranges: of all else that hides; by default there is no force but the wall's. link: that another force pulls.
        outline: with which links touch it; by default sleeves of half the links' widths.
        starts: of the fits, how many directions and offsets of the wall.
    Raises:
        InvalidInput: a mechanism or a number that cannot be served; displaced contact surfaces are none of it.
    """

    ROUNDS = 8, 6  # Gauss-Newton steps of all starts, and of the fits with given directions
    DIRECTIONS = 10  # of the wall, about which states are drawn
    PASSES, SPREAD = 2, 5.0  # in which these are found; how far the first ones reach, in standard deviations
    ENOUGH, MOST = 0.6, 8  # effective share of the samples that is enough, and how many rounds bring it about at most

    def __init__(
        self,
        mechanism: RollingChain,
        wall: WallRanges | None = None,
        ranges: HiddenRanges | None = None,
        sensors: RigSensors | None = None,
        link: int = -1,
        *,
        outline: Outline | None = None,
        starts: tuple[int, int] = (4, 4),
        **arguments: Any,
    ) -> None:
        ranges = ranges or HiddenRanges(force=(0.0, 0.0))
        if ranges.surface_mm > 0.0 or ranges.surface_rad > 0.0:
            displaced = ranges.surface_mm, ranges.surface_rad
            raise InvalidInput("displaced surfaces", displaced, "0", "Estimates beside walls take them as exact.")
        super().__init__(mechanism, ranges, sensors, [link], **arguments)
        self.wall_ranges = wall or WallRanges()
        self._grid = tuple(as_integer("starts", number, 1, 1000) for number in starts)
        self._bare, self.prior = self.prior, self.wall_ranges.prior(self.prior)
        self.around = WallAround(mechanism, outline)
        steps = self._steps + (1 if math.isfinite(self.sensors.law.shown_sd) else 0)
        self._followed = FollowedAmongWall(self.around, self.prior, self.sensors.law, steps)

    def _take(self, motors: Array, tensions: Array, pictures: Array) -> None:
        self.smoother.append(motors, np.zeros_like(motors), tensions, pictures, np.zeros(self._count, np.int64))

    def _forget(self) -> None:
        super()._forget()
        for name in ("_every", "touching"):
            self.__dict__.pop(name, None)

    def _fits(self) -> Track:
        return self._every

    @cached_property
    def _every(self) -> Track:
        """Fits with given directions of the wall, those of a rig adjacent, about the best of many starts."""
        low, high = self.wall_ranges.ends
        shares = [(np.arange(number) + 0.5) / number for number in (*self._grid, 1)]
        grid = np.stack(np.meshgrid(*shares, indexing="ij"), axis=-1).reshape(-1, N_WALL)
        rigs = np.repeat(np.arange(self._count), len(grid))
        numbers = np.tile(self._bare.means, (len(rigs), 1))
        self.smoother.place_at_start(numbers, rigs)
        fits = self._followed_at(rigs, np.hstack([numbers, np.tile(low + grid * (high - low), (self._count, 1))]))
        self.smoother.fit(self._followed, fits, self.ROUNDS[0])
        best = fits.cost.reshape(self._count, -1).argmin(axis=1) + len(grid) * np.arange(self._count)
        fits = self._followed_at(np.arange(self._count), fits.numbers[best])
        sd = np.sqrt(np.linalg.inv(self._precisions(fits))[:, self._place, self._place]) * self.prior.sds[self._at]
        ends = fits.numbers[:, self._at, None] + self.SPREAD * sd[:, None] * [-1.0, 1.0]
        for _ in range(self.PASSES):
            fits = self._fits_between(ends, fits)
            ends = self._likely_ends(fits)
        return self._followed_at(fits.episodes, fits.numbers)

    def _fits_between(self, ends: Array, fits: Track) -> Track:
        """Fits with directions between these (N, 2), from fits of every rig; their walls are turned about pivots."""
        at, D, each = self._at, self.DIRECTIONS, len(fits.steps) // self._count
        low, high = np.clip(ends, self.prior.low[at], self.prior.high[at]).T
        self._between = np.repeat(high - low, D) / (D - 1)
        directions = low[:, None] + (high - low)[:, None] * np.linspace(0.0, 1.0, D)
        known, costs = (values.reshape(self._count, each) for values in (fits.numbers[:, at], fits.cost))
        bad = costs > costs.min(axis=1, keepdims=True) + _BAD
        away = np.abs(directions[:, :, None] - known[:, None]) + _FAR * bad[:, None]
        rows = (away.argmin(axis=2) + each * np.arange(self._count)[:, None]).ravel()
        numbers, (x, y), directions = fits.numbers[rows], self._followed.pivots[rows].T, directions.ravel()
        turned = np.cos(directions) - np.cos(numbers[:, at]), np.sin(directions) - np.sin(numbers[:, at])
        numbers[:, at + OFFSET] += x * turned[0] + y * turned[1]
        numbers[:, at] = directions
        rigs = np.repeat(np.arange(self._count), D)
        found = self._followed_at(rigs, self.prior.within(numbers), HELD)
        self.smoother.fit(self._followed, found, self.ROUNDS[1])
        return self._followed_at(rigs, found.numbers)

    def _likely_ends(self, fits: Track) -> Array:
        """Directions between which fits are likely, (N, 2), and one further on either side."""
        costs = fits.cost.reshape(self._count, -1)
        likely, last = costs < costs.min(axis=1, keepdims=True) + _BAD, costs.shape[1] - 1
        first = np.maximum(likely.argmax(axis=1) - 1, 0)
        final = np.minimum(last - likely[:, ::-1].argmax(axis=1) + 1, last)
        directions, each = fits.numbers[:, self._at].reshape(costs.shape), np.arange(self._count)
        return np.stack([directions[each, first], directions[each, final]], axis=1)

    def _followed_at(self, rigs: Indices, numbers: Array, prior: int = 0) -> Track:
        """Hidden numbers (R, K) along the histories of these rigs."""
        links, priors = np.full(len(rigs), self.links[-1]), np.full(len(rigs), prior)
        return self._followed.followed(self.smoother.history, rigs, links, priors, numbers)

    @property
    def _at(self) -> int:
        """Place of the direction among the hidden numbers."""
        return self.prior.layout.surfaces + DIRECTION

    @cached_property
    def _free(self) -> Indices:
        return np.flatnonzero(self.prior.sds > 0.0)

    @property
    def _place(self) -> int:
        """Place of the direction among the free ones."""
        return int(np.searchsorted(self._free, self._at))

    @cached_property
    def _uniform(self) -> Array:
        """Share of the prior's information that a normal prior has beyond a uniform one, of the free numbers."""
        return np.where(self._free < 2, 0.0, 1.0 - VAGUE)

    def _precisions(self, fits: Track) -> Array:
        """Inverse covariances of the free numbers under uniform priors, (R, F, F), in units of their deviations."""
        return np.asarray(whole(fits.information)[:, self._free[:, None], self._free] - np.diag(self._uniform))

    @cached_property
    def samples(self) -> Samples:
        """Hidden states, as likely as they are given all measurements.

        What a wall does is far from linear in its direction, and where it begins to press measurements have a kink. So
        states are drawn about fits with many directions, and of these as many are kept as are likely by what they
        would have measured; more are drawn where few are.
        Source: Rubin, sampling/importance resampling, 1988.
        """
        if not self.smoother.history.counts.any():
            return self._unmeasured()
        due = np.arange(self._count)
        pools: list[list[tuple[Any, ...]]] = [[] for _ in due]
        for number in range(self.MOST):
            followed, excess = self._drawn(due, self._seed + number)
            parts: tuple[Any, ...] = followed.numbers, followed.links, followed.played, followed.angles, excess
            for rig in due.tolist():
                first, last = np.searchsorted(followed.episodes, [rig, rig + 1])
                pools[rig].append(tuple(part[first:last] for part in parts))
            due = np.array([rig for rig in due.tolist() if _effective(pools[rig]) < self.ENOUGH * self._samples], int)
            if not due.size:
                break
        rng = np.random.default_rng(self._seed + self.MOST)
        every = [[np.concatenate(parts) for parts in zip(*pool, strict=True)] for pool in pools]
        kept = [self._kept(rig, pool, rng) for rig, pool in enumerate(every)]
        return Samples(*(np.stack(parts) for parts in zip(*kept, strict=True)))

    def _kept(self, rig: int, pool: Sequence[Any], rng: np.random.Generator) -> list[Any]:
        """As many of the states of a rig as are asked for, those that are likely; its fits where none is within."""
        *parts, excess = pool
        if not np.isfinite(excess).any():
            fits, own = self._fits(), slice(rig * self.DIRECTIONS, (rig + 1) * self.DIRECTIONS)
            parts = [part[own] for part in (fits.numbers, fits.links, fits.played, fits.angles)]
            excess = fits.cost[own]
        rows = resampled(_likelihoods(excess), self._samples, rng)
        return [part[rows] for part in parts]

    def _unmeasured(self) -> Samples:
        """States before any measurement; tendons as in the straight chain."""
        rng, prior, shape = np.random.default_rng(self._seed), self.prior, (self._count, self._samples)
        numbers = rng.uniform(prior.low, prior.high, (*shape, len(prior.low)))
        numbers[..., :2] = prior.sds[:2] * rng.standard_normal((*shape, 2))
        chain = self.mechanism
        played = np.tile(chain.neutral_lengths - self.sensors.law.start_tension / chain.stiffnesses, (*shape, 1))
        links = np.full(shape, self.links[-1])
        return Samples(prior.within(numbers), links, played, np.tile(chain.neutral_angles, (*shape, 1)))

    def _drawn(self, rigs: Indices, seed: int) -> tuple[Track, Array]:
        """States of some rigs, drawn from normal distributions about their fits, and followed along the histories.

        Returns:
            The states within all ranges, those of a rig adjacent, and how much more they cost than draws should.
        """
        free, sds, D = self._free, self.prior.sds[self._free], self.DIRECTIONS
        each = (rigs[:, None] * D + np.arange(D)).ravel()
        fits = Track._make(values[each] for values in self._fits())
        place = self._place
        means, spacing = self.prior.means[free] / sds, self._between[each] / sds[place]
        precisions, here = self._precisions(fits), fits.numbers[:, free] / sds
        precisions[:, place, place] += 1.0 / np.maximum(spacing, 1e-6) ** 2
        slopes = fits.slope[:, free] - self._uniform * (means - here)
        slopes[:, place] = 0.0
        peaks = here + np.linalg.solve(precisions, slopes[..., None])[..., 0]
        low, high = self.prior.low[free] / sds, self.prior.high[free] / sds
        wide_low, wide_high = low.copy(), high.copy()
        wide_low[place:] -= _FAR  # so that equal shares of all distributions are within
        wide_high[place:] += _FAR
        count, rng = -(-self._samples // D), np.random.default_rng(seed)
        drawn = sample_in_boxes(precisions, peaks, wide_low, wide_high, here, count, rng)
        away = drawn.reshape(len(rigs), 1, D * count, -1) - peaks.reshape(len(rigs), D, 1, -1)
        spread = precisions.reshape(len(rigs), D, *precisions.shape[1:])
        likely = 0.5 * np.linalg.slogdet(spread)[1][..., None] - 0.5 * np.sum(away @ spread * away, axis=-1)
        inside = np.flatnonzero(((drawn >= low) & (drawn <= high)).all(axis=2))
        units = drawn.reshape(-1, len(free))[inside]
        states = np.repeat(fits.numbers, count, axis=0)[inside]
        states[:, free] = units * sds
        followed = self._followed_at(np.repeat(rigs, D * count)[inside], states)
        normal = 0.5 * np.sum(self._uniform * (units - means) ** 2, axis=1)
        return followed, followed.cost - normal + logsumexp(likely, axis=1).ravel()[inside]

    def _shapes(self, numbers: Array) -> tuple[Any, NDArray[np.int64]]:
        return self.mechanism.arrays, np.zeros(len(numbers), np.int64)

    def _walls(self, numbers: Array) -> WallArrays:
        return self.around.arrays(numbers[:, self.prior.layout.surfaces :])

    @property
    def wall(self) -> Estimated:
        """The wall's direction [rad], offset [mm] and compliance [mm/N], as in WallRanges, (3,)."""
        return self._interval(self.samples.numbers[..., self.prior.layout.surfaces :])

    @property
    def touches(self) -> Array:
        """Probability that the wall is touched now."""
        return self._out((self.touching.link > 0).mean(axis=1))

    @property
    def touched(self) -> Array:
        """Probability of every link to be the one that presses most, (n,); that of link 0: none presses."""
        return self._out((self.touching.link[..., None] == np.arange(self.mechanism.n_links)).mean(axis=1))

    @property
    def wall_force(self) -> Estimated:
        """The force of the wall on the chain now, (2,) [N]."""
        return self._interval(self.touching.force)

    @property
    def contact(self) -> Estimated:
        """Where the wall is touched now, (2,) [mm], if it is: NaN where no sample of the rig touches it."""
        tail, places = 0.5 * (1.0 - self.level), self.touching.place
        values = np.full((3, self._count, 2), np.nan)
        some = np.isfinite(places).any(axis=(1, 2))
        if some.any():
            values[0, some] = np.nanmean(places[some], axis=1)
            values[1:, some] = np.nanquantile(places[some], (tail, 1.0 - tail), axis=1)
        return Estimated(*map(self._out, values))

    @cached_property
    def touching(self) -> Touching:
        """How the wall presses in the sampled states now, arrays with leading axes (N, S)."""
        each = (self.around.touching(equilibria) for equilibria in self._equilibria)
        return Touching(*(np.stack(parts) for parts in zip(*each, strict=True)))

    def touching_at(self, positions: ArrayLike) -> Touching:
        """How the wall would press in the sampled states if motors went from here to other positions.

        Args:
            positions: K of them, as commanded lengths, (K, m) or (N, K, m) [mm].
        Returns:
            Arrays with leading axes (K, S) or (N, K, S).
        Raises:
            InvalidInput: another shape, or no numbers.
        """
        places, samples, S = as_floats("positions", positions, "numbers (K, m)"), self.samples, self._samples
        K = places.shape[-2] if places.ndim > 1 else 1
        motors = self._rows("positions", places, (K, self.mechanism.n_tendons))[:, :, None]
        half_widths = self._part("half_widths", "frictions")[:, None]
        played = play_step(np.repeat(samples.played[:, None], K, axis=1), motors, half_widths)
        parts = []
        for rig in range(self._count):
            numbers, links, _, angles = (np.concatenate([part[rig]] * K) for part in samples)
            states = Samples(numbers, links, played[rig].reshape(K * S, -1), angles)
            parts.append(self.around.touching(self._solved(states)))
        each = (np.stack(values) for values in zip(*parts, strict=True))
        return Touching._make(self._out(values.reshape(-1, K, S, *values.shape[2:])) for values in each)


def _likelihoods(excess: Array) -> Array:
    """Weights of states by how much more they cost than expected, (S,), of sum 1."""
    weights = np.exp(np.min(excess, initial=np.inf) - excess)
    return np.asarray(weights / weights.sum())


def _effective(pool: Sequence[tuple[Any, ...]]) -> float:
    """As how many independent states those of a rig count."""
    weights = _likelihoods(np.concatenate([parts[-1] for parts in pool]))
    return float(1.0 / np.sum(weights**2)) if weights.size else 0.0
