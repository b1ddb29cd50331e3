"""Chains in space from the shell: commands of their page, loops, identification, and what is refused."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
import yaml

from rollingjoint import CapstanFriction, WorldForce, pitch_yaw, solve_tensions
from rollingjoint.io.mechanism_file import mechanism_to_dict
from rollingjoint.statics.loop import trace_loop
from tests.rollingjoint.command import rj

PAGE = (Path(__file__).parents[3] / "docs" / "spatial.md").read_text("utf-8")
COMMANDS = [line.removeprefix("rj ") for line in PAGE.splitlines() if line.startswith("rj ") and line != "rj view"]


@pytest.mark.parametrize("command", COMMANDS)
def test_commands_of_the_page_run(command: str, workplace: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert rj(command) == 0
    assert "error" not in "".join(capsys.readouterr())


def test_the_file_of_the_page_is_a_chain(workplace: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (text,) = re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL)
    Path("own.yaml").write_text(text, "utf-8")
    assert rj("check own.yaml") == 0
    assert "3 joints, 2 tendons" in capsys.readouterr().out


def test_a_loop_is_that_of_the_library(capsys: pytest.CaptureFixture[str]) -> None:
    command = "loop pitch_yaw --friction 0.1 --swing 1 0 -1 0 --steps 8 --cycles 1 --force -1 0 0.1 0 --json"
    assert rj(command) == 0
    (loop,) = json.loads(capsys.readouterr().out)["loops"]
    chain = pitch_yaw().replace(friction=CapstanFriction(0.1))
    expected = trace_loop(chain, (1, 0, -1, 0), loads=[WorldForce(-1, (0.0, 0.1, 0.0))], steps=8, cycles=1)
    assert loop["width_mm"] == expected.width
    assert loop["path"]["tip_mm"] == expected.path.tip.tolist()


def test_friction_and_rolling_resistance_are_identified_from_tips(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rng, chain = np.random.default_rng(0), pitch_yaw(6)
    rubbed, at, steps = chain.replace(friction=CapstanFriction(0.12, rolling=0.05)), None, []
    for pulls in rng.uniform(2.0, 5.0, (8, 4)):
        at = solve_tensions(rubbed, pulls, history=at)
        steps.append({"tensions": pulls.tolist(), "tip": at.tip.tolist()})
    content = {"mechanism": mechanism_to_dict(chain), "deviations": {"position": 0.1}, "runs": {"A": steps}}
    file = tmp_path / "measured.yaml"
    file.write_text(yaml.safe_dump(content), "utf-8")
    assert rj(f"identify {file} --parameters mu,rolling --intervals linear --json") == 0
    found = json.loads(capsys.readouterr().out)["parameters"]
    assert found["mu"]["value"] == pytest.approx(0.12, abs=1e-4)
    assert found["rolling"]["value"] == pytest.approx(0.05, abs=1e-4)
    assert rj(f"identify {file} --parameters surface_turn") == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "Only planar chains have it" in line


def test_files_for_the_workshop_are_stl_of_every_link(workplace: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert rj("export pitch_yaw --out files --channel 1 --tensions 3 2 2 2.5") == 0
    links = [f"files/link_{link}.stl" for link in range(13)]
    assert capsys.readouterr().out.splitlines() == [*links, "files/assembly.stl", "files/parts.csv"]
