"""Gradients through lumens are the derivatives of the environment's own errors and forces."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch

from agents.learners.walled_episodes import PlayedAmongWalls, WalledEpisodes, observed
from agents.runs.config import TrainConfig
from agents.training.build import build_model, close
from agents.training.learn import learn
from rollingjoint.errors import ConfigError
from tests.agents.learners.checks import lanes_of

torch.set_num_threads(1)

LUMEN = "rj_gym/Lumen-v0"


def _losses(env: Any, weights: torch.Tensor, bias: torch.Tensor) -> torch.Tensor:
    """Mean error and a norm of the forces over an episode of a policy that is linear in what it sees and remembers."""
    env.reset(seed=3)

    def act(x: torch.Tensor, memory: torch.Tensor | None) -> tuple[torch.Tensor, torch.Tensor]:
        memory = 0.5 * x + (0.0 if memory is None else 0.5 * memory)
        return memory @ weights + bias, memory

    entries = env.single_observation_space.shape[0]
    played = WalledEpisodes(env, lambda seen: (np.zeros(entries), np.ones(entries))).play(act)
    assert played is not None and bool(played.running.all())
    assert float(played.forces.detach().amax()) > 0.3
    return played.errors.mean() + played.forces.square().sum((0, 2)).mean()


@pytest.mark.parametrize("poses", ["all", "none"])
def test_gradients_are_those_of_the_environment_where_walls_do_not_rub(poses: str) -> None:
    """By every kind of parameter, against central differences of whole episodes with noise."""
    noise = {"position_mm": 0.3, "angle": 0.01, "tension": 0.1, "force": 0.1}
    env = lanes_of(LUMEN, 3, episode_steps=14, mu=0.0, noise=noise, poses=poses, feed_scale_mm=4.0)
    rng, count = np.random.default_rng(0), env.single_observation_space.shape[0]
    weights = torch.tensor(0.05 * rng.standard_normal((count, 5)), dtype=torch.float32, requires_grad=True)
    bias = torch.tensor([0.02, -0.02, 0.01, 0.02, 0.7], requires_grad=True)
    _losses(env, weights, bias).backward()
    for parameter in (weights, bias):
        assert parameter.grad is not None
        direction, step, losses = torch.sign(parameter.grad), 1e-4, []
        with torch.no_grad():
            for change in (step * direction, -step * direction):
                parameter += change
                losses.append(_losses(env, weights, bias).item())
                parameter -= change
        expected = (losses[0] - losses[1]) / (2 * step)
        assert float((parameter.grad * direction).sum()) == pytest.approx(expected, rel=0.02)
    env.close()


def test_what_sensors_without_errors_show_is_the_observation() -> None:
    for poses in ("all", "tip", "none"):
        env = lanes_of(LUMEN, 2, poses=poses)
        observation, _ = env.reset(seed=1)
        episodes = WalledEpisodes(env, lambda seen: (np.zeros(1), np.ones(1)))
        for _ in range(12):
            observation, *_ = env.step(np.tile(np.array([0.3, -0.2, 0.1, 0.0, 1.0], np.float32), (2, 1)))
        response = env.tangent()
        commands, feed = (torch.tensor(values, dtype=torch.float32) for values in (response.commands, response.feed))
        state = episodes._state(commands, feed[:, None])
        np.testing.assert_allclose(observed(env.task, state).numpy(), observation, atol=1e-5)
        env.close()


def settings(env_id: str = LUMEN, **given: Any) -> TrainConfig:
    return TrainConfig.from_dict(
        {
            "algorithm": "apg",
            "total_timesteps": 2 * 8 * 6,
            "env": {"id": env_id, "n_envs": 8, "settings": {"episode_steps": 6, **given}},
            "policy": {"memory": None, "hidden": [16]},
            "normalise": {"reward": False},
        }
    )


def test_a_policy_in_lumens_follows_the_gradient() -> None:
    model = build_model(settings())
    before = [parameter.detach().clone() for parameter in model.policy.parameters()]
    losses: list[float] = []
    loss = model.loss
    model.loss = lambda played: losses.append(loss(played).item()) or loss(played)
    learn(model, settings(), [])
    assert len(losses) == 2 and losses[0] > 40.0
    assert all(not torch.equal(old, new) for old, new in zip(before, model.policy.parameters(), strict=True))
    close(model)


@pytest.mark.parametrize("name", ["estimate_weight", "short"])
def test_what_needs_episodes_without_walls_is_refused(name: str) -> None:
    model = build_model(settings())
    setattr(model, name, 0.1)
    with pytest.raises(ConfigError, match=rf"parameters.{name} = 0.1: expected 0 among walls"):
        model._setup_model()
    close(model)


def test_the_loss_is_half_the_square_of_settled_errors_and_the_peak_force() -> None:
    model = build_model(settings())
    model.settled_steps, model.whole_weight, model.force_weight = 2, 0.1, 0.5
    errors, forces, running = torch.full((6, 4), 4.0), torch.zeros(6, 4, 9), torch.ones(6, 4, dtype=torch.bool)
    errors[-2:], forces[3, :, 5], running[:, 3] = 2.0, 3.0, False
    forces[:, 3], errors[:, 3] = 100.0, 100.0  # of an episode that had ended
    loss = model.loss(PlayedAmongWalls(errors, forces, running))
    whole = 0.1 * (4 * 4.0 + 2 * 2.0) / 6
    assert float(loss) == pytest.approx(0.5 * 2.0**2 + whole + 0.5 * 3.0 * 3 / 4, rel=1e-4)
    close(model)


@pytest.mark.parametrize(
    ("config", "match"),
    [(settings("rj_gym/Obstacles-v1"), "rj_gym/Lumen-v0 among the tasks"), (settings(walls="ahead"), "walls.*none")],
)
def test_other_tasks_among_walls_are_refused(config: TrainConfig, match: str) -> None:
    with pytest.raises(ConfigError, match=match) as refused:
        build_model(config)
    assert "\n" not in str(refused.value)
