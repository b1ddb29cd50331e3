"""The model inverse, without feedback; also of a model with friction of its tendons."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from agents.controllers.controller import Array, Controller, Mask, Reading, restarted
from agents.controllers.measured import measured_by, unstretched
from agents.controllers.steps import choose, nearest_tensions
from agents.runs.environment import EnvConfig, make_vector_env
from rj_gym.tracking.task import TrackingTask
from rollingjoint import CapstanFriction, solve_lengths_batch, solve_tensions_batch
from rollingjoint.chain.solution import Solution
from rollingjoint.checks import as_positive
from rollingjoint.errors import InvalidInput


class OpenLoop(Controller):
    """The model command: goes to the tendon lengths that put the unloaded tip nearest to the target.

    It knows the mechanism, the target and its own commands, and looks neither at the pose nor at the load.

    Args:
        rest_tension: the tension [N] that the model's tensions are drawn to where the target leaves a choice; None:
            REST_TENSION where tensions stiffen the mechanism, the tension of the start elsewhere. Outside the tension
            range of the task, the nearest end of that range.
    Raises:
        InvalidInput: a tension that is not a positive number.
    """

    REST_TENSION = 13.0  # N: the best of 3 to 15 N on tuning seeds (docs/training.md); a chain yields less when taut

    def __init__(self, rest_tension: float | None = None) -> None:
        if rest_tension is not None:
            as_positive("rest_tension", rest_tension, "a tension above 0 [N], or None")
        self.rest_tension = rest_tension
        self.target = self.tensions = np.empty(0)

    def reset(self, mask: Mask) -> None:
        """Begin episodes, (B,), without plans."""
        task, model = self.task, measured_by(self.task)
        self.loads = model.nominal_loads
        default = self.REST_TENSION if model.stiffens else task.config.start_tension
        tension = np.clip(default if self.rest_tension is None else self.rest_tension, *task.config.held_tensions)
        self.rest = np.full((len(mask), task.mechanism.n_tendons), tension)
        self.tensions = restarted(self.tensions, mask, self.rest)
        self.target = restarted(self.target, mask, np.full((len(mask), task.dimension), np.nan))

    def act(self, observations: Any) -> Array:
        """One step on the straight way to the commanded lengths, (B, m)."""
        reading = self.read(observations)
        target = self.aim(reading)
        if not np.array_equal(target, self.target):
            self.plan(target)
        way = (reading.commands - self.lengths) / self.task.config.action_scale_mm
        return way / np.maximum(1.0, np.abs(way).max(axis=1, keepdims=True))

    def aim(self, reading: Reading) -> Array:
        """Where the model's tip should go, (B, d) [mm]: to the target."""
        return reading.target

    def plan(self, target: Array) -> None:
        """Set the commanded lengths for these targets: unstretched lengths at the tensions that the model proposes."""
        mechanism, limits = self.task.mechanism, self.task.config.held_tensions
        self.target = target
        self.tensions = nearest_tensions(mechanism, target, limits, self.rest, self.tensions, self.loads)
        self.lengths = unstretched(solve_tensions_batch(mechanism, self.tensions, self.loads))


