"""Search hyper-parameters: rj tune --config ppo_tracking --study studies/ppo.

A study is a folder. The same command continues it; several processes may work on it at once.

    study.yaml           the complete study
    journal.log          every trial (Optuna)
    trials/NNNN/seed-S/  the run folders of the trials, without checkpoints
    best.yaml            the best trial as a configuration for rj train
    report.md            the results, with history.png and parameters.png
    lock                 held for a moment when a trial begins or ends
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from agents.executors.options import add_options
from agents.runs.checks import optional
from agents.runs.command_line import exit_code, typed_command
from agents.runs.consent import add_consent, consent_of
from agents.runs.ready_made import TUNE, add_list, configuration_file


def main(argv: Sequence[str] | None = None) -> int:
    """Exit code of the command: 0 searched, 2 an error, 128 + signal stopped by Ctrl-C or SIGTERM."""
    parser = argparse.ArgumentParser(prog="rj tune", description="Search hyper-parameters.")
    add_list(parser, TUNE)
    parser.add_argument(
        "--config", help="YAML file, or the name of one of configs/tune/; not needed to continue a study"
    )
    parser.add_argument("--study", type=Path, required=True, help="the folder of the study, new or existing")
    parser.add_argument("--trials", type=int, help="trials of the whole study; 0 only shows what would be searched")
    parser.add_argument("--storage", default="", metavar="URL", help="of Optuna, instead of journal.log in the folder")
    add_options(parser, "trials", jobs=1)
    add_consent(parser, pickles=False)
    arguments = parser.parse_args(argv)
    return exit_code(lambda: _command(arguments, typed_command("rj tune", argv)), consent_of(arguments), "train")


def _command(arguments: argparse.Namespace, command: Sequence[str]) -> int:
    from agents.tuning.folder import StudyFolder
    from agents.tuning.study import trial_count
    from agents.tuning.trials import tune

    count = optional(trial_count)("--trials", arguments.trials)
    folder = StudyFolder(arguments.study, arguments.storage)
    config = folder.config(arguments.config and configuration_file(TUNE, arguments.config))
    trials = config.trials if count is None else count
    if trials == 0:
        print("\n".join(f"{key}: {values}" for key, values in config.space.items()))
        return 0
    return tune(config, folder, trials, command, arguments.jobs, arguments.cluster)


if __name__ == "__main__":
    sys.exit(main())
