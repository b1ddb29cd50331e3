"""The content of mechanism files of planar chains: plain values <-> RollingChain."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, fields
from typing import Any

from rollingjoint.checked_yaml import (
    located,
    mapping,
    number,
    number_table,
    numbered,
    numbers,
    point,
    text,
    whole_number,
)
from rollingjoint.errors import ConfigError
from rollingjoint.friction import friction_from_dict, friction_to_dict
from rollingjoint.load import SPRINGS, Load
from rollingjoint.planar.chain import Link, RollingChain
from rollingjoint.profile import Profile, Surface
from rollingjoint.tendon import DEFAULT_STIFFNESS, Hole, OnSurface, Tendon

HEADER = "# A rolling-contact mechanism, base link first. Units: mm, rad, N/mm; curvature in 1/mm.\n"
PARTS = "links"
KEYS: tuple[str, ...] = ("name", "defaults", PARTS, "tendons", "springs", "friction")
_SURFACE_KEYS: tuple[str, ...] = ("curvature", "start", "angle", "limits")
_TENDON_KEYS: tuple[str, ...] = ("on_surface", "holes", "end", "stiffness", "friction")
_SHARED_KEYS: tuple[str, ...] = ("end", "stiffness", "friction")
_TABLES = {
    "piecewise_constant": ("breaks", "values"),
    "piecewise_polynomial": ("breaks", "coefficients"),
    "spline": ("s", "u"),
    "samples": ("s", "u"),
}
_CURVATURES = ("constant", "polynomial", *_TABLES)


def from_dict(content: object, source: str, name: str) -> RollingChain:
    """The chain that the content of a mechanism file describes; raises ConfigError."""
    top = mapping(source, content, KEYS, required=("links", "tendons"))
    defaults = mapping(f"{source}: defaults", top.get("defaults", {}), ("parent", "child", "tendon"))
    links = [_link(place, item, defaults, source) for place, item in numbered(f"{source}: links", top["links"])]
    tendon_default = mapping(f"{source}: defaults.tendon", defaults.get("tendon", {}), _SHARED_KEYS)
    tendons = [_tendon(place, item, tendon_default) for place, item in numbered(f"{source}: tendons", top["tendons"])]
    listed = numbered(f"{source}: springs", top["springs"]) if "springs" in top else ()
    springs = [_spring(place, item) for place, item in listed]
    friction = friction_from_dict(f"{source}: friction", top["friction"]) if "friction" in top else None
    with located(source):
        return RollingChain(links, tendons, text(f"{source}: name", top.get("name", name)), springs, friction)


def to_dict(chain: RollingChain) -> dict[str, Any]:
    """The content that makes the same chain exactly."""
    links = [{side: _surface_dict(getattr(link, side)) for side in ("parent", "child")} for link in chain.links]
    tendons, springs = [_tendon_dict(t) for t in chain.tendons], [_spring_dict(each) for each in chain.springs]
    more = ({"springs": springs} if springs else {}) | friction_to_dict(chain.friction)
    return {"name": chain.name, "links": links, "tendons": tendons, **more}


def _link(where: str, item: object, defaults: Mapping[str, Any], source: str) -> Link:
    item = mapping(where, item, ("parent", "child"))
    surfaces = {}
    for side in ("parent", "child"):
        default = mapping(f"{source}: defaults.{side}", defaults.get(side, {}), _SURFACE_KEYS)
        surfaces[side] = _surface(f"{where}.{side}", item.get(side, {}), default)
    return Link(**surfaces)


def _surface(where: str, item: object, default: Mapping[str, Any]) -> Surface:
    own = mapping(where, item, _SURFACE_KEYS)
    merged = mapping(where, {**default, **own}, _SURFACE_KEYS, required=("curvature", "start"))
    with located(where):
        profile = _profile(where, merged, "limits" in own)
        start = point(f"{where}.start", merged["start"])
        return Surface(profile, start, number(f"{where}.angle", merged.get("angle", 0.0)))


def _profile(where: str, surface: Mapping[str, Any], own_limits: bool) -> Profile:
    place = f"{where}.curvature"
    curvature = mapping(place, surface["curvature"], _CURVATURES)
    if len(curvature) != 1:
        raise ConfigError(place, curvature, f"exactly one of {', '.join(_CURVATURES)}")
    kind, value = next(iter(curvature.items()))
    if kind not in _TABLES:
        return _smooth_profile(where, kind, value, surface)
    if own_limits:
        hint = f"Leave it out: the first and last of {kind}.{_TABLES[kind][0]} are the limits."
        raise ConfigError(f"{where}.limits", surface["limits"], f"no limits beside {kind}", hint)
    columns = mapping(f"{place}.{kind}", value, _TABLES[kind], required=_TABLES[kind])
    abscissa, ordinate = (number_table(f"{place}.{kind}.{key}", columns[key]) for key in _TABLES[kind])
    return getattr(Profile, kind)(abscissa, ordinate)


def _smooth_profile(where: str, kind: str, value: object, surface: Mapping[str, Any]) -> Profile:
    if "limits" not in surface:
        raise ConfigError(
            where, sorted(surface), "the key 'limits'", "Add limits: [lo, hi], the arc length range in mm."
        )
    limits = point(f"{where}.limits", surface["limits"])
    if kind == "constant":
        return Profile.constant(number(f"{where}.curvature.constant", value), limits)
    return Profile.polynomial(numbers(f"{where}.curvature.polynomial", value), limits)


def _tendon(where: str, item: object, default: Mapping[str, Any]) -> Tendon:
    item = mapping(where, item, _TENDON_KEYS)
    if ("on_surface" in item) == ("holes" in item):
        raise ConfigError(where, sorted(item), "either 'on_surface' or 'holes'")
    merged = {**default, **item}
    end = whole_number(f"{where}.end", merged.get("end", -1))
    stiffness = number(f"{where}.stiffness", merged.get("stiffness", DEFAULT_STIFFNESS))
    friction = friction_from_dict(f"{where}.friction", merged["friction"]) if "friction" in merged else None
    with located(where):
        if "on_surface" in item:
            return Tendon.on_surfaces(number(f"{where}.on_surface", item["on_surface"]), end, stiffness, friction)
        pairs = [_hole_pair(place, pair) for place, pair in numbered(f"{where}.holes", item["holes"])]
        return Tendon(pairs, end, stiffness, friction)


def _hole_pair(where: str, pair: object) -> tuple[Hole, Hole]:
    sides = mapping(where, pair, ("parent", "child"), required=("parent", "child"))
    return _hole(f"{where}.parent", sides["parent"]), _hole(f"{where}.child", sides["child"])


def _hole(where: str, hole: object) -> Hole:
    if isinstance(hole, Mapping):
        return OnSurface(number(where, mapping(where, hole, ("on_surface",), ("on_surface",))["on_surface"]))
    return point(where, hole)


def _spring(where: str, item: object) -> Load:
    """A spring of the kind whose fields without a default are all there."""
    keys = mapping(where, item, list(dict.fromkeys(each.name for kind in SPRINGS for each in fields(kind))))
    kind = next((kind for kind in SPRINGS if _needed(kind) <= set(keys)), SPRINGS[0])
    own = mapping(where, item, [each.name for each in fields(kind)], sorted(_needed(kind)))
    readers = {"int": whole_number, "float": number}
    kinds = {each.name: readers.get(str(each.type), point) for each in fields(kind)}
    with located(where):
        return kind(**{key: kinds[key](f"{where}.{key}", value) for key, value in own.items()})


def _needed(kind: type[Any]) -> set[str]:
    return {each.name for each in fields(kind) if each.default is MISSING}


def _spring_dict(spring: Any) -> dict[str, Any]:
    values = {each.name: getattr(spring, each.name) for each in fields(spring)}
    return {key: list(value) if isinstance(value, tuple) else value for key, value in values.items()}


def _surface_dict(surface: Surface) -> dict[str, Any]:
    breaks, coefficients = surface.profile.breaks.tolist(), surface.profile.coefficients.tolist()
    if coefficients == [[coefficients[0][0]]]:
        shape = {"curvature": {"constant": coefficients[0][0]}, "limits": breaks}
    elif len(coefficients[0]) == 1:
        shape = {"curvature": {"piecewise_constant": {"breaks": breaks, "values": [row[0] for row in coefficients]}}}
    else:
        shape = {"curvature": {"piecewise_polynomial": {"breaks": breaks, "coefficients": coefficients}}}
    return {"start": list(surface.start), "angle": surface.angle, **shape}


def _tendon_dict(tendon: Tendon) -> dict[str, Any]:
    parent, child = tendon.holes[0]
    if len(tendon.holes) == 1 and parent == child and isinstance(parent, OnSurface):
        path: dict[str, Any] = {"on_surface": float(parent.s)}
    else:
        path = {"holes": [{"parent": _hole_value(p), "child": _hole_value(c)} for p, c in tendon.holes]}
    return {**path, "end": tendon.end, "stiffness": tendon.stiffness, **friction_to_dict(tendon.friction)}


def _hole_value(hole: Hole) -> object:
    return {"on_surface": float(hole.s)} if isinstance(hole, OnSurface) else list(hole)
