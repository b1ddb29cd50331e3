"""External loads, and the table of rows that the kernels read.

One row acts on one body point x of one link and is the sum of everything a row can hold:
world force + body force turned with the link + spring k (anchor - x), and a moment.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rollingjoint.errors import InvalidInput, as_floats, as_integer

LOAD_COLUMNS = ("link", "px", "py", "fx", "fy", "bx", "by", "moment", "k", "ax", "ay")
"""Columns of a load table: link, body point [mm], world force, body force [N], moment [N·mm], spring [N/mm], anchor."""

Pair = tuple[float, float]


@dataclass(frozen=True)
class WorldForce:
    """A force of fixed direction (a dead load) at a body point, and a moment [N, N·mm, mm]."""

    link: int
    force: Pair
    moment: float = 0.0
    point: Pair = (0.0, 0.0)


@dataclass(frozen=True)
class BodyWrench:
    """A force that turns with the link (a follower load) at a body point, and a moment [N, N·mm, mm]."""

    link: int
    force: Pair
    moment: float = 0.0
    point: Pair = (0.0, 0.0)


@dataclass(frozen=True)
class Spring:
    """A linear spring of zero rest length from a body point to a world point [N/mm, mm]."""

    link: int
    stiffness: float
    anchor: Pair
    point: Pair = (0.0, 0.0)


@dataclass(frozen=True)
class Gravity:
    """The weight of every link [N], base first, acting along `direction` at body points (default: link origins)."""

    weights: Sequence[float]
    direction: Pair = (0.0, -1.0)
    points: Sequence[Pair] | None = None


Load = WorldForce | BodyWrench | Spring | Gravity


def load_table(loads: Sequence[Load], n_links: int) -> NDArray[np.float64]:
    """Rows of LOAD_COLUMNS for the loads, (rows, 11).

    Raises:
        InvalidInput: no list of loads, a link that does not exist, a wrong number of weights or coordinates, text.
    """
    if not isinstance(loads, list | tuple) and (isinstance(loads, Load) or not isinstance(loads, Iterable)):
        raise InvalidInput("loads", loads, "a list of loads, such as [WorldForce(-1, (0.5, 0.0))]")
    rows = [row for load in loads for row in _rows(load, n_links)]
    return np.array(rows, dtype=float).reshape(len(rows), len(LOAD_COLUMNS))


def _rows(load: Load, n_links: int) -> list[list[float]]:
    match load:
        case WorldForce():
            return [_row(load, n_links, world=_pair("load force", load.force), moment=load.moment)]
        case BodyWrench():
            return [_row(load, n_links, body=_pair("load force", load.force), moment=load.moment)]
        case Spring():
            return [_row(load, n_links, spring=load.stiffness, anchor=_pair("spring anchor", load.anchor))]
        case Gravity():
            return _gravity_rows(load, n_links)
    raise InvalidInput("load", load, "WorldForce, BodyWrench, Spring or Gravity")


def _gravity_rows(load: Gravity, n_links: int) -> list[list[float]]:
    allowed = f"{n_links} weights [N] (and points), one per link, the base included"
    weights = as_floats("Gravity weights", load.weights, allowed)
    points = [(0.0, 0.0)] * n_links if load.points is None else list(load.points)
    if weights.shape != (n_links,) or len(points) != n_links:
        raise InvalidInput("Gravity weights", load.weights, allowed)
    dx, dy = _pair("Gravity direction", load.direction)
    norm = float(np.hypot(dx, dy))
    if norm == 0:
        raise InvalidInput("Gravity direction", load.direction, "a direction other than (0, 0)")
    forces = [(weight * dx / norm, weight * dy / norm) for weight in weights]
    acting = zip(forces, points, strict=True)
    return [
        _row(WorldForce(link, force, point=point), n_links, world=force) for link, (force, point) in enumerate(acting)
    ]


def _row(
    load: WorldForce | BodyWrench | Spring,
    n_links: int,
    *,
    world: Pair = (0.0, 0.0),
    body: Pair = (0.0, 0.0),
    moment: float = 0.0,
    spring: float = 0.0,
    anchor: Pair = (0.0, 0.0),
) -> list[float]:
    point = _pair("load point", load.point)
    numbers = _number("load moment", moment), _number("spring stiffness", spring)
    return [link_index(load.link, n_links), *point, *world, *body, *numbers, *anchor]


def link_index(link: int, n_links: int) -> int:
    """The link counted from 0; -1 is the tip.

    Raises:
        InvalidInput: a link that does not exist.
    """
    if type(link) is int and -n_links <= link < n_links:
        return link % n_links
    allowed = f"0 (the base) to {n_links - 1}, or -1 (the tip) to {-n_links}"
    index = as_integer("link", link, allowed)
    if not -n_links <= index < n_links:
        raise InvalidInput("link", link, allowed)
    return index % n_links


def _number(what: str, value: float) -> float:
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError):
        raise InvalidInput(what, value, "a number") from None


def _pair(what: str, values: Pair) -> Pair:
    try:
        x, y = values
        return float(x), float(y)
    except (TypeError, ValueError, OverflowError):
        raise InvalidInput(what, values, "two numbers (x, y)") from None
