"""Pictures of the results page: learning curves, error over varied settings, distribution of the error."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from agents.controllers.controller import Array
from agents.evaluation.pictures import COLOURS, SMALLEST_MM, figure_of, png, tidy
from agents.evaluation.report import OPEN_LOOP
from agents.evaluation.score import FLOOR
from agents.results.record import (
    BASELINE,
    ENTRY,
    POLICY,
    SWEEP,
    TEST,
    BenchmarkRecord,
    ControllerRecord,
    Results,
    World,
)
from agents.results.standings import FEEDBACK
from agents.results.statistics import Bootstrap

POLICY_LABEL, OPPONENT_LABEL = "best learner", "best opponent"
STYLES: dict[str, dict[str, Any]] = {  # dashes where lines lie on each other
    POLICY_LABEL: {"color": COLOURS[0], "linewidth": 2.4},
    OPPONENT_LABEL: {"color": COLOURS[4], "linewidth": 1.6},
    FEEDBACK: {"color": COLOURS[1], "linewidth": 1.6, "linestyle": ":"},
    OPEN_LOOP: {"color": COLOURS[2], "linewidth": 1.6, "linestyle": "--"},
    FLOOR: {"color": "black", "linewidth": 1},
}
LEARNED = (COLOURS[0], COLOURS[4], COLOURS[2], COLOURS[3], COLOURS[5])
RESAMPLES = 2000  # of bands
DPI = 110

LEARNING = (
    "Mean tip error at the end in the evaluations during training over {}: mean of the seeds, band: its 95 % interval "
    "over the seeds; black: Jacobian feedback, the floor, and, by its name, the best opponent of those that were "
    "scored with the learners. All in the episodes of these evaluations."
)
VARIED = (
    "Mean tip error of the last 10 steps over the {}: the best learner and the best opponent of those that were scored "
    "over it, and others for orientation; bands: 95 % intervals over training seeds and episodes; shaded: the range of "
    "training, where there is one. Errors below 0.001 mm are drawn there."
)
SHARES = (
    "Share of the episodes with an error over the last 10 steps below a value: the best learner of every task with all "
    "its seeds, and others. Errors below 0.001 mm are drawn there."
)


def pictures(results: Results) -> dict[str, tuple[bytes, str]]:
    """All pictures that results alone are enough for: PNG and caption, by file name."""
    records = [record for record in results.benchmarks if record.of_role(TEST)]
    images: dict[str, tuple[bytes, str]] = {}
    learned = [
        record
        for record in records
        if any(run.curve is not None for controller in _learned(record) for run in controller.runs)
    ]
    if learned:
        images["results_learning_steps.png"] = learning_curves(learned, False), LEARNING.format("steps")
        images["results_learning_time.png"] = learning_curves(learned, True), LEARNING.format("processor time")
    images["results_distribution.png"] = distributions(records), SHARES
    for axis in dict.fromkeys(world.axis for record in records for world in record.of_role(SWEEP)):
        name = re.sub(r"\W+", "_", axis.partition("[")[0].partition(" of ")[0].strip())
        images[f"results_{name}.png"] = error_over(axis, records), VARIED.format(axis.partition("[")[0].strip())
    return images


def lines_of(record: BenchmarkRecord, worlds: Sequence[World]) -> dict[str, str]:
    """The controllers that pictures of worlds show, by the label of their line.

    The best of those that drove in all of them, feedback, open loop, entered ones.
    """
    best = {
        label: record.best(kind, worlds=worlds) for label, kind in ((POLICY_LABEL, POLICY), (OPPONENT_LABEL, BASELINE))
    }
    names = best | {name: name for name in (FEEDBACK, OPEN_LOOP, *record.names(ENTRY)) if name in record.names()}
    return {label: name for label, name in names.items() if name}


def _style(label: str) -> dict[str, Any]:
    return STYLES.get(label, {"color": COLOURS[3], "linewidth": 1.6, "linestyle": "-."})  # an entered controller


def learning_curves(records: Sequence[BenchmarkRecord], over_time: bool) -> bytes:
    """PNG: mean tip error in the evaluations during training, over steps or over processor time; a panel per benchmark.

    Line: mean of the seeds; band: its 95 % interval over the seeds.
    """
    label = "minutes of processor time" if over_time else "thousand steps"
    figure, panels = _panels(len(records), label, "mean tip error [mm]")
    for axes, record in zip(panels, records, strict=True):
        axes.set(title=record.title)
        _logarithmic(axes, "xy", (1, 2, 5))
        for controller, colour in zip(_learned(record), cycle(LEARNED), strict=False):
            _draw_curve(axes, controller, colour, over_time)
        for name, error in record.levels.items():
            dashes = {FLOOR: "-", FEEDBACK: ":"}.get(name, "--")
            axes.axhline(max(error, SMALLEST_MM), color="black", linestyle=dashes, linewidth=1, label=name)
        axes.legend(fontsize=7, edgecolor="none")
    return png(figure, DPI)


def _draw_curve(axes: Axes, controller: ControllerRecord, colour: str, over_time: bool) -> None:
    curves = [run.curve for run in controller.runs if run.curve is not None]
    if not curves:
        return
    steps = curves[0][0]
    errors = np.array([np.interp(steps, curve[0], curve[1]) for curve in curves])
    seconds = np.median([np.interp(steps, curve[0], curve[2]) for curve in curves], axis=0)
    x = np.maximum(seconds, 1) / 60 if over_time else steps / 1000
    band = [Bootstrap(1, RESAMPLES).mean(column[:, None]) for column in errors.T]
    axes.plot(x, [interval.value for interval in band], color=colour, linewidth=1.8, label=controller.name)
    if len(curves) > 1:
        _draw_band(axes, x, band, colour)


def error_over(axis: str, records: Sequence[BenchmarkRecord]) -> bytes:
    """PNG: mean tip error over the last 10 steps over the setting of an axis; a panel per benchmark that has it."""
    varied = [record for record in records if _along(record, axis)]
    figure, panels = _panels(len(varied), axis, "mean tip error [mm]")
    for axes, record in zip(panels, varied, strict=True):
        worlds = _along(record, axis)
        axes.set(title=record.title)
        _logarithmic(axes, "y", (1, 2, 5))
        axes.axvspan(*worlds[0].trained, color="black", alpha=0.06, linewidth=0)
        for label, name in lines_of(record, worlds).items():
            _draw_line(axes, record.controller(name), worlds, label)
        floors = {world.value: world.known_floors.mean() for world in worlds if len(world.known_floors)}
        if floors:
            axes.plot(list(floors), np.maximum(list(floors.values()), SMALLEST_MM), label=FLOOR, **STYLES[FLOOR])
    return png(_with_legend(figure, panels), DPI)


def _along(record: BenchmarkRecord, axis: str) -> list[World]:
    """The worlds of a benchmark that are points of an axis, in order."""
    return sorted((world for world in record.of_role(SWEEP) if world.axis == axis), key=lambda world: world.value)


def _draw_line(axes: Axes, controller: ControllerRecord, worlds: Sequence[World], label: str) -> None:
    points = [world for world in worlds if controller.has(world.name)]
    band = [Bootstrap(world.episodes, RESAMPLES).mean(controller.errors(world.name)) for world in points]
    values, style = [world.value for world in points], _style(label)
    axes.plot(values, [max(interval.value, SMALLEST_MM) for interval in band], marker=".", label=label, **style)
    _draw_band(axes, values, band, style["color"])


def _draw_band(axes: Axes, x: Any, band: Sequence[Any], colour: str) -> None:
    low, high = (np.maximum([getattr(interval, end) for interval in band], SMALLEST_MM) for end in ("low", "high"))
    axes.fill_between(x, low, high, color=colour, alpha=0.2, linewidth=0)


def distributions(records: Sequence[BenchmarkRecord]) -> bytes:
    """PNG: share of the episodes with an error below a value, for the best learner (all seeds together) and others."""
    figure, panels = _panels(len(records), "tip error over the last 10 steps [mm]", "share of episodes below")
    for axes, record in zip(panels, records, strict=True):
        world = record.of_role(TEST)[0]
        axes.set(title=record.title, ylim=(0, 1))
        _logarithmic(axes, "x")
        axes.axvline(1.0, color="black", linestyle=":", linewidth=1)
        for label, name in lines_of(record, [world]).items():
            if record.controller(name).has(world.name):
                _draw_shares(axes, label, record.controller(name).errors(world.name))
        if len(world.known_floors):
            _draw_shares(axes, FLOOR, world.known_floors)
    return png(_with_legend(figure, panels), DPI)


def _draw_shares(axes: Axes, label: str, errors: Array) -> None:
    below = np.sort(np.maximum(errors, SMALLEST_MM), axis=None)
    axes.plot(below, np.arange(1, len(below) + 1) / len(below), label=label, **_style(label))


def _learned(record: BenchmarkRecord) -> list[ControllerRecord]:
    return [record.controller(name) for name in record.names(POLICY)]


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
    """The figure with one legend of all lines of its panels."""
    handles: Mapping[str, Any] = {
        label: handle for axes in panels for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    columns = 4 if len(panels) > 1 else 2
    figure.legend(handles.values(), handles.keys(), loc="outside upper center", ncols=columns, frameon=False)
    return figure


def _logarithmic(axes: Axes, names: str, marks: Sequence[float] = (1,)) -> None:
    """Make these of its axes, "x", "y" or "xy", logarithmic, with ticks at these multiples of the powers of ten."""
    for name in names:
        axes.set(**{f"{name}scale": "log"})
        axis = axes.xaxis if name == "x" else axes.yaxis
        axis.set_major_locator(LogLocator(subs=marks))
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter(NullFormatter())
