"""Score controllers on mechanisms that they have not seen: the tables of docs/generalist.md.

    python benchmarks/generalist.py                                # the shipped generalist, on the test designs
    python benchmarks/generalist.py --run runs/generalist --choose # a run, on the designs to choose on
    python benchmarks/generalist.py --run generalist --run runs/2  # several trainings, and how much they differ
    python benchmarks/generalist.py --blind --run runs/blind       # mechanisms whose tip is not seen
    python benchmarks/generalist.py --blind --run runs/blind --specialist runs/one # and one trained on one of them
    python benchmarks/generalist.py --lost                         # why episodes end far from their target
    python benchmarks/generalist.py --way --space --choose         # how many steps the tendons' way to a target takes
    python benchmarks/generalist.py --film docs/images/generalist.gif
    python benchmarks/generalist.py --blind --film docs/images/generalist_blind.gif
    python benchmarks/generalist.py --space                        # mechanisms in space; with --blind, too

Every design has the same number of episodes, with the same seeds for every controller: load, link and the tensions of
the target. The error of an episode is the mean tip error over its last 10 steps. Intervals are 95 %, by a bootstrap
over designs. Jacobian feedback and open loop are told every design exactly. The specialist is the shipped policy of
fixed_target, which was trained on five_link; it can read the observations of designs with five links alone. Where the
tip is not seen, opponents are told either every design exactly, or the number of its links: they take it for the plain
chain of the space. Their settings were tuned on other designs of the same space, those of either kind apart.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray
from scipy import stats

from agents.controllers import JacobianFeedback, OpenLoop
from agents.controllers.controller import Controller
from agents.controllers.tuned import tuned_controllers, world_of
from agents.evaluation.floor import episode_floor
from agents.evaluation.pictures import animation
from agents.evaluation.rollout import film, run_with_options
from agents.policies.trained import load_driving
from agents.runs.environment import EnvConfig
from agents.runs.folder import RunFolder
from agents.runs.seeds import DESIGNS_TO_CHOOSE, DESIGNS_TO_TEST, MANY_TEST, MANY_VALIDATION
from agents.shipped import load_policy
from rj_gym.many.designs import DrawnDesigns
from rollingjoint.tables import markdown_table

Errors = NDArray[np.float64]

PLANE, SPACE = (EnvConfig(f"rj_gym/ManyMechanisms{where}-v0") for where in ("", "InSpace"))
HIDDEN = {"sensing": {"pose": "none", "tension_noise": 0.1}}  # as configs/env/generalist_blind.yaml
TOGETHER = 25  # designs side by side
LOST = 5.0  # mm: of most episodes with a larger error the floor is larger, too (--lost)
LONGER = 75  # steps


class Specialist(Controller):
    """A shipped policy of one mechanism on another one with as many links, which it takes for its own."""

    def __init__(self, name: str) -> None:
        self.policy = load_policy(name)

    def act(self, observations: Any) -> Any:
        """Its actions, (B, m)."""
        return self.policy(observations)


def opponents(env: EnvConfig, blind: bool) -> dict[str, Controller]:
    """Controllers with models, by name."""
    if not blind:
        return {"Jacobian feedback, told the design": JacobianFeedback(), "open loop, told the design": OpenLoop()}
    tuned, shown = tuned_controllers(world_of(env)), {"kalman filter": "Kalman filter"}
    models = [name for name in ("smoother", "kalman filter", "open loop") if name in tuned]
    told = {f"{shown.get(name, name)}, told the design": tuned[name] for name in models}
    nominal = {f"{shown.get(name, name)}, told the number of links": tuned[f"nominal {name}"] for name in models}
    return told | nominal


def main(argv: Sequence[str] | None = None) -> int:
    """Print the tables, or write the animation."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--run", action="append", default=[], help="run folders or shipped policies; default: shipped")
    parser.add_argument("--policy", default="best", help="of the runs: best or last")
    parser.add_argument("--blind", action="store_true", help="the tip is not seen")
    parser.add_argument("--space", action="store_true", help="mechanisms in space")
    parser.add_argument("--specialist", type=Path, action="append", default=[], help="run folders, each of one design")
    parser.add_argument("--choose", action="store_true", help="on the designs and seeds to choose on")
    parser.add_argument("--designs", type=int, default=200)
    parser.add_argument("--episodes", type=int, default=10, help="of each design")
    parser.add_argument("--first", type=int, help="first design, in place of that of the range")
    parser.add_argument("--only-policies", action="store_true")
    parser.add_argument("--lost", action="store_true", help="why episodes are lost, and no other tables")
    parser.add_argument("--way", action="store_true", help="how long the tendons' way to a target is, and no tables")
    parser.add_argument("--out", type=Path, help="a JSON file for the errors of all episodes [mm]")
    parser.add_argument("--film", type=Path, help="write an animation of test designs of every size, and no tables")
    arguments = parser.parse_args(argv)
    numbers, seeds = (DESIGNS_TO_CHOOSE, MANY_VALIDATION) if arguments.choose else (DESIGNS_TO_TEST, MANY_TEST)
    env = SPACE if arguments.space else PLANE
    env = replace(env, settings=HIDDEN) if arguments.blind else env
    seen = "generalist" + ("_space" if arguments.space else "")
    runs = arguments.run or [seen + ("_blind" if arguments.blind else "")]
    policies = {Path(run).name: policy_of(run, arguments.policy) for run in runs}
    if arguments.film:
        arguments.film.write_bytes(filmed(env, next(iter(policies.values())), numbers.start))
        return 0
    controllers: dict[str, Controller] = dict(policies)
    if arguments.specialist:
        print(beside_specialists(env, controllers, arguments.specialist, arguments.policy, arguments.episodes, seeds))
        return 0
    first = numbers.start if arguments.first is None else arguments.first
    designs = list(range(first, first + arguments.designs))
    if arguments.way:
        print(way_of(env, policies[Path(runs[0]).name], designs, seeds.start))
        return 0
    if arguments.lost:
        controllers |= {} if arguments.blind else opponents(env, blind=False)
        print(why_lost(env, controllers, seen, designs, arguments.episodes, seeds.start))
        return 0
    if not arguments.only_policies:
        controllers |= opponents(env, arguments.blind)
    errors = {
        name: errors_of(env, each, designs, arguments.episodes, seeds.start) for name, each in controllers.items()
    }
    print(table(errors))
    if len(policies) > 1:
        print(over_trainings({name: errors[name] for name in policies}))
    if not arguments.only_policies:
        for name in policies:
            for against in (each for each in controllers if each not in policies):
                print(compared(name, errors[name], against, errors[against]))
        print(by_size(env, errors, designs))
    if not arguments.only_policies and not arguments.blind and not arguments.space:
        five = [design for design in designs if links(env, design) == 5]
        alone = errors_of(env, Specialist("fixed_target"), five, arguments.episodes, seeds.start)
        print(f"\n{len(five)} designs with five links: the specialist of five_link has {interval(alone)} mm")
    if arguments.out:
        arguments.out.write_text(json.dumps({name: each.round(5).tolist() for name, each in errors.items()}))
    return 0


