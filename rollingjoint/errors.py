"""Exceptions that name the value, what was expected and the mend, and the conversions that raise them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray


class RollingJointError(Exception):
    """Base of everything this project raises on purpose."""


class InvalidInput(RollingJointError, ValueError):
    """An argument that cannot be used.

    Args:
        what: the argument, as the caller knows it.
        value: the offending value.
        allowed: what was expected, in words.
        mend: what to do about it (optional).
    """

    def __init__(self, what: str, value: object, allowed: str, mend: str = "") -> None:
        self.what, self.value, self.allowed, self.mend = what, value, allowed, mend
        super().__init__(what, value, allowed, mend)

    def __str__(self) -> str:
        text = f"{self.what} = {_short(self.value)}: expected {self.allowed}."
        return f"{text} {self.mend}" if self.mend else text


class MechanismError(InvalidInput):
    """A mechanism that cannot be built."""


class ConfigError(InvalidInput):
    """A configuration file, or one of its keys, that cannot be used."""


class SolverError(RollingJointError, RuntimeError):
    """An equilibrium that the caller required and the solver could not give."""


def as_floats(
    what: str, values: ArrayLike | object, allowed: str, error: type[InvalidInput] = InvalidInput
) -> NDArray[np.float64]:
    """A contiguous float copy of the values; `error` unless they are numbers and rows of one length."""
    try:
        return np.array(values, dtype=float, order="C")
    except (TypeError, ValueError, OverflowError):
        raise error(what, values, allowed) from None


def as_integer(
    what: str, value: object, allowed: str, error: type[InvalidInput] = InvalidInput, low: float = -math.inf
) -> int:
    """The value as an int; `error` unless it is a whole number, such as 2 or 2.0, of at least `low`."""
    try:
        number = int(value)  # type: ignore[call-overload]
    except (TypeError, ValueError, OverflowError):
        raise error(what, value, allowed) from None
    if number != value or number < low:
        raise error(what, value, allowed)
    return int(number)


def _short(value: object, limit: int = 120) -> str:
    try:
        text = repr(value)
    except ValueError:  # an integer of thousands of digits, which Python does not print
        text = f"a very large {type(value).__name__}"
    return text if len(text) <= limit else text[: limit - 3] + "..."
