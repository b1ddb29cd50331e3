"""A model of Stable-Baselines3 as a controller."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from agents.controllers.controller import Controller, Mask, plain
from agents.runs.config import PRIVILEGED

if TYPE_CHECKING:
    from stable_baselines3.common.base_class import BaseAlgorithm


class Policy(Controller):
    """The policy of a model: its mean action in every step, observations normalised as in training."""

    one_mechanism = False

    def __init__(self, model: BaseAlgorithm, normaliser: Any = None) -> None:
        self.model, self.normaliser = model, normaliser
        self._carried: dict[str, Any] = {}  # the state of a model with memory, from its second step on

    def reset(self, mask: Mask) -> None:
        """Begin episodes, (B,): a model with memory forgets those before."""
        self._carried = {} if mask.all() or not self._carried else self._carried | {"episode_start": mask}

    def act(self, observations: Any) -> NDArray[Any]:
        """The policy's mean actions, (B, m)."""
        normal = model_input(self.model, self.normaliser, plain(observations))
        action, state = self.model.predict(normal, deterministic=True, **self._carried)
        if state is not None:
            self._carried = {"state": state}
        return action


def model_input(model: Any, normaliser: Any, observation: Any) -> Any:
    """An observation as the model takes it: normalised, if it was in training.

    Where its critic saw the privileged state, that is filled with zeros, at which the policy does not look.
    """
    space = getattr(model, "observation_space", None)
    if isinstance(space, spaces.Dict) and PRIVILEGED in space.spaces and not isinstance(observation, Mapping):
        size = spaces.flatdim(space[PRIVILEGED])
        observation = {"observation": observation, PRIVILEGED: np.zeros((len(observation), size), np.float32)}
    return observation if normaliser is None else normaliser.normalize_obs(observation)
