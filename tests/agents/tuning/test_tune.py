"""agents.tune: a study of trials that goes on, loses no trial, and ends in a configuration and a report."""

import math
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import optuna
import pytest
from optuna.trial import TrialState
from PIL import Image

from agents import train, tune
from agents.executors import local
from agents.runs.config import load_config
from agents.runs.files import read_rows
from agents.runs.locks import file_lock
from agents.training.callbacks import Evaluator
from agents.tuning.folder import StudyFolder
from agents.tuning.journal import journal_storage
from agents.tuning.study import StudyConfig, load_study
from agents.tuning.trials import KILLED
from rollingjoint.errors import ConfigError
from tests.agents.forked import CONTEXT, Forked

STUDY = """
config: {configs}/train/demo.yaml
set:
  total_timesteps: 80
  env.n_envs: 2
  env.settings.episode_steps: 10
  parameters.n_steps: 10
  parameters.batch_size: 20
  parameters.n_epochs: 1
  policy.hidden: [8]
  evaluation.every: 40
space:
  parameters.gamma: {{low: 0.5, high: 0.99}}
  parameters.n_epochs: {{low: 1, high: 3}}
  parameters.learning_rate.linear.0: {{low: 1.0e-4, high: 1.0e-2, log: true}}
  policy.hidden: {{choices: [[4], [8, 8]]}}
episodes: 2
startup: 2
trials: 5
"""


@pytest.fixture
def config(tmp_path) -> Path:
    path = tmp_path / "study.yaml"
    path.write_text(STUDY.format(configs=Path("configs").resolve()))
    return path


def run(*arguments: object) -> int:
    return tune.main([str(argument) for argument in arguments])


def trials(folder: Path) -> list[optuna.trial.FrozenTrial]:
    return optuna.load_study(study_name="study", storage=journal_storage(folder / "journal.log")).get_trials()


@pytest.mark.slow
def test_a_study_goes_on_and_ends_in_a_configuration_and_a_report(config, tmp_path, capsys):
    folder = tmp_path / "study"
    assert run("--config", config, "--study", folder, "--trials", 3) == 0
    assert len([line for line in capsys.readouterr().out.splitlines() if line.startswith("trial ")]) == 3
    assert run("--study", folder) == 0
    assert len([line for line in capsys.readouterr().out.splitlines() if line.startswith("trial ")]) == 2
    done = trials(folder)
    assert [trial.number for trial in done] == [0, 1, 2, 3, 4]
    best = min((trial for trial in done if trial.state == TrialState.COMPLETE), key=lambda trial: trial.value)
    found = load_config(folder / "best.yaml")
    assert found.parameters["gamma"] == best.params["parameters.gamma"]
    assert found.parameters["learning_rate"]["linear"] == [best.params["parameters.learning_rate.linear.0"], 3e-5]
    assert (found.evaluation.seed, found.total_timesteps) == (1_000_000, 80)
    assert train.main(["--config", str(folder / "best.yaml"), "--run-dir", str(tmp_path / "run")]) == 0
    report = (folder / "report.md").read_text()
    assert f"| {best.number} | {best.value:.3f} |" in report
    for name in ("history.png", "parameters.png"):
        assert name in report
        with Image.open(folder / name) as image:
            assert image.width > 400


def test_the_score_of_a_trial_is_its_last_evaluation_on_seeds_of_the_study(config, tmp_path, no_pictures):
    folder = tmp_path / "study"
    assert run("--config", config, "--study", folder, "--trials", 1) == 0
    trained = folder / "trials" / "0000" / "seed-1"
    assert trials(folder)[0].value == float(read_rows(trained / "evaluations.csv")[-1]["last_10_mm"])
    assert '"evaluation_during_training": [\n    2000000,\n    2000001' in (trained / "seeds.json").read_text()


def test_the_same_study_draws_the_same_trials(config, tmp_path, no_pictures):
    for name in ("one", "two"):
        assert run("--config", config, "--study", tmp_path / name, "--trials", 3) == 0
    one, two = (trials(tmp_path / name) for name in ("one", "two"))
    assert [(trial.params, trial.value) for trial in one] == [(trial.params, trial.value) for trial in two]
    assert len({trial.params["parameters.gamma"] for trial in one}) == 3


def test_no_trials_show_what_would_be_searched_and_leave_nothing(config, tmp_path, capsys):
    assert run("--config", config, "--study", tmp_path / "study", "--trials", 0) == 0
    out = capsys.readouterr().out
    assert "parameters.gamma: numbers from 0.5 to 0.99" in out
    assert "policy.hidden: one of [4], [8, 8]" in out
    assert not (tmp_path / "study").exists()


