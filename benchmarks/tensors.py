"""Solves and gradients in torch, of this checkout and an earlier one: python benchmarks/tensors.py --before REV.

Both run in turns. Least processor times of one thread: a solve of rows on tables (SideBySide), the equilibria of as
many rows under tensions by surfaces, and the backward pass of the sum of their tips.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from guard_rows.checkout import REPOSITORY, Checkout, checked_out

from rollingjoint import five_link, flexible_arm
from rollingjoint.chain.spatial import SpatialChain
from rollingjoint.differentiable import DifferentiableChain, DifferentiableSpatialChain, SideBySide, solve_tensions
from rollingjoint.load import LOAD_COLUMNS
from rollingjoint.tables import markdown_table

TURNS, ROUNDS = 3, 5


def milliseconds(call: Callable[[], object]) -> float:
    """The least processor time of some calls after a first one [ms]."""
    call()
    times = []
    for _ in range(ROUNDS):
        begun = time.process_time()
        call()
        times.append(time.process_time() - begun)
    return 1e3 * min(times)


def measured(counts: tuple[int, ...] = (64, 4096)) -> dict[str, float]:
    """Times of this checkout [ms]."""
    torch.set_num_threads(1)
    chain, rng, times = five_link(), np.random.default_rng(1), {}
    arm = SpatialChain.from_arm(flexible_arm())
    for rows in counts:
        commands = torch.tensor(chain.neutral_lengths - 1.0 + rng.uniform(-2.0, 1.0, (rows, chain.n_tendons)))
        loads = torch.zeros(rows, 1, len(LOAD_COLUMNS), dtype=torch.float64)
        loads[:, 0, LOAD_COLUMNS.index("link")] = chain.n_links - 1
        loads[:, 0, LOAD_COLUMNS.index("fx")] = torch.tensor(rng.uniform(-0.5, 0.5, rows))
        stiffnesses = torch.tensor(chain.stiffnesses).expand_as(commands)
        limits = tuple(torch.tensor(limit, dtype=torch.float64) for limit in (0.5, 15.0))
        starts = torch.tensor(np.tile(chain.neutral_angles, (rows, 1)))
        solver = SideBySide(chain.arrays, np.zeros(rows, np.int64))
        times[f"on tables, {rows}"] = milliseconds(
            lambda args=(solver, commands, stiffnesses, limits, loads, starts): args[0].solve(*args[1:])
        )
        times |= gradients(DifferentiableChain.from_mechanism(chain, requires_grad=["coefficients"]), rows, rng)
    return times | gradients(DifferentiableSpatialChain.from_mechanism(arm, requires_grad=["holes"]), counts[0], rng)


def gradients(design: DifferentiableChain | DifferentiableSpatialChain, rows: int, rng: np.random.Generator) -> dict:
    """Times forward and backward [ms]."""
    tensions = torch.tensor(rng.uniform(1.0, 3.0, (rows, design.n_tendons)))
    tips = solve_tensions(design, tensions).tip.sum()
    name = "the plane" if isinstance(design, DifferentiableChain) else "space"
    return {
        f"forward in {name}, {rows}": milliseconds(lambda: solve_tensions(design, tensions)),
        f"backward in {name}, {rows}": milliseconds(lambda: tips.backward(retain_graph=True)),
    }


def main() -> None:
    """Print the table; with --times, this checkout's times alone, as JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--before", default="HEAD", help="a git revision or the folder of a checkout")
    parser.add_argument("--times", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.times:
        print(json.dumps(measured()))
        return
    script = str(Path(__file__).resolve())
    with tempfile.TemporaryDirectory() as scratch, checked_out("before", arguments.before, Path(scratch)) as folder:
        sides = [Checkout("before", folder), Checkout("after", REPOSITORY)]
        least: list[dict[str, float]] = [{}, {}]
        for _ in range(TURNS):
            for side, times in zip(sides, least, strict=True):
                process = side.start(script, "--times", stdout=subprocess.PIPE)
                answer, _ = process.communicate()
                if process.returncode:
                    sys.exit(f"{side.name} ({side.folder}) failed with exit code {process.returncode}")
                times |= {key: min(value, times.get(key, value)) for key, value in json.loads(answer).items()}
    rows = [[key, f"{old:.1f}", f"{least[1][key]:.1f}", f"{least[1][key] / old:.2f}"] for key, old in least[0].items()]
    print(markdown_table(["rows", "before [ms]", "after [ms]", "ratio"], rows))


if __name__ == "__main__":
    main()
