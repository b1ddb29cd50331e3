"""The content of mechanism files: plain values <-> mechanism, documented in docs/mechanism-files.md."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import MISSING, fields
from typing import Any, ClassVar

from rollingjoint.chain.chain import AnyChain
from rollingjoint.chain.hinge import AXES, Bead, HingeChain
from rollingjoint.chain.rolling import Link, RollingChain
from rollingjoint.chain.spatial import SpatialChain, SpatialLink
from rollingjoint.chain.spatial_joints import SpatialJoint
from rollingjoint.chain.tendon import DEFAULT_STIFFNESS, BeadTendon, Hole, OnSurface, SpaceTendon, Tendon
from rollingjoint.checked_yaml import (
    located,
    mapping,
    number,
    number_table,
    numbered,
    numbers,
    point,
    space_point,
    text,
    whole_number,
)
from rollingjoint.checks import Triple
from rollingjoint.errors import ConfigError
from rollingjoint.friction import CapstanFriction, friction_from_dict, friction_to_dict
from rollingjoint.load import SPRINGS, Load
from rollingjoint.profile import Profile, Surface

_SHARED_KEYS = ("end", "stiffness", "friction")  # of tendons, which may have defaults
_BEAD_KEYS = tuple(field.name for field in fields(Bead))
_SURFACE_KEYS: tuple[str, ...] = ("curvature", "start", "angle", "limits")
_TABLES = {
    "piecewise_constant": ("breaks", "values"),
    "piecewise_polynomial": ("breaks", "coefficients"),
    "spline": ("s", "u"),
    "samples": ("s", "u"),
}
_CURVATURES = ("constant", "polynomial", *_TABLES)


_FORMATS: dict[type[Any], type[ChainFormat]] = {}  # by the classes of chains; subclasses enter themselves


class ChainFormat(ABC):
    """Chains of a class as plain values; every class of chains has a subclass.

    Attributes of the subclass:
        kind: the class. header: the comment that a file begins with.
        parts: the key of its links or beads, which identifies such a file.
        keys: all keys at the top level, in the order in which they are written.
        defaults: keys of `defaults`. tendon: class of its tendons. tendon_keys: keys of a tendon.
    """

    kind: ClassVar[type[Any]]
    header: ClassVar[str]
    parts: ClassVar[str]
    keys: ClassVar[tuple[str, ...]]
    defaults: ClassVar[tuple[str, ...]]
    tendon: ClassVar[type[Any]]
    tendon_keys: ClassVar[tuple[str, ...]]

    def __init_subclass__(cls) -> None:
        _FORMATS[cls.kind] = cls

    def from_dict(self, content: object, source: str, name: str) -> AnyChain:
        """The mechanism that the content of a file describes; raises ConfigError."""
        top = mapping(source, content, self.keys, required=(self.parts, "tendons"))
        defaults = mapping(f"{source}: defaults", top.get("defaults", {}), self.defaults)
        default = mapping(f"{source}: defaults.tendon", defaults.get("tendon", {}), _SHARED_KEYS)
        parts = [self.part(place, item, defaults, source) for place, item in _listed(source, top, self.parts)]
        tendons = [self._tendon(place, item, default) for place, item in _listed(source, top, "tendons")]
        springs = [_spring(place, item, self.kind.dimension) for place, item in _listed(source, top, "springs")]
        values = {"name": text(f"{source}: name", top.get("name", name)), "springs": springs, **self.more(source, top)}
        with located(source):
            friction = _friction(f"{source}: ", top)
            chain: AnyChain = self.kind(**{self.parts: parts}, tendons=tendons, friction=friction, **values)
            return chain

    def to_dict(self, chain: Any) -> dict[str, Any]:
        """The content that makes the same mechanism exactly."""
        content = {"name": chain.name, self.parts: [self.part_dict(part) for part in getattr(chain, self.parts)]}
        content["tendons"] = [
            {**self.path_dict(tendon), "end": tendon.end, "stiffness": tendon.stiffness}
            | friction_to_dict(tendon.friction)
            for tendon in chain.tendons
        ]
        if chain.springs:
            content["springs"] = [_spring_dict(spring) for spring in chain.springs]
        content |= self.more_dict(chain) | friction_to_dict(chain.friction)
        return {key: content[key] for key in self.keys if key in content}

    @abstractmethod
    def part(self, where: str, item: object, defaults: Mapping[str, Any], source: str) -> Any:
        """A link or bead."""

    @abstractmethod
    def part_dict(self, part: Any) -> dict[str, Any]:
        """The content that makes the same link or bead."""

    @abstractmethod
    def holes(self, where: str, tendon: Mapping[str, Any]) -> Sequence[Any]:
        """The holes of a tendon."""

    @abstractmethod
    def path_dict(self, tendon: Any) -> dict[str, Any]:
        """The content that makes the same holes."""

    def more(self, source: str, top: Mapping[str, Any]) -> dict[str, Any]:
        """Fields that only chains of the class have."""
        return {}

    def more_dict(self, chain: Any) -> dict[str, Any]:
        """The content that makes the same fields."""
        return {}

    def _tendon(self, where: str, item: object, default: Mapping[str, Any]) -> Any:
        values = mapping(where, item, self.tendon_keys)
        holes = self.holes(where, values)
        merged = {"end": -1, "stiffness": DEFAULT_STIFFNESS, **default, **values}
        end, stiffness = whole_number(f"{where}.end", merged["end"]), number(f"{where}.stiffness", merged["stiffness"])
        with located(where):
            return self.tendon(holes, end, stiffness, _friction(f"{where}.", merged))


class RollingFormat(ChainFormat):
    """Planar chains of links that roll on each other."""

    kind = RollingChain
    header = "# A rolling-contact mechanism, base link first. Units: mm, rad, N/mm; curvature in 1/mm.\n"
    parts = "links"
    keys = ("name", "defaults", parts, "tendons", "springs", "friction")
    defaults = ("parent", "child", "tendon")
    tendon = Tendon
    tendon_keys = ("on_surface", "holes", *_SHARED_KEYS)

    def part(self, where: str, item: object, defaults: Mapping[str, Any], source: str) -> Link:
        """A link; missing keys of its surfaces come from the defaults."""
        item = mapping(where, item, ("parent", "child", "weight", "centre"))
        surfaces = {}
        for side in ("parent", "child"):
            default = mapping(f"{source}: defaults.{side}", defaults.get(side, {}), _SURFACE_KEYS)
            surfaces[side] = _surface(f"{where}.{side}", item.get(side, {}), default)
        weight, centre = item.get("weight", Link.weight), item.get("centre", Link.centre)
        with located(where):
            return Link(**surfaces, weight=number(f"{where}.weight", weight), centre=point(f"{where}.centre", centre))

    def part_dict(self, part: Link) -> dict[str, Any]:
        """The content that makes the same link."""
        surfaces = {side: _surface_dict(getattr(part, side)) for side in ("parent", "child")}
        weight, centre = float(part.weight), tuple(map(float, part.centre))
        if (weight, centre) == (Link.weight, Link.centre):
            return surfaces
        return surfaces | {"weight": weight, "centre": list(centre)}

    def holes(self, where: str, tendon: Mapping[str, Any]) -> Sequence[tuple[Hole, Hole]]:
        """The holes of a tendon, all at one place of the surfaces or pair by pair."""
        if ("on_surface" in tendon) == ("holes" in tendon):
            raise ConfigError(where, sorted(tendon), "either 'on_surface' or 'holes'")
        if "on_surface" in tendon:
            hole = OnSurface(number(f"{where}.on_surface", tendon["on_surface"]))
            return [(hole, hole)]
        return [_hole_pair(place, pair) for place, pair in numbered(f"{where}.holes", tendon["holes"])]

    def path_dict(self, tendon: Tendon) -> dict[str, Any]:
        """The content that makes the same holes."""
        parent, child = tendon.holes[0]
        if len(tendon.holes) == 1 and parent == child and isinstance(parent, OnSurface):
            return {"on_surface": float(parent.s)}
        return {"holes": [{"parent": _hole_value(p), "child": _hole_value(c)} for p, c in tendon.holes]}


class HingeFormat(ChainFormat):
    """Spatial arms of beads on elastic hinges."""

    kind = HingeChain
    header = "# An arm of beads on elastic hinges, base first. Units: mm, rad, N, N·mm/rad; tendons in N/mm.\n"
    parts = "beads"
    keys = ("name", "model", "defaults", parts, "tendons", "springs", "friction")
    defaults = ("bead", "tendon")
    tendon = BeadTendon
    tendon_keys = ("holes", *_SHARED_KEYS)

    def part(self, where: str, item: object, defaults: Mapping[str, Any], source: str) -> Bead:
        """A bead; missing keys come from the default."""
        default = mapping(f"{source}: defaults.bead", defaults.get("bead", {}), _BEAD_KEYS)
        explicit = mapping(where, item, _BEAD_KEYS)
        merged = dict(mapping(where, {**default, **explicit}, _BEAD_KEYS, required=("spacing", "axis", "stiffness")))
        values: dict[str, Any] = {"axis": _axis(f"{where}.axis", merged.pop("axis"))}
        if "limits" in merged:
            values["limits"] = point(f"{where}.limits", merged.pop("limits"))
        values |= {key: number(f"{where}.{key}", value) for key, value in merged.items()}
        with located(where):
            return Bead(**values)

    def part_dict(self, part: Bead) -> dict[str, Any]:
        """The content that makes the same bead."""
        values = {key: getattr(part, key) for key in _BEAD_KEYS}
        axis, limits = values.pop("axis"), values.pop("limits")
        named = next((name for name, direction in AXES.items() if direction == axis), list(axis))
        return {"axis": named, **{key: float(value) for key, value in values.items()}, "limits": list(limits)}

    def holes(self, where: str, tendon: Mapping[str, Any]) -> Sequence[tuple[float, float]]:
        """The holes of a tendon, one per link or one for all."""
        holes = mapping(where, tendon, self.tendon_keys, required=("holes",))["holes"]
        return [point(place, hole) for place, hole in numbered(f"{where}.holes", holes)]

    def path_dict(self, tendon: BeadTendon) -> dict[str, Any]:
        """The content that makes the same holes."""
        return {"holes": [list(hole) for hole in tendon.holes]}

    def more(self, source: str, top: Mapping[str, Any]) -> dict[str, Any]:
        """Its tendon model."""
        return {"model": text(f"{source}: model", top.get("model", HingeChain.model))}

    def more_dict(self, chain: HingeChain) -> dict[str, Any]:
        """The content that makes the same model."""
        return {"model": chain.model}


class SpatialFormat(ChainFormat):
    """Chains in space of rolling contacts and hinges; a joint is of the kind that has all of its keys."""

    kind = SpatialChain
    header = "# Rolling joints and hinges in space, base first. Units: mm, rad, N, N·mm/rad; tendons in N/mm.\n"
    parts = "joints"
    keys = ("name", "defaults", parts, "links", "tendons", "springs", "friction")
    defaults = ("joint", "parent", "child", "tendon")
    tendon = SpaceTendon
    tendon_keys = ("holes", *_SHARED_KEYS)

    def part(self, where: str, item: object, defaults: Mapping[str, Any], source: str) -> SpatialJoint:
        """A joint; missing keys, and missing keys of its surfaces, come from the defaults."""
        kinds: dict[Any, tuple[str, ...]] = {kind: _names(kind) for kind in SpatialJoint.__subclasses__()}
        explicit = mapping(where, item, list(dict.fromkeys(name for names in kinds.values() for name in names)))
        default = mapping(f"{source}: defaults.joint", defaults.get("joint", {}), _joint_keys(kinds))
        kind, names = next((pair for pair in kinds.items() if set(explicit) <= set(pair[1])), next(iter(kinds.items())))
        surfaces: dict[str, Any] = {name: {} for name in names if name in ("parent", "child")}
        known = {key: value for key, value in default.items() if key in names}
        merged = mapping(where, {**surfaces, **known, **explicit}, names, sorted(_needed(kind)))
        readers: dict[str, Any] = {"float": number, "Sequence[float]": space_point, "tuple[float, float]": point}
        values = {}
        for field in fields(kind):
            if field.name in surfaces:
                own = mapping(f"{source}: defaults.{field.name}", defaults.get(field.name, {}), _SURFACE_KEYS)
                values[field.name] = _surface(f"{where}.{field.name}", merged[field.name], own)
            elif field.name in merged:
                values[field.name] = readers[str(field.type)](f"{where}.{field.name}", merged[field.name])
        with located(where):
            joint: SpatialJoint = kind(**values)
            return joint

    def part_dict(self, part: SpatialJoint) -> dict[str, Any]:
        """The content that makes the same joint."""
        values = {name: getattr(part, name) for name in _names(type(part))}
        plain = {name: list(value) if isinstance(value, tuple) else value for name, value in values.items()}
        return {name: _surface_dict(value) if isinstance(value, Surface) else value for name, value in plain.items()}

    def holes(self, where: str, tendon: Mapping[str, Any]) -> Sequence[tuple[Triple, Triple]]:
        """The hole pairs of a tendon, one per link or one for all."""
        holes = mapping(where, tendon, self.tendon_keys, required=("holes",))["holes"]
        return [_space_pair(place, pair) for place, pair in numbered(f"{where}.holes", holes)]

    def path_dict(self, tendon: SpaceTendon) -> dict[str, Any]:
        """The content that makes the same holes."""
        return {"holes": [{"parent": list(parent), "child": list(child)} for parent, child in tendon.holes]}

    def more(self, source: str, top: Mapping[str, Any]) -> dict[str, Any]:
        """Weights of its links."""
        return {"links": [_weight(place, item) for place, item in _listed(source, top, "links")]}

    def more_dict(self, chain: SpatialChain) -> dict[str, Any]:
        """The content that makes the same weights."""
        links = [{"weight": link.weight, "centre": list(link.centre)} for link in chain.links]
        return {"links": links} if links else {}


def formats() -> tuple[ChainFormat, ...]:
    """The formats of all classes of chains."""
    return tuple(kind() for kind in _FORMATS.values())


def format_of(chain: AnyChain) -> ChainFormat:
    """The format of the chain's class, or of its nearest base class with a format."""
    return next(_FORMATS[kind]() for kind in type(chain).__mro__ if kind in _FORMATS)