def policy_of(run: str | Path, which: str) -> Controller:
    """The policy in a run folder, or the shipped one of that name."""
    return load_driving(RunFolder.open(Path(run)), which) if Path(run).is_dir() else load_policy(str(run))


def drawn(env: EnvConfig) -> DrawnDesigns:
    """The designs of an environment."""
    designs: DrawnDesigns = env.arguments()["config"].mechanisms.drawn
    return designs


def links(env: EnvConfig, design: int) -> int:
    """Number of links of a design."""
    return drawn(env)[design].n_links


def errors_of(env: EnvConfig, controller: Controller, designs: Sequence[int], episodes: int, seed: int) -> Errors:
    """Mean tip error over the last 10 steps, (designs, episodes) [mm]; design k of a range has seeds of its own."""
    blocks = []
    for first in range(0, len(designs), TOGETHER):
        block = designs[first : first + TOGETHER]
        options = [fixed for design in block for fixed in [{"design": design}] * episodes]
        seeds = [each for design in block for each in seeds_of(design, episodes, seed)]
        driven = run_with_options(env, controller, seeds, options)
        blocks.append(driven.last_errors.mean(axis=1).reshape(len(block), episodes))
    return np.concatenate(blocks)


def seeds_of(design: int, episodes: int, seed: int) -> list[int]:
    """Seeds of the episodes of a design, where those of a range begin at `seed`."""
    return [seed + design % DESIGNS_TO_CHOOSE.start * episodes + each for each in range(episodes)]


def way_of(env: EnvConfig, policy: Controller, designs: Sequence[int], seed: int) -> str:
    """Steps at full speed from where an episode of every design begins to where a policy ends it."""
    config = env.arguments()["config"]
    envs = gymnasium.make_vec(env.id, len(designs), "vector_entry_point", config=config)
    observations, _ = envs.reset(seed=seed, options={"lanes": [{"design": design} for design in designs]})
    policy.begin(envs)
    begun = envs.unwrapped.tangent().commands
    for _ in range(config.episode_steps):
        observations, *_ = envs.step(policy.act(observations))
    steps = np.abs(envs.unwrapped.tangent().commands - begun).max(axis=1) / config.action_scale_mm
    median, most = np.median(steps), steps.max()
    return f"steps of the tendon with the longest way, {len(designs)} episodes: median {median:.1f}, at most {most:.1f}"


