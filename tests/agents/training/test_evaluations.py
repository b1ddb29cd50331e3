"""Evaluations during training: which error chooses the best policy, and what runs of earlier versions keep to."""

import csv
from types import SimpleNamespace

import numpy as np
import pytest

from agents.evaluation.rollout import Episodes
from agents.runs.config import TrainConfig
from agents.runs.environment import EnvConfig
from agents.runs.folder import RunFolder
from agents.training import callbacks
from agents.training.callbacks import Evaluator, StopOnSignal
from agents.tuning.study import StudyConfig

EARLIER = "steps,mean_mm,median_mm,p95_mm,mean_reward\n10,3.5,3.5,3.5,-1.0\n"


def episodes(before: float, at_the_end: float) -> Episodes:
    """Two alike, at one error until the last step, then at another [mm]."""
    errors = np.full((2, 21), before)
    errors[:, -1] = at_the_end
    return Episodes(np.arange(2), errors, np.full(2, -1.0), np.zeros(2, bool))


def evaluated(run: RunFolder, config: TrainConfig, found: list[Episodes], monkeypatch) -> tuple[list[str], int]:
    """What is printed of these evaluations, and how often the policy was kept as the best."""
    said, kept, answers = [], [], iter(found)
    monkeypatch.setattr(callbacks, "run_episodes", lambda *_: next(answers))
    monkeypatch.setattr(callbacks, "policy_of", lambda *_: None)
    monkeypatch.setattr(callbacks, "controller_of", lambda *_: None)
    monkeypatch.setattr(callbacks, "save_policy", lambda model, files: kept.append(files))
    evaluator = Evaluator(run, config, StopOnSignal(), said.append)
    evaluator.model = SimpleNamespace(
        num_timesteps=20, get_vec_normalize_env=lambda: None, logger=SimpleNamespace(record=lambda *_: None)
    )
    evaluator.num_timesteps = 20
    evaluator._on_training_start()
    for _ in found:
        evaluator.evaluate()
    return said, len(kept)


@pytest.fixture
def run(tmp_path) -> RunFolder:
    return RunFolder.create(tmp_path / "run", TrainConfig(), ["typed"])


def test_a_lucky_last_step_does_not_make_a_policy_the_best(run, monkeypatch):
    said, kept = evaluated(run, TrainConfig(), [episodes(2.0, 2.0), episodes(3.0, 1.0)], monkeypatch)
    assert said[0].endswith("mean tip error over the last 10 steps 2.000 mm  (best so far)")
    assert said[1].endswith("mean tip error over the last 10 steps 2.800 mm") and kept == 1
    rows = list(csv.DictReader(run.evaluations.read_text().splitlines()))
    assert [(float(row["last_10_mm"]), float(row["mean_mm"])) for row in rows] == [(2.0, 2.0), (2.8, 1.0)]


def test_a_run_of_an_earlier_version_goes_on_by_the_error_at_the_end(run, monkeypatch):
    run.evaluations.write_text(EARLIER)
    said, kept = evaluated(run, TrainConfig(), [episodes(2.0, 4.0), episodes(9.0, 3.0)], monkeypatch)
    assert said[0].endswith("mean tip error at the end 4.000 mm")
    assert said[1].endswith("mean tip error at the end 3.000 mm  (best so far)") and kept == 1
    assert run.evaluations.read_text() == EARLIER + "20,4.0,4.0,4.0,-1.0\n20,3.0,3.0,3.0,-1.0\n"


@pytest.mark.parametrize(("id", "column"), [("Instrument-v0", "last_10_mm"), ("CurvatureDesign-v0", "mean_mm")])
def test_tracking_is_judged_by_its_last_steps_and_designs_by_the_final_one(id, column, tmp_path):
    config = TrainConfig(env=EnvConfig(f"rj_gym/{id}"))
    assert RunFolder.create(tmp_path / "run", config, []).judged_by == StudyConfig(config, {}).score == column


def test_where_a_signal_ends_training_nothing_is_evaluated_and_a_policy_is_kept(run, monkeypatch):
    kept = []
    monkeypatch.setattr(Evaluator, "evaluate", lambda self: pytest.fail("takes seconds"))
    monkeypatch.setattr(callbacks, "save_policy", lambda model, files: kept.append(files))
    stop = StopOnSignal()
    evaluator = Evaluator(run, TrainConfig(), stop)
    evaluator.model = SimpleNamespace(logger=SimpleNamespace(dump=lambda steps: None))
    stop.ends = True
    evaluator._on_training_end()
    assert kept == [run.policy_files("best")]
    for path in kept[0]:
        path.parent.mkdir(exist_ok=True)
        path.touch()
    evaluator._on_training_end()
    assert len(kept) == 1
