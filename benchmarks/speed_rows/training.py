"""Frames per second of Stable-Baselines3's PPO on our adapter, and on an environment that costs nothing."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from speed_rows.row import Row, Target, timed_row
from speed_rows.sizes import Sizes
from speed_rows.timing import Contestant, race

if TYPE_CHECKING:
    from stable_baselines3.common.vec_env import VecEnv

TITLE = "Training frames"
TEXT = """Stable-Baselines3's PPO as it comes (CPU, torch on one thread, "MlpPolicy", 10 epochs) with rollouts of 8
steps and one minibatch of all of them, on `rj_gym.sb3.make_sb3_env` and, taking turns in the same run, on a
`VecEnv` with the same spaces and lanes whose steps cost nothing: it hands out the same prepared arrays, and ends
its episodes when ours do, so that Stable-Baselines3 does the same work."""

EPISODE, ROLLOUT = 50, 8  # steps


def measure(sizes: Sizes, images: Path) -> Iterator[Row]:
    """Rows of the section."""
    for lanes in sizes.training_lanes:
        what = f"PPO, {lanes:,} lanes"
        if importlib.util.find_spec("stable_baselines3") is None:
            yield Row(what, None, "frames/s", note="stable-baselines3 is not installed")
            continue
        contestants = {
            "ours": learner(real_env(lanes), sizes.training_rollouts),
            "the same at no cost": learner(free_env(lanes), sizes.training_rollouts),
        }
        row = timed_row(what, "frames/s", race(contestants, sizes.training_repeats))
        yield row
        share = row.times_faster(row.peers[0])
        goal = Target(90.0, at_least=True)
        yield Row(f"share of the rate at no cost, {lanes:,} lanes", 100.0 * (share or 0.0), "%", row.sample, goal)


def learner(env: VecEnv, rollouts: int) -> Contestant:
    """PPO that learns for this many rollouts from the beginning of an episode."""
    import torch
    from stable_baselines3 import PPO

    torch.set_num_threads(1)
    model = PPO("MlpPolicy", env, n_steps=ROLLOUT, batch_size=ROLLOUT * env.num_envs, device="cpu", seed=0)
    frames = rollouts * ROLLOUT * env.num_envs
    return Contestant(lambda: model.learn(frames), frames)


def real_env(lanes: int) -> VecEnv:
    """Our adapter."""
    from rj_gym.sb3 import make_sb3_env

    return make_sb3_env("rj_gym/RollingJoint-v0", lanes)


def free_env(lanes: int) -> VecEnv:
    """An environment like ours whose steps cost nothing."""
    from speed_rows.free_vec_env import FreeVecEnv

    return FreeVecEnv(real_env(lanes), EPISODE)
