"""Steps among walls in space that fail.

    python benchmarks/walls_in_space.py --steps 40000

An arm of beads and two chains of rolling joints start straight among random walls of 1 and 10 N/mm with coefficients
of friction of 0, 0.1 and 0.3, and take 24 steps of random commands, up to 1 mm per tendon and step; in a tube the base
goes on by -0.5 to 2 mm a step. Every step starts at the last equilibrium, after a failure at the one before it.
"""

from __future__ import annotations

import argparse
import itertools
from collections import Counter

import numpy as np

import rollingjoint as rj

CHAINS = {
    "small_arm": rj.small_arm(),
    "small_arm of joints": rj.SpatialChain.from_arm(rj.small_arm()),
    "pitch_yaw": rj.pitch_yaw(),
}
SCENES = "plane", "sphere", "capsule", "tube"
STIFFNESSES, COEFFICIENTS = (1.0, 10.0), (0.0, 0.1, 0.3)
STEPS, SEED = 24, 0
LIMITS = (0.5, 30.0)  # N


def wall_of(scene: str, chain: rj.HingeChain | rj.SpatialChain, rng: np.random.Generator, stiffness: float) -> rj.Wall:
    """A random wall of a kind beside a straight chain, or around it."""
    wide, height, turn = chain.hole_radius, chain.length, rng.uniform(0.0, 2.0 * np.pi)
    out, up = np.array([np.cos(turn), np.sin(turn), 0.0]), np.array([0.0, 0.0, height * rng.uniform(0.4, 1.0)])
    away, radius = wide * rng.uniform(1.02, 1.2), wide * rng.uniform(0.3, 1.0)
    if scene == "plane":
        return rj.Plane(-out + rng.normal(0.0, 0.1, 3), -1.1 * away, stiffness=stiffness)
    if scene == "sphere":
        return rj.Sphere((away + radius) * out + up, radius, stiffness=stiffness)
    if scene == "capsule":
        way = rng.normal(0.0, wide, 3)
        middle = (away + 0.5 * radius) * out + up
        return rj.Capsule(middle - way, middle + way, 0.5 * radius, stiffness=stiffness)
    points = np.array([[0.0, 0.0, z * height] for z in (-0.5, 0.3, 0.8, 1.5)])
    points[1:] += rng.normal(0.0, 0.2 * wide, (3, 3)) * [1.0, 1.0, 0.0]
    return rj.Tube.through(points, 1.15 * wide, 0.6 * height, stiffness=stiffness)


def walk(name: str, scene: str, stiffness: float, mu: float, seed: int) -> tuple[Counter[str], int]:
    """Statuses of the steps of one walk, and the number of those in contact."""
    chain, rng = CHAINS[name], np.random.default_rng([seed, list(CHAINS).index(name), SCENES.index(scene)])
    friction = rj.WallFriction(mu) if mu > 0.0 else None
    walls = rj.Surroundings([wall_of(scene, chain, rng, stiffness)], rj.Sleeve(chain.hole_radius), friction)
    command, base, kept = chain.neutral_lengths - 2.0 / chain.stiffnesses, np.zeros(3), None
    statuses: Counter[str] = Counter()
    touching = 0
    for _ in range(STEPS):
        past = {"history" if mu > 0.0 else "start": kept} if kept is not None else {}
        found = rj.solve_lengths(chain, command, tension_limits=LIMITS, surroundings=walls, base=base, **past)
        statuses[found.status.name] += 1
        if found.ok:
            kept, touching = found, touching + bool(found.wall_contacts)
        command = command + rng.uniform(-1.0, 1.0, command.shape)
        base[2] += rng.uniform(-0.5, 2.0) if scene == "tube" else 0.0
    return statuses, touching


def main() -> None:
    """Count statuses of at least so many steps."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--steps", type=int, default=40_000, help="at least so many steps (default 40000)")
    least = parser.parse_args().steps
    statuses: Counter[str] = Counter()
    touching = bad = 0
    for seed in itertools.count(SEED):
        if statuses.total() >= least:
            break
        for case in itertools.product(CHAINS, SCENES, STIFFNESSES, COEFFICIENTS):
            found, touched = walk(*case, seed)
            statuses, touching = statuses + found, touching + touched
            failed = {status: count for status, count in found.items() if status not in ("CONVERGED", "AT_LIMIT")}
            if failed:
                print("{}, {}, {:g} N/mm, friction {:g}".format(*case), f"seed {seed}: {failed}", flush=True)
            bad += sum(failed.values())
    print(f"{bad} of {statuses.total():,} steps fail, {touching:,} are in contact: {dict(statuses)}")


if __name__ == "__main__":
    main()
