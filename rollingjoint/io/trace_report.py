"""Paths of equilibria as text: a line for every step, to read; JSON and CSV to process."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rollingjoint.chain.status import Status
from rollingjoint.io.path_file import BASE, UNITS
from rollingjoint.tables import csv_text, fixed, text_table

Array = NDArray[np.float64]

SPATIAL_BASE = (*(f"base_{axis}_mm" for axis in "xyz"), *(f"base_turn_{axis}_rad" for axis in "xyz"))
"""Columns of the pose of a base in space, with a rotation vector."""


@dataclass(frozen=True, eq=False)
class TracedPath:
    """Equilibria along a path, and what was given.

    Args:
        path: the equilibria, a leading axis K on their arrays; the first is a step without friction.
        given: "lengths" or "tensions". inputs: (K, m). bases: (K, 3 or 6) poses of the base; None: no walls.
        feeds: (K,) way of the base along its y axis, in space its z axis, where that is what was given [mm].
    """

    path: Any
    given: str
    inputs: Array
    bases: Array | None = None
    feeds: Array | None = None

    @property
    def failure(self) -> str:
        """Number of steps without a stable equilibrium, with the status of the first; empty if there are none."""
        wrong = np.flatnonzero(~self.path.ok)
        if not wrong.size:
            return ""
        status = Status(int(self.path.status[wrong[0]]))
        count = f"{wrong.size} of {len(self.inputs)} steps are no stable equilibria"
        return f"{count}; step {wrong[0]} is {status.name}: {status.message}"

    @property
    def driver(self) -> tuple[str, Array]:
        """Name and values, (K,), of the input that changes most: the way of the base, or one of a tendon's."""
        if self.feeds is not None and np.ptp(self.feeds) > 0.0:
            return "feed [mm]", self.feeds
        leader = int(np.argmax(np.ptp(self.inputs, axis=0)))
        name, unit = UNITS[self.given]
        return f"{name} of tendon {leader} [{unit}]", self.inputs[:, leader]

    @property
    def columns(self) -> dict[str, Array]:
        """Quantities of every step by name, with the unit, (K,) each."""
        path, (name, unit) = self.path, UNITS[self.given]
        columns = {f"{name}_{j}_{unit}": values for j, values in enumerate(self.inputs.T)}
        if self.bases is not None:
            columns |= dict(zip(BASE if self.bases.shape[1] == 3 else SPATIAL_BASE, self.bases.T, strict=True))
        axes = "xyz"[: path.tip.shape[1]]
        columns |= {f"tip_{axis}_mm": values for axis, values in zip(axes, path.tip.T, strict=True)}
        if self.given != "tensions":
            columns |= {f"tension_{j}_N": values for j, values in enumerate(path.tensions.T)}
        columns |= {f"tendon_length_{j}_mm": values for j, values in enumerate(path.lengths.T)}
        columns["dissipated_work_N_mm"] = path.dissipated_work
        columns["sticking_holes"] = path.sticking.sum(axis=(1, 2))
        if path.walls is not None:
            columns |= self.wall_columns
        columns["status"] = np.asarray(path.status, int)
        return columns

    @property
    def wall_columns(self) -> dict[str, Array]:
        """Contact with walls at every step: numbers of contacts and of those that stick, forces, jumps of the pose."""
        touches = self.path.wall_contacts
        sticking = [sum(touch.sticks for touch in every) for every in touches]
        forces = self.path.wall_forces
        columns = {
            "wall_contacts": np.array([len(every) for every in touches]),
            "sticking_contacts": np.array(sticking),
            "largest_normal_N": np.array([max((touch.force for touch in every), default=0.0) for every in touches]),
            "insertion_force_N": self.path.insertion_force,
            "jumped": np.asarray(self.path.jumped, int),
        }
        names: tuple[str, ...] = ("x_N", "y_N", "moment_N_mm")
        if forces.shape[2] == 6:
            names = (*(f"{axis}_N" for axis in "xyz"), *(f"moment_{axis}_N_mm" for axis in "xyz"))
        for link in range(1, forces.shape[1]):
            for name, values in zip(names, forces[:, link].T, strict=True):
                columns[f"wall_force_{link}_{name}"] = values
        return columns

    def as_table(self) -> str:
        """A line per step: what drives it, the tip, contact with walls, work of friction, how it ended."""
        driver, values = self.driver
        tip = self.path.tip
        head = ["step", driver, *(f"{axis} [mm]" for axis in "xyz"[: tip.shape[1]])]
        cells = [[fixed(value, 3) for value in column] for column in (values, *tip.T)]
        if self.path.walls is not None:
            walls = self.wall_columns
            head += ["contacts", "stick", "normal [N]", "insertion [N]"]
            cells += [list(map(str, walls[name])) for name in ("wall_contacts", "sticking_contacts")]
            cells += [[fixed(value, 3) for value in walls[name]] for name in ("largest_normal_N", "insertion_force_N")]
        head += ["lost [N·mm]", ""]
        cells += [[fixed(value, 3) for value in self.path.dissipated_work], self._remarks()]
        return text_table(head, [[str(step), *row] for step, row in enumerate(zip(*cells, strict=True))], left=0)

    def _remarks(self) -> list[str]:
        """The status of steps that are no equilibria, and which poses jumped."""
        jumped = np.zeros(len(self.inputs)) if self.path.walls is None else self.path.jumped
        names = [Status(int(status)).name for status in self.path.status]
        return [
            name if name not in ("CONVERGED", "AT_LIMIT") else "jumped" * bool(jump)
            for name, jump in zip(names, jumped, strict=True)
        ]

    def as_csv(self) -> str:
        """Every step as a line of CSV; units are in the head."""
        columns = {"step": np.arange(len(self.inputs)), **self.columns}
        return csv_text(columns, zip(*(values.tolist() for values in columns.values()), strict=True))

    def as_json(self) -> str:
        """Every column as a list, JSON text; units are in the key names."""
        content = {"mechanism": self.path.mechanism.name, "given": self.given, "usable": bool(self.path.ok.all())}
        columns = {name: [_plain(value) for value in values.tolist()] for name, values in self.columns.items()}
        return json.dumps(content | {"steps": columns}, indent=2, allow_nan=False)


def _plain(value: Any) -> Any:
    """The number; None for infinity, which JSON cannot express."""
    return value if math.isfinite(value) else None
