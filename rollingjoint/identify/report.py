"""An identification as text and as plain values."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from rollingjoint.checked_yaml import dump_yaml
from rollingjoint.identify.errors import LINKS
from rollingjoint.identify.findings import Estimates, Findings
from rollingjoint.identify.measurements import QUANTITIES
from rollingjoint.identify.parameters import Coefficient
from rollingjoint.identify.ranges import Ranges
from rollingjoint.tables import text_table

_COLUMNS = {
    "nominal": "nominal",
    "together": "all runs fitted",
    "alone": "each run fitted",
    "held out": "from other runs",
}


def report(found: Findings, warnings: Sequence[str], ranges: Ranges) -> str:
    """Parameters with intervals, errors by run, warnings and ranges."""
    parts = [_heading(found), _parameters(found), *(_errors(found, quantity) for quantity in found.quantities)]
    if warnings:
        parts.append("\n".join(["what the data cannot tell", *(f"- {line}" for line in warnings)]))
    if ranges:
        parts.append("ranges for domain randomisation\n" + ranges_text(ranges).rstrip())
    return "\n\n".join(parts)


def ranges_text(ranges: Ranges) -> str:
    """The ranges as YAML for a configuration of the tracking environment."""
    flat = {name: {key: _flow(value) for key, value in settings.items()} for name, settings in ranges.items()}
    return dump_yaml(flat).replace("'", "")


def as_dict(found: Findings, warnings: Sequence[str], ranges: Ranges) -> dict[str, Any]:
    """The same as plain dicts, lists and numbers; an interval's end that the data did not set is null."""
    return {
        "mechanism": found.measurements.mechanism.name,
        "given": found.measurements.given,
        "confidence": found.confidence,
        "parameters": _plain(found.together),
        "alone": {run: _plain(each) for run, each in found.alone.items()},
        "held_out": {
            run: {each.label: float(v) for each, v in zip(found.coefficients, values, strict=True)}
            for run, values in found.held_out.items()
        },
        "errors": {
            quantity: {
                which: {run.name: found.errors(quantity, which, run.name)._asdict() for run in found.measurements.runs}
                for which in found.deviations
            }
            for quantity in found.quantities
        },
        "warnings": list(warnings),
        "ranges": ranges,
    }


def _heading(found: Findings) -> str:
    measurements = found.measurements
    steps = sum(len(run.steps) for run in measurements.runs)
    runs = len(measurements.runs)
    numbers = len(found.together.fit.residuals)
    method = f" ({measurements.method})" if measurements.given == "lengths" else ""
    return (
        f"{measurements.mechanism.name}: {_count(runs, 'run')}, {_count(steps, 'step')}, given"
        f" {measurements.given}{method}; {numbers} numbers fitted ({', '.join(found.quantities)})"
    )


def _count(number: int, what: str) -> str:
    return f"{number} {what}" + ("s" if number != 1 else "")


def _parameters(found: Findings) -> str:
    """A row per coefficient: nominal value, estimate and interval from all runs, then from each run alone."""
    percent = f"{100 * found.confidence:g} % interval"
    runs = [run for run in found.alone if any(each.run is None for each in found.coefficients)]
    head = ["parameter", "unit", "nominal", "estimate", percent, *(f"{run} alone" for run in runs)]
    rows = []
    for place, each in enumerate(found.coefficients):
        nominal = each.nominal(found.measurements.mechanism)
        digits = _digits(found.together, place)
        row = [each.label, each.kind.unit or "1", f"{nominal:g}", _fixed(found.together.values[place], digits)]
        row.append(_interval(found.together, place, digits))
        for run in runs:
            row.append(_alone(found.alone[run], each, digits))
        rows.append(row)
    return text_table(head, rows, left=2)


def _alone(estimates: Estimates, coefficient: Coefficient, digits: int) -> str:
    """Estimate and interval from one run."""
    if coefficient not in estimates.coefficients:
        return ""
    place = estimates.coefficients.index(coefficient)
    return f"{_fixed(estimates.values[place], digits)} ({_interval(estimates, place, digits)})"


def _interval(estimates: Estimates, place: int, digits: int) -> str:
    if not estimates.fit.determined[place]:
        return "not determined"
    low, high = estimates.profiles[place].interval
    return f"{_fixed(low, digits)} to {_fixed(high, digits)}"


def _digits(estimates: Estimates, place: int) -> int:
    """Decimals that show an interval to two digits, 2 to 5."""
    low, high = estimates.profiles[place].interval
    return int(np.clip(2 - np.floor(np.log10(max(high - low, 1e-12))), 2, 5)) - (high - low >= 1)


def _fixed(value: float, digits: int) -> str:
    return f"{round(float(value), digits) + 0.0:.{digits}f}"


def _errors(found: Findings, quantity: str) -> str:
    """Errors of one quantity by run under every kind of values."""
    kinds = "last link mean / largest / mean of all" if quantity in LINKS else "largest / mean"
    runs: list[str | None] = [run.name for run in found.measurements.runs]
    if len(runs) > 1:
        runs.append(None)
    rows = [
        [run or "all", *(found.errors(quantity, which, run).text(quantity) for which in found.deviations)]
        for run in runs
    ]
    title = f"errors of {quantity} [{QUANTITIES[quantity]}]: {kinds}"
    return f"{title}\n{text_table(['run', *(_COLUMNS[which] for which in found.deviations)], rows)}"


def _plain(estimates: Estimates) -> dict[str, Any]:
    """Estimates and intervals by label."""
    ends = [
        [end if bounded else None for end, bounded in zip(each.interval, each.bounded, strict=True)]
        for each in estimates.profiles
    ]
    return {
        each.label: {"value": float(value), "interval": interval, "unit": each.kind.unit}
        for each, value, interval in zip(estimates.coefficients, estimates.values, ends, strict=True)
    }


def _flow(value: float | list[float]) -> float | str:
    """A list as it stands in one line."""
    return f"[{value[0]:g}, {value[1]:g}]" if isinstance(value, list) else value
