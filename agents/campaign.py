"""Train many runs, some at a time: rj campaign results --out runs/results.

Every configuration of the list is trained with each of its seeds, into OUT/CONFIGURATION/seed_K; the output goes to
seed_K.log next to that folder, the command to OUT/command.txt. The same command continues a campaign: finished runs are
kept, interrupted ones are resumed. With --cluster they are trained on a Ray cluster: docs/scaling.md.
"""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Sequence

from agents.executors.options import LOCAL, add_options
from agents.runs.checks import job_count
from agents.runs.command_line import exit_code, typed_command
from agents.runs.consent import add_consent, consent_of
from agents.runs.files import write_text
from agents.runs.ready_made import CAMPAIGN, add_configuration, given_files
from agents.training.campaign import Campaign, load_campaign


def main(argv: Sequence[str] | None = None) -> int:
    """Exit code of the command: 0 all finished, 2 an error or a run that failed, 130 stopped by Ctrl-C or SIGTERM."""
    parser = argparse.ArgumentParser(prog="rj campaign", description="Train many runs.")
    add_configuration(parser, CAMPAIGN)
    add_options(parser, "runs")
    add_consent(parser)
    arguments = parser.parse_args(argv)
    return exit_code(lambda: _command(arguments), consent_of(arguments), "train")


def _command(arguments: argparse.Namespace) -> int:
    jobs = job_count("--jobs", arguments.jobs)
    file, out = given_files(arguments, CAMPAIGN)
    members = load_campaign(file)
    typed = [str(arguments.config), "--out", str(out), "--jobs", str(jobs)]
    typed += [] if arguments.cluster == LOCAL else ["--cluster", arguments.cluster]
    write_text(out / "command.txt", shlex.join(typed_command("rj campaign", typed)) + "\n")
    return Campaign(members, out, jobs, arguments.cluster).train()


if __name__ == "__main__":
    sys.exit(main())