def test_failed_trials_keep_their_reason_and_the_study_goes_on(config, tmp_path, monkeypatch, capsys, no_pictures):
    evaluate, count = Evaluator.evaluate, []

    def diverging(self):
        count.append(1)
        if len(count) == 1:
            raise FloatingPointError("broken")
        row = evaluate(self)
        if len(count) in (2, 3):  # both evaluations of the second trial
            row["last_10_mm"] = math.nan
            self._write(row.values())
        return row

    monkeypatch.setattr(Evaluator, "evaluate", diverging)
    folder = tmp_path / "study"
    assert run("--config", config, "--study", folder, "--trials", 2) == 2
    assert "report.md says why" in capsys.readouterr().err
    assert run("--study", folder, "--trials", 3) == 0
    assert [trial.state for trial in trials(folder)] == [TrialState.FAIL, TrialState.FAIL, TrialState.COMPLETE]
    report = (folder / "report.md").read_text()
    assert "- trial 0: FloatingPointError: broken" in report
    assert "last_10_mm is nan" in report


def test_a_trial_that_falls_behind_is_ended_early(config, tmp_path, monkeypatch, no_pictures):
    evaluate = Evaluator.evaluate

    def worse(self):
        row = evaluate(self)
        return row | {"last_10_mm": 1000.0 if "0002" in str(self.run.path) else row["last_10_mm"]}

    monkeypatch.setattr(Evaluator, "evaluate", worse)
    folder = tmp_path / "study"
    assert run("--config", config, "--study", folder, "--trials", 3) == 0
    last = trials(folder)[2]
    assert (last.state, last.intermediate_values) == (TrialState.PRUNED, {40: 1000.0})
    assert len((folder / "trials/0002/seed-1/evaluations.csv").read_text().splitlines()) == 3


KILLED_IN_THE_SECOND_TRIAL = """
import os, signal, sys
from agents import tune
from agents.training.callbacks import Evaluator
evaluate = Evaluator.evaluate
def killing(self):
    if "0001" in str(self.run.path):
        os.kill(os.getpid(), signal.SIGKILL)
    return evaluate(self)
Evaluator.evaluate = killing
tune.main(sys.argv[1:])
"""


@pytest.mark.slow
def test_a_killed_trial_is_queued_again(config, tmp_path, no_pictures):
    folder = tmp_path / "study"
    command = [sys.executable, "-c", KILLED_IN_THE_SECOND_TRIAL, "--config", str(config), "--study", str(folder)]
    assert Forked(command, stdout=subprocess.DEVNULL).wait() == -signal.SIGKILL
    assert [trial.state for trial in trials(folder)] == [TrialState.COMPLETE, TrialState.RUNNING]
    with (folder / "journal.log").open("a") as journal:
        journal.write('{"half": ')  # as a full disk would leave it
    assert run("--study", folder, "--trials", 3) == 0
    first, killed, again, last = trials(folder)
    assert (killed.state, killed.user_attrs["reason"]) == (TrialState.FAIL, KILLED)
    assert again.params == killed.params
    assert first.params != again.params != last.params
    assert all(trial.state.is_finished() for trial in (again, last))


def test_a_trial_that_another_process_works_on_is_left_alone(config, tmp_path, no_pictures):
    folder = tmp_path / "study"
    assert run("--config", config, "--study", folder, "--trials", 1) == 0
    study = StudyFolder(folder).journal(load_study(config))
    number = study.ask().number
    (folder / "trials" / f"{number:04d}").mkdir()
    with file_lock(folder / "trials" / f"{number:04d}" / "lock"):
        assert run("--study", folder, "--trials", 3) == 0
    assert [trial.state.is_finished() for trial in trials(folder)] == [True, False, True]


def test_a_signal_ends_the_study_and_queues_its_trial_again(config, tmp_path, monkeypatch, capsys, no_pictures):
    folder, evaluate = tmp_path / "study", Evaluator.evaluate
    with monkeypatch.context() as patch:
        patch.setattr(Evaluator, "evaluate", lambda self: os.kill(os.getpid(), signal.SIGTERM) or evaluate(self))
        patch.setattr(Evaluator, "_on_training_end", lambda self: None)
        assert run("--config", config, "--study", folder) == 128 + signal.SIGTERM
    assert "to go on: rj tune" in capsys.readouterr().out
    assert run("--study", folder, "--trials", 1) == 0
    killed, again = trials(folder)
    assert (killed.params, again.state) == (again.params, TrialState.COMPLETE)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("parameters.gamma:", "parameters.gama:"), ["gama", "'gamma'"]),
        (("high: 0.99", "high: 1.5"), ["space: parameters.gamma", "0 to 1"]),
        (("high: 0.99", "high: 0.1"), ["parameters.gamma.high = 0.1"]),
        (("low: 0.5", "lo: 0.5"), ["lo", "'low'"]),
        (("low: 1.0e-4", "low: 0"), ["linear.0.low", "above zero"]),
        (("linear.0", "linear.x"), ["linear.x"]),
        (("linear.0", "linear.7"), ["linear.7"]),
        (("[[4], [8, 8]]", "[]"), ["policy.hidden.choices"]),
        (("episodes: 2", "episodes: 0"), ["episodes = 0"]),
        (("episodes: 2", "first_seed: 10100"), ["first_seed = 10100", "rj evaluate"]),
        (("episodes: 2", "training_seeds: [2000050]"), ["first_seed", "training with seed 2000050"]),
        (("episodes: 2", "score: mean"), ["score = 'mean'", "'last_10_mm', 'mean_mm'"]),
        (("episodes: 2", "pruner: mean"), ["pruner = 'mean'", "halving"]),
        (("config:", "confg:"), ["confg", "'config'"]),
        (("space:", "set:"), ["twice"]),
    ],
)
def test_a_wrong_study_ends_with_one_line_that_names_the_key(change, words, config, tmp_path, capsys):
    config.write_text(config.read_text().replace(*change))
    assert run("--config", config, "--study", tmp_path / "study") == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    for word in [str(config), *words]:
        assert word in error
    assert not (tmp_path / "study").exists()


