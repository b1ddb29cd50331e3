"""Identification of parameters from measurements, with intervals and predictions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rollingjoint.checks import as_choice, as_number
from rollingjoint.identify.doubts import doubts
from rollingjoint.identify.findings import Estimates, Findings
from rollingjoint.identify.fit import Fit, fit
from rollingjoint.identify.measurements import Measurements
from rollingjoint.identify.model import MeasurementModel
from rollingjoint.identify.parameters import coefficients_of
from rollingjoint.identify.profile import linear_profile, profile
from rollingjoint.identify.ranges import Ranges, ranges
from rollingjoint.identify.report import as_dict, report

Array = NDArray[np.float64]

INTERVALS = {"profile": profile, "linear": linear_profile}
"""Methods for intervals, by name."""


@dataclass(frozen=True)
class Identification(Findings):
    """Result of `identify`: Findings with warnings, ranges and a report."""

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """Limits of the data, one line each."""
        return tuple(doubts(self))

    @cached_property
    def ranges(self) -> Ranges:
        """Ranges for domain randomisation, as the settings of the tracking environment have them."""
        return ranges(self)

    def report(self) -> str:
        """Parameters, errors, warnings and ranges as text."""
        return report(self, self.warnings, self.ranges)

    def as_dict(self) -> dict[str, Any]:
        """The same as plain dicts, lists and numbers."""
        return as_dict(self, self.warnings, self.ranges)


def identify(
    measurements: Measurements,
    parameters: Sequence[str] = ("mu",),
    confidence: float = 0.95,
    intervals: str = "profile",
) -> Identification:
    """The values of some parameters with which the model fits the measurements best.

    Least squares over all readings that have a standard deviation, by scipy.optimize.least_squares. Derivatives follow
    from the equilibria by the implicit function theorem, through every step of a path with friction, by mu, stiffness,
    offsets and base angle; for other parameters, and with method "least_squares" for all but the base angle, they
    are central differences.

    Args:
        measurements: from load_measurements, or built.
        parameters: names from KINDS; "offsets:run" gives every run separate values.
        confidence: of the intervals, 0.5 to 0.999.
        intervals: "profile", from profile likelihoods, or "linear", faster and rougher.
    Raises:
        InvalidInput: unknown parameters, a confidence out of range.
        SolverError: a step without an equilibrium for any values.
    """
    as_number("confidence", confidence, 0.5, 0.999)
    find = INTERVALS[as_choice("intervals", intervals, tuple(INTERVALS))]
    model = MeasurementModel(measurements, coefficients_of(parameters, measurements))
    names = [run.name for run in measurements.runs]

    def estimates(result: Fit) -> Estimates:
        return Estimates(result, tuple(find(result, place, confidence) for place in range(len(result.values))))

    together = estimates(fit(model))
    if len(names) == 1:
        return Identification(measurements, confidence, together, {}, {})
    alone = {name: estimates(fit(model.select([name]))) for name in names}
    held_out = {}
    for name in names:
        others = [run for run in names if run != name]
        result = alone[others[0]].fit if len(others) == 1 else fit(model.select(others))
        held_out[name] = _carried_over(result, model)
    return Identification(measurements, confidence, together, alone, held_out)


def _carried_over(result: Fit, model: MeasurementModel) -> Array:
    """Values of all coefficients of a model from a fit to some of its runs, (p,)."""
    values: dict[tuple[str, int | None], list[float]] = {}
    for coefficient, value in zip(result.model.coefficients, result.values, strict=True):
        values.setdefault((coefficient.name, coefficient.tendon), []).append(value)
    return np.array([np.mean(values[coefficient.name, coefficient.tendon]) for coefficient in model.coefficients])
