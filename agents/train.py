"""Train a controller: rj train ppo_rolling_joint, or rj train --config my.yaml.

Configurations are YAML files or ready-made ones by their names; --list names them, and --write copies one.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from agents.runs.command_line import exit_code, typed_command
from agents.runs.config import load_config
from agents.runs.consent import add_consent, consent_of
from agents.runs.folder import RunFolder
from agents.runs.ready_made import TRAIN, configuration_file, copied, list_of
from rollingjoint.errors import ConfigError


def main(argv: Sequence[str] | None = None) -> int:
    """Exit code of the command: 0 trained, 2 an error, 128 + signal stopped by Ctrl-C or SIGTERM."""
    parser = argparse.ArgumentParser(prog="rj train", description="Train a controller.")
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("name", nargs="?", metavar="CONFIG", help="YAML file, or the name of a ready-made configuration")
    what.add_argument("--config", metavar="CONFIG", help="the same")
    what.add_argument("--list", action="store_true", help="name the ready-made configurations (configs/train/)")
    what.add_argument("--resume", type=Path, metavar="RUN", help="continue the run in this run folder")
    parser.add_argument("--write", type=Path, metavar="FILE", help="copy the ready-made configuration only")
    parser.add_argument("--run-dir", type=Path, help="the run folder (default: runs/ and the name of the config)")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="section.key=value, repeatable")
    parser.add_argument("--force", action="store_true", help="replace the run that is in the run folder")
    add_consent(parser)
    arguments = parser.parse_args(argv)
    return exit_code(lambda: _command(arguments, typed_command("rj train", argv)), consent_of(arguments), "train")


def _command(arguments: argparse.Namespace, command: Sequence[str]) -> int:
    name = arguments.name or arguments.config
    if arguments.write is not None and name is None:
        raise ConfigError("--write", str(arguments.write), "the name of a ready-made configuration beside it")
    if arguments.list:
        print(list_of(TRAIN))
        return 0
    if arguments.resume is not None:
        if arguments.force or arguments.run_dir is not None:
            option = "--force" if arguments.force else "--run-dir"
            raise ConfigError("--resume", str(arguments.resume), f"no {option} beside it", "Resuming keeps the run.")
        from agents.training.learn import resume

        return resume(arguments.resume, arguments.set, command)
    if arguments.write is not None:
        copied(name, arguments.write)
        print(f"{arguments.write}: edit it, then rj train {arguments.write}")
        return 0
    file = configuration_file(TRAIN, name)
    config = load_config(file, arguments.set)
    path = arguments.run_dir or Path("runs") / file.stem
    RunFolder.check_free(path, arguments.force)
    from agents.training.learn import train

    return train(config, path, command, arguments.force)


if __name__ == "__main__":
    sys.exit(main())
