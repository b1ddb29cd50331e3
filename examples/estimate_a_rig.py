"""What a rig hides, from positions and tensions of its motors: load, play and friction with intervals, step by step.

Run: python examples/estimate_a_rig.py [--out DIR]
"""

import argparse
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import numpy as np
from matplotlib import pyplot

import rollingjoint as rj
from rollingjoint import estimate
from rollingjoint.plotting import PALETTE, save_figure

STEPS = 40
RANGES = estimate.HiddenRanges(
    force=(0.0, 1.0), offset_mm=(-0.5, 0.5), stiffness=(0.8, 1.2), play_mm=(0.5, 2.0), sheath_friction=(0.0, 0.3)
)
SENSORS = estimate.RigSensors(tension_sd=0.05, start_tension=5.0)


def main(argv: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out"))
    out = parser.parse_args(argv).out
    mechanism, rig = rj.five_link(), rig_of(rj.five_link())
    estimators = {
        "whole history": estimate.RigSmoother(mechanism, RANGES, SENSORS),
        "recursive": estimate.RigFilter(mechanism, RANGES, SENSORS),
    }
    shown = {name: [] for name in estimators}
    for positions, tensions in zip(rig.positions[:, 0], rig.tensions[:, 0], strict=True):
        for name, estimator in estimators.items():
            estimator.update(positions, tensions)
            shown[name].append((estimator.load, estimator.play))
    for name, estimator in estimators.items():
        print(f"{name}:")
        for what, truth in (("load", rig.forces), ("play", rig.play), ("friction", rig.friction)):
            found = getattr(estimator, what)
            for mean, low, high, true in zip(found.mean, found.low, found.high, truth[0], strict=True):
                print(f"  {what:8} {mean:6.3f}, 95 % from {low:6.3f} to {high:6.3f}; true {true:6.3f}")
    out.mkdir(parents=True, exist_ok=True)
    print(f"wrote {save_figure(draw(shown, rig), out / 'estimates.png')}")


def rig_of(mechanism: rj.RollingChain) -> estimate.SimulatedRigs:
    """A simulated rig whose motors run to and fro."""
    time = np.arange(float(STEPS))[:, None]
    waves = 2.5 * (np.sin(2.0 * np.pi * time / [12.0, 9.0] + [0.0, 1.0]) - np.sin([0.0, 1.0]))
    return estimate.simulated_rigs(mechanism, waves - np.minimum(time / 4.0, 1.0), RANGES, SENSORS, seed=5)


def draw(shown: dict[str, list], rig: estimate.SimulatedRigs) -> pyplot.Figure:
    figure, panels = pyplot.subplots(2, 2, figsize=(9, 6), layout="constrained", sharex=True, sharey="row")
    steps = np.arange(1, STEPS + 1)
    for column, (name, series) in zip(panels.T, shown.items(), strict=True):
        for panel, number, truth in ((column[0], 0, rig.forces[0]), (column[1], 1, rig.play[0])):
            for axis, label in enumerate(("x", "y") if number == 0 else ("tendon 0", "tendon 1")):
                found = [pair[number] for pair in series]
                low, mean, high = (np.array([getattr(f, end)[axis] for f in found]) for end in ("low", "mean", "high"))
                panel.fill_between(steps, low, high, color=PALETTE[axis], alpha=0.25, linewidth=0)
                panel.plot(steps, mean, color=PALETTE[axis], label=label)
                panel.axhline(truth[axis], color=PALETTE[axis], linestyle="--", linewidth=1)
            panel.legend(loc="upper right")
        column[0].set(title=f"{'RigSmoother' if name == 'whole history' else 'RigFilter'}: {name}")
        column[1].set(xlabel="step")
    panels[0, 0].set(ylabel="force on the tip [N]")
    panels[1, 0].set(ylabel="width of the play [mm]")
    return figure


if __name__ == "__main__":
    main()