def why_lost(
    env: EnvConfig, controllers: dict[str, Controller], seen: str, designs: Sequence[int], episodes: int, seed: int
) -> str:
    """A row per controller: how many of its lost episodes no command saves, and how many others a policy saves.

    This is the shipped policy `seen`, which sees the tip. A longer episode is the same one, with more steps.
    """
    floors = np.array([_floors(env, design, seeds_of(design, episodes, seed)) for design in designs])
    beyond, worlds = floors > LOST, [replace(env, settings=more) for more in ({}, {"episode_steps": LONGER})]
    saved = [errors_of(world, load_policy(seen), designs, episodes, seed) <= LOST for world in worlds]
    rows = []
    for name, controller in controllers.items():
        lost = errors_of(env, controller, designs, episodes, seed) > LOST
        rest = lost & ~beyond
        counts = lost, lost & beyond, rest & saved[0], rest & ~saved[0] & saved[1], rest & ~saved[0] & ~saved[1]
        rows.append([name, *(str(each.sum()) for each in counts)])
    header = [
        f"of {floors.size} episodes",
        f"above {LOST:g} mm",
        "the floor, too",
        f"{seen} is not",
        f"not after {LONGER} steps",
        "others",
    ]
    return f"mean floor {interval(floors)} mm\n{markdown_table(header, rows)}"


def _floors(env: EnvConfig, design: int, seeds: Sequence[int]) -> Errors:
    own = replace(env, settings={**env.settings, "mechanisms": {"designs": (design, design + 1)}})
    return episode_floor(own, seeds).errors


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


def over_trainings(errors: dict[str, Errors]) -> str:
    """Mean over trainings of their mean error, and of the median over all episodes, with Student's 95 % interval."""
    lines = []
    for name, measure in (("mean", np.mean), ("median", np.median)):
        values = np.array([measure(each) for each in errors.values()])
        half = stats.t.ppf(0.975, len(values) - 1) * stats.sem(values)
        lines.append(
            f"{name} error of {len(values)} trainings: {values.mean():.3f} mm [{values.mean() - half:.3f}, "
            f"{values.mean() + half:.3f}], from {values.min():.3f} to {values.max():.3f}"
        )
    return "\n".join([*lines, ""])


def beside_specialists(
    env: EnvConfig, policies: dict[str, Controller], runs: Sequence[Path], which: str, episodes: int, seeds: range
) -> str:
    """A row per specialist: its design, its mean and median error there, and those of the policies.

    The last rows have the ratio of the mean errors to that of the specialists, with an interval over designs, and the
    median of the ratios of all designs.
    """
    rows, means = [], []
    for run in runs:
        folder = RunFolder.open(run)
        design, _ = folder.config().env.settings["mechanisms"]["designs"]
        drivers = {"specialist": load_driving(folder, which), **policies}
        errors = [errors_of(env, each, [design], episodes, seeds.start) for each in drivers.values()]
        means.append([each.mean() for each in errors])
        cells = [f"{each.mean():.3f}, {np.median(each):.3f}" for each in errors]
        rows.append([str(design), str(links(env, design)), *cells])
    each, rng = np.array(means), np.random.default_rng(0)  # (specialists, drivers)
    average, drawn = each.mean(axis=0), each[rng.integers(len(each), size=(10_000, len(each)))].mean(axis=1)
    ratios = average / average[0]
    low, high = np.percentile(drawn / drawn[:, :1], [2.5, 97.5], axis=0)
    rows.append(["mean", "", *(f"{mean:.3f}" for mean in average)])
    cells = [f"{ratio:.2f} [{first:.2f}, {last:.2f}]" for ratio, first, last in zip(ratios, low, high, strict=True)]
    rows.append(["over specialists", "", "1", *cells[1:]])
    rows.append(["median ratio", "", *(f"{ratio:.2f}" for ratio in np.median(each / each[:, :1], axis=0))])
    header = ["design", "links", "specialist [mm]", *(f"{name} [mm]" for name in policies)]
    return markdown_table(header, rows)


def compared(name: str, errors: Errors, opponent: str, told: Errors) -> str:
    """The difference to an opponent, and the same in the episodes that neither has lost."""
    kept = (errors <= LOST) & (told <= LOST)
    ours, theirs = (np.where(kept, each, np.nan) for each in (errors, told))
    return (
        f"{name} minus {opponent}: {interval(errors - told)} mm; in the {100 * kept.mean():.1f} % of episodes with at "
        f"most {LOST:g} mm for both: {interval(ours - theirs)} mm, {np.nanmean(ours):.3f} and "
        f"{np.nanmean(theirs):.3f} mm\n"
    )


def by_size(env: EnvConfig, errors: dict[str, Errors], designs: Sequence[int]) -> str:
    """A row per number of links: designs, and the median and mean error of every controller."""
    sizes = np.array([links(env, design) for design in designs])
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


def filmed(env: EnvConfig, policy: Controller, first: int) -> bytes:
    """GIF of an episode with the first design of every number of links, from `first` on."""
    sizes: dict[int, int] = {}
    for design in range(first, first + 100):
        sizes.setdefault(links(env, design), design)
    frames = {}
    for size, design in sorted(sizes.items()):
        own = replace(env, settings={**env.settings, "mechanisms": {"designs": (design, design + 1)}})
        frames[f"{size} links"] = film(own, policy, MANY_TEST.stop - 1)[:36:2]
    return animation(frames, 400, columns=3)


if __name__ == "__main__":
    raise SystemExit(main())
