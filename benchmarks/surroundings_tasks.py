"""Success of controllers in the tasks among walls, beside that of policies.

    python benchmarks/surroundings_tasks.py Lumen
    python benchmarks/surroundings_tasks.py Lumen --policy lumen --families gentle tight stiff three_bends

Episodes with the seeds 9,100,000 and up, which no training uses, all side by side. A controller that is told what no
instrument sees is marked with a star. --tune tries their gains in other episodes. --film FILE.gif writes an animation
of the first episode of the last controller, --picture FILE.png its last step; --seed N: of another episode. --tuning
plays the episodes of --tune, on which policies are chosen, too. --draws prints the processor time of drawing an episode
alone.
"""

from __future__ import annotations

import argparse
import itertools
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from scipy import stats

import rj_gym
from agents.controllers.among_walls import (
    Feedback,
    FollowTheLeader,
    FreeSpacePlan,
    PlanAround,
    SearchedWay,
    SeekForce,
    Still,
    WallController,
    WayFromAnywhere,
)
from agents.controllers.command_tree import CommandTree
from agents.controllers.fitted_wall import FittedWall

FIRST_SEED = 9_100_000
TUNING_SEED = 6_000_000  # of the episodes on which gains are chosen, which no table uses

Make = Callable[..., WallController | FittedWall]

CONTROLLERS: dict[str, Make] = {
    "do nothing": Still,
    "open loop, free space": FreeSpacePlan,
    "feedback, free space": partial(Feedback, aware=False),
    "feedback, contact*": partial(Feedback, aware=True),
    "plan around": PlanAround,
    "tree of commands": CommandTree,
    "way from anywhere": WayFromAnywhere,
    "follow the leader*": FollowTheLeader,
    "fitted wall": FittedWall,
    "seek the force*": SeekForce,
    "searched way*": SearchedWay,
}
UNFIT = {
    "Lumen": (
        "plan around",
        "tree of commands",
        "way from anywhere",
        "fitted wall",
        "seek the force*",
        "searched way*",
    ),
    "Obstacles": ("follow the leader*", "fitted wall", "seek the force*"),
    "HiddenWall": ("plan around", "tree of commands", "way from anywhere", "follow the leader*"),
}
UNFIT["ObstaclesV1"] = UNFIT["Obstacles"]

_FEEDBACK = {"step_mm": (1.0, 3.0, 5.0, 8.0), "damping": (0.03, 0.1, 0.3, 2.0, 6.0, 15.0)}
GRIDS: dict[str, dict[str, tuple[float, ...]]] = {
    "open loop, free space": {"share": (0.5, 0.8, 1.0)},
    "feedback, free space": _FEEDBACK,
    "feedback, contact*": _FEEDBACK,
    "plan around": {"fast": (0.7, 1.0), "caution": (3.0, 10.0)},
    "tree of commands": {"force": (0.3, 1.0), "towards": (0.1, 0.25, 0.5)},
    "follow the leader*": {"rate": (1.8, 2.0, 2.2), "gain": (0.4, 0.6), "relax": (0.5, 0.8)},
    "fitted wall": {"near": (0.5, 1.5, 3.0), "caution": (1.0, 2.0)},
    "seek the force*": {"gain": (0.2, 0.4, 0.8), "near": (0.3, 1.0, 2.0)},
}
"""Gains that --tune tries, in all combinations."""

CHOSEN: dict[str, dict[str, dict[str, float]]] = {
    "Lumen": {
        "feedback, free space": {"step_mm": 8.0, "damping": 6.0},
        "feedback, contact*": {"step_mm": 8.0, "damping": 6.0},
    },
    "Obstacles": {
        "open loop, free space": {"share": 0.5},
        "feedback, free space": {"step_mm": 8.0, "damping": 0.3},
        "feedback, contact*": {"step_mm": 3.0, "damping": 0.03},
    },
    "ObstaclesV1": {
        "open loop, free space": {"share": 0.5},
        "feedback, free space": {"step_mm": 8.0, "damping": 0.03},
        "feedback, contact*": {"step_mm": 5.0, "damping": 0.1},
    },
    "HiddenWall": {
        "open loop, free space": {"share": 0.5},
        "feedback, free space": {"step_mm": 5.0, "damping": 0.03},
        "feedback, contact*": {"step_mm": 5.0, "damping": 0.03},
        "seek the force*": {"near": 0.3},
    },
}
"""Gains by task and controller, as --tune chose them; what is not here has its defaults."""


