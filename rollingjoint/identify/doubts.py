"""What the data cannot tell: warnings beside an identification."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np

from rollingjoint.identify.errors import distances
from rollingjoint.identify.findings import Estimates, Findings
from rollingjoint.identify.measurements import Run

_CORRELATED = 0.95
_TOO_LARGE = 4.0  # mean squared residual of deviations that are true ones


def doubts(found: Findings) -> Iterator[str]:
    """Warnings, one line each."""
    yield from _unknown(found.together)
    yield from _confused(found.together)
    yield from _open_ends(found.together)
    yield from _few_steps(found.together)
    yield from _differing(found)
    yield from _repeated(found)
    yield from _not_better(found)
    if found.measurements.absolute and found.together.fit.misfit > _TOO_LARGE:
        times = np.sqrt(found.together.fit.misfit)
        yield f"residuals are {times:.1f} times the deviations given: the model errs, and the intervals are too narrow"
    if not found.alone:
        yield "one run: no cross-validation, and no telling whether another run would give the same values"


def _unknown(estimates: Estimates) -> Iterator[str]:
    for each, silent in zip(estimates.coefficients, estimates.fit.silent, strict=True):
        if silent:
            yield f"the readings say nothing about {each.label}; it keeps its nominal value"


def _confused(estimates: Estimates) -> Iterator[str]:
    labels = [each.label for each in estimates.coefficients]
    for group in estimates.fit.tangled:
        yield f"the readings cannot tell {' and '.join(labels[place] for place in group)} apart"
    correlations = estimates.fit.correlations
    for i, j in itertools.combinations(range(len(labels)), 2):
        if abs(correlations[i, j]) > _CORRELATED:
            yield (
                f"the readings hardly tell {labels[i]} and {labels[j]} apart: their errors have the correlation"
                f" {correlations[i, j]:+.3f}"
            )


def _open_ends(estimates: Estimates) -> Iterator[str]:
    for each, profile, determined in zip(
        estimates.coefficients, estimates.profiles, estimates.fit.determined, strict=True
    ):
        if determined and not all(profile.bounded):
            sides = [side for side, bounded in zip(("lower", "upper"), profile.bounded, strict=True) if not bounded]
            low, high = each.bounds
            yield f"the readings set no {' or '.join(sides)} end for {each.label} in its range, {low:g} to {high:g}"


def _few_steps(estimates: Estimates) -> Iterator[str]:
    steps, numbers = estimates.fit.n_steps, int(estimates.fit.determined.sum())
    if steps <= numbers + 1:
        yield f"{numbers} unknown numbers from {steps} steps: the intervals mean little"


def _differing(found: Findings) -> Iterator[str]:
    """Coefficients whose estimates from single runs differ by more than their intervals explain."""
    from scipy.stats import t

    pairs = list(itertools.combinations(found.alone, 2))
    for first, second in pairs:
        a, b = found.alone[first], found.alone[second]
        for i, j in itertools.product(range(len(a.values)), range(len(b.values))):
            one, other = a.coefficients[i], b.coefficients[j]
            if (one.name, one.tendon) != (other.name, other.tendon):
                continue
            variance = _variance(a, i) + _variance(b, j)
            freedom = max(a.fit.n_steps + b.fit.n_steps - 2, 1)
            chance = 2 * t.sf(abs(a.values[i] - b.values[j]) / np.sqrt(variance), freedom) * len(pairs)
            if np.isfinite(variance) and chance < 1 - found.confidence:
                lower, upper = sorted((a.profiles[i].interval, b.profiles[j].interval))
                apart = "do not overlap" if lower[1] < upper[0] else "overlap"
                name = one.name if one.tendon is None else f"{one.name}[{one.tendon}]"
                yield (
                    f"{name} differs between the runs {first} and {second}, {a.values[i]:.3g} and {b.values[j]:.3g}"
                    f" (p = {chance:.2g}; their intervals {apart}): one value is right for neither"
                )


def _variance(estimates: Estimates, place: int) -> float:
    """Variance of an estimate, infinite where it is not determined."""
    fit = estimates.fit
    inflation = 1.0 if fit.model.measurements.absolute else fit.inflations[place]
    return float(np.nan_to_num(fit.variances[place] * inflation, nan=np.inf))


def _repeated(found: Findings) -> Iterator[str]:
    """What the same inputs gave in different runs: no model that knows only them can be nearer to all."""
    measurements = found.measurements
    for first, second in itertools.combinations(measurements.runs, 2):
        count = _common(first, second, measurements.given)
        if not count or "position" not in found.quantities:
            continue
        rows = [found.rows(run.name)[:count] for run in (first, second)]
        readings = measurements.readings(measurements.runs)
        apart = distances(measurements, "position", readings[rows[0]] - readings[rows[1]])
        last = [row[np.isfinite(row)][-1] for row in apart if np.isfinite(row).any()]
        if last:
            yield (
                f"the same inputs in {first.name} and {second.name} ({count} steps) gave last links"
                f" {np.mean(last):.2f} mm apart: no model without hidden differences has a mean error of the last"
                f" link below {np.mean(last) / 2:.2f} mm over both"
            )


def _common(first: Run, second: Run, given: str) -> int:
    """How many steps from the start two runs have in common."""
    same = 0
    for one, other in zip(first.steps, second.steps, strict=False):
        if (*one.approach, one.input(given), *one.forces) != (*other.approach, other.input(given), *other.forces):
            break
        same += 1
    return same


def _not_better(found: Findings) -> Iterator[str]:
    """Runs that the values of the others predict worse than the nominal ones."""
    weights = found.together.fit.model.weights
    for run in found.held_out:
        rows = found.rows(run)
        misfits = [
            float(np.nansum((found.deviations[which][rows] * weights[rows]) ** 2)) for which in ("nominal", "held out")
        ]
        if misfits[1] > misfits[0]:
            yield f"the values of the other runs predict {run} worse than the nominal ones: they do not carry over"
