"""Controllers as teachers and below residual policies: lessons before analytic gradients, residual policies of APG."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from agents.controllers.tuned import tuned_controllers
from agents.learners.episodes import DifferentiableEpisodes
from agents.runs.config import TrainConfig
from agents.training.build import build_model, close
from agents.training.learn import learn
from rollingjoint.errors import ConfigError
from tests.agents.learners.checks import Player, check_that_a_stopped_run_ends_with_the_same_weights, lanes_of

STEPS, LANES, WORLD = 8, 16, "rj_gym/InstrumentShift-v0"
LESSONS = {"lessons": 0.5, "teacher": "open loop", "gradient_steps": 3, "batch_size": 8, "kept_rollouts": 4}


def settings(rollouts: int, **changes: Any) -> dict[str, Any]:
    """A small run of APG on the mild instrument, which begins with lessons of open loop."""
    return {
        "algorithm": "apg",
        "total_timesteps": rollouts * LANES * STEPS,
        "env": {"id": WORLD, "n_envs": LANES, "settings": {"episode_steps": STEPS}},
        "parameters": LESSONS,
        "policy": {"memory": 16},
        "normalise": {"reward": False},
        **changes,
    }


def test_a_controller_teaches_what_it_does_itself() -> None:
    env, controller = lanes_of(WORLD, 3, episode_steps=4), tuned_controllers(WORLD)["bank of filters"]
    model = build_model(TrainConfig.from_dict(settings(1, parameters=LESSONS | {"teacher": "bank of filters"})))
    teacher = model.teacher
    close(model)
    for seed in (1, 2):
        observation, _ = env.reset(seed=seed)
        teacher.reset(np.ones(3, bool))
        controller.begin(env.task, 3)
        for _ in range(4):
            own = controller.act(observation)
            np.testing.assert_array_equal(teacher.act(observation), own)
            observation, *_ = env.step(own)
    env.close()


def test_lessons_come_first_and_leave_nothing_behind() -> None:
    config = TrainConfig.from_dict(settings(6))
    model = build_model(config)
    kept, update = [], model._update
    model._update = lambda played: update(played) or kept.append(len(model.demonstrations))
    learn(model, config, [])
    assert kept == [1, 2, 3, 0, 0, 0]
    assert model.n_updates == 3 * 3 + 3
    steps = {int(state["step"]) for state in model.policy.optimizer.state.values()}
    assert steps == {3}  # Adam began anew
    close(model)


def test_lessons_have_a_learning_rate_of_their_own() -> None:
    rates: dict[str, Any] = {"learning_rate": {"linear": [6e-4, 0.0]}, "lessons_rate": {"linear": [0.03, 0.0]}}
    config = TrainConfig.from_dict(settings(6, parameters=LESSONS | rates))
    model = build_model(config)
    used, update = [], model._update
    model._update = lambda played: update(played) or used.append(model.policy.optimizer.param_groups[0]["lr"])
    learn(model, config, [])
    assert used == pytest.approx([0.02, 0.01, 0.0, 2e-4, 1e-4, 0.0])
    close(model)


@pytest.mark.slow
@pytest.mark.parametrize("stop", [2, 4])
def test_a_run_that_was_stopped_ends_with_the_same_weights(
    stop: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    parameters = LESSONS | {"lessons_rate": {"linear": [0.01, 0.001]}}
    every = {"evaluation": {"every": stop * LANES * STEPS, "episodes": 2}, "checkpoint_every": LANES * STEPS}
    values = settings(6, parameters=parameters, **every)
    check_that_a_stopped_run_ends_with_the_same_weights(values, tmp_path, monkeypatch)


class Constant:
    """A base controller that always pulls as much, and outputs another number, too."""

    def __init__(self, actions: list[float]) -> None:
        self.numbers = np.array([*actions, 0.7])

    def reset(self, mask: Any) -> None:
        self.episodes = len(mask)

    def outputs(self, observations: Any) -> Any:
        return np.tile(self.numbers, (self.episodes, 1))


def test_a_residual_policy_adds_to_its_base_and_sees_its_outputs() -> None:
    """Adding nothing to a controller is that controller: the same errors, and the same derivatives by actions."""
    found = []
    for on_top in (True, False):
        env = lanes_of(WORLD, 4, episode_steps=6)
        env.reset(seed=3)
        pulls, shown = [0.4, -0.3], []
        own = torch.tensor([0.0, 0.0] if on_top else pulls, requires_grad=True)

        def act(
            x: torch.Tensor, memory: torch.Tensor | None, own: torch.Tensor = own, shown: list[Any] = shown
        ) -> tuple[torch.Tensor, torch.Tensor]:
            shown.append(x.detach())
            return own.expand(len(x), 2), torch.zeros(len(x), 1)

        def as_it_is(seen: Any) -> tuple[Any, Any]:
            return np.zeros(seen.shape[1]), np.ones(seen.shape[1])

        episodes = DifferentiableEpisodes(env, as_it_is, base=Constant(pulls) if on_top else None)
        played = episodes.play(Player(act, (own,)))
        assert played is not None
        played.errors[-1].mean().backward()
        assert own.grad is not None
        found.append((played.errors.detach().numpy(), own.grad.numpy()))
        if on_top:
            np.testing.assert_allclose(shown[0][:, -3:].numpy(), np.tile([0.4, -0.3, 0.7], (4, 1)), rtol=1e-6)
        env.close()
    np.testing.assert_allclose(found[0][0], found[1][0], rtol=1e-6)
    np.testing.assert_allclose(found[0][1], found[1][1], rtol=1e-4)
    assert np.abs(found[0][1]).max() > 0.1


def test_apg_trains_a_residual_policy_on_estimates_of_its_base() -> None:
    config = TrainConfig.from_dict(settings(2, residual="kalman filter", parameters={}, env={
        "id": "rj_gym/Instrument-v0", "n_envs": 4, "settings": {"episode_steps": STEPS},
    }))  # fmt: skip
    model = build_model(config)
    before = weights_of(model)
    learn(model, config, [])
    assert model.observation_space.shape[0] == model.policy.actor.encoder[0].in_features > 10
    assert any((before[name] != after).any() for name, after in weights_of(model).items())
    close(model)


def weights_of(model: Any) -> dict[str, Any]:
    return {name: value.detach().numpy().copy() for name, value in model.policy.actor.state_dict().items()}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"parameters": LESSONS | {"teacher": "open lop"}}, "parameters.teacher.*open loop"),
        ({"parameters": LESSONS | {"teacher": "jacobian feedback"}}, "parameters.teacher.*can act on what"),
        ({"parameters": LESSONS | {"lessons": 1.5}}, "parameters.lessons"),
        ({"residual": "open loop"}, "residual.*null with distill, and with apg that has lessons"),
        ({"residual": "open loop", "algorithm": "distill", "parameters": {}}, "residual.*null with distill"),
    ],
)
def test_what_cannot_be_taught_is_refused_in_one_line(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigError, match=words) as refused:
        build_model(TrainConfig.from_dict(settings(1, **changes)))
    assert "\n" not in str(refused.value)


torch.set_num_threads(1)