NOISE = {"position_mm": 0.5, "angle": 0.01, "tension": 0.1, "force": 0.1}


class Policy:
    """A trained policy, which sees observations alone."""

    reads_environment = False

    def __init__(self, name: str) -> None:
        from agents.shipped import load_policy

        self.policy = load_policy(name)

    def begin(self, envs: Any, infos: Any) -> None:
        """Begin episodes."""
        self.policy.reset(envs.num_envs)

    def act(self, observations: Any) -> Any:
        """The actions, (B, m)."""
        return self.policy(observations)


Player = WallController | FittedWall | Policy


def actions_of(player: Player, envs: Any, observations: Any) -> Any:
    """The actions of all lanes, (B, m)."""
    return player.act(envs.unwrapped if player.reads_environment else observations)


class Outcome(NamedTuple):
    """What became of E episodes, (E,) each; early: those that a step without a usable pose ended.

    seconds: processor time of an action, on average.
    """

    error: Any
    peak: Any
    ratio: Any
    success: Any
    returns: Any
    early: Any
    seconds: float


class Beginning:
    """E episodes of an environment that have just begun, with the seeds from `seed` on, all side by side.

    They are drawn once; every player begins them anew.
    """

    def __init__(self, env_id: str, episodes: int, settings: dict[str, Any], seed: int = FIRST_SEED) -> None:
        self.envs: Any = gymnasium.make_vec(
            env_id, episodes, "vector_entry_point", autoreset_mode="Disabled", **settings
        ).unwrapped
        self.observations, self.infos = self.envs.reset(seed=seed)
        self.state = self.envs.get_state()


def outcome(beginning: Beginning, player: Player) -> Outcome:
    """These episodes, driven by a controller or policy."""
    envs, observations, infos = beginning.envs, beginning.observations, beginning.infos
    episodes = envs.num_envs
    envs.set_state(beginning.state)
    player.begin(envs, infos)
    returns, early = np.zeros(episodes), np.zeros(episodes, bool)
    running = np.ones(episodes, bool)
    final = {key: np.array(infos[key]) for key in ("error_mm", "peak_wall_force", "success", "path_ratio")}
    steps, seconds = envs.config.episode_steps, 0.0
    for _ in range(steps):
        begun = time.process_time()
        actions = actions_of(player, envs, observations)
        seconds += time.process_time() - begun
        observations, rewards, terminated, truncated, infos = envs.step(np.where(running[:, None], actions, 0.0))
        returns += running * rewards
        for key, values in final.items():
            values[running] = infos[key][running]
        early |= running & terminated
        running &= ~(terminated | truncated)
        if terminated.any() and running.any():  # a lane that has ended begins again, and does not count
            observations, _ = envs.reset(options={"reset_mask": terminated})
    names = ("error_mm", "peak_wall_force", "path_ratio", "success")
    return Outcome(*(final[name] for name in names), returns, early, seconds / (steps * episodes))


def row(name: str, beginning: Beginning, player: Player, timed: bool = False) -> str:
    """The row of a controller or policy in the table; timed: with the processor time of an action."""
    error, peak, ratio, success, returns, early, seconds = outcome(beginning, player)
    limit = beginning.envs.config.success_mm
    return (
        f"| {name} | {error.mean():.1f}, {np.median(error):.1f} | {100 * np.mean(error <= limit):.0f} % "
        f"| {peak.mean():.2f}, {np.percentile(peak, 95):.2f} | {100 * ratio.mean():.0f} % "
        f"| {100 * success.mean():.0f} % | {returns.mean():.1f} | {early.sum()} |"
        + (f" {1e6 * seconds:.0f} |" if timed else "")
    )


def mean_row(name: str, policies: Sequence[Outcome]) -> str:
    """Success and its range, mean error and mean peak force over policies, each with half its 95 % interval."""
    figures = 100.0 * np.array([[each.success.mean(), each.error.mean(), each.peak.mean()] for each in policies])
    half = stats.t.ppf(0.975, len(figures) - 1) * stats.sem(figures)
    (success, error, peak), shares = figures.mean(axis=0), figures[:, 0]
    return (
        f"| {name} | {success:.1f} ± {half[0]:.1f} % | {shares.min():.0f} to {shares.max():.0f} % "
        f"| {error / 100:.2f} ± {half[1] / 100:.2f} | {peak / 100:.2f} ± {half[2] / 100:.2f} |"
    )


