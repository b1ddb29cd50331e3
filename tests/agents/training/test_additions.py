"""Wrappers, callbacks and trackers of a configuration: made by their names, kept with the run, or refused."""

import csv
import re
import sys
import types
from pathlib import Path

import gymnasium
import numpy as np
import pytest
import yaml

from agents import evaluate, export, train
from agents.evaluation.report import evaluate_controllers
from agents.policies.trained import load_driving
from agents.runs.config import TrainConfig, load_config
from agents.runs.consent import Consent, allowing
from agents.runs.environment import EnvConfig, make_lanes
from agents.runs.folder import RunFolder
from rollingjoint.errors import ConfigError, RollingJointError
from tests.agents.training.test_train import TINY, tiny_train

PAGE = Path("docs/training.md").read_text("utf-8")
(MINE,) = (block for block in re.findall(r"```py\n(.*?)```", PAGE, re.DOTALL) if "class Scaled" in block)
(CONFIG,) = (block for block in re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL) if block.startswith("wrappers:"))
STOPS = """
from stable_baselines3.common.callbacks import BaseCallback


class Stop(BaseCallback):
    def __init__(self, after):
        super().__init__()
        self.after = after

    def _on_step(self):
        return self.num_timesteps < self.after
"""


@pytest.fixture
def mine(tmp_path, monkeypatch):
    """The module `mine` of the page, with a callback, in the working directory."""
    (tmp_path / "configs").symlink_to(Path("configs").resolve())
    (tmp_path / "mine.py").write_text(MINE + STOPS)
    monkeypatch.chdir(tmp_path)


def words(**keys):
    return [word for key, value in keys.items() for word in ("--set", f"{key}={yaml.safe_dump(value).strip()}")]


def rows_of(path):
    return list(csv.DictReader(path.read_text("utf-8").splitlines()))


def test_the_configuration_of_the_page_is_one(mine):
    values = yaml.safe_load(CONFIG)
    with pytest.raises(ConfigError, match="--import mine"):
        TrainConfig.from_dict(values)
    with allowing(Consent(modules=("mine",))):
        config = TrainConfig.from_dict(values)
        assert TrainConfig.from_dict(yaml.safe_load(yaml.safe_dump(config.to_dict()))) == config
    assert list(config.wrappers[0]["mine:Scaled"].items()) == [("scale", 0.5)]


@pytest.mark.slow
def test_a_policy_behind_an_observation_wrapper_is_evaluated_in_it_and_others_are_not(tmp_path, capsys):
    run = tmp_path / "run"
    assert tiny_train(run, *words(wrappers=["TimeAwareObservation"])) == 0
    assert "stepped in turn, for these wrappers" in capsys.readouterr().err
    policy = load_driving(RunFolder.open(run), in_wrappers=True)
    assert policy.network.entries == gymnasium.make("rj_gym/RollingJoint-v0").observation_space.shape[0] + 1
    assert evaluate.main([str(run), "--episodes", "3"]) == 0
    table = capsys.readouterr().out
    assert "jacobian feedback" in table and "policy" in table and "floor" in table
    with pytest.raises(RollingJointError, match="observation"):
        policy.wrappers = ()
        evaluate_controllers(RunFolder.open(run).config().env, {"policy": policy}, range(3))


def test_a_run_behind_wrappers_is_not_exported_nor_compared(tmp_path, capsys):
    run = tmp_path / "run"
    assert tiny_train(run, *words(wrappers=["TimeAwareObservation"])) == 0
    assert export.main([str(run), "--name", "late", "--out", str(tmp_path / "p.safetensors")]) == 2
    assert "wrappers = ['TimeAwareObservation']: expected []" in capsys.readouterr().err
    with pytest.raises(RollingJointError, match="TimeAwareObservation"):
        load_driving(RunFolder.open(run))


@pytest.mark.slow
def test_a_vector_wrapper_keeps_the_native_lanes_and_its_reward_is_that_of_training_alone(mine, tmp_path):
    runs = [tmp_path / "plain", tmp_path / "scaled"]
    more = "--import", "mine"
    assert tiny_train(runs[0]) == 0
    assert tiny_train(runs[1], *more, *words(wrappers=[{"mine:Scaled": {"scale": 0.5}}])) == 0
    rewards, returns = [], []
    for run in runs:
        returns.append(float(rows_of(run / "logs/progress.csv")[0]["rollout/ep_rew_mean"]))
        rewards.append(float(rows_of(run / "evaluations.csv")[0]["mean_reward"]))
    assert returns[1] == pytest.approx(0.5 * returns[0], rel=1e-3)
    assert rewards[1] == pytest.approx(rewards[0], rel=0.2)
    assert evaluate.main([str(runs[1]), "--episodes", "2", *more]) == 0
    assert evaluate.main([str(runs[1]), "--episodes", "2"]) == 2


