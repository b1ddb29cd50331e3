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
from rollingjoint.tables import fixed, text_table

_COLUMNS = {
    "nominal": "nominal",
    "together": "all runs fitted",
    "alone": "each run fitted",
    "held out": "from other runs",
}


def report(findings: Findings, warnings: Sequence[str], ranges: Ranges) -> str:
    """Parameters with intervals, errors by run, warnings and ranges."""
    parts = [
        _heading(findings),
        _parameters(findings),
        *(_errors(findings, quantity) for quantity in findings.quantities),
    ]
    if warnings:
        parts.append("\n".join(["what the data cannot tell", *(f"- {line}" for line in warnings)]))
    if ranges:
        parts.append("ranges for domain randomisation\n" + ranges_text(ranges).rstrip())
    return "\n\n".join(parts)


def ranges_text(ranges: Ranges) -> str:
    """The ranges as YAML for a configuration of the tracking environment."""
    flat = {name: {key: _flow(value) for key, value in settings.items()} for name, settings in ranges.items()}
    return dump_yaml(flat).replace("'", "")


def as_dict(findings: Findings, warnings: Sequence[str], ranges: Ranges) -> dict[str, Any]:
    """The same as plain dicts, lists and numbers; an interval's end that the data did not set is null."""
    return {
        "mechanism": findings.measurements.mechanism.name,
        "given": findings.measurements.given,
        "confidence": findings.confidence,
        "parameters": _plain(findings.together),
        "alone": {run: _plain(estimates) for run, estimates in findings.alone.items()},
        "held_out": {
            run: {
                coefficient.label: float(value)
                for coefficient, value in zip(findings.coefficients, values, strict=True)
            }
            for run, values in findings.held_out.items()
        },
        "errors": {
            quantity: {
                which: {
                    run.name: findings.errors(quantity, which, run.name)._asdict() for run in findings.measurements.runs
                }
                for which in findings.deviations
            }
            for quantity in findings.quantities
        },
        "warnings": list(warnings),
        "ranges": ranges,
    }


def _heading(findings: Findings) -> str:
    measurements = findings.measurements
    steps = sum(len(run.steps) for run in measurements.runs)
    runs = len(measurements.runs)
    numbers = len(findings.together.fit.residuals)
    method = f" ({measurements.method})" if measurements.given == "lengths" else ""
    return (
        f"{measurements.mechanism.name}: {_count(runs, 'run')}, {_count(steps, 'step')}, given"
        f" {measurements.given}{method}; {numbers} numbers fitted ({', '.join(findings.quantities)})"
    )


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" + ("s" if number != 1 else "")


def _parameters(findings: Findings) -> str:
    """A row per coefficient: nominal value, estimate and interval from all runs, then from each run alone."""
    percent = f"{100 * findings.confidence:g} % interval"
    runs = [run for run in findings.alone if any(coefficient.run is None for coefficient in findings.coefficients)]
    head = ["parameter", "unit", "nominal", "estimate", percent, *(f"{run} alone" for run in runs)]
    rows = []
    for place, coefficient in enumerate(findings.coefficients):
        nominal = coefficient.nominal(findings.measurements.mechanism)
        digits = _digits(findings.together, place)
        row = [
            coefficient.label,
            coefficient.kind.unit or "1",
            f"{nominal:g}",
            fixed(findings.together.values[place], digits),
        ]
        row.append(_interval(findings.together, place, digits))
        for run in runs:
            row.append(_alone(findings.alone[run], coefficient, digits))
        rows.append(row)
    return text_table(head, rows, left=2)


def _alone(estimates: Estimates, coefficient: Coefficient, digits: int) -> str:
    """Estimate and interval from one run."""
    if coefficient not in estimates.coefficients:
        return ""
    place = estimates.coefficients.index(coefficient)
    return f"{fixed(estimates.values[place], digits)} ({_interval(estimates, place, digits)})"


def _interval(estimates: Estimates, place: int, digits: int) -> str:
    if not estimates.fit.determined[place]:
        return "not determined"
    low, high = estimates.profiles[place].interval
    return f"{fixed(low, digits)} to {fixed(high, digits)}"


def _digits(estimates: Estimates, place: int) -> int:
    """Decimals that show an interval to two digits, 2 to 5."""
    low, high = estimates.profiles[place].interval
    return int(np.clip(2 - np.floor(np.log10(max(high - low, 1e-12))), 2, 5)) - (high - low >= 1)


def _errors(findings: Findings, quantity: str) -> str:
    """Errors of one quantity by run under every kind of values."""
    kinds = "last link mean / largest / mean of all" if quantity in LINKS else "largest / mean"
    runs: list[str | None] = [run.name for run in findings.measurements.runs]
    if len(runs) > 1:
        runs.append(None)
    rows = [
        [run or "all", *(findings.errors(quantity, which, run).text(quantity) for which in findings.deviations)]
        for run in runs
    ]
    title = f"errors of {quantity} [{QUANTITIES[quantity]}]: {kinds}"
    return f"{title}\n{text_table(['run', *(_COLUMNS[which] for which in findings.deviations)], rows)}"


def _plain(estimates: Estimates) -> dict[str, Any]:
    """Estimates and intervals by label."""
    ends = [
        [end if bounded else None for end, bounded in zip(profile.interval, profile.bounded, strict=True)]
        for profile in estimates.profiles
    ]
    return {
        coefficient.label: {"value": float(value), "interval": interval, "unit": coefficient.kind.unit}
        for coefficient, value, interval in zip(estimates.coefficients, estimates.values, ends, strict=True)
    }


def _flow(value: float | list[float]) -> float | str:
    """A list in YAML's flow style, on one line."""
    return f"[{value[0]:g}, {value[1]:g}]" if isinstance(value, list) else value
