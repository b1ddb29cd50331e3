"""Mechanism files: YAML <-> mechanism, documented in docs/mechanism-files.md.

No text of a file is evaluated; every error names the file and the place in it.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar, overload

import yaml

from rollingjoint.chain.chain import AnyChain
from rollingjoint.chain.file import format_of, formats
from rollingjoint.chain.presets import PRESETS, preset, presets_of
from rollingjoint.checked_yaml import mapping, read_yaml
from rollingjoint.checks import suggestion
from rollingjoint.errors import ConfigError

_M = TypeVar("_M", bound=AnyChain)


@overload
def load_mechanism(name_or_path: str | Path) -> AnyChain: ...


@overload
def load_mechanism(name_or_path: str | Path, kind: type[_M]) -> _M: ...


def load_mechanism(name_or_path: str | Path, kind: type[AnyChain] | None = None) -> AnyChain:
    """The mechanism of a preset, by its name, or of a YAML file, by its path.

    Args:
        name_or_path: of the preset or the file.
        kind: required class of the mechanism, such as RollingChain; None: any.
    Raises:
        ConfigError: neither a preset nor a readable file, a file with a wrong key, type or mechanism, another kind.
    """
    name = str(name_or_path)
    mechanism = preset(name) if name in PRESETS else _read(name)
    if kind is not None and not isinstance(mechanism, kind):
        hint = f"Such presets: {', '.join(presets_of(kind))}."
        raise ConfigError("mechanism", name, f"{kind.title}, not {mechanism.title}", hint)
    return mechanism


def mechanism_from_dict(content: object, source: str = "mechanism", name: str = "") -> AnyChain:
    """The mechanism that the content of a mechanism file describes, by the key of its parts.

    Args:
        content: from yaml.safe_load.
        source: name for messages, usually the file name.
        name: name of a mechanism that states none.
    Raises:
        ConfigError: a wrong key, type or number, or a mechanism that cannot be built.
    """
    keys = tuple(dict.fromkeys(key for kind in formats() for key in kind.keys))
    fields = content if isinstance(content, Mapping) else mapping(source, content, keys)
    fitting = [kind for kind in formats() if kind.parts in fields]
    if not fitting:
        allowed = " or ".join(f"the key {kind.parts!r}" for kind in formats())
        hint = "Add the links of a planar chain, the beads of an arm or the joints of a chain in space."
        raise ConfigError(source, list(mapping(source, fields, keys)), allowed, hint)
    return fitting[-1].from_dict(content, source, name)


def mechanism_to_dict(mechanism: AnyChain) -> dict[str, Any]:
    """Plain dicts, lists, numbers and text, from which mechanism_from_dict builds exactly the same mechanism."""
    return format_of(mechanism).to_dict(mechanism)


def dump_mechanism(mechanism: AnyChain) -> str:
    """YAML text of the mechanism; loading it gives the same mechanism exactly."""
    header = format_of(mechanism).header
    return header + yaml.safe_dump(mechanism_to_dict(mechanism), sort_keys=False, default_flow_style=None, width=110)


def _read(name: str) -> AnyChain:
    path = Path(name)
    if not path.is_file():
        hint = suggestion(name, tuple(PRESETS))
        raise ConfigError("mechanism", name, f"a preset ({', '.join(PRESETS)}) or the path of a YAML file", hint)
    return mechanism_from_dict(read_yaml(path), source=name, name=path.stem)
