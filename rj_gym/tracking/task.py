"""The tracking task of one configuration: its mechanism, its random episodes, its rules as the kernels want them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rj_gym.config import TrackingConfig
from rj_gym.tracking.generators import Generators
from rj_gym.tracking.kernels import Rules
from rj_gym.tracking.observation import POSITION_BOUND, force_scale, observation_entries
from rj_gym.tracking.sampling import NOTHING_FIXED, Episodes, Fixed, Uniforms, sample_episodes, uniform_blocks
from rollingjoint.mechanism_file import load_mechanism
from rollingjoint.rolling_chain import RollingChain

Array = NDArray[np.float64]


class TrackingTask:
    """The tracking task of one configuration; no method changes anything.

    Raises:
        ConfigError, MechanismError: a mechanism that cannot be loaded.
    """

    def __init__(self, config: TrackingConfig) -> None:
        self.config = config
        chosen = config.mechanism
        self.mechanism: RollingChain = load_mechanism(chosen, RollingChain) if isinstance(chosen, str) else chosen
        self.length = float(self.mechanism.length)
        self.neutral_lengths: Array = np.array(self.mechanism.neutral_lengths, dtype=float)
        self._blocks = uniform_blocks(config, self.mechanism)

    def observation_bounds(self, goal: bool = False) -> tuple[Array, Array]:
        """Lowest and highest value of every observation entry, (entries,) each."""
        entries = observation_entries(self.config, self.mechanism, goal)
        return np.array([entry.low for entry in entries]), np.array([entry.high for entry in entries])

    def rules(self, goal: bool = False) -> Rules:
        """The rules; `goal` leaves target and tip error out of the observation."""
        config, reward = self.config, self.config.reward
        return Rules(
            config.action_scale_mm,
            self.length,
            config.command_scale_mm,
            reward.error_scale_mm,
            config.tension_range[1],
            force_scale(config),
            reward.effort,
            reward.smoothness,
            reward.failure_penalty,
            config.observe_tensions,
            not goal,
            config.observe_load,
            self.neutral_lengths,
            *(bound.astype(np.float32) for bound in self.observation_bounds(goal)),
        )

    def sample(self, rngs: Sequence[np.random.Generator] | Generators, fixed: Fixed = NOTHING_FIXED) -> Episodes:
        """One episode per generator; each takes the same count of numbers from its own."""
        return sample_episodes(self.config, self.mechanism, Uniforms(self._blocks, rngs), fixed)

    def goals(self, positions: Array) -> NDArray[np.float32]:
        """Positions (..., 2) [mm] in units of the length, within the bounds of the goal spaces."""
        return np.clip(positions / self.length, -POSITION_BOUND, POSITION_BOUND).astype(np.float32)

    def goal_reward(self, achieved: ArrayLike, desired: ArrayLike) -> Array:
        """Reward of the Goal environment for goals (..., 2), (...)."""
        reward = self.config.reward
        difference = np.asarray(achieved, dtype=float) - np.asarray(desired, dtype=float)
        error = self.length * np.linalg.norm(difference, axis=-1)
        if reward.goal == "sparse":
            return -(error > reward.goal_tolerance_mm).astype(float)
        return -error / reward.error_scale_mm
