"""Residual policies: a controller acts, and a learned policy adds to its actions.

Source: Johannink et al., Residual Reinforcement Learning for Robot Control, 2019.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from agents.controllers import untuned_controllers
from agents.controllers.controller import Array, Controller, Mask, as_controller, plain, saturated
from agents.controllers.tuned import WORLDS, hint, tuned_controllers, world_of
from agents.runs.config import TrainConfig
from agents.runs.environment import EnvConfig, make_vector_env
from rj_gym.tracking.task import TrackingTask
from rollingjoint.errors import ConfigError, RollingJointError


class BaseController(Controller):
    """A controller as a residual policy needs it, which adds to its actions and sees its outputs.

    Args:
        controller: any; where it has a method `estimates()`, that gives numbers (B, k) which it estimated for its last
            actions, and the policy sees them.
    """

    def __init__(self, controller: Controller) -> None:
        self.controller = as_controller(controller)

    def bind(self, task: TrackingTask | None) -> None:
        """Take over the task."""
        super().bind(task)
        self.controller.bind(task)

    def reset(self, mask: Mask) -> None:
        """Begin episodes, (B,)."""
        self.controller.reset(mask)

    def act(self, observations: Any) -> Array:
        """Its actions, (B, m) in [-1, 1]."""
        return saturated(np.asarray(self.controller.act(observations), float))

    def outputs(self, observations: Any) -> Array:
        """Its actions in [-1, 1], and behind them its estimates, (B, m + k)."""
        actions = self.act(observations)
        estimates = getattr(self.controller, "estimates", None)
        parts = [actions] if estimates is None else [actions, estimates()]
        return np.concatenate(parts, axis=1)


def controllers_in(world: str) -> dict[str, Controller]:
    """New controllers by name that can act in this world without training: untuned and tuned ones."""
    return untuned_controllers() | (tuned_controllers(world) if world in WORLDS else {})


def base_controller(name: str, world: str, key: str = "residual") -> BaseController:
    """A new one of the controller that has this name in this world, as agents.controllers.tuned.world_of names it.

    Raises:
        ConfigError: no such controller; `key` is its name in the message.
    """
    controllers = controllers_in(world)
    if name not in controllers:
        raise ConfigError(key, name, f"null, or one of {', '.join(controllers)}", hint(name, controllers))
    return BaseController(controllers[name])


def output_size(name: str, env: EnvConfig, key: str = "residual") -> int:
    """How many numbers the controller of this name outputs in this environment, found by letting it act.

    Raises:
        ConfigError: no such controller, or one that cannot act on these observations; `key` is its name in the
            message.
    """
    base, envs = base_controller(name, world_of(env), key), cast(Any, make_vector_env(env, 1))
    try:
        base.begin(envs.task, 1)
        return base.outputs(envs.reset(seed=0)[0]).shape[1]
    except (LookupError, RollingJointError) as error:
        allowed = f"null, or a controller that can act on what {env.id} shows"
        raise ConfigError(key, name, allowed, f"{type(error).__name__}: {error}") from error
    finally:
        envs.close()


class ResidualPolicy(Controller):
    """A controller, and a policy that sees its outputs and adds to its actions."""

    def __init__(self, base: BaseController, policy: Controller) -> None:
        self.base, self.policy = base, as_controller(policy)

    def bind(self, task: TrackingTask | None) -> None:
        """Take over the task."""
        super().bind(task)
        self.base.bind(task)
        self.policy.bind(task)

    def reset(self, mask: Mask) -> None:
        """Begin episodes, (B,), in both."""
        self.base.reset(mask)
        self.policy.reset(mask)

    def act(self, observations: Any) -> NDArray[Any]:
        """The actions of both together, (B, m) in [-1, 1]."""
        outputs = self.base.outputs(observations)
        return together(outputs, self.policy.act(with_outputs(plain(observations), outputs)))


def with_outputs(observation: Any, outputs: Array) -> Any:
    """The observation (..., n) with the outputs (..., m + k) behind it; of one in parts, behind "observation"."""
    if isinstance(observation, Mapping):
        return {**observation, "observation": with_outputs(observation["observation"], outputs)}
    return np.concatenate([observation, outputs], axis=-1, dtype=np.float32)


def together(outputs: Array, added: NDArray[Any]) -> NDArray[Any]:
    """The actions in a controller's outputs and those that the policy adds, (B, m) in [-1, 1]."""
    return saturated(outputs[:, : added.shape[1]] + added)


def controller_of(config: TrainConfig, policy: Controller) -> Controller:
    """The policy of a run as the controller that it is: alone, or on top of another controller."""
    policy.wrappers = config.policy_wrappers
    if config.residual is None:
        return policy
    return ResidualPolicy(base_controller(config.residual, world_of(config.env)), policy)
