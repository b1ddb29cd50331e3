"""What happens beside training: saving, evaluation, progress, stopping on a signal."""

from __future__ import annotations

import csv
import os
import pickle
import signal
import sys
from typing import Any

import numpy as np
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from tqdm import tqdm

from agents.build import make_env
from agents.config import TrainConfig
from agents.policy import Policy
from agents.rollout import run_episodes
from agents.run_folder import RunFolder, write_file


def save_policy(model: BaseAlgorithm, run: RunFolder, which: str) -> None:
    """Save model and normaliser under the names of RunFolder.policy_files, each whole or not at all."""
    policy, normaliser = run.policy_files(which)
    write_file(policy, model.save)
    if model.get_vec_normalize_env() is not None:
        write_file(normaliser, lambda stream: pickle.dump(model.get_vec_normalize_env(), stream))


class Checkpoints(BaseCallback):
    """Saves the policy every `every` steps."""

    def __init__(self, run: RunFolder, every: int) -> None:
        super().__init__()
        self.run, self.every, self.next = run, every, every

    def _on_step(self) -> bool:
        if self.num_timesteps >= self.next:
            self.next += self.every * (1 + (self.num_timesteps - self.next) // self.every)
            save_policy(self.model, self.run, f"{self.num_timesteps:09d}")
        return True


class Evaluation(BaseCallback):
    """Scores the deterministic policy on fixed seeds now and then and at the end, and keeps the best policy.

    The tip errors go to evaluations.csv, in one line to `show`, and to the training log (evaluation/...).
    """

    def __init__(self, run: RunFolder, config: TrainConfig, show: Any = tqdm.write) -> None:
        super().__init__()
        self.run, self.every, self.show = run, config.evaluation.every, show
        first = config.evaluation.seed
        self.seeds = range(first, first + config.evaluation.episodes)
        self.env = make_env(config.env)
        self.best, self.next = np.inf, self.every

    def _on_training_start(self) -> None:
        with self.run.evaluations.open("w", newline="") as stream:
            csv.writer(stream).writerow(["steps", "mean_mm", "median_mm", "p95_mm", "mean_reward"])

    def _on_step(self) -> bool:
        if self.next <= self.num_timesteps < self.locals["total_timesteps"]:
            self.next += self.every * (1 + (self.num_timesteps - self.next) // self.every)
            self.evaluate()
        return True

    def _on_training_end(self) -> None:
        self.evaluate()
        self.logger.dump(self.num_timesteps)
        self.env.close()

    def evaluate(self) -> None:
        """Score the policy as it is now."""
        episodes = run_episodes(self.env, Policy(self.model, self.model.get_vec_normalize_env()), self.seeds)
        final = np.array([episode.errors[-1] for episode in episodes])
        mean, median, p95 = float(final.mean()), float(np.median(final)), float(np.percentile(final, 95))
        reward = float(np.mean([episode.reward for episode in episodes]))
        for name, value in (
            ("mean_mm", mean),
            ("median_mm", median),
            ("p95_mm", p95),
            ("mean_reward", reward),
        ):
            self.logger.record(f"evaluation/{name}", value)
        with self.run.evaluations.open("a", newline="") as stream:
            csv.writer(stream).writerow([self.num_timesteps, mean, median, p95, reward])
        is_best = mean < self.best
        self.show(f"{self.num_timesteps:>9} steps: mean tip error {mean:6.2f} mm{'  (best so far)' if is_best else ''}")
        if is_best:
            self.best = mean
            save_policy(self.model, self.run, "best")


class FinalError(BaseCallback):
    """Logs the tip error at the end of the training episodes (rollout/final_error_mm)."""

    def _on_step(self) -> bool:
        return True

    def _on_rollout_end(self) -> None:
        finished = [episode["error_mm"] for episode in self.model.ep_info_buffer or ()]
        if finished:
            self.logger.record("rollout/final_error_mm", float(np.mean(finished)))


class Progress(BaseCallback):
    """A progress bar on the terminal; nothing where standard error is no terminal, or in CI."""

    def _on_training_start(self) -> None:
        hidden = not sys.stderr.isatty() or "CI" in os.environ
        total = self.locals["total_timesteps"]
        self.bar = tqdm(total=total, unit=" steps", unit_scale=True, disable=hidden, dynamic_ncols=True)

    def _on_step(self) -> bool:
        self.bar.update(min(self.num_timesteps, self.bar.total) - self.bar.n)
        return True

    def _on_training_end(self) -> None:
        self.bar.close()


class StopOnSignal(BaseCallback):
    """Ends training in good order after SIGINT (Ctrl-C) or SIGTERM; a second one interrupts at once.

    A context manager: the handlers are in place inside it. `signal` is what arrived, or None.
    """

    SIGNALS = (signal.SIGINT, signal.SIGTERM)

    def __init__(self) -> None:
        super().__init__()
        self.signal: signal.Signals | None = None

    def __enter__(self) -> StopOnSignal:
        self.handlers = {number: signal.signal(number, self._stop) for number in self.SIGNALS}
        return self

    def __exit__(self, *exception: object) -> None:
        for number, handler in self.handlers.items():
            signal.signal(number, handler)

    def _stop(self, number: int, frame: object) -> None:
        if self.signal is not None:
            raise KeyboardInterrupt
        self.signal = signal.Signals(number)

    def _on_step(self) -> bool:
        return self.signal is None
