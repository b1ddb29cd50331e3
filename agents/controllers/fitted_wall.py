"""A controller at a hidden wall that fits the wall to what motors measure, and plans with the fit."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.controllers.among_walls import damped, within
from rj_gym.surroundings.observation import COMMAND_MM
from rollingjoint import Sleeve
from rollingjoint.estimate import ContactSmoother, RigSensors, WallRanges
from rollingjoint.statics.sensitivity import dposes_dlengths

Array = NDArray[np.float64]

_TURN = 0.6  # rad: how far a wall may be turned from the tip's way; 0.5 as episodes are drawn
_SLACK = 0.1  # mm: by how much the range of its offset is wider
_MOVES = np.array([-0.3, -0.1, -0.03, -0.01, 0.0, 0.01, 0.03, 0.1, 0.2, 0.4, 0.7, 1.0])  # that are tried, as actions
_STILL = 1e-4  # mm: commands that have moved by less measure nothing new
_FELT = 3.0  # standard deviations of a tension, by which a wall is felt
_BEYOND = 2.0  # mm: so far from the target it must have been


class FittedWall:
    """Feedback on a fitted wall: a ContactSmoother's, whose force it brings to the wanted one.

    Of HiddenWall with the goal "touch". It sees observations alone: commands, tensions and the target. Besides it knows
    the mechanism, the ranges of walls, and that the target is where the tip presses with the wanted force. The model
    without walls leads it there; from `near` on it fits the wall in every step, and goes where sampled walls press with
    the least mean square error. If no wall is felt behind the target, it turns round.

    Args:
        near: distance from the target at which it begins to fit [mm].
        caution: weight of force that is too much, over that of force that is lacking.
        memory: measured steps to which a wall is fitted, the last ones. samples: number of sampled walls.
        tension_sd: of the errors of tensions, those of the model included [N].
    """

    reads_environment = False

    def __init__(
        self,
        near: float = 3.0,
        caution: float = 1.0,
        memory: int = 6,
        samples: int = 40,
        tension_sd: float = 0.02,
    ) -> None:
        self.near, self.caution, self.memory = near, caution, memory
        self.samples, self.tension_sd = samples, tension_sd

    def begin(self, envs: Any, infos: Mapping[str, Any]) -> None:
        """Begin the episodes that `envs` has just begun."""
        self._task, lanes = envs.task, envs.num_envs
        names = [entry.name for entry in self._task.entries()]
        tendons = [[f"tendon {j} {what}" for j in range(self._task.m)] for what in ("command", "tension")]
        self._columns = [[names.index(name) for name in part] for part in (*tendons, ["target x", "target y"])]
        self._smoothers: list[ContactSmoother | None] = [None] * lanes
        self._seen = [deque[tuple[Array, Array]](maxlen=self.memory) for _ in range(lanes)]
        self._free: Any = None
        self._way = np.zeros((0, 2))  # of the tip, from the start to the target

    def act(self, observations: Any) -> Array:
        """The actions, (B, m)."""
        task, config = self._task, self._task.config
        command, tension, place = (np.asarray(observations[:, columns], float) for columns in self._columns)
        commands = task.mechanism.neutral_lengths + COMMAND_MM * command
        tensions, target = config.tension_range[1] * tension, task.length * place
        self._free = task.free(commands, self._free)
        away, pairs = target - self._free.tip, np.kron(np.eye(task.m // 2), [[1.0], [-1.0]])
        rates = -config.action_scale_mm * dposes_dlengths(self._free)[:, -1, :2] @ pairs
        if not len(self._way):
            self._way = away.copy()
        unfelt = np.abs(tensions - self._free.tensions).max(axis=1) < _FELT * self.tension_sd
        pulls = damped(rates, away)
        for lane, distance in enumerate(np.hypot(*away.T)):
            if self._smoothers[lane] is not None and unfelt[lane] and distance > _BEYOND:
                self._smoothers[lane] = None
                self._way[lane] *= -1.0
                self._seen[lane].clear()
            onward = np.sign(self._way[lane] @ rates[lane])
            if self._smoothers[lane] is None and distance < self.near:
                angle = self._free.poses[lane, -1, 2]
                self._smoothers[lane] = self._smoother(rates[lane] @ onward, target[lane], angle)
            if (smoother := self._smoothers[lane]) is not None:
                share = self._planned(smoother, self._seen[lane], commands[lane], tensions[lane], pairs @ onward)
                pulls[lane] = share * onward
        return within(pulls @ pairs.T)

    def _smoother(self, way: Array, target: Array, angle: float) -> ContactSmoother:
        """The smoother of walls that the last link touches at the target.

        way: of the tip as it is pulled on, (2,). angle: of the last link at the target [rad].
        """
        chain, config, sleeve = self._task.mechanism, self._task.config, Sleeve(self._task.config.sleeve)
        across = float(np.arctan2(-way[1], -way[0]))
        points = sleeve.rows(chain.links).points
        x, y = points[points[:, 0] == chain.n_links - 1, 1:3].T
        cos, sin = np.cos(angle), np.sin(angle)
        places = target + np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)
        places -= chain.poses(chain.neutral_angles)[-1, :2]
        turned = across + np.linspace(-_TURN, _TURN, 13)
        nearest = (np.stack([np.cos(turned), np.sin(turned)], axis=-1) @ places.T).min(axis=1) - config.sleeve
        soft, hard = (1.0 / stiffness for stiffness in config.stiffness)
        offsets = nearest.min() - _SLACK, nearest.max() + config.touch_force * soft + _SLACK
        walls, sensors = (
            WallRanges((across - _TURN, across + _TURN), offsets, (hard, soft)),
            RigSensors(self.tension_sd),
        )
        return ContactSmoother(
            chain, walls, None, sensors, outline=sleeve, starts=(2, 2), steps=self.memory, samples=self.samples
        )

    def _planned(
        self, smoother: ContactSmoother, seen: deque[tuple[Array, Array]], commands: Array, tensions: Array, on: Array
    ) -> float:
        """How far to pull on, as a share of the largest action.

        seen: commands and tensions of the last steps, to which these are added if they are new. on: actions that pull
        on, (m,).
        """
        if seen and np.abs(commands - seen[-1][0]).max() < _STILL:
            return 0.0
        seen.append((commands, tensions))
        smoother.reset()
        for measured in seen:
            smoother.update(*measured)
        places = commands - self._task.config.action_scale_mm * _MOVES[:, None] * on
        force = np.linalg.norm(smoother.touching_at(places).force, axis=-1)
        excess = force - self._task.config.touch_force
        cost = np.mean(np.where(excess > 0.0, self.caution, 1.0) * excess**2, axis=1)
        return float(_MOVES[cost.argmin()])
