"""Recordings of rigs: JSON Lines and CSV, files that were cut off, long ones, wrong ones."""

import json

import numpy as np
import pytest

from rollingjoint import five_link
from rollingjoint.errors import ConfigError, InvalidInput
from rollingjoint.identify import RecordedRun, RecordingWriter, RigRecording, read_recording, write_recording
from rollingjoint.io.mechanism_file import mechanism_to_dict

from .rigs import recorded

HEADER = '{"format": "rollingjoint-recording", "version": 1, "mechanism": "five_link"}\n'
PULLED = HEADER + "".join(f'{{"t": {t}, "motors": [1, 2], "tensions": [3.0, -0.4]}}\n' for t in (0, 1))


def test_a_recording_is_read_as_it_was_written(tmp_path):
    first = recorded(30)
    write_recording(first, tmp_path / "a.jsonl")
    again = read_recording(tmp_path / "a.jsonl")
    for name in ("t", "motors", "tensions", "tips"):
        np.testing.assert_allclose(getattr(again.runs[0], name), getattr(first.runs[0], name), atol=1e-9)
    assert mechanism_to_dict(again.mechanism) == mechanism_to_dict(five_link()) and again.steps == 30 and again.sees_tip
    with pytest.raises(InvalidInput, match="new file"):
        write_recording(first, tmp_path / "a.jsonl")


def test_every_line_is_complete_as_soon_as_it_is_written_and_a_cut_one_is_left_out(tmp_path):
    writer = RecordingWriter(tmp_path / "a.jsonl", five_link(), rate=20.0)
    for step in range(5):
        writer.step(0.05 * step, [90.0 + step, 97.0], [3.0, np.nan], action=np.zeros(2), retries=1)
        writer.event(0.05 * step, "guard: 40 N")
        assert read_recording(tmp_path / "a.jsonl").steps == 1 + step if step else True
    whole = read_recording(tmp_path / "a.jsonl")
    assert len(whole.events) == 5 and whole.header["rate"] == 20.0 and np.isnan(whole.runs[0].tensions[0, 1])
    writer.close()
    with (tmp_path / "a.jsonl").open("a") as stream:
        stream.write('{"t": 0.25, "moto')
    assert read_recording(tmp_path / "a.jsonl").steps == 5


def test_runs_are_kept_apart(tmp_path):
    lines = [{"t": t, "motors": [90.0, 97.0], "tip": [1.0, 2.0], "run": run} for run in "ab" for t in (0.0, 0.1)]
    (tmp_path / "a.jsonl").write_text(HEADER + "".join(json.dumps(line) + "\n" for line in lines))
    assert [run.name for run in read_recording(tmp_path / "a.jsonl").runs] == ["a", "b"]


def test_tables_with_named_columns_are_recordings_in_any_order(tmp_path):
    text = "tip_x,tip_y,tension1,tension0,motor0,motor1,t\n1,2,3.5,3,90,97,0\n,,,,91,96,0.1\n5,6,nan,3,92,95,0.2\n"
    (tmp_path / "a.csv").write_text(text)
    (run,) = read_recording(tmp_path / "a.csv").runs
    np.testing.assert_array_equal(run.motors[:, 1], [97, 96, 95])
    np.testing.assert_array_equal(run.tensions[0], [3, 3.5])
    assert np.isnan(run.tensions[1]).all() and np.isnan(run.tensions[2, 1]) and np.isnan(run.tips[1]).all()


def test_long_recordings_are_thinned_and_keep_every_turning_point():
    t = np.arange(24_000) / 8.0
    motors = np.stack([90 + 5 * np.sin(t / 7), 97 - 4 * np.sin(t / 7)], axis=1)
    run = RecordedRun(t, motors, np.full_like(motors, 3.0), np.full_like(motors, np.nan))
    thin = RigRecording([run], five_link()).thinned(2000)
    kept = thin.runs[0]
    assert 1900 <= thin.steps <= 2000
    turns = np.flatnonzero(np.diff(np.sign(np.diff(motors[:, 0]))) != 0) + 1
    nearest = np.abs(kept.motors[:, 0][:, None] - motors[turns, 0]).min(axis=0)
    assert nearest.max() < 1e-6 and len(turns) > 100
    assert RigRecording([run], five_link()).thinned(24_000).steps == 24_000


def test_steps_that_are_left_out_are_counted(tmp_path):
    readings = [[1, 2], [1, None], None, [1, 2], [float("nan"), 2], [1, 2]]
    lines = [{"t": t, "motors": motors} for t, motors in enumerate(readings)] + [{"t": 6, "event": "guard: 40 N"}]
    lines.append({"t": 7, "motors": [1, 2], "run": "alone"})
    (tmp_path / "a.jsonl").write_text(HEADER + "".join(json.dumps(line) + "\n" for line in lines))
    with pytest.warns(UserWarning, match="4 of 7 steps left out .3 without a time or a motor position, 1 alone"):
        assert read_recording(tmp_path / "a.jsonl").steps == 3
    (tmp_path / "a.csv").write_text("t,motor0,motor1\n0,1,2\n0.1,,2\nnan,1,2\n0.3,1,2\n")
    remarks = []
    assert read_recording(tmp_path / "a.csv", remarks.append).steps == 2
    assert len(remarks) == 1 and "2 of 4 steps left out" in remarks[0]


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("", "line 1"),
        ('{"t": 0, "motors": [1, 2]}\n', "the format"),
        (HEADER + '{"t": 0, "motors": [1]}\n{"t": 1, "motors": [1]}\n', "one per tendon"),
        (HEADER + '{"t": 0, "motors": [1, 2]}\n{"t": 1, "motors": [1]}\n', "line 3: motors"),
        (HEADER + '{"t": 0, "motors": [1, "2"]}\n', "line 2: motors"),
        (HEADER + "{broken}\n{}\n", "line 2"),
        (HEADER + '{"t": 1, "motors": [1, 2]}\n{"t": 0, "motors": [1, 2]}\n', "rising"),
        (HEADER + '{"t": 1, "motors": [1, 2]}\n', "two steps"),
        (HEADER + '{"t": 0, "motors": [1, Infinity]}\n{"t": 1, "motors": [1, 2]}\n', "line 2: motors"),
        (HEADER + '{"t": 0, "motors": [1, 2], "tensions": [1, -1e999]}\n', "line 2: tensions"),
        (PULLED.replace("3.0", "-50.0"), "tensions of run 1 = -50.0: .*positive where a tendon pulls"),
        (PULLED.replace("}", ', "rate": -1}', 1), "rate = -1: .*positive number of steps per second"),
        (PULLED.replace("}", ', "rate": NaN}', 1), "rate"),
        (HEADER.replace("five_link", "six_lunk"), "six_lunk"),
        (HEADER.replace('"version": 1', '"version": 9'), "version"),
    ],
)
def test_wrong_lines_are_named(tmp_path, content, said):
    (tmp_path / "a.jsonl").write_text(content)
    with pytest.raises(ConfigError, match=said):
        read_recording(tmp_path / "a.jsonl")


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("t,motor0\n0,x\n", "motor0"),
        ("t,motor0\n0,inf\n", "line 2: motors"),
        ("time,q\n0,1\n", "columns"),
        ("", "columns"),
    ],
)
def test_wrong_tables_are_named(tmp_path, content, said):
    (tmp_path / "a.csv").write_text(content)
    with pytest.raises(ConfigError, match=said):
        read_recording(tmp_path / "a.csv")
    with pytest.raises(ConfigError, match="recording"):
        read_recording(tmp_path / "none.jsonl")