def test_lanes_in_a_vector_wrapper_are_those_of_rj_gym_with_its_reward(mine):
    with allowing(Consent(modules=("mine",))):
        plain, scaled = (make_lanes(EnvConfig(), 3, wrappers) for wrappers in ((), ({"mine:Scaled": {"scale": 0.5}},)))
    for lanes in (plain, scaled):
        lanes.seed(0)
        lanes.reset()
    actions = np.full((3, 2), 0.3, np.float32)
    for _ in range(60):  # over the end of the episodes
        (seen, rewards, dones, _), (seen_too, half, dones_too, _) = plain.step(actions), scaled.step(actions)
        np.testing.assert_array_equal(seen, seen_too)
        np.testing.assert_array_equal(dones, dones_too)
        np.testing.assert_allclose(half, 0.5 * rewards, rtol=1e-6)
    assert type(scaled).__name__ == "SB3VecEnv"


@pytest.mark.parametrize("config", ["demo", "apg_rolling_joint"])
def test_a_callback_ends_the_training_of_every_learner(config, mine, tmp_path, capsys):
    tiny = TINY if config == "demo" else ["env.n_envs=4", "env.settings.episode_steps=5", "evaluation.episodes=2",
                                          "total_timesteps=200", "policy.hidden=[4]"]  # fmt: skip
    callbacks = words(callbacks=[{"mine:Stop": {"after": 30}}])
    assert tiny_train(tmp_path / "run", "--import", "mine", *callbacks, config=config, tiny=tiny) == 0
    rows = rows_of(tmp_path / "run/evaluations.csv")
    assert [30 <= int(row["steps"]) < 50 for row in rows] == [True]
    assert "The run is in" in capsys.readouterr().out


class Filmed(gymnasium.wrappers.RecordVideo):
    """RecordVideo that remembers in place of moviepy."""

    made: list[str] = []  # noqa: RUF012

    def stop_recording(self):
        if self.recorded_frames:
            Filmed.made.append(self._video_name)
        self.recording, self.recorded_frames = False, []


