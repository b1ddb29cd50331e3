"""Demands of a contact line on friction and on teeth, from the forces of two point contacts at its ends.

A line contact carries a reaction by some pressure and friction along it if and only if two contacts at its ends do:
docs/theory.md, section 11.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_HALVINGS = 60  # of an interval of forces


def least_friction(normal: Array, side: Array, axial: Array) -> Array:
    """Smallest coefficient of friction with which two point contacts carry their forces; inf where one of them lifts.

    Args:
        normal, side: force of each contact along the normal and the tangent, (..., 2) [N].
        axial: force along the line, shared by both, (...) [N].
    Source: docs/theory.md, section 11: the root of |axial| = sum of sqrt(mu² normal² - side²).
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        alpha, beta, c = normal**2, side**2, axial**2
        low = np.max(beta / alpha, axis=-1)
        room = np.sqrt(np.maximum(low[..., None] * alpha - beta, 0.0)).sum(axis=-1)
        (first, second), (b, d) = np.moveaxis(alpha, -1, 0), np.moveaxis(beta, -1, 0)
        A, B, C = friction_quadratic(first, second, b, d, c)
        root = 2.0 * C / (B + np.sqrt(np.maximum(B**2 - 4.0 * A * C, 0.0)))
        squared = np.where(np.abs(axial) <= room, low, np.maximum(root, low))
        return np.where(np.all(normal > 0.0, axis=-1), np.sqrt(squared), np.inf)


def friction_quadratic(first: Any, second: Any, b: Any, d: Any, c: Any) -> tuple[Any, Any, Any]:
    """A, B and C of A mu⁴ - B mu² + C = 0, of which the least friction is the smaller root; arrays or tensors (...).

    Args:
        first, second: squares of the normal forces of both contacts [N²].
        b, d: squares of their tangential forces [N²].
        c: square of the force along the line [N²].
    """
    total = c + b + d
    A = (first - second) ** 2
    B = 2.0 * (first + second) * total - 4.0 * (first * d + second * b)
    return A, B, total**2 - 4.0 * b * d


def least_tooth_force(normal: Array, side: Array, axial: Array, friction: float, shoulders: bool) -> Array:
    """Largest force on teeth at the ends of a line, where they take over from friction as evenly as they can (...) [N].

    An end that lifts has no friction. inf where teeth without shoulders leave more axial force than friction holds.

    Args:
        normal, side: force at each end along the normal and the tangent, (..., 2) [N].
        axial: force along the line, shared by both, (...) [N].
        friction: coefficient beside the teeth.
        shoulders: teeth hold along the line, too, as pins do.
    Source: docs/theory.md, section 11: the root of |axial| = sum of the axial forces that both ends can carry.
    """
    held, side, axial = friction * np.maximum(normal, 0.0), np.abs(side), np.abs(axial)
    low = np.max(np.maximum(side - held, 0.0), axis=-1)
    high = low + axial if shoulders else np.max(side, axis=-1)

    def carries(force: Array) -> NDArray[np.bool]:
        radius = held + force[..., None] if shoulders else held
        beside = side if shoulders else np.maximum(side - force[..., None], 0.0)
        return np.asarray(np.sqrt(np.maximum(radius**2 - beside**2, 0.0)).sum(axis=-1) >= axial)

    enough, possible, least = carries(low), carries(high), low
    for _ in range(_HALVINGS):
        middle = 0.5 * (least + high)
        done = carries(middle)
        least, high = np.where(done, least, middle), np.where(done, middle, high)
    return np.asarray(np.where(enough, low, np.where(possible, high, np.inf)))