class FrictionOpenLoop(OpenLoop):
    """The model command where tendons rub: it aims off for the error that the way there leaves in the model.

    It carries the model along its own commands, friction and all, and looks neither at the pose nor at the load.

    Args:
        mu: coefficient of friction of the model, for all tendons; None: the middle of the task's range. An array (E, m)
            has the tendons of E episodes, in their order: with the true ones, from true_friction, it is privileged.
        rest_tension: as of OpenLoop.
    """

    ROUNDS = 4  # of aiming off, after which little of the model's error is left

    def __init__(self, mu: ArrayLike | None = None, rest_tension: float | None = None) -> None:
        super().__init__(rest_tension)
        self.mu, self.begun = mu if mu is None else np.asarray(mu, float), 0
        self.privileged = self.mu is not None and self.mu.ndim == 2
        self._episodes = np.empty(0)

    def reset(self, mask: Mask) -> None:
        """Begin the next of the episodes, (B,), at their start tension and without slip."""
        super().reset(mask)
        self._episodes = restarted(self._episodes, mask, self.begun + np.cumsum(mask, dtype=float) - 1.0)
        self.begun += int(mask.sum())
        self.mechanisms = self._rubbing(self.task, self._episodes)
        tensions = np.full((len(mask), self.task.mechanism.n_tendons), self.task.config.start_tension)
        start = solve_tensions_batch(self.mechanisms, tensions, self.loads)
        self.state: Solution = start if mask.all() else choose(mask, start, self.state)

    def act(self, observations: Any) -> Array:
        """One step on the straight way to the commanded lengths, (B, m)."""
        reading = self.read(observations)
        self.commands = reading.commands
        self.state = self._moved(self.state, self.commands)
        return super().act(reading)

    def plan(self, target: Array) -> None:
        """Set the commanded lengths with which the model ends at these targets, (B, d) [mm], on the straight way."""
        aim = target.copy()
        for _ in range(self.ROUNDS):
            super().plan(aim)
            ends = self._at_the_end()
            aim += np.where(np.asarray(ends.ok)[:, None], target - ends.tip, 0.0)
        super().plan(aim)
        self.target = target

    def _at_the_end(self) -> Solution:
        """The model at the end of the way to the commanded lengths."""
        way, state = self.lengths - self.commands, self.state
        steps = np.maximum(np.abs(way).max(axis=1, keepdims=True) / self.task.config.action_scale_mm, 1.0)
        for step in range(1, 1 + int(np.ceil(steps.max()))):
            state = self._moved(state, self.commands + way * np.minimum(step / steps, 1.0))
        return state

    def _moved(self, state: Solution, commands: Array) -> Solution:
        limits = self.task.config.possible_tensions
        return solve_lengths_batch(self.mechanisms, commands, self.loads, state, limits, history=state)

    def _rubbing(self, task: TrackingTask, episodes: Array) -> list[Any]:
        """The mechanisms of the episodes of these numbers, (B,)."""
        low, high = (0.0, 0.0) if task.config.friction is None else task.config.friction.mu
        shape = len(episodes), task.mechanism.n_tendons
        mu = np.array(0.5 * (low + high) if self.mu is None else self.mu)
        if mu.ndim == 2:
            mu = mu[episodes[episodes < len(mu)].astype(int)]
        if mu.ndim and mu.shape != shape:
            raise InvalidInput("shape of mu", mu.shape, f"(), or (E, {shape[1]}) for all E episodes")
        mechanisms: dict[tuple[float, ...], Any] = {}
        rows = [tuple(row) for row in np.broadcast_to(mu, shape).tolist()]
        for row in rows:
            if row not in mechanisms:
                mechanisms[row] = with_friction(task, row)
        return [mechanisms[row] for row in rows]


def with_friction(task: TrackingTask, mu: Sequence[float]) -> Any:
    """The task's mechanism with these coefficients of friction, one per tendon."""
    presliding = task.config.friction.presliding if task.config.friction else CapstanFriction(0.0).presliding
    frictions = [CapstanFriction(coefficient, presliding) for coefficient in mu]
    tendons = tuple(replace(t, friction=f) for t, f in zip(task.mechanism.tendons, frictions, strict=True))
    return task.mechanism.replace(tendons=tendons)


def true_friction(env: EnvConfig, seeds: Sequence[int]) -> Array:
    """The coefficients of friction drawn for the episodes of these seeds, (E, m); they cannot be measured."""
    envs = make_vector_env(env, len(seeds))
    _, info = envs.reset(seed=[int(seed) for seed in seeds])  # type: ignore[arg-type]
    envs.close()
    return np.array(info["sampled"]["friction_mu"], float)
