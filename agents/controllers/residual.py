"""Residual policies: a controller acts, and a learned policy adds to its actions.

Source: Johannink et al., Residual Reinforcement Learning for Robot Control, 2019.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from agents.controllers import baselines
from agents.controllers.opponents import WORLDS, opponents
from agents.evaluation.controller import Array, Controller, Seen
from agents.runs.config import TrainConfig
from agents.runs.environment import EnvConfig, make_vector_env
from rj_gym.core.tracking_task import TrackingTask
from rollingjoint.checks import suggestion
from rollingjoint.errors import ConfigError, RollingJointError


class Guide:
    """A controller as a residual policy needs it: what it does, and what it lets the policy know.

    Args:
        controller: any; where it has a method `estimates()`, that gives numbers (B, k) which it estimated for its last
            actions, and the policy sees them.
    """

    def __init__(self, controller: Controller) -> None:
        self.controller = controller

    def begin(self, task: TrackingTask, episodes: int) -> None:
        """This many episodes begin together."""
        self.controller.begin(task, episodes)

    def advise(self, seen: Seen) -> Array:
        """Its actions in [-1, 1], and behind them its estimates, (B, m + k)."""
        actions = np.clip(np.asarray(self.controller.act(seen), float), -1.0, 1.0)
        estimates = getattr(self.controller, "estimates", None)
        parts = [actions] if estimates is None else [actions, estimates()]
        return np.concatenate(parts, axis=1)


def controllers_in(env_id: str) -> dict[str, Controller]:
    """New controllers by name, of which one can be the guide in this environment: baselines, tuned opponents."""
    return baselines() | (opponents(env_id) if env_id in WORLDS else {})


def guide_named(name: str, env_id: str, key: str = "residual") -> Guide:
    """A new guide with the controller that has this name in this environment.

    Raises:
        ConfigError: no such controller; `key` is what the message calls it.
    """
    known = controllers_in(env_id)
    if name not in known:
        raise ConfigError(key, name, f"null, or one of {', '.join(known)}", suggestion(name, list(known)))
    return Guide(known[name])


def advice_size(name: str, env: EnvConfig, key: str = "residual") -> int:
    """How many numbers the advice of the controller of this name has in this environment, found by asking for it.

    Raises:
        ConfigError: no such controller, or one that cannot act on what this environment shows; `key` is what the
            message calls it.
    """
    guide, envs = guide_named(name, env.id, key), cast(Any, make_vector_env(env, 1))
    try:
        guide.begin(envs.task, 1)
        return guide.advise(Seen(envs.reset(seed=0)[0], envs.task)).shape[1]
    except (LookupError, RollingJointError) as error:
        allowed = f"null, or a controller that can act on what {env.id} shows"
        raise ConfigError(key, name, allowed, f"{type(error).__name__}: {error}") from error
    finally:
        envs.close()


class ResidualPolicy:
    """A Controller: a guide, and a policy that sees its advice and adds to its actions."""

    def __init__(self, guide: Guide, policy: Controller) -> None:
        self.guide, self.policy = guide, policy

    def begin(self, task: TrackingTask, episodes: int) -> None:
        """This many episodes begin together."""
        self.guide.begin(task, episodes)
        self.policy.begin(task, episodes)

    def act(self, seen: Seen) -> NDArray[Any]:
        """The actions of both together, (B, m) in [-1, 1]."""
        advice = self.guide.advise(seen)
        added = self.policy.act(replace(seen, observation=with_advice(seen.observation, advice)))
        return together(advice, added)


def with_advice(observation: Any, advice: Array) -> Any:
    """The observation (..., entries) with the advice (..., m + k) behind it; of one in parts, behind "observation"."""
    if isinstance(observation, Mapping):
        return {**observation, "observation": with_advice(observation["observation"], advice)}
    return np.concatenate([observation, advice], axis=-1, dtype=np.float32)


def together(advice: Array, added: NDArray[Any]) -> NDArray[Any]:
    """The advised actions and those that the policy adds, (B, m) in [-1, 1]."""
    actions: NDArray[Any] = np.clip(advice[:, : added.shape[1]] + added, -1.0, 1.0)
    return actions


def driving(config: TrainConfig, policy: Controller) -> Controller:
    """The policy of a run as the controller that it is: alone, or on top of a guide."""
    return policy if config.residual is None else ResidualPolicy(guide_named(config.residual, config.env.id), policy)
