"""A controller as the teacher of a distillation."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from numpy.typing import NDArray

from agents.controllers.residual import advice_size, controllers_in
from agents.evaluation.controller import Controller, Seen
from agents.runs.environment import EnvConfig
from rj_gym.core.vector import TaskVectorEnv


class ControllerTeacher:
    """A Demonstrator: a controller that sees what the policy sees, and carries its own model of the mechanism along.

    Args:
        controller: a baseline, or a tuned opponent of the environment.
    """

    def __init__(self, controller: Controller) -> None:
        self.controller = controller

    @classmethod
    def named(cls, name: str, env: EnvConfig) -> ControllerTeacher:
        """That with the controller of this name; ConfigError where there is none that can act in the environment."""
        advice_size(name, env, "parameters.teacher")
        return cls(controllers_in(env.id)[name])

    def begin(self, env: TaskVectorEnv) -> None:
        """Episodes of all lanes begin."""
        self.controller.begin(env.task, env.num_envs)

    def demonstrate(self, env: TaskVectorEnv, observation: Any, info: Mapping[str, Any]) -> NDArray[Any]:
        """What the controller does after this observation, (B, m) in [-1, 1]."""
        return self.controller.act(Seen(observation, env.task)).clip(-1.0, 1.0)
