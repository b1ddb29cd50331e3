"""Pictures of a search: best so far, the best design and the reference, MAP-Elites' archive, the Pareto set."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

import numpy as np
from matplotlib.axes import Axes
from mpl_toolkits.mplot3d import Axes3D

from agents.evaluation.pictures import COLOURS, figure_of, png, tidy
from agents.search.methods import METHODS
from agents.search.optimiser import Array
from agents.search.outcome import Search, SearchOutcome, words
from agents.search.problem import measured, reference
from rollingjoint import RollingChain, SpatialChain, solve_tensions
from rollingjoint.errors import MechanismError
from rollingjoint.plotting import plot_arm, plot_family

RATIOS = (1 / 3, 1 / 3**0.5, 1.0, 3**0.5, 3.0)  # of the tensions, left to right, in which mechanisms are drawn
TENSION = 10.0  # their sum [N]
MOST_POSES = 3  # in which mechanisms in space are drawn
DPI = 110


def progress(search: Search) -> bytes:
    """PNG: best feasible design so far over evaluations and over seconds, per method: median and range of the seeds."""
    figure = figure_of(10.5, 4.4)
    by_evaluations, by_seconds = figure.subplots(1, 2, sharey=True)
    lowest = min(outcome.seconds[0] for outcome in search.all)
    seconds = np.geomspace(max(lowest, 1e-3), max(outcome.seconds[-1] for outcome in search.all), 300)
    for method, outcomes in search.outcomes.items():
        colour = COLOURS[list(METHODS).index(method) % len(COLOURS)]
        evaluations = np.arange(1.0, len(outcomes[0].seconds) + 1)
        _band(by_evaluations, evaluations, [outcome.best_so_far for outcome in outcomes], search, colour, method)
        _band(by_seconds, seconds, [_at(outcome, seconds) for outcome in outcomes], search, colour, method)
    for axes, label in ((by_evaluations, "evaluations"), (by_seconds, "seconds")):
        axes.set(xlabel=label, xscale="log")
        axes.xaxis.set_major_formatter("{x:,g}")
        tidy(axes)
    by_evaluations.set_ylabel(f"best {search.shown_name}")
    _focus(by_evaluations, search)
    figure.legend(*by_evaluations.get_legend_handles_labels(), loc="outside right upper", frameon=False)
    return png(figure, DPI)


def _band(axes: Axes, x: Array, curves: Sequence[Array], search: Search, colour: str, method: str) -> None:
    costs = np.sort(np.array(curves), axis=0)
    curves = (costs[len(costs) // 2], costs[0], costs[-1])
    middle, low, high = (search.shown(np.where(np.isfinite(curve), curve, np.nan)) for curve in curves)
    axes.plot(x, middle, color=colour, linewidth=1.8, label=words(method))
    axes.fill_between(x, low, high, color=colour, alpha=0.15, linewidth=0)


def _at(outcome: SearchOutcome, seconds: Array) -> Array:
    """Best so far at given times, infinite before the first batch."""
    place = np.searchsorted(outcome.seconds, seconds, side="right")
    return np.where(place > 0, outcome.best_so_far[place - 1], np.inf)


def _focus(axes: Axes, search: Search) -> None:
    """Show the best cost, and the cost that four runs in five are below after a twentieth of the budget."""
    early = [outcome.best_so_far[len(outcome.seconds) // 20] for outcome in search.all]
    finite = [cost for cost in early if np.isfinite(cost)]
    if not finite or not np.isfinite(search.winner.best):
        return
    ends = search.shown(np.array([search.winner.best, np.quantile(finite, 0.8)]))
    room = 0.05 * abs(ends[1] - ends[0]) or 1e-3
    axes.set_ylim(ends.min() - room, ends.max() + room)


def shapes(search: Search, best: RollingChain | SpatialChain | None) -> bytes:
    """PNG: best design and reference, under five pairs of tensions, or those of the first objective."""
    theirs = reference(search.config)
    if isinstance(theirs, SpatialChain):
        assert best is None or isinstance(best, SpatialChain)
        return _shapes_in_space(search, best, theirs)
    assert best is None or isinstance(best, RollingChain)
    drawn = [mechanism for mechanism in (best, theirs) if mechanism is not None]
    figure = figure_of(5.2 * len(drawn), 5.0)
    panels = np.atleast_1d(figure.subplots(1, len(drawn), sharex=True, sharey=True))
    tensions: list[Any] = [(TENSION * ratio / (1 + ratio), TENSION / (1 + ratio)) for ratio in RATIOS]
    if theirs.n_tendons != 2:
        tensions = _tensions(search, theirs)[: len(RATIOS)]
    for axes, mechanism in zip(panels, drawn, strict=True):
        equilibria = [solve_tensions(mechanism, row) for row in tensions]
        labels = [", ".join(f"{tension:.1f} N" for tension in row) for row in tensions]
        shapes = [(shape, label) for shape, label in zip(equilibria, labels, strict=True) if shape.ok]
        if shapes:
            plot_family(
                [shape for shape, _ in shapes], [label for _, label in shapes], axes, tendons=True, legend=False
            )
        axes.set_title("best design" if mechanism is best else words(mechanism.name or "reference"))
    handles = panels[0].get_legend_handles_labels()
    figure.legend(
        *handles,
        loc="outside right upper",
        frameon=False,
        title="tensions" if theirs.n_tendons != 2 else "left, right tendon",
    )
    return png(figure, DPI)


def _shapes_in_space(search: Search, best: SpatialChain | None, theirs: SpatialChain) -> bytes:
    """PNG: the same in space, contact lines coloured by their tilting margins."""
    rows = _tensions(search, theirs)
    drawn = [mechanism for mechanism in (best, theirs) if mechanism is not None]
    figure = figure_of(5.2 * len(drawn), 5.0)
    for place, mechanism in enumerate(drawn):
        axes = cast(Axes3D, figure.add_subplot(1, len(drawn), place + 1, projection="3d"))
        shapes = [shape for shape in (solve_tensions(mechanism, row) for row in rows[:MOST_POSES]) if shape.ok]
        for shape in shapes:
            plot_arm(shape, axes)
        _frame(axes, np.stack([mechanism.poses(mechanism.neutral_angles), *(shape.poses for shape in shapes)]))
        axes.set_title("best design" if mechanism is best else words(mechanism.name or "reference"))
    return png(figure, DPI)


def _tensions(search: Search, theirs: RollingChain | SpatialChain) -> list[Any]:
    """The tensions of the first objective that has several rows of them; without one, equal tensions."""
    given = (getattr(objective, "tensions", ()) for objective in measured(search.problem))
    rows = (list(rows) for rows in given if np.ndim(rows) == 2 and np.shape(rows)[1] == theirs.n_tendons)
    return next(rows, [(TENSION / theirs.n_tendons,) * theirs.n_tendons])


def _frame(axes: Axes3D, poses: Array) -> None:
    """Show links (any, n, 4, 4) at one scale, without the legend."""
    points = poses[..., :3, 3].reshape(-1, 3)
    low, high = points.min(axis=0), points.max(axis=0)
    middle, reach = 0.5 * (low + high), 0.55 * float((high - low).max())
    for limit, centre in zip((axes.set_xlim, axes.set_ylim, axes.set_zlim), middle.tolist(), strict=True):
        limit(centre - reach, centre + reach)
    axes.set_box_aspect((1.0, 1.0, 1.0))
    if axes.get_legend() is not None:
        axes.get_legend().remove()


def archive(search: Search) -> bytes | None:
    """PNG: the best feasible design of MAP-Elites in every cell of its archive; None where it was not run."""
    if search.archive is None:
        return None
    designs, columns, ranges = search.archive.designs, search.archive.columns, search.archive.ranges
    shown = np.where(designs < 0, np.nan, search.shown(search.everything.cost[designs])).T
    figure = figure_of(6.6, 5.0)
    axes = figure.subplots()
    extent = (ranges[0, 0], ranges[0, 1], ranges[1, 0], ranges[1, 1])
    image = axes.imshow(shown, origin="lower", extent=extent, aspect="auto", cmap="viridis")
    across, up = (f"{words(search.names[place])} [{search.units[place]}]" for place in columns)
    axes.set(xlabel=across, ylabel=up)
    axes.set_title(f"best design in {int((designs >= 0).sum())} of {designs.size} cells")
    figure.colorbar(image, label=search.shown_name)
    return png(figure, DPI)


def front(search: Search) -> bytes | None:
    """PNG: all feasible designs over the first two objectives, those that no other beats marked; None for one."""
    if len(search.problem.objectives) < 2 or not search.front.any():
        return None
    figure = figure_of(7.0, 4.8)
    axes = figure.subplots()
    x, y = search.everything.measured[:, :2].T
    feasible = search.everything.feasible
    axes.scatter(x[feasible], y[feasible], s=4, color="0.75", label="feasible designs")
    axes.scatter(x[search.front], y[search.front], s=18, color=COLOURS[1], label="none is better in all")
    axes.set(xlabel=_label(search, 0), ylabel=_label(search, 1))
    tidy(axes)
    figure.legend(loc="outside right upper", frameon=False)
    return png(figure, DPI)


def _label(search: Search, place: int) -> str:
    aim = "more is better" if search.problem.objectives[place].objective.maximise else "less is better"
    return f"{words(search.names[place])} [{search.units[place]}], {aim}"


def best_mechanism(search: Search) -> RollingChain | SpatialChain | None:
    """The best design as a mechanism; None where it is no valid one."""
    try:
        best: RollingChain | SpatialChain = search.problem.space.mechanism(search.winner.best_x)
        return best
    except MechanismError:
        return None