def tune(beginning: Beginning, names: Sequence[str]) -> None:
    """Print what every combination of gains of controllers reaches in these episodes, and which one is the best.

    That is the one with the most successes, and among equals with the highest return.
    """
    for name in names:
        tried = {}
        for values in itertools.product(*GRIDS[name].values()):
            gains = dict(zip(GRIDS[name], values, strict=True))
            reached = outcome(beginning, CONTROLLERS[name](**gains))
            tried[values] = float(reached.success.mean()), float(reached.returns.mean())
            print(f"{name} {gains}: {100 * tried[values][0]:.0f} %, return {tried[values][1]:.1f}", flush=True)
        print(f"-> {name}: {dict(zip(GRIDS[name], max(tried, key=lambda values: tried[values]), strict=True))}\n")


def draw_seconds(env_id: str, episodes: int, settings: dict[str, Any]) -> float:
    """Processor time of drawing an episode, of so many side by side [s]; kernels are loaded before."""
    envs: Any = gymnasium.make_vec(env_id, episodes, "vector_entry_point", **settings)
    gymnasium.make(env_id, **settings).reset(seed=TUNING_SEED)
    begun = time.process_time()
    envs.reset(seed=FIRST_SEED)
    return (time.process_time() - begun) / episodes


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
    ids = {stem: env_id for env_id, stem in rj_gym.SURROUNDINGS_IDS.items()}
    parser.add_argument("task", choices=sorted(ids), help="ObstaclesV1: rj_gym/Obstacles-v1")
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--policy", nargs="*", default=[], help="names or files of policies")
    parser.add_argument(
        "--mean", action="store_true", help="only the mean of the policies, with 95 %% intervals over them"
    )
    parser.add_argument("--families", nargs="*", default=["hard"], choices=sorted(rj_gym.FAMILIES))
    parser.add_argument("--only", nargs="*", help="these controllers alone")
    parser.add_argument("--noise", action="store_true", help="sensors with errors, which controllers do not have")
    parser.add_argument("--blind", action="store_true", help="no pose of any link is observed")
    parser.add_argument("--tune", action="store_true", help="try gains in other episodes, seeds 6,000,000 and up")
    parser.add_argument("--tuning", action="store_true", help="tables of these other episodes")
    parser.add_argument("--time", action="store_true", help="also the processor time of an action, all side by side")
    parser.add_argument("--draws", action="store_true", help="only the processor time of drawing an episode")
    parser.add_argument("--film", type=Path, help="write an animation of the first episode of the last controller")
    parser.add_argument("--picture", type=Path, help="write a picture of its last step")
    parser.add_argument("--seed", type=int, default=FIRST_SEED, help="of the animation and the picture")
    given = parser.parse_args()
    env_id = ids[given.task]
    fitting = {name: make for name, make in CONTROLLERS.items() if name not in UNFIT[given.task]}
    chosen = CHOSEN[given.task]
    every: dict[str, Callable[[], Player]] = {
        name: partial(make, **chosen.get(name, {})) for name, make in fitting.items()
    }
    every = {name: make for name, make in every.items() if given.only is None or name in given.only}
    every |= {f"policy {name}": partial(Policy, name) for name in given.policy}
    for family in given.families if given.task == "Lumen" else [""]:
        settings: dict[str, Any] = {"families": [family]} if family else {}
        settings |= {"noise": NOISE} if given.noise else {}
        settings |= {"poses": "none"} if given.blind else {}
        if given.draws:
            print(f"{1e3 * draw_seconds(env_id, given.episodes, settings):.0f} ms to draw an episode")
            continue
        if given.tune:
            names = [name for name in every if name in GRIDS]
            tune(Beginning(env_id, given.episodes, settings, TUNING_SEED), names)
            continue
        beginning = Beginning(env_id, given.episodes, settings, TUNING_SEED if given.tuning else FIRST_SEED)
        if given.mean:
            print(mean_row(family, [outcome(beginning, Policy(name)) for name in given.policy]), flush=True)
            continue
        print(f"\n{given.task} {family}: {given.episodes} episodes\n")
        print(
            "| controller | error mean, median mm | near | peak force mean, 95 % N | way | success | return | ended |"
            + (" µs |" if given.time else "")
        )
        print("|---|" + (8 if given.time else 7) * "--:|")
        for name, make in every.items():
            print(row(name, beginning, make(), given.time), flush=True)
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
