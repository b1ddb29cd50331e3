"""Paths of inputs in CSV and YAML files: what of every step is given, one column each; documented in docs/cli.md."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rollingjoint.checked_yaml import mapping, number, numbers, read_yaml, text_of
from rollingjoint.errors import ConfigError

Array = NDArray[np.float64]

UNITS = {"lengths": ("length", "mm"), "tensions": ("tension", "N")}
BASE = ("base_x_mm", "base_y_mm", "base_angle_rad")
FEED = "feed_mm"
MOST_STEPS = 25_000


def load_columns(path: str | Path, n_tendons: int) -> dict[str, Array]:
    """The columns of a path, (K,) each, by their names.

    Args:
        path: a CSV file with a head, or a YAML file with a list for every column, or a number that stays.
        n_tendons: of the mechanism.
    Returns:
        length_0_mm ... or tension_0_N ..., all or none of them; base_x_mm, base_y_mm, base_angle_rad, or feed_mm.
    Raises:
        ConfigError: a file that cannot be read, an unknown or missing column, a value that is no number.
    """
    source = str(path)
    names = {given: [f"{name}_{j}_{unit}" for j in range(n_tendons)] for given, (name, unit) in UNITS.items()}
    valid = [*names["lengths"], *names["tensions"], *BASE, FEED]
    content = _from_csv(source, valid) if source.lower().endswith(".csv") else _from_yaml(source, valid)
    for group in (*names.values(), BASE):
        present = [name for name in group if name in content]
        if present and len(present) < len(group):
            raise ConfigError(f"{source}: columns", present, f"all of {', '.join(group)}, or none")
    for one, other in ((names["lengths"][0], names["tensions"][0]), (FEED, BASE[0])):
        if one in content and other in content:
            raise ConfigError(f"{source}: columns", [one, other], "one of both")
    counts = {len(column) for column in content.values()}
    if len(counts) != 1 or not 0 < max(counts) <= MOST_STEPS:
        allowed = f"equally many in every column, 1 to {MOST_STEPS:,}"
        raise ConfigError(f"{source}: number of steps", sorted(counts), allowed)
    return content


def given_of(columns: Mapping[str, Array], given: str) -> Array | None:
    """Lengths or tensions of every step, (K, m), if the columns have them."""
    name, unit = UNITS[given]
    count = sum(key.startswith(f"{name}_") for key in columns)
    return np.stack([columns[f"{name}_{j}_{unit}"] for j in range(count)], axis=1) if count else None


def _from_csv(source: str, valid: list[str]) -> dict[str, Array]:
    text = text_of(Path(source), "CSV text").removeprefix("\ufeff")
    head, *rows = [row for row in csv.reader(io.StringIO(text)) if row] or [[]]
    mapping(f"{source}: columns", dict.fromkeys(name.strip() for name in head), valid)
    columns: dict[str, list[float]] = {name.strip(): [] for name in head}
    if len(columns) != len(head):
        raise ConfigError(f"{source}: columns", head, "every name once")
    for line, row in enumerate(rows, start=2):
        if len(row) != len(head):
            raise ConfigError(f"{source}: row {line}", f"{len(row)} values", f"{len(head)}, one per column")
        for name, value in zip(columns, row, strict=True):
            columns[name].append(number(f"{source}: row {line}, {name}", _as_float(value)))
    return {name: np.array(values) for name, values in columns.items()}


def _as_float(value: str) -> Any:
    try:
        return float(value)
    except ValueError:
        return value


def _from_yaml(source: str, valid: list[str]) -> dict[str, Array]:
    content = mapping(source, read_yaml(Path(source)), valid)
    lists = {
        name: [number(f"{source}: {name}", value)]
        if not isinstance(value, list)
        else numbers(f"{source}: {name}", value)
        for name, value in content.items()
    }
    longest = max(map(len, lists.values()), default=0)
    stays = {name for name, value in content.items() if not isinstance(value, list)}
    return {name: np.array(values * longest if name in stays else values) for name, values in lists.items()}
