"""Time of a step with 64 different mechanisms and with one, in the plane and in space.

    python benchmarks/many_mechanisms.py               # the table of docs/generalist.md
    python benchmarks/many_mechanisms.py --lanes 64    # with this number of lanes alone

Every lane draws one of 64 designs in every episode. "One mechanism" is the mean over twelve of these designs, each
alone in rj_gym/RollingJoint-v0, or rj_gym/PitchYaw-v0, with as many lanes. Episodes restart by themselves, and actions
are uniform random numbers. All environments take turns; each counts with the least processor time of its rounds.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from time import process_time
from typing import Any

import gymnasium
import numpy as np

import rj_gym  # noqa: F401  (registers the environments)
from rollingjoint.tables import markdown_table

STEPS = 102  # two episodes and their restarts
DESIGNS = 64
ALONE = 12  # of them are timed alone
IDS = {
    "plane": ("rj_gym/ManyMechanisms-v0", "rj_gym/RollingJoint-v0"),
    "space": ("rj_gym/ManyMechanismsInSpace-v0", "rj_gym/PitchYaw-v0"),
}


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--lanes", type=int, nargs="+", default=[64, 256, 1024])
    parser.add_argument("--rounds", type=int, default=5)
    arguments = parser.parse_args(argv)
    rows = [
        [
            f"{links[0]} to {links[1]}" if links[0] < links[1] else f"{links[0]}",
            where,
            f"{lanes:,}",
            *_row(where, links, lanes, arguments.rounds),
        ]
        for links, where in (((5, 5), "plane"), ((3, 8), "plane"), ((3, 8), "space"))
        for lanes in arguments.lanes
    ]
    print(markdown_table(["links", "in", "lanes", "one mechanism [µs]", "64 mechanisms [µs]", "ratio"], rows, left=2))
    return 0


def _row(where: str, links: tuple[int, int], lanes: int, rounds: int) -> list[str]:
    """Microseconds per lane and step of one mechanism and of 64, and their ratio."""
    of_many, of_one = IDS[where]
    many = _made(of_many, lanes, mechanisms={"links": links, "designs": (0, DESIGNS)})
    chosen = np.linspace(0, DESIGNS - 1, ALONE).astype(int).tolist()
    alone = [_made(of_one, lanes, mechanism=many.unwrapped.task.design(k).mechanism) for k in chosen]
    best = np.full(1 + ALONE, np.inf)
    for _ in range(rounds):
        for place, env in enumerate([many, *alone]):
            best[place] = min(best[place], _seconds(env))
    per_step = 1e6 * best / (STEPS * lanes)
    return [f"{per_step[1:].mean():.2f}", f"{per_step[0]:.2f}", f"{per_step[0] / per_step[1:].mean():.2f}"]


def _made(env_id: str, lanes: int, **settings: Any) -> Any:
    """An environment whose designs are drawn and whose kernels are compiled."""
    env = gymnasium.make_vec(env_id, lanes, "vector_entry_point", **settings)
    if "mechanisms" in settings:
        for first in range(0, DESIGNS, lanes):
            env.reset(options={"lanes": [{"design": (first + lane) % DESIGNS} for lane in range(lanes)]})
    _seconds(env)
    return env


def _seconds(env: Any) -> float:
    """Processor time of STEPS steps [s]."""
    rng = np.random.default_rng(0)
    actions = rng.uniform(-1.0, 1.0, (STEPS, *env.action_space.shape)).astype(np.float32)
    env.reset(seed=0)
    begun = process_time()
    for action in actions:
        env.step(action)
    return process_time() - begun


if __name__ == "__main__":
    raise SystemExit(main())
