"""Rebuild the results page from run folders: python -m agents.results runs/results.

It scores the policies of all finished runs, the baselines and the floor in the same episodes, and writes
OUT/results.md with its pictures, OUT/images/results_*. Nothing but the run folders and the command of the campaign
beside them is read. The same runs give the same page.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import shlex
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from agents.runs.checks import integer
from agents.runs.command_line import exit_code, typed_command
from agents.runs.files import RunFolderError, write_bytes, write_text
from agents.runs.folder import PACKAGES, versions

if TYPE_CHECKING:
    from agents.results.runs import Benchmark
    from agents.results.scores import Scored

LEARNING = (
    "Mean tip error in the evaluations during training over {}: median of the seeds, band from the smallest to the "
    "largest; dashed: Jacobian feedback, black: the floor. All in the episodes of these evaluations."
)
LOADS = (
    "Median tip error over the magnitude of the load at the end: the best policy of every task, with all its seeds; "
    "shaded: the loads of training. Errors below 0.001 mm are drawn there."
)
SHARES = (
    "Share of the episodes that end within an error: the best policy of every task, with all its seeds. Errors below "
    "0.001 mm are drawn there."
)


def main(argv: Sequence[str] | None = None) -> int:
    """Exit code of the command: 0 written, 2 an error."""
    parser = argparse.ArgumentParser(prog="python -m agents.results", description="Rebuild the results page.")
    parser.add_argument("runs", type=Path, help="folder with run folders, as agents.campaign leaves it")
    parser.add_argument("--episodes", type=int, default=1000, help="number of episodes (default 1000)")
    parser.add_argument("--seed", type=int, default=10_000, help="seed of the first episode (default 10000)")
    parser.add_argument("--out", type=Path, default=Path("docs"), help="where the page goes (default: docs)")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes (default: processors)")
    arguments = parser.parse_args(argv)
    return exit_code(lambda: _command(arguments))


def _command(arguments: argparse.Namespace) -> int:
    episodes = integer(1, 100_000)("--episodes", arguments.episodes)
    first, jobs = integer(0, 2**31)("--seed", arguments.seed), integer(1)("--jobs", arguments.jobs)
    from agents.results.runs import find_benchmarks

    benchmarks, left_out = find_benchmarks(arguments.runs)
    for path, reason in left_out.items():
        print(f"left out: {path}: {reason}", file=sys.stderr)
    if not benchmarks:
        raise RunFolderError("runs", str(arguments.runs), "a folder with at least one finished run")
    seeds = range(first, first + episodes)
    scored = _scored(benchmarks, seeds, jobs)
    _write(scored, seeds, left_out, arguments)
    print(f"The page is in {arguments.out / 'results.md'}")
    return 0


def _scored(benchmarks: Sequence[Benchmark], seeds: range, jobs: int) -> list[Scored]:
    """The scores of every benchmark, under heavier loads too; raises ConfigError for seeds of training."""
    from agents.results.scores import driving, score_benchmark

    for run in (run for benchmark in benchmarks for recipe in benchmark.recipes for run in recipe.runs):
        run.config.check_unused(seeds)
    scored: list[Scored] = []
    with driving(jobs) as drive:
        for benchmark in benchmarks:
            count = sum(len(recipe.runs) for recipe in benchmark.recipes)
            print(f"scoring: {benchmark.title}, {count} policies", flush=True)
            scored.append(score_benchmark(benchmark, seeds, drive))
    return scored


def _write(scored: Sequence[Scored], seeds: range, left_out: Mapping[Path, str], arguments: argparse.Namespace) -> None:
    from agents.results import pictures
    from agents.results.page import About, page

    images = {
        "results_learning_steps.png": (pictures.learning_curves(scored, over_time=False), LEARNING.format("steps")),
        "results_learning_time.png": (
            pictures.learning_curves(scored, over_time=True),
            LEARNING.format("processor time"),
        ),
        "results_distribution.png": (pictures.distributions(scored), SHARES),
    }
    if any(one.beyond for one in scored):
        images["results_load.png"] = (pictures.error_against_load(scored), LOADS)
    films = {one.benchmark.title: pictures.three_episodes(one) for one in pictures.to_film(scored)}
    for name, (content, _) in [*images.items(), *(film for films_of in films.values() for film in films_of.items())]:
        write_bytes(arguments.out / "images" / name, content)
    about = About(
        commands=_commands(arguments),
        seeds=seeds,
        machine=f"{_processor()}, {os.cpu_count()} processors",
        versions=_in_words(versions()),
        trained_with=_trained_with(scored),
        left_out=left_out,
        pictures={name: caption for name, (_, caption) in images.items()},
        animations={title: {name: caption for name, (_, caption) in some.items()} for title, some in films.items()},
    )
    write_text(arguments.out / "results.md", page(scored, about))


def _commands(arguments: argparse.Namespace) -> list[str]:
    """The commands that rebuild the page: that of the campaign, where it is known, and this one."""
    campaign = arguments.runs / "command.txt"
    words = [str(arguments.runs), "--episodes", str(arguments.episodes), "--seed", str(arguments.seed)]
    words += [] if arguments.out == Path("docs") else ["--out", str(arguments.out)]
    ours = shlex.join(typed_command("agents.results", words))
    return [*([campaign.read_text().strip()] if campaign.is_file() else []), ours]


def _trained_with(scored: Sequence[Scored]) -> str:
    """Processors and versions of all runs; several, where they differ."""
    runs = [run for one in scored for recipe in one.benchmark.recipes for run in recipe.runs]
    found = [json.loads((run.folder.path / "versions.json").read_text()) for run in runs]
    return "; ".join(sorted({f"{one['cores']} processors, {_in_words(one)}" for one in found}))


def _in_words(found: Mapping[str, str]) -> str:
    return ", ".join(f"{name} {found[name]}" for name in ("python", *PACKAGES) if name in found)


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
