"""Datasets: Minari reads episodes as they were, none leads into the next, and a dataset is whole or not there."""

import json
from dataclasses import replace
from pathlib import Path

import minari
import numpy as np
import pytest

from agents import dataset
from agents.controllers import DoNothing, JacobianFeedback
from agents.evaluation import minari_dataset, recording
from agents.evaluation.minari_dataset import read_dataset, write_dataset
from agents.evaluation.recording import record_episodes
from agents.runs.environment import EnvConfig, make_env, make_vector_env
from agents.runs.files import RunFolderError
from agents.runs.seeds import DATA, TEST
from rollingjoint.chain.presets import preset
from rollingjoint.errors import ConfigError

SETTINGS = {"episode_steps": 8, "load": {"magnitude": [0.0, 1.0]}}
ENV = EnvConfig(settings=SETTINGS)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write_dataset(
        ENV, JacobianFeedback(), 30, tmp_path_factory.mktemp("data") / "small", infos=["error_mm", "tip"]
    )


def test_minari_reads_the_episodes_of_the_scalar_environment(folder):
    data, env = minari.MinariDataset(folder / "data"), make_env(ENV)
    assert (data.total_episodes, data.total_steps, data.spec.dataset_id) == (4, 32, "small-v0")
    for episode, known in zip(data, data.storage.get_episode_metadata(range(4)), strict=True):
        assert known["seed"] == DATA.start + episode.id
        observation, info = env.reset(seed=known["seed"])
        for t, action in enumerate(episode.actions):
            assert observation == pytest.approx(episode.observations[t], abs=1e-6)
            assert info["error_mm"] == pytest.approx(episode.infos["error_mm"][t], abs=1e-6)
            observation, reward, terminated, truncated, info = env.step(action)
            assert reward == pytest.approx(episode.rewards[t], abs=1e-6)
            assert (terminated, truncated) == (episode.terminations[t], episode.truncations[t])
        assert observation == pytest.approx(episode.observations[-1], abs=1e-6) and truncated
        assert info["tip"] == pytest.approx(episode.infos["tip"][-1], abs=1e-6)


def test_arrays_are_the_steps_of_all_episodes(folder):
    steps, data = read_dataset(folder), minari.MinariDataset(folder / "data")
    assert len(steps) == 32 and steps.lengths.tolist() == [8] * 4 and steps.episode[[7, 8]].tolist() == [0, 1]
    assert steps.seeds.tolist() == list(range(DATA.start, DATA.start + 4))
    within = np.flatnonzero(np.diff(steps.episode) == 0)
    assert np.array_equal(steps.next_observations[within], steps.observations[within + 1])
    last = data[2]
    assert np.array_equal(steps.next_observations[23], last.observations[-1])
    assert np.array_equal(steps.infos["error_mm"][16:24], last.infos["error_mm"][1:])
    assert steps.observations.dtype == steps.actions.dtype == np.float32


def test_minari_recovers_the_environment(folder):
    env = minari.MinariDataset(folder / "data").recover_environment().unwrapped
    assert (env.config.episode_steps, env.config.load.magnitude) == (8, (0.0, 1.0))
    assert env.task.mechanism.name == "five_link"


def test_mechanism_that_has_no_name_is_kept_as_numbers(tmp_path):
    env = EnvConfig(settings=SETTINGS | {"mechanism": replace(preset("two_segment"), name="own")})
    data = minari.MinariDataset(write_dataset(env, DoNothing(), 8, tmp_path / "own") / "data")
    assert data.env_spec is None
    kept = data.storage.metadata["rollingjoint_environment"]
    assert kept["id"] == env.id and kept["settings"] == json.loads(json.dumps(env.complete_settings()))


class EndsEarly:
    """A vector environment in which lane k ends after k + 1 steps, and counts on afterwards."""

    def __init__(self, envs):
        self.envs, self.steps = envs, 0

    def __getattr__(self, name):
        return getattr(self.envs, name)

    def step(self, actions):
        observation, reward, terminated, truncated, info = self.envs.step(actions)
        self.steps += 1
        terminated[:] = np.arange(len(terminated)) + 1 == self.steps
        info["error_mm"] = np.full(len(terminated), float(self.steps))
        return observation, reward, terminated, truncated, info


