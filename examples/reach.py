"""Where a mechanism of two segments can bring its tip within tension limits: a table and a picture.

Run: python examples/reach.py [--out DIR]
"""

import argparse
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import numpy as np
from matplotlib import pyplot

import rollingjoint as rj
from rollingjoint.plotting import PALETTE, save_figure

LIMITS = (1.0, 8.0)  # N
LOADS = [rj.WorldForce(-1, (0.2, 0.0))]
RADII, TURNS = np.linspace(74, 92, 7), np.linspace(-1.1, 1.1, 12)  # mm and rad of the targets from the base


def main(argv: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out"))
    out = parser.parse_args(argv).out
    mechanism = rj.two_segment()
    radii, turns = np.meshgrid(RADII, TURNS)
    targets = np.stack([radii * np.sin(turns), radii * np.cos(turns)], axis=-1).reshape(-1, 2)
    result = rj.reach_batch(mechanism, targets, LOADS, LIMITS)
    print(f"{np.sum(result.ok)} of {len(targets)} targets within reach; the others:")
    for row in np.flatnonzero(~result.ok)[::8]:
        one = result.row(int(row))
        print(f"({targets[row, 0]:4.0f}, {targets[row, 1]:4.0f}) mm: {one.distance:5.2f} mm off; {one.binding}")
    out.mkdir(parents=True, exist_ok=True)
    print(f"wrote {save_figure(draw(targets, result), out / 'reach.png')}")


def draw(targets: np.ndarray, result: rj.Reach) -> pyplot.Figure:
    figure, axes = pyplot.subplots(figsize=(7, 5), layout="constrained")
    for row in np.flatnonzero(result.ok):
        axes.plot(*result.equilibrium.positions[row].T, color=PALETTE[0], alpha=0.35, linewidth=1.5)
    for target, tip in zip(targets[~result.ok], result.tip[~result.ok], strict=True):
        axes.plot(*np.stack([target, tip]).T, color="0.6", linewidth=1)
    axes.plot(*targets[result.ok].T, "o", color=PALETTE[0], label="reached")
    axes.plot(*targets[~result.ok].T, "x", color=PALETTE[5], label="out of reach, with a line to the nearest tip")
    axes.set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal", title="Tips of two_segment, tensions from 1 to 8 N")
    figure.legend(loc="outside lower center", ncols=2)
    return figure


if __name__ == "__main__":
    main()
