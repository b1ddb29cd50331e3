"""rj identify: what it prints and writes."""

import json
from pathlib import Path

import pytest
import yaml

from rj_gym.tracking.config import TrackingConfig
from tests.rollingjoint.command import rj

RUNS = str(Path(__file__).parents[3] / "examples" / "data" / "two_runs_calibrated.yaml")


@pytest.mark.slow
def test_it_writes_pictures_numbers_and_ranges(tmp_path, capsys):
    options = "--parameters base_angle:run,surface_turn --intervals linear --confidence 0.9"
    assert rj(f"identify {RUNS} {options} --output {tmp_path / 'found'}") == 0
    printed = capsys.readouterr().out
    assert "90 % interval" in printed and "base_angle in A" in printed
    written = {path.name: path for path in (tmp_path / "found").iterdir()}
    assert set(written) == {
        "identification.json", "poses.png", "profiles.png", "ranges.yaml", "residuals_position.png",
    }  # fmt: skip
    assert all(written[name].stat().st_size > 10_000 for name in written if name.endswith("png"))
    found = json.loads(written["identification.json"].read_text("utf-8"))
    assert set(found["parameters"]) == {"base_angle in A", "base_angle in B", "surface_turn"}
    ranges = yaml.safe_load(written["ranges.yaml"].read_text("utf-8"))
    assert ranges == found["ranges"]
    assert TrackingConfig(randomization=ranges["randomization"]).randomization.link_tolerance_rad > 0


def test_json_is_what_the_folder_has(capsys):
    command = (
        f"identify {RUNS} --parameters base_angle --given lengths --method least_squares --intervals linear --json"
    )
    assert rj(command) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["given"] == "lengths"
    assert found["errors"]["position"]["nominal"]["A"]["last"] == pytest.approx(1.65, abs=0.01)


@pytest.mark.parametrize(
    ("command", "message"),
    [
        ("identify nowhere.yaml", "nowhere.yaml"),
        (f"identify {RUNS} --parameters friction", "expected one of 'mu'"),
        (f"identify {RUNS} --confidence 1", "confidence = 1.0: expected a finite number from 0.5 to 0.999"),
        (f"identify {RUNS} --output {RUNS}", "a folder, not a file"),
    ],
)
def test_wrong_input_is_one_line(command, message, capsys):
    assert rj(command) == 2
    error = capsys.readouterr().err
    assert message in error and error.count("\n") == 1


def test_inputs_without_an_equilibrium_exit_with_3(tmp_path, capsys):
    file = tmp_path / "slack.yaml"
    file.write_text("mechanism: five_link\nruns: {A: [{tensions: [0, 0], tip: [0, 80]}]}\n", "utf-8")
    assert rj(f"identify {file} --parameters base_angle") == 3
    error = capsys.readouterr().err
    assert "no equilibrium at some steps" in error and error.count("\n") == 1
