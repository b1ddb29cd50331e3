"""Search hyper-parameters: python -m agents.tune --config configs/tune/ppo_tracking.yaml --study studies/ppo.

A study is a folder. The same command goes on with it; several processes may work on it at once.

    study.yaml           what is searched, complete
    journal.log          every trial (Optuna)
    trials/NNNN/seed-S/  the run folders of the trials, without checkpoints
    best.yaml            the best trial as a configuration for agents.train
    report.md            what was found, with history.png and parameters.png
    lock                 held for a moment when a trial begins or ends
"""

from __future__ import annotations

import argparse
import csv
import math
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from agents.runs.command_line import exit_code
from agents.runs.file_lock import file_lock
from agents.runs.folder import RunFolder, RunFolderError, typed_command, write_text
from agents.tuning.study import StudyConfig, load_study
from rollingjoint.checked_yaml import dump_yaml
from rollingjoint.errors import ConfigError

if TYPE_CHECKING:
    from optuna.study import Study
    from optuna.trial import Trial

    from agents.training.callbacks import StopOnSignal

KILLED = "its process ended"


def main(argv: Sequence[str] | None = None) -> int:
    """Exit code of the command: 0 searched, 2 an error, 128 + signal stopped by Ctrl-C or SIGTERM."""
    parser = argparse.ArgumentParser(prog="python -m agents.tune", description="Search hyper-parameters.")
    parser.add_argument(
        "--config", type=Path, help="YAML file, for example one of configs/tune/; not for a study begun"
    )
    parser.add_argument("--study", type=Path, required=True, help="the folder of the study, new or begun")
    parser.add_argument("--trials", type=int, help="trials of the whole study; 0 only shows what would be searched")
    arguments = parser.parse_args(argv)
    return exit_code(lambda: _command(arguments, typed_command("agents.tune", argv)))


def _command(arguments: argparse.Namespace, command: Sequence[str]) -> int:
    if arguments.trials is not None and arguments.trials < 0:
        raise ConfigError("--trials", arguments.trials, "an integer >= 0")
    folder = StudyFolder(arguments.study)
    config = folder.config(arguments.config)
    trials = config.trials if arguments.trials is None else arguments.trials
    if trials == 0:
        print("\n".join(f"{key}: {values}" for key, values in config.space.items()))
        return 0
    folder.begin(config)
    return tune(config, folder, trials, command)


@dataclass(frozen=True)
class StudyFolder:
    """Paths of a study, and its journal."""

    path: Path

    def config(self, file: Path | None) -> StudyConfig:
        """What the study searches; raises ConfigError where `file` says something else than the study that is there."""
        begun = self.path / "study.yaml"
        if file is None and not begun.is_file():
            raise ConfigError("--config", None, f"a YAML file, since no study is in {self.path}")
        config = load_study(begun if file is None else file)
        if begun.is_file() and replace(load_study(begun), trials=config.trials) != config:
            hint = "Leave --config out to go on with the study, or give another --study."
            raise ConfigError("--config", str(file), f"what the study in {self.path} began with", hint)
        return config

    def begin(self, config: StudyConfig) -> None:
        """Make the folder, unless the study is there; raises RunFolderError for a folder that holds something else."""
        if not (self.path / "study.yaml").is_file():
            own = (".study.yaml", "lock")  # another process may just begin it
            if self.path.exists() and not all(path.name.startswith(own) for path in self.path.iterdir()):
                raise RunFolderError("study", str(self.path), "a new folder, or one with a study", "It stays as it is.")
            write_text(self.path / "study.yaml", dump_yaml(config.to_dict()))

    def journal(self, config: StudyConfig) -> Study:
        """The study as Optuna knows it, in a file that several processes may write."""
        import optuna

        from agents.tuning.journal import journal_storage

        optuna.logging.set_verbosity(optuna.logging.WARNING)
        pruners = {
            "median": optuna.pruners.MedianPruner(n_startup_trials=config.startup),
            "halving": optuna.pruners.SuccessiveHalvingPruner(),
            "none": optuna.pruners.NopPruner(),
        }
        storage = journal_storage(self.path / "journal.log")
        return optuna.create_study(
            storage=storage, study_name="study", load_if_exists=True, pruner=pruners[config.pruner]
        )

    def trial(self, number: int) -> Path:
        """Folder of a trial."""
        return self.path / "trials" / f"{number:04d}"


def tune(config: StudyConfig, folder: StudyFolder, trials: int, command: Sequence[str] = ()) -> int:
    """Work on the study until it has so many trials, then write its results; the exit code."""
    from optuna.trial import TrialState

    from agents.training.callbacks import StopOnSignal
    from agents.tuning.report import write_results

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
    import optuna

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
    from optuna.trial import TrialState

    trials = study.get_trials(deepcopy=False)
    return sum(t.state != TrialState.WAITING and t.user_attrs.get("reason") != KILLED for t in trials)


def _put_lost_trials_back(study: Study, folder: StudyFolder) -> None:
    """Mark trials whose process ended as failed, and queue their values again, once."""
    from optuna.trial import Trial, TrialState

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
        except BlockingIOError:
            pass


def _try(study: Study, trial: Trial, config: StudyConfig, folder: StudyFolder, stop: StopOnSignal) -> float | str:
    """The score of the trial, or why it has none. A full disk or a signal ends the study; the trial is not lost."""
    from optuna import TrialPruned

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
    from optuna import TrialPruned

    from agents.train import learn
    from agents.training.build import build_model, close
    from agents.training.callbacks import Evaluation, FinalError, Progress
    from agents.training.log import training_log

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
        evaluation = Evaluation(run, train, show=lambda line: None, watch=watch)
        with ExitStack() as stack:
            stack.callback(logger.close)
            learn(model, train, [stop, Progress(), FinalError(), evaluation])
    finally:
        close(model)
    if stop.signal is not None:
        raise KeyboardInterrupt
    if behind:
        raise TrialPruned
    return _last_score(run, config.score)


def _last_score(run: RunFolder, score: str) -> float:
    with run.evaluations.open(newline="") as stream:
        last = list(csv.DictReader(stream))[-1]
    if not math.isfinite(float(last[score])):
        raise ArithmeticError(f"{score} is {last[score]} after {last['steps']} steps")
    return float(last[score])


def _told(study: Study, trial: Trial, outcome: float | str) -> str:
    """Tell the study how the trial ended; the line about it."""
    from optuna.trial import TrialState

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


if __name__ == "__main__":
    sys.exit(main())
