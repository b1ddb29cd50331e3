"""Score controllers on mechanisms that they have not seen: the tables of docs/generalist.md.

    python benchmarks/generalist.py                                # the shipped generalist, on the test designs
    python benchmarks/generalist.py --run runs/generalist --choose # a run, on the designs to choose on
    python benchmarks/generalist.py --film docs/images/generalist.gif

Every design has the same number of episodes, with the same seeds for every controller: load, link and the tensions of
the target. The error of an episode is the mean tip error over its last 10 steps. Intervals are 95 %, by a bootstrap
over designs. Jacobian feedback and open loop are told every design exactly. The specialist is the shipped policy of
fixed_target, which was trained on five_link; it can read the observations of designs with five links alone.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.controllers import JacobianFeedback, OpenLoop
from agents.controllers.controller import Controller
from agents.evaluation.pictures import animation
from agents.evaluation.rollout import film, run_with_options
from agents.policies.trained import load_driving
from agents.runs.environment import EnvConfig
from agents.runs.folder import RunFolder
from agents.runs.seeds import MANY_TEST, MANY_VALIDATION
from agents.shipped import load_policy
from rj_gym import MechanismsConfig
from rollingjoint.tables import markdown_table

Errors = NDArray[np.float64]

ID = "rj_gym/ManyMechanisms-v0"
TO_CHOOSE, TO_TEST = 1_000_000, 2_000_000  # first design
TOGETHER = 25  # designs side by side
LOST = 5.0  # mm: most episodes with a larger error are of a mechanism that has snapped
TOLD = "Jacobian feedback, told the design"


class Specialist(Controller):
    """A shipped policy of one mechanism on another one with as many links, which it takes for its own."""

    def __init__(self, name: str) -> None:
        self.policy = load_policy(name)

    def act(self, observations: Any) -> Any:
        """Its actions, (B, m)."""
        return self.policy(observations)


def main(argv: Sequence[str] | None = None) -> int:
    """Print the tables, or write the animation."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--run", type=Path, action="append", default=[], help="run folders in place of the policy")
    parser.add_argument("--policy", default="best", help="of the runs: best or last")
    parser.add_argument("--choose", action="store_true", help="on the designs and seeds to choose on")
    parser.add_argument("--designs", type=int, default=200)
    parser.add_argument("--episodes", type=int, default=10, help="of each design")
    parser.add_argument("--only-policies", action="store_true")
    parser.add_argument("--out", type=Path, help="a JSON file for the errors of all episodes [mm]")
    parser.add_argument("--film", type=Path, help="write an animation of test designs of every size, and no tables")
    arguments = parser.parse_args(argv)
    first, seeds = (TO_CHOOSE, MANY_VALIDATION) if arguments.choose else (TO_TEST, MANY_TEST)
    designs = list(range(first, first + arguments.designs))
    policies = {path.name: load_driving(RunFolder.open(path), arguments.policy) for path in arguments.run}
    policies = policies or {"generalist": load_policy("generalist")}
    if arguments.film:
        arguments.film.write_bytes(filmed(next(iter(policies.values())), first))
        return 0
    controllers: dict[str, Controller] = dict(policies)
    if not arguments.only_policies:
        controllers |= {TOLD: JacobianFeedback(), "open loop, told the design": OpenLoop()}
    errors = {name: errors_of(each, designs, arguments.episodes, seeds.start) for name, each in controllers.items()}
    print(table(errors))
    if not arguments.only_policies:
        for name in policies:
            print(compared(name, errors[name], errors[TOLD]))
        print(by_size(errors, designs))
        five = np.array([links(design) == 5 for design in designs])
        own = [design for design, is_five in zip(designs, five, strict=True) if is_five]
        alone = errors_of(Specialist("fixed_target"), own, arguments.episodes, seeds.start)
        print(f"\n{len(own)} designs with five links: the specialist of five_link has {interval(alone)} mm")
    if arguments.out:
        arguments.out.write_text(json.dumps({name: each.round(5).tolist() for name, each in errors.items()}))
    return 0


