"""The trials of a study: claimed and recorded here, trained by an executor. Trials of killed processes are repeated."""

from __future__ import annotations

import math
import signal
import time
from collections.abc import Iterator, Mapping, MutableSequence, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import optuna
from filelock import Timeout
from optuna import TrialPruned
from optuna.study import Study
from optuna.trial import Trial, TrialState

from agents.executors.driver import work_through
from agents.executors.folders import FolderUnit, Home, marked
from agents.executors.options import LOCAL, executor_of
from agents.executors.progress import Progress
from agents.executors.protocol import Executor, UnitFailed, WorkerLost
from agents.runs.command_line import signals_seen
from agents.runs.files import RunFolderError, read_rows
from agents.runs.folder import RunFolder
from agents.runs.locks import file_lock
from agents.training.build import close
from agents.training.callbacks import Evaluator, FinalError, StopOnSignal, added
from agents.training.learn import learn
from agents.training.log import training_log
from agents.training.start import earlier_policy, fresh_model
from agents.tuning.folder import StudyFolder
from agents.tuning.report import write_results
from agents.tuning.study import StudyConfig

KILLED = "its process ended"


def tune(
    config: StudyConfig,
    folder: StudyFolder,
    trials: int,
    command: Sequence[str] = (),
    jobs: int = 1,
    cluster: str = LOCAL,
) -> int:
    """Begin the study or go on until it has `trials` trials, then write its results; the exit code.

    Args:
        jobs: trials at a time in processes of this machine; 1: in this one. cluster: as for agents.executors.options.
    Raises:
        RollingJointError: no trial finished, no such cluster, no policy to start from, or a folder that holds something
            else.
    """
    if cluster == LOCAL:  # other machines look for `start_from` themselves
        earlier_policy(config.train)
    folder.begin(config)
    study = folder.journal(config)
    with executor_of(cluster, jobs, inline=True) as executor, signals_seen() as signals:
        _work(executor, study, config, folder, trials, signals)
    write_results(study, config, folder.path, command)
    if signals:
        print(f"stopped by {signal.Signals(signals[0]).name}; to go on: rj tune --study {folder.path}")
        return 128 + signals[0]
    if not study.get_trials(deepcopy=False, states=[TrialState.COMPLETE]):
        raise RunFolderError(
            "study", str(folder.path), "one trial at least that finishes", "report.md says why none did."
        )
    print(f"The best trial is in {folder.path / 'best.yaml'}, the report in {folder.path / 'report.md'}")
    print(f"Next: rj train --config {folder.path / 'best.yaml'} --run-dir runs/best")
    return 0


@dataclass(frozen=True)
class TrialUnit(FolderUnit):
    """The training of one trial, in its folder; the lock of the trial is held meanwhile.

    Args:
        trial: as Optuna knows it. held: resources to close after the result of the trial is stored.
    """

    waits: bool = False
    trial: Any = None
    held: ExitStack = field(default_factory=ExitStack)


class Tried(NamedTuple):
    """The result of a training: its score, or its failure, or PRUNED; reports by step; seconds."""

    outcome: float | str
    reports: Mapping[int, float]
    seconds: float


PRUNED = "pruned"


def _work(
    executor: Executor,
    study: Study,
    config: StudyConfig,
    folder: StudyFolder,
    trials: int,
    signals: MutableSequence[int],
) -> None:
    missing, broken = max(trials - _begun(study), 0), None
    with ExitStack() as held, marked(folder.path) as home, Progress(missing, "trial") as progress:
        units = _claimed(study, config, folder, trials, home, held)
        for ended in work_through(executor, units, progress, signals):
            if ended.failure and not isinstance(ended.error, WorkerLost):  # no fault of the trial: a full disk
                broken = ended
                signals.append(signal.SIGINT)  # the others end in good order
                continue
            progress.write(_store(study, ended.unit.trial, ended.value or Tried(ended.failure, {}, 0.0)))
            ended.unit.held.close()
    if broken is not None:
        raise UnitFailed(broken.failure) from broken.error


def _claimed(
    study: Study, config: StudyConfig, folder: StudyFolder, trials: int, home: Home, held: ExitStack
) -> Iterator[TrialUnit]:
    """New trials, until the study has enough of them."""
    while True:
        resources = held.enter_context(ExitStack())
        with file_lock(folder.path / "lock", wait=True):
            _put_lost_trials_back(study, folder)
            if _begun(study) >= trials:
                return
            place = len(study.get_trials(deepcopy=False))
            study.sampler = optuna.samplers.TPESampler(n_startup_trials=config.startup, seed=1000 * config.seed + place)
            trial = study.ask()
            folder.trial(trial.number).mkdir(parents=True, exist_ok=True)
            resources.enter_context(file_lock(folder.trial(trial.number) / "lock"))
        values = config.drawn(trial)
        at = f"trials/{trial.number:04d}"
        remote = StudyFolder(home.path, folder.storage)
        yield TrialUnit(
            f"trial {trial.number}",
            try_in,
            (config, values, remote, trial._trial_id),
            home,
            at,
            trial=trial,
            held=resources,
        )


