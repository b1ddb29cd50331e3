"""Pictures of an identification: profiles, residuals and poses; matplotlib is imported when one is drawn."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rollingjoint.errors import naming_extras
from rollingjoint.identify.errors import LINKS, distances
from rollingjoint.identify.findings import Findings
from rollingjoint.identify.measurements import QUANTITIES, Run
from rollingjoint.identify.parameters import Coefficient
from rollingjoint.plotting.figure import save_figure
from rollingjoint.plotting.parts import LINK_COLOR, PALETTE, draw_links

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

TITLES = {
    "nominal": "nominal",
    "together": "all runs fitted",
    "alone": "each run fitted",
    "held out": "from the other runs",
}
MEASURED_COLOR = PALETTE[5]
_MOST_STEPS = 6  # of a run in pictures of poses


def save_pictures(findings: Findings, folder: Path) -> list[Path]:
    """The paths of all pictures, written into an existing folder."""
    figures = {"profiles": draw_profiles(findings)}
    figures |= {f"residuals_{quantity}": draw_residuals(findings, quantity) for quantity in findings.quantities}
    if "position" in findings.quantities and findings.measurements.dimension == 2:
        figures["poses"] = draw_poses(findings)
    return [save_figure(figure, folder / f"{name}.png", dpi=100) for name, figure in figures.items()]


def draw_profiles(findings: Findings) -> Figure:
    """A panel per coefficient: loss of fit as the coefficient changes, for all runs and for each alone."""
    places = [
        place
        for place in range(len(findings.coefficients))
        if findings.together.fit.determined[place] and len(findings.together.profiles[place].values) > 2
    ]
    columns = max(min(len(places), 3), 1)
    figure, axes = _panels(-(-len(places) // columns), columns, (4.6, 3.4))
    for ax in axes.flat[len(places) :]:
        ax.set_axis_off()
    for ax, place in zip(axes.flat, places, strict=False):
        _draw_profiles_of(ax, findings, place)
    return figure


def _draw_profiles_of(ax: Axes, findings: Findings, place: int) -> None:
    """The profiles of one coefficient; bars on top are its intervals."""
    coefficient = findings.coefficients[place]
    drawn = [("all runs", findings.together, PALETTE[6])]
    for color, (run, estimates) in zip(PALETTE, findings.alone.items(), strict=False):
        if coefficient.run is None and coefficient in estimates.coefficients:
            drawn.append((f"{run} alone", estimates, color))
    for height, (label, estimates, color) in zip(np.arange(1.93, 1.0, -0.09), drawn, strict=False):
        at = estimates.coefficients.index(coefficient)
        profile = estimates.profiles[at]
        if len(profile.values) < 3:
            continue
        values, deviances = _smooth(profile.values, profile.deviances / profile.threshold, estimates.values[at])
        ax.plot(values, deviances, "-", color=color, linewidth=1.6, label=label)
        ax.plot(profile.interval, [height, height], "-", color=color, linewidth=4.0, solid_capstyle="butt")
        ax.plot(estimates.values[at], 0.0, "o", color=color, markersize=5, clip_on=False)
    ax.axhline(1.0, color=LINK_COLOR, linestyle=":", linewidth=1.0)
    ax.axvline(coefficient.nominal(findings.measurements.mechanism), color=LINK_COLOR, linewidth=0.8)
    ax.set(xlabel=_axis_label(coefficient), ylim=(0.0, 2.0))
    ax.set_ylabel(f"deviance / its {100 * findings.confidence:g} % limit")
    if len(drawn) > 1:
        ax.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))


def _smooth(values: Array, deviances: Array, best: float) -> tuple[Array, Array]:
    """The curve between its points; the signed root of a deviance is nearly a straight line."""
    from scipy.interpolate import PchipInterpolator

    roots = np.sign(values - best) * np.sqrt(np.maximum(deviances, 0.0))
    many = np.linspace(values[0], values[-1], 121)
    return many, PchipInterpolator(values, roots)(many) ** 2


def _axis_label(coefficient: Coefficient) -> str:
    return f"{coefficient.label} [{coefficient.kind.unit}]" if coefficient.kind.unit else coefficient.label


def draw_residuals(findings: Findings, quantity: str) -> Figure:
    """A row per run, a column per kind of values: errors of every link or tendon, a line per step."""
    runs, kinds = findings.measurements.runs, list(findings.deviations)
    figure, axes = _panels(len(runs), len(kinds), (3.1, 2.6), sharex=True, sharey=True)
    for row, run in zip(axes, runs, strict=True):
        for ax, which in zip(row, kinds, strict=True):
            table = distances(findings.measurements, quantity, findings.deviations[which][findings.rows(run.name)])
            for step, errors in enumerate(table):
                shown, label = np.isfinite(errors), _step_label(run, step, findings.measurements.given)
                style: dict[str, Any] = {"markersize": 4, "linewidth": 1.0, "color": PALETTE[step % len(PALETTE)]}
                ax.plot(np.flatnonzero(shown), errors[shown], "o-", label=label, **style)
            mean = findings.errors(quantity, which, run.name).mean
            ax.set_title(f"{run.name}: {TITLES[which]}, mean {mean:.2f}", fontsize=9)
            ax.grid(alpha=0.3)
        row[0].set_ylabel(f"error of {quantity} [{QUANTITIES[quantity]}]")
        if len(run.steps) <= _MOST_STEPS:
            position: dict[str, Any] = {"loc": "center left", "bbox_to_anchor": (1.0, 0.5), "title_fontsize": 7}
            row[-1].legend(fontsize=7, title=findings.measurements.given, **position)
    axes[0, 0].set_ylim(bottom=0.0)
    for ax in axes[-1]:
        ax.set_xlabel("link" if quantity in LINKS else "tendon")
        ax.xaxis.get_major_locator().set_params(integer=True)
    return figure


def _step_label(run: Run, step: int, given: str) -> str:
    return ", ".join(f"{value:g}" for value in run.steps[step].input(given).values)


def draw_poses(findings: Findings) -> Figure:
    """A row per run, a column per step: the fitted links, and errors of nominal and fitted centres as long arrows."""
    runs = findings.measurements.runs
    columns = min(max(len(run.steps) for run in runs), _MOST_STEPS)
    figure, axes = _panels(len(runs), columns, (2.6, 3.6), sharex=True, sharey=True)
    largest = max(findings.errors("position", which).largest for which in ("nominal", "together"))
    times = max(
        [scale for scale in (1, 2, 5, 10, 20, 50, 100) if scale * largest <= 0.4 * _height(findings)], default=1
    )
    for row, run in zip(axes, runs, strict=True):
        for step, ax in enumerate(row):
            ax.set_aspect("equal")
            if step < len(run.steps):
                _draw_pose(ax, findings, run, step, times)
            else:
                ax.set_axis_off()
        row[0].set_ylabel("y [mm]")
    for ax in axes[-1]:
        ax.set_xlabel("x [mm]")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=8)
    return figure


def _height(findings: Findings) -> float:
    return float(findings.measurements.mechanism.length)


def _draw_pose(ax: Axes, findings: Findings, run: Run, step: int, times: int) -> None:
    """The fitted links, the measured centres, and arrows from each to its place in the model."""
    model, row, values = findings.together.fit.model, findings.rows(run.name)[step], findings.together.values
    fitted = model.equilibria(run, values)[step]
    draw_links(
        ax, fitted.mechanism, _turned(fitted.poses, model.values_in(run, values)["base_angle"]), LINK_COLOR, None
    )
    measured = _centres(findings, model.readings[row])
    for name, color, at in (("nominal", PALETTE[0], model.nominal), ("fitted", PALETTE[2], values)):
        error = times * (_centres(findings, model.predictions(at)[row]) - measured)
        style: dict[str, Any] = {"angles": "xy", "scale_units": "xy", "scale": 1.0, "width": 0.012, "zorder": 5}
        ax.quiver(*measured.T, *error.T, color=color, label=f"{name} less measured, {times} times", **style)
    ax.plot(*measured.T, "s", color=MEASURED_COLOR, markersize=4, label="measured", zorder=6)
    last = distances(findings.measurements, "position", findings.deviations["together"][[row]])[0]
    worst = last[np.isfinite(last)][-1] if np.isfinite(last).any() else np.nan
    label = _step_label(run, step, findings.measurements.given)
    ax.set_title(f"{run.name}: {label}; last link {worst:.1f} mm", fontsize=8)


def _turned(poses: Array, angle: float) -> Array:
    """Poses of links in the measured frame."""
    cos, sin = np.cos(angle), np.sin(angle)
    return np.column_stack([poses[:, :2] @ np.array([[cos, sin], [-sin, cos]]), poses[:, 2] + angle])


def _centres(findings: Findings, reading: Array) -> Array:
    """Origins of the links in a reading, (n, 2)."""
    return reading[findings.measurements.columns("position")].reshape(-1, 2)


def _panels(rows: int, columns: int, size: tuple[float, float], **options: bool) -> tuple[Figure, Any]:
    """A figure and its axes, (rows, columns)."""
    with naming_extras():
        from matplotlib.figure import Figure

    figure = Figure(figsize=(columns * size[0], max(rows, 1) * size[1]), layout="constrained")
    return figure, figure.subplots(max(rows, 1), columns, squeeze=False, **options)  # type: ignore[call-overload]
