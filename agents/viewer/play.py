"""A person as the controller of a tracking environment, with other controllers in the same episode."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from agents.controllers import OpenLoop
from agents.controllers.controller import Array, Controller, Mask, Reading
from agents.runs.environment import EnvConfig
from agents.viewer.controllers import offered_controllers
from agents.viewer.drive import Drive, Film
from rj_gym.tracking.task import TrackingTask
from rollingjoint.checks import as_choice, as_vector
from rollingjoint.errors import InvalidInput

PERSON = "you"


class Hand(Controller):
    """Pulls every tendon as a person sets it."""

    def reset(self, mask: Mask) -> None:
        """Hold still."""
        self.pulls = np.zeros(self.task.action_size)

    def pull(self, pulls: ArrayLike) -> None:
        """Set the pull of each tendon per step, (m,) in units of action_scale_mm, until the next call.

        Raises:
            InvalidInput: anything but m finite numbers.
        """
        self.pulls = np.clip(_finite("pulls", pulls, len(self.pulls), "one per tendon"), -1.0, 1.0)

    def act(self, observations: Any) -> Array:
        """The pulls, (1, m)."""
        return self.pulls[None]


class Pointer(OpenLoop):
    """Brings the tip of the model, not of the mechanism, to a point that a person moves.

    A person who sees the tip or its trend moves the point until the true tip is at the target.
    """

    def reset(self, mask: Mask) -> None:
        """Point at the tip of the resting model."""
        super().reset(mask)
        self.point: Array | None = None

    def aim_at(self, point: ArrayLike) -> None:
        """Move the point to here, (d,) [mm].

        Raises:
            InvalidInput: anything but d finite numbers.
        """
        self.point = _finite("point", point, self.task.dimension, "coordinates in mm")

    def act(self, observations: Any) -> Array:
        """One step towards the point, (1, m); zero before there is one."""
        return np.zeros((1, self.task.action_size)) if self.point is None else super().act(observations)

    def aim(self, reading: Reading) -> Array:
        """The target of the model's tip, (1, d) [mm]."""
        assert self.point is not None
        return self.point[None]


WAYS: Mapping[str, Callable[[], Any]] = {"point": Pointer, "tendons": Hand}
"""The ways in which a person steers."""


@dataclass(frozen=True)
class Seat:
    """The choices of a person before an episode.

    Args:
        env: the environment. seed: of the episode. way: one of WAYS.
        beside: names of others, of `offered_controllers`.
    """

    env: EnvConfig
    seed: int = 0
    way: str = "point"
    beside: Sequence[str] = ()


class Match:
    """A person and other controllers in the same episode: same mechanism, load and target; one step at a time.

    Args:
        seat: the choices of the person.
    Raises:
        RollingJointError: an environment that cannot be made; a way or name that is not known.
    """

    def __init__(self, seat: Seat) -> None:
        self.seat = seat
        self.person: Any = WAYS[as_choice("way", seat.way, list(WAYS))]()
        offered = offered_controllers(seat.env) if seat.beside else {}
        others = [offered[as_choice("controller", name, list(offered))] for name in seat.beside]
        self.drives = [
            Drive(PERSON, seat.env, self.person, seat.seed),
            *(controller.drive(seat.seed) for controller in others),
        ]

    @property
    def over(self) -> bool:
        """Whether the episode has ended for all."""
        return all(drive.over for drive in self.drives)

    @property
    def films(self) -> list[Film]:
        """The films of all controllers so far; the person first."""
        return [drive.film for drive in self.drives]

    @property
    def task(self) -> TrackingTask:
        """The tracking task, without the random draws of the episode."""
        task: TrackingTask = self.drives[0].task
        return task

    def step(self) -> None:
        """One step of all controllers."""
        for drive in self.drives:
            drive.step()

    def close(self) -> None:
        """Free the environments."""
        for drive in self.drives:
            drive.close()


def _finite(name: str, values: ArrayLike, size: int, meaning: str) -> Array:
    numbers = as_vector(name, values, size, meaning)
    if not np.isfinite(numbers).all():
        raise InvalidInput(name, values, f"{size} finite numbers, {meaning}")
    return numbers


def hidden_load(film: Film, step: int) -> str:
    """The load on the mechanism at this step, one line; controllers do not observe it."""
    scene: Any = film.at(step)
    if hasattr(scene, "force"):
        return f"{np.hypot(*scene.force):.2f} N on link {scene.link}"
    tilt = np.degrees(np.arccos(np.clip(scene.gravity[2], -1.0, 1.0)))
    return f"{np.linalg.norm(scene.payload):.2f} N at the tip, gravity {tilt:.0f}° off"