def _listed(source: str, top: Mapping[str, Any], key: str) -> Iterable[tuple[str, Any]]:
    """The items of a list at the top level, each with its place; none where there is no such key."""
    return numbered(f"{source}: {key}", top[key]) if key in top else ()


def _friction(before: str, values: Mapping[str, Any]) -> CapstanFriction | None:
    return friction_from_dict(f"{before}friction", values["friction"]) if "friction" in values else None


def _surface(where: str, item: object, default: Mapping[str, Any]) -> Surface:
    explicit = mapping(where, item, _SURFACE_KEYS)
    merged = mapping(where, {**default, **explicit}, _SURFACE_KEYS, required=("curvature", "start"))
    with located(where):
        profile = _profile(where, merged, "limits" in explicit)
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


def _hole_pair(where: str, pair: object) -> tuple[Hole, Hole]:
    sides = mapping(where, pair, ("parent", "child"), required=("parent", "child"))
    return _hole(f"{where}.parent", sides["parent"]), _hole(f"{where}.child", sides["child"])


def _hole(where: str, hole: object) -> Hole:
    if isinstance(hole, Mapping):
        return OnSurface(number(where, mapping(where, hole, ("on_surface",), ("on_surface",))["on_surface"]))
    return point(where, hole)


def _names(kind: type[Any]) -> tuple[str, ...]:
    return tuple(field.name for field in fields(kind))


