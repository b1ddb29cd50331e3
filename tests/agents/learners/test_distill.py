"""Distillation: the teacher reaches its targets, policies come to imitate it, runs resume to the bit."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from agents.learners.demonstrations import TaughtEpisodes
from agents.learners.true_state import TrueState, TrueStateFeedback
from agents.runs.config import TrainConfig
from agents.training.build import build_model, close
from agents.training.learn import learn
from rollingjoint.errors import ConfigError
from tests.agents.learners.checks import (
    Player,
    check_that_a_stopped_run_ends_with_the_same_weights,
    check_that_numpy_acts_as_torch,
    lanes_of,
)

STEPS, LANES = 16, 32


def settings(rollouts: int, **changes: Any) -> dict[str, Any]:
    """A small run on the mild instrument."""
    env = {"id": "rj_gym/InstrumentShift-v0", "n_envs": LANES, "settings": {"episode_steps": STEPS}}
    parameters = {"learning_rate": 3.0e-3, "taught": 0.5, "gradient_steps": 10, "batch_size": 16, "kept_rollouts": 3}
    return {
        "algorithm": "distill",
        "total_timesteps": rollouts * LANES * STEPS,
        "env": env | changes.pop("env", {}),
        "parameters": parameters | changes.pop("parameters", {}),
        "policy": {"memory": 24},
        "normalise": {"reward": False},
        **changes,
    }


def taught_errors(env: Any, seed: int, leads: bool = True) -> np.ndarray:
    """Tip errors (T, B) [mm] of episodes that the teacher drives; one that does not lead forgets where targets were."""
    info, teacher, errors = env.reset(seed=seed)[1], TrueStateFeedback(env.task), []
    teacher.reset(np.ones(env.num_envs, bool))
    for _ in range(env.task.config.episode_steps):
        if not leads:
            teacher.reset(np.ones(env.num_envs, bool))
        info = env.step(teacher.act(TrueState(env.tangent(), info["target"])))[-1]
        errors.append(info["error_mm"].copy())
    env.close()
    return np.array(errors)


def test_the_teacher_reaches_targets_through_hidden_play_and_friction() -> None:
    errors = taught_errors(lanes_of("rj_gym/Instrument-v0", 20), 5_000_000)
    assert errors[0].mean() > 5.0
    assert errors[-10:].mean() < 0.2


def test_the_teacher_leads_moving_targets() -> None:
    with_lead, without = (
        taught_errors(lanes_of("rj_gym/Instrument-v0", 20, target={"process": "path"}), 5_000_000, leads)[-10:].mean()
        for leads in (True, False)
    )
    assert with_lead < 0.6 and with_lead < 0.5 * without


def test_the_teacher_frees_tendons_that_are_held_at_a_tension_limit() -> None:
    env = lanes_of("rj_gym/Instrument-v0", 8)
    info, teacher = env.reset(seed=5_000_000)[1], TrueStateFeedback(env.task)
    pulled = np.ones((8, env.task.action_size))
    for _ in range(15):
        info = env.step(pulled)[-1]
    assert env.tangent().held.any(1).all()
    teacher.reset(np.ones(8, bool))
    for _ in range(20):
        info = env.step(teacher.act(TrueState(env.tangent(), info["target"])))[-1]
    assert not env.tangent().held.any()
    env.close()


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_the_teacher_drives_its_share_of_the_lanes(share: float) -> None:
    """The policy stands still, so the motors have moved where the teacher drove."""
    env = lanes_of("rj_gym/Instrument-v0", 6, episode_steps=3)
    env.reset(seed=3)
    m, started = env.task.action_size, []

    def still(x: torch.Tensor, memory: torch.Tensor | None) -> tuple[torch.Tensor, torch.Tensor]:
        started.append(env.tangent().motors)
        return torch.zeros(len(x), m), torch.zeros(len(x), 1)

    episodes = TaughtEpisodes(env, lambda seen: (np.zeros(seen.shape[1]), np.ones(seen.shape[1])), lambda: share)
    played = episodes.play(Player(still))
    assert played is not None and played.actions.shape == (6, 3, m) and played.running.all()
    assert (np.abs(env.tangent().motors - started[0]).max(1) > 0.1).tolist() == [share > 0.0] * 6
    assert played.actions.abs().amax() > 0.5
    env.close()


def test_the_policy_comes_nearer_to_the_teacher_and_takes_over_from_it() -> None:
    config = TrainConfig.from_dict(settings(12))
    model = build_model(config)
    untrained, shares = copy.deepcopy(model.policy.state_dict()), []
    update = model._update
    model._update = lambda played: shares.append(model.teachers_share()) or update(played)
    learn(model, config, [])
    assert model.n_updates == 120 and len(model.demonstrations) == 3
    np.testing.assert_allclose(shares, np.maximum(0.0, 1.0 - np.arange(1, 13) / 6.0))
    loss = model.imitation_loss(model.demonstrations[-1]).item()  # where the policy drove
    model.policy.load_state_dict(untrained)
    assert loss < 0.75 * model.imitation_loss(model.demonstrations[-1]).item()
    close(model)


def test_episodes_that_have_ended_do_not_count() -> None:
    config = TrainConfig.from_dict(settings(1))
    model = build_model(config)
    learn(model, config, [])
    (played,) = model.demonstrations
    loss = model.imitation_loss(played)
    played.running[:, 8:] = False
    expected = model.imitation_loss(played).item()
    assert expected != loss.item()
    played.actions[:, 8:] = 1e3
    assert model.imitation_loss(played).item() == expected
    close(model)


def test_numpy_gives_the_actions_of_the_student_over_whole_episodes() -> None:
    check_that_numpy_acts_as_torch(TrainConfig.from_dict(settings(2)))


@pytest.mark.slow
def test_a_run_that_was_stopped_ends_with_the_same_weights(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    values = settings(6, evaluation={"every": 3 * LANES * STEPS, "episodes": 4}, checkpoint_every=2 * LANES * STEPS)
    check_that_a_stopped_run_ends_with_the_same_weights(values, tmp_path, monkeypatch)


@pytest.mark.parametrize(
    ("env", "words"),
    [
        ({"id": "rj_gym/CurvatureDesign-v0", "settings": {}}, "a tracking environment of rj_gym"),
        ({"settings": {"privileged": "observation"}}, "a tracking environment of rj_gym"),
        ({"settings": {"actuation": {"delay": 2}}}, "actuation.delay.*0 with distill"),
        ({"settings": {"actuation": {"rate_limit_mm": 0.5}}}, "actuation.rate_limit_mm.*null with distill"),
    ],
)
def test_what_cannot_be_taught_is_refused_in_one_line(env: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigError, match=words) as refused:
        build_model(TrainConfig.from_dict(settings(1, env=env)))
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    "parameter", [{"taught": 1.5}, {"delta": 0.0}, {"gradient_steps": 0}, {"kept_rollouts": 0}, {"gamma": 0.9}]
)
def test_parameters_are_checked(parameter: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match=next(iter(parameter))):
        TrainConfig.from_dict(settings(1, parameters=parameter))


torch.set_num_threads(1)