def _begun(study: Study) -> int:
    """Number of trials that count: all except the waiting and the killed ones."""
    trials = study.get_trials(deepcopy=False)
    return sum(t.state != TrialState.WAITING and t.user_attrs.get("reason") != KILLED for t in trials)


def _put_lost_trials_back(study: Study, folder: StudyFolder) -> None:
    """Mark trials of ended processes as failed, and queue their values again, once."""
    for lost in study.get_trials(deepcopy=False, states=[TrialState.RUNNING]):
        try:
            folder.trial(lost.number).mkdir(parents=True, exist_ok=True)
            with file_lock(folder.trial(lost.number) / "lock"):
                again = lost.user_attrs.get("again", False)
                reason = f"{KILLED} twice" if again else KILLED
                Trial(study, lost._trial_id).set_user_attr("reason", reason)
                study.tell(lost.number, state=TrialState.FAIL)
                if not again:
                    study.enqueue_trial(lost.params, user_attrs={"again": True})
        except Timeout:
            pass


def try_in(path: Path, config: StudyConfig, values: Mapping[str, Any], study: StudyFolder, trial_id: int) -> Tried:
    """Train a trial into its folder. A full disk or a signal ends the study; the trial is not lost.

    Args:
        values: of the keys that are searched. study: where this machine reaches it. trial_id: in Optuna's storage.
    Raises:
        OSError: a full disk, for example.
        ConfigError: the trials are to be compared while they run, and the storage cannot be reached from here.
        KeyboardInterrupt: a signal came.
    """
    trial = Trial(study.reached(config), trial_id) if config.pruner != "none" else None
    reports: dict[int, float] = {}
    start = time.monotonic()
    try:
        scores = [_train(path, config, values, place, trial, reports) for place in range(len(config.training_seeds))]
        outcome: float | str = sum(scores) / len(scores)
    except TrialPruned:
        outcome = PRUNED
    except OSError:
        raise
    except Exception as error:
        outcome = " ".join(f"{type(error).__name__}: {error}".split())
    return Tried(outcome, reports, round(time.monotonic() - start, 1))


def _train(
    path: Path,
    config: StudyConfig,
    values: Mapping[str, Any],
    place: int,
    trial: Trial | None,
    reports: dict[int, float],
) -> float:
    """The score of training with one seed, the last evaluation; raises TrialPruned where it falls behind."""
    seed = config.training_seeds[place]
    train = config.trained(values, seed)
    behind = False

    def watch(row: Mapping[str, float]) -> bool:
        nonlocal behind
        score = row[config.score]
        if math.isfinite(score):
            at = place * train.total_timesteps + row["steps"] // train.evaluation.every * train.evaluation.every
            behind = _falls_behind(trial, reports, int(at), score)
        return behind or not math.isfinite(score)

    model = fresh_model(train)
    try:
        run = RunFolder.create(path / f"seed-{seed}", train, [], force=True)  # a lost worker may have left one
        logger = training_log(run)
        model.set_logger(logger)
        with StopOnSignal() as stop, ExitStack() as stack:
            stack.callback(logger.close)
            evaluator = Evaluator(run, train, stop, show=lambda line: None, watch=watch)
            learn(model, train, [stop, FinalError(), evaluator, *added(train)])
    finally:
        close(model)
    if stop.signal is not None:
        signal.raise_signal(stop.signal)
        raise KeyboardInterrupt
    if behind:
        raise TrialPruned
    return _last_score(run, config.score)


def _falls_behind(trial: Trial | None, reports: dict[int, float], step: int, score: float) -> bool:
    reports[step] = score
    if trial is None:
        return False
    if step not in trial._get_latest_trial().intermediate_values:  # a lost worker may have reported it
        trial.report(score, step)
    return trial.should_prune()


def _last_score(run: RunFolder, score: str) -> float:
    last = read_rows(run.evaluations)[-1]
    if not math.isfinite(float(last[score])):
        raise ArithmeticError(f"{score} is {last[score]} after {last['steps']} steps")
    return float(last[score])


def _store(study: Study, trial: Trial, tried: Tried) -> str:
    """Store the result of a trial in the study; the line about it."""
    trial.set_user_attr("seconds", tried.seconds)
    reported = study.get_trials(deepcopy=False)[trial.number].intermediate_values
    for step, score in tried.reports.items():
        if step not in reported:
            trial.report(score, step)
    if isinstance(tried.outcome, float):
        study.tell(trial, tried.outcome)
        text = f"{tried.outcome:.3f} mm"
    elif tried.outcome == PRUNED:
        study.tell(trial, state=TrialState.PRUNED)
        text = "ended early, it fell behind"
    else:
        trial.set_user_attr("reason", tried.outcome)
        study.tell(trial, state=TrialState.FAIL)
        text = f"failed: {tried.outcome}"
    done = study.get_trials(deepcopy=False, states=[TrialState.COMPLETE])
    best = f"; best: {study.best_value:.3f} mm, trial {study.best_trial.number}" if done else ""
    return f"trial {trial.number:3}: {text} ({tried.seconds:.0f} s{best})"
