"""A trained policy as a Controller."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from agents.build import algorithm_class, load_normaliser
from agents.controller import Seen
from agents.run_folder import RunFolder, RunFolderError
from rj_gym.core.tracking_task import TrackingTask as Task

if TYPE_CHECKING:
    from stable_baselines3.common.base_class import BaseAlgorithm


class Policy:
    """The trained policy: its mean action in every step, observations normalised as in training."""

    def __init__(self, model: BaseAlgorithm, normaliser: Any = None) -> None:
        self.model, self.normaliser = model, normaliser

    @classmethod
    def load(cls, run: RunFolder, which: str = "best") -> Policy:
        """The policy saved in a run folder; raises RunFolderError if it is not there."""
        import torch

        config = run.config()
        torch.set_num_threads(config.torch_threads)
        policy, normaliser = run.policy_files(which)
        if not policy.is_file():
            raise RunFolderError("policy", str(policy), "a saved policy", "Has the training run got that far?")
        return cls(algorithm_class(config.algorithm).load(policy, device="cpu"), load_normaliser(normaliser))

    def begin(self, task: Task | None, lanes: int) -> None:
        """Nothing to prepare: the policy has no memory."""

    def act(self, seen: Seen) -> NDArray[Any]:
        """The policy's mean actions, (B, m)."""
        observation = seen.observation
        if self.normaliser is not None:
            observation = self.normaliser.normalize_obs(observation)
        return self.model.predict(observation, deterministic=True)[0]
