"""The benchmark of arms of others, on recordings that the project's own arm makes."""

import csv
from pathlib import Path

import numpy as np
import pytest

BENCHMARKS = Path(__file__).parent.parent / "benchmarks"
HEAD = ["timestamp", "pattern_label", *(f"servo_{n}_mm" for n in range(9)), "tip_x", "tip_y", "tip_z"]


@pytest.fixture
def foreign_arms(monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    import foreign_arms

    return foreign_arms


def motors_of_patterns(rng, patterns, steps=12):
    """Pull and release along random directions, one segment or two at a time, (patterns x steps, 9) mm."""
    there_and_back = 1.0 - np.abs(np.linspace(-1.0, 1.0, steps))
    ends = rng.uniform(-4.0, 4.0, (patterns, 9)) * np.repeat(rng.random((patterns, 3)) < 0.6, 3, axis=1)
    return (ends[:, None, :] * there_and_back[:, None]).reshape(-1, 9)


def made_recording(module, rng, free, noise=0.0, patterns=8):
    """A recording of the project's arm at random parameters, its model and their z."""
    model = module.Model(module.ROBOTS["v4"], free)
    z = 0.5 * rng.standard_normal(model.size)
    motors = motors_of_patterns(rng, patterns)
    labels = np.array([f"rep1_{module.FAMILIES[row // 24 % 5]}_dir" for row in range(len(motors))])
    bare = module.Recording(0.55 * np.arange(len(motors)), labels, motors, np.zeros((len(motors), 3)))
    tips = model.tips(z, bare)
    return bare._replace(tips=tips + noise * rng.standard_normal(tips.shape)), model, z


def written(path, recording):
    with path.open("w", newline="") as file:
        rows = zip(*recording, strict=True)
        csv.writer(file).writerows([HEAD, *([time, label, *motors, *tip] for time, label, motors, tip in rows)])
    return path


def test_fit_finds_the_arm_that_made_a_recording(foreign_arms):
    free = (*foreign_arms.CALIBRATED, "delay")
    recording, model, z = made_recording(foreign_arms, np.random.default_rng(1), free, noise=0.05)
    found = model.fit([recording])
    assert foreign_arms.rms(recording.tips, model.tips(found, recording)) < 0.5
    assert foreign_arms.rms(recording.tips, model.tips(0.0 * z, recording)) > 4.0
    values, true = model.values(found), model.values(z)
    assert values["frame"] == pytest.approx(true["frame"], abs=0.01)
    assert values["delay"] == pytest.approx(true["delay"], abs=0.02)
    assert values["offset"] == pytest.approx(true["offset"], abs=0.15)


def test_sweeps_settle_what_depends_on_tensions_and_on_the_past(foreign_arms, monkeypatch):
    free = foreign_arms.VARIANTS[foreign_arms.CHOSEN]
    recording, model, z = made_recording(foreign_arms, np.random.default_rng(2), free)
    monkeypatch.setattr(foreign_arms, "SWEEPS", 30)
    values = model.values(z)
    arm = model.arm(values)
    found, shortening = model.solve(values, arm, model.unstretched(values, arm, recording.times, recording.motors))
    passes = np.arange(3)[:, None] <= np.repeat(np.arange(3), 3)
    forces = found.tensions @ passes.T
    assert shortening == pytest.approx(forces * np.abs(values["axial compliance"]), abs=1e-6)
    assert shortening.max() > 0.1
    assert foreign_arms.rms(recording.tips, model.tips(z, recording)) < 0.15
    assert model.tips(z, recording) == pytest.approx(recording.tips, abs=0.5)
    idle = ~recording.motors.any(axis=1)
    assert np.ptp(recording.tips[idle][1:], axis=0).max() > 0.1  # friction of bending remembers where the arm was


def test_repeatability_is_the_noise_of_equal_commands(foreign_arms):
    recording, _, _ = made_recording(foreign_arms, np.random.default_rng(4), foreign_arms.CALIBRATED)
    twice = foreign_arms.Recording(*(np.concatenate([column, column]) for column in recording))
    twice = twice._replace(times=0.55 * np.arange(len(twice.times)))
    noisy = twice._replace(tips=twice.tips + 2.0 * np.random.default_rng(5).standard_normal(twice.tips.shape))
    (_, pairs, spread), *_ = foreign_arms.repeatability(noisy, twice.tips)
    assert pairs >= len(recording.times)
    assert spread == pytest.approx(2.0 * np.sqrt(3.0), rel=0.15)


def test_process_learns_what_physics_leaves_and_is_silent_far_away(foreign_arms):
    recording, _, _ = made_recording(foreign_arms, np.random.default_rng(6), foreign_arms.CALIBRATED)
    left = np.sin(recording.motors[:, :3])
    seen = np.arange(len(left)) % 3 > 0
    learned = foreign_arms.Process.of(recording.rows(seen), left[seen])
    between = recording.rows(~seen)
    assert np.sqrt(np.mean((learned(between) - left[~seen]) ** 2)) < 0.6 * left[~seen].std()
    assert np.abs(learned(between._replace(motors=between.motors + 40.0))).max() < 1e-6


def test_shifts_in_pulls_move_tendons_only_where_motors_are_let_out(foreign_arms):
    recording, model, z = made_recording(
        foreign_arms, np.random.default_rng(8), (*foreign_arms.CALIBRATED, "shift in pulls")
    )
    values = model.values(z)
    motors = recording.motors.copy()
    motors[3:6, 1:] = -9.9
    bare = {**values, "shift in pulls": np.zeros(9)}
    arm = model.arm(values)
    moved, still = (model.unstretched(numbers, arm, recording.times, motors) for numbers in (values, bare))
    shift = np.zeros_like(moved)
    shift[3:6] = values["shift in pulls"]
    np.testing.assert_allclose(moved - still, shift, atol=1e-12)


@pytest.mark.slow
def test_command_prints_the_error_on_a_file(foreign_arms, tmp_path, capsys):
    recording, _, _ = made_recording(
        foreign_arms, np.random.default_rng(7), foreign_arms.MOVING, noise=0.2, patterns=12
    )
    half = len(recording.times) // 2
    written(tmp_path / "v4_train.csv", recording)
    scored = written(tmp_path / "scored.csv", recording.rows(slice(half, None)))
    image = tmp_path / "tips.png"
    foreign_arms.main(["--robot", "v4", "--fit", str(tmp_path), "--score", str(scored), "--picture", str(image)])
    printed = capsys.readouterr().out
    assert f"{half} rows fitted, {half} scored" in printed
    assert float(printed.split("physics: ")[1].split()[0]) < 8.0
    assert image.stat().st_size > 10_000


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("timestamp,tip_x\n1,2\n3,4\n", "columns of v4_train.csv"),
        (",".join(HEAD) + "\n", "rows of v4_train.csv"),
        ("\n".join([",".join(HEAD), *["1,a" + ",0" * 12] * 2, "1,a" + ",nan" * 12]), "line 4 of v4_train.csv"),
        ("\n".join([",".join(HEAD), *["1,a" + ",0" * 12] * 2, "1,a" + ",x" * 12]), "entries of v4_train.csv"),
        ("\n".join([",".join(HEAD), *["1,a" + ",0" * 12] * 2, "1,a"]), "line 4 of v4_train.csv"),
        ("\n".join([",".join(HEAD), *["1,a" + ",0" * 12] * 2]), "rows to fit"),
        (None, "folder to fit"),
    ],
)
def test_unusable_recordings_are_one_line(foreign_arms, text, told, tmp_path, capsys):
    if text is not None:
        (tmp_path / "v4_train.csv").write_text(text)
    with pytest.raises(SystemExit) as exit:
        foreign_arms.main(["--robot", "v4", "--fit", str(tmp_path)])
    printed = capsys.readouterr()
    assert exit.value.code == 2
    assert told in printed.err
    assert printed.err.count("\n") == 1


def test_picture_that_cannot_be_written_is_told_before_the_fit(foreign_arms, tmp_path, capsys):
    with pytest.raises(SystemExit):
        foreign_arms.main(
            ["--robot", "v4", "--fit", str(tmp_path), "--picture", str(tmp_path / "missing" / "tips.png")]
        )
    printed = capsys.readouterr().err
    assert "missing" in printed and "recordings" not in printed and printed.count("\n") == 1


def test_missing_file_to_score_is_one_line(foreign_arms, tmp_path, capsys):
    recording, _, _ = made_recording(foreign_arms, np.random.default_rng(8), foreign_arms.CALIBRATED)
    written(tmp_path / "v4_train.csv", recording)
    with pytest.raises(SystemExit):
        foreign_arms.main(["--robot", "v4", "--fit", str(tmp_path), "--score", str(tmp_path / "missing.csv")])
    assert "missing.csv" in capsys.readouterr().err
