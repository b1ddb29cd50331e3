"""Surroundings in YAML files, under the key `surroundings`: docs/surroundings.md."""

from __future__ import annotations

from pathlib import Path

from rollingjoint.checked_yaml import mapping, read_yaml
from rollingjoint.surroundings import Surroundings
from rollingjoint.surroundings.file import surroundings_from_dict


def load_surroundings(path: str | Path) -> Surroundings:
    """The surroundings of a YAML file with the key `surroundings`.

    Raises:
        ConfigError: no readable file, a wrong key, type or number, with the place in the file.
    """
    source = str(path)
    content = mapping(source, read_yaml(Path(path)), ("surroundings",), required=("surroundings",))
    return surroundings_from_dict(f"{source}: surroundings", content["surroundings"])
