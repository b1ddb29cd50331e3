"""Design spaces from plain settings, as files of searches and environments have them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any

from rollingjoint.checked_yaml import mapping
from rollingjoint.design.box import DesignBox
from rollingjoint.design.mechanism_space import MechanismSpace
from rollingjoint.design.space import DesignSpace
from rollingjoint.design.spatial_space import SpatialDesignSpace

SPACES: dict[str, type[DesignSpace | SpatialDesignSpace]] = {"plane": DesignSpace, "space": SpatialDesignSpace}
"""Spaces of equal tubes and chains by their `kind`."""


def space_of_settings(settings: object, base: DesignBox | None = None) -> DesignBox:
    """The design space of plain settings; raises ConfigError for keys and values that it does not have.

    Args:
        settings: with `mechanism` the fields of MechanismSpace; else those of DesignSpace, with `kind: space` those of
            SpatialDesignSpace. Lists count as tuples.
        base: the space that is changed where the settings have neither `mechanism` nor `kind`; None: DesignSpace().
    """
    values = mapping("space", settings, list(settings) if isinstance(settings, Mapping) else ["kind", "mechanism"])
    values = {key: _frozen(value) for key, value in values.items()}
    if "mechanism" in values:
        return MechanismSpace.of_settings(values)
    if base is None or "kind" in values:
        kind = values.pop("kind", "plane")
        mapping("space.kind", {kind: None}, tuple(SPACES))
        return SPACES[kind](**_checked(SPACES[kind], values))
    space: DesignBox = replace(base, **_checked(type(base), values))  # type: ignore[type-var]
    return space


def _checked(space: type[Any], values: Mapping[str, Any]) -> Mapping[str, Any]:
    names = [field.name for field in fields(space) if field.init and field.name != "base"]
    return mapping("space", values, ["kind", "mechanism", *names])


def _frozen(value: Any) -> Any:
    return tuple(map(_frozen, value)) if isinstance(value, list | tuple) else value