def test_a_study_that_began_with_something_else_or_no_study_is_refused(config, tmp_path, capsys):
    folder = tmp_path / "study"
    StudyFolder(folder).begin(load_study(config))
    config.write_text(config.read_text().replace("high: 0.99", "high: 0.9"))
    assert run("--config", config, "--study", folder) == 2
    assert "began with" in capsys.readouterr().err
    assert run("--study", tmp_path / "nowhere") == 2
    assert "no study is in" in capsys.readouterr().err
    shutil.move(folder / "study.yaml", folder / "letters.txt")
    assert run("--config", config, "--study", folder) == 2
    assert "It stays as it is" in capsys.readouterr().err
    assert run("--study", folder, "--trials", -1) == 2


def test_a_study_survives_a_round_trip_through_yaml(config, tmp_path):
    study = load_study(config)
    StudyFolder(tmp_path / "study").begin(study)
    assert load_study(tmp_path / "study" / "study.yaml") == study


@pytest.mark.parametrize("path", sorted(Path("configs/tune").glob("*.yaml")), ids=lambda path: path.stem)
def test_the_shipped_studies_load(path):
    study = load_study(path)
    assert study.train.total_timesteps <= 200_000
    assert len(study.space) >= 5


def test_every_value_of_a_space_must_fit_the_configuration():
    with pytest.raises(ConfigError, match=r"space: parameters\.batch_size"):
        load_study_with({"parameters.batch_size": {"choices": [64, 63]}})


def load_study_with(space: dict) -> StudyConfig:
    from agents.runs.config import TrainConfig
    from agents.tuning.study import Choices

    return StudyConfig(TrainConfig(), {key: Choices(tuple(value["choices"])) for key, value in space.items()})


RECURRENT = """
config: {configs}/train/recurrent_ppo_instrument.yaml
set: {{total_timesteps: 32, env.n_envs: 2, env.settings.episode_steps: 8, parameters.n_steps: 8, parameters.n_epochs: 1,
  parameters.batch_size: 16, policy.hidden: [4], policy.value_hidden: [4], policy.memory: 4, evaluation.every: 16}}
space:
  policy.critic: {{choices: [privileged, observation]}}
  residual: {{choices: [null, open loop]}}
training_seeds: [1, 2]
episodes: 2
startup: 3
trials: 3
"""


@pytest.mark.slow
def test_learners_with_memory_privileged_critic_and_residual_are_tuned(tmp_path, no_pictures):
    path = tmp_path / "study.yaml"
    path.write_text(RECURRENT.format(configs=Path("configs").resolve()))
    assert run("--config", path, "--study", tmp_path / "study") == 0
    done = trials(tmp_path / "study")
    assert [trial.state for trial in done] == [TrialState.COMPLETE] * 3
    assert len({(trial.params["policy.critic"], trial.params["residual"]) for trial in done}) > 1
    assert load_config(tmp_path / "study" / "best.yaml").algorithm == "recurrent_ppo"


@pytest.mark.slow
def test_a_study_in_a_database_is_worked_on_by_two_processes(config, tmp_path, monkeypatch, no_pictures):
    monkeypatch.setattr(local, "get_context", lambda method: CONTEXT)
    url = f"sqlite:///{tmp_path}/trials.db"
    words = ["--study", tmp_path / "study", "--storage", url, "--trials", 4, "--jobs", 2]
    assert run("--config", config, *words) == 0
    done = optuna.load_study(study_name="study", storage=url).get_trials()
    assert [trial.state.is_finished() for trial in done] == [True] * 4
    assert all(40 in trial.intermediate_values for trial in done)
    assert not (tmp_path / "study/journal.log").exists()


@pytest.mark.parametrize(
    ("url", "words"),
    [("nowhere://me:secret@host/name", ["nowhere://me:***@host", "grpc://"]), ("grpc://here", ["grpc"])],
)
def test_a_storage_that_cannot_be_reached_is_one_line_without_its_password(url, words, config, tmp_path, capsys):
    assert run("--config", config, "--study", tmp_path / "study", "--storage", url) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and "secret" not in error
    assert [word for word in words if word not in error] == []


def test_a_worker_that_does_not_see_the_journal_says_so(config, tmp_path):
    study = load_study(config)
    with pytest.raises(ConfigError, match="every machine needs the storage"):
        StudyFolder(tmp_path).reached(study)
