"""Surroundings as plain values, the key `surroundings` of YAML files; documented in docs/surroundings.md."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, fields
from typing import Any

from rollingjoint.checked_yaml import entries, located, mapping, number, numbered
from rollingjoint.checks import as_boolean
from rollingjoint.errors import ConfigError
from rollingjoint.surroundings.lumen import Lumen
from rollingjoint.surroundings.outline import Bare, Outline, Sleeve
from rollingjoint.surroundings.table import Surroundings
from rollingjoint.surroundings.tube import Tube
from rollingjoint.surroundings.walls import (
    Boundary,
    Capsule,
    Disc,
    HalfPlane,
    Plane,
    Polygon,
    Sphere,
    Wall,
    WallFriction,
)

_WALLS: dict[str, type[Any]] = {
    "half_plane": HalfPlane,
    "disc": Disc,
    "capsule": Capsule,
    "polygon": Polygon,
    "lumen": Lumen,
    "plane": Plane,
    "sphere": Sphere,
    "tube": Tube,
}
_OUTLINES: dict[str, type[Any]] = {"sleeve": Sleeve, "bare": Bare}
_LAW = tuple(field.name for field in fields(Boundary))
# Other forms of lumens and tubes, by the key of their points, with the keys beside those of the law
_BY_POINTS = {"through": ("radii", "bend_radius"), "fit": ("radii", "tolerance")}
KEYS = ("walls", "outline", "friction", "rigid")


def surroundings_from_dict(where: str, value: object) -> Surroundings:
    """The surroundings that a mapping describes.

    Raises:
        ConfigError: a wrong key, type or number, with the place.
    """
    content = mapping(where, value, KEYS, required=("walls",))
    walls = [_wall(place, item) for place, item in numbered(f"{where}.walls", content["walls"])]
    more: dict[str, Any] = {}
    if "outline" in content:
        more["outline"] = _outline(f"{where}.outline", content["outline"])
    if "friction" in content:
        more["friction"] = _friction(f"{where}.friction", content["friction"])
    with located(where):
        return Surroundings(walls, rigid=as_boolean("rigid", content.get("rigid", False)), **more)


def surroundings_to_dict(surroundings: Surroundings) -> dict[str, Any]:
    """Plain values from which surroundings_from_dict makes the same surroundings exactly."""
    kinds = {kind: name for name, kind in _WALLS.items()}
    outlines = {kind: name for name, kind in _OUTLINES.items()}
    content: dict[str, Any] = {
        "walls": [{kinds[type(wall)]: _plain(wall)} for wall in surroundings.walls],
        "outline": {outlines[type(surroundings.outline)]: _plain(surroundings.outline)},
    }
    if surroundings.friction is not None:
        content["friction"] = _plain(surroundings.friction)
    return content | ({"rigid": True} if surroundings.rigid else {})


def _wall(where: str, item: object) -> Wall:
    """A wall, a mapping with its kind as the only key."""
    name, value = _only(where, item, _WALLS)
    place, kind = f"{where}.{name}", _WALLS[name]
    keys = [field.name for field in fields(kind)]
    required = [field.name for field in fields(kind) if field.default is MISSING]
    make: Any = kind
    points = [key for key in _BY_POINTS if kind in (Lumen, Tube) and isinstance(value, Mapping) and key in value]
    if points:
        make, others = getattr(kind, points[0]), _BY_POINTS[points[0]]
        keys, required = [points[0], *others, *_LAW], [points[0], "radii"]
        required += ["bend_radius"] if "bend_radius" in others else []
    values = {key: _value(f"{place}.{key}", key, entry) for key, entry in mapping(place, value, keys, required).items()}
    if points:
        values["points"] = values.pop(points[0])
    with located(place):
        wall: Wall = make(**values)
        return wall


def _value(where: str, key: str, entry: object) -> Any:
    return _friction(where, entry) if key == "friction" else _numbers(where, entry)


def _outline(where: str, item: object) -> Outline:
    name, value = _only(where, item, _OUTLINES)
    place, kind = f"{where}.{name}", _OUTLINES[name]
    content = mapping(place, value, [field.name for field in fields(kind)])
    with located(place):
        outline: Outline = kind(**{key: number(f"{place}.{key}", entry) for key, entry in content.items()})
        return outline


def _friction(where: str, item: object) -> WallFriction:
    content = mapping(where, item, [field.name for field in fields(WallFriction)], required=("mu",))
    with located(where):
        return WallFriction(**{key: number(f"{where}.{key}", entry) for key, entry in content.items()})


def _only(where: str, item: object, kinds: Mapping[str, object]) -> tuple[str, object]:
    """The only key of a mapping, one of the kinds, and its value."""
    content = mapping(where, item, tuple(kinds))
    if len(content) != 1:
        raise ConfigError(where, list(content), f"one key, one of {', '.join(kinds)}")
    return next(iter(content.items()))


def _numbers(where: str, value: object) -> Any:
    """A number, or lists of numbers in lists."""
    if isinstance(value, list | tuple):
        return [_numbers(f"{where}[{i}]", item) for i, item in enumerate(entries(where, value))]
    return number(where, value)


def _plain(value: Any) -> Any:
    """Fields of a dataclass that are not at their defaults; tuples as lists."""
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    if isinstance(value, Wall | Sleeve | Bare | WallFriction):
        content = {field.name: (getattr(value, field.name), field.default) for field in fields(value)}
        return {name: _plain(entry) for name, (entry, default) in content.items() if entry != default}
    return value
