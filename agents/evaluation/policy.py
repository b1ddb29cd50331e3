"""The policy of a run folder as a controller."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from agents.evaluation.controller import Seen
from agents.runs.algorithms import algorithm_class, schedules
from agents.runs.files import RunFolderError, check_as_written
from agents.runs.folder import RunFolder
from rj_gym.core.tracking_task import TrackingTask

if TYPE_CHECKING:
    from stable_baselines3.common.base_class import BaseAlgorithm


class Policy:
    """The trained policy: its mean action in every step, observations normalised as in training."""

    def __init__(self, model: BaseAlgorithm, normaliser: Any = None) -> None:
        self.model, self.normaliser = model, normaliser

    @classmethod
    def load(cls, run: RunFolder, which: str = "best") -> Policy:
        """The policy saved in a run folder; raises RunFolderError if it is not there or cannot be read."""
        import torch

        config = run.config()
        torch.set_num_threads(config.torch_threads)
        policy, normaliser = run.policy_files(which)
        if not policy.is_file():
            raise RunFolderError("policy", str(policy), "a saved policy", "Has the training run got that far?")
        check_as_written(policy, normaliser)
        objects = {"lr_schedule": None, **schedules(config.parameters)}  # whose classes may have moved since
        try:
            model = algorithm_class(config.algorithm).load(policy, device="cpu", custom_objects=objects)
            return cls(model, _load_normaliser(normaliser))
        except Exception as error:  # whatever SB3, torch and pickle make of a damaged file
            allowed = "files that can be read: a zip that Stable-Baselines3 can load, its normaliser"
            raise RunFolderError("policy", str(policy), allowed, repr(error)) from error

    def begin(self, task: TrackingTask | None, episodes: int) -> None:
        """Nothing to prepare: the policy has no memory."""

    def act(self, seen: Seen) -> NDArray[Any]:
        """The policy's mean actions, (B, m)."""
        observation = seen.observation
        if self.normaliser is not None:
            observation = self.normaliser.normalize_obs(observation)
        return self.model.predict(observation, deterministic=True)[0]


def _load_normaliser(path: Path) -> Any:
    """The VecNormalize saved at `path`, frozen, without environments; None if the run does not normalise."""
    if not path.is_file():
        return None
    with path.open("rb") as stream:
        normaliser = pickle.load(stream)
    normaliser.training = False
    return normaliser
