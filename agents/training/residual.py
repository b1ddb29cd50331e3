"""The environment of a residual policy: observations show a controller's outputs, and actions add to its actions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn

from agents.controllers.residual import BaseController, together, with_outputs

Rows = NDArray[np.int64]
Vectors = NDArray[np.float32]


@dataclass
class _Together:
    """Lanes with episodes that began in the same step, and the controller that began with them.

    Args:
        lanes: where its episodes run or ran.
        running: which of them still do.
        seen: all observations since its episodes began.
    """

    base: BaseController
    lanes: Rows
    running: NDArray[np.bool_]
    seen: list[Vectors]

    def outputs(self, vectors: Vectors) -> NDArray[Any]:
        """The controller's outputs for observations of its lanes."""
        self.seen.append(vectors)
        return self.base.outputs(vectors)


class ResidualVecEnv(VecEnvWrapper):
    """A vector environment with actions added to a controller's, and with the controller's outputs observed.

    Controllers begin many episodes at a time, so those that begin in the same step share one. That is usually all of
    them: they are equally long unless one fails. A controller sees its episodes to their end, the terminal observation
    included.

    Args:
        venv: tracking environments of rj_gym; not with goals.
        new_base: makes a controller with `size` outputs.
    """

    def __init__(self, venv: VecEnv, new_base: Callable[[], BaseController], size: int) -> None:
        super().__init__(venv, _with_room(venv.observation_space, size))
        self._new_base, self._task = new_base, venv.get_attr("task", [0])[0]
        self._groups: list[_Together] = []
        self._outputs = np.zeros((venv.num_envs, size))

    def new_base(self) -> BaseController:
        """A new controller, for learners that play episodes of the environments themselves."""
        base = self._new_base()
        base.bind(self._task)
        return base

    def reset(self) -> VecEnvObs:
        """First observations of all lanes."""
        observations = self.venv.reset()
        self._groups = []
        self._begin(np.arange(self.num_envs), _vectors(observations))
        return with_outputs(observations, self._outputs)

    def step_async(self, actions: NDArray[Any]) -> None:
        """Begin a step with the sum of the controller's and the given actions."""
        self.venv.step_async(together(self._outputs, actions))

    def step_wait(self) -> VecEnvStepReturn:
        """Observations, rewards, dones and infos of all lanes."""
        observations, rewards, dones, infos = self.venv.step_wait()
        ended, vectors = np.flatnonzero(dones), _vectors(observations)
        reached = vectors.copy()
        for lane in ended:
            reached[lane] = _vectors(infos[lane]["terminal_observation"])
        self._go_on(reached)
        for lane in ended:
            infos[lane]["terminal_observation"] = with_outputs(infos[lane]["terminal_observation"], self._outputs[lane])
        if len(ended):
            self._end(ended)
            self._begin(ended, vectors)
        return with_outputs(observations, self._outputs), rewards, dones, infos

    def get_state(self) -> dict[str, Any]:
        """The observations of all controllers, and their outputs, in plain values and arrays."""
        groups = [{"lanes": group.lanes, "running": group.running, "seen": group.seen} for group in self._groups]
        return {"groups": groups, "advice": self._outputs}

    def set_state(self, state: Any) -> None:
        """Continue from a state of `get_state`: new controllers receive the same observations again."""
        self._groups, self._outputs = [], state["advice"].copy()
        for saved in state["groups"]:
            group = _Together(self.new_base(), saved["lanes"], saved["running"], [])
            group.base.reset(np.ones(len(group.lanes), bool))
            for vectors in saved["seen"]:
                group.outputs(vectors)
            self._groups.append(group)

    def _begin(self, lanes: Rows, vectors: Vectors) -> None:
        """Episodes begin in these lanes."""
        base = self.new_base()
        base.reset(np.ones(len(lanes), bool))
        self._groups.append(group := _Together(base, lanes, np.ones(len(lanes), bool), []))
        self._outputs[lanes] = group.outputs(vectors[lanes])

    def _go_on(self, vectors: Vectors) -> None:
        """Outputs of all controllers for the observations that their episodes have reached."""
        for group in self._groups:
            outputs = group.outputs(vectors[group.lanes])
            self._outputs[group.lanes[group.running]] = outputs[group.running]

    def _end(self, lanes: Rows) -> None:
        """The episodes in these lanes are over."""
        for group in self._groups:
            group.running &= ~np.isin(group.lanes, lanes)
        self._groups = [group for group in self._groups if group.running.any()]


def _vectors(observations: Any) -> Vectors:
    """The vectors that controllers see, of an observation that may also have the privileged state."""
    vectors: Vectors = observations["observation"] if isinstance(observations, dict) else observations
    return vectors


def _with_room(space: spaces.Space[Any], size: int) -> spaces.Space[Any]:
    """The space of observations with this number of outputs of a controller."""
    if isinstance(space, spaces.Dict):
        return spaces.Dict({**space.spaces, "observation": _with_room(space["observation"], size)})
    assert isinstance(space, spaces.Box)
    room = np.full(size, np.inf, np.float32)
    return spaces.Box(np.append(space.low, -room), np.append(space.high, room), dtype=np.float32)
