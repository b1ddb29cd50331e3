"""How often 95 % intervals of an identified rig hold the true numbers, over simulated rigs.

    python benchmarks/rig_intervals.py --rigs 1000

Every rig has play, sheath friction, stiffnesses and offsets drawn from the beliefs of identification, load cells with
0.1 N of noise and a camera with 0.2 mm; its motors sweep for 300 steps.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace

import numpy as np

from agents.rig.simulated.plant import Plant
from rollingjoint import five_link
from rollingjoint.errors import RollingJointError
from rollingjoint.identify import RecordedRun, RigRecording, identify_rig
from rollingjoint.identify.beliefs import RigSpace

KINDS = ("play", "sheath", "stiffness", "offsets")
STEPS, CAMERA_MM, HOME_MM = 300, 0.2, 1.0


def main() -> None:
    """Print the share of numbers within their intervals, by kind."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--rigs", type=int, default=100)
    parser.add_argument("--seconds", type=float, default=1e9, help="after which no further rig is begun")
    arguments = parser.parse_args()
    inside, failed, begun = [], 0, time.monotonic()
    for seed in range(arguments.rigs):
        if time.monotonic() - begun > arguments.seconds:
            break
        try:
            inside.append(covered(seed))
        except RollingJointError as error:
            failed += 1
            print(f"rig {seed}: {error}")
    shares = np.array(inside, float).reshape(len(inside), len(KINDS), -1).mean(axis=(0, 2))
    print(f"{len(inside)} rigs, {failed} not identified:", end=" ")
    print(", ".join(f"{kind} {100 * share:.1f} %" for kind, share in zip(KINDS, shares, strict=True)))
    print(f"all {100 * np.mean(inside):.1f} %")


def covered(seed: int) -> list[bool]:
    """Whether the intervals of a rig hold its numbers."""
    rng, nominal = np.random.default_rng(seed), five_link()
    space = RigSpace(nominal, KINDS)
    truth = np.clip(
        rng.normal(space.mean, space.sd), np.maximum(space.low, [0.2] * 4 + [0.4] * 2 + [-50.0] * 2), space.high
    )
    truth[space.place("offsets")] = rng.normal(0.0, HOME_MM, 2)
    values = space.fields(truth)
    factors = zip(nominal.tendons, values["stiffness"], strict=True)
    chain = nominal.replace(
        tendons=[replace(tendon, stiffness=tendon.stiffness * factor) for tendon, factor in factors]
    )
    plant = Plant(chain, values["play"], values["sheath"], values["offsets"], start_tension=5.0, seed=seed)
    middle, rows = plant.q.copy(), []
    at, end, side = middle.copy(), middle.copy(), 1.0
    for _ in range(STEPS):
        if np.abs(end - at).max() < 1e-9:
            end = middle + side * rng.uniform(5.0, 8.0) * np.array([1.0, -1.0]) - rng.uniform(0.0, 2.0)
            side = -side
        at = at + np.clip(end - at, -1.0, 1.0)
        plant.move(at)
        rows.append((at, plant.weighed(), plant.tip + CAMERA_MM * rng.standard_normal(2)))
    motors, tensions, tips = (np.array(column) for column in zip(*rows, strict=True))
    run = RecordedRun(0.05 * np.arange(STEPS), motors, tensions, tips)
    ends = identify_rig(RigRecording([run], nominal), kinds=KINDS).intervals
    return ((ends[:, 0] <= truth) & (truth <= ends[:, 1])).tolist()


if __name__ == "__main__":
    main()
