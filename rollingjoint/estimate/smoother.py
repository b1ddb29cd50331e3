"""Full-information smoother: the most likely hidden numbers of episodes, given all that was measured in them so far."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rollingjoint.chain.rolling import RollingChain
from rollingjoint.compiled import PinnedRange, TendonLaw
from rollingjoint.errors import InvalidInput
from rollingjoint.estimate import equations, kernels
from rollingjoint.estimate.arrays import MeasurementLaw, Model, MotorHistory, Track, empty_track
from rollingjoint.estimate.hidden import HiddenPrior
from rollingjoint.estimate.surfaces import SurfaceTables, surface_tables
from rollingjoint.load import LOAD_COLUMNS

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Mask = NDArray[np.bool_]

_LARGEST_TENSION = 1e4  # N: motors stand where they were measured, whatever the tension
_EASED, _DAMPED = 0.2, 10.0  # factors of the damping after a better and a worse trial
LEAST_DAMPING, _FIRST, MOST_DAMPING = 1e-6, 1e-2, 1e6  # damping: the smallest, of new starts, the largest
_SURPRISE = 5.0  # minus the logarithm of the probability of the second prior, over that of the first


@dataclass(frozen=True)
class Effort:
    """How hard a smoother searches.

    Args:
        every: steps after which the history is followed anew, along the present estimate.
        moved: change of a hidden number, in standard deviations of its prior, after which it is at once.
        passes: how often in one step at most.
        searches: numbers of measured steps after which the fit starts anew from many places.
        starts: of the play of every tendon, such a search tries this many.
        doubt: cost per measurement above which the fit is searched for anew, under the second prior, too, with a start
            more. patience: steps after a search before one for such a reason. tries: how often at most.
        rounds: Gauss-Newton steps of every start, with exact surfaces.
        coarse_sd: standard deviation of tensions in these [N].
        kept: best starts for every link that go on with displaced surfaces.
        farthest: largest change of a hidden number in one Gauss-Newton step, in standard deviations.
    """

    every: int = 6
    moved: float = 0.5
    passes: int = 2
    searches: Sequence[int] = (13, 25)
    starts: int = 3
    doubt: float = math.inf
    patience: int = 4
    tries: int = 4
    rounds: int = 5
    coarse_sd: float = 0.3
    kept: int = 2
    farthest: float = 2.0


class Smoothed(NamedTuple):
    """The present estimate of N episodes."""

    numbers: Array  # hidden ones, (N, K)
    tip: Array  # (N, 2) mm
    tensions: Array  # (N, m) N
    tip_by_command: Array  # (N, 2, m)
    tensions_by_command: Array  # (N, m, m) N/mm
    played: Array  # commands of the tendons behind their play, (N, m) mm
    half_widths: Array  # of the play, (N, m) mm
    misfit: Array  # cost per measurement, (N,): about 1/2 where the model holds


class Smoother:
    """Maximum a posteriori estimate of the hidden numbers of N episodes side by side, step by step.

    Every measured step is linearised where the estimate was when the history was last followed; the normal equations of
    the whole history are solved in every step. Now and then the history is followed anew along the present estimate
    (Gauss-Newton), where that lowers the cost (Levenberg-Marquardt), and after some steps from many other widths of the
    play and loaded links, whose costs have several minima.

    Args:
        chain: the nominal mechanism.
        prior: of its hidden numbers.
        law: of its measurements.
        worn: a second prior with the same layout, where the fit is in doubt.
        links: those that the load may pull.
        effort: of the search.
        steps: number of measured steps that an episode can have.
        pictured: whether there are pictures.
    """

    def __init__(
        self,
        chain: RollingChain,
        prior: HiddenPrior,
        law: MeasurementLaw,
        links: Sequence[int],
        effort: Effort | None = None,
        steps: int = 51,
        pictured: bool = False,
        worn: HiddenPrior | None = None,
    ) -> None:
        if chain.springs or chain.has_friction:
            raise InvalidInput("mechanism", chain, "a chain without springs and friction", "The smoother knows none.")
        self.prior, self.effort, self._links = prior, effort or Effort(), list(links)
        self._count = -1  # no episodes yet
        self._pictured = chain.n_joints if pictured else 0
        self._before = 1 if math.isfinite(law.shown_sd) else 0  # steps of a history before those that are measured
        self._steps, self._n_tendons = self._before + steps, chain.n_tendons
        tables = surface_tables(chain, prior.layout, law.start_tension)
        priors = [prior, *([] if worn is None else [worn])]
        self.fine = FollowedChain(chain, priors, law, tables, self._steps)
        coarse = law._replace(tension_sd=max(law.tension_sd, self.effort.coarse_sd))
        exact = [each.without_surfaces() for each in priors]
        self._coarse = FollowedChain(chain, exact, coarse, tables, self._steps)
        self.reset(np.ones(0, bool))

    def reset(self, mask: Mask) -> None:
        """Begin the episodes of the mask, (N,), without measurements; all where N has changed."""
        count, m = len(mask), self._n_tendons
        if count != self._count:
            self._count, mask = count, np.ones(count, bool)
            pictures = np.full((count, self._steps, self._pictured, 3), np.nan)
            motors, shifts, tensions = (np.zeros((count, self._steps, m)) for _ in range(3))
            self.history = MotorHistory(np.zeros(count, np.int64), motors, shifts, tensions, pictures)
            self.track = self._begun(np.arange(count), np.full(count, self._links[-1]))
            self._damping = np.full(count, LEAST_DAMPING)
            self._since, self._tries, self._rested = (np.zeros(count, np.int64) for _ in range(3))
        rows = np.flatnonzero(mask)
        if rows.size:
            self.history.pictures[rows] = np.nan
            self._damping[rows] = LEAST_DAMPING
            for counts in (self.history.counts, self._since, self._tries, self._rested):
                counts[rows] = 0
            _put(self.track, rows, self._begun(rows, np.full(len(rows), self._links[-1])))

    @property
    def links(self) -> Integers:
        """The links that are taken to be loaded, (N,)."""
        return self.track.links

    @property
    def joint_angles(self) -> Array:
        """Of the nominal chain where the history was last followed, (N, n - 1) [rad]."""
        return self.track.angles

    @property
    def priors(self) -> Integers:
        """Which prior explains the measurements best, (N,): 0, or 1 where it is the worn mechanism."""
        return self.track.priors

    @property
    def measured_steps(self) -> Integers:
        """How many steps of the episodes have been measured, (N,)."""
        return np.maximum(self.history.counts - self._before, 0)

    @property
    def trusted_from(self) -> int:
        """Measured steps from which on a misfit tells that the fit has failed."""
        return min(self.effort.searches, default=0)

    def _begun(self, episodes: Integers, links: Integers) -> Track:
        numbers, priors = np.tile(self.prior.means, (len(episodes), 1)), np.zeros(len(episodes), np.int64)
        return self.fine.begun(episodes, links, priors, numbers)

    def take_in(
        self,
        motors: Array,
        shifts: Array,
        tensions: Array,
        pictures: Array | None = None,
        ages: Integers | None = None,
    ) -> Smoothed:
        """The estimate after another step of all episodes; those with all their steps measured stay as they are.

        Args:
            motors: measured positions, (N, m) [mm].
            shifts: how far motors have given way in this step at a limit of tension, taking tendons along, (N, m) [mm].
            tensions: measured, (N, m) [N]; NaN where there is none.
            pictures: x, y and angle of the moving links in a picture that comes now, (N, n - 1, 3) [mm, rad]; NaN where
                none comes. ages: of the pictures, (N,) [steps].
        """
        rows, late = self.append(motors, shifts, tensions, pictures, ages)
        self._since[rows] += 1
        self.fine.follow(self.track, self.history)
        searched = np.zeros(self._count, bool)
        searched[rows] = np.isin(self.measured_steps[rows], list(self.effort.searches))
        if searched.any():
            self._search(np.flatnonzero(searched), 1, self.effort.starts)
        doubtful = self._doubtful(rows) & ~searched
        if doubtful.any():
            self._search(np.flatnonzero(doubtful), len(self.fine.priors), self.effort.starts + 1)
            self._tries[doubtful] += 1
        self._rested += 1
        self._rested[searched | doubtful] = 0
        self._renew(searched | doubtful, late)
        return self._smoothed()

    def append(
        self,
        motors: Array,
        shifts: Array,
        tensions: Array,
        pictures: Array | None = None,
        ages: Integers | None = None,
    ) -> tuple[Integers, Mask]:
        """Put a step into the histories; the episodes that had room for it, and whether a late picture came, (N,).

        Arguments as of `take_in`.
        """
        history = self.history
        if self._before:
            rows = np.flatnonzero(history.counts == 0)
            history.motors[rows, 0], history.tensions[rows, 0] = motors[rows], self.fine.model.law.start_tension
            history.counts[rows] = 1
            starts = self.track.numbers[rows]
            self.place_at_start(starts, rows)
            self.track.numbers[rows] = starts
        rows = np.flatnonzero(history.counts < self._steps)
        for values, measured in zip(history[1:4], (motors, shifts, tensions), strict=True):
            values[rows, history.counts[rows]] = measured[rows]
        history.counts[rows] += 1
        late = np.zeros(self._count, bool)
        if pictures is not None and ages is not None:
            places = history.counts - 1 - ages
            late = np.isfinite(pictures[:, 0, 0]) & (places >= self._before)
            late[np.setdiff1d(np.arange(self._count), rows)] = False
            history.pictures[np.flatnonzero(late), places[late]] = pictures[late]
            late &= ages > 0
        return rows, late

    def _doubtful(self, rows: Integers) -> Mask:
        """Whether the fits of these episodes are in doubt and rested since they were searched for last, (N,)."""
        effort, misfit = self.effort, self.track.misfit / self._measurements()
        due = np.zeros(self._count, bool)
        due[rows] = self.measured_steps[rows] > min(effort.searches, default=self._steps)
        return due & (misfit > effort.doubt) & (self._rested >= effort.patience) & (self._tries < effort.tries)

    def _measurements(self) -> Integers:
        """How many measurements the episodes have, (N,); 1 before any."""
        shown = np.isfinite(self.history.pictures).sum(axis=(1, 2, 3))
        return np.maximum(self.history.counts * self._n_tendons + shown, 1)

    def _renew(self, searched: Mask, late: Mask) -> None:
        """Follow histories anew, where that is due, along estimates that lower their costs.

        late: where a picture of an earlier step has come, whose costs are not known before that.
        """
        effort, track = self.effort, self.track
        for number in range(effort.passes):
            proposals, forces = self.fine.proposals(track, self._damping, effort.farthest)
            change = np.abs(proposals - track.numbers) / np.maximum(self.fine.model.sds[track.priors], 1e-12)
            due = (change.max(axis=1) > effort.moved) & (self._damping < MOST_DAMPING)
            if number == 0:
                due |= (self._since >= effort.every) | searched | late
            rows = np.flatnonzero(due)
            if not rows.size:
                break
            which = track.episodes[rows], track.links[rows], track.priors[rows], proposals[rows], forces[rows]
            trial = self.fine.followed(self.history, *which)
            better = (trial.cost < track.cost[rows]) | (late[rows] & (number == 0))
            self._damping[rows] = adapted_damping(self._damping[rows], better)
            self._since[rows] = 0
            _put(track, rows[better], trial, np.flatnonzero(better))

    def _search(self, rows: Integers, n_priors: int, n_starts: int) -> None:
        """Fit the histories of some episodes from many starts, with the first priors; keep fits with lower costs."""
        fine = self.fits(rows, n_priors, n_starts)
        costs = self.fine.unlikely(fine).reshape(len(rows), -1)
        winners = np.arange(len(rows)) * costs.shape[1] + costs.argmin(axis=1)
        better = costs.min(axis=1) < self.fine.unlikely(self.track)[rows]
        _put(self.track, rows[better], fine, winners[better])
        self._damping[rows[better]] = LEAST_DAMPING

    def fits(self, rows: Integers, n_priors: int, n_starts: int) -> Track:
        """Fits of the histories of some episodes from many starts, those of an episode adjacent, as many of each."""
        effort, widths = self.effort, slice(self.prior.layout.half_widths, self.prior.layout.frictions)
        if not np.any(self.prior.high[widths] > self.prior.low[widths]):
            n_starts = 1
        shares = (np.arange(n_starts) + 0.5) / n_starts
        places = np.stack(np.meshgrid(*[shares] * self._n_tendons, indexing="ij"), axis=-1).reshape(-1, self._n_tendons)
        groups = [(number, link) for number in range(n_priors) for link in self._links]
        priors, links = (np.repeat(values, len(places)) for values in zip(*groups, strict=True))
        starts = self._coarse.model.means[priors]
        low, high = (ends[priors][:, widths] for ends in self._coarse.bounds)
        starts[:, widths] = low + np.tile(places, (len(groups), 1)) * (high - low)
        numbers, episodes = np.tile(starts, (len(rows), 1)), np.repeat(rows, len(starts))
        self.place_at_start(numbers, episodes)
        which = episodes, np.tile(links, len(rows)), np.tile(priors, len(rows)), numbers
        coarse = self._coarse.followed(self.history, *which, self.track.forces[episodes])
        self.fit(self._coarse, coarse, effort.rounds)
        costs = self._coarse.unlikely(coarse).reshape(len(rows) * len(groups), -1)
        order = costs.argsort(axis=1)[:, : effort.kept]
        best = (np.arange(len(costs))[:, None] * costs.shape[1] + order).ravel()
        numbers = self.fine.model.means[coarse.priors[best]]
        numbers[:, : starts.shape[1]] = coarse.numbers[best]
        starts_again = coarse.episodes[best], coarse.links[best], coarse.priors[best], numbers, coarse.forces[best]
        fine = self.fine.followed(self.history, *starts_again)
        self.fit(self.fine, fine, 1 + effort.passes)
        return fine

    def place_at_start(self, numbers: Array, episodes: Integers) -> None:
        """Let tendons begin near the start tension, in hidden numbers (R, K), by places in the play.

        Where motors were set with their offsets, those account for the rest: a chain that is slack tells nothing.
        """
        law, at, m = self.fine.model.law, self.prior.layout, self._n_tendons
        if not (math.isfinite(law.start_sd) or math.isfinite(law.shown_sd)):
            return
        tables, stiffnesses = self.fine.model.tables, self.fine.model.stiffnesses
        ahead = self.history.motors[episodes, 0] - (tables.start_lengths - law.start_tension / stiffnesses)
        widths = 2.0 * numbers[:, at.half_widths : at.frictions]
        shares = np.divide(ahead, widths, out=np.zeros_like(ahead), where=widths > 0.0)
        numbers[:, at.places : at.places + m] = np.clip(shares, -0.5, 0.5)
        if math.isfinite(law.shown_sd):
            offsets, priors = slice(at.offsets, at.stiffnesses), self.fine.bounds
            rest = ahead - numbers[:, at.places : at.places + m] * widths
            numbers[:, offsets] = np.clip(-rest, *(bound[0, offsets] for bound in priors))

    def fit(self, followed: FollowedChain, track: Track, rounds: int) -> None:
        """Levenberg-Marquardt steps of all rows, in place."""
        damping = np.full(len(track.steps), _FIRST)
        for _ in range(rounds):
            proposals = followed.proposals(track, damping, self.effort.farthest)
            trial = followed.followed(self.history, track.episodes, track.links, track.priors, *proposals)
            better = trial.cost < track.cost
            damping = adapted_damping(damping, better)
            _put(track, np.flatnonzero(better), trial, np.flatnonzero(better))

    def _smoothed(self) -> Smoothed:
        track, at = self.track, self.prior.layout
        numbers, _ = self.fine.proposals(track, self._damping, self.effort.farthest)
        change = numbers - track.numbers
        widths, places = slice(at.half_widths, at.frictions), slice(at.places, at.gains)
        commands = slice(at.offsets, at.stiffnesses)
        return Smoothed(
            numbers,
            track.tip + np.einsum("nik,nk->ni", track.tip_by, change),
            track.tensions + np.einsum("nik,nk->ni", track.tensions_by, change),
            np.ascontiguousarray(track.tip_by[:, :, commands]),
            np.ascontiguousarray(track.tensions_by[:, :, commands]),
            track.played + track.by_width * change[:, widths] + track.by_place * change[:, places],
            np.ascontiguousarray(numbers[:, widths]),
            track.misfit / self._measurements(),
        )


class FollowedChain:
    """A chain with some priors and a law, along whose rows histories are followed; bounds: of the priors, (P, K)."""

    def __init__(
        self,
        chain: RollingChain,
        priors: Sequence[HiddenPrior],
        law: MeasurementLaw,
        tables: SurfaceTables,
        steps: int,
    ) -> None:
        self.chain, self.priors, self._steps = chain, priors, steps
        means, sds, low, high = (
            np.stack([getattr(prior, name) for prior in priors]) for name in ("means", "sds", "low", "high")
        )
        self.bounds = low, high
        self.model = Model(chain.arrays, tables, law, priors[0].layout, np.array(chain.stiffnesses), means, sds)
        self._solvers: dict[int, tuple[object, PinnedRange]] = {}

    def __getstate__(self) -> dict[str, object]:
        return vars(self) | {"_solvers": {}}  # bound to addresses in this process

    def begun(
        self, episodes: Integers, links: Integers, priors: Integers, numbers: Array, forces: Array | None = None
    ) -> Track:
        """Rows at the start of their histories."""
        angles = np.tile(self.chain.neutral_angles, (len(episodes), 1))
        times = self._steps if self.model.law.memory < 1.0 else 0
        forces = np.full((len(episodes), times, 2), np.nan) if forces is None else forces.copy()
        return empty_track(episodes, links, priors, numbers, angles, self.chain.n_tendons, forces)

    def followed(
        self,
        history: MotorHistory,
        episodes: Integers,
        links: Integers,
        priors: Integers,
        numbers: Array,
        forces: Array | None = None,
    ) -> Track:
        """Rows of hidden numbers (R, K) and forces (R, T, 2) along the histories of these episodes."""
        track = self.begun(episodes.copy(), links.copy(), priors.copy(), numbers, forces)
        self.follow(track, history)
        return track

    def follow(self, track: Track, history: MotorHistory) -> None:
        """Follow rows to the last step of their histories."""
        if not len(track.steps):
            return
        batch, solver = self._solver(len(track.steps))
        pending = False
        while kernels.advance(self.model, history, track, batch, solver.entry, solver.pins, pending):
            solver.solve_the_rest(0, len(track.steps))
            pending = True

    def proposals(self, track: Track, damping: Array, farthest: float) -> tuple[Array, Array]:
        """The minima of the normal equations, (R, K), within bounds, and the forces there, (R, T, 2)."""
        numbers, forces = np.empty_like(track.numbers), np.empty_like(track.forces)
        equations.propose(track, self.model.sds, damping, farthest, numbers, np.empty(len(numbers)))
        for number, prior in enumerate(self.priors):
            rows = track.priors == number
            numbers[rows] = prior.within(numbers[rows])
        if forces.shape[1] > 0:
            equations.recall(track, self.model.sds, farthest, numbers, forces)
        return numbers, forces

    def unlikely(self, track: Track) -> Array:
        """Minus the logarithm of the evidence of rows, (R,), but for a constant: cost, and how narrow its minimum is.

        Source: Laplace's approximation.
        """
        volumes, rows = np.empty(len(track.steps)), np.zeros(len(track.steps))
        equations.propose(track, self.model.sds, rows, 0.0, np.empty_like(track.numbers), volumes)
        unlikely: Array = track.cost + track.volume + volumes + _SURPRISE * track.priors
        return unlikely

    def _solver(self, rows: int) -> tuple[object, PinnedRange]:
        if rows not in self._solvers:
            if len(self._solvers) > 16:
                self._solvers.clear()
            kinds, m, n_joints = type(self.chain).kernels, self.chain.n_tendons, self.chain.n_joints
            laws = TendonLaw(*(np.zeros((rows, m)) for _ in range(4)))
            laws.high[:] = _LARGEST_TENSION
            loads = np.zeros((rows, 1, len(LOAD_COLUMNS)))
            results = kinds.new_results(rows, n_joints, m)
            designs = np.zeros(rows, np.int64)
            batch = kinds.batch_arrays(self.chain.arrays, designs, laws, loads, np.zeros((rows, n_joints)), results)
            self._solvers[rows] = batch, PinnedRange(kinds, batch)
        return self._solvers[rows]


def adapted_damping(damping: Array, better: Mask) -> Array:
    """Damping (R,) after trials."""
    return np.where(better, np.maximum(damping * _EASED, LEAST_DAMPING), np.minimum(damping * _DAMPED, MOST_DAMPING))


def _put(track: Track, rows: Integers, other: Track, places: Integers | None = None) -> None:
    """Replace rows of a track by the rows of another one at these places, by all of them if None."""
    for values, others in zip(track, other, strict=True):
        values[rows] = others if places is None else others[places]
