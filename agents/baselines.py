"""The Controller protocol, and controllers to compare a policy with: examples of how to plug in one's own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol, cast

import gymnasium
import numpy as np

from rj_gym import RollingJointEnv
from rj_gym.tracking.observation import observation_entries
from rj_gym.tracking.task import TrackingTask
from rollingjoint.rolling_chain import RollingChain
from rollingjoint.sensitivity import dposes_dtensions
from rollingjoint.solve import solve_tensions


class Controller(Protocol):
    """Anything that turns observations into actions."""

    def reset(self, env: gymnasium.Env) -> None:
        """An episode of `env` begins."""

    def act(self, observation: Any, env: gymnasium.Env) -> np.ndarray:
        """The action, (n_tendons,) in [-1, 1]: the share of action_scale_mm by which each tendon is pulled in."""


class DoNothing:
    """Leaves the tendons as they are."""

    def reset(self, env: gymnasium.Env) -> None:
        """Nothing to prepare."""

    def act(self, observation: Any, env: gymnasium.Env) -> np.ndarray:
        """No increments, (n_tendons,)."""
        return np.zeros(task_of(env).mechanism.n_tendons)


class OpenLoop:
    """The model command: goes to the tendon lengths that put the unloaded tip nearest to the target.

    It knows the mechanism, the target and its own commands, and looks neither at the pose nor at the load.
    """

    def reset(self, env: gymnasium.Env) -> None:
        """An episode begins: nothing is planned yet."""
        task = task_of(env)
        self.target = np.full(2, np.nan)
        self.tensions = np.full(task.mechanism.n_tendons, task.config.start_tension)

    def act(self, observation: Any, env: gymnasium.Env) -> np.ndarray:
        """One step on the straight way to the commanded lengths, (n_tendons,)."""
        task = task_of(env)
        target = self.aim(observation, task)
        if not np.array_equal(target, self.target):
            self.plan(task, target)
        way = (observed_commands(observation, task) - self.lengths) / task.config.action_scale_mm
        return way / max(1.0, float(np.abs(way).max()))

    def aim(self, observation: Any, task: TrackingTask) -> np.ndarray:
        """Where the model's tip shall go, (2,) [mm]: to the target."""
        return observed_target(observation, task)

    def plan(self, task: TrackingTask, target: np.ndarray) -> None:
        """Set the commanded lengths for this target: unstretched lengths at the tensions that the model proposes."""
        self.target = target
        self.tensions = nearest_tensions(task.mechanism, target, task.config.tension_range, self.tensions)
        lengths = solve_tensions(task.mechanism, self.tensions).lengths
        self.lengths = lengths - self.tensions / task.mechanism.stiffnesses


def task_of(env: gymnasium.Env) -> TrackingTask:
    """The tracking task behind an environment of rj_gym: its mechanism and configuration."""
    return cast(RollingJointEnv, env.unwrapped).task


def observed_target(observation: Any, task: TrackingTask) -> np.ndarray:
    """The target in an observation of either environment, (2,) [mm]."""
    if isinstance(observation, Mapping):
        return task.mechanism.length * np.asarray(observation["desired_goal"], dtype=float)
    return task.mechanism.length * _entries(observation, task, ["target x", "target y"])


def observed_tip(observation: Any, task: TrackingTask) -> np.ndarray:
    """The measured tip in an observation of either environment, (2,) [mm]."""
    last = task.mechanism.n_links - 1
    return task.mechanism.length * _entries(observation, task, [f"link {last} x", f"link {last} y"])


def observed_commands(observation: Any, task: TrackingTask) -> np.ndarray:
    """The commanded tendon lengths in an observation of either environment, (n_tendons,) [mm]."""
    names = [f"tendon {j} command" for j in range(task.mechanism.n_tendons)]
    return task.mechanism.neutral_lengths + task.config.command_scale_mm * _entries(observation, task, names)


def _entries(observation: Any, task: TrackingTask, names: Sequence[str]) -> np.ndarray:
    goal = isinstance(observation, Mapping)
    values = observation["observation"] if goal else observation
    places = [entry.name for entry in observation_entries(task.config, task.mechanism, goal)]
    return np.array([values[places.index(name)] for name in names], dtype=float)


def nearest_tensions(
    mechanism: RollingChain,
    target: np.ndarray,
    limits: tuple[float, float],
    start: np.ndarray,
) -> np.ndarray:
    """Tensions (n_tendons,) [N] within `limits` at which the model's tip is nearest to the target.

    Bounded least squares over the logarithms of the tensions, with the implicit derivative of the tip. Unloaded, only
    ratios of tensions matter: a small weight keeps their geometric mean at that of `start`.

    Args:
        target: (2,) [mm].
        limits: lowest and highest tension [N], the lowest above zero.
        start: first guess, (n_tendons,) [N].
    """
    from scipy.optimize import least_squares

    low, high = np.log(max(limits[0], 1e-3)), np.log(limits[1])
    middle, weight = np.log(start).mean(), 1e-3 * mechanism.length

    def misfit(logs: np.ndarray) -> np.ndarray:
        tip = solve_tensions(mechanism, np.exp(logs)).tip
        return np.append(tip - target, weight * (logs.mean() - middle))

    def slope(logs: np.ndarray) -> np.ndarray:
        tips = dposes_dtensions(solve_tensions(mechanism, np.exp(logs)))[-1, :2] * np.exp(logs)
        return np.vstack([tips, np.full(len(logs), weight / len(logs))])

    first = np.clip(np.log(start), low + 1e-6, high - 1e-6)
    return np.exp(least_squares(misfit, first, slope, bounds=(low, high)).x)
