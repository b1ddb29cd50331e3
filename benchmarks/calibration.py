"""How often intervals of rollingjoint.estimate contain the truth of simulated rigs: python benchmarks/calibration.py.

Every rig is a chain with hidden numbers drawn from their ranges; its motors run along a path and measure tensions. The
table has the share of rigs whose truth lies within the interval of a probability, by quantity, and how wide intervals
are. With --picture FILE it draws the curve of shares over probabilities. With --wall rigs swing against a wall of
unknown direction, place and compliance, which presses in the last step.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import rollingjoint as rj
from rollingjoint.estimate import (
    ContactSmoother,
    HiddenRanges,
    RigEstimator,
    RigFilter,
    RigSensors,
    RigSmoother,
    SimulatedRigs,
    WallRanges,
    simulated_rigs,
)
from rollingjoint.surroundings import Sleeve
from rollingjoint.tables import text_table

Array = NDArray[np.float64]

RANGES = HiddenRanges(
    force=(0.0, 1.0), offset_mm=(-0.5, 0.5), stiffness=(0.8, 1.2), play_mm=(0.5, 2.0), sheath_friction=(0.0, 0.3)
)
SENSORS = RigSensors(tension_sd=0.05, start_tension=5.0, start_sd=0.05)
WALL = WallRanges(direction=(-0.5, 0.5), offset_mm=(-20.0, -5.0), compliance=(0.5, 3.0))
BESIDE_WALL = HiddenRanges(
    force=(0.0, 0.0), offset_mm=(-0.3, 0.3), stiffness=(0.9, 1.1), play_mm=(0.2, 0.8), sheath_friction=(0.0, 0.2)
)
OUTLINE = Sleeve(5.0)
OF_WALL = "wall: direction [rad]", "wall: offset [mm]", "wall: compliance [mm/N]"
FORCE, PLACE = "contact: force [N]", "contact: place [mm]"
ESTIMATORS: dict[str, type[RigEstimator]] = {"whole history": RigSmoother, "recursive": RigFilter}
LEVELS = (0.5, 0.8, 0.9, 0.95, 0.99)
BLOCK = 250  # rigs side by side


def path(steps: int, n_tendons: int = 2, size: float = 2.5) -> Array:
    """Positions of motors over their start, (T, m) [mm]: waves of other lengths, tighter than the start."""
    time_of = np.arange(float(steps))[:, None]
    periods, phases = 12.0 - 3.0 * np.arange(n_tendons), np.arange(n_tendons) * 1.0
    waves = size * (np.sin(2.0 * np.pi * time_of / periods + phases) - np.sin(phases))
    return np.asarray(waves - np.minimum(time_of / 4.0, 1.0))


def swing(steps: int, size: float = 5.0) -> Array:
    """Positions of two motors over their start, (T, 2) [mm]: the chain swings with a period of 16 steps, tighter."""
    time_of = np.arange(float(steps))[:, None]
    together = np.minimum(time_of / 4.0, 1.0) + 0.7 * (1.0 - np.cos(2.0 * np.pi * time_of / 13.0))
    return np.asarray(size * np.sin(2.0 * np.pi * time_of / 16.0) * [1.0, -1.0] - together)


def sampled(estimator: RigEstimator) -> dict[str, Array]:
    """Samples of what is estimated, (N, S, k) each."""
    numbers, at = estimator.samples.numbers, estimator.prior.layout
    values = {
        "load [N]": numbers[..., :2],
        "offset [mm]": numbers[..., at.offsets : at.stiffnesses],
        "stiffness [N/mm]": numbers[..., at.stiffnesses : at.half_widths] * estimator.mechanism.stiffnesses,
        "play [mm]": 2.0 * numbers[..., at.half_widths : at.frictions],
        "sheath friction": numbers[..., at.frictions : at.places],
        "tip [mm]": estimator.poses[:, :, -1, :2],
        "middle link [mm]": estimator.poses[:, :, estimator.mechanism.n_links // 2, :2],
    }
    if isinstance(estimator, ContactSmoother):
        del values["load [N]"]
        values |= {name: numbers[..., at.surfaces + k, None] for k, name in enumerate(OF_WALL)}
        values |= {FORCE: estimator.touching.force, PLACE: estimator.touching.place}
    return values


def truth(rigs: SimulatedRigs) -> dict[str, Array]:
    """The same of the rigs, (N, k) each; NaN where there is none."""
    last = rigs.poses[-1]
    middle = last.shape[1] // 2
    values = rigs.forces, rigs.offsets, rigs.stiffnesses, rigs.play, rigs.friction, last[:, -1, :2], last[:, middle, :2]
    names = "load [N]", "offset [mm]", "stiffness [N/mm]", "play [mm]", "sheath friction", "tip [mm]"
    known = dict(zip((*names, "middle link [mm]"), values, strict=True))
    if rigs.touching is not None:
        del known["load [N]"]
        known |= {name: rigs.walls[:, k, None] for k, name in enumerate(OF_WALL)}
        pressed = rigs.touching.link[:, None] > 0
        known |= {FORCE: np.where(pressed, rigs.touching.force, np.nan), PLACE: rigs.touching.place}
    return known


def measured(
    kind: type[RigEstimator], rigs: int, steps: int, seed: int, ranges: HiddenRanges, links: Sequence[int]
) -> tuple[dict[str, Array], dict[str, Array], dict[str, float]]:
    """By quantity: probability of the smallest interval that has the truth, (N k,), and widths at 95 %; and figures."""
    chain, depths, widths = rj.five_link(), dict[str, list[Array]](), dict[str, list[Array]]()
    seconds, right, sure = 0.0, 0.0, 0.0
    for first in range(0, rigs, BLOCK):
        count = min(BLOCK, rigs - first)
        motors, beside = (swing(steps), (WALL, OUTLINE)) if kind is ContactSmoother else (path(steps), ())
        simulated = simulated_rigs(chain, motors, ranges, SENSORS, links, count, seed + first, *beside)
        start = time.process_time()
        sizes: dict[str, Any] = {"rigs": count, "steps": steps}
        if kind is ContactSmoother:
            estimator: RigEstimator = ContactSmoother(chain, WALL, ranges, SENSORS, outline=OUTLINE, **sizes)
        else:
            estimator = kind(chain, ranges, SENSORS, links, **sizes)
        for positions, tensions in zip(simulated.positions, simulated.tensions, strict=True):
            estimator.update(positions, tensions)
        samples = sampled(estimator)
        seconds += time.process_time() - start
        for name, values in truth(simulated).items():
            shown = np.isfinite(values).all(axis=1)
            drawn = samples[name][shown]
            less, known = (drawn < values[shown, None]).sum(axis=1), np.isfinite(drawn).sum(axis=1)
            depths.setdefault(name, []).append(np.abs(2.0 * less / np.maximum(known, 1) - 1.0).ravel())
            low, high = np.nanquantile(drawn, (0.025, 0.975), axis=1)
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
    parser.add_argument("--wall", action="store_true", help="rigs beside a wall, which presses in step 29")
    parser.add_argument("--picture", type=Path)
    arguments = parser.parse_args()
    rj.set_threads(1)
    ranges = HiddenRanges(**{**vars(RANGES), "surface_mm": arguments.tolerance_mm})
    links = range(1, rj.five_link().n_links) if arguments.any_link else [-1]
    curves, estimators = {}, ESTIMATORS
    if arguments.wall:
        estimators, ranges = {"beside a wall": ContactSmoother}, BESIDE_WALL
    for name, kind in estimators.items():
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

    size = (4.5 * len(curves), 4.6)
    figure, (panels,) = pyplot.subplots(1, len(curves), figsize=size, layout="constrained", sharey=True, squeeze=False)
    levels = np.linspace(0.01, 0.99, 99)
    for panel, (name, depths) in zip(panels, curves.items(), strict=True):
        panel.plot([0, 100], [0, 100], color="0.7", linewidth=1)
        for color, (what, values) in zip(PALETTE, depths.items(), strict=False):
            shares = [100.0 * (values <= level).mean() for level in levels]
            panel.plot(100.0 * levels, shares, color=color, label=what.rpartition(" [")[0] or what)
        panel.set(title=f"{ESTIMATORS.get(name, ContactSmoother).__name__}: {name}", aspect="equal")
        panel.set(xlabel="probability of the interval [%]", xlim=(0, 100), ylim=(0, 100))
    panels[0].set(ylabel=f"truth within [% of {arguments.rigs:,} rigs]")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    save_figure(figure, arguments.picture)


if __name__ == "__main__":
    main()
