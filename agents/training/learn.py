"""Training a new run, or resuming one."""

from __future__ import annotations

import sys
import traceback
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback

from agents.runs.algorithms import ON_POLICY
from agents.runs.config import TrainConfig
from agents.runs.consent import import_options
from agents.runs.files import RunFolderError, seal, unseal, write_text
from agents.runs.folder import RunFolder
from agents.training import checkpoint
from agents.training.build import close
from agents.training.callbacks import Checkpoints, Evaluator, FinalError, StopOnSignal, TrainingProgress, added
from agents.training.checkpoint import Moment
from agents.training.log import training_log
from agents.training.start import fresh_model
from agents.training.tracking import tracked, wandb_of
from rollingjoint.errors import ConfigError, RollingJointError


class TrainingError(RollingJointError):
    """Training that failed midway."""


def train(config: TrainConfig, path: Path, command: Sequence[str] = (), force: bool = False) -> int:
    """Train into a run folder at `path`; the exit code. Raises RollingJointError."""
    check_additions(config)
    model = fresh_model(config)
    run = RunFolder.create(path, config, command, force)
    with run.locked():
        return _train(model, config, run)


def resume(path: Path, overrides: Sequence[str] = (), command: Sequence[str] = ()) -> int:
    """Resume the run at `path`, or say that it is finished; the exit code. Raises RollingJointError.

    Args:
        overrides: none, or "total_timesteps=N", the new end of the run.
    """
    run = RunFolder.open(path)
    with run.locked():
        newest = checkpoint.newest(run)
        done = checkpoint.steps_of(newest) if newest else 0
        config = _resumed_config(run, overrides, done)
        if done >= config.total_timesteps:
            print(f"The run in {path} is finished: {done} steps. To train on: --set total_timesteps=N")
            return 0
        check_additions(config)
        run.tidy()
        moment = None
        if newest:
            model, moment = checkpoint.load(newest, config)
            checkpoint.bring_back_files(newest, run)
        else:
            _check_nothing_is_lost(run)
            model = fresh_model(config)
            run.restart()
        run.extend(config.total_timesteps, command)
        return _train(model, config, run, moment)


def check_additions(config: TrainConfig) -> None:
    """Raise ConfigError, or name the extra, before training begins, for callbacks or a tracker that cannot be had."""
    added(config)
    if config.tracker is not None:
        wandb_of()


def _resumed_config(run: RunFolder, overrides: Sequence[str], done: int) -> TrainConfig:
    before, config = run.config(), run.config(overrides)
    if replace(config, total_timesteps=before.total_timesteps) != before:
        hint = "For any other change begin a new run from its config.yaml."
        raise ConfigError("--set", " ".join(overrides), "total_timesteps=N and nothing else with --resume", hint)
    if overrides and config.total_timesteps < done:
        raise ConfigError("--set", " ".join(overrides), f"no fewer than the {done} steps that are done")
    return config


def _check_nothing_is_lost(run: RunFolder) -> None:
    """Raise RunFolderError if there is a policy but no checkpoint to resume from."""
    if run.checkpoint_folders or run.policy_files("last").are_there:
        hint = "To start over: --config with --force."
        raise RunFolderError("run folder", str(run.path), "a run with a checkpoint that can be resumed", hint)


def _train(model: BaseAlgorithm, config: TrainConfig, run: RunFolder, moment: Moment | None = None) -> int:
    origin = f"from step {model.num_timesteps} on, " if moment else ""
    print(
        f"{config.algorithm.upper()}, {config.total_timesteps} steps of {config.env.id}, {origin}into {run.path}",
        flush=True,
    )
    if note := config.why_scalar:
        print(f"note: {note}", file=sys.stderr)
    with tracked(config, run), StopOnSignal() as stop:
        try:
            _learn_and_save(model, config, run, stop, moment)
        except Exception as error:
            raise _broken_off(error, model, run) from error
        finally:
            close(model)
    if stop.signal is not None:
        print(f"stopped by {stop.signal.name} after {model.num_timesteps} steps; the policy so far is saved.")
        if checkpoint.resumable(run):
            print(f"To go on: rj train --resume {run.path}{import_options()}")
    print(f"The run is in {run.path}\nNext: rj evaluate {run.path}{import_options()}")
    return 0 if stop.signal is None else 128 + stop.signal


def _learn_and_save(
    model: BaseAlgorithm, config: TrainConfig, run: RunFolder, stop: StopOnSignal, moment: Moment | None
) -> None:
    unseal(*run.tables)
    logger = training_log(run, model.num_timesteps)
    model.set_logger(logger)
    checkpoints = Checkpoints(run, config.checkpoint_every, stop, moment)
    callbacks = [stop, TrainingProgress(), FinalError(), checkpoints, Evaluator(run, config, stop), *added(config)]
    try:
        learn(model, config, callbacks)
    except KeyboardInterrupt:
        print("stopped at once, in the middle of an update", file=sys.stderr)
    finally:
        logger.close()
    checkpoint.save_policy(model, run.policy_files("last"))
    seal(*run.tables)
    if model.num_timesteps >= config.total_timesteps:
        checkpoint.save(model, run)


def learn(model: BaseAlgorithm, config: TrainConfig, callbacks: Sequence[BaseCallback]) -> None:
    """Train the model until config.total_timesteps, from its current step."""
    remaining = config.total_timesteps - model.num_timesteps
    # rollouts, or episodes where learning goes on within them, per row of the log
    rare = {name: 1 for name in ON_POLICY} | {"apg": 20, "distill": 1}
    often = rare.get(config.algorithm, max(4, config.env.n_envs))
    model.learn(remaining, list(callbacks), log_interval=often, reset_num_timesteps=model._last_obs is None)


def _broken_off(error: Exception, model: BaseAlgorithm, run: RunFolder) -> TrainingError:
    """The error for training that failed; the traceback goes to error.txt if that helps and the disk has room."""
    text = f"training broke off after {model.num_timesteps} steps: "
    if isinstance(error, OSError):
        text += str(error)
    else:
        with suppress(OSError):
            write_text(run.path / "error.txt", traceback.format_exc())
        text += f"{error!r}; all of it is in {run.path}/error.txt"
    checkpoints = checkpoint.resumable(run)
    if checkpoints:
        text += f". From step {checkpoint.steps_of(checkpoints[0])} on: rj train --resume {run.path}{import_options()}"
    return TrainingError(text)
