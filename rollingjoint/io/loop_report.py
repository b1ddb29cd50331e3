"""Loops as text: a table to read, JSON and CSV to process."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from rollingjoint.chain.status import Status
from rollingjoint.statics.loop import Loop
from rollingjoint.tables import csv_text, text_table

_HEAD = (
    "friction",
    "width [mm]",
    "at the middle [mm]",
    "travel [mm]",
    "friction work [N·mm]",
    "motor work [N·mm]",
    "sticking [%]",
)


def friction_name(loop: Loop) -> str:
    """The coefficients of friction of the tendons, each once."""
    coefficients = loop.path.mechanism.friction_coefficients[:, 0]
    return ", ".join(f"{mu:g}" for mu in dict.fromkeys(coefficients.tolist()))


def as_table(loops: Sequence[Loop]) -> str:
    """One line per loop, figures of its last cycle."""
    rows = [
        (
            friction_name(loop),
            f"{loop.width:.2f}",
            f"{loop.width_in_the_middle:.2f}",
            f"{loop.travel:.2f}",
            f"{loop.dissipated_work + 0.0:.2f}",
            f"{round(loop.motor_work, 2) + 0.0:.2f}",
            f"{100 * loop.sticking:.1f}",
        )
        for loop in loops
    ]
    return text_table(_HEAD, rows)


def failure(loop: Loop) -> str:
    """Number of steps without a stable equilibrium, with the status of the first; empty if there are none."""
    wrong = np.flatnonzero(~loop.path.ok)
    if not wrong.size:
        return ""
    status = Status(int(loop.path.status[wrong[0]]))
    count = f"{wrong.size} of {len(loop.shares)} steps are no stable equilibria"
    return f"friction {friction_name(loop)}: {count}; step {wrong[0]} is {status.name}: {status.message}"


def as_json(loops: Sequence[Loop]) -> str:
    """Figures and steps of all loops as JSON text; units are in the key names."""
    first = loops[0]
    unit = _unit(first)
    content = {
        "mechanism": first.path.mechanism.name,
        "given": first.given,
        f"middle_{unit}": _plain(first.middle),
        f"swing_{unit}": _plain(first.swing),
        "steps": first.steps,
        "usable": all(loop.ok for loop in loops),
        "loops": [_as_dict(loop) for loop in loops],
    }
    return json.dumps(content, indent=2, allow_nan=False)


def as_csv(loops: Sequence[Loop]) -> str:
    """Every step of every loop as a line of CSV; units are in the head."""
    first = loops[0]
    tendons, unit = range(len(first.swing)), _unit(first)
    axes = "xyz"[: first.path.tip.shape[1]]
    head = ["friction", "step", *(f"input_{j}_{unit}" for j in tendons), *(f"{axis}_mm" for axis in axes)]
    head += [f"tension_{j}_N" for j in tendons] + [f"length_{j}_mm" for j in tendons]
    rows = (
        [friction_name(loop), step, *numbers, int(sticking)]
        for loop in loops
        for step, (*numbers, sticking) in enumerate(np.column_stack(list(_columns(loop).values())).tolist())
    )
    return csv_text([*head, "dissipated_work_N_mm", "sticking_holes"], rows)


def _unit(loop: Loop) -> str:
    return "mm" if loop.given == "lengths" else "N"


def _as_dict(loop: Loop) -> dict[str, Any]:
    coefficients = loop.path.mechanism.friction_coefficients
    return {
        "friction": coefficients[:, 0].tolist(),
        "presliding_mm": coefficients[:, 1].tolist(),
        "width_mm": loop.width,
        "width_in_the_middle_mm": loop.width_in_the_middle,
        "travel_mm": loop.travel,
        "friction_work_N_mm": loop.dissipated_work,
        "motor_work_N_mm": loop.motor_work,
        "sticking": loop.sticking,
        "path": {name: _plain(values) for name, values in _columns(loop).items()},
    }


def _columns(loop: Loop) -> dict[str, Any]:
    """Quantities of every step of a loop, leading axis K."""
    path = loop.path
    return {
        f"inputs_{_unit(loop)}": loop.inputs,
        "tip_mm": path.tip,
        "tensions_N": path.tensions,
        "lengths_mm": path.lengths,
        "dissipated_work_N_mm": path.dissipated_work,
        "sticking_holes": path.sticking.sum(axis=(1, 2)),
    }


def _plain(values: Any) -> Any:
    """Nested lists; None for numbers that JSON cannot express."""
    if isinstance(values, np.ndarray):
        return [_plain(value) for value in values.tolist()]
    if isinstance(values, list):
        return [_plain(value) for value in values]
    return values if math.isfinite(values) else None
