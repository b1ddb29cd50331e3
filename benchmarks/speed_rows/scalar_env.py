"""Steps per second of the scalar environment."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium

import rj_gym  # noqa: F401  (registers its ids)
from speed_rows.limit import BareWalk
from speed_rows.row import LIMIT, Row, Target, timed_row
from speed_rows.sizes import Sizes
from speed_rows.timing import Contestant, race
from speed_rows.walk import random_walk

TITLE = "Scalar environment"
TEXT = """`gymnasium.make(id)` with its usual wrappers, random actions drawn beforehand, resets included."""

OURS = "rj_gym/RollingJoint-v0"
PEERS = {"Reacher-v5 (MuJoCo)": "Reacher-v5", "CartPole-v1": "CartPole-v1"}


def measure(sizes: Sizes, images: Path) -> Iterator[Row]:
    """Rows of the section."""
    contestants = {name: player(env_id, sizes.scalar_steps) for name, env_id in {OURS: OURS, **PEERS}.items()}
    contestants[LIMIT] = Contestant(BareWalk(random_walk(sizes.walk)).one_by_one, sizes.walk)
    yield timed_row(OURS, "steps/s", race(contestants, sizes.repeats), Target(200e3, at_least=True))


def player(env_id: str, steps: int) -> Contestant | str:
    """This many steps of an environment; a text if it is not installed."""
    try:
        env = gymnasium.make(env_id)
    except (ImportError, gymnasium.error.Error):
        return "not installed"
    env.action_space.seed(0)
    actions = [env.action_space.sample() for _ in range(steps)]
    return Contestant(lambda: play(env, actions), steps)


def play(env: gymnasium.Env[Any, Any], actions: list[Any]) -> None:
    """Play actions; an episode that ends is followed by the next one."""
    env.reset(seed=0)
    for action in actions:
        _, _, terminated, truncated, _ = env.step(action)
        if terminated or truncated:
            env.reset()
