"""Is the arm's task well posed? Prints how far targets are, how many can be held, and how often the solver fails.

    python benchmarks/arm_task.py               # 1,000 episodes; some seconds
    python benchmarks/arm_task.py --episodes 50

A target counts as held where some tensions within the range bring the tip there under gravity and payload of the
episode: the inverse, from the tensions at which the target was drawn.
"""

from __future__ import annotations

import argparse

import numpy as np

from rj_gym import FlexibleArmConfig, FlexibleArmVectorEnv
from rj_gym.registry import task_of
from rollingjoint import reach_batch, solve_lengths, solve_tensions, solve_tensions_batch

STARTS = 4  # of a search


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--episodes", type=int, default=1000)
    count = parser.parse_args().episodes
    env = FlexibleArmVectorEnv(count, autoreset_mode="Disabled")
    _, infos = env.reset(seed=0)
    errors = infos["error_mm"]
    print(f"do nothing: {np.median(errors):.0f} mm off in the median, {errors.max():.0f} mm at most")
    print(f"gravity tilted as far as it goes: moves the tip of the straight arm by {gravity_shift():.0f} mm")
    held = held_errors(count)
    print(f"held within 1 mm: {np.mean(held < 1):.1%} of {count} targets, within 0.01 mm {np.mean(held < 0.01):.1%}")
    print(f"random actions: {failures(env)} of {count} episodes without equilibrium")


def gravity_shift() -> float:
    """How far gravity from the most tilted side moves the tip of the straight arm, its tendons locked [mm]."""
    config = FlexibleArmConfig()
    arm, tilt = task_of(config).mechanism, config.gravity.tilt[1]
    straight = solve_tensions(arm, [config.start_tension] * arm.n_tendons, [arm.gravity((0, 0, 1))])
    locked, shifts = straight.lengths - straight.tensions / arm.stiffnesses, []
    for azimuth in np.linspace(0, 2 * np.pi, 8, endpoint=False):
        side = np.sin(tilt) * np.array([np.cos(azimuth), np.sin(azimuth)])
        loads = [arm.gravity((*side, np.cos(tilt)))]
        found = solve_lengths(arm, locked, loads, straight, tension_limits=config.tension_range)
        shifts.append(np.linalg.norm(found.require().tip - straight.tip))
    return float(max(shifts))


def held_errors(count: int) -> np.ndarray:
    """Smallest tip errors found under the true loads of episodes with seeds 0, 1, ..., (count,) [mm]."""
    task = task_of(FlexibleArmConfig())
    episodes = task.sample([np.random.default_rng(seed) for seed in range(count)])
    tensions = episodes.target_tensions[:, 0]
    aims = solve_tensions_batch(task.mechanism, tensions, task.base_load_tables(episodes))
    loads, limits = task.load_tables(episodes, 0), task.config.tension_range
    return np.asarray(reach_batch(task.mechanism, aims.tip, loads, limits, start=aims, starts=STARTS).distance)


def failures(env: FlexibleArmVectorEnv) -> int:
    """Episodes that uniform random actions end without an equilibrium."""
    rng, ended = np.random.default_rng(0), np.zeros(env.num_envs, bool)
    env.reset(seed=0)
    for _ in range(env.config.episode_steps):
        _, _, terminated, _, _ = env.step(rng.uniform(-1, 1, env.action_space.shape))
        ended |= terminated
        if terminated.any():
            env.reset(options={"reset_mask": terminated})
    return int(ended.sum())


if __name__ == "__main__":
    main()
