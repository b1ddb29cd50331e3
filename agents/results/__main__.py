"""Rebuild the results page from run folders, or from results files: rj results runs/results.

It scores the policies of all finished runs, with --shipped also those that are shipped for other tasks, the baselines
and the floor in the same episodes, and writes OUT/results.json.gz with every episode's error, OUT/results.md, and its
pictures OUT/images/results_*. With --from it reads results files instead of run folders, merges them and writes the
same, with the animations in the folders of these files or in OUT. The same runs, or the same files, give the
same page. With --runs-only it scores further training seeds for a page that has their task and its opponents already.
"""

from __future__ import annotations

import argparse
import os
import platform
import shlex
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from agents.executors.options import add_options
from agents.results.file import FILE, read_results, write_results
from agents.results.record import Results, ResultsError
from agents.runs.checked_json import read_json
from agents.runs.checks import episode_count, integer, job_count, seed_number
from agents.runs.command_line import exit_code, typed_command
from agents.runs.consent import add_consent, consent_of
from agents.runs.files import RunFolderError, write_bytes, write_text
from agents.runs.folder import PACKAGES, versions
from agents.runs.seeds import TEST, VALIDATION

if TYPE_CHECKING:
    from agents.policies.shipped import ShippedPolicy
    from agents.results.runs import Benchmark
    from agents.results.worlds import ScoringPlan

OUT = Path("docs")
SIZES = {
    "episodes": (len(TEST), "of the tables"),
    "seed": (TEST.start, "of the first of them"),
    "validation": (len(VALIDATION), "episodes to choose in"),
    "per-point": (200, "episodes per point of a curve, 0: none"),
}


def main(argv: Sequence[str] | None = None) -> int:
    """Exit code of the command: 0 written, 2 an error."""
    parser = argparse.ArgumentParser(prog="rj results", description="Rebuild the results page.")
    parser.add_argument("runs", type=Path, nargs="?", help="folder with run folders, as rj campaign leaves it")
    parser.add_argument("--from", dest="files", type=Path, nargs="+", help="results files to merge, instead of runs")
    for name, (default, meaning) in SIZES.items():
        parser.add_argument(f"--{name}", type=int, default=default, help=f"{meaning} (default {default})")
    parser.add_argument(
        "--shipped", action="store_true", help="add shipped policies and their tasks where no run is of the task"
    )
    parser.add_argument("--out", type=Path, default=OUT, help="where the page goes (default: docs)")
    parser.add_argument(
        "--runs-only",
        action="store_true",
        help="score the runs alone and write no page: further training seeds, to be merged by --from into results that "
        "have the rest",
    )
    add_options(parser, "policies")
    add_consent(parser)
    arguments = parser.parse_args(argv)
    if (arguments.runs is None) == (arguments.files is None):
        parser.error("give a folder with run folders, or --from with results files")
    return exit_code(lambda: _command(arguments), consent_of(arguments))


def _command(arguments: argparse.Namespace) -> int:
    results = _merged(arguments) if arguments.files else _scored(arguments)
    if not any(record.of_role("test") for record in results.benchmarks):
        titles = [record.title for record in results.benchmarks]
        raise ResultsError("tasks", titles, "at least one task with test episodes", "Score with --seeds test.")
    write_results(arguments.out / FILE, results)
    if arguments.runs_only:
        print(f"What the runs did is in {arguments.out / FILE}: merge it by --from")
        return 0
    _write_page(read_results(arguments.out / FILE), arguments.out)
    print(f"The page is in {arguments.out / 'results.md'}, its figures in {arguments.out / FILE}")
    return 0


def _merged(arguments: argparse.Namespace) -> Results:
    """The content of the files, with their animations; if they merge, the page's last command is this one."""
    from agents.results.films import bring_films
    from agents.results.merging import merged

    sources = {path: read_results(path) for path in arguments.files}
    results = merged(list(sources.values()))
    bring_films(sources, results, arguments.out)
    return replace(results, commands=[*results.commands, _typed(arguments)]) if len(sources) > 1 else results


