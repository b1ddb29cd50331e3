import csv
import json
import os
import signal
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from PIL import Image

from agents import evaluate, train
from agents.evaluation.rollout import run_episodes
from agents.policies.trained import load_trained
from agents.runs.folder import RunFolder
from agents.training.callbacks import StopOnSignal

TINY = [
    "env.n_envs=2", "env.settings.episode_steps=10", "total_timesteps=80", "parameters.n_steps=20",
    "parameters.batch_size=20", "parameters.n_epochs=2", "policy.hidden=[8]", "evaluation.every=40",
    "evaluation.episodes=2", "checkpoint_every=40",
]  # fmt: skip
TINY_SAC = [
    "env.n_envs=2", "env.settings.episode_steps=10", "total_timesteps=60", "parameters.learning_starts=20",
    "parameters.batch_size=16", "parameters.buffer_size=1000", "policy.hidden=[8]", "evaluation.every=40",
    "evaluation.episodes=2", "checkpoint_every=40",
]  # fmt: skip


def tiny_train(path: Path, *extra: str, config: str = "demo", tiny: list[str] = TINY) -> int:
    overrides = [word for override in tiny for word in ("--set", override)]
    return train.main(["--config", f"configs/train/{config}.yaml", "--run-dir", str(path), *overrides, *extra])


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("runs") / "tiny"
    assert tiny_train(path) == 0
    assert evaluate.main([str(path), "--episodes", "4"]) == 0
    return path


@pytest.mark.slow
def test_a_run_folder_holds_policy_normaliser_checkpoints_and_logs(run):
    files = {str(path.relative_to(run)) for path in run.rglob("*") if path.is_file()}
    assert files >= {
        "config.yaml", "command.txt", "versions.json", "seeds.json",
        "checkpoints/000000080/resume/training.safetensors", "evaluations.csv", "logs/progress.csv",
    }  # fmt: skip
    for folder in ("", "best/", "checkpoints/000000040/", "checkpoints/000000080/"):
        assert files >= {f"{folder}{name}" for name in ("policy.safetensors", "policy.zip", "normaliser.pkl")}
    assert list((run / "logs").glob("events.out.tfevents*"))
    assert not [name for name in files if Path(name).name.startswith(".")]


def test_training_logs_the_tip_error(run):
    evaluations = list(csv.DictReader((run / "evaluations.csv").read_text().splitlines()))
    assert [int(row["steps"]) for row in evaluations] == [40, 80]
    assert all(0 < float(row["median_mm"]) < 200 for row in evaluations)
    assert all(0 < float(row["last_10_mm"]) != float(row["mean_mm"]) for row in evaluations)
    assert "rollout/final_error_mm" in (run / "logs" / "progress.csv").read_text()


def test_an_evaluation_writes_its_report_and_pictures(run):
    folder = run / "evaluation"
    report = json.loads((folder / "report.json").read_text())
    assert set(report["scores"]) >= {"policy", "open loop", "do nothing"}
    assert report["seeds"] == [10000, 10001, 10002, 10003]
    assert report["scores"]["policy"]["mean_mm"] == pytest.approx(np.mean(report["final_errors_mm"]["policy"]))
    text = (folder / "report.md").read_text()
    assert "A point is the floor of its own step." in text
    for name in ("error_over_time.png", "error_distribution.png", "animation.gif"):
        assert name in text
        with Image.open(folder / name) as image:
            assert image.width > 400
            assert getattr(image, "n_frames", 1) == (11 if name == "animation.gif" else 1)


def test_the_same_seeds_give_the_same_evaluation(run, tmp_path, no_pictures):
    assert evaluate.main([str(run), "--episodes", "4", "--out", str(tmp_path)]) == 0
    first, second = (json.loads((folder / "report.json").read_text()) for folder in (run / "evaluation", tmp_path))
    assert first["final_errors_mm"] == second["final_errors_mm"]


def test_the_policy_acts_without_chance(run):
    folder = RunFolder.open(run)
    policy = load_trained(folder)
    first, second = (run_episodes(folder.config().env, policy, [3, 4]).errors for _ in range(2))
    np.testing.assert_array_equal(first, second)


def test_a_run_repeated_from_its_own_config_gives_the_same_policy(run, tmp_path, capsys):
    assert train.main(["--config", str(run / "config.yaml"), "--run-dir", str(tmp_path / "again")]) == 0
    assert "rj evaluate" in capsys.readouterr().out
    assert (run / "evaluations.csv").read_text() == (tmp_path / "again" / "evaluations.csv").read_text()


def test_an_evaluation_needs_nothing_but_the_run_folder_and_takes_other_settings(run, tmp_path, no_pictures):
    moved = tmp_path / "elsewhere"
    os.symlink(run, moved)
    out = tmp_path / "unloaded"
    settings = ["--set", "env.settings.load.magnitude=[0, 0]", "--set", "env.settings.episode_steps=40"]
    assert evaluate.main([str(moved), "--episodes", "2", "--policy", "last", "--out", str(out), *settings]) == 0
    report = json.loads((out / "report.json").read_text())
    assert report["scores"]["open loop"]["p95_mm"] < 0.5
    assert "magnitude" in report["about"]["changed settings"]


