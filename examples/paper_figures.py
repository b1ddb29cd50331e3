"""Figures 3 and 4 of the rolling-contact paper: the five-link mechanism under tensions, and pulled to the right.

Run: python examples/paper_figures.py [--out DIR]
"""

import argparse
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
from matplotlib import pyplot

import rollingjoint as rj
from rollingjoint.plotting import PALETTE, plot_family, save_figure

FIGURE_3 = [(3, 1), (1, 1), (1, 3)]
FIGURE_4_TENSIONS, FIGURE_4_FORCES = (6, 3), (0.0, 0.5, 1.0, 1.5)


def main(argv: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out"))
    out = parser.parse_args(argv).out
    out.mkdir(parents=True, exist_ok=True)
    mechanism = rj.five_link()
    for draw, name in ((figure_3, "paper_figure_3.png"), (figure_4, "paper_figure_4.png")):
        figure = draw(mechanism)
        print(f"wrote {save_figure(figure, out / name)}")
        pyplot.close(figure)


def figure_3(mechanism: rj.RollingChain) -> pyplot.Figure:
    """(a) three pairs of tensions; (b) the same doubled: without loads only their ratio matters."""
    figure, axes = pyplot.subplots(1, 2, figsize=(10, 5.7), layout="constrained", sharey=True)
    for ax, factor, letter in zip(axes, (1, 2), "ab", strict=True):
        pairs = [(factor * left, factor * right) for left, right in FIGURE_3]
        equilibria = [rj.solve_tensions(mechanism, pair).require() for pair in pairs]
        plot_family(equilibria, [f"{left} N, {right} N" for left, right in pairs], ax, tendons=False, legend=False)
        ax.legend(title="left, right tension", loc="lower left")
        ax.set_title(f"({letter}) " + ("tensions" if factor == 1 else "tensions doubled"))
    axes[1].set_ylabel("")
    return figure


def figure_4(mechanism: rj.RollingChain) -> pyplot.Figure:
    """Tensions (6, 3) N and a dead force to the right on the last link."""
    figure, ax = pyplot.subplots(figsize=(8.4, 6.4), layout="constrained")
    loads = [[rj.WorldForce(-1, (force, 0.0))] for force in FIGURE_4_FORCES]
    equilibria = [rj.solve_tensions(mechanism, FIGURE_4_TENSIONS, load).require() for load in loads]
    labels = [f"{force:g} N" for force in FIGURE_4_FORCES]
    plot_family(equilibria, labels, ax, tendons=False, colors=PALETTE[: len(labels)], legend=False)
    named = dict(zip(*reversed(ax.get_legend_handles_labels()), strict=True))
    order = [*labels, *(name for name in named if name not in labels)]
    ax.legend([named[name] for name in order], order, title="force on the last link", loc="lower right")
    ax.set_xlim(right=78)  # room for the legend
    ax.set_title("Tensions 6 N (left), 3 N (right), and a force to the right")
    return figure


if __name__ == "__main__":
    main()
