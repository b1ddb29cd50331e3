"""What fits to measurements found: estimates for all runs and for each, and how far predictions are from readings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rollingjoint.identify.errors import Errors, errors_of, quantities
from rollingjoint.identify.fit import Fit
from rollingjoint.identify.measurements import Measurements
from rollingjoint.identify.parameters import Coefficient
from rollingjoint.identify.profile import Profile

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Estimates:
    """A fit to some runs, with an interval for every coefficient."""

    fit: Fit
    profiles: tuple[Profile, ...]

    @property
    def coefficients(self) -> tuple[Coefficient, ...]:
        """The unknown numbers."""
        return self.fit.model.coefficients

    @property
    def values(self) -> Array:
        """The best values, (p,)."""
        return self.fit.values

    @property
    def intervals(self) -> Array:
        """Lower and upper ends, (p, 2); ends of the searched range where the data set none."""
        return np.array([each.interval for each in self.profiles]).reshape(-1, 2)


@dataclass(frozen=True)
class Findings:
    """What fits to all runs and to each of them found.

    Args:
        measurements: what was fitted.
        confidence: of the intervals.
        together: one fit to all runs.
        alone: a fit to each run; empty for a single run.
        held_out: for each run, values of all coefficients from the other runs alone; empty for a single run. A value
            that every run has of its own is the mean of those of the other runs.
    """

    measurements: Measurements
    confidence: float
    together: Estimates
    alone: Mapping[str, Estimates]
    held_out: Mapping[str, Array]

    @property
    def coefficients(self) -> tuple[Coefficient, ...]:
        """The unknown numbers."""
        return self.together.coefficients

    @property
    def values(self) -> dict[str, float]:
        """The best values for all runs together, by label."""
        return {each.label: float(v) for each, v in zip(self.coefficients, self.together.values, strict=True)}

    @property
    def intervals(self) -> dict[str, tuple[float, float]]:
        """Their intervals, by label."""
        ends = zip(self.coefficients, self.together.profiles, strict=True)
        return {each.label: found.interval for each, found in ends}

    @cached_property
    def deviations(self) -> dict[str, Array]:
        """Measured minus predicted for all runs, (steps, M) each.

        "nominal": the mechanism as designed; "together": one fit to all runs; "alone": every run with its own fit;
        "held out": every run with the values from the others. The last two only with several runs.
        """
        model = self.together.fit.model
        found = {"nominal": model.nominal, "together": self.together.values}
        tables = {name: model.readings - model.predictions(values) for name, values in found.items()}
        if self.alone:
            tables["alone"] = np.concatenate(
                [each.fit.model.readings - each.fit.model.predictions(each.values) for each in self.alone.values()]
            )
            everywhere = {run: model.readings - model.predictions(v) for run, v in self.held_out.items()}
            tables["held out"] = np.concatenate([everywhere[run][self.rows(run)] for run in self.held_out])
        return tables

    def rows(self, run: str | None) -> NDArray[np.int64]:
        """The steps of a run, or of all, among those of all runs."""
        names = [each.name for each in self.measurements.runs for _ in each.steps]
        return np.flatnonzero([run in (None, name) for name in names])

    def errors(self, quantity: str, which: str, run: str | None = None) -> Errors:
        """Errors of one quantity under one kind of values (see `deviations`), of a run or of all."""
        return errors_of(self.measurements, quantity, self.deviations[which][self.rows(run)])

    @cached_property
    def quantities(self) -> list[str]:
        """What was fitted."""
        return quantities(self.measurements)