def links(design: int) -> int:
    """Number of links of a design."""
    return MechanismsConfig().drawn[design].n_links


def errors_of(controller: Controller, designs: Sequence[int], episodes: int, seed: int) -> Errors:
    """Mean tip error over the last 10 steps, (designs, episodes) [mm]; design k of a range has seeds of its own."""
    blocks = []
    for first in range(0, len(designs), TOGETHER):
        block = designs[first : first + TOGETHER]
        options = [fixed for design in block for fixed in [{"design": design}] * episodes]
        seeds = [seed + (design % TO_CHOOSE) * episodes + each for design in block for each in range(episodes)]
        driven = run_with_options(EnvConfig(ID), controller, seeds, options)
        blocks.append(driven.last_errors.mean(axis=1).reshape(len(block), episodes))
    return np.concatenate(blocks)


def table(errors: dict[str, Errors]) -> str:
    """A row per controller."""
    header = [
        "controller",
        "mean [mm]",
        "median",
        "95th percentile",
        "median of designs",
        "worst design",
        f"above {LOST:g} mm",
    ]
    return markdown_table(header, [[name, interval(each), *_spread(each)] for name, each in errors.items()])


def _spread(errors: Errors) -> list[str]:
    of_designs = errors.mean(axis=1)
    numbers = np.median(errors), np.percentile(errors, 95), np.median(of_designs), of_designs.max()
    return [*(f"{number:.3f}" for number in numbers), f"{100 * np.mean(errors > LOST):.2f} %"]


def compared(name: str, errors: Errors, told: Errors) -> str:
    """The difference to Jacobian feedback, and the same in the episodes that neither has lost."""
    kept = (errors <= LOST) & (told <= LOST)
    ours, theirs = (np.where(kept, each, np.nan) for each in (errors, told))
    return (
        f"{name} minus {TOLD}: {interval(errors - told)} mm; in the {100 * kept.mean():.1f} % of episodes with at most "
        f"{LOST:g} mm for both: {interval(ours - theirs)} mm, {np.nanmean(ours):.3f} and {np.nanmean(theirs):.3f} mm\n"
    )


def by_size(errors: dict[str, Errors], designs: Sequence[int]) -> str:
    """A row per number of links: designs, and the median and mean error of every controller."""
    sizes = np.array([links(design) for design in designs])
    rows = []
    for size in np.unique(sizes):
        cells = [f"{np.median(each[sizes == size]):.3f}, {each[sizes == size].mean():.3f}" for each in errors.values()]
        rows.append([str(size), str((sizes == size).sum()), *cells])
    return markdown_table(["links", "designs", *(f"{name} [mm]" for name in errors)], rows)


def interval(errors: Errors) -> str:
    """The mean over designs of errors (designs, episodes) that are not NaN, with its interval."""
    rows = errors[np.isfinite(errors).any(axis=1)]
    means, rng = np.nanmean(rows, axis=1), np.random.default_rng(0)
    drawn = means[rng.integers(len(means), size=(10_000, len(means)))].mean(axis=1)
    low, high = np.percentile(drawn, [2.5, 97.5])
    return f"{means.mean():.3f} [{low:.3f}, {high:.3f}]"


def filmed(policy: Controller, first: int) -> bytes:
    """GIF of an episode with the first design of every number of links, from `first` on."""
    sizes: dict[int, int] = {}
    for design in range(first, first + 100):
        sizes.setdefault(links(design), design)
    frames = {}
    for size, design in sorted(sizes.items()):
        env = EnvConfig(ID, settings={"mechanisms": {"designs": (design, design + 1)}})
        frames[f"{size} links"] = film(env, policy, MANY_TEST.stop - 1)[:36:2]
    return animation(frames, 400, columns=3)


if __name__ == "__main__":
    raise SystemExit(main())
