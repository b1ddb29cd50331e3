"""A controller as the teacher of a distillation."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from numpy.typing import NDArray

from agents.controllers.controller import Controller, saturated
from agents.controllers.residual import controllers_in, output_size
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
        output_size(name, env, "parameters.teacher")
        return cls(controllers_in(env.id)[name])

    def begin(self, env: TaskVectorEnv) -> None:
        """Episodes of all lanes begin."""
        self.controller.begin(env.task, env.num_envs)

    def demonstrate(self, env: TaskVectorEnv, observation: Any, info: Mapping[str, Any]) -> NDArray[Any]:
        """What the controller does after this observation, (B, m) in [-1, 1]."""
        return saturated(self.controller.act(observation))
