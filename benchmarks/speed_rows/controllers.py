"""What an idea waits for: the training of a controller until it is good."""

from __future__ import annotations

import statistics
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from stable_baselines3.common.callbacks import BaseCallback

from agents.controllers.residual import controller_of
from agents.evaluation.rollout import run_episodes
from agents.policies.trained import policy_of
from agents.results import read_results
from agents.results.record import TEST
from agents.runs.config import TrainConfig, load_config
from agents.shipped import load_policy
from agents.training.build import build_model, close
from agents.training.learn import learn
from speed_rows.row import Peer, Row, Target
from speed_rows.sizes import LEFT_OUT, Sizes

TITLE = "Controllers"
ONCE = True
TEXT = """Processor seconds of one core until a policy's error is within 20 % of the best known, evaluations left out:
the shipped recipes (`rj train apg_fixed_target` and so on), and Stable-Baselines3's PPO with its defaults and 16 lanes.
The best known is the smallest mean error over the last 10 steps in the test episodes of [results.md](results.md), of
all controllers without privilege; of lumens, which are not on that page, the error of the shipped policy in the
validation episodes. Errors below 0.01 mm are as good as that. A policy is scored on the recipe's validation episodes
after every twentieth of its steps. One that does not get there has no value; a training that takes longer than its
sample says ends."""

ROOT = Path(__file__).resolve().parents[2]
TASKS = {
    "fixed_target": 5.0,
    "two_segment": 20.0,
    "flexible_arm": 20.0,
    "pitch_yaw": None,
    "instrument": 180.0,
    "lumen": 600.0,
}  # s
AMONG_WALLS = ("lumen",)  # not on the results page
WITHIN, SMALL_MM, EVALUATIONS = 1.2, 0.01, 20
PLAIN = (
    "algorithm=ppo", "parameters={}", "policy={}", "normalise={observation: false, reward: false}", "env.n_envs=16",
    "total_timesteps=100_000_000",
)  # fmt: skip


def measure(sizes: Sizes, images: Path) -> Iterator[Row]:
    """Rows of the section."""
    for task, bound in TASKS.items():
        path = ROOT / f"configs/train/apg_{task}.yaml"
        best = shipped_error(task, load_config(path)) if task in AMONG_WALLS else best_known(task)
        what, goal = f"{task}, to {max(WITHIN * best, SMALL_MM):.3g} mm", max(WITHIN * best, SMALL_MM)
        target = None if bound is None else Target(bound)
        if not sizes.minutes:
            yield Row(what, None, "s", target=target, note=LEFT_OUT)
            continue
        seeds, cap = range(1, sizes.training_seeds + 1), max(sizes.training_seconds, 2.0 * (bound or 0.0))
        configs = [load_config(path, [f"seed={seed}"]) for seed in seeds[: 1 if cap > sizes.training_seconds else None]]
        ours, plain = [], []
        for config in configs:
            every = config.total_timesteps // EVALUATIONS
            ours.append(arrival(config, goal, every, cap))
            peer = load_config(path, [f"seed={config.seed}", *PLAIN])
            plain.append(arrival(peer, goal, every, sizes.training_seconds))
        value, note = _summary(ours)
        peer = Peer("PPO, defaults", *_summary(plain), sample=f"at most {sizes.training_seconds:.0f} s")
        sample = f"median of {len(ours)} seeds" if len(ours) > 1 else f"one seed, at most {cap:.0f} s"
        yield Row(what, value, "s", sample, target, (peer,), f"{note}; best known {best:.3g} mm")


def _summary(arrivals: Sequence[Arrival]) -> tuple[float | None, str]:
    """The median seconds, None if not all arrived, and what they arrived at."""
    count = sum(one.arrived for one in arrivals)
    error = f"{statistics.median(one.error for one in arrivals):.3g} mm"
    seconds = statistics.median(one.seconds for one in arrivals)
    if count < len(arrivals):
        return None, f"{count} of {len(arrivals)} there; {error} after {seconds:.0f} s"
    return seconds, f"ends at {error}"


class Arrival(NamedTuple):
    """What a training took.

    Attributes:
        seconds: of processor time until it arrived; of all of it where it did not. arrived: whether.
        error: then, on the validation episodes [mm].
    """

    seconds: float
    arrived: bool
    error: float


class _Watch(BaseCallback):
    """Ends training where its error is the goal, or its time is over."""

    def __init__(self, config: TrainConfig, goal: float, every: int, cap: float) -> None:
        super().__init__()
        self.config, self.goal, self.every, self.cap = config, goal, every, cap
        self.seconds, self.error, self.next = 0.0, float("inf"), every

    def _on_training_start(self) -> None:
        self.began = time.process_time()

    def _on_rollout_start(self) -> None:
        """Between updates: the policy is whole here."""
        if self.num_timesteps >= self.next:
            self.score()

    def _on_step(self) -> bool:
        return self.error > self.goal and self.seconds < self.cap

    def score(self) -> None:
        """Evaluate the policy with the clock stopped."""
        self.seconds += time.process_time() - self.began
        self.next = self.num_timesteps + self.every
        policy = controller_of(self.config, policy_of(self.model, self.model.get_vec_normalize_env()))
        self.error = validation_error(self.config, policy)
        self.began = time.process_time()


def arrival(config: TrainConfig, goal: float, every: int, cap: float) -> Arrival:
    """Train until the error [mm] is the goal, `cap` seconds have passed, or the steps are over."""
    model: Any = build_model(config)
    watch = _Watch(config, goal, every, cap)
    try:
        learn(model, config, [watch])
        if watch.error > goal and watch.seconds < cap:
            watch.score()
    finally:
        close(model)
    return Arrival(watch.seconds, watch.error <= goal, watch.error)


def validation_error(config: TrainConfig, policy: Any) -> float:
    """The mean error of a policy in a recipe's validation episodes, [mm]."""
    return float(run_episodes(config.env, policy, config.evaluation.seeds).last_errors.mean())


def shipped_error(task: str, config: TrainConfig) -> float:
    """The error of the policy that ships, [mm]."""
    return validation_error(config, load_policy(task))


def best_known(task: str) -> float:
    """The smallest mean error of controllers without privilege, [mm]."""
    benchmark = next(
        b for b in read_results(ROOT / "docs/results.json.gz").benchmarks if b.title == task.replace("_", " ")
    )
    world = benchmark.of_role(TEST)[0].name
    return min(
        float(controller.errors(world).mean())
        for controller in benchmark.controllers
        if not controller.privileged and controller.has(world)
    )
