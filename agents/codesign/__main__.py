"""Co-design a mechanism and its policy: rj codesign lumen --out runs/codesign/lumen.

Pairs are trained with every seed by one gradient, and compared with the best design of every mechanical objective and
a policy of its own. The same command continues what was interrupted; at the end report.md describes the results.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from agents.executors.progress import Progress
from agents.runs.command_line import exit_code, finished, signals_seen, typed_command
from agents.runs.consent import add_consent, consent_of
from agents.runs.ready_made import CODESIGN, add_configuration, given_files
from rollingjoint.errors import naming_extras


def main(argv: Sequence[str] | None = None) -> int:
    """Exit code of the command: 0 all finished, 2 an error, 130 stopped by Ctrl-C or SIGTERM."""
    parser = argparse.ArgumentParser(prog="rj codesign", description="Co-design a mechanism and its policy.")
    add_configuration(parser, CODESIGN)
    parser.add_argument("--force", action="store_true", help="restart what is there")
    add_consent(parser, pickles=False)
    arguments = parser.parse_args(argv)
    return exit_code(lambda: _command(arguments, typed_command("rj codesign", argv)), consent_of(arguments))


@naming_extras("search")
def _command(arguments: argparse.Namespace, command: Sequence[str]) -> int:
    import torch

    from agents.codesign.config import load_codesign
    from agents.codesign.report import verdict, write_report
    from agents.codesign.study import Study, results_of

    torch.set_num_threads(1)
    file, out = given_files(arguments, CODESIGN)
    study = Study.begin(out, load_codesign(file), command, arguments.force)
    with study.locked(), signals_seen() as signals:
        units = list(study.units())
        with Progress(len(units), "unit") as progress:
            for unit in units:
                if signals:
                    break
                if not study.is_finished(unit):
                    progress.running = 1
                    found = study.work(unit, progress.show)
                    progress.write(f"{unit}: {_told(study, found)}, {found['seconds']:.1f} s")
                progress.done, progress.running = progress.done + 1, 0
                progress.show()
        stopped = signals and not all(map(study.is_finished, units))
        if "joint" in results_of(study):
            write_report(out)
        if stopped:
            return finished(len(units), {}, signals, command)
    print(verdict(study, results_of(study)))
    print(f"The report is in {out / 'report.md'}; rj export {out / 'winner.yaml'} --out DIR draws the winner for CAD")
    return 0


def _told(study: object, found: dict[str, object]) -> str:
    validation = found.get("validation")
    return (
        f"validation {validation:.4g}"
        if isinstance(validation, float)
        else "no pair"
        if "test" in found
        else "a design"
    )


if __name__ == "__main__":
    sys.exit(main())
