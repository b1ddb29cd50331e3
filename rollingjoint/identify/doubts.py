"""Limits of the data, as warnings of an identification."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np

from rollingjoint.identify.errors import distances
from rollingjoint.identify.findings import Estimates, Findings
from rollingjoint.identify.measurements import Run, Step

_CORRELATED = 0.95
_TOO_LARGE = 4.0  # mean squared residual, with true standard deviations


def doubts(findings: Findings) -> Iterator[str]:
    """Warnings, one line each."""
    yield from _unknown(findings.together)
    yield from _confused(findings.together)
    yield from _open_ends(findings.together)
    yield from _few_steps(findings.together)
    yield from _differing(findings)
    yield from _repeated(findings)
    yield from _not_better(findings)
    if findings.measurements.absolute and findings.together.fit.misfit > _TOO_LARGE:
        times = np.sqrt(findings.together.fit.misfit)
        yield f"residuals are {times:.1f} times the deviations given: the model errs, and the intervals are too narrow"
    if not findings.alone:
        yield "one run: no cross-validation, and no telling whether another run would give the same values"


def _unknown(estimates: Estimates) -> Iterator[str]:
    for coefficient, silent in zip(estimates.coefficients, estimates.fit.silent, strict=True):
        if silent:
            yield f"the readings say nothing about {coefficient.label}; it keeps its nominal value"


def _confused(estimates: Estimates) -> Iterator[str]:
    labels = [coefficient.label for coefficient in estimates.coefficients]
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
    for coefficient, profile, determined in zip(
        estimates.coefficients, estimates.profiles, estimates.fit.determined, strict=True
    ):
        if determined and not all(profile.bounded):
            sides = [side for side, bounded in zip(("lower", "upper"), profile.bounded, strict=True) if not bounded]
            low, high = coefficient.bounds
            label, ends = coefficient.label, " or ".join(sides)
            yield f"the readings set no {ends} end for {label} in its range, {low:g} to {high:g}"


def _few_steps(estimates: Estimates) -> Iterator[str]:
    steps, numbers = estimates.fit.n_steps, int(estimates.fit.determined.sum())
    if steps <= numbers + 1:
        yield f"{numbers} unknown numbers from {steps} steps: the intervals mean little"


def _differing(findings: Findings) -> Iterator[str]:
    """Coefficients with estimates from single runs that differ by more than their intervals explain."""
    from scipy.stats import t

    pairs = list(itertools.combinations(findings.alone, 2))
    for first, second in pairs:
        a, b = findings.alone[first], findings.alone[second]
        for i, j in itertools.product(range(len(a.values)), range(len(b.values))):
            coefficient, counterpart = a.coefficients[i], b.coefficients[j]
            if (coefficient.name, coefficient.tendon) != (counterpart.name, counterpart.tendon):
                continue
            variance = _variance(a, i) + _variance(b, j)
            freedom = max(a.fit.n_steps + b.fit.n_steps - 2, 1)
            chance = 2 * t.sf(abs(a.values[i] - b.values[j]) / np.sqrt(variance), freedom) * len(pairs)
            if np.isfinite(variance) and chance < 1 - findings.confidence:
                lower, upper = sorted((a.profiles[i].interval, b.profiles[j].interval))
                apart = "do not overlap" if lower[1] < upper[0] else "overlap"
                name = coefficient.name if coefficient.tendon is None else f"{coefficient.name}[{coefficient.tendon}]"
                yield (
                    f"{name} differs between the runs {first} and {second}, {a.values[i]:.3g} and {b.values[j]:.3g}"
                    f" (p = {chance:.2g}; their intervals {apart}): one value is right for neither"
                )


def _variance(estimates: Estimates, place: int) -> float:
    """Variance of an estimate, infinite where it is not determined."""
    fit = estimates.fit
    inflation = 1.0 if fit.model.measurements.absolute else fit.inflations[place]
    return float(np.nan_to_num(fit.variances[place] * inflation, nan=np.inf))


def _repeated(findings: Findings) -> Iterator[str]:
    """Scatter of repeated inputs between runs: a lower bound on the error of every model that sees only the inputs."""
    measurements = findings.measurements
    for first, second in itertools.combinations(measurements.runs, 2):
        count = _common(first, second, measurements.given)
        if not count or "position" not in findings.quantities:
            continue
        rows = [findings.rows(run.name)[:count] for run in (first, second)]
        readings = measurements.readings(measurements.runs)
        apart = distances(measurements, "position", readings[rows[0]] - readings[rows[1]])
        last = [row[np.isfinite(row)][-1] for row in apart if np.isfinite(row).any()]
        if last:
            yield (
                f"the same inputs in {first.name} and {second.name} ({count} steps) gave last links"
                f" {np.mean(last):.2f} mm apart: no model without hidden differences has a mean error of the last"
                f" link below {np.mean(last) / 2:.2f} mm over both"
            )


def _common(first: Run, second: Run, input_kind: str) -> int:
    """Number of steps that two runs share from the start."""
    count = 0
    for step, counterpart in zip(first.steps, second.steps, strict=False):
        if _inputs(step, input_kind) != _inputs(counterpart, input_kind):
            break
        count += 1
    return count


def _inputs(step: Step, input_kind: str) -> tuple[object, ...]:
    """All inputs and forces of a step."""
    return (*step.approach, step.input(input_kind), *step.forces)


def _not_better(findings: Findings) -> Iterator[str]:
    """Runs that the values of the other runs predict worse than the nominal values."""
    weights = findings.together.fit.model.weights
    for run in findings.held_out:
        rows = findings.rows(run)
        misfits = [
            float(np.nansum((findings.deviations[which][rows] * weights[rows]) ** 2))
            for which in ("nominal", "held out")
        ]
        if misfits[1] > misfits[0]:
            yield f"the values of the other runs predict {run} worse than the nominal ones: they do not carry over"
