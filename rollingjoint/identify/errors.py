"""How far predictions are from readings: last link, largest, mean."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rollingjoint.identify.measurements import Measurements

Array = NDArray[np.float64]

LINKS = ("position", "angle")
"""The quantities that links have; the others are those of tendons."""


class Errors(NamedTuple):
    """Errors of one quantity: of links the mean of the last measured one, the largest, and the mean of all."""

    last: float
    largest: float
    mean: float

    def text(self, quantity: str) -> str:
        """The numbers for a table; tendons have no last one."""
        shown = self if quantity in LINKS else self[1:]
        return " / ".join("-" if np.isnan(number) else f"{number:.2f}" for number in shown)


def errors_of(measurements: Measurements, quantity: str, deviations: Array) -> Errors:
    """Errors of one quantity.

    Args:
        measurements: which say where it is in a reading.
        quantity: "position", "angle", "length" or "tension".
        deviations: measured minus predicted, (steps, M); NaN where nothing was read.
    """
    table = distances(measurements, quantity, deviations)
    read = table[np.any(np.isfinite(table), axis=1)]
    if not len(read):
        return Errors(np.nan, np.nan, np.nan)
    last = [row[np.isfinite(row)][-1] for row in read]
    return Errors(float(np.mean(last)), float(np.nanmax(read)), float(np.nanmean(read)))


def distances(measurements: Measurements, quantity: str, deviations: Array) -> Array:
    """Error of every link or tendon in every step, (steps, n or m); NaN where nothing was read."""
    table = deviations[:, measurements.columns(quantity)]
    if quantity != "position":
        return np.abs(table)
    return np.linalg.norm(table.reshape(len(table), -1, measurements.dimension), axis=-1)


def quantities(measurements: Measurements) -> list[str]:
    """What is fitted and was read, in order."""
    readings = measurements.readings(measurements.runs)
    return [name for name in measurements.deviations if np.isfinite(readings[:, measurements.columns(name)]).any()]
