"""Mechanism files: YAML <-> mechanism, documented in docs/mechanism-files.md.

Nothing in a file is evaluated; every error names the file and the place in it.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar, overload

import yaml

from rollingjoint.checked_yaml import mapping, read_yaml
from rollingjoint.checks import suggestion
from rollingjoint.errors import ConfigError
from rollingjoint.mechanism import AnyMechanism
from rollingjoint.presets import PRESETS, preset
from rollingjoint.statics.families import FAMILIES, family_of, family_of_kind

_M = TypeVar("_M", bound=AnyMechanism)


@overload
def load_mechanism(name_or_path: str | Path) -> AnyMechanism: ...


@overload
def load_mechanism(name_or_path: str | Path, kind: type[_M]) -> _M: ...


def load_mechanism(name_or_path: str | Path, kind: type[AnyMechanism] | None = None) -> AnyMechanism:
    """The mechanism of that preset name, or of the YAML file at that path.

    Args:
        name_or_path: what to load.
        kind: class of the mechanism, such as RollingChain, where no other will do.
    Raises:
        ConfigError: neither a preset nor a readable file, a file with a wrong key, type or mechanism, the other kind.
    """
    name = str(name_or_path)
    mechanism = preset(name) if name in PRESETS else _read(name)
    if kind is not None and not isinstance(mechanism, kind):
        wanted, found = family_of_kind(kind), family_of(mechanism)
        assert wanted is not None
        hint = f"Such presets: {', '.join(wanted.presets)}."
        raise ConfigError("mechanism", name, f"{wanted.title}, not {found.title}", hint)
    return mechanism


def mechanism_from_dict(content: object, source: str = "mechanism", name: str = "") -> AnyMechanism:
    """The mechanism that the content of a mechanism file describes: an arm if it lists beads.

    Args:
        content: what yaml.safe_load gives.
        source: how messages call it, usually the file name.
        name: name of a mechanism that states none.
    Raises:
        ConfigError: a wrong key, type or number, or a mechanism that cannot be built.
    """
    keys = tuple(dict.fromkeys(key for family in FAMILIES for key in family.file.KEYS))
    given = content if isinstance(content, Mapping) else mapping(source, content, keys)
    fitting = [family for family in FAMILIES if family.file.PARTS in given]
    if not fitting:
        allowed = " or ".join(f"the key {family.file.PARTS!r}" for family in FAMILIES)
        hint = "Add the links of a planar chain or the beads of an arm."
        raise ConfigError(source, list(mapping(source, given, keys)), allowed, hint)
    return fitting[-1].file.from_dict(content, source, name)


def mechanism_to_dict(mechanism: AnyMechanism) -> dict[str, Any]:
    """Plain dicts, lists, numbers and text; mechanism_from_dict makes the same mechanism of them exactly."""
    return family_of(mechanism).file.to_dict(mechanism)


def dump_mechanism(mechanism: AnyMechanism) -> str:
    """YAML text of the mechanism; loading it gives the same mechanism exactly."""
    header = family_of(mechanism).file.HEADER
    return header + yaml.safe_dump(mechanism_to_dict(mechanism), sort_keys=False, default_flow_style=None, width=110)


def _read(name: str) -> AnyMechanism:
    path = Path(name)
    if not path.is_file():
        hint = suggestion(name, tuple(PRESETS))
        raise ConfigError("mechanism", name, f"a preset ({', '.join(PRESETS)}) or the path of a YAML file", hint)
    return mechanism_from_dict(read_yaml(path), source=name, name=path.stem)
