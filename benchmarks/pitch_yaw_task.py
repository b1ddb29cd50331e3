"""Is the task of rj_gym/PitchYaw-v0 well posed, and how near do controllers come? Prints both.

python benchmarks/pitch_yaw_task.py                             # 100 test episodes, seeds from 9,000,000 on; seconds
python benchmarks/pitch_yaw_task.py --episodes 1000 --run RUN   # with the policy of a run folder
python benchmarks/pitch_yaw_task.py --set mechanism=pitch_yaw target.loaded=true
python benchmarks/pitch_yaw_task.py --file configs/env/pitch_yaw_blind.yaml
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from arm_task import failures

from agents.controllers.privileged_feedback import PrivilegedFeedback
from agents.evaluation.floor import episode_floor, why_no_floor
from agents.evaluation.rollout import run_episodes
from agents.policies.trained import load_driving
from agents.results.roster import opponents
from agents.runs.config import apply_overrides, env_settings
from agents.runs.environment import EnvConfig
from agents.runs.folder import RunFolder
from agents.runs.seeds import TEST
from rj_gym import PitchYawConfig, PitchYawVectorEnv
from rj_gym.registry import task_of
from rollingjoint import solve_lengths_batch, solve_tensions_batch
from rollingjoint.transmission import unstretched_length


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--file", type=Path, help="settings of the environment, YAML")
    parser.add_argument("--set", nargs="+", default=[], metavar="KEY=VALUE", help="settings on top")
    parser.add_argument("--run", type=Path, help="run folder of a policy to drive, too")
    arguments = parser.parse_args()
    settings = apply_overrides(env_settings(arguments.file) if arguments.file else {}, arguments.set)
    env, seeds = EnvConfig("rj_gym/PitchYaw-v0", settings=settings), TEST[: arguments.episodes]
    config = PitchYawConfig.from_dict(settings)
    moved = payload_shifts(config, len(seeds))
    print(f"the largest payload moves tips by {np.median(moved):.1f} mm in the median, {moved.max():.1f} mm at most")
    envs = PitchYawVectorEnv(len(seeds), config=config, autoreset_mode="Disabled")
    print(f"random actions: {failures(envs)} of {len(seeds)} episodes without equilibrium")
    print(f"floor: {floor_text(env, seeds)}")
    controllers = opponents(env)[0] | {"privileged teacher": PrivilegedFeedback()}
    if arguments.run:
        controllers["policy"] = load_driving(RunFolder.open(arguments.run))
    for name, controller in controllers.items():
        errors = run_episodes(env, controller, seeds).last_errors.mean(axis=1)
        print(
            f"{name:20} {errors.mean():7.4f} mm on average, {np.median(errors):.4f} in the median, "
            f"{errors.max():.3f} at most, {np.mean(errors > 0.1):.1%} above 0.1 mm"
        )


def floor_text(env: EnvConfig, seeds: Sequence[int]) -> str:
    """The floors of these episodes, or why there are none."""
    if why := why_no_floor(env):
        return why
    floors = episode_floor(env, seeds).errors
    return f"{floors.mean():.3g} mm on average, {floors.max():.3g} mm at most"


def payload_shifts(config: PitchYawConfig, count: int) -> np.ndarray:
    """How far the largest payload moves tips of equilibria at target tensions, tendons locked, (count,) [mm]."""
    largest = config.load.magnitude[1]
    task = task_of(config.updated({"load": {"magnitude": [largest, largest]}}))
    episodes = task.sample([np.random.default_rng(seed) for seed in range(count)])
    free = solve_tensions_batch(task.mechanism, episodes.target_tensions[:, 0], task.base_load_tables(episodes))
    locked = unstretched_length(free.lengths, free.tensions, task.mechanism.stiffnesses)
    pulled = solve_lengths_batch(task.mechanism, locked, task.load_tables(episodes, 0), free, config.tension_range)
    return np.asarray(np.linalg.norm(pulled.tip - free.tip, axis=1))


if __name__ == "__main__":
    main()
