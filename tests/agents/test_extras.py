"""Without the packages of an extra: one line that names it, from every package and every command."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

HIDE = """
import importlib.abc, runpy, sys

class Hide(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in PACKAGES:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

PACKAGES = sys.argv[1].split(",")
sys.meta_path.insert(0, Hide())
sys.argv = sys.argv[2:]
runpy.run_module(sys.argv[0], run_name="__main__")
"""
TRAIN = "torch,stable_baselines3,sb3_contrib,optuna,tensorboard,tqdm,filelock"

CASES = [
    (TRAIN, ["rollingjoint.differentiable"], "design"),
    (TRAIN, ["rollingjoint.design"], "design"),
    (TRAIN, ["rj_gym.design.task"], "design"),
    (TRAIN, ["rj_gym.sb3"], "train"),
    (TRAIN, ["agents.train", "--config", "configs/train/ppo_rolling_joint.yaml", "--run-dir", "{}"], "train"),
    (TRAIN, ["agents.search", "configs/search/demo.yaml", "--out", "{}"], "search"),
    (TRAIN, ["agents.view", "--port", "0", "--search", "{}"], "search"),
    ("filelock", ["agents.search", "configs/search/demo.yaml", "--out", "{}"], "search"),
    ("onnx", ["agents.export", "noisy", "--onnx", "{}"], "onnx"),
    ("h5py", ["agents.dataset", "noisy", "--steps", "5", "--out", "{}"], "data"),
    ("matplotlib,PIL", ["agents.evaluate", "{}"], "plot"),
    pytest.param(
        "tensorboard",
        ["agents.train", "--config", "configs/train/demo.yaml", "--run-dir", "{}"],
        "train",
        marks=pytest.mark.slow,  # imports torch and all that follows first
    ),
]


@pytest.mark.slow
@pytest.mark.parametrize("hidden, arguments, extra", CASES, ids=lambda value: str(value)[:40])
def test_a_missing_package_is_one_line_with_its_extra(hidden, arguments, extra, tmp_path):
    command = [each.format(tmp_path / "run") for each in arguments]
    run = [sys.executable, "-c", HIDE, hidden, *command]
    done = subprocess.run(run, cwd=ROOT, capture_output=True, text=True, timeout=60)
    line = done.stderr.strip().splitlines()[-1]
    assert line.endswith(f'is not installed: run pip install "rollingjoint[{extra}]"')
    if command[0].startswith("agents."):
        assert done.returncode == 2 and line.startswith("error: ") and "Traceback" not in done.stderr
        assert not (tmp_path / "run").exists()


@pytest.mark.slow
def test_the_viewer_opens_without_the_room_of_designs_where_their_packages_are_missing():
    hide, _, _ = HIDE.partition("sys.argv = sys.argv[2:]")
    program = f"{hide}from agents.view import rooms\nprint(*rooms())"
    done = subprocess.run([sys.executable, "-c", program, TRAIN], cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert done.stdout == "Explore Control Replay\n", done.stderr
