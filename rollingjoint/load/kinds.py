"""The kinds of loads.

Each is one dataclass: its fields, and its rows of planar and spatial tables; OPTIONS says how `rj` takes it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rollingjoint.checks import Triple, as_floats, as_integer, as_number
from rollingjoint.errors import InvalidInput
from rollingjoint.load.columns import SPATIAL_LOAD_COLUMNS

_POINT, _FORCE = (slice(first, first + 3) for first in map(SPATIAL_LOAD_COLUMNS.index, ("px", "fx")))

Pair = tuple[float, float]
Row = dict[str, float]


class Option(NamedTuple):
    """An option of `rj` for a load at the origin of a link: --name LINK NUMBERS."""

    name: str
    metavar: str
    help: str
    numbers: tuple[str, ...]  # on a planar chain
    spatial: tuple[str, ...]  # on an arm
    make: Callable[[int, Any], Load]
    optional: int = 0  # how many of the last numbers may be left out

    def names(self, dimension: int) -> tuple[str, ...]:
        """The numbers that follow LINK, on a mechanism in 2 or 3 dimensions."""
        return self.spatial if dimension == 3 else self.numbers


class Load:
    """Base class of all loads. A row holds the columns that are not zero, by name."""

    def rows(self, n_links: int) -> list[Row]:
        """Rows of a planar table."""
        raise InvalidInput("load", self, f"a load that acts on planar chains: {in_words(*LOADS)}")

    def spatial_rows(self, n_links: int) -> list[Row] | NDArray[np.float64]:
        """Rows of a spatial table, or such a table."""
        raise InvalidInput("load", self, f"a load that acts on arms: {in_words(*LOADS)}")


@dataclass(frozen=True)
class WorldForce(Load):
    """A force of fixed direction (a dead load) at a body point, and a moment [N, N·mm, mm]."""

    link: int
    force: Pair | Triple
    moment: float | Triple = 0.0
    point: Pair | Triple = (0.0, 0.0)

    def rows(self, n_links: int) -> list[Row]:
        """Rows of a planar table."""
        moment, (fx, fy) = number("load moment", self.moment), pair("load force", self.force)
        return [at_planar(self, n_links) | {"fx": fx, "fy": fy, "moment": moment}]

    def spatial_rows(self, n_links: int) -> list[Row]:
        """Rows of a spatial table."""
        return [at_spatial(self, n_links) | wrench("f", "m", self)]


@dataclass(frozen=True)
class BodyWrench(Load):
    """A force that turns with the link (a follower load) at a body point, and a moment [N, N·mm, mm]."""

    link: int
    force: Pair | Triple
    moment: float | Triple = 0.0
    point: Pair | Triple = (0.0, 0.0)

    def rows(self, n_links: int) -> list[Row]:
        """Rows of a planar table."""
        moment, (bx, by) = number("load moment", self.moment), pair("load force", self.force)
        return [at_planar(self, n_links) | {"bx": bx, "by": by, "moment": moment}]

    def spatial_rows(self, n_links: int) -> list[Row]:
        """Rows of a spatial table."""
        return [at_spatial(self, n_links) | wrench("b", "n", self)]


@dataclass(frozen=True)
class Spring(Load):
    """A linear spring of zero rest length from a body point to a world point [N/mm, mm]."""

    link: int
    stiffness: float
    anchor: Pair | Triple
    point: Pair | Triple = (0.0, 0.0)

    def rows(self, n_links: int) -> list[Row]:
        """Rows of a planar table."""
        ax, ay = pair("spring anchor", self.anchor)
        return [at_planar(self, n_links) | {"k": number("spring stiffness", self.stiffness), "ax": ax, "ay": ay}]

    def spatial_rows(self, n_links: int) -> list[Row]:
        """Rows of a spatial table."""
        at, k = at_spatial(self, n_links), number("spring stiffness", self.stiffness)
        return [at | {"k": k} | along("a", triple("spring anchor", self.anchor))]


@dataclass(frozen=True)
class TorsionSpring(Load):
    """A linear torsion spring between two links; between neighbours it acts about their joint.

    Its energy is 1/2 stiffness (angle of link - angle of other - rest_angle)², its stiffness in N·mm/rad, angles in rad
    in the base frame. The other link is the base unless it is given; -1 is the tip. On an arm the hinges between the
    two links must be parallel, and their angles add up to the angle between the links.
    """

    link: int
    stiffness: float
    rest_angle: float = 0.0
    other: int = 0

    def rows(self, n_links: int) -> list[Row]:
        """Rows of a planar table."""
        link, partner = link_index(self.link, n_links), link_index(self.other, n_links)
        if link == partner:
            raise InvalidInput("TorsionSpring other", self.other, f"a link other than {self.link}")
        k, angle = number("torsion spring stiffness", self.stiffness), number("rest angle", self.rest_angle)
        return [{"link": link, "torsion": k, "rest": angle, "other": partner}]

    def spatial_rows(self, n_links: int) -> list[Row]:
        """Rows of a spatial table."""
        return self.rows(n_links)


@dataclass(frozen=True)
class Gravity(Load):
    """The weight of every link [N], base first, acting along `direction` at body points (default: link origins)."""

    weights: Sequence[float]
    direction: Pair | Triple = (0.0, -1.0)
    points: Sequence[Pair | Triple] | None = None

    def rows(self, n_links: int) -> list[Row]:
        """Rows of a planar table."""
        weights, points = self._weights([(0.0, 0.0)] * n_links if self.points is None else self.points, n_links)
        dx, dy = pair("Gravity direction", self.direction)
        norm = float(np.hypot(dx, dy))
        if norm == 0:
            raise InvalidInput("Gravity direction", self.direction, "a direction other than (0, 0)")
        forces = [(w * dx / norm, w * dy / norm) for w in weights.tolist()]
        numbered = enumerate(zip(map(body_point, points), forces, strict=True))
        return [{"link": link, "px": px, "py": py, "fx": fx, "fy": fy} for link, ((px, py), (fx, fy)) in numbered]

    def spatial_rows(self, n_links: int) -> NDArray[np.float64]:
        """Rows of a spatial table, whole: a third of the time for an arm of 32 beads."""
        weights, at = self._weights(np.zeros((n_links, 3)) if self.points is None else self.points, n_links)
        centres = as_floats("Gravity points", at, "three numbers (x, y, z) for every link")
        direction = np.array(triple("Gravity direction", self.direction))
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


LOADS: tuple[type[Load], ...] = (WorldForce, BodyWrench, Spring, TorsionSpring, Gravity)
SPRINGS: tuple[type[Any], ...] = (Spring, TorsionSpring)
"""The kinds of loads that can belong to a mechanism."""

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
        spatial=("K", "REST", "OTHER"),
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
"""The loads that `rj` takes by link, in the order in which it adds them; gravity has separate options."""


def in_words(*kinds: type) -> str:
    """The names of the kinds in words."""
    *first, last = (kind.__name__ for kind in kinds)
    return f"{', '.join(first)} or {last}" if first else last


def checked_springs(springs: object, n_links: int, dimension: int) -> tuple[Load, ...]:
    """The springs that belong to a mechanism in 2 or 3 dimensions, with plain numbers in their fields.

    Raises:
        InvalidInput: another kind of load, a link that does not exist, a number that is negative or not finite.
    """
    kinds = in_words(*SPRINGS)
    if not isinstance(springs, Iterable):
        raise InvalidInput("springs", springs, f"a list of {kinds}")
    checked = []
    for i, spring in enumerate(springs):
        if not isinstance(spring, SPRINGS):
            raise InvalidInput(f"springs[{i}]", spring, kinds)
        as_number(f"springs[{i}] stiffness", spring.stiffness, 0.0)
        for row in spring.rows(n_links) if dimension == 2 else spring.spatial_rows(n_links):
            for column, value in row.items():
                as_number(f"springs[{i}] {column}", value)
        checked.append(
            replace(
                spring,
                **{field.name: _plain(field.type, getattr(spring, field.name), dimension) for field in fields(spring)},
            )
        )
    return tuple(checked)


def _plain(kind: object, value: Any, dimension: int) -> Any:
    """The value of a field of this annotation, in plain numbers."""
    if kind == "int":
        return int(value)
    if kind == "float":
        return float(value)
    point = tuple(float(coordinate) for coordinate in value)
    return point + (0.0,) * (dimension - len(point))  # the origin of a link is (0, 0) by default


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
