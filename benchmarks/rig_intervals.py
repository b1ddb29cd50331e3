"""How often 95 % intervals of an identified rig hold the true numbers, over simulated rigs.

    python benchmarks/rig_intervals.py --rigs 1000
    python benchmarks/rig_intervals.py --rigs 100 --kinds play,sheath,mu,stiffness,offsets,surfaces

Every rig has numbers drawn from the beliefs of identification, load cells with 0.1 N of noise and a camera with 0.2 mm;
its motors sweep for 300 steps. Shares are printed with the standard error over rigs, and with the root mean square of
errors in standard deviations: 1 where intervals are as wide as they should be.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from agents.rig.simulated.plant import Plant
from rollingjoint import five_link
from rollingjoint.errors import RollingJointError
from rollingjoint.identify import RecordedRun, RigRecording, identify_rig
from rollingjoint.identify.beliefs import RIG_KINDS, RigSpace

FIRST_SEED = 100_000  # smaller ones were looked at while identification was written
KINDS = ("play", "sheath", "stiffness", "offsets")
LEAST = {"play": 0.2, "stiffness": 0.4}  # mm, 1: of what is drawn
STEPS, CAMERA_MM, HOME_MM = 300, 0.2, 1.0


def main() -> None:
    """Print the share of numbers within their intervals, by kind."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--rigs", type=int, default=100)
    parser.add_argument("--first", type=int, default=FIRST_SEED, help="seed of the first rig")
    parser.add_argument("--kinds", default=",".join(KINDS), help=f"sought, of {', '.join(RIG_KINDS)}")
    parser.add_argument("--seconds", type=float, default=1e9, help="after which no further rig is begun")
    arguments = parser.parse_args()
    kinds = arguments.kinds.split(",")
    space = RigSpace(five_link(), kinds)
    errors, inside, failed, begun = [], [], 0, time.monotonic()
    for seed in range(arguments.first, arguments.first + arguments.rigs):
        if time.monotonic() - begun > arguments.seconds:
            break
        try:
            held, scaled = covered(seed, space)
        except RollingJointError as error:
            failed += 1
            print(f"rig {seed}: {error}", flush=True)
            continue
        inside.append(held)
        errors.append(scaled)
    print(f"{len(inside)} rigs from seed {arguments.first}, {failed} not identified")
    held, scaled = np.array(inside, float), np.array(errors)
    for kind, place in [*((kind, space.place(kind)) for kind in kinds), ("all", slice(None))]:
        of_rigs = held[:, place].mean(axis=1)
        error = of_rigs.std(ddof=1) / np.sqrt(len(of_rigs)) if len(of_rigs) > 1 else np.nan
        size = np.sqrt(np.mean(scaled[:, place] ** 2))
        print(f"{kind}: {100 * of_rigs.mean():.1f} % (standard error {100 * error:.1f}), errors {size:.2f} sd")


def covered(seed: int, space: RigSpace) -> tuple[np.ndarray, np.ndarray]:
    """Whether the intervals of a rig hold its numbers, (P,), and errors in standard deviations, (P,)."""
    truth, recording = drawn(seed, space)
    found = identify_rig(recording, kinds=space.kinds)
    ends = found.intervals
    scaled = (found.values - truth) / np.sqrt(np.diag(found.covariance))
    return (ends[:, 0] <= truth) & (truth <= ends[:, 1]), scaled


def drawn(seed: int, space: RigSpace) -> tuple[np.ndarray, RigRecording]:
    """Numbers of a rig as the beliefs have them, (P,), and what it recorded."""
    rng = np.random.default_rng(seed)
    truth = rng.normal(space.mean, space.sd)
    if "offsets" in space.kinds:
        truth[space.place("offsets")] = rng.normal(0.0, HOME_MM, space.mechanism.n_tendons)
    low = space.low.copy()
    for kind, least in LEAST.items():
        if kind in space.kinds:
            low[space.place(kind)] = least
    truth = np.clip(truth, low, space.high)
    play, sheath, offsets = (space.value(truth, kind) for kind in ("play", "sheath", "offsets"))
    plant = Plant(space.chain(truth), play, sheath, offsets, start_tension=5.0, seed=seed)
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
    return truth, RigRecording([run], space.mechanism)


if __name__ == "__main__":
    main()
