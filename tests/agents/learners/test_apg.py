"""Analytic policy gradients: they learn, runs resume to the bit, policies run with NumPy alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from agents.runs.config import TrainConfig
from agents.training.build import build_model
from agents.training.learn import learn
from rollingjoint.errors import ConfigError
from tests.agents.learners.checks import (
    check_that_a_stopped_run_ends_with_the_same_weights,
    check_that_numpy_acts_as_torch,
)

STEPS, LANES = 16, 32


def settings(updates: int, **changes: Any) -> dict[str, Any]:
    """A small run on the mild instrument."""
    env = {"id": "rj_gym/InstrumentShift-v0", "n_envs": LANES, "settings": {"episode_steps": STEPS}}
    return {
        "algorithm": "apg",
        "total_timesteps": updates * LANES * STEPS,
        "env": env | changes.pop("env", {}),
        "parameters": {"learning_rate": 3.0e-3},
        "policy": {"memory": 24},
        "normalise": {"reward": False},
        **changes,
    }


@pytest.mark.slow
@pytest.mark.parametrize(("optimizer", "share"), [("adam", 0.5), ("muon", 0.6)])
def test_errors_shrink_within_a_few_updates(optimizer: str, share: float) -> None:
    parameters = {"learning_rate": 3.0e-3, "optimizer": optimizer}
    config = TrainConfig.from_dict(settings(40, parameters=parameters))
    model = build_model(config)
    losses: list[float] = []
    loss = model.loss
    model.loss = lambda played: losses.append(loss(played).item()) or loss(played)
    learn(model, config, [])
    assert np.mean(losses[-5:]) < share * np.mean(losses[:3])


def test_episodes_are_short_in_the_first_share_of_training() -> None:
    config = TrainConfig.from_dict(settings(2, parameters={"short": 0.5, "short_steps": 4}))
    model = build_model(config)
    steps: list[tuple[int, int]] = []
    loss = model.loss
    model.loss = lambda played: steps.append((len(played.errors), len(model.ep_info_buffer))) or loss(played)
    learn(model, config, [])
    assert steps == [(4, 32), (4, 64), (4, 96), (4, 100), (16, 100)]  # the window of ended episodes holds a hundred
    assert model.num_timesteps == config.total_timesteps


def test_numpy_gives_the_actions_of_the_learner_over_whole_episodes() -> None:
    check_that_numpy_acts_as_torch(TrainConfig.from_dict(settings(2)))


@pytest.mark.slow
@pytest.mark.parametrize("optimizer", ["adam", "muon"])
def test_a_run_that_was_stopped_ends_with_the_same_weights(
    optimizer: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    values = settings(
        6,
        parameters={"learning_rate": 3.0e-3, "optimizer": optimizer},
        evaluation={"every": 3 * LANES * STEPS, "episodes": 4},
        checkpoint_every=2 * LANES * STEPS,
    )
    check_that_a_stopped_run_ends_with_the_same_weights(values, tmp_path, monkeypatch)


@pytest.mark.parametrize(
    "env",
    [{"id": "rj_gym/CurvatureDesign-v0", "settings": {}}, {"settings": {"privileged": "observation"}}],
)
def test_other_environments_are_refused_in_one_line(env: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match="a tracking environment of rj_gym") as refused:
        build_model(TrainConfig.from_dict(settings(1, env=env)))
    assert "\n" not in str(refused.value)


torch.set_num_threads(1)
