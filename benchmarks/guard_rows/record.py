"""What one checkout answered in one row, written by its process and read by the comparing one."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

ABSENT = "(absent)"
_META = "meta"
_AT = " | "


@dataclass
class Record:
    """Arrays by the case and the field that they belong to.

    Args:
        row: the row's name. count: how many solves, steps or names it holds.
        rule: how far a field may be off, (absolute, relative), in the field's unit; "*" stands for fields that are
            not named. None: to the bit.
        unsteady: cases with rows that last bits move further than the rule allows, (rows,); these are not compared.
    """

    row: str
    rule: Mapping[str, tuple[float, float]] | None = None
    count: int = 0
    arrays: dict[tuple[str, str], NDArray[Any]] = field(default_factory=dict)
    unsteady: dict[str, NDArray[np.bool_]] = field(default_factory=dict)

    def add(self, case: str, values: Mapping[str, ArrayLike]) -> None:
        """Keep the fields of a case."""
        for name, value in values.items():
            self.arrays[case, name] = np.asarray(value)

    def write(self, path: Path) -> None:
        """Write it as an .npz file."""
        meta = json.dumps({"row": self.row, "rule": self.rule, "count": self.count})
        named = {f"{case}{_AT}{name}": value for (case, name), value in self.arrays.items()}
        kept = {f"{case}{_AT}": value for case, value in self.unsteady.items()}
        np.savez(path, **{_META: np.array(meta)}, **named, **kept)

    @classmethod
    def read(cls, path: Path) -> Record:
        """The record in a file."""
        with np.load(path) as file:
            arrays = {tuple(key.split(_AT)): file[key] for key in file.files if key != _META}
            meta = json.loads(str(file[_META]))
        unsteady = {case: value for (case, name), value in arrays.items() if not name}
        return cls(**meta, arrays={key: value for key, value in arrays.items() if key[1]}, unsteady=unsteady)


def read_folder(folder: Path) -> dict[str, Record]:
    """All records of a folder, by row."""
    records = [Record.read(path) for path in sorted(folder.glob("*.npz"))]
    return {record.row: record for record in records}
