"""Where a wall is that nobody sees, from positions and tensions of the motors of a chain that swings against it.

Run: python examples/find_a_wall.py [--out DIR]
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
from rollingjoint.surroundings import Sleeve

STEPS = 29
WALL = estimate.WallRanges(direction=(-0.5, 0.5), offset_mm=(-20.0, -5.0), compliance=(0.5, 3.0))
RANGES = estimate.HiddenRanges(force=(0.0, 0.0), offset_mm=(-0.3, 0.3), play_mm=(0.2, 0.8), sheath_friction=(0.0, 0.2))
SENSORS = estimate.RigSensors(tension_sd=0.05, start_tension=5.0)
SLEEVE = Sleeve(5.0)


def main(argv: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out"))
    out = parser.parse_args(argv).out
    mechanism, time = rj.five_link(), np.arange(float(STEPS))[:, None]
    swing = 5.0 * np.sin(2.0 * np.pi * time / 16.0) * [1.0, -1.0]
    tighter = np.minimum(time / 4.0, 1.0) + 0.7 * (1.0 - np.cos(2.0 * np.pi * time / 13.0))
    rig = estimate.simulated_rigs(mechanism, swing - tighter, RANGES, SENSORS, seed=4, wall=WALL, outline=SLEEVE)
    estimator = estimate.ContactSmoother(mechanism, WALL, RANGES, SENSORS, outline=SLEEVE)
    shown = []
    for positions, tensions in zip(rig.positions[:, 0], rig.tensions[:, 0], strict=True):
        estimator.update(positions, tensions)
        if len(shown) in (9, STEPS - 1):
            print(f"step {len(shown) + 1}: the wall is touched with probability {estimator.touches:.2f}")
            at = estimator.prior.layout.surfaces
            shown.append((estimator.samples.numbers[0, ::8, at:], estimator.poses[0, 0], estimator.contact))
        else:
            shown.append(None)
    for what, truth in (("wall", rig.walls), ("wall_force", rig.touching.force), ("contact", rig.touching.place)):
        found = getattr(estimator, what)
        for mean, low, high, true in zip(found.mean, found.low, found.high, truth[0], strict=True):
            print(f"  {what:10} {mean:7.2f}, 95 % from {low:7.2f} to {high:7.2f}; true {true:7.2f}")
    out.mkdir(parents=True, exist_ok=True)
    print(f"wrote {save_figure(draw(mechanism, rig, shown), out / 'hidden_wall_estimate.png')}")


def line(mechanism: rj.RollingChain, wall: np.ndarray) -> np.ndarray:
    """Two points of a wall, (2, 2) [mm]."""
    rest = mechanism.poses(mechanism.neutral_angles)[-1, :2]
    normal = np.array([np.cos(wall[0]), np.sin(wall[0])])
    return rest + wall[1] * normal + np.outer([-80.0, 80.0], [-normal[1], normal[0]])


def draw(mechanism: rj.RollingChain, rig: estimate.SimulatedRigs, shown: list) -> pyplot.Figure:
    figure, panels = pyplot.subplots(1, 2, figsize=(9, 5.2), layout="constrained", sharex=True, sharey=True)
    steps = [number for number, values in enumerate(shown) if values is not None]
    for panel, step in zip(panels, steps, strict=True):
        walls, _, contact = shown[step]
        for wall in walls:
            panel.plot(*line(mechanism, wall).T, color=PALETTE[0], alpha=0.25, linewidth=0.8)
        panel.plot([], [], color=PALETTE[0], label="walls as likely as they are drawn")
        panel.plot(*line(mechanism, rig.walls[0]).T, "--", color="0.2", label="the wall")
        x, y = rig.poses[step, 0, :, :2].T
        panel.plot(x, y, "o-", color=PALETTE[1], label="origins of the links")
        if np.isfinite(contact.mean).all() and step == steps[-1]:
            (x, y), (left, right) = contact.mean, (contact.mean - contact.low, contact.high - contact.mean)
            bars = [[left[0]], [right[0]]], [[left[1]], [right[1]]]
            panel.errorbar(x, y, bars[1], bars[0], color=PALETTE[2], capsize=3, label="contact, 95 %")
            panel.plot(*rig.touching.place[0], "kx", label="true contact")
        panel.set(title=f"after {step + 1} steps", xlabel="x [mm]", aspect="equal", xlim=(-60, 30), ylim=(-5, 115))
    panels[0].set(ylabel="y [mm]")
    figure.legend(*panels[1].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


if __name__ == "__main__":
    main()
