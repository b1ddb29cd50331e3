"""Success of controllers in the tasks among walls, beside that of policies.

    python benchmarks/surroundings_tasks.py Lumen
    python benchmarks/surroundings_tasks.py Lumen --policy lumen --families gentle tight stiff three_bends

Episodes with the seeds 9,100,000 and up, which no training uses, all side by side. A controller that is told what no
instrument sees is marked with a star. --film FILE.gif writes an animation of the first episode of the last controller,
--picture FILE.png its last step; --seed N: of another episode.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

import rj_gym
from agents.controllers.among_walls import (
    Feedback,
    FollowTheLeader,
    FreeSpacePlan,
    SearchedWay,
    SeekForce,
    Still,
    WallController,
)

FIRST_SEED = 9_100_000

CONTROLLERS: dict[str, Callable[[], WallController]] = {
    "do nothing": Still,
    "open loop, free space": FreeSpacePlan,
    "feedback, free space": lambda: Feedback(aware=False),
    "feedback, contact*": lambda: Feedback(aware=True),
    "follow the leader*": FollowTheLeader,
    "seek the force*": SeekForce,
    "searched way*": SearchedWay,
}
UNFIT = {
    "Lumen": ("seek the force*", "searched way*"),
    "Obstacles": ("follow the leader*", "seek the force*"),
    "HiddenWall": ("follow the leader*",),
}


class Policy:
    """A trained policy, which sees observations alone."""

    def __init__(self, name: str) -> None:
        from agents.shipped import load_policy

        self.policy = load_policy(name)

    def begin(self, envs: Any, infos: Any) -> None:
        """Begin episodes, of which a policy remembers nothing."""


Player = WallController | Policy


def actions_of(player: Player, envs: Any, observations: Any) -> Any:
    """The actions of all lanes, (B, m)."""
    return player.policy(observations) if isinstance(player, Policy) else player.act(envs.unwrapped)


def row(env_id: str, name: str, player: Player, episodes: int, settings: dict[str, Any]) -> str:
    """The row of a controller or policy in the table."""
    envs = gymnasium.make_vec(env_id, episodes, "vector_entry_point", autoreset_mode="Disabled", **settings)
    observations, infos = envs.reset(seed=FIRST_SEED)
    player.begin(envs.unwrapped, infos)
    returns, early = np.zeros(episodes), np.zeros(episodes, bool)
    running = np.ones(episodes, bool)
    final = {key: np.array(infos[key]) for key in ("error_mm", "peak_wall_force", "success", "path_ratio")}
    for _ in range(envs.unwrapped.config.episode_steps):
        actions = actions_of(player, envs, observations)
        observations, rewards, terminated, truncated, infos = envs.step(np.where(running[:, None], actions, 0.0))
        returns += running * rewards
        for key, values in final.items():
            values[running] = infos[key][running]
        early |= running & terminated
        running &= ~(terminated | truncated)
        if terminated.any() and running.any():  # a lane that has ended begins again, and does not count
            observations, _ = envs.reset(options={"reset_mask": terminated})
    error, peak = final["error_mm"], final["peak_wall_force"]
    limit = envs.unwrapped.config.success_mm
    return (
        f"| {name} | {error.mean():.1f}, {np.median(error):.1f} | {100 * np.mean(error <= limit):.0f} % "
        f"| {peak.mean():.2f}, {np.percentile(peak, 95):.2f} | {100 * final['path_ratio'].mean():.0f} % "
        f"| {100 * final['success'].mean():.0f} % | {returns.mean():.1f} | {early.sum()} |"
    )


def film(env_id: str, player: Player, settings: dict[str, Any], seed: int) -> list[Any]:
    """Pictures of an episode."""
    envs = gymnasium.make_vec(
        env_id, 1, "vector_entry_point", render_mode="rgb_array", autoreset_mode="Disabled", **settings
    )
    observations, infos = envs.reset(seed=seed)
    player.begin(envs.unwrapped, infos)
    frames = [envs.render()[0]]
    for _ in range(envs.unwrapped.config.episode_steps):
        observations, _, terminated, *_ = envs.step(actions_of(player, envs, observations))
        frames.append(envs.render()[0])
        if terminated.any():
            break
    return frames


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("task", choices=sorted(rj_gym.SURROUNDINGS_IDS.values()))
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--policy", nargs="*", default=[], help="names or files of policies")
    parser.add_argument("--families", nargs="*", default=["hard"], choices=sorted(rj_gym.FAMILIES))
    parser.add_argument("--only", nargs="*", help="these controllers alone")
    parser.add_argument("--film", type=Path, help="write an animation of the first episode of the last controller")
    parser.add_argument("--picture", type=Path, help="write a picture of its last step")
    parser.add_argument("--seed", type=int, default=FIRST_SEED, help="of the animation and the picture")
    given = parser.parse_args()
    env_id = f"rj_gym/{given.task}-v0"
    every: dict[str, Callable[[], Player]] = dict(CONTROLLERS)
    every = {name: make for name, make in every.items() if name not in UNFIT[given.task]}
    every = {name: make for name, make in every.items() if given.only is None or name in given.only}
    every |= {f"policy {Path(name).name}": partial(Policy, name) for name in given.policy}
    for family in given.families if given.task == "Lumen" else [""]:
        settings: dict[str, Any] = {"families": [family]} if family else {}
        print(f"\n{given.task} {family}: {given.episodes} episodes\n")
        print(
            "| controller | error mean, median mm | near | peak force mean, 95 % N | way | success | return | ended |"
        )
        print("|---|--:|--:|--:|--:|--:|--:|--:|")
        for name, make in every.items():
            print(row(env_id, name, make(), given.episodes, settings), flush=True)
    if given.film or given.picture:
        frames = film(env_id, list(every.values())[-1](), settings, given.seed)
        _save(frames, given.film, given.picture)


def _save(frames: list[Any], animation: Path | None, picture: Path | None) -> None:
    from PIL import Image

    images = [Image.fromarray(frame).resize((480, 400)) for frame in frames]
    if animation:
        colours = [image.quantize(64) for image in images]
        colours[0].save(animation, save_all=True, append_images=colours[1:], duration=90, loop=0, optimize=True)
    if picture:
        Image.fromarray(frames[-1]).save(picture)


if __name__ == "__main__":
    main()
