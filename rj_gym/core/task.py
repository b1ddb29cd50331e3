"""The interface of a task, as environments see it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rj_gym.core.columns import STATUS
from rj_gym.core.generators import Random
from rj_gym.core.info import every_lane
from rollingjoint.chain.status import Status
from rollingjoint.errors import ConfigError

Array = NDArray[np.float64]

POSITION_BOUND = 2.0
"""Largest coordinate of an observed position, in lengths of the mechanism."""


class Entry(NamedTuple):
    """One number of the observation: its name, its unit in words, and its bounds."""

    name: str
    unit: str
    low: float
    high: float


class ObservedError(NamedTuple):
    """Where an observation vector has the tip error, target minus measured tip.

    Args:
        places: of its coordinates among the entries. unit_mm: of these entries [mm].
    """

    places: tuple[int, ...]
    unit_mm: float


class Task(ABC):
    """The task of an environment of one configuration; no method changes it.

    Readings are the numbers that rewards and infos are made of, (B, columns); the first columns are in
    rj_gym/core/columns.py.

    Attributes:
        config: its settings. length: of the mechanism [mm].
        action_size: numbers of an action.
        dimension: number of coordinates of the position that pictures trace; 0 where they trace none.
        last_status: the largest status with which an episode continues.
        own_ends: whether episodes may end for a reason besides their status.
        observes_truth: whether observations are a Dict with the privileged state of a tracking task.
    """

    dimension: ClassVar[int] = 0
    last_status: ClassVar[int] = int(Status.AT_LIMIT)
    observes_truth: bool = False
    own_ends: bool = False
    config: Any
    length: float
    action_size: int

    @abstractmethod
    def entries(self, goal: bool = False) -> list[Entry]:
        """The entries of the observation vector; `goal` leaves out target and errors."""

    @abstractmethod
    def sample(self, rngs: Random, fixed: Any = None) -> Any:
        """One episode per generator."""

    @abstractmethod
    def checked_options(self, options: Mapping[str, Any] | None) -> Any:
        """Values that the options of a reset fix; raises InvalidInput for options that cannot be used."""

    @abstractmethod
    def state_info(self, readings: Array) -> dict[str, Any]:
        """Entries of info in every step, arrays (B, ...): parts of the readings, and copies."""

    def terminated(self, readings: Array) -> NDArray[np.bool_]:
        """Which episodes have terminated, (B,), from readings (B, columns)."""
        ended: NDArray[np.bool_] = readings[:, STATUS] > self.last_status
        return ended

    @abstractmethod
    def reward_info(self, readings: Array) -> dict[str, Array]:
        """The terms of the reward, (B,) each: parts of the readings."""

    def single_info(self, readings: Array, numbers: list[float]) -> dict[str, Any]:
        """state_info and reward_info of one lane: Python numbers, `numbers`, and parts of its readings (columns,)."""
        row = readings[None]
        (info,) = every_lane(self.state_info(row) | {"reward_terms": self.reward_info(row)}, [0])
        return info

    def observed_error(self, goal: bool = False) -> ObservedError:
        """Where the observation vector has the tip error; raises ConfigError where it does not have it."""
        raise ConfigError("tip error", "not observed", "a tracking environment", "Only there a tip has an error.")

    def observation_bounds(self, goal: bool = False) -> tuple[Array, Array]:
        """Lowest and highest value of every observation entry, (entries,) each."""
        entries = self.entries(goal)
        return np.array([entry.low for entry in entries]), np.array([entry.high for entry in entries])
