"""Recordings as Minari datasets."""

from pathlib import Path

import numpy as np
import pytest

from agents.evaluation.minari_dataset import read_dataset
from agents.rig.__main__ import main
from rollingjoint import five_link
from rollingjoint.identify import RecordingWriter


def test_an_episode_per_run_has_readings_and_goals(tmp_path, capsys):
    with RecordingWriter(tmp_path / "a.jsonl", five_link(), rate=20.0) as writer:
        for run in ("1", "2"):
            for k in range(4):
                others = {"goal": [90.5 + k, 97.5]} if k and run == "1" else {}
                seen = {"tip": [1.0, 80.0]} if k != 2 else {}
                writer.step(0.05 * k, [90.0 + k, 97.0], [3.0, 4.0], run=run, **others, **seen)
        writer.event(0.3, "guard: tension low")
    assert main(["export", str(tmp_path / "a.jsonl"), "--out", str(tmp_path / "data")]) == 0
    assert "6 steps" in capsys.readouterr().out
    steps = read_dataset(tmp_path / "data")
    assert steps.lengths.tolist() == [3, 3] and steps.observations.shape == (6, 6)
    np.testing.assert_array_equal(steps.actions[:, 0], [91.5, 92.5, 93.5, 91.0, 92.0, 93.0])
    np.testing.assert_array_equal(steps.next_observations[0], [91.0, 97.0, 3.0, 4.0, 1.0, 80.0])
    assert np.isnan(steps.observations[2, 4:]).all() and steps.truncations.tolist() == [False, False, True] * 2
    assert main(["export", str(tmp_path / "a.jsonl"), "--out", str(tmp_path / "data")]) == 2
    assert "a new folder" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["none.jsonl", "none.csv"])
def test_a_file_that_is_not_there_is_one_line(tmp_path, capsys, name):
    assert main(["export", str(tmp_path / name), "--out", str(tmp_path / "data")]) == 2
    error = capsys.readouterr().err
    assert name in error and error.count("\n") == 1 and not Path(tmp_path / "data").exists()