def test_one_of_the_environments_is_filmed(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("moviepy", "moviepy.video", "moviepy.video.io", "moviepy.video.io.ImageSequenceClip"):
        monkeypatch.setitem(sys.modules, name, types.ModuleType(name))
    sys.modules["moviepy.video.io.ImageSequenceClip"].ImageSequenceClip = None
    monkeypatch.delitem(sys.modules, "gymnasium.utils.save_video", raising=False)
    monkeypatch.setattr("gymnasium.wrappers.RecordVideo", Filmed)
    Filmed.made.clear()
    lanes = make_lanes(EnvConfig(settings={"episode_steps": 3}), 2, ({"RecordVideo": {"video_folder": "videos"}},))
    lanes.reset()
    for _ in range(7):
        lanes.step(np.zeros((2, 2), np.float32))
    assert Filmed.made == ["rl-video-episode-0", "rl-video-episode-1"]


def test_one_of_the_environments_is_shown(monkeypatch):
    pygame = pytest.importorskip("pygame")
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    lanes = make_lanes(EnvConfig(settings={"episode_steps": 3}), 3, ({"HumanRendering": {}},))
    lanes.reset()
    assert [env.get_wrapper_attr("render_mode") for env in lanes.envs] == ["human"] * 3
    assert pygame.display.get_init()
    lanes.close()


class Follower:
    """What wandb.init returns, and what it was told."""

    told: list[dict] = []  # noqa: RUF012
    ends = 0

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        Follower.ends += 1


@pytest.fixture
def wandb(monkeypatch):
    """A module wandb that keeps what it is told."""
    module = types.ModuleType("wandb")
    Follower.told, Follower.ends = [], 0
    module.init = lambda **given: Follower.told.append(given) or Follower()
    monkeypatch.setitem(sys.modules, "wandb", module)
    return module


def test_a_tracker_follows_the_events_and_a_resumed_run_goes_on_there(wandb, tmp_path):
    run = tmp_path / "run"
    assert tiny_train(run, *words(tracker={"wandb": {"project": "mine"}})) == 0
    assert train.main(["--resume", str(run), "--set", "total_timesteps=120"]) == 0
    first, second = Follower.told
    assert first["sync_tensorboard"] and (first["project"], first["name"]) == ("mine", "run")
    assert first["config"]["total_timesteps"] == 80 and second["config"]["total_timesteps"] == 120
    assert first["id"] == second["id"] and second["resume"] == "allow" and Follower.ends == 2
    assert first["dir"] == str(run)


def test_a_tracker_that_does_not_begin_is_one_line(wandb, tmp_path, capsys):
    def fails(**given):
        raise ValueError("No API key configured.")

    wandb.init = fails
    assert tiny_train(tmp_path / "run", *words(tracker="wandb")) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "No API key configured." in line and "mode: offline" in line and "--resume" in line


@pytest.mark.parametrize(
    ("hidden", "keys", "extra"),
    [
        ("wandb", {"tracker": "wandb"}, "track"),
        ("moviepy", {"wrappers": [{"RecordVideo": {"video_folder": "videos"}}]}, "video"),
    ],
)
def test_a_missing_package_is_named_with_its_extra_before_anything_is_written(
    hidden, keys, extra, tmp_path, monkeypatch, capsys
):
    monkeypatch.setitem(sys.modules, hidden, None)
    assert tiny_train(tmp_path / "run", *words(**keys)) == 2
    assert f'run pip install "rollingjoint[{extra}]"' in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


SCALAR, NATIVE = "TimeAwareObservation", {"vector.ClipReward": {"min_reward": -1.0}}


@pytest.mark.parametrize(
    ("config", "keys", "said"),
    [
        ("demo", {"wrappers": SCALAR}, ["wrappers = 'TimeAwareObservation'", "a list of at most 32"]),
        ("demo", {"wrappers": [[1]]}, ["NAME: {argument: value}"]),
        ("demo", {"wrappers": [{SCALAR: 3}]}, ["NAME: {argument: value}"]),
        ("demo", {"wrappers": ["TimeAware"]}, ["Did you mean 'TimeAwareObservation'?"]),
        ("demo", {"wrappers": ["stranger:Wrapper"]}, ["--import stranger"]),
        ("demo", {"wrappers": [":Wrapper"]}, ["MODULE:CLASS"]),
        ("demo", {"wrappers": ["gymnasium:make"]}, ["a subclass of Wrapper or VectorWrapper"]),
        ("demo", {"wrappers": [{SCALAR: {"speed": 2}}]}, ["speed", "arguments that TimeAwareObservation takes"]),
        ("demo", {"wrappers": [SCALAR, NATIVE]}, ["all of scalar environments, or all of vector"]),
        ("demo", {"wrappers": ["NormalizeObservation"]}, ["normalise.observation"]),
        ("demo", {"wrappers": [NATIVE], "policy.form": "gain"}, ["[] with policy.form: gain"]),
        ("demo", {"wrappers": [{"RecordVideo": {"video_folder": "../up"}}]}, ["'../up'", "below the working"]),
        ("demo", {"wrappers": [{"vector.RescaleObservation": {"min_obs": 0, "max_obs": 1}}]}, ["NEXT_STEP"]),
        ("apg_rolling_joint", {"wrappers": [NATIVE]}, ["[] with algorithm: apg"]),
        ("her_fixed_target", {"wrappers": [SCALAR]}, ["[] with her"]),
        ("demo", {"callbacks": ["EvalCallback"]}, ["eval_env"]),
        ("demo", {"callbacks": [{"CheckpointCallback": {"save_freq": 1, "save_path": "/tmp"}}]}, ["below the working"]),
        ("demo", {"callbacks": ["gymnasium:Wrapper"]}, ["a subclass of BaseCallback"]),
        ("demo", {"tracker": "mlflow"}, ["tracker = 'mlflow'", "null or wandb"]),
        ("demo", {"tracker": {"wandb": {"projekt": "a"}}}, ["Did you mean 'project'?"]),
    ],
)
def test_what_cannot_be_had_is_one_line_and_no_folder(config, keys, said, tmp_path, capsys):
    run = tmp_path / "run"
    assert train.main([config, "--run-dir", str(run), *words(**keys)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert [text for text in said if text not in line] == []
    assert not run.exists()


def test_the_ready_made_configurations_have_none():
    for path in Path("configs/train").glob("*.yaml"):
        assert load_config(path).wrappers == ()
