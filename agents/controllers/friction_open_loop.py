"""Open loop on a model whose tendons rub in their holes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from agents.controllers.open_loop import OpenLoop
from agents.evaluation.controller import Array, Seen
from agents.runs.environment import EnvConfig, make_vector_env
from rj_gym.core.tracking_task import TrackingTask
from rollingjoint.chain.solution import Solution
from rollingjoint.errors import InvalidInput
from rollingjoint.friction import CapstanFriction
from rollingjoint.statics.solve import solve_lengths_batch, solve_tensions_batch


class FrictionOpenLoop(OpenLoop):
    """The model command where tendons rub: what the way there leaves of an error in the model is aimed off for.

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

    @property
    def privileged(self) -> bool:
        """Whether it was given coefficients of single episodes."""
        return self.mu is not None and self.mu.ndim == 2

    def begin(self, task: TrackingTask, episodes: int) -> None:
        """Reset: the next of the episodes begin, at their start tension, and nothing has slipped."""
        super().begin(task, episodes)
        self.mechanisms = self._rubbing(task, episodes)
        tensions = np.full((episodes, task.mechanism.n_tendons), task.config.start_tension)
        self.state: Solution = solve_tensions_batch(self.mechanisms, tensions, self.loads)
        self.begun += episodes

    def act(self, seen: Seen) -> Array:
        """One step on the straight way to the commanded lengths, (B, m)."""
        self.commands = seen.commands
        self.state = self._moved(self.state, self.commands)
        return super().act(seen)

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
        limits = self.task.config.tension_range
        return solve_lengths_batch(self.mechanisms, commands, self.loads, state, limits, history=state)

    def _rubbing(self, task: TrackingTask, episodes: int) -> list[Any]:
        """The mechanism of every episode."""
        low, high = (0.0, 0.0) if task.config.friction is None else task.config.friction.mu
        shape = episodes, task.mechanism.n_tendons
        mu = np.array(0.5 * (low + high) if self.mu is None else self.mu)
        if mu.ndim == 2:
            mu = mu[self.begun : self.begun + episodes]
        if mu.ndim and mu.shape != shape:
            raise InvalidInput("shape of mu", mu.shape, f"(), or (E, {shape[1]}) for all E episodes")
        made: dict[tuple[float, ...], Any] = {}
        rows = [tuple(row) for row in np.broadcast_to(mu, shape).tolist()]
        for row in rows:
            if row not in made:
                made[row] = with_friction(task, row)
        return [made[row] for row in rows]


def with_friction(task: TrackingTask, mu: Sequence[float]) -> Any:
    """The task's mechanism with these coefficients of friction, one per tendon."""
    presliding = task.config.friction.presliding if task.config.friction else CapstanFriction(0.0).presliding
    frictions = [CapstanFriction(each, presliding) for each in mu]
    tendons = tuple(replace(t, friction=f) for t, f in zip(task.mechanism.tendons, frictions, strict=True))
    return task.mechanism.replace(tendons=tendons)


def true_friction(env: EnvConfig, seeds: Sequence[int]) -> Array:
    """The coefficients of friction that were drawn for the episodes of these seeds, (E, m): nobody can measure them."""
    envs = make_vector_env(env, len(seeds))
    _, info = envs.reset(seed=[int(seed) for seed in seeds])  # type: ignore[arg-type]
    envs.close()
    return np.array(info["sampled"]["friction_mu"], float)
