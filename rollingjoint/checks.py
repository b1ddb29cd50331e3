"""Checks of single values: each returns the value in its plain form, or raises an error with the allowed values.

The same rules everywhere: 2.0 is an integer, True is not a number, NaN and infinity are not finite, and text is never
read as a number.
"""

from __future__ import annotations

import difflib
import math
import sys
from collections.abc import Sequence
from numbers import Integral, Real

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.errors import InvalidInput

Error = type[InvalidInput]
Triple = tuple[float, float, float]
"""Three coordinates in space."""

_LARGEST = sys.float_info.max
_FLOATS = np.dtype(float)


def as_floats(what: str, values: ArrayLike | object, allowed: str, error: Error = InvalidInput) -> NDArray[np.float64]:
    """A contiguous float copy of the values; `error` unless they are numbers and rows of one length."""
    try:
        return np.array(values, dtype=float, order="C")
    except (TypeError, ValueError, OverflowError):
        raise error(what, values, allowed) from None


def as_vector(what: str, values: ArrayLike | object, size: int, meaning: str) -> NDArray[np.float64]:
    """`size` numbers as floats, (size,); InvalidInput for anything else."""
    allowed = f"{size} numbers, {meaning}"
    array = as_floats(what, values, allowed)
    if array.shape != (size,):
        raise InvalidInput(what, values, allowed)
    return array


def seen_as_vector(what: str, values: ArrayLike | object, size: int, meaning: str) -> NDArray[np.float64]:
    """`as_vector`, but not a copy of an array that fits, in a third of the time: read it before returning."""
    if type(values) is np.ndarray and values.dtype == _FLOATS and values.shape == (size,):
        return values
    return as_vector(what, values, size, meaning)


def as_number(
    what: str,
    value: object,
    low: float = -math.inf,
    high: float = math.inf,
    *,
    allowed: str = "",
    error: Error = InvalidInput,
) -> float:
    """The value as a float; `error` unless it is a finite number from `low` to `high`."""
    number = isinstance(value, Real) and not isinstance(value, bool | np.bool)
    if not number or not max(low, -_LARGEST) <= value <= min(high, _LARGEST):  # type: ignore[operator]
        raise error(what, value, allowed or f"a finite number{_between(low, high)}")
    return float(value)  # type: ignore[arg-type]


def as_positive(what: str, value: object, allowed: str, error: Error = InvalidInput) -> float:
    """The value as a float; `error` unless it is a finite number above 0."""
    return as_number(what, value, math.ulp(0.0), allowed=allowed, error=error)


def as_friction(value: object) -> float:
    """The value as a float; InvalidInput unless it is a coefficient of friction, 0 or more."""
    return as_number("friction", value, 0.0, allowed="a coefficient, 0 or more")


def as_integer(
    what: str,
    value: object,
    low: float = -math.inf,
    high: float = math.inf,
    *,
    allowed: str = "",
    error: Error = InvalidInput,
) -> int:
    """The value as an int; `error` unless it is an integer, such as 2 or 2.0, from `low` to `high`."""
    number = isinstance(value, Integral | Real) and not isinstance(value, bool | np.bool)
    if not number or not low <= value <= high or value % 1:  # type: ignore[operator]
        raise error(what, value, allowed or f"an integer{_between(low, high)}")
    return int(value)  # type: ignore[call-overload]


def as_boolean(what: str, value: object, error: Error = InvalidInput) -> bool:
    """The value; `error` unless it is true or false."""
    if not isinstance(value, bool):
        raise error(what, value, "true or false")
    return value


def as_choice(what: str, value: object, choices: Sequence[str], error: Error = InvalidInput) -> str:
    """The value; `error`, with the nearest choice, unless it is one of the choices."""
    if not isinstance(value, str) or value not in choices:
        raise error(what, value, f"one of {', '.join(map(repr, choices))}", suggestion(str(value), choices))
    return value


def as_range(
    what: str,
    value: object,
    low: float = -math.inf,
    high: float = math.inf,
    *,
    unit: str = "",
    error: Error = InvalidInput,
) -> tuple[float, float]:
    """Two numbers in order from `low` to `high`; `error` for anything else."""
    if not isinstance(value, Sequence | np.ndarray) or isinstance(value, str) or np.shape(value) != (2,):
        raise error(what, value, f"two numbers (low, high) [{unit}]" if unit else "two numbers (low, high)")
    first, second = (as_number(what, number, low, high, error=error) for number in value)
    if first > second:
        raise error(what, value, f"low <= high [{unit}]" if unit else "low <= high", f"Write ({second:g}, {first:g}).")
    return first, second


def suggestion(word: str, valid: Sequence[str]) -> str:
    """A question suggesting the nearest valid word, or an empty text if none is near."""
    nearest = difflib.get_close_matches(word, valid, n=1, cutoff=0.5)
    return f"Did you mean {nearest[0]!r}?" if nearest else ""


def _between(low: float, high: float) -> str:
    """The bounds in words, with a leading space where there are any."""
    minimum, maximum = (
        f"{bound:.0f}" if abs(bound) < 1e15 and bound % 1 == 0 else f"{bound:g}" for bound in (low, high)
    )
    if high == math.inf:
        return "" if low == -math.inf else f" >= {minimum}"
    return f" <= {maximum}" if low == -math.inf else f" from {minimum} to {maximum}"
