"""The model of a mechanism under the states of many filters, and its derivatives by them."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cache
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.controllers.controller import Array
from agents.controllers.filters import kernels
from agents.controllers.filters.kernels import Derivatives, Levers, ModelEquilibria, Play, StateLayout
from rj_gym.tracking.task import TrackingTask
from rollingjoint.chain.batch import solve_batch
from rollingjoint.chain.solution import Solution
from rollingjoint.chain.stacks import designs_of
from rollingjoint.compiled import TendonLaw


class StatePart(NamedTuple):
    """Some numbers of a state before any measurement, and their change in a step; (H, size) or less.

    memory: factor of a step. walk: standard deviation that it adds.
    """

    size: int
    mean: Any
    sd: Any
    memory: float
    walk: Any
    bounds: tuple[float, float]


@dataclass(frozen=True)
class Prediction:
    """The model under B x H states: R rows, the hypotheses of an episode adjacent.

    Args:
        equilibria: of the model. link_angles: as pictures show them, (R, J) [rad]; J is 0 where none.
        solved, linear: equilibria and their derivatives, as the kernels take them.
    """

    equilibria: Solution
    link_angles: Array
    solved: ModelEquilibria
    linear: Derivatives


class FilterModel(ABC):
    """A mechanism with predicted tip, tensions and link angles; every class of chains has one.

    Args:
        task: the task with this nominal mechanism.
        links: the loaded link of every hypothesis, (H,).

    Attributes:
        places: of the parts of a state. n_tendons: m. n_angles: how many link angles pictures may show.
        radius: of the circle about 0 in which the first two numbers of a load lie, in their unit.
        stiffens: whether higher tensions stiffen the mechanism, so that they are worth going for.
    """

    N_LOAD: ClassVar[int]
    START_PASSES: ClassVar[int] = 1  # of taking the lengths at the start in, each from where the last one ended
    stiffens: bool
    n_angles: int
    radius: float

    def __init__(self, task: TrackingTask, links: NDArray[np.int64]) -> None:
        self.mechanism: Any = task.mechanism
        self._links, self._tension_range = links, task.config.possible_tensions
        self.n_tendons: int = task.mechanism.n_tendons
        self.places = StateLayout.of(self.N_LOAD, self.n_tendons, task.dimension)
        self._bind()

    def _bind(self) -> None:
        self._rows = cache(self._new_rows)

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "_rows"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__ |= state
        self._bind()

    @abstractmethod
    def load_prior(self, force_walk: float) -> list[StatePart]:
        """The load before anything is measured."""

    @abstractmethod
    def start(self, states: Array, tension: float) -> tuple[Solution, Array]:
        """Equilibria before the load acts, one or R, and the derivatives of their lengths by the load, (R, m, L).

        tension: of all tendons [N].
        """

    @abstractmethod
    def load_tables(self, states: Array) -> Array:
        """Load tables, (R, rows, columns)."""

    @abstractmethod
    def _fill_levers(self, equilibria: Any, states: Array, levers: Levers) -> None:
        """Fill the levers at equilibria under states."""

    @abstractmethod
    def _link_angles(self, equilibria: Any) -> Array:
        """Those that pictures may show, (R, J) [rad]."""

    def predict(self, states: Array, play: Play, starts: Array) -> Prediction:
        """The model under states (R, states) and where tendons are in their play, from angles (R, J) [rad]."""
        at, rows = self.places, self._rows(len(states))
        stiffnesses = self.mechanism.stiffnesses * np.exp(states[:, at.stiffnesses : at.bias])
        law = TendonLaw(play.played + states[:, at.offsets : at.stiffnesses], stiffnesses, rows.low, rows.high)
        tables = self.load_tables(states)
        equilibria = solve_batch(type(self.mechanism), self.mechanism, rows.chain, rows.designs, law, tables, starts)
        solved, linear = solved_of(equilibria), self._new_linear(len(states))
        kernels.linearise(solved, self.levers(equilibria, states), play, stiffnesses, at, linear)
        return Prediction(equilibria, self._link_angles(equilibria), solved, linear)

    def levers(self, equilibria: Any, states: Array) -> Levers:
        """The levers at equilibria under states (R, states)."""
        count, n_joints = equilibria.joint_angles.shape
        levers = Levers(np.empty((count, n_joints, self.N_LOAD)), np.empty((count, equilibria.tip.shape[1], n_joints)))
        self._fill_levers(equilibria, states, levers)
        return levers

    def _new_linear(self, count: int) -> Derivatives:
        n, d = self.places.total, self.places.half_widths - self.places.bias
        return Derivatives(*(np.empty((count, size, n)) for size in (self.n_angles, self.n_tendons, d)))

    def _new_rows(self, count: int) -> SharedRows:
        chain, designs = designs_of(self.mechanism, count)
        low, high = (np.full((count, self.n_tendons), limit) for limit in self._tension_range)
        return SharedRows(chain, designs, np.tile(self._links, count // len(self._links)), low, high)


@dataclass(frozen=True)
class SharedRows:
    """Arguments of the solver that all batches of equal size share."""

    chain: Any
    designs: NDArray[np.int64]
    links: NDArray[np.int64]
    low: Array
    high: Array


def solved_of(equilibria: Any) -> ModelEquilibria:
    """Equilibria as the kernels take them."""
    valid, tips = np.asarray(equilibria.ok), np.array(equilibria.tip)  # of one kind for all chains: compiled once
    rates, elastic, tensions = equilibria.tendon_rates, equilibria.tendon_stiffness, equilibria.tensions
    return ModelEquilibria(valid, equilibria.free_joints, equilibria.stiffness, rates, elastic, tensions, tips)


def process_part(size: int, sd: float, settings: Any, walk: float, bounds: tuple[float, float]) -> StatePart:
    """A load about its mean that stays, or follows a process of the task.

    Args:
        size: how many numbers it has. sd: their standard deviation.
        settings: of the process: LoadSettings.
        walk: how far a constant load is taken to drift in a step, as a share of its standard deviation.
        bounds: of every number.
    """
    if settings.process == "ou":
        memory = math.exp(-1.0 / settings.correlation_steps)
        return StatePart(size, 0.0, sd, memory, sd * math.sqrt(1.0 - memory**2), bounds)
    jumps = 2.0 / settings.hold_steps if settings.process == "step" else 0.0
    return StatePart(size, 0.0, sd, 1.0, sd * math.hypot(walk, math.sqrt(jumps)), bounds)
