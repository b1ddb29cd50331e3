"""Controllers of the tasks among walls, which read the true state of an environment: opponents of policies.

Each is begun with a vector environment after its reset, and then gives the actions of every step. What each knows that
a policy does not see stands in its docstring.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rj_gym.surroundings.drawing import steps_through
from rj_gym.surroundings.task import Response

Array = NDArray[np.float64]

_DAMPING = 2.0
_REACH_MM = 3.0  # of the error that a step of feedback tries to remove


class WallController(ABC):
    """Gives actions for all lanes of a native vector environment of the tasks among walls."""

    def begin(self, envs: Any, infos: Mapping[str, Any]) -> None:  # noqa: B027 (most of them plan nothing)
        """Begin the episodes that `envs` has just begun, with the infos of that reset."""

    @abstractmethod
    def act(self, envs: Any) -> Array:
        """The actions, (B, m), in [-1, 1]."""


class Still(WallController):
    """Does nothing."""

    def act(self, envs: Any) -> Array:
        """No increments."""
        return np.zeros(envs.action_space.shape)


class FreeSpacePlan(WallController):
    """Open loop: the commands and feed that put the tip at the target in free space, approached in a straight line.

    It knows the mechanism and the target, and neither walls nor what happens.
    """

    def begin(self, envs: Any, infos: Mapping[str, Any]) -> None:
        """Find the commands by Jacobian steps of a twin without walls."""
        task, config = envs.task, envs.config
        response: Response = envs.tangent()
        commands, feed = response.commands.copy(), response.feed.copy()
        self._start = commands.copy(), feed.copy()
        equilibria = None
        for _ in range(80):
            equilibria = task.free(commands, equilibria)
            free = task.response(equilibria, feed, response.scenes)
            step = damped(free.tip_rates, free.target - free.tip)
            step /= np.maximum(1.0, np.abs(step).max(axis=1, keepdims=True))
            commands = commands - config.action_scale_mm * step[:, : task.m]
            if config.FEEDS:
                feed = np.clip(feed + config.feed_scale_mm * step[:, -1], *config.feed_range)
        self._end, self._step = (commands, feed), 0

    def act(self, envs: Any) -> Array:
        """A straight change, over 0.8 of the episode."""
        config, steps = envs.config, 0.8 * envs.config.episode_steps
        self._step += 1
        share = 1.0 if self._step <= steps else 0.0
        (begin, from_feed), (end, to_feed) = self._start, self._end
        actions = share * (begin - end) / (steps * config.action_scale_mm)
        if config.FEEDS:
            actions = np.column_stack([actions, share * (to_feed - from_feed) / (steps * config.feed_scale_mm)])
        return np.clip(actions, -1.0, 1.0)


class SearchedWay(WallController):
    """The commands with which the target was found when the episode was drawn (privileged): the floor.

    Of tasks whose info["sampled"] has them: Obstacles and HiddenWall.
    """

    def begin(self, envs: Any, infos: Mapping[str, Any]) -> None:
        """Take the commands over."""
        sampled, rest = infos["sampled"], np.repeat(envs.task.rest[None], envs.num_envs, axis=0)
        ends = [rest, *(sampled[name] for name in ("via", "goal") if name in sampled)]
        self._steps = steps_through(ends, envs.config.action_scale_mm)

    def act(self, envs: Any) -> Array:
        """To the next commands."""
        wanted = self._steps.pop(0) if len(self._steps) > 1 else self._steps[0]
        return np.clip((envs.tangent().commands - wanted) / envs.config.action_scale_mm, -1.0, 1.0)


class Feedback(WallController):
    """Jacobian feedback on the true tip.

    Args:
        aware: whether its Jacobian is that with contact, which no instrument can know (privileged); else it is that of
            the chain in free space, at the true pose and tensions.
    """

    def __init__(self, aware: bool) -> None:
        self.aware = aware

    def act(self, envs: Any) -> Array:
        """Damped least squares towards the target."""
        response: Response = envs.tangent()
        rates = response.tip_rates if self.aware else response.free_tip_rates
        error = response.target - response.tip
        size = np.hypot(*error.T)
        error = error * np.minimum(1.0, _REACH_MM / np.maximum(size, 1e-9))[:, None]
        return within(damped(rates, error))


class SeekForce(WallController):
    """Feedback to the target, and from `near` on the pull goes on until the wall presses with the wanted force.

    Privileged: it is told the tip and the force of the wall. Of HiddenWall with the goal "touch".
    """

    gain, near = 0.4, 1.0  # mm/N in a step; mm

    def begin(self, envs: Any, infos: Mapping[str, Any]) -> None:
        """The direction to go on in is that from the start to the target."""
        self._way = infos["target"] - infos["tip"]
        self._pressing = np.zeros(len(self._way), bool)

    def act(self, envs: Any) -> Array:
        """Both tendons of a pair move against each other: together they would only stiffen it."""
        response: Response = envs.tangent()
        pairs = np.kron(np.eye(envs.task.m // 2), [[1.0], [-1.0]])
        rates, away = response.free_tip_rates @ pairs, response.target - response.tip
        self._pressing |= np.hypot(*away.T) < self.near
        onward = np.sign(np.einsum("bx,bxa->ba", self._way, rates))
        lacking = (envs.config.touch_force - response.wall_force) / envs.config.action_scale_mm
        press = self.gain * lacking[:, None] * onward
        return within(np.where(self._pressing[:, None], press, damped(rates, away)) @ pairs.T)


class FollowTheLeader(WallController):
    """Keeps every link and the nose on the centre line and the tip going along it.

    Privileged: it knows the line and the contact.

    Args:
        rate: how far the tip goes on along the line in a step [mm].
    """

    def __init__(self, rate: float = 2.2) -> None:
        self.rate = rate

    def act(self, envs: Any) -> Array:
        """Damped least squares: links and nose across the line to 0, the tip along it by the rate."""
        response: Response = envs.tangent()
        points, rates = response.with_nose(np.array(envs.task.mechanism.links[-1].child.start))
        offsets, tangents, remaining = envs.task.on_the_line(points, response.scenes)
        normals = np.stack([-tangents[..., 1], tangents[..., 0]], -1)
        weights = np.ones(points.shape[1] - 2)  # links 0 and 1 are where the base is
        weights[-1] = 2.0
        across = np.einsum("bkx,bkxa->bka", normals, rates)[:, 2:]
        forward = 3.0 * np.einsum("bx,bxa->ba", tangents[:, -2], rates[:, -2])
        way = 3.0 * np.clip(remaining[:, -2], -self.rate, self.rate)
        rows = np.concatenate([weights[:, None] * across, forward[:, None]], axis=1)
        return within(damped(rows, np.column_stack([-weights * offsets[:, 2:], way])))


def damped(rates: Array, wanted: Array) -> Array:
    """Actions (B, a) of least squares for d rows / d action (B, r, a) and wanted changes of the rows (B, r)."""
    transposed = np.swapaxes(rates, 1, 2)
    square = transposed @ rates + _DAMPING * np.eye(rates.shape[2])
    return np.asarray(np.linalg.solve(square, transposed @ wanted[..., None])[..., 0], float)


def within(actions: Array) -> Array:
    """Actions scaled so that none exceeds 1."""
    return np.asarray(actions / np.maximum(1.0, np.abs(actions).max(axis=1, keepdims=True)))
