"""Mechanism files: YAML <-> RollingChain, documented in docs/mechanism-files.md.

Nothing in a file is evaluated; every complaint names the file, the place in it and the mend.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml

from rollingjoint.checked_yaml import (
    entries,
    mapping,
    number,
    number_table,
    numbers,
    point,
    read_yaml,
    suggestion,
    text,
    whole_number,
)
from rollingjoint.errors import ConfigError, InvalidInput
from rollingjoint.presets import PRESETS, preset
from rollingjoint.profile import Profile, Surface
from rollingjoint.rolling_chain import Link, RollingChain
from rollingjoint.tendon import DEFAULT_STIFFNESS, Hole, OnSurface, Tendon

_HEADER = "# A rolling-contact mechanism, base link first. Units: mm, rad, N/mm; curvature in 1/mm.\n"
_SURFACE_KEYS = ("curvature", "start", "angle", "limits")
_TENDON_KEYS = ("on_surface", "holes", "end", "stiffness")
_TABLES = {
    "piecewise_constant": ("breaks", "values"),
    "piecewise_polynomial": ("breaks", "coefficients"),
    "spline": ("s", "u"),
    "samples": ("s", "u"),
}
_CURVATURES = ("constant", "polynomial", *_TABLES)


def load_mechanism(name_or_path: str | Path) -> RollingChain:
    """The mechanism of that preset name, or of the YAML file at that path.

    Raises:
        ConfigError: neither a preset nor a readable file, or a file with a wrong key, type or mechanism.
    """
    name = str(name_or_path)
    if name in PRESETS:
        return preset(name)
    path = Path(name)
    if not path.is_file():
        mend = suggestion(name, tuple(PRESETS))
        raise ConfigError("mechanism", name, f"a preset ({', '.join(PRESETS)}) or the path of a YAML file", mend)
    return mechanism_from_dict(read_yaml(path), source=name, name=path.stem)


def mechanism_from_dict(content: object, source: str = "mechanism", name: str = "") -> RollingChain:
    """The mechanism that the content of a mechanism file describes.

    Args:
        content: what yaml.safe_load gives.
        source: how messages call it, usually the file name.
        name: name of a mechanism that states none.
    Raises:
        ConfigError: a wrong key, type or number, or a mechanism that cannot be built.
    """
    top = mapping(source, content, ("name", "defaults", "links", "tendons"), required=("links", "tendons"))
    defaults = mapping(f"{source}: defaults", top.get("defaults", {}), ("parent", "child", "tendon"))
    links = [
        _link(f"{source}: links[{i}]", item, defaults, source)
        for i, item in enumerate(entries(f"{source}: links", top["links"]))
    ]
    tendon_default = mapping(f"{source}: defaults.tendon", defaults.get("tendon", {}), ("end", "stiffness"))
    tendons = [
        _tendon(f"{source}: tendons[{j}]", item, tendon_default)
        for j, item in enumerate(entries(f"{source}: tendons", top["tendons"]))
    ]
    with _located(source):
        return RollingChain(links, tendons, name=text(f"{source}: name", top.get("name", name)))


def mechanism_to_dict(mechanism: RollingChain) -> dict[str, Any]:
    """Plain dicts, lists, numbers and text; mechanism_from_dict makes the same mechanism of them exactly."""
    links = [{side: _surface_dict(getattr(link, side)) for side in ("parent", "child")} for link in mechanism.links]
    return {"name": mechanism.name, "links": links, "tendons": [_tendon_dict(t) for t in mechanism.tendons]}


def dump_mechanism(mechanism: RollingChain) -> str:
    """YAML text of the mechanism; loading it gives the same mechanism exactly."""
    return _HEADER + yaml.safe_dump(mechanism_to_dict(mechanism), sort_keys=False, default_flow_style=None, width=110)


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
    with _located(where):
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
        mend = f"Leave it out: the first and last of {kind}.{_TABLES[kind][0]} are the limits."
        raise ConfigError(f"{where}.limits", surface["limits"], f"no limits beside {kind}", mend)
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
    with _located(where):
        if "on_surface" in item:
            return Tendon.on_surfaces(number(f"{where}.on_surface", item["on_surface"]), end, stiffness)
        pairs = enumerate(entries(f"{where}.holes", item["holes"]))
        return Tendon([_hole_pair(f"{where}.holes[{i}]", pair) for i, pair in pairs], end, stiffness)


def _hole_pair(where: str, pair: object) -> tuple[Hole, Hole]:
    sides = mapping(where, pair, ("parent", "child"), required=("parent", "child"))
    return _hole(f"{where}.parent", sides["parent"]), _hole(f"{where}.child", sides["child"])


def _hole(where: str, hole: object) -> Hole:
    if isinstance(hole, Mapping):
        return OnSurface(number(where, mapping(where, hole, ("on_surface",), ("on_surface",))["on_surface"]))
    return point(where, hole)


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
    return {**path, "end": tendon.end, "stiffness": tendon.stiffness}


def _hole_value(hole: Hole) -> object:
    return {"on_surface": float(hole.s)} if isinstance(hole, OnSurface) else list(hole)


@contextmanager
def _located(where: str) -> Iterator[None]:
    """Says where in the file the mechanism's own complaint arose."""
    try:
        yield
    except ConfigError:
        raise
    except InvalidInput as error:
        raise ConfigError(f"{where}: {error.what}", error.value, error.allowed, error.mend) from error
