"""Robots with play, friction, stiffness, surfaces and motors outside the ranges of rj_gym/Instrument-v0.

Robot k is a function of k alone. Its numbers are drawn once from a generator with a seed of this file, so that the
robots are the same everywhere; no number changes from episode to episode. Generation 1 has limits of tension besides.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np

from agents.controllers.controller import Array
from rollingjoint import RollingChain, five_link
from rollingjoint.chain.variations import varied_chain
from rollingjoint.checks import as_integer
from rollingjoint.errors import InvalidInput

SEED = 20_250_715
TEST_BED = range(50)
"""Numbers of the robots that controllers are judged on."""

DEVELOPMENT = range(1_000, 1_050)
"""Numbers of other robots, on which anything may be tried."""

PLAY_MM = (3.0, 4.5)  # Instrument-v0: 0.5 to 3
SHEATH_FRICTION = (0.6, 0.8)  # Instrument-v0: 0 to 0.6
MU = (0.02, 0.1)  # Instrument-v0: none
STIFFNESS_ERROR = (0.2, 0.35)  # share of the nominal one, either way; Instrument-v0: up to 0.2
SURFACE_ERROR_MM = (0.1, 0.2)  # of x and of y, either way; Instrument-v0: up to 0.1
SURFACE_ERROR_RAD = (0.01, 0.02)  # either way; Instrument-v0: up to 0.01
MOTOR_OFFSET_MM = (0.5, 1.0)  # either way; Instrument-v0: up to 0.5
TENSION_LIMIT = (30.0, 45.0)  # N, at the motors, of generation 1; Instrument-v0: an ideal 15; Instrument-v1: 10 to 30
GENERATIONS = (0, 1)


@dataclass(frozen=True)
class Robot:
    """One robot of m tendons and n links.

    Args:
        number: which one.
        mu: capstan friction of every tendon in the holes of the chain, (m,).
        play_mm: between motor and tendon, (m,) [mm]. sheath_friction: before the base, nu, (m,).
        stiffness: of the tendons over the nominal one, (m,).
        motor_offsets: error of every motor's length, (m,) [mm].
        surface_errors: displacement (x, y, angle) of every link's parent and child surface, (n, 2, 3) [mm, rad].
        tension_limits: of the motors, (m,) [N]; None in generation 0, with the ideal limit of Instrument-v0.
    """

    number: int
    mu: Array
    play_mm: Array
    sheath_friction: Array
    stiffness: Array
    motor_offsets: Array
    surface_errors: Array
    tension_limits: Array | None = None

    @cached_property
    def chain(self) -> RollingChain:
        """Its mechanism, which no controller sees."""
        return varied_chain(five_link(), self.surface_errors, self.stiffness)

    @property
    def options(self) -> dict[str, Any]:
        """Reset options that make an episode one of this robot."""
        limits = {} if self.tension_limits is None else {"tension_limit": self.tension_limits}
        return limits | {
            "mechanism": self.chain,
            "friction": self.mu,
            "play_mm": self.play_mm,
            "sheath_friction": self.sheath_friction,
            "actuator_offsets": self.motor_offsets,
        }


@cache
def robot(number: int, generation: int = 0) -> Robot:
    """The robot of that number; raises InvalidInput unless it is 0 or more.

    generation: 0, or 1 of the same robot with motors that have limits of their own, and homed by tension.
    """
    number = as_integer("number of a robot", number, 0)
    rng, limits = np.random.default_rng([SEED, number]), None
    if as_integer("generation of a robot", generation, 0, 1):
        limits = np.random.default_rng([SEED, number, generation]).uniform(*TENSION_LIMIT, five_link().n_tendons)
    chain = five_link()
    m, surfaces = chain.n_tendons, (chain.n_links, 2)
    mu, play, sheath = (rng.uniform(*ends, m) for ends in (MU, PLAY_MM, SHEATH_FRICTION))
    stiffness = 1.0 + _either_way(rng, STIFFNESS_ERROR, (m,))
    motors = _either_way(rng, MOTOR_OFFSET_MM, (m,))
    x, y = (_either_way(rng, SURFACE_ERROR_MM, surfaces) for _ in "xy")
    turns = _either_way(rng, SURFACE_ERROR_RAD, surfaces)
    return Robot(number, mu, play, sheath, stiffness, motors, np.stack([x, y, turns], axis=-1), limits)


def robots(numbers: Iterable[int] = TEST_BED, generation: int = 0) -> list[Robot]:
    """The robots of these numbers; raises InvalidInput where there is none."""
    listed = [robot(number, generation) for number in numbers]
    if not listed:
        raise InvalidInput("number of robots", 0, "1 or more")
    return listed


def _either_way(rng: np.random.Generator, limits: tuple[float, float], shape: tuple[int, ...]) -> Array:
    """Numbers of a size within the limits and of either sign."""
    sizes: Array = rng.uniform(*limits, shape)
    return np.where(rng.random(shape) < 0.5, -sizes, sizes)
