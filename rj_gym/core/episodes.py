"""The interface of an episode buffer: running episodes of a task side by side, one lane each."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rj_gym.core.generators import Random
from rj_gym.core.task import Task
from rollingjoint.checks import as_floats
from rollingjoint.errors import InvalidInput

Array = NDArray[np.float64]
Rows = NDArray[np.int64]
Observation = NDArray[np.float32]

NO_ROWS: Rows = np.zeros(0, np.int64)


class EpisodeBuffer(ABC):
    """Room for B episodes of a task, in arrays that are kept from step to step; a scalar environment has one lane.

    Every call changes the arrays: copy their parts before you keep them.

    Args:
        task: the task.
        capacity: B.
        goal: whether observations leave out target and errors.
    """

    readings: Array  # (B, columns), see Task
    task: Any

    def __init__(self, task: Task, capacity: int, goal: bool = False) -> None:
        self.task, self.capacity, self.goal = task, capacity, goal
        self._actions = np.zeros((capacity, task.action_size))

    def accept(self, actions: ArrayLike) -> None:
        """Keep actions, (B, m), for `advance`.

        Raises:
            InvalidInput: actions that are not finite numbers of that shape; the state is unchanged then.
        """
        self._accept("actions", actions, self._actions)
        if not self._finite():
            raise InvalidInput("actions", actions, self._allowed(self._actions.shape))

    @abstractmethod
    def advance(self, ended: Rows = NO_ROWS) -> Observation:
        """One step of all lanes with the accepted actions; fresh observations, (B, entries).

        Lanes that have `ended` restart next: whether they step as well makes no difference.
        """

    def step_alone(self, action: ArrayLike) -> tuple[Observation, Array]:
        """One step of the only lane, with an action (m,): its observation, (entries,), and readings, (columns,), fresh.

        Raises as `accept`.
        """
        self._accept("action", action, self._actions[0])
        if not self._finite():
            raise InvalidInput("action", action, self._allowed(self._actions[0].shape))
        return self.advance()[0], self.readings[0].copy()

    @abstractmethod
    def restart(self, rows: Rows, rngs: Random, fixed: Any = None) -> tuple[dict[str, Any], Observation]:
        """New episodes in these lanes, one per generator: info["sampled"], and observations (len(rows), entries)."""

    def tangent(self) -> Any:
        """How the last step answers its actions; raises InvalidInput for tasks of design, which have no such answer."""
        raise InvalidInput("task", type(self.task).__name__, "a tracking task, or one among walls")

    @abstractmethod
    def observe(self) -> Observation:
        """The current observations of all lanes, (B, entries)."""

    @abstractmethod
    def get_state(self) -> dict[str, Any]:
        """Everything that later steps depend on, copied: plain values and arrays."""

    @abstractmethod
    def set_state(self, state: Any) -> None:
        """Continue from a state of `get_state`; raises InvalidInput, and keeps its state, if it does not fit."""

    @abstractmethod
    def scene(self, trail: Array, lane: int = 0) -> Any:
        """The scene of one lane's picture; trail (steps, dimension) [mm] is where its tip has been."""

    @abstractmethod
    def renderer(self) -> Any:
        """A renderer of the scenes."""

    @abstractmethod
    def _allowed(self, shape: tuple[int, ...]) -> str:
        """Allowed actions in words, for messages."""

    def _finite(self) -> bool:
        """Whether all actions are finite."""
        return bool(np.isfinite(self._actions).all())

    def _accept(self, what: str, actions: ArrayLike, place: Array) -> None:
        """Put actions of the right shape into their place.

        Raises:
            InvalidInput: others.
        """
        if isinstance(actions, np.ndarray) and actions.dtype.kind == "f":
            values: NDArray[Any] = actions
        else:
            values = as_floats(what, actions, self._allowed(place.shape))
        if values.shape != place.shape:
            raise InvalidInput(what, actions, self._allowed(place.shape))
        place[...] = values
