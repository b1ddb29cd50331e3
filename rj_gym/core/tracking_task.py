"""The base of the tracking tasks: bring the tip of a mechanism to a target by moving its tendons."""

from __future__ import annotations

import math
from abc import abstractmethod
from operator import itemgetter
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rj_gym.core import info
from rj_gym.core.columns import ERROR, TARGET, TENSIONS, TIP
from rj_gym.core.config import TaskConfig
from rj_gym.core.draws import Block
from rj_gym.core.hardware_draws import hardware_rules
from rj_gym.core.kernels import friction_columns
from rj_gym.core.observation import POSITION_BOUND, Entry
from rj_gym.core.task import Task
from rollingjoint.checks import as_floats
from rollingjoint.compiled import CONSTANT, MU
from rollingjoint.errors import InvalidInput
from rollingjoint.io.mechanism_file import load_mechanism

Array = NDArray[np.float64]


class TrackingTask(Task):
    """A tracking task of one configuration, as environments and controllers see it; no method changes anything.

    Attributes:
        config: its settings. mechanism: before randomisation.
        length: of the mechanism [mm]. neutral_lengths: of its tendons at rest, (m,) [mm].
        dimension: number of coordinates of a position.
        has_friction: whether episodes take steps with friction.
    Raises:
        ConfigError, MechanismError: a mechanism that cannot be loaded, or none of this task.
    """

    dimension: ClassVar[int]
    own_columns: ClassVar[int] = 0  # of readings that only this task has
    mechanism: Any

    def __init__(self, config: TaskConfig) -> None:
        self.config = config
        chosen = config.mechanism
        self.mechanism = load_mechanism(chosen, config.MECHANISM) if isinstance(chosen, str) else chosen
        self.length = float(self.mechanism.length)
        self.action_size = self.mechanism.n_tendons
        self.neutral_lengths: Array = np.array(self.mechanism.neutral_lengths, dtype=float)
        self._columns = TENSIONS + 2 * self.action_size  # of readings that every tracking task has
        self._places = info.Places.of(self.dimension, self.action_size)
        self._parts = itemgetter(*self._places)
        self.has_friction = bool(config.has_friction(self.mechanism))
        self._goal_size = len(self.goal_bounds())
        self.observes_truth = config.privileged == "observation"
        self._truths = len(self.privileged_entries()) if config.privileged != "off" else 0
        self._blocks = self._uniform_blocks()

    @property
    @abstractmethod
    def pictured(self) -> list[str]:
        """Names of the observation's entries that pictures fill and `Tangent.poses` has, in its order."""

    @abstractmethod
    def privileged_entries(self) -> list[Entry]:
        """The entries of the privileged state, whether or not the settings show it."""

    def privileged_bounds(self) -> tuple[Array, Array]:
        """Lowest and highest value of every privileged entry, (K,) each."""
        entries = self.privileged_entries()
        return np.array([entry.low for entry in entries]), np.array([entry.high for entry in entries])

    def privileged(self, readings: Array) -> NDArray[np.float32]:
        """The privileged state, (..., K), from readings (..., columns)."""
        first = self._columns + self.own_columns
        return readings[..., first : first + self._truths].astype(np.float32)

    @abstractmethod
    def rules(self, goal: bool = False) -> Any:
        """The parameters that all lanes share, as the kernels take them."""

    @abstractmethod
    def load_tables(self, episodes: Any, step: int) -> Array:
        """The true loads of E episodes at a step, tables (E, rows, columns)."""

    @abstractmethod
    def base_load_tables(self, episodes: Any) -> Array:
        """Loads of the unloaded states, in which episodes begin and targets are found, tables (E, rows, columns)."""

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

    def checked_goals(self, achieved: ArrayLike, desired: ArrayLike) -> tuple[Array, Array]:
        """Goals (..., d) as floats; InvalidInput unless they are finite numbers of shapes that fit each other."""
        d = self._goal_size
        allowed = f"finite numbers of shape ({d},), or (..., {d}) in batches of one size"
        goals = as_floats("achieved_goal", achieved, allowed), as_floats("desired_goal", desired, allowed)
        for what, goal in zip(("achieved_goal", "desired_goal"), goals, strict=True):
            if goal.shape[-1:] != (d,) or not math.isfinite(np.vdot(goal, goal)):
                raise InvalidInput(what, goal.tolist(), allowed)
        if goals[0].shape != goals[1].shape and not _broadcast(*goals):
            raise InvalidInput("shapes of achieved_goal and desired_goal", (goals[0].shape, goals[1].shape), allowed)
        return goals

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

    def reward_info(self, readings: Array) -> dict[str, Array]:
        """The terms of the reward, (B,) each: parts of the readings."""
        return info.reward_info(readings)

    @property
    def friction_acts(self) -> bool:
        """Whether poses of some episode depend on the way to them."""
        drawn, (arm, _) = self.config.friction, self.mechanism.rolling_coefficients
        coefficients = self.mechanism.friction_coefficients
        highest = coefficients[:, MU].max() if drawn is None else drawn.mu[1]
        return bool(highest > 0.0 or arm > 0.0 or np.any(coefficients[:, CONSTANT] > 0.0))

    @property
    def columns(self) -> int:
        """How many columns readings have."""
        return self._columns + self.own_columns + self._truths + self.friction_columns

    @property
    def friction_columns(self) -> int:
        """How many columns of readings say what friction did."""
        return friction_columns(self.mechanism.n_joints, self.action_size) if self.has_friction else 0

    def truth_info(self, readings: Array) -> dict[str, Any]:
        """What info says of the privileged state, arrays (B, ...): nothing where it does not."""
        return {"privileged": self.privileged(readings)} if self.config.privileged == "info" else {}

    def friction_info(self, readings: Array) -> dict[str, Any]:
        """What info says of friction, arrays (B, ...): nothing where there is none."""
        if not self.has_friction:
            return {}
        return info.friction_info(readings, self.mechanism.n_joints, self.action_size)

    def _shared_rules(self, goal: bool) -> dict[str, Any]:
        """The fields that the rules of every tracking task have."""
        config, reward = self.config, self.config.reward
        low, high = self.observation_bounds(goal)
        return {
            "action_scale": config.action_scale_mm,
            "length": self.length,
            "command_scale": config.command_scale_mm,
            "error_scale": reward.error_scale_mm,
            "highest_tension": config.tension_range[1],
            "effort": reward.effort,
            "smoothness": reward.smoothness,
            "failure_penalty": reward.failure_penalty,
            "precision": reward.precision,
            "observe_tensions": config.observe_tensions,
            "observe_target": not goal,
            "observe_load": config.observe_load,
            "neutral_lengths": self.neutral_lengths,
            "low": low.astype(np.float32),
            "high": high.astype(np.float32),
            "hardware": hardware_rules(
                config, self.mechanism, self.privileged_bounds(), self._columns + self.own_columns
            ),
        }

    @abstractmethod
    def _uniform_blocks(self) -> dict[str, Block]:
        """The blocks of uniform numbers that one episode needs."""


def _broadcast(first: Array, second: Array) -> bool:
    """Whether arrays of these shapes fit each other."""
    try:
        np.broadcast_shapes(first.shape, second.shape)
    except ValueError:
        return False
    return True
