"""A model of Stable-Baselines3 as a controller."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from agents.evaluation.controller import Seen
from agents.runs.config import PRIVILEGED
from rj_gym.tracking.task import TrackingTask

if TYPE_CHECKING:
    from stable_baselines3.common.base_class import BaseAlgorithm


class Policy:
    """The policy of a model: its mean action in every step, observations normalised as in training."""

    def __init__(self, model: BaseAlgorithm, normaliser: Any = None) -> None:
        self.model, self.normaliser = model, normaliser
        self._carried: dict[str, Any] = {}  # the state of a model with memory, from its second step on

    def begin(self, task: TrackingTask | None, episodes: int) -> None:
        """Episodes begin: a model with memory forgets those before."""
        self._carried = {}

    def act(self, seen: Seen) -> NDArray[Any]:
        """The policy's mean actions, (B, m)."""
        observation = model_input(self.model, self.normaliser, seen.observation)
        action, state = self.model.predict(observation, deterministic=True, **self._carried)
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
