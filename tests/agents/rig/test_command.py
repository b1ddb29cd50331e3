"""rj rig from check to drive on a simulated robot, and policies adapted to a recording of it."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import yaml

from agents import adapt
from agents.policies.loading import load_policy
from agents.rig.__main__ import main
from agents.rig.settings import KEYS, load_rig
from rollingjoint.cli import main as rj
from rollingjoint.errors import ConfigError
from rollingjoint.identify import read_recording

pytestmark = pytest.mark.posix

RIG = "mechanism: five_link\nmotors: {radius_mm: 10, signs: [1, -1], current_limit: 27}\nsimulated: {robot: 1000}\n"
PAGE = Path("docs/rig.md").read_text("utf-8")


@pytest.fixture
def rig(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("rig.yaml").write_text(RIG)
    return tmp_path


@pytest.mark.slow
def test_check_home_bench_identify_replay_and_drive_follow_each_other(rig, capsys):
    assert main(["check", "rig.yaml"]) == 0 and "(not homed)" in capsys.readouterr().out
    assert main(["bench", "rig.yaml", "--out", "a.jsonl"]) == 2 and "rj rig home rig.yaml" in capsys.readouterr().err
    assert not Path("a.jsonl").exists()
    assert main(["home", "rig.yaml"]) == 0
    calibration = json.loads(Path("rig.calibration.json").read_text())
    np.testing.assert_allclose(calibration["zero_mm"], [89.8, 99.7], atol=0.1)
    assert main(["bench", "rig.yaml", "--steps", "250", "--out", "bench.jsonl"]) == 0
    recording = read_recording("bench.jsonl")
    assert recording.steps == 251 and np.ptp(recording.runs[0].motors, axis=0).min() > 6 and recording.sees_tip
    assert rj(["identify", "bench.jsonl", "--parameters", "play,sheath,stiffness,offsets", "--output", "found"]) == 0
    found = yaml.safe_load(Path("found/identified.yaml").read_text())["parameters"]
    assert found["play[0]"]["value"] == pytest.approx(3.94, abs=0.4)
    assert found["sheath[1]"]["value"] == pytest.approx(0.73, abs=0.15)
    assert found["stiffness[0]"]["value"] == pytest.approx(0.73, abs=0.15)
    capsys.readouterr()
    remaining = []
    for words in ([], ["--identified", "found"]):
        assert main(["replay", "bench.jsonl", *words]) == 0
        remaining.append(float(re.search(r"tension: rms ([\d.]+)", capsys.readouterr().out)[1]))
    assert remaining[1] < 0.3 * remaining[0]
    Path("rig.yaml").write_text(RIG + "identified: found\n")
    np.testing.assert_allclose(load_rig("rig.yaml").offsets, [found[f"offsets[{j}]"]["value"] for j in (0, 1)])
    assert main(["drive", "rig.yaml", "--target", "-20", "70", "--out", "drive.jsonl"]) == 0
    assert "tip error" in capsys.readouterr().out
    assert read_recording("drive.jsonl").header["policy"] == "instrument"


def test_a_reboot_forgets_the_zero(rig, capsys):
    assert main(["home", "rig.yaml"]) == 0 and Path("rig.calibration.json").exists()
    assert main(["reboot", "rig.yaml", "--id", "2"]) == 0
    assert "rj rig home rig.yaml" in capsys.readouterr().out and not Path("rig.calibration.json").exists()


def test_a_wrong_sign_is_found_before_anything_is_kept(rig, monkeypatch, capsys):
    from agents.rig.simulated import bus

    made = bus.SimulatedBus.__init__

    def other(self, plant, clock, radius, signs, seed=1):
        made(self, plant, clock, radius, (1, 1), seed)

    monkeypatch.setattr(bus.SimulatedBus, "__init__", other)
    assert main(["home", "rig.yaml"]) == 2
    assert "the other sign for the motors [2]" in capsys.readouterr().err
    assert not Path("rig.calibration.json").exists()


@pytest.mark.slow
def test_a_policy_is_trained_on_for_a_recorded_rig(rig, capsys):
    assert main(["home", "rig.yaml"]) == 0 and main(["bench", "rig.yaml", "--steps", "60", "--out", "bench.jsonl"]) == 0
    words = ["--recording", "bench.jsonl", "--controller", "instrument", "--updates", "1"]
    assert adapt.main(words) == 2 and "--policies" in capsys.readouterr().err
    assert adapt.main([*words, "--policies", "adapted"]) == 0
    policy = load_policy("adapted/instrument_rig.safetensors")
    assert policy.env_id == "rj_gym/Instrument-v1" and policy.sha256 != load_policy("instrument").sha256
    assert Path("adapted/identified.yaml").is_file() and "play[0]" in capsys.readouterr().out
    assert adapt.main([*words[:2], "--controller", "probing bank", "--policies", "x"]) == 2
    assert "a policy" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (RIG + "rat: 20\n", "Did you mean 'rate'?"),
        ("mechanism: five_link\nmotors: {radius_mm: 10}\n", "'port'"),
        (RIG + "guard: {high: 50}\n", "low < high < stop"),
        (RIG + "offsets: [1]\n", "2 numbers"),
        (RIG.replace("[1, -1]", "[1, 1, 1]"), "2 numbers"),
        (RIG + "identified: nowhere\n", "nowhere"),
        (RIG.replace("[1, -1]", "[1, 5]"), "motors.signs = 5"),
        (RIG.replace("[1, -1]", "[1, 0]"), "motors.signs = [1, 0]: expected 1 for motors"),
        (RIG + "rate: 5000\n", "rate = 5000: expected a number from 0.1 to 200 [Hz]"),
        (RIG.replace("radius_mm: 10", "radius_mm: 10, baud: 5"), "motors.baud = 5: expected one of 9600"),
        (RIG.replace("radius_mm: 10", "radius_mm: 10, baud: fast"), "motors.baud = 'fast'"),
    ],
)
def test_a_wrong_file_of_a_rig_is_one_line(rig, capsys, text, said):
    Path("rig.yaml").write_text(text)
    assert main(["check", "rig.yaml"]) == 2
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1
    with pytest.raises(ConfigError):
        load_rig("rig.yaml")


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"zero_ticks": [0]}, "zero_ticks = [0]: expected 2 numbers"),
        ({"zero_ticks": [0, "x"]}, "zero_ticks[1] = 'x'"),
        ({"zero_mm": None}, "zero_mm"),
        ({"signs": 3}, "signs = 3"),
        ({"radius_mm": 9.0}, "Home again: rj rig home rig.yaml"),
    ],
)
def test_a_damaged_calibration_is_one_line(rig, capsys, changes, said):
    kept = {"zero_ticks": [0, 0], "zero_mm": [90.0, 100.0], "signs": [1, -1], "radius_mm": 10.0, "tension": 3.0}
    Path("rig.calibration.json").write_text(json.dumps(kept))
    load_rig("rig.yaml").spools()
    Path("rig.calibration.json").write_text(json.dumps(kept | changes))
    assert main(["check", "rig.yaml"]) == 2
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1


def test_errors_of_ports_and_of_simulated_arms_name_the_key(rig, capsys):
    Path("arm.yaml").write_text("mechanism: small_arm\nmotors: {radius_mm: 10}\nsimulated: {}\n")
    ports = "motors: {port: nowhere, ids: [1, 2], signs: [1, 1], radius_mm: 10}\ncells: {port: nowhere}\n"
    Path("ports.yaml").write_text("mechanism: five_link\n" + ports)
    for file, said in (("arm.yaml", "arm.yaml: mechanism = "), ("ports.yaml", "motors.port")):
        assert main(["check", file]) == 2
        error = capsys.readouterr().err
        assert said in error and error.count("\n") == 1


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["home", "rig.yaml", "--tension", "nan"], "--tension = nan"),
        (["home", "rig.yaml", "--tension", "300"], "--tension = 300.0: expected a finite number from 0.5 to 25"),
        (["bench", "rig.yaml", "--bend", "nan", "--out", "x.jsonl"], "--bend = nan"),
        (["bench", "rig.yaml", "--bend", "90", "--out", "x.jsonl"], "--bend = 90.0: expected 0.1 to 40 mm"),
        (["bench", "rig.yaml", "--seed", "-1", "--out", "x.jsonl"], "--seed = -1"),
        (["drive", "rig.yaml", "--seed", "-1", "--out", "x.jsonl"], "--seed = -1"),
        (["drive", "rig.yaml", "--target", "500", "500", "--out", "x.jsonl"], "the nearest place found is ("),
        (["drive", "rig.yaml", "--target", "nan", "70", "--out", "x.jsonl"], "--target = [nan, 70.0]"),
        (
            ["drive", "rig.yaml", "--policy", "late_pose", "--out", "x.jsonl"],
            "--policy = 'late_pose': expected",
        ),
        (["reboot", "rig.yaml", "--id", "7"], "a motor of the rig: [1, 2]"),
    ],
)
def test_options_are_checked_before_anything_moves(rig, capsys, words, said):
    assert main(words) == 2
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1 and not Path("x.jsonl").exists()


def test_a_recording_that_cannot_be_replayed_is_one_line(rig, capsys):
    header = '{"format": "rollingjoint-recording", "version": 1}\n'
    steps = [{"t": 0.1 * step, "motors": [90.0 - step, 97.0 + step]} for step in range(3)]
    Path("bare.jsonl").write_text(header + "".join(json.dumps(step) + "\n" for step in steps))
    five_link = ["--mechanism", "five_link"]
    Path("identified.yaml").write_text("parameters_of: [play]\nparameters: {'play[0]': 1, 'play[1]': 1}\n")
    for words, said in (
        ([], "--mechanism"),
        (["--mechanism", "small_arm"], "tendons of the recording = 2"),
        (five_link, "readings of tensions or tips"),
        ([*five_link, "--identified", "."], "parameters.play[0] = 1"),
    ):
        assert main(["replay", "bare.jsonl", *words]) == 2
        error = capsys.readouterr().err
        assert said in error and error.count("\n") == 1
    Path("far.jsonl").write_text(
        header + json.dumps({"t": 0.0, "motors": [90.0, -9e9]}) + "\n" + json.dumps(steps[1]) + "\n"
    )
    assert main(["replay", "far.jsonl", *five_link]) == 2
    assert "motors of run 1 = -9000000000.0: expected numbers from -10000" in capsys.readouterr().err
    tense = [step | {"tensions": [3.0, 3.0]} for step in steps]
    Path("tense.jsonl").write_text(header + "".join(json.dumps(step) + "\n" for step in tense))
    assert main(["replay", "tense.jsonl", *five_link]) == 0 and "tension: rms" in capsys.readouterr().out


def test_the_page_has_a_file_that_can_be_read_and_the_commands_that_there_are(rig):
    content = re.search(r"```yaml\n(.*?)```", PAGE, re.DOTALL)[1]
    Path("page.yaml").write_text(content)
    assert load_rig("page.yaml").guard.stop == 40.0 and set(yaml.safe_load(content)) <= set(KEYS)
    lines = re.findall(r'^\{"(?:format|t).*', PAGE, re.MULTILINE)
    Path("page.jsonl").write_text("\n".join(lines) + "\n")
    assert read_recording("page.jsonl").steps == 2
    for command in re.findall(r"^rj rig (\w+)", PAGE, re.MULTILINE):
        with pytest.raises(SystemExit) as ended:
            main([command, "--help"])
        assert ended.value.code == 0
