"""The host's side of lanes on a device: episodes begin here, and lanes that the device leaves are solved here."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rj_gym.tracking.episodes import TrackingEpisodeBuffer
from rollingjoint.chain.stacks import stack

Array = NDArray[np.float64]
Rows = NDArray[np.int64]

SOLVED = ("joint_angles", "responses", "poses", "tensions", "lengths", "status", "contacts")
"""What a step reads of a solve, by the names of the compiled solver's results."""


class HostEpisodes(TrackingEpisodeBuffer):
    """The native episode buffer, in which lanes begin their episodes; where they go on is known on the device alone."""

    @property
    def load_tables(self) -> Array:
        """The loads of all lanes, (B, 1, columns), with links and without forces that are up to date."""
        return self.solver.loads

    @property
    def varies(self) -> bool:
        """Whether every lane has separate tables."""
        return len(self.tables[0].joints) == self.capacity > 1

    @property
    def tables(self) -> tuple[Any, Rows]:
        """The tables of the mechanisms as a stack of designs, and which of these each lane has, (B,)."""
        return stack(self.solver.mechanisms), self.solver.rows

    def solve_lanes(
        self, rows: Rows, commands: Array, highest: Array, forces: Array, starts: Array
    ) -> dict[str, NDArray[Any]]:
        """Equilibria of some lanes as the native environment finds them, SOLVED by name, (len(rows), ...).

        There are contacts only where the privileged state is to be read.

        Args:
            rows: the lanes, (R,).
            commands: of the tendons, (R, m) [mm].
            highest: tensions that they can have, (R, m) [N].
            forces: (R, 2) [N].
            starts: joint angles to start from, (R, J) [rad].
        """
        laws, results = self.solver.laws, self.solver.results
        laws.low[rows], laws.high[rows] = self.task.config.tension_range[0], highest
        self.solver.solve_lanes(rows, commands, forces, starts)
        parts = {name: getattr(results, name)[rows] for name in SOLVED if len(getattr(results, name))}
        if "contacts" in parts:
            parts["contacts"] = parts["contacts"][..., :2]
        return parts
