"""Time of a gradient step of co-design in the lumen, and of its parts.

Run: python benchmarks/codesign.py [--lanes N] [--repeats N]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch

from agents.codesign.config import load_codesign
from agents.codesign.study import Study
from rollingjoint.tables import markdown_table

FILE = Path(__file__).resolve().parents[1] / "configs/codesign/lumen.yaml"


def main(argv: list[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--lanes", type=int, default=12)
    parser.add_argument("--repeats", type=int, default=10)
    options = parser.parse_args(argv)
    torch.set_num_threads(1)
    study = Study(Path(), load_codesign(FILE))
    task, x = study.task, np.asarray(study.space.reference())
    episodes, theta = task.episodes(range(options.lanes)), task.policy.initial(0)

    def timed(work: Callable[[], object]) -> float:
        work()
        seconds = []
        for _ in range(options.repeats):
            begin = time.process_time()
            work()
            seconds.append(time.process_time() - begin)
        return 1e3 * min(seconds)

    rollout = timed(lambda: task.scores(x, theta, episodes))
    policy = timed(lambda: task.slope(x, theta, episodes, by_design=False))
    joint = timed(lambda: task.slope(x, theta, episodes))
    limits = timed(lambda: study.problem.with_gradient(x[None]))
    numbers = len(x) + len(theta)
    rows = [
        ["rollout alone", rollout],
        ["with the gradient by the policy", policy],
        ["with the gradient by design and policy", joint],
        ["limits of the design, with their gradient", limits],
        [f"the same by {numbers} one-sided differences of rollouts", (numbers + 1) * rollout],
    ]
    steps = f"{options.lanes} lumens, {task.settings.steps} steps"
    print(markdown_table([steps, "ms"], [[name, f"{value:.0f}"] for name, value in rows]))


if __name__ == "__main__":
    main()
