"""Identification of a rig from a recording: the most likely numbers under the beliefs, and how sure they are.

The most likely rig minimises a sum of squares: distances of predictions from readings and of numbers from their
beliefs, in standard deviations, by a trust-region method (scipy) with forward differences, all in one batch. Readings
beyond a few standard deviations count less, since play and friction switch. Standard deviations of readings are found
from the residuals of a first fit, and the covariance of the numbers follows from the linearised problem (Laplace's
approximation).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rollingjoint.chain.chain import AnyChain
from rollingjoint.checks import as_integer
from rollingjoint.errors import InvalidInput, SolverError
from rollingjoint.identify.beliefs import RIG_KINDS, Belief, RigSpace
from rollingjoint.identify.recording import MOST_STEPS, RigRecording
from rollingjoint.identify.twin import Limits, RigModel
from rollingjoint.load import Load
from rollingjoint.statics.solve import solve_lengths, solve_tensions_batch
from rollingjoint.transmission import unstretched_length

Array = NDArray[np.float64]

DEVIATIONS = {"tension": 0.2, "position": 0.4}  # of readings in the first fit, N and mm
SMALLEST_DEVIATIONS = {"tension": 0.01, "position": 0.005}
EVALUATIONS = 15  # at most, each with its derivatives
GRID = {"play": (0.75, 1.5, 3.0, 4.5, 6.0), "sheath": (0.1, 0.4, 0.8), "offsets": (0.0, -1.5, -3.0)}
"""Where the search may begin: play [mm] and sheath friction of all tendons, and what is added to their offsets [mm]."""
MOST_STARTS = 4
LOST = 10.0  # standard deviations: the residual where the model has no equilibrium
MOST_LOST = 0.5  # share of the readings; poor fits have larger residuals, so a search would end where all are lost
REACH, FINE_REACH = 0.05, 1e-5  # of differences in the search and at its end, in standard deviations of the beliefs
DRIVES = ("play", "sheath", "mu", "stiffness", "offsets")  # sought by default, and the surfaces where a tip was seen
_FAR = 3.0  # standard deviations: readings beyond count less
_POOR = 1.0  # standard deviations of the first fit that are left: another start is tried
_ENOUGH = 1e-6  # change of the cost at which the search ends, as a share of it
_NORMAL = 1.4826  # standard deviation over median of the size, of a normal distribution
_SURE = 1.96  # standard deviations: half a 95 % interval


@dataclass(frozen=True)
class IdentifiedRig:
    """Beliefs about a rig after a recording.

    Args:
        space: of rigs. values: of the most likely one, (P,). covariance: (P, P).
        deviations: standard deviations of readings by quantity, from the residuals [N, mm].
        residual: root mean square of the residuals, in standard deviations of the first fit. before: the same of the
            first beliefs. count: of readings.
        begin: position of the motors where the recording begins, (m,) [mm].
    """

    space: RigSpace
    values: Array
    covariance: Array
    deviations: Mapping[str, float]
    residual: float
    before: float
    count: int
    begin: Array

    @property
    def fields(self) -> dict[str, Array]:
        """The most likely numbers, by kind."""
        return self.space.fields(self.values)

    @property
    def sd(self) -> dict[str, Array]:
        """Their standard deviations, by kind."""
        return self.space.fields(np.sqrt(np.diag(self.covariance)))

    @property
    def intervals(self) -> Array:
        """95 % intervals within the bounds, (P, 2)."""
        margin = _SURE * np.sqrt(np.diag(self.covariance))
        ends = np.stack([self.values - margin, self.values + margin], axis=1)
        return np.clip(ends, self.space.low[:, None], self.space.high[:, None])

    @property
    def mechanism(self) -> AnyChain:
        """The mechanism with the most likely numbers."""
        return self.space.chain(self.values)

    @property
    def offsets(self) -> Array:
        """Unstretched length minus position of every motor, (m,) [mm]: added to positions, these are true lengths."""
        return self.space.value(self.values, "offsets")

    @property
    def pretension(self) -> Array:
        """Tensions behind the sheath where the recording begins, in the middle of the play, (m,) [N]."""
        return np.asarray(solve_lengths(self.mechanism, self.begin + self.offsets).tensions)

    def drawn(self, rng: np.random.Generator, count: int) -> Array:
        """Rigs as this one may be, (count, P): samples of the posterior within the bounds."""
        samples = rng.multivariate_normal(self.values, self.covariance, count, method="cholesky")
        return np.clip(samples, self.space.low, self.space.high)


def identify_rig(
    recording: RigRecording,
    mechanism: AnyChain | None = None,
    kinds: Sequence[str] | None = None,
    *,
    beliefs: Mapping[str, Belief] | None = None,
    loads: Sequence[Load] = (),
    limits: Limits = (0.0, np.inf),
    first: int | None = None,
    evaluations: int = EVALUATIONS,
    say: Callable[[], object] = lambda: None,
) -> IdentifiedRig:
    """Beliefs about a rig after a recording of it.

    Args:
        recording: of any length; it is thinned. mechanism: as designed; None: the recording's.
        kinds: names from RIG_KINDS; None: play, sheath, mu, stiffness, offsets and, where a tip was seen, surfaces.
        beliefs: in place of those of RIG_KINDS. Those of offsets are about 0 or about
            the offsets that the first tensions mean, whichever fits better.
        loads, limits, first: as of RigModel.
        evaluations: of the model with its derivatives, at most. say: called at each.
    Raises:
        InvalidInput: no mechanism, unknown kinds, a recording without tensions and tips.
        SolverError: no equilibrium anywhere.
    """
    chain = mechanism_of(recording, mechanism)
    as_integer("evaluations", evaluations, 1)
    if kinds is None:
        surfaces = ["surfaces"] if recording.sees_tip and isinstance(chain, RIG_KINDS["surfaces"].mechanisms) else []
        kinds = [*DRIVES, *surfaces]
    own, kept = dict(beliefs or {}), recording.thinned(MOST_STEPS)
    smooth_kinds = [name for name in kinds if name != "mu"]
    if "offsets" in kinds and "offsets" not in own:
        wide = RIG_KINDS["offsets"].belief
        centres = [replace(wide, mean=mean) for mean in (0.0, first_offsets(recording, chain, loads))]
        spaces = [RigSpace(chain, smooth_kinds, own | {"offsets": belief}) for belief in centres]
        costs = [Misfit(RigModel(kept, each, loads, limits, first)).least_cost() for each in spaces]
        own["offsets"] = centres[int(np.argmin(costs))]
    space = RigSpace(chain, kinds, own)
    misfit = Misfit(RigModel(kept, space, loads, limits, first))
    before = misfit.rms(np.zeros(len(space)))
    start = None
    if "mu" in kinds and limits == (0.0, np.inf):  # where the search begins follows from a model without that friction
        smooth = RigSpace(chain, smooth_kinds, own)
        fields = smooth.fields(Misfit(RigModel(kept, smooth, loads, limits, first)).best_fit(evaluations, say))
        start = space.vector(fields | {"mu": 0.0})
    start = misfit.best_fit(evaluations, say) if start is None else misfit.fitted(start, evaluations, say)
    residual = misfit.rms(start)
    if not misfit.solvable(start):
        raise SolverError("no equilibrium of the model along the recorded motor positions: check units and signs")
    misfit.learn_deviations(start)
    start = misfit.fitted(start, max(evaluations // 2, 1), say, FINE_REACH)
    misfit.learn_deviations(start)
    covariance = misfit.covariance(start) * np.outer(space.sd, space.sd)
    begin = np.asarray(recording.runs[0].motors[0])
    values = space.mean + start * space.sd
    return IdentifiedRig(space, values, covariance, misfit.deviations, residual, before, misfit.size, begin)


def mechanism_of(recording: RigRecording, mechanism: AnyChain | None = None) -> AnyChain:
    """This mechanism, as designed, or the recording's; InvalidInput where there is none, or with other tendons."""
    chain = mechanism or recording.mechanism
    if chain is None:
        hint = "Name it in the first line of the recording, or by --mechanism."
        raise InvalidInput("mechanism", None, "the mechanism as designed", hint)
    if chain.n_tendons != recording.n_tendons:
        raise InvalidInput("tendons of the recording", recording.n_tendons, f"{chain.n_tendons}, as of the mechanism")
    return chain


