"""The tasks: their mechanism, their random episodes, and everything in which they differ from one another."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rj_gym.core import info
from rj_gym.core.config import TaskConfig, TrackingConfig
from rj_gym.core.draws import Block, Uniforms
from rj_gym.core.episodes import TaskLanes
from rj_gym.core.generators import Generators
from rj_gym.planar.episodes import Lanes
from rj_gym.planar.kernels import ERROR, TARGET, TIP, Rules
from rj_gym.planar.observation import POSITION_BOUND, Entry, force_scale, observation_entries
from rj_gym.planar.options import checked_options
from rj_gym.planar.render import Renderer
from rj_gym.planar.sampling import NOTHING_FIXED, Episodes, Fixed, sample_episodes, uniform_blocks
from rollingjoint.io.mechanism_file import load_mechanism
from rollingjoint.load import LOAD_COLUMNS
from rollingjoint.planar.chain import RollingChain

Array = NDArray[np.float64]

_LINK, _FX = LOAD_COLUMNS.index("link"), LOAD_COLUMNS.index("fx")


class Task(ABC):
    """A tracking task of one configuration, as environments and controllers see it; no method changes anything.

    Attributes:
        config: its settings. mechanism: the chain before randomisation.
        length: of the mechanism [mm]. neutral_lengths: of its tendons at rest, (m,) [mm].
        dimension: number of coordinates of a position.
    Raises:
        ConfigError, MechanismError: a mechanism that cannot be loaded, or none of this task.
    """

    dimension: ClassVar[int]
    config: Any
    mechanism: Any

    def __init__(self, config: TaskConfig) -> None:
        self.config = config
        chosen = config.mechanism
        self.mechanism = load_mechanism(chosen, config.MECHANISM) if isinstance(chosen, str) else chosen
        self.length = float(self.mechanism.length)
        self.neutral_lengths: Array = np.array(self.mechanism.neutral_lengths, dtype=float)
        self._blocks = self._uniform_blocks()

    @abstractmethod
    def entries(self, goal: bool = False) -> list[Entry]:
        """The entries of the observation vector; `goal` leaves target and tip error out."""

    @abstractmethod
    def rules(self, goal: bool = False) -> Any:
        """The numbers that all lanes share, as the kernels want them."""

    @abstractmethod
    def sample(self, rngs: Sequence[np.random.Generator] | Generators, fixed: Any = None) -> Any:
        """One episode per generator; each takes the same count of numbers from its own."""

    @abstractmethod
    def load_tables(self, episodes: Any, step: int) -> Array:
        """The true loads of E episodes at a step, tables (E, rows, columns)."""

    @abstractmethod
    def base_load_tables(self, episodes: Any) -> Array:
        """Loads of the unloaded states, in which episodes begin and targets are found, tables (E, rows, columns)."""

    @abstractmethod
    def lanes(self, capacity: int, goal: bool) -> TaskLanes:
        """Room for so many episodes side by side."""

    @abstractmethod
    def checked_options(self, options: Mapping[str, Any] | None) -> Any:
        """What the options of a reset hold fixed; raises InvalidInput for those that cannot be used."""

    @abstractmethod
    def renderer(self) -> Any:
        """What draws the scenes of the lanes."""

    def observation_bounds(self, goal: bool = False) -> tuple[Array, Array]:
        """Lowest and highest value of every observation entry, (entries,) each."""
        entries = self.entries(goal)
        return np.array([entry.low for entry in entries]), np.array([entry.high for entry in entries])

    def goals(self, positions: Array) -> NDArray[np.float32]:
        """Positions (..., d) [mm] in units of the length, within the bounds of the goal spaces."""
        return np.clip(positions / self.length, -POSITION_BOUND, POSITION_BOUND).astype(np.float32)

    def goal_bounds(self) -> Array:
        """Largest size of every entry of a goal."""
        return np.full(self.dimension, POSITION_BOUND)

    def achieved_goals(self, readings: Array) -> NDArray[np.float32]:
        """Where tips are, from readings (..., columns)."""
        return self.goals(readings[..., TIP : TIP + self.dimension])

    def desired_goals(self, readings: Array) -> NDArray[np.float32]:
        """Where they should be."""
        return self.goals(readings[..., TARGET : TARGET + self.dimension])

    def goal_reward(self, achieved: ArrayLike, desired: ArrayLike) -> Array:
        """Reward of the Goal environment for goals (..., d), (...)."""
        reward = self.config.reward
        difference = np.asarray(achieved, dtype=float) - np.asarray(desired, dtype=float)
        error = self.length * np.linalg.norm(difference, axis=-1)
        if reward.goal == "sparse":
            return -(error > reward.goal_tolerance_mm).astype(float)
        return -error / reward.error_scale_mm

    def reached(self, readings: Array) -> Any:
        """Whether the target is reached within the tolerance, from readings (..., columns)."""
        return readings[..., ERROR] <= self.config.reward.goal_tolerance_mm

    @abstractmethod
    def state_info(self, readings: Array) -> dict[str, Any]:
        """What info says in every step, arrays (B, ...): parts of the readings, and copies."""

    def reward_info(self, readings: Array) -> dict[str, Array]:
        """The terms of the reward, (B,) each: parts of the readings."""
        return info.reward_info(readings)

    @abstractmethod
    def single_info(self, readings: Array, numbers: list[float]) -> dict[str, Any]:
        """state_info and reward_info of one lane: Python numbers, `numbers`, and parts of its readings (columns,)."""

    def sampled_info(self, lanes: TaskLanes, episodes: Any) -> dict[str, Any]:
        """What was drawn for the episodes that just began in the first lanes: fresh arrays (B, ...)."""
        return info.sampled_info(lanes, episodes)

    @abstractmethod
    def _uniform_blocks(self) -> dict[str, Block]:
        """The blocks of uniform numbers that one episode needs."""


class TrackingTask(Task):
    """The planar task: the tip of a rolling-contact chain."""

    dimension: ClassVar[int] = 2
    config: TrackingConfig
    mechanism: RollingChain
    state_info = staticmethod(info.state_info)
    single_info = staticmethod(info.single_info)

    def entries(self, goal: bool = False) -> list[Entry]:
        """The entries of the observation vector; `goal` leaves target and tip error out."""
        return observation_entries(self.config, self.mechanism, goal)

    def rules(self, goal: bool = False) -> Rules:
        """The numbers that all lanes share, as the kernels want them."""
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

    def sample(self, rngs: Sequence[np.random.Generator] | Generators, fixed: Fixed | None = None) -> Episodes:
        """One episode per generator; each takes the same count of numbers from its own."""
        return sample_episodes(self.config, self.mechanism, Uniforms(self._blocks, rngs), fixed or NOTHING_FIXED)

    def load_tables(self, episodes: Episodes, step: int) -> Array:
        """The true loads of E episodes at a step, tables (E, 1, 11)."""
        tables = np.zeros((len(episodes), 1, len(LOAD_COLUMNS)))
        tables[:, 0, _LINK] = episodes.links
        tables[:, 0, _FX : _FX + 2] = episodes.forces[:, min(step, episodes.forces.shape[1] - 1)]
        return tables

    def base_load_tables(self, episodes: Episodes) -> Array:
        """Loads of the unloaded states: none, tables (E, 0, 11)."""
        return np.zeros((len(episodes), 0, len(LOAD_COLUMNS)))

    def lanes(self, capacity: int, goal: bool) -> Lanes:
        """Room for so many episodes side by side."""
        return Lanes(self, capacity, goal)

    def checked_options(self, options: Mapping[str, Any] | None) -> Fixed:
        """What the options of a reset hold fixed; raises InvalidInput for those that cannot be used."""
        return checked_options(options, self.config, self.mechanism)

    def renderer(self) -> Renderer:
        """What draws the scenes of the lanes."""
        return Renderer(self.length)

    def sampled_info(self, lanes: TaskLanes, episodes: Episodes) -> dict[str, Any]:
        """What was drawn for the episodes that just began in the first lanes: fresh arrays (B, ...)."""
        return super().sampled_info(lanes, episodes) | {"surface_offsets": episodes.surface_offsets}

    def _uniform_blocks(self) -> dict[str, Block]:
        return uniform_blocks(self.config, self.mechanism)


def task_of(config: TaskConfig) -> Task:
    """The task of these settings.

    Raises:
        ConfigError, MechanismError: a mechanism that cannot be loaded.
    """
    if isinstance(config, TrackingConfig):
        return TrackingTask(config)
    from rj_gym.arm.task import ArmTask  # made of what is here

    return ArmTask(config)
