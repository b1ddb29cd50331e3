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
_LEAST, _FIRST, _MOST = 1e-6, 1e-2, 1e6  # damping: the smallest, that of new starts, the largest


@dataclass(frozen=True)
class Effort:
    """How hard a smoother searches.

    Args:
        every: steps after which the history is followed anew, along the present estimate.
        moved: change of a hidden number, in standard deviations of its prior, after which it is at once.
        passes: how often in one step at most.
        searches: numbers of measured steps after which the fit starts anew from many places.
        starts: of the play of every tendon, such a search tries this many.
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
    ) -> None:
        if chain.springs or chain.has_friction:
            raise InvalidInput("mechanism", chain, "a chain without springs and friction", "The smoother knows none.")
        self.prior, self.effort, self._links = prior, effort or Effort(), list(links)
        self._count = -1  # no episodes yet
        self._pictured = chain.n_joints if pictured else 0
        self._before = 1 if math.isfinite(law.shown_sd) else 0  # steps of a history before those that are measured
        self._steps, self._n_tendons = self._before + steps, chain.n_tendons
        tables = surface_tables(chain, prior.layout, law.start_tension)
        self._fine = _Followed(chain, prior, law, tables, self._steps)
        coarse = law._replace(tension_sd=max(law.tension_sd, self.effort.coarse_sd))
        self._coarse = _Followed(chain, prior.without_surfaces(), coarse, tables, self._steps)
        self.reset(np.ones(0, bool))

    def reset(self, mask: Mask) -> None:
        """Begin the episodes of the mask, (N,), without measurements; all where N has changed."""
        count, m = len(mask), self._n_tendons
        if count != self._count:
            self._count, mask = count, np.ones(count, bool)
            pictures = np.full((count, self._steps, self._pictured, 3), np.nan)
            motors, shifts, tensions = (np.zeros((count, self._steps, m)) for _ in range(3))
            self.history = MotorHistory(np.zeros(count, np.int64), motors, shifts, tensions, pictures)
            self._track = self._begun(np.arange(count), np.full(count, self._links[-1]))
            self._damping = np.full(count, _LEAST)
            self._since = np.zeros(count, np.int64)
        rows = np.flatnonzero(mask)
        if rows.size:
            self.history.pictures[rows] = np.nan
            self.history.counts[rows], self._damping[rows], self._since[rows] = 0, _LEAST, 0
            _put(self._track, rows, self._begun(rows, np.full(len(rows), self._links[-1])))

    @property
    def links(self) -> Integers:
        """The links that are taken to be loaded, (N,)."""
        return self._track.links

    @property
    def measured_steps(self) -> Integers:
        """How many steps of the episodes have been measured, (N,)."""
        return np.maximum(self.history.counts - self._before, 0)

    @property
    def trusted_from(self) -> int:
        """Measured steps from which on a misfit tells that the fit has failed."""
        return min(self.effort.searches, default=0)

    def _begun(self, episodes: Integers, links: Integers) -> Track:
        return self._fine.begun(episodes, links, np.tile(self.prior.means, (len(episodes), 1)))

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
        history = self.history
        if self._before:
            rows = np.flatnonzero(history.counts == 0)
            history.motors[rows, 0], history.tensions[rows, 0] = motors[rows], self._fine.model.law.start_tension
            history.counts[rows] = 1
        rows = np.flatnonzero(history.counts < self._steps)
        for values, measured in zip(history[1:4], (motors, shifts, tensions), strict=True):
            values[rows, history.counts[rows]] = measured[rows]
        history.counts[rows] += 1
        self._since[rows] += 1
        late = np.zeros(self._count, bool)
        if pictures is not None and ages is not None:
            places = history.counts - 1 - ages
            late = np.isfinite(pictures[:, 0, 0]) & (places >= self._before)
            late[np.setdiff1d(np.arange(self._count), rows)] = False
            history.pictures[np.flatnonzero(late), places[late]] = pictures[late]
            late &= ages > 0
        self._fine.follow(self._track, history)
        searched = np.zeros(self._count, bool)
        searched[rows] = np.isin(self.measured_steps[rows], list(self.effort.searches))
        if searched.any():
            self._search(np.flatnonzero(searched))
        self._renew(searched, late)
        return self._smoothed()

    def _renew(self, searched: Mask, late: Mask) -> None:
        """Follow histories anew, where that is due, along estimates that lower their costs.

        late: where a picture of an earlier step has come, whose costs are not known before that.
        """
        effort, track = self.effort, self._track
        for number in range(effort.passes):
            proposals, forces = self._fine.proposals(track, self._damping, effort.farthest)
            change = np.abs(proposals - track.numbers) / np.maximum(self.prior.sds, 1e-12)
            due = (change.max(axis=1) > effort.moved) & (self._damping < _MOST)
            if number == 0:
                due |= (self._since >= effort.every) | searched | late
            rows = np.flatnonzero(due)
            if not rows.size:
                break
            which = track.episodes[rows], track.links[rows], proposals[rows], forces[rows]
            trial = self._fine.followed(self.history, *which)
            better = (trial.cost < track.cost[rows]) | (late[rows] & (number == 0))
            self._damping[rows] = _adapted(self._damping[rows], better)
            self._since[rows] = 0
            _put(track, rows[better], trial, np.flatnonzero(better))

    def _search(self, rows: Integers) -> None:
        """Fit the histories of some episodes from many starts; keep fits with lower costs."""
        effort, m = self.effort, self._n_tendons
        shares = (np.arange(effort.starts) + 0.5) / effort.starts
        grid = np.stack(np.meshgrid(*[shares] * m, indexing="ij"), axis=-1).reshape(-1, m)
        grid, links = np.tile(grid, (len(self._links), 1)), np.repeat(self._links, len(grid))
        prior, starts = self._coarse.prior, len(grid)
        numbers = np.tile(prior.means, (len(rows) * starts, 1))
        widths = slice(prior.layout.half_widths, prior.layout.frictions)
        numbers[:, widths] = np.tile(prior.low[widths] + grid * (prior.high - prior.low)[widths], (len(rows), 1))
        self._place_at_start(numbers, np.repeat(rows, starts))
        which = np.repeat(rows, starts), np.tile(links, len(rows)), numbers
        coarse = self._coarse.followed(self.history, *which, self._track.forces[which[0]])
        self._fit(self._coarse, coarse, effort.rounds)
        costs = self._coarse.unlikely(coarse).reshape(len(rows) * len(self._links), -1)
        order = costs.argsort(axis=1)[:, : effort.kept]
        best = (np.arange(len(costs))[:, None] * costs.shape[1] + order).ravel()
        numbers = np.tile(self.prior.means, (len(best), 1))
        numbers[:, : prior.layout.total] = coarse.numbers[best]
        starts_again = coarse.episodes[best], coarse.links[best], numbers, coarse.forces[best]
        fine = self._fine.followed(self.history, *starts_again)
        self._fit(self._fine, fine, 1 + effort.passes)
        costs = self._fine.unlikely(fine).reshape(len(rows), -1)
        winners = np.arange(len(rows)) * costs.shape[1] + costs.argmin(axis=1)
        better = costs.min(axis=1) < self._fine.unlikely(self._track)[rows]
        _put(self._track, rows[better], fine, winners[better])
        self._damping[rows[better]] = _LEAST

    def _place_at_start(self, numbers: Array, episodes: Integers) -> None:
        """Let motors begin where the start tension has them but for offsets and sheaths, in hidden numbers (R, K)."""
        law, at, m = self._fine.model.law, self._coarse.prior.layout, self._n_tendons
        if not (math.isfinite(law.start_sd) or math.isfinite(law.shown_sd)):
            return
        tables, stiffnesses = self._fine.model.tables, self._fine.model.stiffnesses
        ahead = self.history.motors[episodes, 0] - (tables.start_lengths - law.start_tension / stiffnesses)
        widths = 2.0 * numbers[:, at.half_widths : at.frictions]
        shares = np.divide(ahead, widths, out=np.zeros_like(ahead), where=widths > 0.0)
        numbers[:, at.places : at.places + m] = np.clip(shares, -0.5, 0.5)

    def _fit(self, followed: _Followed, track: Track, rounds: int) -> None:
        """Levenberg-Marquardt steps of all rows, in place."""
        damping = np.full(len(track.steps), _FIRST)
        for _ in range(rounds):
            proposals = followed.proposals(track, damping, self.effort.farthest)
            trial = followed.followed(self.history, track.episodes, track.links, *proposals)
            better = trial.cost < track.cost
            damping = _adapted(damping, better)
            _put(track, np.flatnonzero(better), trial, np.flatnonzero(better))

    def _smoothed(self) -> Smoothed:
        track, at = self._track, self.prior.layout
        numbers, _ = self._fine.proposals(track, self._damping, self.effort.farthest)
        change = numbers - track.numbers
        widths, places = slice(at.half_widths, at.frictions), slice(at.places, at.gains)
        commands = slice(at.offsets, at.stiffnesses)
        shown = np.isfinite(self.history.pictures).sum(axis=(1, 2, 3))
        count = np.maximum(self.history.counts * self._n_tendons + shown, 1)
        return Smoothed(
            numbers,
            track.tip + np.einsum("nik,nk->ni", track.tip_by, change),
            track.tensions + np.einsum("nik,nk->ni", track.tensions_by, change),
            np.ascontiguousarray(track.tip_by[:, :, commands]),
            np.ascontiguousarray(track.tensions_by[:, :, commands]),
            track.played + track.by_width * change[:, widths] + track.by_place * change[:, places],
            np.ascontiguousarray(numbers[:, widths]),
            track.misfit / count,
        )


class _Followed:
    """A chain with a prior and a law, along whose rows histories are followed."""

    def __init__(
        self, chain: RollingChain, prior: HiddenPrior, law: MeasurementLaw, tables: SurfaceTables, steps: int
    ) -> None:
        self.chain, self.prior, self._steps = chain, prior, steps
        self.model = Model(chain.arrays, tables, law, prior.layout, np.array(chain.stiffnesses), prior.means, prior.sds)
        self._solvers: dict[int, tuple[object, PinnedRange]] = {}

    def __getstate__(self) -> dict[str, object]:
        return vars(self) | {"_solvers": {}}  # bound to addresses in this process

    def begun(self, episodes: Integers, links: Integers, numbers: Array, forces: Array | None = None) -> Track:
        """Rows at the start of their histories."""
        angles = np.tile(self.chain.neutral_angles, (len(episodes), 1))
        times = self._steps if self.model.law.memory < 1.0 else 0
        forces = np.full((len(episodes), times, 2), np.nan) if forces is None else forces.copy()
        return empty_track(episodes, links, numbers, angles, self.chain.n_tendons, forces)

    def followed(
        self, history: MotorHistory, episodes: Integers, links: Integers, numbers: Array, forces: Array | None = None
    ) -> Track:
        """Rows of hidden numbers (R, K) and forces (R, T, 2) along the histories of these episodes."""
        track = self.begun(episodes.copy(), links.copy(), numbers, forces)
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
        equations.propose(track, self.prior.sds, damping, farthest, numbers, np.empty(len(numbers)))
        numbers = self.prior.within(numbers)
        if forces.shape[1] > 0:
            equations.recall(track, self.prior.sds, farthest, numbers, forces)
        return numbers, forces

    def unlikely(self, track: Track) -> Array:
        """Minus the logarithm of the evidence of rows, (R,), but for a constant: cost, and how narrow its minimum is.

        Source: Laplace's approximation.
        """
        volumes, rows = np.empty(len(track.steps)), np.zeros(len(track.steps))
        equations.propose(track, self.prior.sds, rows, 0.0, np.empty_like(track.numbers), volumes)
        unlikely: Array = track.cost + track.volume + volumes
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


def _adapted(damping: Array, better: Mask) -> Array:
    """Damping (R,) after trials."""
    return np.where(better, np.maximum(damping * _EASED, _LEAST), np.minimum(damping * _DAMPED, _MOST))


def _put(track: Track, rows: Integers, other: Track, places: Integers | None = None) -> None:
    """Replace rows of a track by those of another one at these places, by all of them if None."""
    for values, others in zip(track, other, strict=True):
        values[rows] = others if places is None else others[places]
