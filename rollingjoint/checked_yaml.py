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

LARGEST_FILE = 1_000_000  # bytes
MOST_VALUES = 50_000  # with all aliases written out
DEEPEST = 32  # levels of lists and mappings inside each other
_LONGEST_NUMBER = 400  # characters


class _StrictLoader(yaml.SafeLoader):
    """The safe loader with limits on size and depth; 3e-4 is a number (YAML 1.1 makes it text).

    A key given twice, a key that is a list or a mapping, and an alias inside its own value are errors.
    """

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self._depth = 0
        self._sizes: dict[yaml.Node, int] = {}  # of nodes that are complete: values inside, aliases written out

    def compose_node(self, parent: Any, index: Any) -> yaml.Node:
        mark, alias = self.peek_event().start_mark, self.check_event(yaml.AliasEvent)
        if self._depth == DEEPEST:
            raise _found(f"more than {DEEPEST} levels of lists and mappings", mark)
        self._depth += 1
        node: yaml.Node = super().compose_node(parent, index)  # type: ignore[assignment]
        self._depth -= 1
        if alias and node not in self._sizes:
            raise _found("an alias inside of what it stands for", mark)
        if node not in self._sizes:
            self._sizes[node] = 1 + sum(self._sizes[child] for child in _children(node))
        if self._sizes[node] > MOST_VALUES:
            raise _found(f"more than {MOST_VALUES:,} values, aliases written out", mark)
        return node

    def compose_mapping_node(self, anchor: Any) -> yaml.MappingNode:
        node = super().compose_mapping_node(anchor)
        keys: set[str] = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                raise _found("a list or a mapping as a key", key.start_mark)
            if key.value in keys:
                raise _found(f"key {_shortened(key.value)} given twice", key.start_mark)
            keys.add(key.value)
        return node

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        kind = node.tag.rpartition(":")[2]
        try:
            if kind in ("int", "float") and len(node.value) > _LONGEST_NUMBER:
                raise _found(f"a number of {len(node.value):,} characters", node.start_mark)
            return super().construct_object(node, deep)
        except (ValueError, ArithmeticError, LookupError, AttributeError, TypeError):
            raise _found(f"{_shortened(node.value)} is not of type {kind}", node.start_mark) from None


def _found(problem: str, mark: yaml.Mark) -> yaml.MarkedYAMLError:
    return yaml.composer.ComposerError(None, None, problem, mark)


def _children(node: yaml.Node) -> list[yaml.Node]:
    if isinstance(node, yaml.MappingNode):
        return [child for pair in node.value for child in pair]
    return list(node.value) if isinstance(node, yaml.SequenceNode) else []


def _shortened(value: object) -> str:
    return repr(value if len(str(value)) <= 40 else f"{str(value)[:37]}...") if isinstance(value, str) else "this"


_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$")
_StrictLoader.add_implicit_resolver("tag:yaml.org,2002:float", _NUMBER, list("-+.0123456789"))


def parse_yaml(text: str, where: str) -> object:
    """Content of YAML text: dicts, lists, numbers and text, never other objects.

    Raises:
        ConfigError: no valid YAML, a key given twice, more than LARGEST_FILE characters, MOST_VALUES values or DEEPEST
            levels.
    """
    if len(text) > LARGEST_FILE:
        raise ConfigError(f"size of {where}", len(text), f"at most {LARGEST_FILE:,} characters")
    try:
        return yaml.load(text, Loader=_StrictLoader)
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        raise ConfigError(f"{where}: line {line}", error.problem, "valid YAML") from None
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        raise ConfigError(
            f"{where}: line {line}", text[error.position], "valid YAML", "Remove this character."
        ) from None
    except (yaml.YAMLError, ValueError, ArithmeticError, RecursionError) as error:  # such as an impossible escape
        raise ConfigError(where, text, "valid YAML", str(error)) from None


def read_yaml(path: Path) -> object:
    """Content of a YAML file; as parse_yaml, and ConfigError for a file that cannot be read."""
    return parse_yaml(text_of(path, "YAML text"), str(path))


def text_of(path: Path, kind: str) -> str:
    """Text of a file of at most LARGEST_FILE bytes; ConfigError, which names its kind, for one that cannot be read."""
    try:
        if path.exists() and not path.is_file():
            raise ConfigError("file", str(path), f"a file of {kind}, no folder or device")
        with path.open("rb") as stream:
            content = stream.read(LARGEST_FILE + 1)
        if len(content) > LARGEST_FILE:
            size = path.stat().st_size
            raise ConfigError(f"size of {path}", size, f"at most {LARGEST_FILE:,} bytes of {kind}")
        return content.decode().replace("\r\n", "\n")
    except ConfigError:
        raise
    except OSError as error:  # its text would repeat the path, however long it is
        raise ConfigError("file", str(path), f"readable {kind}", error.strerror or "") from None
    except ValueError as error:
        raise ConfigError("file", str(path), f"readable {kind}", str(error)) from None


def dump_yaml(values: Mapping[str, Any]) -> str:
    """YAML text of plain values, keys in the order given."""
    return yaml.safe_dump(dict(values), sort_keys=False, allow_unicode=True)


def mapping(where: str, value: object, valid: Sequence[str], required: Sequence[str] = ()) -> Mapping[str, Any]:
    """The value, a mapping with valid keys only and all the required ones; None counts as an empty mapping."""
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


def space_point(where: str, value: object) -> tuple[float, float, float]:
    """Three finite numbers."""
    if not isinstance(value, list | tuple) or len(value) != 3:
        raise ConfigError(where, value, "three numbers, such as [0, 0, 10]")
    x, y, z = numbers(where, value)
    return x, y, z


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
    """A context that adds the place in the file to errors in values from it."""
    try:
        yield
    except ConfigError:
        raise
    except InvalidInput as error:
        raise ConfigError(f"{where}: {error.what}", error.value, error.allowed, error.hint) from error
