"""Friction of tendons in their holes and of rolling contacts: its coefficients and its state.

Source: docs/theory.md, section 9.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rollingjoint.checked_yaml import located, mapping, number
from rollingjoint.checks import as_number
from rollingjoint.errors import MechanismError

Array = NDArray[np.float64]

LARGEST_MU = 0.25
SMALLEST_PRESLIDING = 0.01  # mm
ROLLING_PRESLIDING = 1e-3  # rad: the turn of a joint over which its rolling resistance builds up

RANGES = {
    "mu": (0.0, LARGEST_MU, ""),
    "presliding": (SMALLEST_PRESLIDING, 10.0, " [mm]"),
    "extra_turn": (0.0, np.pi, " [rad]"),
    "constant": (0.0, 100.0, " [N]"),
    "rolling": (0.0, 10.0, " [mm]"),
    "compliance": (0.0, 10.0, " [mm/N]"),
}


@dataclass(frozen=True)
class CapstanFriction:
    """Coulomb friction of a tendon that turns at the holes it passes, with memory of which way it last slipped.

    Across the holes of a link the tension changes by the factor exp(-mu z turn), where z, from -1 (the tendon slips
    towards the tip) to 1 (towards the motor), follows the slip: it sticks until it has slipped about `presliding`.

    Args:
        mu: coefficient of friction, 0 to 0.25.
        presliding: slip over which friction builds up, 0.01 mm or more [mm].
        extra_turn: turn that every link adds, whatever its angle, 0 to pi [rad].
        constant: friction force that every link adds, whatever the tension [N].
        rolling: resistance of every rolling contact, arm of the normal force [mm]; not of arms.
        compliance: stretch of the tendon between the base and its end per newton, spread evenly over the links [mm/N].
            It decides which holes slip as the tension changes; the tendon's own stiffness stays as it is.
    Raises:
        MechanismError: a number that is not in its range.
    Source: docs/theory.md, section 9.
    """

    mu: float
    presliding: float = 0.02
    extra_turn: float = 0.0
    constant: float = 0.0
    rolling: float = 0.0
    compliance: float = 0.0

    def __post_init__(self) -> None:
        for name, (low, high, unit) in RANGES.items():
            value, allowed = getattr(self, name), f"a number from {low:g} to {high:g}{unit}".replace("3.14159", "pi")
            object.__setattr__(
                self, name, as_number(f"friction {name}", value, low, high, allowed=allowed, error=MechanismError)
            )

    @property
    def acts(self) -> bool:
        """True if any coefficient is not zero."""
        return self.mu > 0.0 or self.constant > 0.0 or self.rolling > 0.0


NO_FRICTION = CapstanFriction(0.0)


def friction_from_dict(where: str, value: object) -> CapstanFriction:
    """The friction that a mapping in a mechanism file describes; ConfigError with the place for a wrong one."""
    content = mapping(where, value, tuple(RANGES), required=("mu",))
    numbers = {key: number(f"{where}.{key}", entry) for key, entry in content.items()}
    with located(where):
        return CapstanFriction(**numbers)


def friction_to_dict(friction: CapstanFriction | None) -> dict[str, dict[str, float]]:
    """The key of a mechanism file that makes the same friction exactly; none for None."""
    return {} if friction is None else {"friction": asdict(friction)}


def checked_friction(friction: object, what: str = "friction") -> CapstanFriction | None:
    """The friction; MechanismError unless it is a CapstanFriction or None."""
    if friction is not None and not isinstance(friction, CapstanFriction):
        raise MechanismError(
            what, friction, "a CapstanFriction or None", "CapstanFriction(0.1) has a coefficient of 0.1."
        )
    return friction


def friction_coefficients(friction: CapstanFriction) -> tuple[float, ...]:
    """A row of the kernels' FrictionLaw.tendons: its numbers but the rolling resistance."""
    return friction.mu, friction.presliding, friction.extra_turn, friction.constant, friction.compliance


class FrictionState(NamedTuple):
    """State of friction after a step, or after many with a leading axis B; the history of the next one.

    Attributes:
        states: (n - 1, m) friction state of every tendon in links 0 to n - 2, -1 to 1; it sticks in between.
        slips: (n - 1, m) slip coordinate: length of the tendon's gaps beyond the link, less its stretch [mm].
        grips: (n - 1, m) friction force of the link's holes where the tendon slips [N].
        angles: (n - 1,) joint angles [rad].
        rolling: (n - 1,) state of the rolling resistance, -1 to 1.
    """

    states: Array
    slips: Array
    grips: Array
    angles: Array
    rolling: Array

    def row(self, index: int) -> FrictionState:
        """The state of one row of a batch."""
        return FrictionState(*[array[index] for array in self])