def _joint_keys(kinds: Mapping[Any, tuple[str, ...]]) -> list[str]:
    """The keys of any kind of joint but for its surfaces, which have defaults of their own."""
    names = dict.fromkeys(name for names in kinds.values() for name in names)
    return [name for name in names if name not in ("parent", "child")]


def _space_pair(where: str, pair: object) -> tuple[Triple, Triple]:
    sides = mapping(where, pair, ("parent", "child"), required=("parent", "child"))
    return space_point(f"{where}.parent", sides["parent"]), space_point(f"{where}.child", sides["child"])


def _weight(where: str, item: object) -> SpatialLink:
    values = mapping(where, item, ("weight", "centre"))
    weight = number(f"{where}.weight", values.get("weight", 0.0))
    centre = space_point(f"{where}.centre", values.get("centre", (0.0, 0.0, 0.0)))
    with located(where):
        return SpatialLink(weight, centre)


def _spring(where: str, item: object, dimension: int) -> Load:
    """A spring, of the first kind with all its required fields present; points have `dimension` coordinates."""
    keys = mapping(where, item, list(dict.fromkeys(field.name for kind in SPRINGS for field in fields(kind))))
    kind = next((kind for kind in SPRINGS if _needed(kind) <= set(keys)), SPRINGS[0])
    values = mapping(where, item, [field.name for field in fields(kind)], sorted(_needed(kind)))
    readers = {"int": whole_number, "float": number}
    place = point if dimension == 2 else space_point
    kinds = {field.name: readers.get(str(field.type), place) for field in fields(kind)}
    with located(where):
        return kind(**{key: kinds[key](f"{where}.{key}", value) for key, value in values.items()})


def _needed(kind: type[Any]) -> set[str]:
    return {field.name for field in fields(kind) if field.default is MISSING}


def _spring_dict(spring: Any) -> dict[str, Any]:
    values = {field.name: getattr(spring, field.name) for field in fields(spring)}
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


def _hole_value(hole: Hole) -> object:
    return {"on_surface": float(hole.s)} if isinstance(hole, OnSurface) else list(hole)


def _axis(where: str, value: object) -> str | list[float]:
    if isinstance(value, str) and value in AXES:
        return value
    if not isinstance(value, list | tuple) or len(value) != 3:
        raise ConfigError(where, value, f"{', '.join(AXES)} or three numbers, such as [1, 1, 0]")
    return numbers(where, value)
