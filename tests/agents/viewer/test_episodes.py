"""Episodes to look at: of run folders, of policies, recorded ones."""

import json

import numpy as np
import pytest

from agents.controllers import Controller, JacobianFeedback
from agents.policies.loading import load_policy
from agents.policies.trained import TrainedPolicy
from agents.runs.config import TrainConfig
from agents.runs.environment import EnvConfig
from agents.runs.files import RunFolderError, write_hashed_bytes
from agents.runs.folder import RunFolder
from agents.viewer.controllers import OfferedController
from agents.viewer.drive import Repeated, filmed
from agents.viewer.episodes import DrivenEpisodes, recorded_episodes, run_episodes_of
from agents.viewer.recorded import file_of, read_records, records_in, write_records
from rollingjoint.errors import ConfigError, InvalidInput

SHORT = EnvConfig(settings={"episode_steps": 6})
VARIED = EnvConfig("rj_gym/Instrument-v0", settings={"episode_steps": 5, "mechanism": "two_segment"})


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run folder with a shipped policy in place of a trained one."""
    folder = tmp_path_factory.mktemp("runs") / "mine"
    made = RunFolder.create(folder, TrainConfig(env=SHORT), ["python"])
    policy = TrainedPolicy(load_policy("fixed_target").network, "ppo", 0)
    (folder / "best").mkdir()
    write_hashed_bytes(folder / "best" / "policy.safetensors", policy.to_bytes())
    return made.path


def test_best_median_and_worst_are_ranked_by_the_error_of_the_last_steps():
    episodes = DrivenEpisodes(OfferedController("feedback", SHORT, JacobianFeedback), range(20, 27))
    ranked = episodes.ranked()
    errors = {seed: episodes.film(seed).last_10_mm for seed in range(20, 27)}
    ordered = sorted(errors, key=errors.get)
    assert list(ranked.values()) == [ordered[0], ordered[3], ordered[-1]]
    assert episodes.error(ranked["worst"]) == pytest.approx(max(errors.values()), abs=1e-6)
    with pytest.raises(InvalidInput, match="seed"):
        episodes.film(4)


def test_a_run_folder_shows_its_policy_in_its_environment(run):
    episodes = run_episodes_of(run, seeds=range(10_000, 10_003))
    assert episodes.name == "mine" and episodes.env.settings["episode_steps"] == 6
    assert episodes.film(10_001).steps == 6
    assert {"jacobian feedback", "open loop"} <= set(episodes.beside())


def test_what_is_no_run_or_was_trained_on_is_refused(run, tmp_path):
    with pytest.raises(RunFolderError, match="run folder"):
        run_episodes_of(tmp_path)
    with pytest.raises(ConfigError, match="training has not used"):
        run_episodes_of(run, seeds=range(0, 3))


def test_recorded_episodes_are_the_same_when_they_are_read_back(tmp_path):
    films = [filmed("feedback", SHORT, JacobianFeedback(), seed) for seed in (3, 4)]
    films.append(filmed("still", VARIED, Still(), 9))
    write_records(tmp_path / "some.json", films)
    feedback, still = recorded_episodes(tmp_path / "some.json")
    assert (feedback.name, list(feedback.seeds), still.name, list(still.seeds)) == ("feedback", [3, 4], "still", [9])
    for film, again in zip(films, [feedback.film(3), feedback.film(4), still.film(9)], strict=True):
        np.testing.assert_allclose(again.errors, film.errors, atol=1e-9)
        np.testing.assert_allclose(again.scenes[-1].poses, film.scenes[-1].poses, atol=1e-9)
    assert read_records(tmp_path / "some.json")[0].error_mm == pytest.approx(films[0].last_10_mm)


class Still(Controller):
    """Does nothing."""

    def reset(self, mask):
        self.shape = len(mask), self.task.action_size

    def act(self, observations):
        return np.zeros(self.shape)


def test_actions_for_other_tendons_are_refused():
    with pytest.raises(InvalidInput, match="numbers per action"):
        filmed("", SHORT, Repeated(np.zeros((3, 8))), 0)


def test_a_dataset_of_agents_dataset_is_read(tmp_path):
    minari = pytest.importorskip("minari", reason="the extra data is not installed")  # noqa: F841
    from agents.dataset import write_dataset

    write_dataset(SHORT, JacobianFeedback(), 12, tmp_path / "feedback", about={"algorithm_name": "mine"})
    (episodes,) = recorded_episodes(tmp_path / "feedback")
    again = filmed("", SHORT, JacobianFeedback(), episodes.seeds[1])
    assert episodes.name == "mine" and len(episodes.seeds) == 2
    np.testing.assert_allclose(episodes.film(episodes.seeds[1]).errors, again.errors, atol=1e-9)


@pytest.fixture(scope="module")
def content():
    return json.loads(file_of([filmed("feedback", SHORT, JacobianFeedback(), 3)]))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"actions": [[2.0, 0.0]]}, "in \\[-1, 1\\]"),
        ({"actions": []}, "one row per step"),
        ({"actions": [[1.0], [1.0, 2.0]]}, "one row per step"),
        ({"seed": -1}, "seed"),
        ({"error_mm": "small"}, "error_mm"),
        ({"environment": {"id": "CartPole-v1", "settings": {}}}, "some.json"),
        ({"environment": {"id": "rj_gym/RollingJoint-v0", "settings": {"mechanism": 3}}}, "some.json"),
    ],
)
def test_a_damaged_file_of_episodes_is_refused_in_one_line(content, change, message):
    episode = content["episodes"][0] | change
    with pytest.raises(InvalidInput, match=message) as caught:
        records_in(json.dumps(content | {"episodes": [episode]}).encode(), "some.json")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("other", [b"", b"{}", b"[1]", b"\xff\xfe", b'{"rolling-joint episodes": 2}'])
def test_another_file_is_no_file_of_episodes(tmp_path, other):
    (tmp_path / "other.json").write_bytes(other)
    with pytest.raises(InvalidInput, match="rj view"):
        read_records(tmp_path / "other.json")
