"""Mechanism files: YAML <-> RollingChain or HingeChain, documented in docs/mechanism-files.md.

Nothing in a file is evaluated; every complaint names the file, the place in it and the mend.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, TypeVar, overload

import yaml

from rollingjoint.checked_yaml import mapping, read_yaml
from rollingjoint.checks import suggestion
from rollingjoint.errors import ConfigError
from rollingjoint.planar.chain import RollingChain
from rollingjoint.planar.file import rolling_chain_from_dict, rolling_chain_to_dict
from rollingjoint.presets import HINGE_CHAINS, PRESETS, ROLLING_CHAINS, preset
from rollingjoint.spatial.chain import HingeChain
from rollingjoint.spatial.file import hinge_chain_from_dict, hinge_chain_to_dict
from rollingjoint.statics.families import Mechanism

_ROLLING_HEADER = "# A rolling-contact mechanism, base link first. Units: mm, rad, N/mm; curvature in 1/mm.\n"
_HINGE_HEADER = "# An arm of beads on elastic hinges, base first. Units: mm, rad, N, N·mm/rad; tendons in N/mm.\n"
_KEYS = ("name", "model", "defaults", "links", "beads", "tendons", "springs")

_KINDS: dict[type, tuple[str, Iterable[str]]] = {
    RollingChain: ("a planar chain of rolling links", ROLLING_CHAINS),
    HingeChain: ("an arm of beads", HINGE_CHAINS),
}
_Kind = TypeVar("_Kind", RollingChain, HingeChain)


@overload
def load_mechanism(name_or_path: str | Path) -> Mechanism: ...


@overload
def load_mechanism(name_or_path: str | Path, kind: type[_Kind]) -> _Kind: ...


def load_mechanism(name_or_path: str | Path, kind: type[Any] | None = None) -> Any:
    """The mechanism of that preset name, or of the YAML file at that path.

    Args:
        name_or_path: what to load.
        kind: RollingChain or HingeChain, where no other will do.
    Raises:
        ConfigError: neither a preset nor a readable file, a file with a wrong key, type or mechanism, the other kind.
    """
    name = str(name_or_path)
    mechanism = preset(name) if name in PRESETS else _read(name)
    if kind is not None and not isinstance(mechanism, kind):
        (wanted, presets), (found, _) = _KINDS[kind], _KINDS[type(mechanism)]
        raise ConfigError("mechanism", name, f"{wanted}, not {found}", f"Such presets: {', '.join(presets)}.")
    return mechanism


def mechanism_from_dict(content: object, source: str = "mechanism", name: str = "") -> Mechanism:
    """The mechanism that the content of a mechanism file describes: a HingeChain if it lists beads.

    Args:
        content: what yaml.safe_load gives.
        source: how messages call it, usually the file name.
        name: name of a mechanism that states none.
    Raises:
        ConfigError: a wrong key, type or number, or a mechanism that cannot be built.
    """
    top = {} if content is None else content
    if isinstance(top, Mapping):
        if "beads" in top:
            return hinge_chain_from_dict(top, source, name)
        if "links" not in top:
            mend = "Add the links of a planar chain or the beads of an arm."
            raise ConfigError(source, list(mapping(source, top, _KEYS)), "the key 'links' or the key 'beads'", mend)
    return rolling_chain_from_dict(top, source, name)


def mechanism_to_dict(mechanism: Mechanism) -> dict[str, Any]:
    """Plain dicts, lists, numbers and text; mechanism_from_dict makes the same mechanism of them exactly."""
    if isinstance(mechanism, HingeChain):
        return hinge_chain_to_dict(mechanism)
    return rolling_chain_to_dict(mechanism)


def dump_mechanism(mechanism: Mechanism) -> str:
    """YAML text of the mechanism; loading it gives the same mechanism exactly."""
    header = _HINGE_HEADER if isinstance(mechanism, HingeChain) else _ROLLING_HEADER
    return header + yaml.safe_dump(mechanism_to_dict(mechanism), sort_keys=False, default_flow_style=None, width=110)


def _read(name: str) -> Mechanism:
    path = Path(name)
    if not path.is_file():
        mend = suggestion(name, tuple(PRESETS))
        raise ConfigError("mechanism", name, f"a preset ({', '.join(PRESETS)}) or the path of a YAML file", mend)
    return mechanism_from_dict(read_yaml(path), source=name, name=path.stem)
