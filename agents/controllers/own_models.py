"""A controller that computes with the model of one mechanism where every lane has its own: told it, or not."""

from __future__ import annotations

from copy import deepcopy
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.controllers.controller import Array, Controller, Mask


class OwnModels(Controller):
    """Copies of a controller, one for each mechanism that lanes have, each told that mechanism exactly if not Nominal.

    A copy is bound to the task with its mechanism alone, and sees the observations that this gives.

    Args:
        controller: not bound yet. envs: a vector environment with many mechanisms, asked for its designs as episodes
            begin.
    """

    one_mechanism = False

    def __init__(self, controller: Controller, envs: Any) -> None:
        self.controller, self.envs, self.told = controller, envs, not isinstance(controller, Nominal)
        self.privileged, self.wrappers = controller.privileged, controller.wrappers
        self._copies: dict[tuple[Any, tuple[int, ...]], Controller] = {}  # by design and lanes

    def reset(self, mask: Mask) -> None:
        """Begin episodes, (B,): lanes whose mechanism was another one get a new copy, and so do those beside them."""
        lanes: dict[Any, list[int]] = {}
        for lane, design in enumerate(self.envs.designs):
            lanes.setdefault(design, []).append(lane)
        before, self._copies = self._copies, {}
        for design, rows in lanes.items():
            place, begins = (design, tuple(rows)), mask[rows]
            if place in before:
                copy = before[place]
            else:
                copy, begins = deepcopy(self.controller), np.ones(len(rows), bool)
                copy.bind(self.task.own_task(design) if self.told else self.task.plain_task(design.n_links))
            if begins.any():
                copy.reset(begins)
            self._copies[place] = copy

    def act(self, observations: Any) -> Array:
        """The actions of every copy in its lanes, (B, m)."""
        count = len(observations["observation"] if isinstance(observations, dict) else observations)
        actions = np.zeros((count, self.task.action_size))
        for (design, lanes), copy in self._copies.items():
            rows = np.array(lanes)
            actions[rows] = copy.act(self.task.own_observations(_rows(observations, rows), design.n_links))
        return actions


class Nominal(Controller):
    """A controller that is not told the mechanisms of lanes: it takes them for the plain chain with as many links.

    Args:
        controller: not bound yet.
    """

    def __init__(self, controller: Controller) -> None:
        self.controller = controller
        self.privileged, self.wrappers = controller.privileged, controller.wrappers

    def bind(self, task: Any) -> None:
        """Take over the task of one mechanism, which is the plain one."""
        super().bind(task)
        self.controller.bind(task)

    def reset(self, mask: Mask) -> None:
        """Begin episodes, (B,)."""
        self.controller.reset(mask)

    def act(self, observations: Any) -> Array:
        """The actions of the controller, (B, m)."""
        return self.controller.act(observations)


def with_own_models(controller: Controller, envs: Any) -> Controller:
    """The controller, or OwnModels of it where it computes with one mechanism and lanes have different ones."""
    many = getattr(envs, "designs", None) is not None
    return OwnModels(controller, envs) if many and controller.one_mechanism else controller


def _rows(observations: Any, rows: NDArray[np.int64]) -> Any:
    if isinstance(observations, dict):
        return {key: values[rows] for key, values in observations.items()}
    return observations[rows]