def test_the_policy_of_another_run_drives_the_same_episodes(run, tmp_path, no_pictures):
    other = tmp_path / "other"
    os.symlink(run, other)
    assert evaluate.main([str(run), "--episodes", "2", "--beside", str(other), "--out", str(tmp_path / "out")]) == 0
    errors = json.loads((tmp_path / "out" / "report.json").read_text())["final_errors_mm"]
    assert list(errors)[:2] == ["policy", "other"] and errors["other"] == errors["policy"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--beside", "nowhere"], "error: --beside: run folder = 'nowhere'"),
        (["--policy", "000000033"], "000000033/policy.safetensors"),
        (["--episodes", "0"], "--episodes"),
        (["--seed", "1"], "seeds that training has not used"),
        (["--set", "env.settings.lod=1"], "'load'"),
        (["--controller", "agents.controllers:Nobody"], "Nobody"),
        (["--controller", "nowhere"], "module:Class"),
    ],
)
def test_a_wrong_evaluation_ends_with_one_line(run, arguments, words, capsys):
    assert evaluate.main([str(run), *arguments]) == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1


def test_evaluating_a_folder_without_a_run_ends_with_one_line(tmp_path, capsys):
    assert evaluate.main([str(tmp_path)]) == 2
    assert "config.yaml" in capsys.readouterr().err


def test_training_into_an_existing_run_is_refused_in_one_line(run, capsys):
    before = (run / "policy.zip").read_bytes()
    assert tiny_train(run) == 2
    error = capsys.readouterr().err
    assert "--force" in error
    assert error.count("\n") == 1
    assert (run / "policy.zip").read_bytes() == before


@pytest.mark.slow
def test_sac_trains_and_evaluates_on_the_goal_environment(tmp_path):
    goal = ["--set", "env.id=rj_gym/RollingJointGoal-v0"]
    assert tiny_train(tmp_path / "sac", *goal, config="sac_rolling_joint", tiny=TINY_SAC) == 0
    assert evaluate.main([str(tmp_path / "sac"), "--episodes", "2"]) == 0


class Interrupting(gymnasium.Env):
    """Sends a signal to its own process after some steps, or raises an error. Its episodes do not pickle."""

    observation_space = gymnasium.spaces.Box(-1.0, 1.0, (1,))
    action_space = gymnasium.spaces.Box(-1.0, 1.0, (1,))

    def __init__(self, number: int):
        self.number, self.steps = number, 0
        self.unpicklable = (step for step in range(3))

    def reset(self, seed=None, options=None):
        super().reset(seed=seed)
        return np.zeros(1, np.float32), {"error_mm": 1.0}

    def step(self, action):
        self.steps += 1
        if self.steps == 25:
            if self.number == 0:
                raise FloatingPointError("broken")
            signal.raise_signal(self.number)
        return np.zeros(1, np.float32), 0.0, False, self.steps % 10 == 0, {"error_mm": 1.0}


@pytest.fixture
def interrupting():
    gymnasium.register("test/Interrupting-v0", Interrupting)
    yield ["--set", "env.id=test/Interrupting-v0", "--set", "env.n_envs=1", "--set", "env.file=null", "--set"]
    gymnasium.registry.pop("test/Interrupting-v0")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_training_in_good_order_and_saves_the_policy(number, interrupting, tmp_path, capsys):
    path = tmp_path / "run"
    handler = signal.getsignal(number)
    assert tiny_train(path, *interrupting, f"env.settings={{number: {number}}}") == 128 + number
    printed = capsys.readouterr().out
    assert f"stopped by {number.name} after 41 steps" in printed  # two rollouts of 20, and the step that asks
    assert (path / "policy.zip").is_file()
    assert signal.getsignal(number) is handler


def test_episodes_of_foreign_environments_begin_anew_where_a_run_is_resumed(interrupting, tmp_path, capsys):
    path = tmp_path / "run"
    assert tiny_train(path, *interrupting, "env.settings={number: 15}") == 128 + signal.SIGTERM
    capsys.readouterr()
    assert train.main(["--resume", str(path)]) == 128 + signal.SIGTERM  # 25 steps later
    printed = capsys.readouterr()
    assert printed.err == "note: episodes of test/Interrupting-v0 begin anew, since only those of rj_gym are saved\n"
    assert "from step 40 on" in printed.out and "stopped by SIGTERM after 80 steps" in printed.out


def test_a_second_signal_interrupts_at_once():
    with StopOnSignal() as stop:
        signal.raise_signal(signal.SIGINT)
        assert stop.signal == signal.SIGINT
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)


def test_an_environment_without_a_tip_error_is_refused_before_training(tmp_path, capsys):
    own = ["--set", "env.id=Pendulum-v1", "--set", "env.file=null", "--set", "env.settings={}"]
    assert tiny_train(tmp_path / "run", *own) == 2
    assert "error_mm" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


def test_training_that_breaks_off_says_so_in_one_line_and_keeps_the_traceback(interrupting, tmp_path, capsys):
    path = tmp_path / "run"
    assert tiny_train(path, *interrupting, "env.settings={number: 0}") == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "after 24 steps" in error
    assert "Traceback" in (path / "error.txt").read_text()
