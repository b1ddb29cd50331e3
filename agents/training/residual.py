"""The environment of a residual policy: its observation has a controller's advice, and actions add to that."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn

from agents.controllers.residual import Guide, together, with_advice
from agents.evaluation.controller import Seen
from rj_gym.core.tracking_task import TrackingTask

Rows = NDArray[np.int64]
Vectors = NDArray[np.float32]


class GuideOfAll:
    """A guide of all lanes, which begin together, as learners that play whole episodes ask it for advice.

    Args:
        guide: that. task: of the environment.
    """

    def __init__(self, guide: Guide, task: TrackingTask) -> None:
        self.guide, self.task = guide, task

    def begin(self, episodes: int) -> None:
        """This many episodes begin together."""
        self.guide.begin(self.task, episodes)

    def advise(self, observation: NDArray[np.float32]) -> NDArray[Any]:
        """Its actions in [-1, 1], and behind them its estimates, (B, m + k)."""
        return self.guide.advise(Seen(observation, self.task))


@dataclass
class _Together:
    """Lanes whose episodes began in the same step, and the guide that began with them.

    Args:
        lanes: where its episodes run or ran.
        running: which of them still do.
        seen: all observations since its episodes began.
    """

    guide: Guide
    lanes: Rows
    running: NDArray[np.bool_]
    seen: list[Vectors]

    def advise(self, vectors: Vectors, task: TrackingTask) -> NDArray[Any]:
        """The guide's advice on observations of its lanes."""
        self.seen.append(vectors)
        return self.guide.advise(Seen(vectors, task))


class AdvisedVecEnv(VecEnvWrapper):
    """A vector environment whose actions are added to those of a controller, whose advice is observed.

    Controllers begin many episodes at a time, so those that begin in the same step share one. That is usually all of
    them: they are equally long unless one fails. A controller sees its episodes to their end, the terminal observation
    included.

    Args:
        venv: tracking environments of rj_gym; not with goals.
        new_guide: makes a guide, which always gives `size` numbers.
    """

    def __init__(self, venv: VecEnv, new_guide: Callable[[], Guide], size: int) -> None:
        super().__init__(venv, _with_room(venv.observation_space, size))
        self._new_guide, self._task = new_guide, venv.get_attr("task", [0])[0]
        self._groups: list[_Together] = []
        self._advice = np.zeros((venv.num_envs, size))

    def new_advisor(self) -> GuideOfAll:
        """A new guide, for learners that play episodes of the environments themselves, all of them together."""
        return GuideOfAll(self._new_guide(), self._task)

    def reset(self) -> VecEnvObs:
        """First observations of all lanes."""
        observations = self.venv.reset()
        self._groups = []
        self._begin(np.arange(self.num_envs), _vectors(observations))
        return with_advice(observations, self._advice)

    def step_async(self, actions: NDArray[Any]) -> None:
        """Begin a step with the sum of advised and given actions."""
        self.venv.step_async(together(self._advice, actions))

    def step_wait(self) -> VecEnvStepReturn:
        """Observations, rewards, dones and infos of all lanes."""
        observations, rewards, dones, infos = self.venv.step_wait()
        ended, vectors = np.flatnonzero(dones), _vectors(observations)
        reached = vectors.copy()
        for lane in ended:
            reached[lane] = _vectors(infos[lane]["terminal_observation"])
        self._go_on(reached)
        for lane in ended:
            infos[lane]["terminal_observation"] = with_advice(infos[lane]["terminal_observation"], self._advice[lane])
        if len(ended):
            self._end(ended)
            self._begin(ended, vectors)
        return with_advice(observations, self._advice), rewards, dones, infos

    def get_state(self) -> dict[str, Any]:
        """The observations of all guides, and their advice, in plain values and arrays."""
        kept = [{"lanes": each.lanes, "running": each.running, "seen": each.seen} for each in self._groups]
        return {"groups": kept, "advice": self._advice}

    def set_state(self, state: Any) -> None:
        """Continue from a state of `get_state`: new guides receive the same observations again."""
        self._groups, self._advice = [], state["advice"].copy()
        for kept in state["groups"]:
            group = _Together(self._new_guide(), kept["lanes"], kept["running"], [])
            group.guide.begin(self._task, len(group.lanes))
            for vectors in kept["seen"]:
                group.advise(vectors, self._task)
            self._groups.append(group)

    def _begin(self, lanes: Rows, vectors: Vectors) -> None:
        """Episodes begin in these lanes."""
        guide = self._new_guide()
        guide.begin(self._task, len(lanes))
        self._groups.append(group := _Together(guide, lanes, np.ones(len(lanes), bool), []))
        self._advice[lanes] = group.advise(vectors[lanes], self._task)

    def _go_on(self, vectors: Vectors) -> None:
        """Advice of all guides on what their episodes have come to."""
        for group in self._groups:
            advice = group.advise(vectors[group.lanes], self._task)
            self._advice[group.lanes[group.running]] = advice[group.running]

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
    """The space of observations with so many numbers of advice."""
    if isinstance(space, spaces.Dict):
        return spaces.Dict({**space.spaces, "observation": _with_room(space["observation"], size)})
    assert isinstance(space, spaces.Box)
    room = np.full(size, np.inf, np.float32)
    return spaces.Box(np.append(space.low, -room), np.append(space.high, room), dtype=np.float32)
