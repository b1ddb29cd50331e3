"""The content of mechanism files of spatial arms: plain values <-> HingeChain."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from rollingjoint.checked_yaml import located, mapping, number, numbered, numbers, point, text, whole_number
from rollingjoint.errors import ConfigError
from rollingjoint.friction import friction_from_dict, friction_to_dict
from rollingjoint.spatial.chain import AXES, Bead, HingeChain
from rollingjoint.tendon import DEFAULT_STIFFNESS, BeadTendon

HEADER = "# An arm of beads on elastic hinges, base first. Units: mm, rad, N, N·mm/rad; tendons in N/mm.\n"
PARTS = "beads"
KEYS: tuple[str, ...] = ("name", "model", "defaults", PARTS, "tendons", "friction")
_BEAD_KEYS = tuple(field.name for field in fields(Bead))
_TENDON_KEYS = tuple(field.name for field in fields(BeadTendon))
_SHARED_KEYS = ("end", "stiffness", "friction")


def from_dict(content: object, source: str, name: str) -> HingeChain:
    """The arm that the content of a mechanism file describes; raises ConfigError."""
    top = mapping(source, content, KEYS, required=("beads", "tendons"))
    defaults = mapping(f"{source}: defaults", top.get("defaults", {}), ("bead", "tendon"))
    bead_default = mapping(f"{source}: defaults.bead", defaults.get("bead", {}), _BEAD_KEYS)
    tendon_default = mapping(f"{source}: defaults.tendon", defaults.get("tendon", {}), _SHARED_KEYS)
    beads = [_bead(place, item, bead_default) for place, item in numbered(f"{source}: beads", top["beads"])]
    tendons = [_tendon(place, item, tendon_default) for place, item in numbered(f"{source}: tendons", top["tendons"])]
    with located(source):
        model = text(f"{source}: model", top.get("model", HingeChain.model))
        friction = friction_from_dict(f"{source}: friction", top["friction"]) if "friction" in top else None
        return HingeChain(beads, tendons, model, text(f"{source}: name", top.get("name", name)), friction)


def to_dict(chain: HingeChain) -> dict[str, Any]:
    """The content that makes the same arm exactly."""
    beads = [_bead_dict(bead) for bead in chain.beads]
    tendons = [
        {"holes": [list(hole) for hole in tendon.holes], "end": tendon.end, "stiffness": tendon.stiffness}
        | friction_to_dict(tendon.friction)
        for tendon in chain.tendons
    ]
    named = {"name": chain.name, "model": chain.model, "beads": beads, "tendons": tendons}
    return named | friction_to_dict(chain.friction)


def _bead(where: str, item: object, default: Mapping[str, Any]) -> Bead:
    own = mapping(where, item, _BEAD_KEYS)
    merged = dict(mapping(where, {**default, **own}, _BEAD_KEYS, required=("spacing", "axis", "stiffness")))
    values: dict[str, Any] = {"axis": _axis(f"{where}.axis", merged.pop("axis"))}
    if "limits" in merged:
        values["limits"] = point(f"{where}.limits", merged.pop("limits"))
    values |= {key: number(f"{where}.{key}", value) for key, value in merged.items()}
    with located(where):
        return Bead(**values)


def _axis(where: str, value: object) -> str | list[float]:
    if isinstance(value, str) and value in AXES:
        return value
    if not isinstance(value, list | tuple) or len(value) != 3:
        raise ConfigError(where, value, f"{', '.join(AXES)} or three numbers, such as [1, 1, 0]")
    return numbers(where, value)


def _tendon(where: str, item: object, default: Mapping[str, Any]) -> BeadTendon:
    own = mapping(where, item, _TENDON_KEYS, required=("holes",))
    holes = [point(place, hole) for place, hole in numbered(f"{where}.holes", own["holes"])]
    merged = {"end": BeadTendon.end, "stiffness": DEFAULT_STIFFNESS, **default, **own}
    end = whole_number(f"{where}.end", merged["end"])
    with located(where):
        friction = friction_from_dict(f"{where}.friction", merged["friction"]) if "friction" in merged else None
        return BeadTendon(holes, end, number(f"{where}.stiffness", merged["stiffness"]), friction)


def _bead_dict(bead: Bead) -> dict[str, Any]:
    values = {key: getattr(bead, key) for key in _BEAD_KEYS}
    axis, limits = values.pop("axis"), values.pop("limits")
    named = next((name for name, direction in AXES.items() if direction == axis), list(axis))
    return {"axis": named, **{key: float(value) for key, value in values.items()}, "limits": list(limits)}