def designed_space(mechanism: AnyChain) -> tuple[RigSpace, Array]:
    """Rigs with offsets alone, and the one as designed."""
    space = RigSpace(mechanism, ["offsets"])
    return space, np.zeros(len(space))


def first_offsets(recording: RigRecording, chain: AnyChain, loads: Sequence[Load] = ()) -> Array:
    """Offsets that the first tensions would mean without sheaths, (m,) [mm]; 0 without tensions."""
    run = recording.runs[0]
    rows = np.flatnonzero(np.isfinite(run.tensions).all(axis=1) & (run.tensions > 0.0).all(axis=1))[:1]
    if not rows.size:
        return np.zeros(chain.n_tendons)
    solved = solve_tensions_batch(chain, run.tensions[rows], loads)
    free = unstretched_length(np.asarray(solved.lengths), run.tensions[rows], chain.stiffnesses)
    return np.asarray(free - run.motors[rows])[0]


class Misfit:
    """Residuals of rigs against a recording, then their distances from the beliefs, all in standard deviations.

    Rigs are vectors of the space minus its means, over its standard deviations.

    Raises:
        InvalidInput: no readings that count.
    """

    def __init__(self, model: RigModel) -> None:
        self.model, self.space = model, model.space
        self.deviations = dict(DEVIATIONS)
        self.read = {
            "tension": np.isfinite(model.tensions) & model.counts[..., None],
            "position": np.isfinite(model.tips) & model.counts[..., None],
        }
        self.size = sum(int(mask.sum()) for mask in self.read.values())
        if not self.size:
            hint = "Move more, beyond the play, or record one of them."
            raise InvalidInput("recording", 0, "readings of tensions or tips after the play was crossed", hint)
        seen = bool(self.read["position"].any())
        self.heard = [name for name in self.space.kinds if seen or name != "surfaces"]  # tensions hardly know surfaces

    def errors(self, scaled: Array) -> dict[str, Array]:
        """Predicted minus measured by quantity, (K, readings) [N, mm]; NaN where there is no equilibrium."""
        vectors = np.clip(self.space.mean + scaled * self.space.sd, self.space.low, self.space.high)
        model, predicted = self.model, self.model.predict(vectors)
        pairs = {
            "tension": (predicted.tensions, model.tensions),
            "position": (predicted.tips, model.tips),
        }
        ok = predicted.ok[..., None]
        return {
            name: np.where(ok, values - measured, np.nan)[:, self.read[name]]
            for name, (values, measured) in pairs.items()
        }

    def of_all(self, scaled: Array, deviations: Mapping[str, float] | None = None) -> Array:
        """Residuals of K rigs, (K, N)."""
        sizes = deviations or self.deviations
        errors = [values / sizes[name] for name, values in self.errors(scaled).items()]
        return np.concatenate([np.nan_to_num(np.concatenate(errors, axis=1), nan=LOST), scaled], axis=1)

    def __call__(self, scaled: Array) -> Array:
        """Residuals of one rig, (N,); infinite, where no search goes, for one without equilibria at many readings."""
        residuals = self.of_all(scaled[None])
        return np.full(residuals.shape[1], np.inf) if self._is_lost(residuals)[0] else residuals[0]

    def _is_lost(self, residuals: Array) -> NDArray[np.bool_]:
        """Whether rigs with these residuals, (K, N), have no equilibrium at more readings than MOST_LOST."""
        return np.asarray((residuals[:, : self.size] == LOST).mean(axis=1) > MOST_LOST)

    def rms(self, scaled: Array, deviations: Mapping[str, float] | None = None) -> float:
        """Root mean square of the residuals of readings."""
        return float(np.sqrt(np.mean(self.of_all(scaled[None], deviations)[0, : self.size] ** 2)))

    def best_fit(self, evaluations: int, say: Callable[[], object]) -> Array:
        """The most likely rig: from the best point of the grid, and from the next ones while much is left."""
        fits: list[Array] = []
        for start in self.starts()[:MOST_STARTS]:
            fits.append(self.fitted(self.with_own_drives(start), evaluations, say))
            if self.rms(fits[-1]) < _POOR:
                return fits[-1]
        return min(fits, key=self.rms)

    def starts(self) -> list[Array]:
        """Points of a grid over play, sheath friction and tautness, the best first: there are several minima."""
        points = self._grid()
        return [points[place] for place in np.argsort(self._costs(points), kind="stable")]

    def with_own_drives(self, start: Array) -> Array:
        """A start in which every tendon in turn has the play and sheath friction of the grid that fit best."""
        names, space = [name for name in ("play", "sheath") if name in self.space.kinds], self.space
        for tendon in range(space.mechanism.n_tendons if names else 0):
            points = [start]
            for values in product(*(GRID[name] for name in names)):
                vector = space.mean + start * space.sd
                for name, value in zip(names, values, strict=True):
                    vector[space.place(name).start + tendon] = value
                points.append((np.clip(vector, space.low, space.high) - space.mean) / space.sd)
            start = points[int(np.argmin(self._costs(points)))]
        return start

    def least_cost(self) -> float:
        """Cost of the best point of the grid."""
        return float(self._costs(self._grid()).min())

    def _grid(self) -> list[Array]:
        names, space, points = [name for name in GRID if name in self.space.kinds], self.space, []
        for values in product(*(GRID[name] for name in names)):
            vector = space.mean.copy()
            for name, value in zip(names, values, strict=True):
                place = space.place(name)
                vector[place] = value + (vector[place] if name == "offsets" else 0.0)
            points.append((np.clip(vector, space.low, space.high) - space.mean) / space.sd)
        return points

    def _costs(self, points: list[Array]) -> Array:
        residuals = self.of_all(np.array(points))
        return np.where(self._is_lost(residuals), np.inf, np.sqrt(1.0 + (residuals / _FAR) ** 2).sum(axis=1))

    def solvable(self, scaled: Array) -> bool:
        """Whether there is an equilibrium at any reading that counts."""
        return any(bool(np.isfinite(values).any()) for values in self.errors(scaled[None]).values())

    def covariance(self, scaled: Array) -> Array:
        """Of the numbers, scaled, (P, P): of the linearised problem.

        Its differences are much smaller than in the search: readings have kinks where motors turn or give way, and
        where surfaces and offsets explain the same, one kink within the reach of a difference counts as information.
        """
        jacobian = self.derivatives(scaled, FINE_REACH)
        return np.asarray(np.linalg.inv(jacobian.T @ jacobian))

    def derivatives(self, scaled: Array, reach: float = REACH) -> Array:
        """By differences to one side, (N, P)."""
        units = np.eye(len(self.space))
        places = np.concatenate([np.arange(len(units))[self.space.place(name)] for name in self.heard])
        ends = self.space.mean + (scaled + reach) * self.space.sd
        shifts = np.where((ends > self.space.high) | (ends < self.space.low), -reach, reach)[places]
        rows = self.of_all(np.concatenate([scaled[None], scaled + shifts[:, None] * units[places]]))
        jacobian = np.vstack([np.zeros((self.size, len(units))), units])
        jacobian[:, places] = ((rows[1:] - rows[0]) / shifts[:, None]).T
        return jacobian

    def fitted(self, start: Array, evaluations: int, say: Callable[[], object], reach: float = REACH) -> Array:
        """The most likely rig near a start; reach: of differences. A start that is lost stays what it is."""
        from scipy.optimize import least_squares

        def derivatives(scaled: Array) -> Array:
            say()
            return self.derivatives(scaled, reach)

        space = self.space
        low, high = ((end - space.mean) / space.sd for end in (space.low, space.high))
        margin = 1e-6 * (high - low)
        inside = np.clip(start, low + margin, high - margin)
        if not np.isfinite(self(inside)).all():
            return inside
        solution = least_squares(
            self,
            inside,
            derivatives,
            (low, high),
            ftol=_ENOUGH,
            loss="soft_l1",
            f_scale=_FAR,
            max_nfev=evaluations,
        )
        return np.asarray(solution.x)

    def learn_deviations(self, scaled: Array) -> None:
        """Take standard deviations of readings from the residuals."""
        for name, values in self.errors(scaled[None]).items():
            sizes = np.abs(values[np.isfinite(values)])
            if sizes.size:
                self.deviations[name] = max(_NORMAL * float(np.median(sizes)), SMALLEST_DEVIATIONS[name])


def as_report(found: IdentifiedRig) -> dict[str, Any]:
    """Values with 95 % intervals by name, pretension, deviations and residuals, as plain values."""
    rows = zip(found.space.labels, found.values, np.sqrt(np.diag(found.covariance)), found.intervals, strict=True)
    return {
        "parameters": {
            label: {"value": _short(value), "sd": _short(sd), "interval": [_short(end) for end in ends]}
            for label, value, sd, ends in rows
        },
        "pretension": [_short(value) for value in found.pretension],
        "deviations": {name: _short(value) for name, value in found.deviations.items()},
        "residual": {"before": _short(found.before), "after": _short(found.residual), "readings": found.count},
    }


def _short(value: float | np.floating[Any]) -> float:
    return float(f"{value:.6g}")
