"""YAML files read strictly: plain values only, and errors that name the file and the place.

Every check takes `where`, such as "arm.yaml: links[2].child", and raises ConfigError with it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml

from rollingjoint.checks import as_integer, as_number, suggestion
from rollingjoint.errors import ConfigError, InvalidInput


class _StrictLoader(yaml.SafeLoader):
    """The safe loader; a key given twice is an error, and 3e-4 is a number (YAML 1.1 makes it text)."""

    def compose_mapping_node(self, anchor: Any) -> yaml.MappingNode:
        node = super().compose_mapping_node(anchor)
        seen: set[str] = set()
        for key, _ in node.value:
            if str(key.value) in seen:
                raise yaml.composer.ComposerError(None, None, f"key {key.value!r} given twice", key.start_mark)
            seen.add(str(key.value))
        return node


_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$")
_StrictLoader.add_implicit_resolver("tag:yaml.org,2002:float", _NUMBER, list("-+.0123456789"))


def parse_yaml(text: str, where: str) -> object:
    """Content of YAML text: dicts, lists, numbers and text, never other objects.

    Raises:
        ConfigError: no valid YAML, or a key given twice.
    """
    try:
        return yaml.load(text, Loader=_StrictLoader)
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        raise ConfigError(f"{where}: line {line}", error.problem, "valid YAML") from None
    except yaml.YAMLError as error:
        raise ConfigError(where, text, "valid YAML", str(error)) from None


def read_yaml(path: Path) -> object:
    """Content of a YAML file; as parse_yaml, and ConfigError for a file that cannot be read."""
    try:
        text = path.read_text(encoding="utf-8")
    except (UnicodeDecodeError, OSError) as error:
        raise ConfigError("file", str(path), "readable YAML text", str(error)) from None
    return parse_yaml(text, str(path))


def dump_yaml(values: Mapping[str, Any]) -> str:
    """YAML text of plain values, keys in the order given."""
    return yaml.safe_dump(dict(values), sort_keys=False, allow_unicode=True)


def mapping(where: str, value: object, valid: Sequence[str], required: Sequence[str] = ()) -> Mapping[str, Any]:
    """The value, a mapping with valid keys only and all the required ones; nothing is an empty mapping."""
    value = {} if value is None else value
    if not isinstance(value, Mapping):
        raise ConfigError(where, value, f"keys and values, with the keys {', '.join(valid)}")
    for key in value:
        if key not in valid:
            raise ConfigError(f"{where}: unknown key", key, f"one of {', '.join(valid)}", suggestion(str(key), valid))
    for key in required:
        if key not in value:
            raise ConfigError(where, list(value), f"the key {key!r}", f"Add it; the keys are {', '.join(valid)}.")
    return value


def entries(where: str, value: object) -> Sequence[Any]:
    """The value, a list that is not empty."""
    if not isinstance(value, list | tuple) or not value:
        raise ConfigError(where, value, "a list with at least one entry")
    return value


def numbered(where: str, value: object) -> Iterator[tuple[str, Any]]:
    """The entries of a list that is not empty, each with its place, such as "arm.yaml: links[2]"."""
    return ((f"{where}[{i}]", entry) for i, entry in enumerate(entries(where, value)))


def number_table(where: str, value: object) -> list[Any]:
    """Numbers, or rows of numbers of one width."""
    items = entries(where, value)
    if not isinstance(items[0], list | tuple):
        return numbers(where, items)
    rows = [numbers(place, row) for place, row in numbered(where, items)]
    if len({len(row) for row in rows}) > 1:
        raise ConfigError(where, value, "rows of the same length", "Fill the shorter rows with zeros.")
    return rows


def numbers(where: str, value: object) -> list[float]:
    """A list of finite numbers that is not empty."""
    return [number(place, item) for place, item in numbered(where, value)]


def point(where: str, value: object) -> tuple[float, float]:
    """Two finite numbers."""
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise ConfigError(where, value, "two numbers, such as [0, 10]")
    return number(f"{where}[0]", value[0]), number(f"{where}[1]", value[1])


def number(where: str, value: object) -> float:
    """A finite number."""
    return as_number(where, value, error=ConfigError)


def whole_number(where: str, value: object) -> int:
    """An integer."""
    return as_integer(where, value, error=ConfigError)


def text(where: str, value: object) -> str:
    """Text; a bare number or date in YAML is not text."""
    if not isinstance(value, str):
        raise ConfigError(where, value, "text", "Put it in quotes.")
    return value


@contextmanager
def located(where: str) -> Iterator[None]:
    """A context that adds the place in the file to errors of what is built from it."""
    try:
        yield
    except ConfigError:
        raise
    except InvalidInput as error:
        raise ConfigError(f"{where}: {error.what}", error.value, error.allowed, error.hint) from error
