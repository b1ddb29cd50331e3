"""Designs and training seeds per second by the number of workers: python benchmarks/throughput.py [--cluster auto].

Four searches as units, one search whose batches are scored in chunks, and four trainings with PPO, on one worker and on
two, which have begun before the clock does; before that, processor time of a chunk of 100 designs.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from agents.executors.driver import work_through
from agents.executors.folders import FolderUnit, Home, marked
from agents.executors.options import LOCAL, executor_of
from agents.executors.progress import Progress
from agents.executors.protocol import Executor
from agents.runs.config import load_config
from agents.search.config import SearchConfig, load_search
from agents.search.folder import SearchRun
from agents.search.problem import design_problem
from agents.search.run import search_in
from agents.search.spread import SpreadRuns
from agents.training.campaign import Member, TrainingUnit
from rollingjoint.checked_yaml import dump_yaml
from rollingjoint.tables import markdown_table

CONFIGS = Path(__file__).parent.parent / "configs"
SEEDS = (1, 2, 3, 4)
SEARCHES = ("stiffness", "load_capacity", "peak_tension", "multi", "bending_shapes", "tendon_travel", "workspace")
Work = Callable[[Executor, Home, int], None]


def searches(executor: Executor, home: Home, designs: int) -> None:
    """Search so many designs in all: a run per seed, each a unit."""
    config = load_search(CONFIGS / "search/stiffness.yaml")
    search(executor, home, replace(config, methods={"cma_es": {}}, seeds=SEEDS, budget=designs // len(SEEDS)))


def chunks(executor: Executor, home: Home, designs: int) -> None:
    """Search so many designs, 400 at least, in one run, whose populations are scored in up to ten chunks."""
    config = load_search(CONFIGS / "search/stiffness.yaml")
    designs = max(designs, 400)  # so that every worker has had a chunk before the clock starts
    methods = {"cma_es": {"population": min(1000, designs)}}
    search(executor, home, replace(config, methods=methods, seeds=(1,), budget=designs, chunk=100))


def search(executor: Executor, home: Home, config: SearchConfig) -> None:
    """Search all runs in the folder."""
    runs = [SearchRun.begin(home.path / one.run_name, one, ["benchmark"]) for one in config.runs()]
    units = [FolderUnit(str(run.path), search_in, (), home, run.path.relative_to(home.path).as_posix()) for run in runs]
    with Progress(len(units), "run") as progress, SpreadRuns(units, progress) as spread:
        for ended in spread.runs(work_through(executor, spread.units(), progress, [])):
            assert not ended.failure, ended.failure


def trainings(executor: Executor, home: Home, steps: int) -> None:
    """Train so many steps in all: a run per seed, each a unit."""
    config = load_config(CONFIGS / "train/ppo_fixed_target.yaml", [f"total_timesteps={steps // len(SEEDS)}"])
    path = home.path / "ppo.yaml"
    path.write_text(dump_yaml(config.to_dict()), "utf-8")
    units = (TrainingUnit.of(Member(path, seed), home.path, home) for seed in SEEDS)
    with Progress(len(SEEDS), "run") as progress:
        for ended in work_through(executor, units, progress, []):
            assert not ended.failure, ended.failure


def seconds_of(work: Work, amount: int, cluster: str, jobs: int) -> tuple[float, int]:
    """Wall time of an amount of work once every worker has done a little of it [s]; how many they were."""
    with executor_of(cluster, jobs) as executor:
        for share in (0.02, 1.0):
            with tempfile.TemporaryDirectory() as folder, marked(Path(folder)) as home:
                begun = time.perf_counter()
                work(executor, home, int(share * amount))
                wall = time.perf_counter() - begun
        return wall, executor.slots


def chunk_times(name: str, count: int = 4) -> list[str]:
    """A row: what it takes to score 100 random designs of a search of configs/search, and with gradients [ms]."""
    problem = design_problem(load_search(CONFIGS / f"search/{name}.yaml"))
    x = np.random.default_rng(0).uniform(-1.0, 1.0, (count, 100, problem.dimensions))
    row = [name]
    for score in (problem.evaluate, problem.with_gradient):
        score(x[0, :2])  # compiled
        begun = time.process_time()
        for chunk in x:
            score(chunk)
        row.append(f"{1e3 * (time.process_time() - begun) / count:.0f}")
    return row


def rows_of(what: str, work: Work, amount: int, cluster: str, counts: Sequence[int]) -> list[list[str]]:
    """A row per number of workers."""
    rows, first = [], 0.0
    for jobs in counts:
        wall, workers = seconds_of(work, amount, cluster, jobs)
        first = first or wall
        rows.append([what, str(workers), f"{wall:.1f}", f"{amount / wall:,.0f}", f"{first / wall:.2f}"])
    return rows


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description="Designs and training steps per second by the number of workers.")
    parser.add_argument("--designs", type=int, default=8_000, help="of all runs together")
    parser.add_argument("--steps", type=int, default=120_000, help="of all trainings together")
    parser.add_argument("--cluster", default=LOCAL, help="local, or auto or HOST:PORT of a Ray cluster")
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2], help="where it is local")
    arguments = parser.parse_args(argv)
    torch.set_num_threads(1)
    rows = [chunk_times(name) for name in SEARCHES]
    print(markdown_table(["100 designs of", "processor [ms]", "with gradients [ms]"], rows), flush=True)
    counts = arguments.workers if arguments.cluster == LOCAL else [1]
    rows = [
        *rows_of("designs, 4 runs as units", searches, arguments.designs, arguments.cluster, counts),
        *rows_of("designs, 1 run in chunks", chunks, arguments.designs, arguments.cluster, counts),
        *rows_of("training steps, 4 seeds", trainings, arguments.steps, arguments.cluster, counts),
    ]
    print()
    print(markdown_table(["what", "workers", "wall [s]", "per second", "times the first row"], rows))


if __name__ == "__main__":
    main()
