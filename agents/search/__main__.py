"""Search designs: rj search demo --out runs/search/demo.

Every method of the file runs with every seed into OUT/METHOD/seed_K; at the end report.md describes the results. The
same command continues a search: finished runs are kept, interrupted ones continue after their last batch.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import MutableSequence, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from agents.executors.driver import work_through
from agents.executors.options import LOCAL, add_options, executor_of
from agents.executors.progress import Progress
from agents.executors.protocol import Executor
from agents.runs.checks import choice, job_count
from agents.runs.command_line import exit_code, finished, signals_seen, typed_command
from agents.runs.consent import add_consent, consent_of
from agents.runs.ready_made import SEARCH, add_configuration, given_files
from agents.search.config import SearchConfig, load_search
from agents.search.folder import SearchRun
from rollingjoint.errors import naming_extras

if TYPE_CHECKING:
    from agents.executors.folders import Home


def main(argv: Sequence[str] | None = None) -> int:
    """Exit code of the command: 0 all finished, 2 an error or a run that failed, 130 stopped by Ctrl-C or SIGTERM."""
    parser = argparse.ArgumentParser(prog="rj search", description="Search designs.")
    add_configuration(parser, SEARCH)
    parser.add_argument("--methods", nargs="+", metavar="NAME", help="only these methods of the file")
    add_options(parser, "runs")
    parser.add_argument("--force", action="store_true", help="restart existing runs")
    add_consent(parser, pickles=False)
    arguments = parser.parse_args(argv)
    return exit_code(lambda: _command(arguments, typed_command("rj search", argv)), consent_of(arguments))


@naming_extras("search")
def _command(arguments: argparse.Namespace, command: Sequence[str]) -> int:
    import torch

    from agents.executors.folders import marked
    from agents.search.problem import check
    from agents.search.report import write_report

    jobs = job_count("--jobs", arguments.jobs)
    torch.set_num_threads(1)
    file, out = given_files(arguments, SEARCH)
    config = _chosen(load_search(file), arguments.methods)
    check(config)
    configs = config.runs()
    runs = [SearchRun.begin(out / run_config.run_name, run_config, command, arguments.force) for run_config in configs]
    unfinished = [run.path for run in runs if not run.is_finished]
    where = f"{jobs} at a time" if arguments.cluster == LOCAL else f"on the cluster {arguments.cluster}"
    print(f"{len(runs) - len(unfinished)} runs are finished, {len(unfinished)} are not; {where}", flush=True)
    with executor_of(arguments.cluster, jobs) as executor, signals_seen() as signals, marked(out) as home:
        failed = _work(executor, unfinished, out, home, signals)
    code = finished(len(runs), failed, signals, command)
    if code == 0:
        write_report(out)
        print(f"All {len(runs)} runs are finished; the report is in {out / 'report.md'}")
    return code


def _chosen(config: SearchConfig, methods: Sequence[str] | None) -> SearchConfig:
    for name in methods or ():
        choice(*config.methods)("--methods", name)
    return replace(config, methods={name: config.methods[name] for name in methods}) if methods else config


def _work(
    executor: Executor, paths: Sequence[Path], out: Path, home: Home, signals: MutableSequence[int]
) -> dict[Path, str]:
    """Let the workers finish all runs; the reasons of failures, by folder. `home` marks the folder `out`."""
    from agents.executors.folders import FolderUnit
    from agents.search.run import search_in
    from agents.search.spread import SpreadRuns

    failed, done = dict[Path, str](), 0
    with ExitStack() as held:
        progress = held.enter_context(Progress(len(paths), "run"))
        units = [FolderUnit(str(path), search_in, (), home, path.relative_to(out).as_posix()) for path in paths]
        spread = held.enter_context(SpreadRuns(units, progress))
        for ended in spread.runs(work_through(executor, spread.units(), progress, signals)):
            if ended.failure:
                failed[Path(ended.unit.name)] = ended.failure
                continue
            done += 1
            last = ended.value
            line = f"{ended.unit.place}: best cost {_cost(last.best)}, {last.seconds:.1f} s"
            progress.write(f"{done:>4} of {len(paths)}  {line}")
    return failed


def _cost(best: float) -> str:
    return f"{best:.4g}" if math.isfinite(best) else "none yet"


if __name__ == "__main__":
    sys.exit(main())
