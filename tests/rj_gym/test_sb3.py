"""The SB3 adapter gives what SB3's own DummyVecEnv over scalar environments gives."""

import gymnasium
import numpy as np
import pytest

import rj_gym
from rollingjoint import InvalidInput

vec_env = pytest.importorskip("stable_baselines3.common.vec_env")
from rj_gym.sb3 import SB3VecEnv, make_sb3_env  # noqa: E402

IDS = list(rj_gym.IDS)


def same(one, other):
    if isinstance(other, dict):
        return all(same(one[key], other[key]) for key in other)
    return np.array_equal(one, other)


@pytest.mark.parametrize("env_id", IDS)
def test_adapter_equals_dummy_vec_env(env_id):
    native = make_sb3_env(env_id, 4, episode_steps=3)
    dummy = vec_env.DummyVecEnv([lambda: gymnasium.make(env_id, episode_steps=3)] * 4)
    native.seed(7), dummy.seed(7)
    assert same(native.reset(), dummy.reset())
    assert same(native.reset_infos[2]["target"], dummy.reset_infos[2]["target"])
    rng = np.random.default_rng(0)
    for _ in range(7):
        actions = rng.uniform(-1, 1, native.env.action_space.shape).astype(np.float32)
        one, other = native.step(actions), dummy.step(actions)
        assert same(one[0], other[0])
        assert np.allclose(one[1], other[1], rtol=1e-6)
        assert one[1].dtype == other[1].dtype
        assert np.array_equal(one[2], other[2])
        for info, expected in zip(one[3], other[3], strict=True):
            assert ("terminal_observation" in info) == ("terminal_observation" in expected)
            if "terminal_observation" in expected:
                assert same(info["terminal_observation"], expected["terminal_observation"])
                assert info["TimeLimit.truncated"] is expected["TimeLimit.truncated"] is True
                assert info["error_mm"] == expected["error_mm"]
                assert info["status"] == expected["status"]


def test_ppo_learns_on_the_adapter_and_monitors_errors():
    from stable_baselines3 import PPO

    env = vec_env.VecMonitor(make_sb3_env(IDS[0], 8, episode_steps=5), info_keywords=("error_mm",))
    model = PPO("MlpPolicy", env, n_steps=10, batch_size=40, n_epochs=1, seed=0, device="cpu")
    model.learn(160)
    assert model.num_timesteps == 160
    assert all("error_mm" in episode for episode in model.ep_info_buffer)


def test_hindsight_relabelling_works_on_the_goal_adapter():
    from stable_baselines3 import SAC, HerReplayBuffer

    env = make_sb3_env(IDS[1], 4, episode_steps=5)
    model = SAC(
        "MultiInputPolicy", env, replay_buffer_class=HerReplayBuffer, learning_starts=40, batch_size=16, seed=0,
        device="cpu",
    )  # fmt: skip
    model.learn(80)
    assert model.num_timesteps == 80


def test_options_reach_every_lane_once():
    env = make_sb3_env(IDS[0], 3)
    env.set_options({"target": (10.0, 80.0)})
    env.reset()
    assert all(np.array_equal(info["target"], [10.0, 80.0]) for info in env.reset_infos)
    env.reset()
    assert not any(np.array_equal(info["target"], [10.0, 80.0]) for info in env.reset_infos)
    env.set_options([{}, {"target": (1.0, 80.0)}, {}])
    env.reset()
    assert [np.array_equal(info["target"], [1.0, 80.0]) for info in env.reset_infos] == [False, True, False]


def test_other_autoreset_modes_are_refused():
    with pytest.raises(InvalidInput, match="SAME_STEP"):
        SB3VecEnv(rj_gym.RollingJointVectorEnv(2))


def test_gymnasium_s_wrappers_of_rewards_and_actions_go_between():
    from gymnasium.wrappers.vector import TransformReward
    from stable_baselines3 import PPO

    native = gymnasium.make_vec(IDS[0], 4, "vector_entry_point", episode_steps=3, autoreset_mode="SameStep")
    env, plain = SB3VecEnv(TransformReward(native, lambda rewards: 2.0 * rewards)), make_sb3_env(IDS[0], 4)
    env.seed(7), plain.seed(7), env.reset(), plain.reset()
    actions = np.full((4, 2), 0.5, np.float32)
    for _ in range(2):
        assert np.allclose(env.step(actions)[1], 2.0 * plain.step(actions)[1])
    assert "terminal_observation" in env.step(actions)[3][0]
    assert env.get_attr("task")[0] is native.task
    PPO("MlpPolicy", env, n_steps=8, batch_size=16, n_epochs=1, seed=0, device="cpu").learn(64)


def test_attributes_and_pictures():
    env = make_sb3_env(IDS[0], 2, render_mode="rgb_array")
    env.reset()
    assert env.get_attr("config")[0].episode_steps == 50
    assert env.env_is_wrapped(gymnasium.Wrapper) == [False, False]
    assert [picture.shape[2] for picture in env.get_images()] == [3, 3]
    env.close()
