"""Cost of steps among walls against the same steps without, and the steps that fail.

    python benchmarks/walls.py
    python benchmarks/walls.py --in-space
    python benchmarks/walls.py --failures 100000

Instruments start straight in random scenes and take 24 steps of random commands, up to 1 mm a tendon and step; in a
lumen or tube the base goes on by -0.5 to 2 mm a step. Every step starts at the last equilibrium. All rows are solved
one by one on one core by the general solver, which is also that of the steps without walls; best of the repeats,
processor time.
--failures counts the steps without an equilibrium in tissue of 1 and 10 N/mm with coefficients of friction of 0, 0.1
and 0.3; after a failure a row goes on from its last equilibrium.
"""

from __future__ import annotations

import argparse
import itertools
import time
from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

import rollingjoint as rj
from benchmarks.walls_in_space import wall_of
from rollingjoint._numba.layout import Integers
from rollingjoint.chain.batch import _on_batch, step_range_among_walls
from rollingjoint.chain.friction_step import no_friction
from rollingjoint.chain.wall_step import new_wall_arrays, touch
from rollingjoint.kernels.arrays import INDETERMINATE, TendonLaw
from rollingjoint.kernels.batch import solve_lanes
from rollingjoint.kernels.friction import new_friction_arrays
from rollingjoint.kernels.walled_solve import solve_among_walls
from rollingjoint.statics.among import stacked_walls

Array = NDArray[np.float64]

SCENES = "plane", "discs", "lumen"
IN_SPACE = (
    "small_arm beside a plane",
    "pitch_yaw beside a sphere",
    "pitch_yaw beside a capsule",
    "eight beads in a tube",
)
STEPS, ROWS, SEED = 24, 64, 0
STIFFNESSES, COEFFICIENTS = (1.0, 10.0), (0.0, 0.1, 0.3)
_LEFT = Annotated[Integers, "left"]


CHAINS = {
    "small_arm": rj.small_arm(),
    "pitch_yaw": rj.pitch_yaw(),
    "eight": rj.HingeChain(
        [rj.Bead(10.0, "y" if i % 2 else "x", 120.0, gap=3.0) for i in range(8)],
        [rj.BeadTendon([hole]) for hole in ((6.0, 0.0), (0.0, 6.0), (-6.0, 0.0), (0.0, -6.0))],
    ),
}


@dataclass
class Tally:
    """Counts of the steps of a walk."""

    seconds: float = 0.0
    steps: int = 0
    iterations: int = 0
    evaluations: list[Array] = field(default_factory=list)  # of every row, by step
    touching: int = 0
    failures: list[tuple[int, int]] = field(default_factory=list)  # row and step


def chain_of(scene: str) -> Any:
    """The instrument of a scene."""
    if scene in IN_SPACE:
        return CHAINS[scene.split()[0]]
    return rj.five_link() if scene == "plane" else rj.two_segment(4, 4, height=10.0, radius=7.0, half_width=5.0)


def surroundings_of(scene: str, rng: np.random.Generator, stiffness: float, mu: float) -> rj.Surroundings:
    """A random scene."""
    side, outline, friction = rng.choice([-1.0, 1.0]), rj.Sleeve(8.0 if scene == "plane" else 4.5), None
    if mu > 0.0:
        friction = rj.WallFriction(mu)
    if scene in IN_SPACE:
        chain = chain_of(scene)
        return rj.Surroundings(
            [wall_of(scene.split()[-1], chain, rng, stiffness)], rj.Sleeve(chain.hole_radius), friction
        )
    if scene == "plane":
        angle = rng.uniform(-0.3, 0.3)
        normal = side * np.cos(angle), np.sin(angle)
        return rj.Surroundings([rj.HalfPlane(normal, -rng.uniform(12, 25), stiffness=stiffness)], outline, friction)
    if scene == "discs":
        places = [(rng.choice([-1, 1]) * rng.uniform(12, 25), rng.uniform(25, 80)) for _ in range(3)]
        return rj.Surroundings(
            [rj.Disc(place, rng.uniform(3, 6), stiffness=stiffness) for place in places], outline, friction
        )
    (first, second), turns = rng.uniform(28, 45, 2), rng.uniform((0.5, 0.4), (1.2, 1.0))
    lengths = rng.uniform(25, 40), first * turns[0], rng.uniform(5, 15), second * turns[1], 40.0
    curvatures = 0.0, side / first, 0.0, side * rng.choice([-1, 1]) / second, 0.0
    lumen = rj.Lumen(lengths, curvatures, radii=7.5, start=(0.0, 0.0, np.pi / 2), stiffness=stiffness)
    return rj.Surroundings([lumen], outline, friction)


