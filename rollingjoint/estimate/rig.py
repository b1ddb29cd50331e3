"""Loads, friction, play, offsets and shape of rigs from positions and tensions of their motors, with intervals.

Two estimators with one protocol: RigSmoother fits everything that was measured, RigFilter what the last step left.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.chain.batch import solve_batch
from rollingjoint.chain.chain import check_chain
from rollingjoint.chain.rolling import RollingChain
from rollingjoint.chain.variations import ChainVariations
from rollingjoint.checks import as_floats, as_integer, as_number
from rollingjoint.compiled import TendonLaw
from rollingjoint.errors import InvalidInput
from rollingjoint.estimate.arrays import MeasurementLaw, Track
from rollingjoint.estimate.equations import propose
from rollingjoint.estimate.hidden import HiddenPrior, HiddenRanges
from rollingjoint.estimate.sampling import sample_in_boxes
from rollingjoint.estimate.smoother import Effort, Smoother
from rollingjoint.kernels.walled_solve import WallArrays
from rollingjoint.load import LOAD_COLUMNS, link_index

Array = NDArray[np.float64]

_LINK, _FX = LOAD_COLUMNS.index("link"), LOAD_COLUMNS.index("fx")
_HIGHEST = 1e6  # N
VAGUE = 0.05  # share of a prior's information that stays where it is uniform: density at its ends 0.93 of the middle's
_SAME = 0.3  # standard deviations of the estimate: fits that are nearer in every number are one
_UNLIKELY = 1e-3  # of the weight of the best fit: others are left out
_START_TENSION = 3.0  # N: about which lengths of displaced surfaces are linear, where no start is known


@dataclass(frozen=True)
class RigSensors:
    """What motors and cameras of a rig measure, and how well.

    Args:
        tension_sd: standard deviation of a measured tension [N]. tension_share: the same in proportion to it.
        at_tendons: whether load cells are behind the sheath, at the tendons; else at the motors.
        start_tension: that load cells showed before the load acted, with motors at the first positions, which were set
            by it; None: not known [N]. start_sd: of what they showed then [N].
        angle_sd, position_sd_mm: of the links in a picture [rad, mm].
        memory: share of the force that stays from step to step, 1: all of it.
    Raises:
        InvalidInput: a number that is none, or out of range.
    """

    tension_sd: float = 0.05
    tension_share: float = 0.0
    at_tendons: bool = False
    start_tension: float | None = None
    start_sd: float = 0.05
    angle_sd: float = 0.01
    position_sd_mm: float = 0.5
    memory: float = 1.0

    def __post_init__(self) -> None:
        for name in ("tension_sd", "start_sd", "angle_sd", "position_sd_mm"):
            as_number(name, getattr(self, name), 1e-6, 1e6)
        as_number("tension_share", self.tension_share, 0.0, 10.0)
        as_number("memory", self.memory, 0.0, 1.0)
        if self.start_tension is not None:
            as_number("start_tension", self.start_tension, 1e-3, 1e6)

    @property
    def law(self) -> MeasurementLaw:
        """As the smoother takes it."""
        known = self.start_tension is not None
        return MeasurementLaw(
            start_tension=self.start_tension if self.start_tension is not None else _START_TENSION,
            start_sd=math.inf,
            shown_sd=self.start_sd if known else math.inf,
            low=0.0,
            high=math.inf,
            limit_sd=math.inf,
            cells_at_tendons=self.at_tendons,
            tension_sd=self.tension_sd,
            tension_share=self.tension_share,
            robust=math.inf,
            memory=self.memory,
            angle_sd=self.angle_sd,
            position_sd=self.position_sd_mm,
        )


@dataclass(frozen=True)
class Estimated:
    """An estimate: the mean of what is possible, and equal-tailed intervals of a probability, arrays of one shape."""

    mean: Array
    low: Array
    high: Array

    @property
    def interval(self) -> tuple[Array, Array]:
        """Its ends."""
        return self.low, self.high

    def contains(self, values: ArrayLike) -> NDArray[np.bool_]:
        """Whether values lie within."""
        given = np.asarray(values, float)
        return np.asarray((self.low <= given) & (given <= self.high))


class Samples(NamedTuple):
    """S hidden states of N rigs, as likely as they are given all measurements."""

    numbers: Array  # hidden numbers, (N, S, K)
    links: NDArray[np.int64]  # the loaded ones, (N, S)
    played: Array  # commands of the tendons behind their play, (N, S, m) mm
    angles: Array  # joint angles near their equilibria, (N, S, J) rad


class RigEstimator(ABC):
    """Estimates of what rigs hide, after every step; N rigs side by side, or one.

    A rig is a chain in the plane whose motors take tendons along through play and a sheath, under a force on one link.
    Its motors are taken to be where they measure, what hides is drawn from the ranges. Estimates have a leading axis N
    where `rigs` is a number.

    Args:
        mechanism: the nominal chain, without springs and friction of its own.
        ranges: of what may hide.
        sensors: of the rigs.
        links: those that may be loaded, by default the last one.
        rigs: how many there are; None: one, and arrays have no axis for it.
        steps: of measurements at most.
        level: probability of the intervals. In the first steps, before the motors have turned round, they hold the
            truth less often: 73 to 84 % in place of 95 % after 3 and 4 steps (docs/estimation.md).
        samples: of hidden states, from which means and intervals follow. seed: of these samples.
    Raises:
        InvalidInput: a mechanism or a number that cannot be served.
    """

    def __init__(
        self,
        mechanism: RollingChain,
        ranges: HiddenRanges | None = None,
        sensors: RigSensors | None = None,
        links: Sequence[int] | None = None,
        *,
        rigs: int | None = None,
        steps: int = 100,
        level: float = 0.95,
        samples: int = 400,
        seed: int = 0,
    ) -> None:
        check_chain(mechanism)
        if not isinstance(mechanism, RollingChain):
            raise InvalidInput("mechanism", mechanism, "a RollingChain", "Estimates of rigs serve chains in the plane.")
        self.mechanism, self.ranges, self.sensors = mechanism, ranges or HiddenRanges(), sensors or RigSensors()
        self.level, self._one = as_number("level", level, 0.5, 0.9999), rigs is None
        self._count = 1 if rigs is None else as_integer("rigs", rigs, 1)
        self._steps, self._samples = as_integer("steps", steps, 1, 100_000), as_integer("samples", samples, 20, 10**6)
        self._seed = as_integer("seed", seed, 0)
        self.prior = HiddenPrior.of(mechanism, self.ranges)
        every = [mechanism.n_links - 1] if links is None else [link_index(link, mechanism.n_links) for link in links]
        self.links = sorted(set(every))
        searches = [13 * 2**k for k in range(20) if 13 * 2**k <= self._steps]
        effort, law = Effort(searches=searches), self.sensors.law
        self.smoother = Smoother(mechanism, self.prior, law, self.links, effort, self._steps, pictured=True)
        self.reset()

    def reset(self) -> None:
        """Forget all measurements."""
        self.smoother.reset(np.ones(0, bool))
        self.smoother.reset(np.ones(self._count, bool))
        self._forget()

    def update(self, positions: ArrayLike, tensions: ArrayLike, poses: ArrayLike | None = None) -> None:
        """Take the measurements of a step in.

        Args:
            positions: of the motors, as commanded lengths, (m,) or (N, m) [mm].
            tensions: measured, likewise [N]; NaN where there is none.
            poses: x, y and angle of the moving links in a picture, (n - 1, 3) or (N, n - 1, 3) [mm, rad]; NaN for what
                it does not show.
        Raises:
            InvalidInput: another shape, positions that are no numbers, or more steps than there is room for.
        """
        if self.smoother.measured_steps[0] >= self._steps:
            raise InvalidInput("steps", self._steps + 1, f"at most {self._steps}", "Reset it, or give it more steps.")
        m, J = self.mechanism.n_tendons, self.mechanism.n_joints
        motors, measured = self._rows("positions", positions, (m,)), self._rows("tensions", tensions, (m,))
        if not np.isfinite(motors).all():
            raise InvalidInput("positions", positions, "finite numbers [mm]")
        pictures = np.full((self._count, J, 3), np.nan) if poses is None else self._rows("poses", poses, (J, 3))
        self._take(motors, measured, pictures)
        self._forget()

    def _rows(self, what: str, values: ArrayLike, shape: tuple[int, ...]) -> Array:
        wanted = shape if self._one else (self._count, *shape)
        array = as_floats(what, values, f"numbers, {wanted}")
        if array.shape != wanted:
            raise InvalidInput(f"shape of {what}", array.shape, f"{wanted}")
        return array.reshape(self._count, *shape)

    def _forget(self) -> None:
        for name in ("samples", "poses", "_equilibria"):
            self.__dict__.pop(name, None)

    @abstractmethod
    def _take(self, motors: Array, tensions: Array, pictures: Array) -> None:
        """Take the measurements of a step in, of all rigs."""

    @abstractmethod
    def _fits(self) -> Track:
        """Fits of all rigs, those of a rig adjacent, as many of each."""

    @cached_property
    def samples(self) -> Samples:
        """Hidden states, as likely as they are given all measurements; ranges are uniform, the force is normal."""
        return _sampled(self.smoother.fine, self.prior, self._fits(), self._count, self._samples, self._seed)

    @property
    def load(self) -> Estimated:
        """The force on the loaded link, (2,) [N]."""
        return self._interval(self.samples.numbers[..., :2])

    @property
    def place(self) -> Array:
        """Probability of every link to be the loaded one, (n,)."""
        links = self.samples.links[..., None] == np.arange(self.mechanism.n_links)
        return self._out(links.mean(axis=1))

    @property
    def offsets(self) -> Estimated:
        """What commanded lengths are off, (m,) [mm]."""
        return self._interval(self._part("offsets", "stiffnesses"))

    @property
    def stiffnesses(self) -> Estimated:
        """Of the tendons, (m,) [N/mm]."""
        return self._interval(self._part("stiffnesses", "half_widths") * self.mechanism.stiffnesses)

    @property
    def play(self) -> Estimated:
        """Widths of the play, (m,) [mm]."""
        return self._interval(2.0 * self._part("half_widths", "frictions"))

    @property
    def friction(self) -> Estimated:
        """Exponents of the friction of sheaths, (m,)."""
        return self._interval(self._part("frictions", "places"))

    @property
    def commands(self) -> Estimated:
        """Commanded lengths of the tendons behind their play, offsets included, (m,) [mm]."""
        return self._interval(self.samples.played + self._part("offsets", "stiffnesses"))

    @property
    def tip(self) -> Estimated:
        """Where the tip is, (2,) [mm]."""
        return self._interval(self.poses[:, :, -1, :2])

    @property
    def shape(self) -> Estimated:
        """x, y and angle of all links, (n, 3) [mm, rad]."""
        return self._interval(self.poses)

    @property
    def misfit(self) -> Array:
        """Cost per measurement, about 1/2 where the model holds; 3 is doubtful."""
        track, count = self._fits(), np.maximum(self.smoother.history.counts * self.mechanism.n_tendons, 1)
        return self._out(track.misfit.reshape(self._count, -1).min(axis=1) / count)

    @cached_property
    def poses(self) -> Array:
        """Of all links in the sampled states, (N, S, n, 3) [mm, rad]: their equilibria."""
        return np.stack([equilibria.poses for equilibria in self._equilibria])

    @cached_property
    def _equilibria(self) -> list[Any]:
        """The equilibria of the sampled states, a batch for every rig."""
        return [self._solved(Samples(*(part[rig] for part in self.samples))) for rig in range(self._count)]

    def _solved(self, samples: Samples) -> Any:
        """The equilibria of the states of one rig, S rows."""
        numbers, at, chain = samples.numbers, self.prior.layout, self.mechanism
        R, m = samples.played.shape
        commands = samples.played + numbers[:, at.offsets : at.stiffnesses]
        stiff = chain.stiffnesses * numbers[:, at.stiffnesses : at.half_widths]
        laws = TendonLaw(commands, stiff, np.zeros((R, m)), np.full((R, m), _HIGHEST))
        loads = np.zeros((R, 1, len(LOAD_COLUMNS)))
        loads[:, 0, _LINK], loads[:, 0, _FX : _FX + 2] = samples.links, numbers[:, :2]
        starts, shapes = np.array(samples.angles, order="C"), self._shapes(numbers)
        return solve_batch(type(chain), chain, *shapes, laws, loads, starts, self._walls(numbers))

    def _shapes(self, numbers: Array) -> tuple[Any, NDArray[np.int64]]:
        """Arrays of the chains of hidden numbers (R, K), and the index of each in them."""
        at, chain, R = self.prior.layout, self.mechanism, len(numbers)
        if at.surfaces == at.total:
            return chain.arrays, np.zeros(R, np.int64)
        each = numbers[:, at.surfaces :].reshape(R, chain.n_joints, 2, 3)
        surfaces = np.zeros((R, chain.n_links, 2, 3))
        surfaces[:, :-1, 1], surfaces[:, 1:, 0] = each[:, :, 0], each[:, :, 1]
        varied = ChainVariations(chain, surfaces, np.ones((R, chain.n_tendons)))
        return varied.arrays, varied.designs

    def _walls(self, numbers: Array) -> WallArrays | None:
        """What is around the chain in states (R, K); None: nothing."""
        return None

    def _part(self, first: str, last: str) -> Array:
        at = self.prior.layout
        return self.samples.numbers[..., getattr(at, first) : getattr(at, last)]

    def _interval(self, values: Array) -> Estimated:
        tail = 0.5 * (1.0 - self.level)
        low, high = np.quantile(values, (tail, 1.0 - tail), axis=1)
        return Estimated(*map(self._out, (values.mean(axis=1), low, high)))

    def _out(self, values: Array) -> Array:
        return values[0] if self._one else values


class RigSmoother(RigEstimator):
    """The estimator that fits the whole history anew: Gauss-Newton from many starts, on exact derivatives."""

    def _take(self, motors: Array, tensions: Array, pictures: Array) -> None:
        self.smoother.take_in(motors, np.zeros_like(motors), tensions, pictures, np.zeros(self._count, np.int64))

    def _forget(self) -> None:
        super()._forget()
        self.__dict__.pop("_every", None)

    def _fits(self) -> Track:
        return self._every

    @cached_property
    def _every(self) -> Track:
        """The present fit, and fits from many starts."""
        smoother, count = self.smoother, self._count
        searched = smoother.fits(np.arange(count), 1, smoother.effort.starts)
        each = len(searched.steps) // count
        order = np.hstack([count * each + np.arange(count)[:, None], np.arange(count * each).reshape(count, each)])
        pairs = zip(searched, smoother.track, strict=True)
        return Track._make(np.concatenate([fits, present])[order.ravel()] for fits, present in pairs)


class RigFilter(RigSmoother):
    """The estimator that keeps normal distributions of the hidden numbers, at a cost that stays.

    The first steps are fitted together, by RigSmoother. Its fits go on as iterated extended Kalman filters in
    information form, side by side, and are weighed by their evidence.

    Attributes:
        together: number of the first steps.
    """

    together = 20
    _PASSES = 3  # of a step, each expanded where the last one ended

    def reset(self) -> None:
        """Forget all measurements."""
        self._filters: Track | None = None
        super().reset()

    def _take(self, motors: Array, tensions: Array, pictures: Array) -> None:
        if self.smoother.measured_steps[0] < self.together:
            super()._take(motors, tensions, pictures)
            return
        if self._filters is None:
            self._filters = self._every
        self.smoother.append(motors, np.zeros_like(motors), tensions, pictures, np.zeros(self._count, np.int64))
        self._filters = self._advanced(self._filters)

    def _fits(self) -> Track:
        return self._every if self._filters is None else self._filters

    def _advanced(self, filters: Track) -> Track:
        """The filters after another step: of its passes, the one with the lowest cost where it was expanded."""
        best, numbers = None, self._peaks(filters)
        for _ in range(self._PASSES):
            trial = _moved(filters, self.prior, numbers)
            self.smoother.fine.follow(trial, self.smoother.history)
            if best is None:
                best = trial
            else:
                better = trial.cost < best.cost
                for values, others in zip(best, trial, strict=True):
                    values[better] = others[better]
            numbers = self._peaks(best)
        return filters if best is None else best

    def _peaks(self, filters: Track) -> Array:
        """The most likely hidden numbers, (R, K)."""
        numbers, count = np.empty_like(filters.numbers), len(filters.numbers)
        farthest = self.smoother.effort.farthest
        propose(filters, self.prior.sds[None], np.zeros(count), farthest, numbers, np.empty(count))
        return self.prior.within(numbers)


def _moved(filters: Track, prior: HiddenPrior, numbers: Array) -> Track:
    """A copy with the same costs, expanded about other numbers (R, K)."""
    at, moved = prior.layout, Track._make(values.copy() for values in filters)
    change = numbers - filters.numbers
    units = np.divide(change, prior.sds, out=np.zeros_like(change), where=prior.sds > 0.0)
    pulled = np.einsum("rij,rj->ri", whole(filters.information), units)
    moved.cost[:] += np.sum(units * (0.5 * pulled - filters.slope), axis=1)
    moved.slope[:] -= pulled
    moved.played[:] += filters.by_width * change[:, at.half_widths : at.frictions]
    moved.played[:] += filters.by_place * change[:, at.places : at.gains]
    moved.numbers[:] = numbers
    if filters.forces.shape[1] > 0:
        moved.forces[np.arange(len(numbers)), filters.steps - 1] = numbers[:, :2]
    return moved


def whole(lower: Array) -> Array:
    """Symmetric matrices from their lower triangles, (R, K, K)."""
    triangle = np.tril(lower, -1)
    return np.tril(lower) + np.swapaxes(triangle, 1, 2)


def _sampled(followed: Any, prior: HiddenPrior, fits: Track, rigs: int, count: int, seed: int) -> Samples:
    """Samples of N rigs from the normal approximations of their fits, those of a rig adjacent, within the ranges.

    A fit counts by its evidence (Laplace's approximation); of fits in the same minimum the best one counts.
    """
    at, rng = prior.layout, np.random.default_rng(seed)
    known = prior.sds == 0.0
    free = np.flatnonzero(~known)
    sds, uniform = prior.sds[free], np.where(free < 2, 0.0, 1.0 - VAGUE)
    measured, eye = fits.steps[:, None] > 0, np.eye(len(free))
    deviations = (prior.means - fits.numbers)[:, free] / sds
    information = np.where(measured[..., None], whole(fits.information)[:, free[:, None], free], eye)
    precisions = information - uniform * eye
    slopes = np.where(measured, fits.slope[:, free], deviations) - uniform * deviations
    peaks = np.linalg.solve(precisions, slopes[..., None])[..., 0]
    spreads = np.sqrt(np.einsum("rii->ri", np.linalg.inv(information)))
    costs = np.where(measured[:, 0], followed.unlikely(fits), 0.0)
    weights = _weights(costs, fits, spreads * sds, free, rigs)
    rows = np.concatenate([resampled(weights[rig], count, rng) + rig * weights.shape[1] for rig in range(rigs)])
    used = np.unique(rows)
    most = np.bincount(rows).max()
    low, high = prior.low[free] / sds, prior.high[free] / sds
    here = fits.numbers[:, free] / sds
    drawn = sample_in_boxes(precisions[used], (here + peaks)[used], low, high, here[used], int(most), rng)
    place = np.arange(len(rows)) - np.searchsorted(rows, rows)  # among the samples of the same fit
    numbers = fits.numbers[rows].copy()
    numbers[:, free] = drawn[np.searchsorted(used, rows), place] * sds
    change = numbers - fits.numbers[rows]
    played = fits.played[rows] + fits.by_width[rows] * change[:, at.half_widths : at.frictions]
    played += fits.by_place[rows] * change[:, at.places : at.gains]
    parts = numbers, fits.links[rows], played, fits.angles[rows]
    return Samples(*(part.reshape(rigs, count, *part.shape[1:]) for part in parts))


def _weights(unlikely: Array, fits: Track, spreads: Array, free: NDArray[np.int64], rigs: int) -> Array:
    """Weights of the fits of every rig, (N, F), of sum 1; 0 for those that are a better one again."""
    costs = np.where(np.isfinite(unlikely), unlikely, 1e12).reshape(rigs, -1)
    weights = np.exp(costs.min(axis=1, keepdims=True) - costs)
    weights[weights < _UNLIKELY] = 0.0
    numbers = fits.numbers[:, free].reshape(*costs.shape, -1)
    links, widths = fits.links.reshape(costs.shape), spreads.reshape(*costs.shape, -1)
    order = costs.argsort(axis=1)
    each = np.arange(rigs)
    for worse in range(1, costs.shape[1]):
        here = order[:, worse]
        for better in range(worse):
            other = order[:, better]
            away = np.abs(numbers[each, here] - numbers[each, other]) / np.maximum(widths[each, other], 1e-12)
            same = (away.max(axis=1) < _SAME) & (links[each, here] == links[each, other])
            weights[each[same], here[same]] = 0.0
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))


def resampled(weights: Array, count: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """`count` indices in order, each as often as its weight says: systematic resampling."""
    places = (np.arange(count) + rng.uniform()) / count
    return np.minimum(np.searchsorted(np.cumsum(weights), places), len(weights) - 1)