def _scored(arguments: argparse.Namespace) -> Results:
    """The results of all runs, their animations written; raises ConfigError for seeds of training."""
    from agents.results.runs import find_benchmarks
    from agents.results.scores import driving, score_benchmark, score_shipped, shipped_for_others

    plan, jobs = _plan(arguments), job_count("--jobs", arguments.jobs)
    benchmarks, left_out = find_benchmarks(arguments.runs)
    for path, reason in left_out.items():
        print(f"left out: {path}: {reason}", file=sys.stderr)
    if not benchmarks:
        raise RunFolderError("runs", str(arguments.runs), "a folder with at least one finished run")
    for run in (run for benchmark in benchmarks for recipe in benchmark.recipes for run in recipe.runs):
        run.config.check_unused(plan.test)
        run.config.check_unused(plan.validation)
    others = shipped_for_others(benchmarks) if arguments.shipped and not arguments.runs_only else {}
    records = []
    with driving(jobs, arguments.cluster) as drive:
        for benchmark in benchmarks:
            count = sum(len(recipe.runs) for recipe in benchmark.recipes)
            print(f"scoring: {benchmark.title}, {count} policies", flush=True)
            records.append(score_benchmark(benchmark, plan, drive, arguments.runs_only))
        for title, policy in others.items():
            print(f"scoring: {title}, the shipped policy", flush=True)
            records.append(score_shipped(policy, title, plan, drive))
    results = Results(
        records,
        commands=_commands(arguments),
        scored_on=[f"{_processor()}, {os.cpu_count()} processors, {_in_words(versions())}"],
        trained_with=_trained_with(benchmarks),
        left_out={str(path): reason for path, reason in left_out.items()},
    )
    if arguments.runs_only:
        return results
    return replace(results, films=_filmed([*benchmarks, *others.values()], results, arguments.out))


def _plan(arguments: argparse.Namespace) -> ScoringPlan:
    from agents.results.worlds import ScoringPlan

    episodes = episode_count("--episodes", arguments.episodes)
    first = seed_number("--seed", arguments.seed)
    choosing = episode_count("--validation", arguments.validation)
    validation = range(VALIDATION.start, VALIDATION.start + choosing)
    return ScoringPlan(
        range(first, first + episodes), validation, integer(0, 100_000)("--per-point", arguments.per_point)
    )


def _filmed(sources: Sequence[Benchmark | ShippedPolicy], results: Results, out: Path) -> dict[str, dict[str, str]]:
    """Writes the animations; their captions by file name, by title."""
    from agents.results.films import three_episodes, three_of_shipped
    from agents.results.runs import Benchmark

    captions: dict[str, dict[str, str]] = {}
    for source, record in zip(sources, results.benchmarks, strict=True):
        films = three_episodes(source, record) if isinstance(source, Benchmark) else three_of_shipped(source, record)
        for name, (content, caption) in films.items():
            write_bytes(out / "images" / name, content)
            captions[record.title] = {name: caption}
    return captions


def _write_page(results: Results, out: Path) -> None:
    from agents.results.page import page
    from agents.results.pictures import pictures

    images = pictures(results)
    for name, (content, _) in images.items():
        write_bytes(out / "images" / name, content)
    animations: Mapping[str, Mapping[str, str]] = {
        title: {name: caption for name, caption in films.items() if (out / "images" / name).is_file()}
        for title, films in results.films.items()
    }
    write_text(out / "results.md", page(results, {name: caption for name, (_, caption) in images.items()}, animations))


def _commands(arguments: argparse.Namespace) -> list[str]:
    """The commands that rebuild the page: the campaigns' own, where they are known, and this one."""
    typed = [path.read_text("utf-8").strip() for path in sorted(arguments.runs.rglob("command.txt"))]
    campaigns = [text for text in typed if text.startswith(("rj campaign ", "python -m agents.campaign "))]
    return [*campaigns, _typed(arguments)]


def _typed(arguments: argparse.Namespace) -> str:
    """This command, with the arguments that change the page."""
    words = ["--from", *map(str, arguments.files)] if arguments.files else [str(arguments.runs)]
    for name, (default, _) in SIZES.items():
        value = getattr(arguments, name.replace("-", "_"))
        words += [] if value == default or arguments.files else [f"--{name}", str(value)]
    words += ["--shipped"] if arguments.shipped and not arguments.files else []
    words += ["--runs-only"] if arguments.runs_only else []
    words += [] if arguments.out == OUT else ["--out", str(arguments.out)]
    return shlex.join(typed_command("rj results", words))


def _trained_with(benchmarks: Sequence[Benchmark]) -> list[str]:
    """Processors and versions of all runs; several, where they differ."""
    runs = [run for benchmark in benchmarks for recipe in benchmark.recipes for run in recipe.runs]
    versions_of_runs = [read_json(run.folder.path / "versions.json") for run in runs]
    return sorted({f"{values['cores']} processors, {_in_words(values)}" for values in versions_of_runs})


def _in_words(values: Mapping[str, str]) -> str:
    return ", ".join(f"{name} {values[name]}" for name in ("python", *PACKAGES) if name in values)


def _processor() -> str:
    """The processor's name, as far as the system tells it."""
    try:
        lines = Path("/proc/cpuinfo").read_text("utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


if __name__ == "__main__":
    sys.exit(main())
