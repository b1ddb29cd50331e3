"""External loads, and the tables of rows that the kernels read.

Each kind of load is one dataclass: its fields and its rows of a table; OPTIONS says how `rj` takes it, and mechanism
files use the names of the fields. One row acts on one body point x of one link and is the sum of everything a row can
hold: world force + body force turned with the link + spring k (anchor - x), and a moment.
Planar chains take pairs (x, y) and a moment; spatial ones triples (x, y, z) throughout.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rollingjoint.checks import as_floats, as_integer, as_number
from rollingjoint.errors import InvalidInput
from rollingjoint.kernels.planar.loads import ACTING, LINK_COLUMNS, LOAD_COLUMNS
from rollingjoint.kernels.spatial.arrays import SPATIAL_LOAD_COLUMNS

__all__ = [
    "LOADS",
    "LOAD_COLUMNS",
    "OPTIONS",
    "SPATIAL_LOAD_COLUMNS",
    "SPRINGS",
    "BodyWrench",
    "Gravity",
    "Load",
    "Option",
    "Spring",
    "TorsionSpring",
    "WorldForce",
    "acts",
    "checked_springs",
    "link_index",
    "load_table",
    "pair_columns",
    "spatial_load_table",
    "with_all_columns",
    "wrong_links",
]

# LOAD_COLUMNS: link, body point [mm], world force, body force [N], moment [N·mm], spring [N/mm], anchor [mm], torsion
# spring [N·mm/rad], its angle at rest [rad] and its other link.
# SPATIAL_LOAD_COLUMNS: link, body point [mm], world force, world moment, body force, body moment [N, N·mm], spring
# [N/mm], anchor [mm].

_PLACES, _SPATIAL_PLACES = (
    {name: place for place, name in enumerate(columns)} for columns in (LOAD_COLUMNS, SPATIAL_LOAD_COLUMNS)
)
_FIRST_COLUMNS = LOAD_COLUMNS.index("ay") + 1  # a table may end after these; the columns that it omits are zero

_POINT, _FORCE = (slice(first, first + 3) for first in map(SPATIAL_LOAD_COLUMNS.index, ("px", "fx")))

Pair = tuple[float, float]
Triple = tuple[float, float, float]
Row = dict[str, float]


class Option(NamedTuple):
    """An option of `rj` for a load at the origin of a link: --name LINK NUMBERS."""

    name: str
    metavar: str
    help: str
    numbers: tuple[str, ...]  # on a planar chain
    spatial: tuple[str, ...]  # on an arm; empty: arms take no such load
    make: Callable[[int, Any], Load]
    optional: int = 0  # how many of the last numbers may be left out

    def names(self, dimension: int) -> tuple[str, ...]:
        """The numbers that follow LINK, on a mechanism in 2 or 3 dimensions."""
        return self.spatial if dimension == 3 else self.numbers


class Load:
    """Base class of all loads. A row holds the columns that are not zero, by name."""

    def rows(self, n_links: int) -> list[Row]:
        """Rows of a planar table."""
        raise InvalidInput("load", self, f"a load that acts on planar chains: {_names(*LOADS)}")

    def spatial_rows(self, n_links: int) -> list[Row] | NDArray[np.float64]:
        """Rows of a spatial table, or such a table."""
        raise InvalidInput("load", self, f"a load that acts on arms: {_names(*_SPATIAL_LOADS)}")


@dataclass(frozen=True)
class WorldForce(Load):
    """A force of fixed direction (a dead load) at a body point, and a moment [N, N·mm, mm]."""

    link: int
    force: Pair | Triple
    moment: float | Triple = 0.0
    point: Pair | Triple = (0.0, 0.0)

    def rows(self, n_links: int) -> list[Row]:
        """Rows of a planar table."""
        moment, (fx, fy) = _number("load moment", self.moment), _pair("load force", self.force)
        return [_at(self, n_links) | {"fx": fx, "fy": fy, "moment": moment}]

    def spatial_rows(self, n_links: int) -> list[Row]:
        """Rows of a spatial table."""
        return [_at_spatial(self, n_links) | _wrench("f", "m", self)]


@dataclass(frozen=True)
class BodyWrench(Load):
    """A force that turns with the link (a follower load) at a body point, and a moment [N, N·mm, mm]."""

    link: int
    force: Pair | Triple
    moment: float | Triple = 0.0
    point: Pair | Triple = (0.0, 0.0)

    def rows(self, n_links: int) -> list[Row]:
        """Rows of a planar table."""
        moment, (bx, by) = _number("load moment", self.moment), _pair("load force", self.force)
        return [_at(self, n_links) | {"bx": bx, "by": by, "moment": moment}]

    def spatial_rows(self, n_links: int) -> list[Row]:
        """Rows of a spatial table."""
        return [_at_spatial(self, n_links) | _wrench("b", "n", self)]


@dataclass(frozen=True)
class Spring(Load):
    """A linear spring of zero rest length from a body point to a world point [N/mm, mm]."""

    link: int
    stiffness: float
    anchor: Pair | Triple
    point: Pair | Triple = (0.0, 0.0)

    def rows(self, n_links: int) -> list[Row]:
        """Rows of a planar table."""
        ax, ay = _pair("spring anchor", self.anchor)
        return [_at(self, n_links) | {"k": _number("spring stiffness", self.stiffness), "ax": ax, "ay": ay}]

    def spatial_rows(self, n_links: int) -> list[Row]:
        """Rows of a spatial table."""
        at, k = _at_spatial(self, n_links), _number("spring stiffness", self.stiffness)
        return [at | {"k": k} | _along("a", _triple("spring anchor", self.anchor))]


@dataclass(frozen=True)
class TorsionSpring(Load):
    """A linear torsion spring between two links of a planar chain; between neighbours it acts about their joint.

    Its energy is 1/2 stiffness (angle of link - angle of other - rest_angle)², its stiffness in N·mm/rad, angles in rad
    in the base frame. The other link is the base unless it is given; -1 is the tip.
    """

    link: int
    stiffness: float
    rest_angle: float = 0.0
    other: int = 0

    def rows(self, n_links: int) -> list[Row]:
        """Rows of a planar table."""
        link, other = link_index(self.link, n_links), link_index(self.other, n_links)
        if link == other:
            raise InvalidInput("TorsionSpring other", self.other, f"a link other than {self.link}")
        k, rest = _number("torsion spring stiffness", self.stiffness), _number("rest angle", self.rest_angle)
        return [{"link": link, "torsion": k, "rest": rest, "other": other}]


@dataclass(frozen=True)
class Gravity(Load):
    """The weight of every link [N], base first, acting along `direction` at body points (default: link origins)."""

    weights: Sequence[float]
    direction: Pair | Triple = (0.0, -1.0)
    points: Sequence[Pair | Triple] | None = None

    def rows(self, n_links: int) -> list[Row]:
        """Rows of a planar table."""
        weights, points = self._weights([(0.0, 0.0)] * n_links if self.points is None else self.points, n_links)
        dx, dy = _pair("Gravity direction", self.direction)
        norm = float(np.hypot(dx, dy))
        if norm == 0:
            raise InvalidInput("Gravity direction", self.direction, "a direction other than (0, 0)")
        forces = [(w * dx / norm, w * dy / norm) for w in weights.tolist()]
        acting = enumerate(zip(map(_point, points), forces, strict=True))
        return [{"link": link, "px": px, "py": py, "fx": fx, "fy": fy} for link, ((px, py), (fx, fy)) in acting]

    def spatial_rows(self, n_links: int) -> NDArray[np.float64]:
        """Rows of a spatial table, whole: a third of the time for an arm of 32 beads."""
        weights, at = self._weights(np.zeros((n_links, 3)) if self.points is None else self.points, n_links)
        centres = as_floats("Gravity points", at, "three numbers (x, y, z) for every link")
        direction = np.array(_triple("Gravity direction", self.direction))
        norm = float(np.linalg.norm(direction))
        if norm == 0 or centres.shape != (n_links, 3):
            raise InvalidInput("Gravity", self, "a direction other than (0, 0, 0), and points (x, y, z)")
        table = np.zeros((n_links, len(SPATIAL_LOAD_COLUMNS)))
        table[:, 0] = np.arange(n_links)
        table[:, _POINT], table[:, _FORCE] = centres, weights[:, None] * direction / norm
        return table

    def _weights(
        self, points: Sequence[Pair | Triple] | NDArray[np.float64], n_links: int
    ) -> tuple[NDArray[np.float64], list[Any]]:
        """Weights and points, checked to be one per link."""
        allowed = f"{n_links} weights [N] (and points), one per link, the base included"
        weights, at = as_floats("Gravity weights", self.weights, allowed), list(points)
        if weights.shape != (n_links,) or len(at) != n_links:
            raise InvalidInput("Gravity weights", self.weights, allowed)
        return weights, at


_NO_FORCE: dict[int, Any] = {1: (0.0, 0.0), 3: (0.0, 0.0, 0.0)}  # by the numbers of a moment

OPTIONS = (
    Option(
        name="moment",
        metavar="M",
        help="moment, on an arm MX MY MZ [N·mm]",
        numbers=("M",),
        spatial=("MX", "MY", "MZ"),
        make=lambda link, m: WorldForce(link, _NO_FORCE[len(m)], m if len(m) > 1 else m[0]),
    ),
    Option(
        name="spring",
        metavar="K",
        help="spring K [N/mm] to the anchor AX AY, on an arm AX AY AZ [mm]",
        numbers=("K", "AX", "AY"),
        spatial=("K", "AX", "AY", "AZ"),
        make=lambda link, numbers: Spring(link, numbers[0], numbers[1:]),
    ),
    Option(
        name="torsion_spring",
        metavar="K",
        help="torsion spring K [N·mm/rad], then angle at rest [rad] (default 0), other link (default 0, the base)",
        numbers=("K", "REST", "OTHER"),
        spatial=(),
        make=lambda link, numbers: TorsionSpring(link, *numbers),
        optional=2,
    ),
    Option(
        name="force",
        metavar="F",
        help="force of fixed direction FX FY, on an arm FX FY FZ [N]",
        numbers=("FX", "FY"),
        spatial=("FX", "FY", "FZ"),
        make=WorldForce,
    ),
    Option(
        name="body_force",
        metavar="F",
        help="force that turns with the link, as above",
        numbers=("FX", "FY"),
        spatial=("FX", "FY", "FZ"),
        make=BodyWrench,
    ),
)
"""The loads that `rj` takes by link, in the order in which it adds them; gravity has options of its own."""

LOADS: tuple[type[Load], ...] = (WorldForce, BodyWrench, Spring, TorsionSpring, Gravity)
_SPATIAL_LOADS = (WorldForce, BodyWrench, Spring, Gravity)
SPRINGS: tuple[type[Any], ...] = (Spring, TorsionSpring)
"""The kinds of loads that can belong to a planar mechanism."""


def load_table(loads: Sequence[Load], n_links: int) -> NDArray[np.float64]:
    """Rows of LOAD_COLUMNS for the loads, (rows, columns).

    Raises:
        InvalidInput: no list of loads, a link that does not exist, a wrong number of weights or coordinates, text.
    """
    return _table(loads, _PLACES, lambda load: load.rows(n_links))


def spatial_load_table(loads: Sequence[Load], n_links: int) -> NDArray[np.float64]:
    """Rows of SPATIAL_LOAD_COLUMNS for the loads on a spatial chain, (rows, columns).

    Raises:
        InvalidInput: as load_table, and a load that acts on planar chains only.
    """
    return _table(loads, _SPATIAL_PLACES, lambda load: load.spatial_rows(n_links))


def checked_springs(springs: object, n_links: int) -> tuple[Load, ...]:
    """The springs that belong to a planar mechanism, with plain numbers in their fields.

    Raises:
        InvalidInput: another kind of load, a link that does not exist, a number that is negative or not finite.
    """
    kinds = _names(*SPRINGS)
    if not isinstance(springs, Iterable):
        raise InvalidInput("springs", springs, f"a list of {kinds}")
    checked = []
    for i, spring in enumerate(springs):
        if not isinstance(spring, SPRINGS):
            raise InvalidInput(f"springs[{i}]", spring, kinds)
        as_number(f"springs[{i}] stiffness", spring.stiffness, 0.0)
        for row in spring.rows(n_links):
            for column, value in row.items():
                as_number(f"springs[{i}] {column}", value)
        checked.append(
            replace(spring, **{each.name: _plain(each.type, getattr(spring, each.name)) for each in fields(spring)})
        )
    return tuple(checked)


def pair_columns(*letters: str) -> list[slice]:
    """The columns of planar load tables that hold the pairs x, y of these letters, such as "p" for px, py."""
    firsts = [LOAD_COLUMNS.index(f"{letter}x") for letter in letters]
    return [slice(first, first + 2) for first in firsts]


def acts(table: NDArray[np.float64]) -> bool:
    """Whether any row of a planar load table has an effect."""
    return bool(np.any(table[..., list(ACTING)]))


def with_all_columns(tables: Any, columns: Sequence[str], pad: Callable[[Any, int], Any]) -> Any:
    """Load tables (..., rows, columns) with the trailing columns that planar ones may omit; None for a wrong width.

    `pad` appends a number of columns of zeros.
    """
    missing = len(columns) - tables.shape[-1]
    if missing == 0:
        return tables
    return pad(tables, missing) if columns is LOAD_COLUMNS and 0 < missing <= len(columns) - _FIRST_COLUMNS else None


def wrong_links(tables: Any, columns: Sequence[str], n_links: int) -> Any:
    """The first column of load tables (..., rows, columns) with a link that does not exist, or None."""
    for name in LINK_COLUMNS:
        if name in columns:
            links = tables[..., columns.index(name)]
            if not bool(((links >= 0) & (links < n_links) & (links % 1 == 0)).all()):
                return links
    return None


def check_table(tables: Any, columns: Sequence[str], n_links: int) -> None:
    """Raise InvalidInput unless load tables (..., rows, columns) have these columns, and links that exist."""
    if not isinstance(tables, np.ndarray) or tables.dtype != float or tables.shape[-1] != len(columns):
        raise InvalidInput("loads", tables, f"a table of floats with {len(columns)} columns")
    links = wrong_links(tables, columns, n_links)
    if links is not None:
        raise InvalidInput("links of the load table", links, f"integers from 0 to {n_links - 1}")


def _table(
    loads: Sequence[Load], places: Mapping[str, int], rows_of: Callable[[Load], list[Row] | NDArray[np.float64]]
) -> NDArray[np.float64]:
    if not isinstance(loads, list | tuple) and (isinstance(loads, Load) or not isinstance(loads, Iterable)):
        raise InvalidInput("loads", loads, "a list of loads, such as [WorldForce(-1, (0.5, 0.0))]")
    rows: list[Row] = []
    tables: list[NDArray[np.float64]] = []
    for load in loads:
        if not isinstance(load, Load):
            raise InvalidInput("load", load, _names(*LOADS))
        more = rows_of(load)
        if isinstance(more, list):
            rows += more
        else:
            tables += [_filled(rows, places), more]
            rows = []
    last = _filled(rows, places)
    return np.concatenate([*tables, last]) if tables else last


def _filled(rows: Sequence[Row], places: Mapping[str, int]) -> NDArray[np.float64]:
    """The table of rows that name the columns that are not zero."""
    flat, begin, width = [0.0] * (len(rows) * len(places)), 0, len(places)
    for row in rows:
        for column, value in row.items():
            flat[begin + places[column]] = value
        begin += width
    return np.array(flat, dtype=float).reshape(len(rows), width)


def _names(*kinds: type) -> str:
    """The names of the kinds in words."""
    *first, last = (kind.__name__ for kind in kinds)
    return f"{', '.join(first)} or {last}" if first else last


def _plain(kind: object, value: Any) -> Any:
    """The value of a field of this annotation, in plain numbers."""
    if kind == "int":
        return int(value)
    return float(value) if kind == "float" else tuple(float(each) for each in value)


def _point(point: Any) -> Pair:
    return _pair("load point", point)


def _at(load: Any, n_links: int) -> Row:
    """Where a load acts on a planar chain."""
    px, py = _point(load.point)
    return {"link": link_index(load.link, n_links), "px": px, "py": py}


def _at_spatial(load: Any, n_links: int) -> Row:
    """Where a load acts on an arm."""
    point = _triple("load point", load.point, unset=(0.0, 0.0))
    return {"link": link_index(load.link, n_links)} | _along("p", point)


def _wrench(force: str, moment: str, load: WorldForce | BodyWrench) -> Row:
    """Force and moment of a load on an arm, in columns of these letters."""
    forces, moments = _triple("load force", load.force), _triple("load moment", load.moment, unset=0.0)
    return _along(force, forces) | _along(moment, moments)


def _along(letter: str, values: Iterable[float]) -> Row:
    """Three values in the columns of x, y and z."""
    return dict(zip((letter + axis for axis in "xyz"), values, strict=True))


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
