"""YAML from outside: whatever is in it, one line names the file, the place and what was expected, at once."""

from __future__ import annotations

import time

import pytest

from rollingjoint.checked_yaml import LARGEST_FILE, MOST_VALUES, parse_yaml, read_yaml
from rollingjoint.errors import ConfigError, InvalidInput
from rollingjoint.io.mechanism_file import load_mechanism


def aliases(levels: int = 9, width: int = 9) -> str:
    """Lists of lists of the same lists: width**levels values in a few hundred bytes."""
    lines = ["a0: &a0 [x, x, x]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * width)}]" for i in range(1, levels + 1)]
    return "\n".join(lines)


def merges(levels: int = 9, width: int = 9) -> str:
    """Mappings that merge the same mapping many times."""
    lines = ["a0: &a0 {x: 1, y: 2}"]
    lines += [f"a{i}: &a{i} {{<<: [{', '.join([f'*a{i - 1}'] * width)}]}}" for i in range(1, levels + 1)]
    return "\n".join(lines)


HOSTILE = {
    "!!int": ("links: 2\nname: !!int abc", "line 2 = \"'abc' is not of type int\""),
    "!!float": ("name: !!float abc", "is not of type float"),
    "!!bool": ("name: !!bool abc", "is not of type bool"),
    "!!timestamp": ("name: !!timestamp abc", "is not of type timestamp"),
    "bad date": ("name: 2020-13-45", "'2020-13-45' is not of type timestamp"),
    "5,000 digits": (f"links: {'9' * 5000}", "a number of 5,000 characters"),
    "5,000 digits at base 60": (f"links: {'59:' * 5000}59", "a number of 15,002 characters"),
    "recursion": ("links: &a [*a]", "an alias inside of what it stands for"),
    "recursive mapping": ("links: &a {b: *a}", "an alias inside of what it stands for"),
    "nesting": ("[" * 100_000, "more than 32 levels"),
    "nested mappings": ("{a: " * 100_000, "more than 32 levels"),
    "aliases": (aliases(), "more than 50,000 values"),
    "merge keys": (merges(), "more than 50,000 values"),
    "a list as a key": ("? [a, b]\n: 1", "a list or a mapping as a key"),
    "aliases as a key": (aliases(4) + "\n? *a4\n: 1", "a list or a mapping as a key"),
    "NUL": ("links: 1\nname: a\0b", r"line 2 = '\x00': expected valid YAML"),
    "escape": ('name: "\\UFFFFFFFF"', "expected valid YAML"),
    "directive": (f"%YAML {'1' * 5000}.1\n---\na: 1", "expected valid YAML"),
    "python": ("name: !!python/object/apply:os.system [ls]", "expected valid YAML"),
    "two documents": ("a: 1\n---\nb: 2", "expected valid YAML"),
}


@pytest.mark.parametrize("kind", HOSTILE)
def test_hostile_yaml_is_refused_at_once_in_one_line(tmp_path, kind):
    text, expected = HOSTILE[kind]
    path = tmp_path / "arm.yaml"
    path.write_text(text, encoding="utf-8")
    begin = time.process_time()
    with pytest.raises(ConfigError) as found:
        read_yaml(path)
    message = str(found.value)
    assert time.process_time() - begin < 2.0
    assert message.startswith(str(path)) and expected in message
    assert message.isprintable() and len(message) < 600


@pytest.mark.parametrize("text", ["links: " + "[[x], " * 30 + "]" * 30, "name: 2020-01-01", aliases(3), merges(2)])
def test_files_that_can_be_read_but_make_no_mechanism_say_so_in_one_line(tmp_path, text):
    path = tmp_path / "arm.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError) as found:
        load_mechanism(path)
    assert str(found.value).startswith(str(path)) and str(found.value).isprintable()


def test_a_file_that_is_too_large_is_named_and_not_read(tmp_path):
    path = tmp_path / "arm.yaml"
    with path.open("wb") as stream:
        stream.truncate(50_000_000)
    begin = time.process_time()
    with pytest.raises(ConfigError) as found:
        read_yaml(path)
    assert time.process_time() - begin < 0.5
    assert str(found.value) == f"size of {path} = 50000000: expected at most 1,000,000 bytes of YAML text."


@pytest.mark.slow
def test_the_largest_file_with_the_most_values_takes_seconds():
    text = "[" + "1, " * (MOST_VALUES - 2) + "1" + " " * (LARGEST_FILE - 3 * MOST_VALUES) + "]"
    begin = time.process_time()
    parse_yaml(text, "arm.yaml")
    assert time.process_time() - begin < 10.0


@pytest.mark.parametrize("name", ["/dev/zero", "."])
def test_a_device_or_a_folder_is_not_read(tmp_path, monkeypatch, name):
    from pathlib import Path

    monkeypatch.chdir(tmp_path)
    with pytest.raises(ConfigError, match="a file of YAML text"):
        read_yaml(Path(name))


def test_anchors_and_merge_keys_of_ordinary_files_still_work():
    text = "a: &a {x: 1, y: 2}\nb: {<<: *a, y: 3}\nc: [*a, *a]"
    expected = {"a": {"x": 1, "y": 2}, "b": {"x": 1, "y": 3}, "c": [{"x": 1, "y": 2}] * 2}
    assert parse_yaml(text, "text") == expected


def test_messages_are_one_line_and_made_no_longer_than_they_are_shown():
    import numpy as np

    bomb: object = ["x"]
    for _ in range(60):
        bomb = [bomb] * 9
    itself: list[object] = []
    itself.append(itself)
    for value in (np.zeros((3, 3)), bomb, itself, "a\0b\nc", "x" * 10**7, [10**5000], {"a": {"b": (1,)}}):
        message = str(InvalidInput("what\nwhere", value, "something\nelse", "hint\0"))
        assert message.isprintable() and len(message) < 220
    for value in ([1, 2.0, None], (1,), (), {"a": {"b": (1, [])}, 2: "x"}, "text", 3, "it's"):
        assert str(InvalidInput("x", value, "y")) == f"x = {value!r}: expected y."


def test_a_name_that_is_too_long_for_a_file_is_told_in_one_short_line(tmp_path):
    with pytest.raises(ConfigError) as told:
        read_yaml(tmp_path / ("long" * 1000))
    assert str(told.value).endswith("expected readable YAML text. File name too long")
    assert len(str(told.value)) < 300
