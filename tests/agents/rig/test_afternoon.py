"""From a recording to a trained policy by commands alone; and open loop by the identified mechanism."""

import re
from pathlib import Path

import numpy as np
import pytest

from agents import evaluate, train
from rollingjoint import five_link, reach, solve_lengths, solve_tensions
from rollingjoint.cli import main as rj
from rollingjoint.identify import write_recording
from rollingjoint.identify.rig_files import load_identified
from rollingjoint.io.mechanism_file import load_mechanism
from tests.rollingjoint.identify.rigs import TRUE, recorded, with_stiffness

TARGETS = 200
CONFIG = Path("configs/train/apg_rolling_joint.yaml").resolve()


def open_loop_errors(chain, offsets, play):
    """Tip errors where motors pull to the lengths with which a model reaches targets, (TARGETS,) [mm]."""
    rng, true, nominal = np.random.default_rng(7), with_stiffness(five_link(), TRUE["stiffness"]), five_link()
    errors = []
    for _ in range(TARGETS):
        target = solve_tensions(nominal, rng.uniform(3.0, 9.0, 2)).tip[:2]
        model = reach(chain, target, tension_limits=(1.0, 12.0)).equilibrium
        motors = model.lengths - model.tensions / chain.stiffnesses - offsets - 0.5 * play
        arrived = solve_lengths(true, motors + 0.5 * np.array(TRUE["play"]) + TRUE["offsets"])  # at the pulled end
        errors.append(np.linalg.norm(arrived.tip[:2] - target))
    return np.array(errors)


@pytest.mark.slow
def test_a_recording_is_identified_trained_on_and_scored_without_a_number_written_by_hand(tmp_path, capsys):
    write_recording(recorded(480), tmp_path / "bench.jsonl")
    found, run = tmp_path / "found", tmp_path / "run"
    kinds = "play,sheath,stiffness,offsets"
    assert rj(["identify", str(tmp_path / "bench.jsonl"), "--parameters", kinds, "--output", str(found)]) == 0
    chain = load_mechanism(found / "mechanism.yaml")
    space, values = load_identified(found, five_link())
    before = open_loop_errors(five_link(), 0.0, 0.0)
    after = open_loop_errors(chain, space.value(values, "offsets"), space.value(values, "play"))
    assert before.mean() > 1.5 and after.mean() < 0.1

    words = [
        "--set",
        f"env.file={found / 'environment.yaml'}",
        "--set",
        "total_timesteps=64_000",
        "--run-dir",
        str(run),
    ]
    words += ["--set", "checkpoint_every=32_000", "--set", "evaluation.every=32_000", "--set", "evaluation.episodes=10"]
    assert train.main(["--config", str(CONFIG), *words]) == 0
    capsys.readouterr()
    assert evaluate.main([str(run), "--episodes", "20"]) == 0
    table = capsys.readouterr().out
    policy, idle = (
        float(re.search(rf"^{name} +([\d.]+) mm", table, re.MULTILINE)[1]) for name in ("policy", "do nothing")
    )
    assert policy < 0.2 < 5.0 < idle
