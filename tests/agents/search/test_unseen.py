"""A policy of the design environment: trained, evaluated alone, and beside other methods on new tasks."""

import json

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from agents import evaluate, train  # noqa: E402 - needs torch
from agents.runs.folder import RunFolder  # noqa: E402
from agents.search import unseen  # noqa: E402
from rj_gym import CurvatureDesignVectorEnv  # noqa: E402

SMALL = ["total_timesteps=24", "env.n_envs=2", "env.settings.episode_steps=5", "policy.hidden=[8]"]
SMALL += ["parameters.n_steps=12", "parameters.batch_size=12", "evaluation.every=24", "evaluation.episodes=2"]


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("design") / "run"
    changes = [word for change in SMALL for word in ("--set", change)]
    config = "configs/train/ppo_curvature_design.yaml"
    assert train.main(["--config", config, "--run-dir", str(folder), *changes]) == 0
    return folder


@pytest.mark.slow
def test_the_table_has_the_policy_and_every_method_and_goes_between_the_marks(run, tmp_path, capsys):
    page = tmp_path / "page.md"
    page.write_text(f"before\n\n{unseen.BEGIN}\nold\n{unseen.END}\nafter\n")
    arguments = [str(run), "--tasks", "2", "--budget", "4", "--page", str(page)]
    assert unseen.main(arguments) == 0
    text = page.read_text()
    assert text.startswith("before\n") and text.endswith("\nafter\n") and "old" not in text
    assert f"agents.search.unseen {run} --tasks 2 --budget 4" in text
    names = [line.split("|")[1].strip() for line in capsys.readouterr().out.splitlines() if line.startswith("| ")]
    assert names == ["method", ":--", "policy", *(name.replace("_", " ") for name in unseen.METHODS)]


def test_a_method_is_judged_by_the_environments_own_error(run):
    env = RunFolder.open(run).config().env
    envs = CurvatureDesignVectorEnv(3, **env.arguments())
    begin = envs.reset(seed=unseen.FIRST_SEED)[1]["error_mm"]
    policy = unseen._policy_errors(RunFolder.open(run), env, 3, 2)
    assert (policy <= begin).all()
    random = unseen._method_errors("random", env, 3, 12)
    assert (random > 0).all() and (random <= envs.config.largest_error_mm).all()
    more = unseen._method_errors("random", env, 3, 24)
    assert (more <= random).all() and np.isfinite(more).all()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--budget", "7"], "--budget = 7"),
        (["--tasks", "0"], "--tasks = 0"),
        (["--budget", "3", "--page", "no.md"], "no.md"),
    ],
)
def test_wrong_numbers_are_refused_in_one_line(run, capsys, arguments, message):
    assert unseen.main([str(run), *arguments]) == 2
    said = capsys.readouterr().err
    assert message in said and said.count("\n") == 1


def test_evaluation_scores_the_policy_alone(run):
    assert evaluate.main([str(run), "--episodes", "3"]) == 0
    report = json.loads((run / "evaluation" / "report.json").read_text())
    assert list(report["scores"]) == ["policy"]
