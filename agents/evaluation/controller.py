"""The Controller protocol, and what a controller sees of many episodes at a time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from rj_gym.tracking.arrays import AGE
from rj_gym.tracking.task import TrackingTask
from rollingjoint.errors import InvalidInput
from rollingjoint.statics.solve import solve_lengths_batch
from rollingjoint.transmission import limited_tension

Array = NDArray[np.float64]
HANGING = (0.0, 0.0, 1.0)  # the nominal direction of gravity, of an arm


class Controller(Protocol):
    """Anything that turns what it sees into actions, for B episodes side by side.

    An episode must not depend on those beside it. Actions are also requested for episodes that have ended, and
    ignored.
    """

    def begin(self, task: TrackingTask, episodes: int) -> None:
        """This many episodes begin together; the task is None where the environment is not one of rj_gym."""

    def act(self, seen: Seen) -> NDArray[Any]:
        """The actions, (B, m) in [-1, 1]: the share of action_scale_mm by which each tendon is pulled in."""


@dataclass(frozen=True)
class Seen:
    """What an agent sees of B episodes, read out of the observation in mm, rad, N when it is asked for.

    Positions have d coordinates, 2 of a planar chain and 3 of an arm. Only a planar chain shows `poses` of its links.

    Args:
        observation: as the environment gave it: (B, entries) float32, or a dict of such arrays where it has goals or
            shows the privileged state.
        task: the tracking task; without it nothing but the observation can be read.
    """

    observation: Any
    task: TrackingTask | None = None

    @property
    def sees(self) -> str:
        """What of the pose is measured: "all", "tip" or "none"."""
        return self._task.config.sensing.pose

    @property
    def picture_age(self) -> Array:
        """How many steps old the measured pose is, (B,): 0 where poses are never late."""
        ages = self._entries("picture age") if "picture age" in self._places else np.zeros((self._count, 1))
        return AGE * ages[:, 0]

    @property
    def picture_is_new(self) -> NDArray[np.bool_]:
        """Whether the measured pose came in this step, (B,)."""
        new = self._entries("picture new") if "picture new" in self._places else np.ones((self._count, 1))
        return new[:, 0] > 0.5

    @property
    def privileged(self) -> Array:
        """The privileged state of an environment that shows it beside its observation, (B, K), in its units."""
        if not isinstance(self.observation, Mapping) or "privileged" not in self.observation:
            raise InvalidInput("privileged", self._task.config.privileged, "'observation'", "This controller needs it.")
        return np.asarray(self.observation["privileged"], float)

    @property
    def tip(self) -> Array:
        """Measured position of the tip, (B, d) [mm].

        Raises:
            InvalidInput: it is not measured; so do the properties below that need a pose.
        """
        self._need("all", "tip")
        return self._task.length * self._entries(*(f"{self._tip_name} {axis}" for axis in self._axes))

    @property
    def target(self) -> Array:
        """Where the tip should be now, (B, d) [mm]."""
        if self._has_goals:
            return self._task.length * np.asarray(self.observation["desired_goal"], float)[:, : len(self._axes)]
        return self._task.length * self._entries(*(f"target {axis}" for axis in self._axes))

    @property
    def error(self) -> Array:
        """Target minus measured tip, (B, d) [mm]."""
        return self.target - self.tip

    @cached_property
    def poses(self) -> Array:
        """Measured x, y, angle of every link, base first, (B, n, 3) [mm, rad]; joints turn by less than half a turn."""
        self._need("all")
        n = self._task.mechanism.n_links
        entries = [f"link {k} {what}" for k in range(1, n) for what in ("x", "y", "cos angle", "sin angle")]
        x, y, cos, sin = np.moveaxis(self._entries(*entries).reshape(-1, n - 1, 4), -1, 0)
        turns = np.diff(np.arctan2(sin, cos), axis=1, prepend=0.0)
        angles = np.cumsum((turns + np.pi) % (2 * np.pi) - np.pi, axis=1)
        poses = np.zeros((len(x), n, 3))
        poses[:, 1:] = np.stack([self._task.length * x, self._task.length * y, angles], axis=-1)
        return poses

    @property
    def joint_angles(self) -> Array:
        """Measured joint angles, (B, n - 1) [rad]."""
        return np.diff(self.poses[..., 2], axis=1)

    @property
    def commands(self) -> Array:
        """Commanded tendon lengths, (B, m) [mm]: measured motor positions, which differ by play from the tendons'."""
        tendons = range(self._task.mechanism.n_tendons)
        away = self._entries(*(f"tendon {j} command" for j in tendons))
        return self._task.neutral_lengths + self._task.config.command_scale_mm * away

    @cached_property
    def tensions(self) -> Array:
        """Measured tensions, (B, m) [N]; where they are not observed, those of the model at pose and commands.

        The pose of an arm is not measured either: then they are those of the hanging arm under the commands.
        """
        config, mechanism = self._task.config, self._task.mechanism
        if config.observe_tensions:
            tendons = range(mechanism.n_tendons)
            return config.tension_range[1] * self._entries(*(f"tendon {j} tension" for j in tendons))
        if self._task.dimension == 3:
            hanging = [mechanism.gravity(HANGING)]
            return solve_lengths_batch(mechanism, self.commands, hanging, tension_limits=config.tension_range).tensions
        stretch = mechanism.tendon_lengths(self.joint_angles) - self.commands
        return limited_tension(mechanism.stiffnesses * stretch, *config.tension_range)

    def _need(self, *poses: str) -> None:
        if self.sees not in poses:
            allowed = " or ".join(map(repr, poses))
            raise InvalidInput("sensing.pose", self.sees, allowed, "This controller needs measured poses.")

    @property
    def _has_goals(self) -> bool:
        return isinstance(self.observation, Mapping) and "desired_goal" in self.observation

    @property
    def _count(self) -> int:
        """B."""
        return len(self.observation["observation"] if isinstance(self.observation, Mapping) else self.observation)

    @property
    def _axes(self) -> str:
        return "xyz"[: self._task.dimension]

    @property
    def _shows_tip_alone(self) -> bool:
        """Whether the tip is measured and nothing else of the pose, as of an arm."""
        return "tip x" in self._places

    @property
    def _tip_name(self) -> str:
        """What the observation calls the tip: of a planar chain it is the last link."""
        return "tip" if self._shows_tip_alone else f"link {self._task.mechanism.n_links - 1}"

    @property
    def _task(self) -> TrackingTask:
        if self.task is None:
            raise InvalidInput("environment", "not one of rj_gym", "rj_gym/...", "This controller needs its task.")
        return self.task

    @cached_property
    def _places(self) -> dict[str, int]:
        return {entry.name: place for place, entry in enumerate(self._task.entries(self._has_goals))}

    def _entries(self, *names: str) -> Array:
        """These entries of the observation, (B, len(names)), in their units."""
        vectors = self.observation["observation"] if isinstance(self.observation, Mapping) else self.observation
        return np.take(np.asarray(vectors, float), self._columns(names), axis=1)  # C order: kernels compile once

    def _columns(self, names: Sequence[str]) -> list[int]:
        missing = [name for name in names if name not in self._places]
        if missing:
            hint = "The environment does not show what this controller needs."
            raise InvalidInput("observation entry", missing[0], f"one of {', '.join(self._places)}", hint)
        return [self._places[name] for name in names]
