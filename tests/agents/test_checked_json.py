"""JSON of strangers: refused in one line where it is too large, too deep or none."""

import gzip
import tracemalloc

import pytest

from agents.policies.errors import PolicyError
from agents.policies.file import unpack
from agents.results.__main__ import main as results
from agents.runs import checked_json
from agents.runs.checked_json import DEEPEST, parse_json, read_json
from agents.runs.files import RunFolderError, read_rows
from agents.viewer.recorded import records_in
from rollingjoint.errors import ConfigError, InvalidInput

DEEP = "[" * 100_000


def test_a_file_that_unpacks_to_too_much_is_not_unpacked(tmp_path, monkeypatch):
    monkeypatch.setattr(checked_json, "LARGEST", 1_000_000)
    path = tmp_path / "results.json.gz"
    path.write_bytes(gzip.compress(bytes(50_000_000), 1))
    tracemalloc.start()
    try:
        with pytest.raises(
            ConfigError, match=r"size of .*results.json.gz.*: expected at most 1,000,000 bytes, unpacked"
        ):
            read_json(path)
        assert tracemalloc.get_traced_memory()[1] < 10_000_000
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (DEEP, "expected at most 64 levels"),
        ("[" * (DEEPEST + 1) + "]" * (DEEPEST + 1), "expected at most 64 levels"),
        ('{"a":' * (DEEPEST + 1) + "0" + "}" * (DEEPEST + 1), "expected at most 64 levels"),
        ("[" + "[]," * 60_000 + "0]", "values in it = 120001: expected at most 110,000"),
        ("9" * 5000, "expected JSON text"),
        (b"\xff\xfe", "expected JSON text"),
        ("", "expected JSON text"),
    ],
)
def test_text_beyond_the_limits_is_refused(content, message, monkeypatch):
    monkeypatch.setattr(checked_json, "MOST_VALUES", 110_000)
    with pytest.raises(ConfigError, match=message) as caught:
        parse_json(content, "it")
    assert len(str(caught.value)) < 400


def test_text_within_the_limits_is_its_values():
    assert parse_json("[" * DEEPEST + "1" + "]" * DEEPEST, "it") == eval("[" * DEEPEST + "1" + "]" * DEEPEST)
    assert parse_json('{"a": [1, 2.5, null, "ü"]}'.encode(), "it") == {"a": [1, 2.5, None, "ü"]}


@pytest.mark.parametrize("name", ["deep.json", "deep.json.gz", "cut.json.gz", "folder.json"])
def test_results_from_such_a_file_are_one_line(name, tmp_path, capsys):
    path, packed = tmp_path / name, gzip.compress(DEEP.encode())
    if name == "folder.json":
        path.mkdir()
    else:
        path.write_bytes({"deep.json": DEEP.encode(), "deep.json.gz": packed, "cut.json.gz": packed[:-20]}[name])
    assert results(["--from", str(path), "--out", str(tmp_path / "page")]) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: results file = ") and error.count("\n") == 1
    assert not (tmp_path / "page").exists()


def test_deep_episodes_are_one_line():
    with pytest.raises(InvalidInput, match=r"deep\.json = 'more than 64 levels'"):
        records_in(DEEP.encode(), "deep.json")


def test_a_policy_file_with_a_deep_header_is_one_line():
    header = DEEP.encode()
    with pytest.raises(PolicyError, match=r"policy file = 'deep\.safetensors'"):
        unpack(len(header).to_bytes(8, "little") + header, "deep.safetensors")


@pytest.mark.parametrize("content", [b"steps\n\xff\n", b"steps\n" + b"9" * 200_000 + b"\n"])
def test_a_table_that_is_no_csv_is_one_line(content, tmp_path):
    (tmp_path / "progress.csv").write_bytes(content)
    with pytest.raises(RunFolderError, match=r"table = .*progress\.csv"):
        read_rows(tmp_path / "progress.csv")
