"""Errors of predictions: of the last link, the largest, the mean."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rollingjoint.identify.measurements import Measurements

Array = NDArray[np.float64]

LINKS = ("position", "angle")
"""Quantities of links; the remaining ones belong to tendons."""


class Errors(NamedTuple):
    """Errors of one quantity: mean over the last measured links, largest, and mean of all."""

    last: float
    largest: float
    mean: float

    def text(self, quantity: str) -> str:
        """The numbers for a table; `last` is left out for tendons."""
        shown = self if quantity in LINKS else self[1:]
        return " / ".join("-" if np.isnan(number) else f"{number:.2f}" for number in shown)


def errors_of(measurements: Measurements, quantity: str, deviations: Array) -> Errors:
    """Errors of one quantity.

    Args:
        measurements: define the columns of a reading.
        quantity: "position", "angle", "length" or "tension".
        deviations: measured minus predicted, (steps, M); NaN: not read.
    """
    table = distances(measurements, quantity, deviations)
    read = table[np.any(np.isfinite(table), axis=1)]
    if not len(read):
        return Errors(np.nan, np.nan, np.nan)
    last = [row[np.isfinite(row)][-1] for row in read]
    return Errors(float(np.mean(last)), float(np.nanmax(read)), float(np.nanmean(read)))


def distances(measurements: Measurements, quantity: str, deviations: Array) -> Array:
    """Error of every link or tendon in every step, (steps, n or m); NaN: not read."""
    table = deviations[:, measurements.columns(quantity)]
    if quantity != "position":
        return np.abs(table)
    return np.linalg.norm(table.reshape(len(table), -1, measurements.dimension), axis=-1)


def quantities(measurements: Measurements) -> list[str]:
    """Names of the quantities that are fitted and were read, in order."""
    readings = measurements.readings(measurements.runs)
    return [name for name in measurements.deviations if np.isfinite(readings[:, measurements.columns(name)]).any()]
