"""Distillation in the tasks among walls: the teacher drives, its actions are what is learnt, other learners refuse."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from agents.controllers.among_walls import FollowTheLeader, SeekForce, WayFromAnywhere
from agents.learners.distill import Distill
from agents.runs.config import TrainConfig
from agents.shipped import load_policy
from agents.training.build import build_model, close
from agents.training.learn import learn
from rollingjoint.errors import ConfigError
from tests.agents.learners.checks import lanes_of

STEPS, LANES = 6, 8


def config(name: str, teacher: str | None, algorithm: str = "distill", **policy: Any) -> TrainConfig:
    parameters = {"teacher": teacher, "taught": 1.0} if algorithm == "distill" else {}
    return TrainConfig.from_dict(
        {
            "algorithm": algorithm,
            "total_timesteps": 2 * LANES * STEPS,
            "env": {"id": f"rj_gym/{name}", "n_envs": LANES, "settings": {"episode_steps": STEPS}},
            "parameters": parameters,
            "policy": {"memory": None, "hidden": [16]} | policy,
            "normalise": {"reward": False},
        }
    )


def trained(name: str, teacher: str, **policy: Any) -> Distill:
    settings = config(name, teacher, **policy)
    model = build_model(settings)
    assert isinstance(model, Distill)
    learn(model, settings, [])
    return model


def test_the_leader_is_followed_and_its_actions_are_learnt() -> None:
    model = trained("Lumen-v0", "follow the leader")
    assert isinstance(model.teacher, FollowTheLeader) and len(model.demonstrations) == 2
    env, played = lanes_of("rj_gym/Lumen-v0", LANES, episode_steps=STEPS), model.demonstrations[0]
    env.reset(seed=0)
    observation, info = env.reset()  # the teacher drives all lanes of the first episodes
    teacher = FollowTheLeader()
    teacher.begin(env, info)
    for step in range(STEPS):
        actions = teacher.act(env)
        np.testing.assert_array_equal(played.observations[:, step], observation)
        np.testing.assert_allclose(played.actions[:, step], actions, atol=1e-6)
        observation = env.step(actions.astype(np.float32))[0]
    env.close()
    close(model)


def test_a_policy_with_memory_learns_to_seek_a_force_that_it_does_not_see() -> None:
    model = trained("HiddenWall-v0", "seek the force", memory=8)
    assert isinstance(model.teacher, SeekForce)
    assert model.demonstrations[0].actions.abs().amax() > 0.1
    close(model)


@pytest.mark.slow
def test_ways_around_discs_are_learnt_and_the_shipped_policy_goes_them() -> None:
    model = trained("Obstacles-v1", "way from anywhere")
    assert isinstance(model.teacher, WayFromAnywhere)
    assert model.demonstrations[0].actions.abs().amax() > 0.5
    close(model)
    policy, env = load_policy("obstacles"), lanes_of("rj_gym/Obstacles-v1", 6)
    observation, info = env.reset(seed=6_000_000)
    for _ in range(env.config.episode_steps):
        observation, *_, info = env.step(policy(observation))
    assert info["success"].all() and info["error_mm"].max() < 1.0
    env.close()


@pytest.mark.parametrize(
    ("settings", "match"),
    [
        (("Lumen-v0", "seek the force"), "teacher.*follow the leader"),
        (("Lumen-v0", None), "env.*among walls distill has to be told its teacher"),
        (("HiddenWall-v0", None, "apg"), "env.*rj_gym/Lumen-v0 among the tasks among walls"),
    ],
)
def test_other_teachers_and_learners_are_refused(settings: Any, match: str) -> None:
    with pytest.raises(ConfigError, match=f"(?i){match}"):
        model = build_model(config(*settings))
        learn(model, config(*settings), [])
