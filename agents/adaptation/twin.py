"""What is believed of a robot before it was on the bench, and robots as the numbers that a search changes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from agents.controllers.controller import Array
from agents.robots.robot import Robot
from rollingjoint import five_link


@dataclass(frozen=True)
class Belief:
    """A field of Robot: a normal distribution, and bounds beyond which it cannot be; each a number or an array."""

    mean: float
    sd: ArrayLike
    low: ArrayLike
    high: ArrayLike


BELIEFS = {
    "play_mm": Belief(1.75, 1.5, 0.05, 8.0),
    "sheath_friction": Belief(0.3, 0.3, 0.0, 1.0),
    "mu": Belief(0.05, 0.05, 0.0, 0.25),
    "stiffness": Belief(1.0, 0.2, 0.4, 2.0),
    "motor_offsets": Belief(0.0, 0.5, -3.0, 3.0),
    "surface_errors": Belief(0.0, (0.1, 0.1, 0.01), (-0.5, -0.5, -0.05), (0.5, 0.5, 0.05)),
}
"""About the ranges of rj_gym/Instrument-v0, twice as wide or more; and that tendons may rub in the chain."""


class Space:
    """Robots as vectors (P,): field after field, in the units of Robot.

    Attributes:
        mean, sd, low, high: of the beliefs, (P,).
        surfaces: where the errors of surfaces begin, the last field.
    """

    def __init__(self) -> None:
        n, m = five_link().n_links, five_link().n_tendons
        self._shapes = {name: (n, 2, 3) if name == "surface_errors" else (m,) for name in BELIEFS}
        self.surfaces = (len(BELIEFS) - 1) * m
        self.mean, self.sd, self.low, self.high = (
            self.vector({name: getattr(belief, what) for name, belief in BELIEFS.items()})
            for what in ("mean", "sd", "low", "high")
        )

    def vector(self, values: Mapping[str, ArrayLike]) -> Array:
        """The vector of these fields, each spread to the shape that it has in Robot."""
        parts = [np.broadcast_to(np.asarray(values[name], float), shape) for name, shape in self._shapes.items()]
        return np.concatenate([part.ravel() for part in parts])

    def with_all(self, **values: float) -> Array:
        """The means, with these fields the same of all tendons."""
        return self.vector({name: belief.mean for name, belief in BELIEFS.items()} | values)

    def fields(self, values: Array) -> dict[str, Array]:
        """A vector in the fields of a Robot."""
        found = {}
        for name, shape in self._shapes.items():
            found[name], values = values[: np.prod(shape)].reshape(shape), values[np.prod(shape) :]
        return found

    def robot(self, values: Array, number: int) -> Robot:
        """The robot of a vector, cut to the bounds."""
        return Robot(number=number, **self.fields(np.clip(values, self.low, self.high)))
