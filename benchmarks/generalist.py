"""Score controllers on mechanisms that they have not seen: the table of docs/generalist.md.

    python benchmarks/generalist.py                                # the shipped generalist, on the test designs
    python benchmarks/generalist.py --run runs/generalist --choose # a run, on the designs to choose on

Every design has the same number of episodes, with the same seeds for every controller: load, link and the tensions of
the target. The error of an episode is the mean tip error over its last 10 steps. Intervals are 95 %,
by a bootstrap over designs. Jacobian feedback is told every design exactly; specialists are trained on one mechanism,
five_link, and drive the designs with as many links alone.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from agents.controllers import JacobianFeedback, OpenLoop
from agents.controllers.controller import Controller
from agents.evaluation.rollout import run_with_options
from agents.policies.trained import load_driving
from agents.runs.environment import EnvConfig
from agents.runs.folder import RunFolder
from agents.runs.seeds import MANY_TEST, MANY_VALIDATION
from agents.shipped import load_policy
from rollingjoint.tables import markdown_table

TO_CHOOSE, TO_TEST = 1_000_000, 2_000_000  # first design
TOGETHER = 50  # designs side by side


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table, and write all errors where asked."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--run", type=Path, action="append", default=[], help="run folders in place of the policy")
    parser.add_argument("--choose", action="store_true", help="on the designs and seeds to choose on")
    parser.add_argument("--designs", type=int, default=200)
    parser.add_argument("--episodes", type=int, default=20, help="of each design")
    parser.add_argument("--only-policies", action="store_true")
    parser.add_argument("--out", type=Path, help="a JSON file for the errors of all episodes [mm]")
    arguments = parser.parse_args(argv)
    first, seeds = (TO_CHOOSE, MANY_VALIDATION) if arguments.choose else (TO_TEST, MANY_TEST)
    designs = range(first, first + arguments.designs)
    controllers: dict[str, Controller] = {path.name: load_driving(RunFolder.open(path)) for path in arguments.run}
    if not arguments.run:
        controllers["generalist"] = load_policy("generalist")
    if not arguments.only_policies:
        controllers |= {
            "Jacobian feedback, told the design": JacobianFeedback(),
            "open loop, told the design": OpenLoop(),
        }
    errors = {name: errors_of(each, designs, arguments.episodes, seeds.start) for name, each in controllers.items()}
    print(
        markdown_table(["controller", "mean [mm]", "median", "95 %", "median of designs", "worst design"], rows(errors))
    )
    if not arguments.only_policies:
        names = list(errors)
        for name in names[:-2]:
            print(f"{name} minus {names[-2]}: {interval(errors[name] - errors[names[-2]])} mm")
    if arguments.out:
        arguments.out.write_text(json.dumps({name: each.round(5).tolist() for name, each in errors.items()}))
    return 0


def errors_of(controller: Controller, designs: range, episodes: int, seed: int) -> Any:
    """Mean tip error over the last 10 steps, (designs, episodes) [mm]."""
    blocks = []
    for first in range(0, len(designs), TOGETHER):
        block = designs[first : first + TOGETHER]
        env = EnvConfig("rj_gym/ManyMechanisms-v0")
        fixed = [{"design": design} for design in block]
        count = len(block) * episodes
        begin = seed + first * episodes
        options = [fixed[i // episodes] for i in range(count)]
        driven = run_with_options(env, controller, range(begin, begin + count), options)
        blocks.append(driven.last_errors.mean(axis=1).reshape(len(block), episodes))
    return np.concatenate(blocks)


def rows(errors: dict[str, Any]) -> list[list[str]]:
    """A row per controller."""
    return [
        [
            name,
            interval(each),
            f"{np.median(each):.3f}",
            f"{np.percentile(each, 95):.3f}",
            f"{np.median(each.mean(axis=1)):.3f}",
            f"{each.mean(axis=1).max():.3f}",
        ]
        for name, each in errors.items()
    ]


def interval(values: Any) -> str:
    """The mean of (designs, episodes), with its interval."""
    means, rng = values.mean(axis=1), np.random.default_rng(0)
    drawn = means[rng.integers(len(means), size=(10_000, len(means)))].mean(axis=1)
    low, high = np.percentile(drawn, [2.5, 97.5])
    return f"{means.mean():.3f} [{low:.3f}, {high:.3f}]"


if __name__ == "__main__":
    raise SystemExit(main())
