"""A campaign, a search and a study on nodes of which some are lost: python benchmarks/lost_nodes.py [--nodes 8].

The nodes are a Ray cluster on this machine, one processor each as Ray counts them. While a command works, a node is
killed with all its processes every few seconds, and another one joins. Its results are then compared, bit by bit but
for times, with those of the same command on two local processes.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

from rollingjoint.tables import markdown_table
from tests.agents.executors.nodes import (
    SEARCH,
    Nodes,
    campaign_file,
    ended,
    nodes_of_this_machine,
    run,
    searched,
    trained,
)

STUDY = """
config: {folder}/near.yaml
set: {{total_timesteps: {steps}, evaluation.every: {steps}}}
trials: 16
space: {{parameters.gamma: {{low: 0.5, high: 0.99}}}}
episodes: 2
startup: 16
"""  # all trials are drawn at random, so that they do not depend on the order in which others end


class Work(NamedTuple):
    """A command, and what of its results must not depend on where it ran."""

    name: str
    units: int
    module: str
    words: Callable[[Path], list[str]]
    results: Callable[[Path], Any]


def works(folder: Path, steps: int, budget: int) -> list[Work]:
    """A campaign of 16 trainings, a search of 16 runs, a study of 16 trials; their files are written."""
    campaign = campaign_file(folder, steps, range(1, 17))
    search, study = folder / "search.yaml", folder / "study.yaml"
    search.write_text(SEARCH.replace("budget: 120", f"budget: {budget}").replace("[1, 2]", str([*range(1, 9)])))
    study.write_text(STUDY.format(folder=folder, steps=steps))
    return [
        Work("campaign", 16, "agents.campaign", lambda out: [str(campaign), "--out", str(out)], trained),
        Work("search", 16, "agents.search", lambda out: [str(search), "--out", str(out)], searched),
        Work("study", 16, "agents.tune", lambda out: ["--config", str(study), "--study", str(out)], best_trial),
    ]


def best_trial(out: Path) -> str:
    """The best configuration of a study, without its first line, which names the folder."""
    return (out / "best.yaml").read_text().split("\n", 1)[1]


def on_nodes(work: Work, nodes: Nodes, count: int, out: Path, every: float, most: int) -> tuple[float, int, int]:
    """Run the command while nodes are lost: seconds, nodes killed, units that were tried again."""
    nodes.complete(count)
    begun, killed = time.monotonic(), 0
    process, due = run(work.module, *work.words(out), "--cluster", nodes.address), begun + 2 * every
    with ThreadPoolExecutor(1) as reader:  # a command whose output nobody reads stops
        end = reader.submit(ended, process)
        while not end.done():
            time.sleep(0.1)
            if killed < most and time.monotonic() > due:
                nodes.kill()
                nodes.complete(count)
                killed, due = killed + 1, time.monotonic() + every
    code, said = end.result()
    assert code == 0, said
    return time.monotonic() - begun, killed, said.count("its worker or machine is gone")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--nodes", type=int, default=8)
    parser.add_argument("--steps", type=int, default=6_000, help="of a training and of a trial")
    parser.add_argument("--budget", type=int, default=600, help="designs of a run of the search")
    parser.add_argument("--every", type=float, default=8.0, help="seconds from one loss to the next")
    parser.add_argument("--most", type=int, default=6, help="nodes that a command loses at most")
    given = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as name, nodes_of_this_machine(Path(name)) as nodes:
        folder = Path(name)
        for work in works(folder, given.steps, given.budget):
            there, here = folder / f"{work.name}_nodes", folder / f"{work.name}_local"
            seconds, killed, again = on_nodes(work, nodes, given.nodes, there, given.every, given.most)
            begun = time.monotonic()
            code, said = ended(run(work.module, *work.words(here), "--jobs", "2"))
            assert code == 0, said
            alone = time.monotonic() - begun
            equal = "yes" if work.results(there) == work.results(here) else "**no**"
            rows.append([work.name, str(work.units), str(killed), str(again), f"{seconds:.0f}", f"{alone:.0f}", equal])
            print(rows[-1], flush=True)
    head = ["what", "units", "nodes lost", "tried again", "wall [s]", "two local processes [s]", "equal to the bit"]
    print(markdown_table(head, rows))


if __name__ == "__main__":
    main()
