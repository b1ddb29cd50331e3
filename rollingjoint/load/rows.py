"""Checked numbers of loads, and the rows of load tables that are made of them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from rollingjoint.checks import as_floats, as_integer
from rollingjoint.errors import InvalidInput

Pair = tuple[float, float]
Triple = tuple[float, float, float]
Row = dict[str, float]


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


def number(what: str, value: float | Triple) -> float:
    """One number; the errors of these functions are InvalidInput."""
    try:
        return float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        raise InvalidInput(what, value, "a number") from None


def pair(what: str, values: Pair | Triple) -> Pair:
    """Two numbers."""
    try:
        x, y = values  # type: ignore[misc]
        return float(x), float(y)
    except (TypeError, ValueError, OverflowError):
        raise InvalidInput(what, values, "two numbers (x, y)") from None


def triple(what: str, values: object, unset: object = None) -> Triple:
    """Three numbers; zeros for the default of a planar load."""
    if type(values) is type(unset) and values == unset:
        return 0.0, 0.0, 0.0
    array = as_floats(what, values, "three numbers (x, y, z)")
    if array.shape != (3,):
        raise InvalidInput(what, values, "three numbers (x, y, z)")
    x, y, z = array.tolist()
    return x, y, z


def body_point(point: Any) -> Pair:
    """Where on its link a load acts [mm]."""
    return pair("load point", point)


def at_planar(load: Any, n_links: int) -> Row:
    """Where a load acts on a planar chain."""
    px, py = body_point(load.point)
    return {"link": link_index(load.link, n_links), "px": px, "py": py}


def at_spatial(load: Any, n_links: int) -> Row:
    """Where a load acts on an arm."""
    point = triple("load point", load.point, unset=(0.0, 0.0))
    return {"link": link_index(load.link, n_links)} | along("p", point)


def wrench(force: str, moment: str, load: Any) -> Row:
    """Force and moment of a load on an arm, in columns of these letters."""
    forces, moments = triple("load force", load.force), triple("load moment", load.moment, unset=0.0)
    return along(force, forces) | along(moment, moments)


def along(letter: str, values: Iterable[float]) -> Row:
    """Three values in the columns of x, y and z."""
    return dict(zip((letter + axis for axis in "xyz"), values, strict=True))
