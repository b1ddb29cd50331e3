"""Callbacks of training: checkpoints, evaluations, progress, stopping on a signal."""

from __future__ import annotations

import csv
import signal
from collections.abc import Callable
from typing import Any

import numpy as np
from stable_baselines3.common.callbacks import BaseCallback
from tqdm import tqdm

from agents.controllers.residual import controller_of
from agents.evaluation.rollout import Episodes, run_episodes
from agents.policies.trained import policy_of
from agents.runs.additions import class_of, made
from agents.runs.command_line import STOPPING, progress_bar
from agents.runs.config import TrainConfig
from agents.runs.environment import COLUMNS, in_words
from agents.runs.folder import RunFolder
from agents.training import checkpoint
from agents.training.checkpoint import Moment, save_policy

Row = dict[str, float]
Watch = Callable[[Row], bool]


def due_after(every: int, steps: int) -> int:
    """The first multiple of `every` beyond `steps`."""
    return every * (steps // every + 1)


class StopOnSignal(BaseCallback):
    """Ends training cleanly after SIGINT (Ctrl-C) or SIGTERM (Windows: SIGBREAK); a second one interrupts at once.

    Training continues to the end of the rollout, from where it can be resumed exactly. A context manager: the
    handlers are in place inside it. `signal` is the one that arrived, or None.
    """

    def __init__(self) -> None:
        super().__init__()
        self.signal: signal.Signals | None = None
        self.ends = False

    def __enter__(self) -> StopOnSignal:
        self.handlers = {number: signal.signal(number, self._stop) for number in STOPPING}
        return self

    def __exit__(self, *exception: object) -> None:
        for number, handler in self.handlers.items():
            signal.signal(number, handler)

    def _stop(self, number: int, frame: object) -> None:
        if self.signal is not None:
            raise KeyboardInterrupt
        self.signal = signal.Signals(number)

    def _on_rollout_start(self) -> None:
        self.ends = self.signal is not None

    def _on_step(self) -> bool:
        return not self.ends


class Checkpoints(BaseCallback):
    """Saves a checkpoint at the start of a rollout: every `every` steps or a little later, and when training stops.

    Args:
        moment: for a resumed run, the state to restore at the start of its first rollout.
    """

    def __init__(self, run: RunFolder, every: int, stop: StopOnSignal, moment: Moment | None = None) -> None:
        super().__init__()
        self.run, self.every, self.stop, self.moment = run, every, stop, moment

    def _on_training_start(self) -> None:
        self.next = due_after(self.every, self.model.num_timesteps)

    def _on_rollout_start(self) -> None:
        steps = self.model.num_timesteps
        if self.moment is not None:
            self.moment.restore(self.model)
            self.moment = None
        if steps >= self.next or self.stop.ends:
            self.next = due_after(self.every, steps)
            checkpoint.save(self.model, self.run)

    def _on_step(self) -> bool:
        return True


class Evaluator(BaseCallback):
    """Evaluates the deterministic policy on fixed seeds, at regular intervals and at the end, and keeps the best one.

    Not where a signal ends training: an evaluation may take seconds, and the resumed run does not count it. The policy
    is then the best one if there is no other.

    The tip errors go to evaluations.csv, in one line to `show`, and to the training log (evaluation/...). The best
    policy has the smallest mean error over the last 10 steps in tracking tasks, else at the end (RunFolder.judged_by).

    Args:
        watch: called with every new row of evaluations.csv but the last; True ends training.
    """

    def __init__(
        self,
        run: RunFolder,
        config: TrainConfig,
        stop: StopOnSignal,
        show: Callable[[str], Any] = tqdm.write,
        watch: Watch | None = None,
    ) -> None:
        super().__init__()
        self.run, self.config, self.stop, self.show, self.watch = run, config, stop, show, watch
        self.seeds = config.evaluation.seeds

    def _on_training_start(self) -> None:
        self.next = due_after(self.config.evaluation.every, self.model.num_timesteps)
        if not self.run.evaluations.is_file():
            self._write(COLUMNS)
        self.columns, self.judged_by = self.run.evaluated, self.run.judged_by
        with self.run.evaluations.open(encoding="utf-8", newline="") as stream:
            self.best = min((float(row[self.judged_by]) for row in csv.DictReader(stream)), default=np.inf)

    def _on_step(self) -> bool:
        if self.next <= self.num_timesteps < self.locals["total_timesteps"]:
            self.next = due_after(self.config.evaluation.every, self.num_timesteps)
            row = self.evaluate()
            return self.watch is None or not self.watch(row)
        return True

    def _on_training_end(self) -> None:
        if not self.stop.ends:
            self.evaluate()
        elif not self.run.policy_files("best").are_there:
            save_policy(self.model, self.run.policy_files("best"))
        self.logger.dump(self.num_timesteps)

    def evaluate(self) -> Row:
        """Score the policy as it is now: the new row of evaluations.csv."""
        policy = controller_of(self.config, policy_of(self.model, self.model.get_vec_normalize_env()))
        row = self._row(run_episodes(self.config.env, policy, self.seeds))
        for name in self.columns[1:]:
            self.logger.record(f"evaluation/{name}", row[name])
        self._write([row[name] for name in self.columns])
        error = row[self.judged_by]
        is_best = error < self.best
        best = "  (best so far)" if is_best else ""
        self.show(f"{self.num_timesteps:>9} steps: {in_words(self.judged_by, error)}{best}")
        if is_best:
            self.best = error
            save_policy(self.model, self.run.policy_files("best"))
        return row

    def _row(self, episodes: Episodes) -> Row:
        """Values of these episodes, by column; a run begun by an older version keeps the columns that it has."""
        final = episodes.final_errors
        last, rewards = float(episodes.last_errors.mean()), float(episodes.rewards.mean())
        errors = float(final.mean()), float(np.median(final)), float(np.percentile(final, 95)), last
        values = dict(zip(COLUMNS, (self.num_timesteps, *errors, rewards), strict=True))
        return {name: values[name] for name in self.columns}

    def _write(self, row: Any) -> None:
        with self.run.evaluations.open("a", encoding="utf-8", newline="") as stream:
            csv.writer(stream).writerow(row)


def added(config: TrainConfig) -> list[BaseCallback]:
    """The callbacks that a configuration names; raises ConfigError for one that cannot be made."""
    place = {"": "stable_baselines3.common.callbacks"}
    named = [pair for each in config.callbacks for pair in each.items()]
    kinds = [class_of("callbacks", name, place, (BaseCallback,)) for name, _ in named]
    return [made(f"callbacks: {name}", kind, arguments) for kind, (name, arguments) in zip(kinds, named, strict=True)]


class FinalError(BaseCallback):
    """Logs the tip error at the end of the training episodes (rollout/final_error_mm)."""

    def _on_step(self) -> bool:
        return True

    def _on_rollout_end(self) -> None:
        finished = [episode["error_mm"] for episode in self.model.ep_info_buffer or ()]
        if finished:
            self.logger.record("rollout/final_error_mm", float(np.mean(finished)))


class TrainingProgress(BaseCallback):
    """A progress bar on the terminal; hidden where standard error is not a terminal, and in CI."""

    def _on_training_start(self) -> None:
        total, done = self.locals["total_timesteps"], self.model.num_timesteps
        self.bar = progress_bar(total, " steps", initial=done, unit_scale=True)

    def _on_step(self) -> bool:
        self.bar.update(min(self.num_timesteps, self.bar.total) - self.bar.n)
        return True

    def _on_training_end(self) -> None:
        self.bar.close()
