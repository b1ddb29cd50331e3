"""Steps per second of the vector environment: lanes times steps."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import gymnasium
import numpy as np

import rj_gym  # noqa: F401  (registers its ids)
from speed_rows.limit import BareWalk
from speed_rows.plots import log_log
from speed_rows.row import LIMIT, Row, Target, timed_row
from speed_rows.sizes import Sizes
from speed_rows.timing import Contestant, fastest, race, repeated
from speed_rows.walk import random_walk

TITLE = "Vector environment"
TEXT = """`gymnasium.make_vec(id, lanes, "vector_entry_point")`, random actions drawn beforehand, a step counted
once per lane; seeded once beforehand, a reset of all lanes and all automatic ones included. Reacher-v5 has no native
vector environment and steps in Gymnasium's `SyncVectorEnv`; so do our own scalar environments, as the peers of arms.
Arms have 32 hinges and 8 tendons; that of ArmInstrument has friction besides."""
PICTURES = {"speed_vector_env.png": "Steps per second of all lanes over the number of lanes"}

OURS = "rj_gym/RollingJoint-v0"
EPISODE = 51  # steps, the one that resets included
PICTURE_REPEATS = 5
SYNC_LANES = 8
ARMS = {"rj_gym/FlexibleArm-v0": 1, "rj_gym/ArmInstrument-v1": 16}  # by how much fewer lanes


def measure(sizes: Sizes, images: Path) -> Iterator[Row]:
    """Rows of the section, and its picture."""
    lanes, steps = sizes.vector_lanes, sizes.vector_episodes * EPISODE
    contestants = {
        "ours": player(OURS, lanes, steps),
        LIMIT: repeated(BareWalk(random_walk(sizes.walk), lanes).batch, lanes, steps),
        f"CartPole-v1, native, {lanes:,} lanes": player("CartPole-v1", lanes, steps),
        f"Reacher-v5 (MuJoCo), SyncVectorEnv, {SYNC_LANES} lanes": player("Reacher-v5", SYNC_LANES, steps, "sync"),
    }
    note = f"{steps:,} steps, {sizes.vector_episodes} episodes of every lane"
    what = f"{OURS}, {lanes:,} lanes"
    yield timed_row(what, "steps/s", race(contestants, sizes.repeats), Target(3e6, at_least=True), note)
    for env_id, fewer in ARMS.items():
        lanes = max(sizes.vector_lanes // fewer, SYNC_LANES)
        peer = player(env_id, SYNC_LANES, EPISODE, "sync")
        contestants = {
            "ours": player(env_id, lanes, EPISODE),
            f"the scalar one, SyncVectorEnv, {SYNC_LANES} lanes": peer,
        }
        note = f"{EPISODE} steps, an episode of every lane"
        yield timed_row(f"{env_id}, {lanes:,} lanes", "steps/s", race(contestants, sizes.repeats), note=note)
    _draw(sizes, images / "speed_vector_env.png")


def player(env_id: str, lanes: int, steps: int, mode: str = "vector_entry_point") -> Contestant | str:
    """This many steps of all lanes; a text if the environment is not installed."""
    try:
        env = gymnasium.make_vec(env_id, lanes, mode)
    except (ImportError, gymnasium.error.Error):
        return "not installed"
    env.reset(seed=0)
    env.action_space.seed(0)
    distinct = [env.action_space.sample() for _ in range(min(steps, 16))]
    actions = [distinct[step % len(distinct)] for step in range(steps)]
    return Contestant(lambda: play(env, actions), lanes * steps)


def play(env: gymnasium.vector.VectorEnv, actions: list[np.ndarray]) -> None:
    """Play actions; ended lanes reset by themselves."""
    env.reset()
    for action in actions:
        env.step(action)


def _draw(sizes: Sizes, path: Path) -> None:
    points = []
    for lanes in sizes.vector_sizes:
        contestant = player(OURS, lanes, EPISODE)
        assert isinstance(contestant, Contestant)
        timing = fastest(contestant.work, contestant.pieces, min(PICTURE_REPEATS, sizes.repeats))
        points.append((lanes, 1.0 / timing.seconds))
    log_log(path, "lanes", "steps per second, all lanes", {OURS: points})
