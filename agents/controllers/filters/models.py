"""The models of all classes of chains that filters know: a planar chain, a hanging arm, and a tube without weight."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from agents.controllers.controller import Array
from agents.controllers.filters.kernels import Levers
from agents.controllers.filters.levers import ArmLoads, arm_levers, chain_levers, tube_levers, turn_gravity
from agents.controllers.filters.model import FilterModel, StatePart, process_part
from agents.controllers.measured import hanging_loads, loads_along
from rj_gym.tracking.task import TrackingTask
from rollingjoint import HingeChain, RollingChain, SpatialChain, SpatialEquilibrium, solve_tensions_batch
from rollingjoint.chain.solution import Solution
from rollingjoint.load import LOAD_COLUMNS, SPATIAL_LOAD_COLUMNS
from rollingjoint.statics.sensitivity import joint_response

_LINK, _FX = LOAD_COLUMNS.index("link"), LOAD_COLUMNS.index("fx")  # the link is the first column in space, too
_FX_SPACE = SPATIAL_LOAD_COLUMNS.index("fx")
_BEYOND = 1.2  # times the largest load: how far an estimate may go


class ChainModel(FilterModel):
    """A planar chain; its load is the force (2) [N] on the loaded link."""

    N_LOAD: ClassVar[int] = 2
    stiffens = True

    def __init__(self, task: TrackingTask, links: NDArray[np.int64]) -> None:
        super().__init__(task, links)
        self._load = task.config.load
        self.radius, self.n_angles = _BEYOND * self._load.magnitude[1], task.mechanism.n_joints

    def load_prior(self, force_walk: float) -> list[StatePart]:
        """Forces that stay have a direction that is uniform, and a uniform magnitude."""
        low, high = self._load.magnitude
        sd = 0.5 * high if self._load.process == "ou" else math.sqrt((low**2 + low * high + high**2) / 6.0)
        return [process_part(2, sd, self._load, force_walk, (-self.radius, self.radius))]

    def start(self, states: Array, tension: float) -> tuple[Solution, Array]:
        """One equilibrium, for the start is unloaded, and derivatives of 0."""
        start = solve_tensions_batch(self.mechanism, np.full((1, self.n_tendons), tension))
        return start, np.zeros((len(states), self.n_tendons, self.N_LOAD))

    def load_tables(self, states: Array) -> Array:
        """Load tables, (R, rows, columns)."""
        loads = np.zeros((len(states), 1, len(LOAD_COLUMNS)))
        loads[:, 0, _LINK], loads[:, 0, _FX : _FX + 2] = self._rows(len(states)).links, states[:, :2]
        return loads

    def _fill_levers(self, equilibria: Any, states: Array, levers: Levers) -> None:
        chain_levers(equilibria.poses, equilibria.contact_points, self._rows(len(states)).links, levers)

    def _link_angles(self, equilibria: Any) -> Array:
        return np.asarray(equilibria.poses[:, 1:, 2])


class ArmModel(FilterModel):
    """An arm.

    Its load is the vector by which gravity is turned from hanging (2) [rad], and the payload less the middle of its
    range [N].
    """

    N_LOAD: ClassVar[int] = 3
    START_PASSES: ClassVar[int] = 4  # lengths are not linear in the turn

    def __init__(self, task: TrackingTask, links: NDArray[np.int64]) -> None:
        super().__init__(task, links)
        config, arm = task.config, task.mechanism
        self._load, self._tilt, self._middle = config.load, config.gravity.tilt, 0.5 * sum(config.load.magnitude)
        self.radius, self.n_angles = min(_BEYOND * self._tilt[1], math.pi), 0
        self._weights, self._centres = arm.weights, arm.centres
        self.stiffens = arm.slips
        self._table = hanging_loads(arm)

    def load_prior(self, force_walk: float) -> list[StatePart]:
        """Directions of gravity are uniform over a part of the sphere, payloads over their range."""
        (near, far), (low, high) = self._tilt, self._load.magnitude
        angles = np.linspace(near, far, 101)
        sd = math.sqrt(np.average(angles**2, weights=np.sin(angles) + 1e-12) / 2.0)
        width = high - low
        payload_sd = width / 4.0 if self._load.process == "ou" else width / math.sqrt(12.0)
        bounds = -self._middle, _BEYOND * high - self._middle
        turn = StatePart(2, 0.0, sd, 1.0, force_walk * sd, (-self.radius, self.radius))
        return [turn, process_part(1, payload_sd, self._load, force_walk, bounds)]

    def start(self, states: Array, tension: float) -> tuple[Solution, Array]:
        """The arm hangs without its payload, under the gravity of the states."""
        rows, m, hanging = len(states), self.n_tendons, states.copy()
        hanging[:, 2] = -self._middle
        start = solve_tensions_batch(self.mechanism, np.full((rows, m), tension), self.load_tables(hanging))
        torques = self.levers(start, hanging).loads
        torques[:, :, 2] = 0.0  # there is no payload yet
        return start, np.swapaxes(start.tendon_rates, 1, 2) @ joint_response(start, start.stiffness, torques)

    def load_tables(self, states: Array) -> Array:
        """Load tables, (R, rows, columns)."""
        loads = self._loads(states)
        return loads_along(self._table, loads.gravity, loads.payloads)

    def _fill_levers(self, equilibria: Any, states: Array, levers: Levers) -> None:
        axes = self._rows(len(states)).chain.axes[0]
        arm_levers(equilibria.poses, pivots_of(equilibria), axes, self._loads(states), levers)

    def _link_angles(self, equilibria: Any) -> Array:
        return np.empty((len(equilibria.poses), 0))

    def _loads(self, states: Array) -> ArmLoads:
        count = len(states)
        gravity, by_turn = np.empty((count, 3)), np.empty((count, 3, 2))
        turn_gravity(np.ascontiguousarray(states[:, :2]), gravity, by_turn)
        return ArmLoads(self._weights, self._centres, gravity, by_turn, states[:, 2] + self._middle)


class TubeModel(FilterModel):
    """A chain in space without weight; its load is the force (3) [N] at its tip."""

    N_LOAD: ClassVar[int] = 3
    stiffens = True

    def __init__(self, task: TrackingTask, links: NDArray[np.int64]) -> None:
        super().__init__(task, links)
        self._load = task.config.load
        self.radius, self.n_angles = _BEYOND * self._load.magnitude[1], 0

    def load_prior(self, force_walk: float) -> list[StatePart]:
        """Forces have a direction that is uniform, and a uniform magnitude."""
        low, high = self._load.magnitude
        sd = math.sqrt((low**2 + low * high + high**2) / 9.0)
        walk = math.sqrt(2.0 / self._load.correlation_steps) if self._load.process == "ou" else force_walk
        jumps = 2.0 / self._load.hold_steps if self._load.process == "step" else 0.0
        return [StatePart(3, 0.0, sd, 1.0, sd * math.hypot(walk, math.sqrt(jumps)), (-self.radius, self.radius))]

    def start(self, states: Array, tension: float) -> tuple[Solution, Array]:
        """One equilibrium, for the start is unloaded, and derivatives of 0."""
        start = solve_tensions_batch(self.mechanism, np.full((1, self.n_tendons), tension))
        return start, np.zeros((len(states), self.n_tendons, self.N_LOAD))

    def load_tables(self, states: Array) -> Array:
        """Load tables, (R, rows, columns)."""
        loads = np.zeros((len(states), 1, len(SPATIAL_LOAD_COLUMNS)))
        loads[:, 0, _LINK], loads[:, 0, _FX_SPACE : _FX_SPACE + 3] = self.mechanism.n_joints, states[:, :3]
        return loads

    def _fill_levers(self, equilibria: Any, states: Array, levers: Levers) -> None:
        axes = self._rows(len(states)).chain.axes[0]
        tube_levers(equilibria.poses, pivots_of(equilibria), axes, levers)

    def _link_angles(self, equilibria: Any) -> Array:
        return np.empty((len(equilibria.poses), 0))


def pivots_of(equilibria: Any) -> Array:
    """Where the joints of chains in space turn, (R, J, 3) [mm]: contact points, or hinges at the origins of links."""
    pivots = equilibria.contact_points if isinstance(equilibria, SpatialEquilibrium) else equilibria.positions[:, :-1]
    return np.array(pivots, order="C")  # of one kind for both: compiled once


def model_in_space(task: TrackingTask, links: NDArray[np.int64]) -> FilterModel:
    """The model of a SpatialChain: with weights it hangs as an arm."""
    return ArmModel(task, links) if task.mechanism.weights.any() else TubeModel(task, links)


MODELS: dict[type, Callable[[TrackingTask, NDArray[np.int64]], FilterModel]] = {
    RollingChain: ChainModel,
    HingeChain: ArmModel,
    SpatialChain: model_in_space,
}


def model_of(task: TrackingTask, links: NDArray[np.int64]) -> FilterModel:
    """The model of a task's mechanism, for hypotheses with these loaded links, (H,)."""
    mechanism: Any = task.mechanism
    return MODELS[type(mechanism)](task, links)
