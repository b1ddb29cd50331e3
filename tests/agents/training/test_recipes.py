"""Every analytic-gradient and newcomer's configuration trains: it builds, makes an update, and its policy acts."""

from pathlib import Path

import numpy as np
import pytest
import torch

from agents.policies.trained import TrainedPolicy, policy_of
from agents.runs.config import load_config
from agents.training.build import build_model, close
from agents.training.learn import learn

torch.set_num_threads(1)

SHORT = ["env.n_envs=4", "env.settings.episode_steps=6", "total_timesteps=24"]
GAINS = [path for path in sorted(Path("configs/train").glob("apg_*.yaml")) if "form: gain" in path.read_text()]


@pytest.mark.parametrize("path", GAINS, ids=lambda path: path.stem)
def test_a_recipe_makes_an_update_and_its_actions_vanish_with_the_error(path):
    config = load_config(path, SHORT)
    model = build_model(config)
    before = model.policy.actor.head.layer.weight.detach().clone()
    learn(model, config, [])
    assert not torch.equal(before, model.policy.actor.head.layer.weight)
    policy = policy_of(model, model.get_vec_normalize_env())
    assert isinstance(policy, TrainedPolicy)
    observation = model.observation_space.sample()[None]
    observation[:, list(policy.network.error.places)] = 0.0
    assert not policy.act(observation).any()
    close(model)


def test_there_is_a_recipe_for_every_task_with_a_tip_that_is_seen():
    recipes = {path.stem.removeprefix("apg_") for path in GAINS}
    others = {path.stem.removeprefix("ppo_") for path in Path("configs/train").glob("ppo_*.yaml")}
    blind = {"instrument", "instrument_shift", "slow_camera", "late_pose", "arm_instrument", "convolution_instrument"}
    assert recipes == others - blind - {"curvature_design", "lumen", "obstacles"}


WORLDS = ("instrument", "instrument_shift", "slow_camera", "late_pose", "arm_instrument")


@pytest.mark.parametrize("world", WORLDS)
def test_a_newcomers_ppo_trains_in_every_world_whose_tip_is_not_seen_or_late(world):
    env_id = "rj_gym/" + "".join(word.capitalize() for word in world.split("_")) + "-v0"
    words = [f"env.id={env_id}", f"env.file=../env/{world}.yaml", "parameters.n_steps=6", "parameters.batch_size=24"]
    config = load_config("configs/train/plain_ppo.yaml", [*SHORT, *words])
    model = build_model(config)
    learn(model, config, [])
    policy = policy_of(model)
    assert isinstance(policy, TrainedPolicy) and policy.network.frames == 8
    policy.reset(np.ones(2, bool))
    observations = np.zeros((2, policy.network.entries), np.float32)
    assert policy.act(observations).shape == (2, *model.action_space.shape)
    close(model)
