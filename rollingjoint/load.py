"""External loads, and the table of rows that the kernels read.

One row acts on one body point x of one link and is the sum of everything a row can hold:
world force + body force turned with the link + spring k (anchor - x), and a moment.
Planar chains take pairs (x, y) and a moment; spatial ones triples (x, y, z) throughout.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rollingjoint.checks import as_floats, as_integer
from rollingjoint.errors import InvalidInput

LOAD_COLUMNS = ("link", "px", "py", "fx", "fy", "bx", "by", "moment", "k", "ax", "ay")
"""Columns of a load table: link, body point [mm], world force, body force [N], moment [N·mm], spring [N/mm], anchor."""

SPATIAL_LOAD_COLUMNS = (
    "link",
    *(f"{what}{axis}" for what in ("p", "f", "m", "b", "n") for axis in "xyz"),
    *("k", "ax", "ay", "az"),
)
"""Columns of a spatial table: link, body point [mm], world force, world moment, body force, body moment [N, N·mm],
spring [N/mm], anchor [mm]."""

Pair = tuple[float, float]
Triple = tuple[float, float, float]


@dataclass(frozen=True)
class WorldForce:
    """A force of fixed direction (a dead load) at a body point, and a moment [N, N·mm, mm]."""

    link: int
    force: Pair | Triple
    moment: float | Triple = 0.0
    point: Pair | Triple = (0.0, 0.0)


@dataclass(frozen=True)
class BodyWrench:
    """A force that turns with the link (a follower load) at a body point, and a moment [N, N·mm, mm]."""

    link: int
    force: Pair | Triple
    moment: float | Triple = 0.0
    point: Pair | Triple = (0.0, 0.0)


@dataclass(frozen=True)
class Spring:
    """A linear spring of zero rest length from a body point to a world point [N/mm, mm]."""

    link: int
    stiffness: float
    anchor: Pair | Triple
    point: Pair | Triple = (0.0, 0.0)


@dataclass(frozen=True)
class Gravity:
    """The weight of every link [N], base first, acting along `direction` at body points (default: link origins)."""

    weights: Sequence[float]
    direction: Pair | Triple = (0.0, -1.0)
    points: Sequence[Pair | Triple] | None = None


Load = WorldForce | BodyWrench | Spring | Gravity


def load_table(loads: Sequence[Load], n_links: int) -> NDArray[np.float64]:
    """Rows of LOAD_COLUMNS for the loads, (rows, 11).

    Raises:
        InvalidInput: no list of loads, a link that does not exist, a wrong number of weights or coordinates, text.
    """
    return _table(loads, n_links, _rows, len(LOAD_COLUMNS))


def spatial_load_table(loads: Sequence[Load], n_links: int) -> NDArray[np.float64]:
    """Rows of SPATIAL_LOAD_COLUMNS for the loads on a spatial chain, (rows, 20).

    Raises:
        InvalidInput: as load_table.
    """
    return _table(loads, n_links, _spatial_rows, len(SPATIAL_LOAD_COLUMNS))


def _table(
    loads: Sequence[Load], n_links: int, rows_of: Callable[[Load, int], list[list[float]]], n_columns: int
) -> NDArray[np.float64]:
    if not isinstance(loads, list | tuple) and (isinstance(loads, Load) or not isinstance(loads, Iterable)):
        raise InvalidInput("loads", loads, "a list of loads, such as [WorldForce(-1, (0.5, 0.0))]")
    rows = [row for load in loads for row in rows_of(load, n_links)]
    return np.array(rows, dtype=float).reshape(len(rows), n_columns)


def _spatial_rows(load: Load, n_links: int) -> list[list[float]]:
    match load:
        case WorldForce() | BodyWrench() | Spring():
            point = _triple("load point", load.point, unset=(0.0, 0.0))
            return [[link_index(load.link, n_links), *point, *_acting(load)]]
        case Gravity():
            weights, at = _weights(load, np.zeros((n_links, 3)) if load.points is None else load.points, n_links)
            centres = as_floats("Gravity points", at, "three numbers (x, y, z) for every link")
            direction = np.array(_triple("Gravity direction", load.direction))
            norm = float(np.linalg.norm(direction))
            if norm == 0 or centres.shape != (n_links, 3):
                raise InvalidInput("Gravity", load, "a direction other than (0, 0, 0), and points (x, y, z)")
            rows = np.zeros((n_links, len(SPATIAL_LOAD_COLUMNS)))
            rows[:, 0], rows[:, 1:4], rows[:, 4:7] = np.arange(n_links), centres, weights[:, None] * direction / norm
            return rows.tolist()
    raise InvalidInput("load", load, "WorldForce, BodyWrench, Spring or Gravity")


def _acting(load: WorldForce | BodyWrench | Spring) -> list[float]:
    """World wrench, body wrench and spring of a load, (16,)."""
    if isinstance(load, Spring):
        return [*[0.0] * 12, _number("spring stiffness", load.stiffness), *_triple("spring anchor", load.anchor)]
    wrench = [*_triple("load force", load.force), *_triple("load moment", load.moment, unset=0.0)]
    return [*wrench, *[0.0] * 10] if isinstance(load, WorldForce) else [*[0.0] * 6, *wrench, *[0.0] * 4]


def _rows(load: Load, n_links: int) -> list[list[float]]:
    match load:
        case WorldForce():
            moment = _number("load moment", load.moment)
            return [_row(load, n_links, world=_pair("load force", load.force), moment=moment)]
        case BodyWrench():
            moment = _number("load moment", load.moment)
            return [_row(load, n_links, body=_pair("load force", load.force), moment=moment)]
        case Spring():
            return [_row(load, n_links, spring=load.stiffness, anchor=_pair("spring anchor", load.anchor))]
        case Gravity():
            return _gravity_rows(load, n_links)
    raise InvalidInput("load", load, "WorldForce, BodyWrench, Spring or Gravity")


def _gravity_rows(load: Gravity, n_links: int) -> list[list[float]]:
    weights, points = _weights(load, [(0.0, 0.0)] * n_links if load.points is None else load.points, n_links)
    dx, dy = _pair("Gravity direction", load.direction)
    norm = float(np.hypot(dx, dy))
    if norm == 0:
        raise InvalidInput("Gravity direction", load.direction, "a direction other than (0, 0)")
    forces = [(weight * dx / norm, weight * dy / norm) for weight in weights]
    acting = zip(forces, points, strict=True)
    return [
        _row(WorldForce(link, force, point=point), n_links, world=force) for link, (force, point) in enumerate(acting)
    ]


def _weights(
    load: Gravity, points: Sequence[Pair | Triple] | NDArray[np.float64], n_links: int
) -> tuple[NDArray[np.float64], list[Any]]:
    """Weights and points of all links, as many as there are links."""
    allowed = f"{n_links} weights [N] (and points), one per link, the base included"
    weights, at = as_floats("Gravity weights", load.weights, allowed), list(points)
    if weights.shape != (n_links,) or len(at) != n_links:
        raise InvalidInput("Gravity weights", load.weights, allowed)
    return weights, at


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
    numbers = moment, _number("spring stiffness", spring)
    return [link_index(load.link, n_links), *point, *world, *body, *numbers, *anchor]


def link_index(link: int, n_links: int) -> int:
    """The link counted from 0; -1 is the tip.

    Raises:
        InvalidInput: a link that does not exist.
    """
    if type(link) is int and -n_links <= link < n_links:
        return link % n_links
    allowed = f"0 (the base) to {n_links - 1}, or -1 (the tip) to {-n_links}"
    index = as_integer("link", link, allowed=allowed)
    if not -n_links <= index < n_links:
        raise InvalidInput("link", link, allowed)
    return index % n_links


def _number(what: str, value: float | Triple) -> float:
    try:
        return float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        raise InvalidInput(what, value, "a number") from None


def _pair(what: str, values: Pair | Triple) -> Pair:
    try:
        x, y = values  # type: ignore[misc]
        return float(x), float(y)
    except (TypeError, ValueError, OverflowError):
        raise InvalidInput(what, values, "two numbers (x, y)") from None


def _triple(what: str, values: object, unset: object = None) -> Triple:
    """Three numbers; zeros for the default of a planar load."""
    if type(values) is type(unset) and values == unset:
        return 0.0, 0.0, 0.0
    array = as_floats(what, values, "three numbers (x, y, z)")
    if array.shape != (3,):
        raise InvalidInput(what, values, "three numbers (x, y, z)")
    x, y, z = array.tolist()
    return x, y, z
