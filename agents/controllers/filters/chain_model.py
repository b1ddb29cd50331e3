"""The model of a planar chain, of which a force pulls on one link."""

from __future__ import annotations

import math
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from agents.controllers.filters.kernels import Levers
from agents.controllers.filters.levers import chain_levers
from agents.controllers.filters.model import Model, Part, process_part
from agents.evaluation.controller import Array
from rj_gym.core.tracking_task import TrackingTask
from rollingjoint.chain.solution import Solution
from rollingjoint.load import LOAD_COLUMNS
from rollingjoint.statics.solve import solve_tensions_batch

_LINK, _FX = LOAD_COLUMNS.index("link"), LOAD_COLUMNS.index("fx")
_BEYOND = 1.2  # times the largest load: how far an estimate may go


class ChainModel(Model):
    """A planar chain; its load is the force (2) [N] on the loaded link."""

    N_LOAD: ClassVar[int] = 2
    stiffens: ClassVar[bool] = True

    def __init__(self, task: TrackingTask, links: NDArray[np.int64]) -> None:
        super().__init__(task, links)
        self._load = task.config.load
        self.radius, self.n_angles = _BEYOND * self._load.magnitude[1], task.mechanism.n_joints

    def load_prior(self, force_walk: float) -> list[Part]:
        """Forces that stay have a direction that is uniform, and a uniform magnitude."""
        low, high = self._load.magnitude
        sd = 0.5 * high if self._load.process == "ou" else math.sqrt((low**2 + low * high + high**2) / 6.0)
        return [process_part(2, sd, self._load, force_walk, (-self.radius, self.radius))]

    def start(self, states: Array, tension: float) -> tuple[Solution, Array]:
        """One equilibrium, for the start is unloaded, and derivatives of 0."""
        start = solve_tensions_batch(self.mechanism, np.full((1, self.n_tendons), tension))
        return start, np.zeros((len(states), self.n_tendons, self.N_LOAD))

    def _load_tables(self, states: Array) -> Array:
        loads = np.zeros((len(states), 1, len(LOAD_COLUMNS)))
        loads[:, 0, _LINK], loads[:, 0, _FX : _FX + 2] = self._rows(len(states)).links, states[:, :2]
        return loads

    def _fill_levers(self, found: Any, states: Array, levers: Levers) -> None:
        chain_levers(found.poses, found.contact_points, self._rows(len(states)).links, levers)

    def _link_angles(self, found: Any) -> Array:
        return np.asarray(found.poses[:, 1:, 2])
