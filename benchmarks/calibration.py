"""How often intervals of rollingjoint.estimate contain the truth of simulated rigs: python benchmarks/calibration.py.

Every rig is a chain with hidden numbers drawn from their ranges; its motors run along a path and measure tensions. The
table has the share of rigs whose truth lies within the interval of a probability, by quantity, and how wide intervals
are. With --picture FILE it draws the curve of shares over probabilities.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import rollingjoint as rj
from rollingjoint.estimate import (
    HiddenRanges,
    RigEstimator,
    RigFilter,
    RigSensors,
    RigSmoother,
    SimulatedRigs,
    simulated_rigs,
)
from rollingjoint.tables import text_table

Array = NDArray[np.float64]

RANGES = HiddenRanges(
    force=(0.0, 1.0), offset_mm=(-0.5, 0.5), stiffness=(0.8, 1.2), play_mm=(0.5, 2.0), sheath_friction=(0.0, 0.3)
)
SENSORS = RigSensors(tension_sd=0.05, start_tension=5.0, start_sd=0.05)
ESTIMATORS: dict[str, type[RigEstimator]] = {"whole history": RigSmoother, "recursive": RigFilter}
LEVELS = (0.5, 0.8, 0.9, 0.95, 0.99)
BLOCK = 250  # rigs side by side


def path(steps: int, n_tendons: int = 2, size: float = 2.5) -> Array:
    """Positions of motors over their start, (T, m) [mm]: waves of other lengths, tighter than the start."""
    time_of = np.arange(float(steps))[:, None]
    periods, phases = 12.0 - 3.0 * np.arange(n_tendons), np.arange(n_tendons) * 1.0
    waves = size * (np.sin(2.0 * np.pi * time_of / periods + phases) - np.sin(phases))
    return np.asarray(waves - np.minimum(time_of / 4.0, 1.0))


def sampled(estimator: RigEstimator) -> dict[str, Array]:
    """Samples of what is estimated, (N, S, k) each."""
    numbers, at = estimator.samples.numbers, estimator.prior.layout
    return {
        "load [N]": numbers[..., :2],
        "offset [mm]": numbers[..., at.offsets : at.stiffnesses],
        "stiffness [N/mm]": numbers[..., at.stiffnesses : at.half_widths] * estimator.mechanism.stiffnesses,
        "play [mm]": 2.0 * numbers[..., at.half_widths : at.frictions],
        "sheath friction": numbers[..., at.frictions : at.places],
        "tip [mm]": estimator.poses[:, :, -1, :2],
        "middle link [mm]": estimator.poses[:, :, estimator.mechanism.n_links // 2, :2],
    }


def truth(rigs: SimulatedRigs) -> dict[str, Array]:
    """The same of the rigs, (N, k) each."""
    last = rigs.poses[-1]
    middle = last.shape[1] // 2
    values = rigs.forces, rigs.offsets, rigs.stiffnesses, rigs.play, rigs.friction, last[:, -1, :2], last[:, middle, :2]
    names = "load [N]", "offset [mm]", "stiffness [N/mm]", "play [mm]", "sheath friction", "tip [mm]"
    return dict(zip((*names, "middle link [mm]"), values, strict=True))


def measured(
    kind: type[RigEstimator], rigs: int, steps: int, seed: int, ranges: HiddenRanges, links: Sequence[int]
) -> tuple[dict[str, Array], dict[str, Array], dict[str, float]]:
    """By quantity: probability of the smallest interval that has the truth, (N k,), and widths at 95 %; and figures."""
    chain, depths, widths = rj.five_link(), dict[str, list[Array]](), dict[str, list[Array]]()
    seconds, right, sure = 0.0, 0.0, 0.0
    for first in range(0, rigs, BLOCK):
        count = min(BLOCK, rigs - first)
        simulated = simulated_rigs(chain, path(steps), ranges, SENSORS, links, count, seed + first)
        start = time.process_time()
        estimator = kind(chain, ranges, SENSORS, links, rigs=count, steps=steps)
        for positions, tensions in zip(simulated.positions, simulated.tensions, strict=True):
            estimator.update(positions, tensions)
        samples = sampled(estimator)
        seconds += time.process_time() - start
        for name, values in truth(simulated).items():
            share = (samples[name] < values[:, None]).mean(axis=1)
            depths.setdefault(name, []).append(np.abs(2.0 * share - 1.0).ravel())
            low, high = np.quantile(samples[name], (0.025, 0.975), axis=1)
            widths.setdefault(name, []).append((high - low).ravel())
        place = estimator.place
        right += float((place.argmax(axis=1) == simulated.links).sum())
        sure += float(place[np.arange(count), simulated.links].sum())
    joined = ({name: np.concatenate(parts) for name, parts in each.items()} for each in (depths, widths))
    figures = {"ms": 1e3 * seconds / rigs, "right": right / rigs, "probability": sure / rigs}
    return (*joined, figures)  # type: ignore[return-value]


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--rigs", type=int, default=1000)
    parser.add_argument("--steps", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--any-link", action="store_true", help="the force is on any link, which is estimated, too")
    parser.add_argument("--tolerance-mm", type=float, default=0.0, help="of contact surfaces in x and in y")
    parser.add_argument("--picture", type=Path)
    arguments = parser.parse_args()
    rj.set_threads(1)
    ranges = HiddenRanges(**{**vars(RANGES), "surface_mm": arguments.tolerance_mm})
    links = range(1, rj.five_link().n_links) if arguments.any_link else [-1]
    curves = {}
    for name, kind in ESTIMATORS.items():
        depths, widths, figures = measured(kind, arguments.rigs, arguments.steps, arguments.seed, ranges, [*links])
        curves[name] = depths
        rows = [
            [what, *(f"{100.0 * (values <= level).mean():.1f}" for level in LEVELS), f"{np.median(widths[what]):.3g}"]
            for what, values in depths.items()
        ]
        head = [name, *(f"{100 * level:g} %" for level in LEVELS), "width at 95 %"]
        print(text_table(head, rows))
        print(
            f"{figures['ms']:.1f} ms of processor time per rig; the loaded link is the most likely one of "
            f"{100 * figures['right']:.1f} % of the rigs, its mean probability {figures['probability']:.3f}\n"
        )
    if arguments.picture:
        draw(curves, arguments)


def draw(curves: dict[str, dict[str, Array]], arguments: argparse.Namespace) -> None:
    """The shares over the probabilities, one panel per estimator."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    from rollingjoint.plotting import PALETTE, save_figure

    figure, panels = pyplot.subplots(1, len(curves), figsize=(9, 4.6), layout="constrained", sharey=True)
    levels = np.linspace(0.01, 0.99, 99)
    for panel, (name, depths) in zip(panels, curves.items(), strict=True):
        panel.plot([0, 100], [0, 100], color="0.7", linewidth=1)
        for color, (what, values) in zip(PALETTE, depths.items(), strict=False):
            shares = [100.0 * (values <= level).mean() for level in levels]
            panel.plot(100.0 * levels, shares, color=color, label=what.rpartition(" [")[0] or what)
        panel.set(title=f"RigSmoother: {name}" if name == "whole history" else f"RigFilter: {name}", aspect="equal")
        panel.set(xlabel="probability of the interval [%]", xlim=(0, 100), ylim=(0, 100))
    panels[0].set(ylabel=f"truth within [% of {arguments.rigs:,} rigs]")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    save_figure(figure, arguments.picture)


if __name__ == "__main__":
    main()