def walk(scene: str, stiffness: float | None, mu: float, rows: int = ROWS, seed: int = SEED) -> Tally:
    """One walk of all rows; stiffness: None for no walls."""
    chain, rng, tally = chain_of(scene), np.random.default_rng(seed), Tally()
    walls = stacked_walls([surroundings_of(scene, rng, stiffness or 1.0, mu).arrays(chain) for _ in range(rows)])
    m, joints = chain.n_tendons, chain.n_joints
    rest = chain.neutral_lengths - 2.0 / chain.stiffnesses
    stiffnesses, low, high = (np.tile(v, (rows, 1)) for v in (chain.stiffnesses, np.full(m, 0.5), np.full(m, 15.0)))
    angles, offsets, bases = (
        np.tile(chain.neutral_angles, (rows, 1)),
        np.zeros((rows, m)),
        np.zeros((rows, 3 * chain.dimension - 3)),
    )
    tables, designs, before = np.zeros((rows, 0, len(chain.load_columns))), np.zeros(rows, np.int64), None
    for step in range(STEPS + 1):
        if step:
            offsets = np.clip(offsets + rng.uniform(-1.0, 1.0, offsets.shape), -6.0, 6.0)
            if scene.endswith(("lumen", "tube")):
                feed = bases[:, chain.dimension - 1]
                feed[:] = np.maximum(feed + rng.uniform(-0.5, 2.0, rows), 0.0)
        law = TendonLaw(rest + offsets, stiffnesses, low, high)
        results = chain.kernels.new_results(rows, joints, m)
        batch = chain.kernels.batch_arrays(chain.arrays, designs, law, tables, angles, results)
        around = new_wall_arrays(walls, np.arange(rows), bases.copy(), joints, before)
        seconds = _solve(batch, None if stiffness is None else around, before is not None)
        if mu > 0.0 and stiffness is not None:
            if before is None:
                touch((chain.arrays, designs), results.joint_angles, around)
            before = type(around.after)(*around.after)
        if step:
            _count(tally, step, seconds, results, around)
        found = results.status <= INDETERMINATE
        angles = np.where(found[:, None], results.joint_angles, angles)
    return tally


def _solve(batch: Any, around: Any, with_memory: bool) -> float:
    """Solve all rows; returns the processor time [s]."""
    rows = len(batch.starts)
    if around is None:
        kernel, kind = _on_batch(solve_lanes, type(batch), _LEFT), np.arange(rows)
        begin = time.process_time()
        kernel(*batch, kind)
        return time.process_time() - begin
    if with_memory:
        friction = new_friction_arrays(*no_friction(batch.starts, batch.laws.low.shape[1]))
        begin = time.process_time()
        step_range_among_walls(batch, friction, around, 0, rows)
        return time.process_time() - begin
    general, every = _on_batch(solve_among_walls, type(batch), type(around), _LEFT), np.arange(rows)
    begin = time.process_time()
    general(*batch, around, every)
    return time.process_time() - begin


def _count(tally: Tally, step: int, seconds: float, results: Any, around: Any) -> None:
    tally.seconds, tally.steps = tally.seconds + seconds, tally.steps + len(results.status)
    tally.iterations += int(results.iterations.sum())
    tally.evaluations.append(around.evaluations.copy())
    tally.touching += int((around.after.normals > 0.0).any(1).sum())
    tally.failures += [(int(row), step) for row in np.flatnonzero(results.status > INDETERMINATE)]


