"""How near the model comes to two photographed runs of the real mechanism, and what friction has to do with it.

Run: python examples/fidelity.py [--out DIR] [--quick]
Measurements and their source: examples/data/two_runs_raw.yaml and two_runs_calibrated.yaml. docs/fidelity.md explains
what this prints. --quick leaves out the tables of other explanations.
"""

import argparse
import dataclasses
from collections.abc import Callable
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import numpy as np
from matplotlib import pyplot

import rollingjoint as rj
from rollingjoint.identify import Identification, Input, Measurements, Run, Step, identify, load_measurements
from rollingjoint.identify.fit import Fit
from rollingjoint.identify.pictures import save_pictures
from rollingjoint.plotting import PALETTE, save_figure
from rollingjoint.tables import text_table

DATA = Path(__file__).parent / "data"
POSES = ("raw", "calibrated")
EXPLANATIONS = {
    "tensions": (
        *("mu", "constant", "rolling", "base_angle", "base_angle:run", "mu,base_angle:run"),
        *("surface_height", "mu,surface_height"),
    ),
    "lengths": ("mu", "offsets", "offsets:run", "mu,offsets"),
}
PAPER = {"tensions": 1.71, "lengths": 1.05}  # mm, the paper's own mean error of the last link, on other measurements


def main(argv: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out"))
    parser.add_argument("--quick", action="store_true", help="friction under tensions only")
    args = parser.parse_args(argv)
    runs = {poses: load_measurements(DATA / f"two_runs_{poses}.yaml") for poses in POSES}
    for poses, measurements in runs.items():
        found = identify(measurements, ["mu"])
        print(f"== {poses} poses, tensions given\n{found.report()}\n")
        folder = args.out / f"fidelity_{poses}"
        folder.mkdir(parents=True, exist_ok=True)
        save_pictures(found, folder)
    if args.quick:
        return
    found = {
        (poses, given): explanations(measurements.input_given(given, "least_squares"), given)
        for poses, measurements in runs.items()
        for given in EXPLANATIONS
    }
    for (poses, given), tried in found.items():
        print(f"== {poses} poses, {given} given: mean error of the last link in A and B [mm]")
        print(table(tried, PAPER[given]), end="\n\n")
    for poses, measurements in runs.items():
        print(f"== {poses} poses: what rests on assumptions\n{assumptions(measurements)}\n")
    print(f"wrote {save_figure(draw(found), args.out / 'fidelity.png', dpi=100)}")


def explanations(measurements: Measurements, given: str) -> dict[str, Identification]:
    """An identification for every set of parameters."""
    return {names: identify(measurements, names.split(","), intervals="linear") for names in EXPLANATIONS[given]}


def last_links(found: Identification, which: str) -> list[float]:
    """Mean error of the last link in both runs [mm]."""
    return [found.errors("position", which, run.name).last for run in found.measurements.runs]


def table(tried: dict[str, Identification], paper: float) -> str:
    """A row per set of parameters: their values, and the errors that they leave."""
    first = next(iter(tried.values()))
    rows = [["none", "", pair(last_links(first, "nominal")), "", f"{rms(first, 'nominal'):.2f}"]]
    for names, found in tried.items():
        shown = (pair(last_links(found, which)) for which in ("together", "held out"))
        rows.append([names, values(found), *shown, f"{rms(found, 'held out'):.2f}"])
    head = ["parameters", "values", "both runs fitted", "from the other run", "its rms, all links"]
    return text_table(head, rows, left=2) + f"\nthe paper, on other measurements: {paper:.2f}"


def assumptions(measurements: Measurements) -> str:
    """What another way to the poses, another criterion and another reading of the lengths would give."""
    rows = []
    for way, change in (("from equal tensions", lambda step: step), ("from beyond", from_beyond)):
        found = identify(changed(measurements, change), ["mu"], intervals="linear")
        for run, alone in found.alone.items():
            nearly = nearly_best(alone.fit)
            rows.append([run, way, f"{alone.values[0]:.3f}", f"{rms(found, 'alone', run):.3f}", nearly])
    head = ["run", "approached", "mu alone", "rms [mm]", "mu within 5 % of the best rms"]
    through = changed(measurements, through_poses).input_given("lengths", "least_squares")
    apart = [np.subtract(a.lengths, b.lengths) for a, b in zip(steps_of(through), steps_of(measurements), strict=True)]
    errors = last_links(identify(through, ["offsets"], intervals="linear"), "nominal")
    return (
        f"{text_table(head, rows, left=2)}\n"
        f"tendons drawn through the poses are {np.min(apart):.2f} to {np.max(apart):.2f} mm longer than the lengths;\n"
        f"with their lengths, nominal last links are {pair(errors)} mm off"
    )


def steps_of(measurements: Measurements) -> list[Step]:
    return [step for run in measurements.runs for step in run.steps]


def changed(measurements: Measurements, change: Callable[[Step], Step]) -> Measurements:
    """The measurements with other steps."""
    runs = [Run(run.name, [change(step) for step in run.steps]) for run in measurements.runs]
    return dataclasses.replace(measurements, runs=runs)


def from_beyond(step: Step) -> Step:
    """The step approached from the square of its ratio of tensions."""
    tensions = np.array(step.tensions)
    return dataclasses.replace(step, approach=[Input("tensions", tuple(tensions**2 / tensions.min()))])


def through_poses(step: Step) -> Step:
    """The step with the lengths of the model's tendons drawn through the measured poses."""
    lines = rj.five_link().tendon_polyline(np.column_stack([step.positions, step.angles]))
    return dataclasses.replace(step, lengths=[np.linalg.norm(np.diff(line, axis=0), axis=1).sum() for line in lines])


def nearly_best(fit: Fit) -> str:
    """The range of mu whose root mean square error is within 5 % of the best."""
    tried = np.linspace(0.0, 0.12, 121)
    costs = np.array([np.sum(fit.model.residuals(np.array([mu])) ** 2) for mu in tried])
    inside = tried[np.sqrt(costs) < 1.05 * np.sqrt(fit.cost)]
    return f"{inside.min():.3f} to {inside.max():.3f}"


def values(found: Identification) -> str:
    return ", ".join(f"{value:.3f}" for value in found.values.values())


def pair(numbers: list[float]) -> str:
    return ", ".join(f"{number:.2f}" for number in numbers)


def rms(found: Identification, which: str, run: str | None = None) -> float:
    """Root mean square error of all links [mm]."""
    table = found.deviations[which][found.rows(run), found.measurements.columns("position")]
    return float(np.sqrt(2 * np.nanmean(table**2)))


def draw(found: dict[tuple[str, str], dict[str, Identification]]) -> pyplot.Figure:
    """A panel per kind of poses and input: errors of the last link, fitted and predicted from the other run."""
    figure, axes = pyplot.subplots(2, 2, figsize=(11.0, 8.5), layout="constrained", sharey=True)
    for ax, ((poses, given), tried) in zip(axes.flat, found.items(), strict=True):
        first = next(iter(tried.values()))
        bars = [("none", np.mean(last_links(first, "nominal")), np.nan)]
        for names, each in tried.items():
            bars.append((names, *(np.mean(last_links(each, which)) for which in ("together", "held out"))))
        labels, fitted, predicted = zip(*bars, strict=True)
        place = np.arange(len(labels))
        ax.bar(place - 0.2, fitted, 0.38, color=PALETTE[0], label="both runs fitted (none: nothing fitted)")
        ax.bar(place + 0.2, predicted, 0.38, color=PALETTE[1], label="each run from the other")
        ax.axhline(PAPER[given], color="black", linestyle=":", label="the paper, other measurements")
        ax.set_xticks(
            place,
            [label.replace(",", ",\n") for label in labels],
            fontsize=7,
            rotation=35,
            ha="right",
            rotation_mode="anchor",
        )
        ax.set_title(f"{poses} poses, {given} given", fontsize=10)
    for ax in axes[:, 0]:
        ax.set_ylabel("mean error of the last link [mm]")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3)
    return figure


if __name__ == "__main__":
    main()
