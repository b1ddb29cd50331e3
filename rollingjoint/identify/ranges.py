"""Ranges for domain randomisation: settings of the tracking environment from the intervals of parameters."""

from __future__ import annotations

from typing import Any

import numpy as np

from rollingjoint.identify.findings import Findings
from rollingjoint.identify.parameters import KINDS

Ranges = dict[str, dict[str, float | list[float]]]

_STIFFNESS_SPREAD = 0.9  # the largest that the environment takes


def ranges(findings: Findings) -> Ranges:
    """Settings `friction` and `randomization` of the tracking environment, as rj_gym.TrackingConfig takes them.

    Each range holds the intervals of the fits to all runs together and to each run, so that it covers runs that
    differ; presliding is the best value. Parameters that the data do not determine are left out.
    """
    names = list(dict.fromkeys(coefficient.name for coefficient in findings.coefficients))
    spans = {name: span for name in names if (span := _span(findings, name))}
    largest = {name: max(abs(end - KINDS[name].nominal) for end in span) for name, span in spans.items()}
    friction: dict[str, float | list[float]] = {}
    if "mu" in spans:
        friction["mu"] = [_rounded(end) for end in spans["mu"]]
    if "presliding" in spans:
        best = zip(findings.coefficients, findings.together.values, strict=True)
        friction["presliding"] = _rounded(
            np.mean([value for coefficient, value in best if coefficient.name == "presliding"])
        )
    randomization: dict[str, float | list[float]] = {}
    if "stiffness" in spans:
        randomization["stiffness_spread"] = _rounded(min(largest["stiffness"], _STIFFNESS_SPREAD))
    shifts = [largest[name] / 2 for name in ("surface_height", "surface_shift") if name in spans]
    if shifts:
        randomization["link_tolerance_mm"] = _rounded(max(shifts))
    if "surface_turn" in spans:
        randomization["link_tolerance_rad"] = _rounded(largest["surface_turn"] / 2)
    if "offsets" in spans:
        randomization["actuator_offset_mm"] = _rounded(largest["offsets"])
    sections = {"friction": friction, "randomization": randomization}
    return {name: settings for name, settings in sections.items() if settings}


def _span(findings: Findings, name: str) -> tuple[float, float] | None:
    """The smallest range that holds all intervals of a parameter with at least one end set by the data."""
    ends = [
        profile.interval
        for estimates in (findings.together, *findings.alone.values())
        for coefficient, profile in zip(estimates.coefficients, estimates.profiles, strict=True)
        if coefficient.name == name and any(profile.bounded)
    ]
    return (min(low for low, _ in ends), max(high for _, high in ends)) if ends else None


def _rounded(number: float | np.floating[Any]) -> float:
    """The number to three digits, without a negative zero."""
    return float(f"{number:.3g}") + 0.0