def print_cost(repeats: int, scenes: tuple[str, ...] = SCENES) -> None:
    """The table of costs in tissue of 1 N/mm."""
    print("| scene | friction | a step | times free | iterations | evaluations, dearest 1 % | touching | failures |")
    print("|---|--:|--:|--:|--:|--:|--:|--:|")
    for scene in scenes:
        cases = (None, 0.0), (1.0, 0.0), (1.0, 0.1)
        best: dict[Any, Tally] = {}
        for _, case in itertools.product(range(repeats), cases):
            tally = walk(scene, *case)
            best[case] = min(best.get(case, tally), tally, key=lambda one: one.seconds)
        for case, one in best.items():
            name = "no walls" if case[0] is None else f"{case[1]:g}"
            every = np.sort(np.concatenate(one.evaluations))
            dearest = every[-max(1, len(every) // 100) :].sum() / max(every.sum(), 1)
            evaluations = "" if case[0] is None else f"{every.mean():.2f}, {100 * dearest:.0f} %"
            print(
                f"| {scene} | {name} | {1e6 * one.seconds / one.steps:.1f} µs "
                f"| {one.seconds / best[cases[0]].seconds:.2f} | {one.iterations / one.steps:.2f} | {evaluations} "
                f"| {100 * one.touching / one.steps:.0f} % | {len(one.failures)} of {one.steps:,} |",
                flush=True,
            )


def print_single(repeats: int, scene: str = "discs") -> None:
    """The cost of a public solve with three walls."""
    chain, rng = chain_of(scene), np.random.default_rng(SEED)
    walls: list[rj.Wall] = [rj.HalfPlane((1, 0), -20), rj.HalfPlane((-1, 0), -20), rj.Disc((0, 100), 6)]
    if scene in IN_SPACE:
        walls = [rj.Plane((1, 0, 0), -20), rj.Plane((-1, 0, 0), -20), rj.Sphere((0, 0, chain.length + 15), 6)]
    three = rj.Surroundings(walls, rj.Sleeve(4.5))
    rest = chain.neutral_lengths - 2.0 / chain.stiffnesses
    commands = rest + np.clip(np.cumsum(rng.uniform(-0.5, 0.5, (1000, chain.n_tendons)), axis=0), -4.0, 4.0)
    best = {}
    for _, around in itertools.product(range(repeats), (None, three)):
        pose, begin = None, time.process_time()
        for command in commands:
            pose = rj.solve_lengths(chain, command, start=pose, tension_limits=(0.5, 15.0), surroundings=around)
        seconds = (time.process_time() - begin) / len(commands)
        best[around is None] = min(best.get(around is None, np.inf), seconds)
    free, among = 1e6 * best[True], 1e6 * best[False]
    print(f"public solve, {scene}: {free:.1f} µs, with three walls {among:.1f} µs, {among / free:.2f} times")


def print_lanes(repeats: int, scene: str) -> None:
    """The cost of a step without walls in a public batch, which goes to the SIMD lanes, and in the general solver."""
    chain, times = chain_of(scene), []
    rest = chain.neutral_lengths - 2.0 / chain.stiffnesses
    for _ in range(repeats):
        rng, offsets, angles, seconds = np.random.default_rng(SEED), np.zeros((ROWS, chain.n_tendons)), None, 0.0
        for _ in range(STEPS):
            begin = time.process_time()
            found = rj.solve_lengths_batch(chain, rest + offsets, starts=angles, tension_limits=(0.5, 15.0))
            seconds, angles = seconds + time.process_time() - begin, found.joint_angles
            offsets = np.clip(offsets + rng.uniform(-1.0, 1.0, offsets.shape), -6.0, 6.0)
        times.append(seconds)
    general = min(walk(scene, None, 0.0).seconds for _ in range(repeats))
    lanes, general = (1e6 * seconds / (ROWS * STEPS) for seconds in (min(times), general))
    print(f"without walls, {scene}: {lanes:.1f} µs a step in lanes, {general:.1f} µs in the general solver")


def print_failures(least: int) -> None:
    """Failures in at least so many steps, over all scenes, stiffnesses and coefficients of friction."""
    steps, failures, seed = 0, 0, SEED
    while steps < least:
        for scene, stiffness, mu in itertools.product(SCENES, STIFFNESSES, COEFFICIENTS):
            tally = walk(scene, stiffness, mu, seed=seed)
            steps, failures = steps + tally.steps, failures + len(tally.failures)
            for row, step in tally.failures:
                print(f"{scene}, {stiffness:g} N/mm, friction {mu:g}, seed {seed}: row {row}, step {step}", flush=True)
        seed += 1
    print(f"{failures} of {steps:,} steps fail")


def main() -> None:
    """Print the table, or count failures."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--failures", type=int, metavar="N", help="count the failures in at least N steps")
    parser.add_argument("--in-space", action="store_true", help="the costs around chains in space")
    parser.add_argument("--repeats", type=int, default=5, help="repeats of a measurement, default 5")
    settings = parser.parse_args()
    if settings.failures is not None:
        print_failures(settings.failures)
    elif settings.in_space:
        print_cost(settings.repeats, IN_SPACE)
        for scene in IN_SPACE[:2]:
            print_single(settings.repeats, scene)
        for scene in (IN_SPACE[0], IN_SPACE[1], IN_SPACE[3]):
            print_lanes(settings.repeats, scene)
    else:
        print_cost(settings.repeats)
        print_single(settings.repeats)


if __name__ == "__main__":
    main()