def test_nothing_is_kept_after_the_end_of_an_episode(tmp_path, monkeypatch):
    monkeypatch.setattr(recording, "make_vector_env", lambda *given: EndsEarly(make_vector_env(*given)))
    episodes = record_episodes(ENV, DoNothing(), range(3))
    assert [episode.length for episode in episodes] == [1, 2, 3]
    assert [len(episode.observations) for episode in episodes] == [2, 3, 4]
    assert [episode.infos["error_mm"][1:].tolist() for episode in episodes] == [[1], [1, 2], [1, 2, 3]]
    assert [episode.terminations.tolist() for episode in episodes] == [[True], [False, True], [False, False, True]]
    steps = read_dataset(write_dataset(ENV, DoNothing(), 24, tmp_path / "early"))
    assert len(steps) >= 24 and steps.lengths[:3].tolist() == [1, 2, 3]  # more episodes, as these were short
    assert steps.terminations.sum() == len(steps.lengths) and np.array_equal(
        np.flatnonzero(steps.terminations), np.cumsum(steps.lengths) - 1
    )


def test_same_arguments_write_the_same_episodes_in_blocks_of_any_size(folder, tmp_path, monkeypatch):
    monkeypatch.setattr(minari_dataset, "LANES", 3)
    again = read_dataset(write_dataset(ENV, JacobianFeedback(), 30, tmp_path / "again"))
    other = read_dataset(write_dataset(ENV, JacobianFeedback(), 8, tmp_path / "other", seed=DATA.start + 1))
    first = read_dataset(folder)
    assert np.abs(again.observations - first.observations).max() < 1e-6
    assert np.abs(other.observations - first.observations[8:16]).max() < 1e-6
    assert np.abs(other.observations - first.observations[:8]).max() > 1e-3


class Wild(DoNothing):
    def act(self, seen):
        return 3.0 + super().act(seen)


def test_actions_are_those_that_the_environment_took(tmp_path):
    assert read_dataset(write_dataset(ENV, Wild(), 8, tmp_path / "wild")).actions.tolist() == [[1.0, 1.0]] * 8


def test_interrupted_dataset_leaves_nothing(tmp_path):
    def interrupt(steps):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_dataset(ENV, DoNothing(), 8, tmp_path / "data", progress=interrupt)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"steps": 0}, "steps = 0"),
        ({"seed": -1}, "seed = -1"),
        ({"seed": TEST.stop - 1}, "controllers are compared in these episodes"),
        ({"seed": TEST.start - 1, "steps": 9}, "controllers are compared in these episodes"),
        ({"infos": ["tips"]}, "info = 'tips': expected one of command, error_mm"),
        ({"env": EnvConfig("rj_gym/CurvatureDesign-v0")}, "a tracking environment of rj_gym"),
    ],
)
def test_what_cannot_be_written_is_a_clear_error_and_leaves_nothing(changes, message, tmp_path):
    given = {"env": ENV, "controller": DoNothing(), "steps": 8, "where": tmp_path / "data"} | changes
    with pytest.raises(ConfigError, match=message):
        write_dataset(**given)
    assert list(tmp_path.iterdir()) == []


def test_dataset_that_is_there_is_kept(folder):
    with pytest.raises(RunFolderError, match="expected a new folder or id"):
        write_dataset(ENV, DoNothing(), 8, folder)
    assert len(read_dataset(folder)) == 32


def test_what_is_no_dataset_is_a_clear_error(tmp_path):
    with pytest.raises(RunFolderError, match="a Minari dataset"):
        read_dataset(tmp_path)


CONTROLLERS = {
    "late_pose": "rj_gym/LatePose-v1",  # with memory, and in its own environment
    "agents/policies/noisy.safetensors": "rj_gym/RollingJoint-v0",
    "load estimate": "rj_gym/RollingJoint-v0",
    "agents.controllers.privileged_feedback:PrivilegedFeedback": "rj_gym/RollingJoint-v0",
}


@pytest.mark.parametrize(("controller", "env_id"), CONTROLLERS.items())
def test_command_writes_what_minari_loads_by_its_id(controller, env_id, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    arguments = [controller, "--steps", "12", "--set", "episode_steps=6", "--out", "joint/own-v3", "--info", "tensions"]
    assert dataset.main(arguments) == 0
    assert f"12 steps of {env_id}" in capsys.readouterr().out
    data = minari.load_dataset("joint/own-v3")
    assert data.env_spec.id == env_id and data.total_steps == 12
    assert set(data[0].infos) == {"error_mm", "tensions"}
    assert data.storage.metadata["algorithm_name"] == controller
    steps = dataset.read_dataset("joint/own-v3")
    seen = steps.observations
    assert (set(seen) == {"observation", "privileged"}) if "privileged" in controller else len(seen) == 12


def test_command_without_such_a_controller_says_what_there_is(tmp_path, capsys):
    assert dataset.main(["lod estimate", "--steps", "5", "--out", str(tmp_path / "x")]) == 2
    assert "Did you mean 'load estimate'?" in capsys.readouterr().err
    assert list(Path(tmp_path).iterdir()) == []
