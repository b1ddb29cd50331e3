"""The trials of a study: claiming, training and recording them; trials of killed processes are queued again."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from typing import Any

import optuna
from filelock import Timeout
from optuna import TrialPruned
from optuna.study import Study
from optuna.trial import Trial, TrialState

from agents.runs.files import RunFolderError, read_rows
from agents.runs.folder import RunFolder
from agents.runs.locks import file_lock
from agents.training.build import build_model, close
from agents.training.callbacks import Evaluator, FinalError, Progress, StopOnSignal
from agents.training.learn import learn
from agents.training.log import training_log
from agents.tuning.folder import StudyFolder
from agents.tuning.report import write_results
from agents.tuning.study import StudyConfig

KILLED = "its process ended"


def tune(config: StudyConfig, folder: StudyFolder, trials: int, command: Sequence[str] = ()) -> int:
    """Work on the study until it has `trials` trials, then write its results; the exit code."""
    study = folder.journal(config)
    with StopOnSignal() as stop:
        try:
            _work(study, config, folder, trials, stop)
        except KeyboardInterrupt:
            print("the trial that was interrupted is queued again", file=sys.stderr)
    write_results(study, config, folder.path, command)
    if stop.signal is not None:
        print(f"stopped by {stop.signal.name}; to go on: python -m agents.tune --study {folder.path}")
        return 128 + stop.signal
    if not study.get_trials(deepcopy=False, states=[TrialState.COMPLETE]):
        raise RunFolderError(
            "study", str(folder.path), "one trial at least that finishes", "report.md says why none did."
        )
    print(f"The best trial is in {folder.path / 'best.yaml'}, the report in {folder.path / 'report.md'}")
    print(f"Next: python -m agents.train --config {folder.path / 'best.yaml'} --run-dir runs/best")
    return 0


def _work(study: Study, config: StudyConfig, folder: StudyFolder, trials: int, stop: StopOnSignal) -> None:
    while stop.signal is None:
        with _claimed(study, config, folder, trials) as trial:
            if trial is None:
                return
            print(_told(study, trial, _try(study, trial, config, folder, stop)), flush=True)


@contextmanager
def _claimed(study: Study, config: StudyConfig, folder: StudyFolder, trials: int) -> Iterator[Trial | None]:
    """A new trial, which holds its lock as long as it is worked on; None if the study has enough of them."""
    with ExitStack() as held:
        trial = None
        with file_lock(folder.path / "lock", wait=True):
            _put_lost_trials_back(study, folder)
            if _begun(study) < trials:
                place = len(study.get_trials(deepcopy=False))
                study.sampler = optuna.samplers.TPESampler(
                    n_startup_trials=config.startup, seed=1000 * config.seed + place
                )
                trial = study.ask()
                folder.trial(trial.number).mkdir(parents=True, exist_ok=True)
                held.enter_context(file_lock(folder.trial(trial.number) / "lock"))
        yield trial


def _begun(study: Study) -> int:
    """Trials that count: not those whose process ended under them."""
    trials = study.get_trials(deepcopy=False)
    return sum(t.state != TrialState.WAITING and t.user_attrs.get("reason") != KILLED for t in trials)


def _put_lost_trials_back(study: Study, folder: StudyFolder) -> None:
    """Mark trials whose process ended as failed, and queue their values again, once."""
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


def _try(study: Study, trial: Trial, config: StudyConfig, folder: StudyFolder, stop: StopOnSignal) -> float | str:
    """The score of the trial, or why it has none. A full disk or a signal ends the study; the trial is not lost."""
    values = config.drawn(trial)
    begun = time.monotonic()
    try:
        scores = [_train(trial, config, values, place, folder, stop) for place in range(len(config.training_seeds))]
        return sum(scores) / len(scores)
    except TrialPruned:
        return "pruned"
    except OSError:
        raise
    except Exception as error:
        return " ".join(f"{type(error).__name__}: {error}".split())
    finally:
        trial.set_user_attr("seconds", round(time.monotonic() - begun, 1))


def _train(
    trial: Trial, config: StudyConfig, values: Mapping[str, Any], place: int, folder: StudyFolder, stop: StopOnSignal
) -> float:
    """The score of training with one seed, the last evaluation; raises TrialPruned where it falls behind."""
    seed = config.training_seeds[place]
    train = config.trained(values, seed)
    behind = False

    def watch(row: Mapping[str, float]) -> bool:
        nonlocal behind
        if math.isfinite(row[config.score]):
            at = place * train.total_timesteps + row["steps"] // train.evaluation.every * train.evaluation.every
            trial.report(row[config.score], int(at))
            behind = trial.should_prune()
        return behind or not math.isfinite(row[config.score])

    model = build_model(train)
    try:
        run = RunFolder.create(folder.trial(trial.number) / f"seed-{seed}", train, [])
        logger = training_log(run)
        model.set_logger(logger)
        evaluator = Evaluator(run, train, show=lambda line: None, watch=watch)
        with ExitStack() as stack:
            stack.callback(logger.close)
            learn(model, train, [stop, Progress(), FinalError(), evaluator])
    finally:
        close(model)
    if stop.signal is not None:
        raise KeyboardInterrupt
    if behind:
        raise TrialPruned
    return _last_score(run, config.score)


def _last_score(run: RunFolder, score: str) -> float:
    last = read_rows(run.evaluations)[-1]
    if not math.isfinite(float(last[score])):
        raise ArithmeticError(f"{score} is {last[score]} after {last['steps']} steps")
    return float(last[score])


def _told(study: Study, trial: Trial, outcome: float | str) -> str:
    """Tell the study how the trial ended; the line about it."""
    if isinstance(outcome, float):
        study.tell(trial, outcome)
        text = f"{outcome:.3f} mm"
    elif outcome == "pruned":
        study.tell(trial, state=TrialState.PRUNED)
        text = "ended early, it fell behind"
    else:
        trial.set_user_attr("reason", outcome)
        study.tell(trial, state=TrialState.FAIL)
        text = f"failed: {outcome}"
    done = study.get_trials(deepcopy=False, states=[TrialState.COMPLETE])
    best = f"; best: {study.best_value:.3f} mm, trial {study.best_trial.number}" if done else ""
    return f"trial {trial.number:3}: {text} ({trial.user_attrs['seconds']:.0f} s{best})"
