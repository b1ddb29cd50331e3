"""From motors to tendons: play, the friction of a sheath, and the limits of tension.

    p ← clip(p, q - h, q + h)                           play (backlash) of half width h
    T = clip(k (l - p), low, high),  then p ← l - T / k     the motor holds at `low` and gives way at `high`
    T_motor = T exp(ν ζ),  ζ = (p - q) / h                  friction of the bent sheath, by the capstan's law
    a pull of q ends where T_motor = limit                  a motor with a limit of its own, before the sheath

A motor at q [mm] moves its tendon through play: p is the unstretched length of the tendon [mm]. A tendon
of length l [mm] and stiffness k [N/mm] then has the tension T [N] where the sheath ends, and its motor measures
T_motor [N]. ζ is 1 while the motor pulls the tendon in, -1 while it pays out, and passes from one to the other as the
play is crossed; ν is the coefficient of friction times the turn of the sheath.

A motor with a limit of its own stops where T_motor reaches it while it pulls in: in its play, where T stays, or with
its tendon, where T = limit / exp(ν) and ζ = 1. At rest it holds whatever T becomes, and paying out has no limit.

Functions here are of numbers or arrays of any shapes that broadcast, and return new arrays (numbers for numbers). They
never raise for NaN or infinite numbers. In kernels the same formulas are parts of the same names, from
`rollingjoint.compiled`; both give the same numbers, to the last bit. For tensors they are in
`rollingjoint.differentiable.formulas`. Source: docs/theory.md, section 10.

Modules:
    kernels: the formulas, compiled.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.transmission import kernels

Array = NDArray[np.float64]

__all__ = [
    "at_limit",
    "elastic_tension",
    "limited_tension",
    "play_contact",
    "play_inverse",
    "play_place",
    "play_step",
    "pull_end",
    "pull_limit",
    "sheath_direction",
    "sheath_ratio",
    "unstretched_length",
]


def play_step(tendon: ArrayLike, motor: ArrayLike, half_width: ArrayLike) -> Array:
    """p after a step of the motor: the play operator, which depends on the way of the motor and not on its speed.

    Args:
        tendon: p before the step [mm]. motor: q after it [mm]. half_width: h, 0 or more [mm].
    Returns:
        [mm]; p where q is NaN.
    """
    return _filled(kernels.play_steps, tendon, motor, half_width)


def play_contact(tendon: ArrayLike, motor: ArrayLike, half_width: ArrayLike) -> Array:
    """The end of the play that moves the tendon in a step: 1 as it is pulled in, -1 as it is paid out, 0 where none.

    Args:
        tendon: p before the step [mm]. motor: q after it [mm]. half_width: h, 0 or more [mm].
    """
    return _filled(kernels.play_contacts, tendon, motor, half_width)


def play_place(tendon: ArrayLike, motor: ArrayLike, half_width: ArrayLike) -> Array:
    """Position of a tendon in its play: (p - q) / h, 0 without play; beyond [-1, 1] for beliefs, or by rounding.

    Args:
        tendon: p [mm]. motor: q [mm]. half_width: h, 0 or more [mm].
    """
    return _filled(kernels.play_places, tendon, motor, half_width)


def play_inverse(tendon: ArrayLike, move: ArrayLike, half_width: ArrayLike) -> Array:
    """q that moves a tendon by a distance, whichever way it was moved before: the inverse of the play.

    Args:
        tendon: p before the step [mm]. move: its change [mm]; one of 0 counts as pulling in.
        half_width: h, 0 or more [mm].
    Returns:
        [mm].
    """
    return _filled(kernels.play_inverses, tendon, move, half_width)


def sheath_direction(tendon: ArrayLike, motor: ArrayLike, half_width: ArrayLike) -> Array:
    """ζ, within [-1, 1]: position of a tendon in its play; 0 without play, where no friction is modelled.

    Args:
        tendon: p [mm]. motor: q [mm]. half_width: h, 0 or more [mm].
    """
    return _filled(kernels.sheath_directions, tendon, motor, half_width)


def sheath_ratio(friction: ArrayLike, direction: ArrayLike) -> Array:
    """Tension that the motor measures over the one that arrives behind the sheath: exp(ν ζ).

    Args:
        friction: ν, 0 or more. direction: ζ.
    """
    return _filled(kernels.sheath_ratios, friction, direction)


def pull_limit(limit: ArrayLike, friction: ArrayLike, half_width: ArrayLike) -> Array:
    """T at which a motor that pulls its tendon in reaches its limit: limit / exp(ν); the limit itself without play.

    Args:
        limit: of the tension at the motor [N]. friction: ν, 0 or more. half_width: h, 0 or more [mm].
    """
    return _filled(kernels.pull_limits, limit, friction, half_width)


def pull_end(
    tendon: ArrayLike,
    motor: ArrayLike,
    goal: ArrayLike,
    tension: ArrayLike,
    limit: ArrayLike,
    friction: ArrayLike,
    half_width: ArrayLike,
) -> Array:
    """q where a pull ends while the tendon stays: at its goal, or before it where T exp(ν ζ) reaches the limit [mm].

    Args:
        tendon: p [mm]. motor: q before the pull [mm], where it stays if it is at its limit there.
        goal: q that is asked for, below `motor` [mm].
        tension: T [N]. limit: of the tension at the motor [N]. friction: ν. half_width: h [mm].
    """
    return _filled(kernels.pull_ends, tendon, motor, goal, tension, limit, friction, half_width)


def at_limit(tension: ArrayLike, low: ArrayLike, high: ArrayLike) -> NDArray[np.bool_]:
    """Whether a motor holds or gives way: a tension, or a pull k (l - p), at or beyond a limit [N]."""
    reached: NDArray[np.bool_] = _filled(kernels.limits_reached, tension, low, high) > 0.0
    return reached


def limited_tension(pull: ArrayLike, low: ArrayLike, high: ArrayLike) -> Array:
    """T of an elastic tendon: its pull k (l - p) within the limits of its motor [N]."""
    return _filled(kernels.limited_tensions, pull, low, high)


def elastic_tension(
    length: ArrayLike, unstretched: ArrayLike, stiffness: ArrayLike, low: ArrayLike, high: ArrayLike
) -> Array:
    """T of an elastic tendon, clip(k (l - p), low, high).

    Args:
        length: l [mm]. unstretched: p, the length that its motor commands [mm]. stiffness: k [N/mm].
        low, high: limits of its motor [N].
    """
    return _filled(kernels.elastic_tensions, length, unstretched, stiffness, low, high)


def unstretched_length(length: ArrayLike, tension: ArrayLike, stiffness: ArrayLike) -> Array:
    """p of an elastic tendon, l - T / k: the command that holds it.

    Args:
        length: l [mm]. tension: T [N]. stiffness: k [N/mm].
    """
    return _filled(kernels.unstretched_lengths, length, tension, stiffness)


def _filled(fill: Callable[..., None], *values: ArrayLike) -> Any:
    """Output of a kernel for values that broadcast against each other, in their common shape."""
    arrays = [np.asarray(value, np.float64) for value in values]
    first, *others = {array.shape for array in arrays}
    shape = np.broadcast_shapes(first, *others) if others else first
    output = np.empty(shape)
    fill(*(_row(array, shape) for array in arrays), output.reshape(-1))
    return output if shape else output[()]


def _row(array: Array, shape: tuple[int, ...]) -> Array:
    """An array spread to a shape, (N,): of the one layout for which kernels are compiled."""
    if array.shape != shape:
        array = np.broadcast_to(array, shape)
    return (array if array.flags.carray else array.copy()).reshape(-1)
