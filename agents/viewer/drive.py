"""One controller in one episode, step by step, and the film of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from agents.controllers.controller import Array, Controller, Mask, as_controller, env_for, restarted
from agents.evaluation.rollout import LAST_STEPS
from agents.runs.environment import EnvConfig, make_vector_env
from rj_gym.tracking.render import TrackingScene
from rollingjoint.errors import InvalidInput


@dataclass
class Film:
    """Scenes, errors and actions of an episode under one controller; of a running one until now.

    Args:
        name: of the controller. env: a tracking environment. seed: of its reset.
        scenes: at the start and after every step.
        errors: distance of the tip from the target at the start and after every step [mm].
        actions: (m,) each, within the bounds of the space, one per step.
        ended: whether the environment ended the episode early.
    """

    name: str
    env: EnvConfig
    seed: int
    scenes: list[TrackingScene] = field(default_factory=list)
    errors: list[float] = field(default_factory=list)
    actions: list[NDArray[np.float32]] = field(default_factory=list)
    ended: bool = False

    @property
    def steps(self) -> int:
        """Steps taken."""
        return len(self.actions)

    @property
    def last_10_mm(self) -> float:
        """Mean error after the last 10 steps [mm], which controllers are compared by; NaN before the first step."""
        return float(np.mean(self.errors[1:][-LAST_STEPS:])) if self.actions else float("nan")

    def at(self, step: int) -> TrackingScene:
        """The scene after this many steps; the last one where the episode has fewer."""
        return self.scenes[min(step, self.steps)]

    def trail(self, step: int) -> Array:
        """The positions of the tip until then, (K, d) [mm]."""
        return np.array([scene.tip for scene in self.scenes[: step + 1]])


class Drive:
    """A controller in the episode that its environment begins with reset(seed=seed), one step at a time.

    Args:
        name: of the controller. env: a tracking environment of rj_gym.
    Raises:
        RollingJointError: an environment that cannot be made, or a controller that cannot act in it.
    """

    def __init__(self, name: str, env: EnvConfig, controller: Controller, seed: int) -> None:
        if not env.is_built_in_tracking:
            raise InvalidInput("environment", env.id, "a tracking environment of rj_gym")
        self.film, self.controller, self.over = Film(name, env, seed), as_controller(controller), False
        self._envs = cast(Any, make_vector_env(env_for(env, controller), 1))
        self._observation, info = self._envs.reset(seed=[seed])
        self.controller.begin(self._envs.task, 1)
        self._see(info)

    @property
    def task(self) -> Any:
        """The tracking task."""
        return self._envs.task

    def step(self) -> None:
        """One step of the controller; without effect after the end of the episode.

        Raises:
            RollingJointError: a controller that cannot act on the observation.
        """
        if self.over:
            return
        space = self._envs.single_action_space
        command = np.asarray(self.controller.act(self._observation), np.float32)
        action = np.clip(command, space.low, space.high)
        self._observation, _, (ended,), (truncated,), info = self._envs.step(action)
        self.film.actions.append(action[0])
        self.film.ended, self.over = bool(ended), bool(ended or truncated)
        self._see(info)

    def close(self) -> None:
        """Free the environment."""
        self._envs.close()

    def _see(self, info: Any) -> None:
        self.film.scenes.append(self._envs.scene())
        self.film.errors.append(float(info["error_mm"][0]))


def filmed(name: str, env: EnvConfig, controller: Controller, seed: int) -> Film:
    """The whole episode under a controller; raises RollingJointError as Drive does."""
    drive = Drive(name, env, controller, seed)
    while not drive.over:
        drive.step()
    drive.close()
    return drive.film


class Repeated(Controller):
    """Repeats the actions of a recorded episode; after its end, the last one.

    Args:
        actions: (T, m), of one episode.
    """

    def __init__(self, actions: Sequence[NDArray[np.float32]] | NDArray[np.float32]) -> None:
        self.actions, self.steps = np.asarray(actions, np.float32), np.empty(0)

    def reset(self, mask: Mask) -> None:
        """Return to the first action; raises InvalidInput unless there is one number per tendon."""
        if self.actions.shape[1] != self.task.action_size:
            raise InvalidInput("numbers per action", self.actions.shape[1], f"{self.task.action_size}, one per tendon")
        self.steps = restarted(self.steps, mask, np.zeros(len(mask)))

    def act(self, observations: Any) -> NDArray[Any]:
        """The recorded actions of this step, (B, m)."""
        actions = self.actions[np.minimum(self.steps, len(self.actions) - 1).astype(int)]
        self.steps = self.steps + 1.0
        return actions
