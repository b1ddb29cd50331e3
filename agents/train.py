"""Train a controller: python -m agents.train --config configs/train/ppo_rolling_joint.yaml."""

from __future__ import annotations

import argparse
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from agents.command_line import exit_code
from agents.config import TrainConfig, load_config
from agents.run_folder import RunFolder, typed_command, write_text
from rollingjoint.errors import RollingJointError

if TYPE_CHECKING:
    from stable_baselines3.common.base_class import BaseAlgorithm

    from agents.callbacks import StopOnSignal


class TrainingError(RollingJointError):
    """Training that broke off."""


def main(argv: Sequence[str] | None = None) -> int:
    """Exit code of the command: 0 trained, 2 an error, 128 + signal stopped by Ctrl-C or SIGTERM."""
    parser = argparse.ArgumentParser(prog="python -m agents.train", description="Train a controller.")
    parser.add_argument("--config", type=Path, required=True, help="YAML file, for example one of configs/train/")
    parser.add_argument("--run-dir", type=Path, help="the run folder (default: runs/ and the name of the config)")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="section.key=value, repeatable")
    parser.add_argument("--force", action="store_true", help="replace the run that is in the run folder")
    arguments = parser.parse_args(argv)
    return exit_code(lambda: _command(arguments, typed_command("agents.train", argv)))


def _command(arguments: argparse.Namespace, command: Sequence[str]) -> int:
    config = load_config(arguments.config, arguments.set)
    path = arguments.run_dir or Path("runs") / arguments.config.stem
    RunFolder.check_free(path, arguments.force)
    return train(config, path, command, arguments.force)


def train(config: TrainConfig, path: Path, command: Sequence[str] = (), force: bool = False) -> int:
    """Train into a run folder at `path`; the exit code. Raises RollingJointError."""
    from agents.build import build_model, close
    from agents.callbacks import StopOnSignal, save_policy

    model = build_model(config)
    run = RunFolder.create(path, config, command, force)
    print(
        f"{config.algorithm.upper()}, {config.total_timesteps} steps of {config.env.id}, into {run.path}",
        flush=True,
    )
    with StopOnSignal() as stop:
        try:
            _learn(model, config, run, stop)
        except KeyboardInterrupt:
            print("stopped at once, in the middle of an update", file=sys.stderr)
        except Exception as error:
            write_text(run.path / "error.txt", traceback.format_exc())
            step = f"after {model.num_timesteps} steps"
            raise TrainingError(
                f"training broke off {step}: {error!r}; all of it is in {run.path}/error.txt"
            ) from error
        finally:
            close(model)
        save_policy(model, run, "last")
    if stop.signal is not None:
        print(f"stopped by {stop.signal.name} after {model.num_timesteps} steps; the policy so far is saved.")
    print(f"The run is in {run.path}\nNext: python -m agents.evaluate {run.path}")
    return 0 if stop.signal is None else 128 + stop.signal


def _learn(model: BaseAlgorithm, config: TrainConfig, run: RunFolder, stop: StopOnSignal) -> None:
    from stable_baselines3.common.logger import configure

    from agents.callbacks import Checkpoints, Evaluation, FinalError, Progress

    logger = configure(str(run.logs), ["csv", "tensorboard"])
    model.set_logger(logger)
    checkpoints = Checkpoints(run, config.checkpoint_every)
    try:
        model.learn(config.total_timesteps, [stop, Progress(), FinalError(), checkpoints, Evaluation(run, config)])
    finally:
        logger.close()


if __name__ == "__main__":
    sys.exit(main())
