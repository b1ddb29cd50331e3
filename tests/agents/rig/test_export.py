"""Recordings as Minari datasets and Parquet tables."""

import json
from pathlib import Path

import numpy as np
import pytest

from agents.evaluation.minari_dataset import read_dataset
from agents.rig.__main__ import main
from rollingjoint import five_link
from rollingjoint.identify import RecordingWriter


@pytest.fixture
def recording(tmp_path):
    """Two runs of four steps; the third tip is not seen, the second run has no goals."""
    with RecordingWriter(tmp_path / "a.jsonl", five_link(), rate=20.0) as writer:
        for run in ("1", "2"):
            for k in range(4):
                others = {"goal": [90.5 + k, 97.5]} if k and run == "1" else {}
                seen = {"tip": [1.0, 80.0]} if k != 2 else {}
                writer.step(0.05 * k, [90.0 + k, 97.0], [3.0, 4.0], run=run, **others, **seen)
        writer.event(0.3, "guard: tension low")
    return tmp_path / "a.jsonl"


def test_an_episode_per_run_has_readings_and_goals(recording, tmp_path, capsys):
    assert main(["export", str(recording), "--out", str(tmp_path / "data")]) == 0
    assert "6 steps" in capsys.readouterr().out
    steps = read_dataset(tmp_path / "data")
    assert steps.lengths.tolist() == [3, 3] and steps.observations.shape == (6, 6)
    np.testing.assert_array_equal(steps.actions[:, 0], [91.5, 92.5, 93.5, 91.0, 92.0, 93.0])
    np.testing.assert_array_equal(steps.next_observations[0], [91.0, 97.0, 3.0, 4.0, 1.0, 80.0])
    assert np.isnan(steps.observations[2, 4:]).all() and steps.truncations.tolist() == [False, False, True] * 2
    assert main(["export", str(recording), "--out", str(tmp_path / "data")]) == 2
    assert "a new folder" in capsys.readouterr().err


def test_a_parquet_table_has_a_row_per_step_and_null_for_what_is_not_there(recording, tmp_path, capsys):
    parquet = pytest.importorskip("pyarrow.parquet")
    export = ["export", str(recording), "--out", str(tmp_path / "a.parquet")]
    assert main(export) == 0 and "8 steps" in capsys.readouterr().out
    table = parquet.read_table(tmp_path / "a.parquet")
    columns = table.to_pydict()
    assert " ".join(columns) == "t motor0 motor1 tension0 tension1 tip_x tip_y goal0 goal1 run"
    assert columns["run"] == ["1"] * 4 + ["2"] * 4 and columns["motor0"] == [90.0, 91.0, 92.0, 93.0] * 2
    assert columns["tip_x"] == [1.0, 1.0, None, 1.0] * 2
    assert columns["goal0"] == [None, 91.5, 92.5, 93.5] + [None] * 4
    assert json.loads(table.schema.metadata[b"rollingjoint-recording"])["rate"] == 20.0
    for place in ("a.parquet", "nowhere/a.parquet"):
        assert main([*export[:-1], str(tmp_path / place)]) == 2
        assert "a new file that can be written" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["none.jsonl", "none.csv"])
def test_a_file_that_is_not_there_is_one_line(tmp_path, capsys, name):
    assert main(["export", str(tmp_path / name), "--out", str(tmp_path / "data")]) == 2
    error = capsys.readouterr().err
    assert name in error and error.count("\n") == 1 and not Path(tmp_path / "data").exists()
