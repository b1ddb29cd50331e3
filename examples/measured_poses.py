"""The model against measured poses of the real five-link mechanism: a table of link-centre errors and a picture.

Run: python examples/measured_poses.py [--out DIR]
Measurements and their source: examples/data/measured_poses.json.
"""

import argparse
import json
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import numpy as np
from matplotlib import pyplot

import rollingjoint as rj
from rollingjoint.chain.outline import link_outline, to_world
from rollingjoint.plotting import PALETTE, plot_mechanism, save_figure

MEASUREMENTS = Path(__file__).parent / "data" / "measured_poses.json"
WEIGHT = 2.94  # N, 300 g; without external load only the ratio of the tensions matters
ACTUATIONS = ("tension", "displacement")
MODEL_COLOR, MEASURED_COLOR = PALETTE[0], PALETTE[5]


def main(argv: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out"))
    out = parser.parse_args(argv).out
    measured = json.loads(MEASUREMENTS.read_text(encoding="utf-8"))["poses"]
    mechanism = rj.five_link()
    predicted = {actuation: [predict(mechanism, pose, actuation) for pose in measured] for actuation in ACTUATIONS}
    for actuation in ACTUATIONS:
        print("\n".join(error_table(actuation, measured, predicted[actuation])), end="\n\n")
    print(paper_figures())
    out.mkdir(parents=True, exist_ok=True)
    print(f"\nwrote {save_figure(draw(measured, predicted), out / 'measured_poses.png')}")


def predict(mechanism: rj.RollingChain, measured: dict, actuation: str) -> rj.Equilibrium:
    """The model's equilibrium at the measured tensions, or at the measured tendon lengths."""
    if actuation == "tension":
        return rj.solve_tensions(mechanism, WEIGHT * np.array(measured["tension_ratio"])).require()
    return rj.solve_lengths(mechanism, measured["tendon_lengths"], method="least_squares").require()


def centre_errors(measured: dict, equilibrium: rj.Equilibrium) -> np.ndarray:
    """Distance between measured and predicted link origin, moving links, (n - 1,) [mm]."""
    centres = np.array(measured["link_poses"])[1:, :2]
    return np.linalg.norm(equilibrium.poses[1:, :2] - centres, axis=1)


def error_table(actuation: str, measured: list[dict], predicted: list[rj.Equilibrium]) -> list[str]:
    errors = np.array([centre_errors(pose, eq) for pose, eq in zip(measured, predicted, strict=True)])
    links = "".join(f"{f'link {i}':>8}" for i in range(1, errors.shape[1] + 1))
    lines = [f"Link-centre error [mm], {actuation} actuation", f"{'left:right':>10}{links}{'mean':>8}{'max':>8}"]
    for pose, row in zip(measured, errors, strict=True):
        name = "{}:{}".format(*pose["tension_ratio"])
        lines.append(f"{name:>10}" + "".join(f"{value:8.2f}" for value in [*row, row.mean(), row.max()]))
    lines.append(f"{'mean':>10}" + "".join(f"{value:8.2f}" for value in [*errors.mean(axis=0), errors.mean()]))
    lines.append(
        f"{'max':>10}" + "".join(f"{value:8.2f}" for value in errors.max(axis=0)) + f"{'':8}{errors.max():8.2f}"
    )
    return lines


def paper_figures() -> str:
    return (
        "The paper's own figures, without load: largest error 3.74 mm and mean of the last link 1.71 mm (tension),\n"
        "2.19 mm and 1.05 mm (displacement). They are over five poses, one of them at equal tensions, and other\n"
        "measurements of the same mechanism, and so cannot be compared number by number."
    )


def draw(measured: list[dict], predicted: dict[str, list[rj.Equilibrium]]) -> pyplot.Figure:
    """A row per kind of actuation, a column per pose: the model in blue, the measured links dashed in orange."""
    figure, axes = pyplot.subplots(
        2, len(measured), figsize=(3.4 * len(measured), 8.2), layout="constrained", sharex=True, sharey=True
    )
    for row, actuation in zip(axes, ACTUATIONS, strict=True):
        for ax, pose, equilibrium in zip(row, measured, predicted[actuation], strict=True):
            draw_pose(ax, np.array(pose["link_poses"]), equilibrium)
            worst = centre_errors(pose, equilibrium).max()
            ratio = "{}:{}".format(*pose["tension_ratio"])
            ax.set_title(f"{actuation}, {ratio}, largest error {worst:.1f} mm", fontsize=9)
    for ax in axes[:, 1:].flat:
        ax.set_ylabel("")
    for ax in axes[0]:
        ax.set_xlabel("")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4)
    return figure


def draw_pose(ax: pyplot.Axes, measured: np.ndarray, equilibrium: rj.Equilibrium) -> None:
    plot_mechanism(
        equilibrium, ax, tendons=False, contacts=False, numbers=False, legend=False, label="model", color=MODEL_COLOR
    )
    for i, (link, pose) in enumerate(zip(equilibrium.mechanism.links, measured, strict=True)):
        outline, label = to_world(pose, link_outline(link)), None if i else "measured"
        ax.plot(*outline.T, "--", color=MEASURED_COLOR, linewidth=1.0, label=label, zorder=4)
    ax.plot(*equilibrium.poses[:, :2].T, "-o", color=MODEL_COLOR, markersize=4, label="model, link centres", zorder=5)
    ax.plot(*measured[:, :2].T, "s", color=MEASURED_COLOR, markersize=4, label="measured, link centres", zorder=6)


if __name__ == "__main__":
    main()
