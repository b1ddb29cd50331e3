"""Pictures of the results page: learning curves, error against load, distribution of the error, animations."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import cycle
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from agents.evaluation.controller import Array
from agents.evaluation.pictures import COLOURS, SMALLEST_MM, animation, figure_of, png, tidy
from agents.evaluation.policy import Policy
from agents.evaluation.report import OPEN_LOOP
from agents.evaluation.rollout import film
from agents.evaluation.score import FLOOR
from agents.results.runs import POLICY, Recipe
from agents.results.scores import FEEDBACK, Scored

POLICY_LABEL = "best policy"
STYLES: dict[str, dict[str, Any]] = {  # dashes where lines lie on each other
    POLICY_LABEL: {"color": COLOURS[0], "linewidth": 2.4},
    "predictive": {"color": COLOURS[4], "linewidth": 1.6},
    "load estimate": {"color": COLOURS[3], "linewidth": 1.6, "linestyle": "--"},
    FEEDBACK: {"color": COLOURS[1], "linewidth": 1.6, "linestyle": ":"},
    OPEN_LOOP: {"color": COLOURS[2], "linewidth": 1.6},
    "do nothing": {"color": COLOURS[6], "linewidth": 1.6},
    FLOOR: {"color": "black", "linewidth": 1},
}
LEARNED = (COLOURS[0], COLOURS[4], COLOURS[2], COLOURS[3], COLOURS[5])
BINS = 10  # over the loads of training
FEWEST = 10  # episodes in a bin
DPI = 110
PICTURE_WIDTH = 300  # of one episode in an animation [pixels]
LONGEST = 60  # pictures in an animation; of longer episodes every second one is shown, or every third


def learning_curves(scored: Sequence[Scored], over_time: bool) -> bytes:
    """PNG: mean tip error in the evaluations during training, over steps or over processor time; a panel per benchmark.

    Line: median over the seeds; band: smallest to largest.
    """
    label = "minutes of processor time" if over_time else "thousand steps"
    figure, panels = _panels(len(scored), label, "mean tip error [mm]")
    for axes, one in zip(panels, scored, strict=True):
        axes.set(title=one.benchmark.title)
        _logarithmic(axes, "xy", (1, 2, 5))
        for recipe, colour in zip(one.benchmark.recipes, cycle(LEARNED), strict=False):
            _draw_curve(axes, recipe, colour, over_time)
        for (name, error), dashes in zip(one.levels.items(), ("--", "-"), strict=False):
            axes.axhline(max(error, SMALLEST_MM), color="black", linestyle=dashes, linewidth=1, label=name)
        axes.legend(fontsize=7, edgecolor="none")
    return png(figure, DPI)


def _draw_curve(axes: Axes, recipe: Recipe, colour: str, over_time: bool) -> None:
    steps = recipe.runs[0].curve[0]
    errors = np.array([np.interp(steps, run.curve[0], run.curve[1]) for run in recipe.runs])
    seconds = np.median([np.interp(steps, run.curve[0], run.curve[2]) for run in recipe.runs], axis=0)
    x = np.maximum(seconds, 1) / 60 if over_time else steps / 1000
    axes.plot(x, np.median(errors, axis=0), color=colour, linewidth=1.8, label=recipe.name)
    if len(recipe.runs) > 1:
        axes.fill_between(x, errors.min(axis=0), errors.max(axis=0), color=colour, alpha=0.2, linewidth=0)


def error_against_load(scored: Sequence[Scored]) -> bytes:
    """PNG: median tip error at the end over the magnitude of the load then; loads of training shaded.

    A panel per benchmark that has been scored under heavier loads, too.
    """
    with_loads = [(one.benchmark, one.scores, one.beyond) for one in scored if one.beyond]
    figure, panels = _panels(len(with_loads), "load at the end [N]", "median tip error [mm]")
    for axes, (benchmark, scores, beyond) in zip(panels, with_loads, strict=True):
        low, high = benchmark.config.load.magnitude
        axes.set(title=benchmark.title)
        _logarithmic(axes, "y")
        axes.axvspan(0 if benchmark.config.load.process == "ou" else low, high, color="black", alpha=0.06, linewidth=0)
        inside, outside = scores.loads <= high, beyond.loads > high
        loads = np.concatenate([scores.loads[inside], beyond.loads[outside]])
        for name, label in ((scores.best_policy, POLICY_LABEL), (FEEDBACK, FEEDBACK), (OPEN_LOOP, OPEN_LOOP)):
            errors = np.concatenate([scores.errors(name)[:, inside], beyond.errors(name)[:, outside]], axis=1)
            axes.plot(*_binned(loads, errors, high / BINS), marker=".", label=label, **STYLES[label])
        floors = np.concatenate([scores.floors[inside], beyond.floors[outside]])[None]
        if np.isfinite(floors).any():
            axes.plot(*_binned(loads, floors, high / BINS), label=FLOOR, **STYLES[FLOOR])
    return png(_with_legend(figure, panels), DPI)


def _binned(loads: Array, errors: Array, width: float) -> tuple[Array, Array]:
    """Middles of bins of that width [N] over the loads (E,), and the median of the errors (S, E) in each."""
    places = np.floor(loads / width * (1 - 1e-9)).astype(int)
    bins = [place for place in np.unique(places) if np.sum(places == place) >= FEWEST]
    medians = [np.median(np.maximum(errors[:, places == place], SMALLEST_MM)) for place in bins]
    return (np.array(bins) + 0.5) * width, np.array(medians)


def distributions(scored: Sequence[Scored]) -> bytes:
    """PNG: share of the episodes that end within an error, for the best policy (all seeds together) and the others."""
    figure, panels = _panels(len(scored), "tip error at the end [mm]", "share of episodes below")
    for axes, one in zip(panels, scored, strict=True):
        scores = one.scores
        axes.set(title=one.benchmark.title, ylim=(0, 1))
        _logarithmic(axes, "x")
        axes.axvline(1.0, color="black", linestyle=":", linewidth=1)
        _draw_shares(axes, POLICY_LABEL, scores.errors(scores.best_policy))
        for name in scores.baselines:
            _draw_shares(axes, name, scores.errors(name))
        if np.isfinite(scores.floors).any():
            _draw_shares(axes, FLOOR, scores.floors)
    return png(_with_legend(figure, panels), DPI)


def _draw_shares(axes: Axes, label: str, errors: Array) -> None:
    below = np.sort(np.maximum(errors[np.isfinite(errors)], SMALLEST_MM), axis=None)
    shares = np.arange(1, len(below) + 1) / len(below)
    axes.plot(below, shares, label=label, **STYLES[label])


def to_film(scored: Sequence[Scored]) -> list[Scored]:
    """The first benchmark of every kind: of every mechanism, with fixed and with moving targets."""
    kinds: dict[str, Scored] = {}
    for one in scored:
        settings = one.benchmark.recipes[0].config.env.complete_settings()
        kinds.setdefault(repr((settings["mechanism"], settings["target"]["process"])), one)
    return list(kinds.values())


def three_episodes(scored: Scored) -> dict[str, tuple[bytes, str]]:
    """GIF of the episodes that end with the smallest, the median and the largest error; by its name, with a caption.

    Of the best configuration's run that did best in the evaluations during training.
    """
    benchmark, scores = scored.benchmark, scored.scores
    recipe = next(recipe for recipe in benchmark.recipes if recipe.name == scores.best_policy)
    run = recipe.chosen
    episodes = scores.policies[recipe.name][list(recipe.runs).index(run)]
    order = np.argsort(episodes.final_errors, kind="stable")
    places = {"best": order[0], "median": order[len(order) // 2], "worst": order[-1]}
    seeds = {name: int(episodes.seeds[place]) for name, place in places.items()}
    policy = Policy.load(run.folder, POLICY)
    frames = {
        f"{name}: {episodes.final_errors[place]:.2g} mm": _shortened(film(run.config.env, policy, seeds[name]))
        for name, place in places.items()
    }
    told = ", ".join(f"{name} (seed {seed})" for name, seed in seeds.items())
    caption = f"{recipe.name}, training seed {run.config.seed}: of the episodes of the table the {told}."
    return {f"results_{benchmark.file}.gif": (animation(frames, PICTURE_WIDTH), caption)}


def _shortened(frames: Sequence[Any]) -> Sequence[Any]:
    """At most LONGEST of the pictures, evenly, the last one among them."""
    return frames[:: -math.ceil(len(frames) / LONGEST)][::-1]


def _panels(count: int, x_label: str, y_label: str) -> tuple[Figure, list[Axes]]:
    """A figure with `count` panels, three in a row."""
    columns = min(3, count)
    rows = -(-count // columns)
    figure = figure_of(4.2 * columns, 3.4 * rows)
    panels = [figure.add_subplot(rows, columns, place + 1) for place in range(count)]
    for place, axes in enumerate(panels):
        axes.set(xlabel=x_label if place >= count - columns else "", ylabel=y_label if place % columns == 0 else "")
        tidy(axes)
    return figure, panels


def _with_legend(figure: Figure, panels: Sequence[Axes]) -> Figure:
    """The figure with one legend, since its panels have the same lines."""
    columns = 4 if len(panels) > 1 else 2
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=columns, frameon=False)
    return figure


def _logarithmic(axes: Axes, names: str, marks: Sequence[float] = (1,)) -> None:
    """Make these of its axes, "x", "y" or "xy", logarithmic, with ticks at these multiples of the powers of ten."""
    for name in names:
        axes.set(**{f"{name}scale": "log"})
        axis = axes.xaxis if name == "x" else axes.yaxis
        axis.set_major_locator(LogLocator(subs=marks))
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter(NullFormatter())
