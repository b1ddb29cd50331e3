"""Pictures of plans: the mechanism on its way along the path, lengths and tensions over time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

import numpy as np

from rollingjoint.chain.outline import to_world
from rollingjoint.errors import naming_extras
from rollingjoint.plan.result import Plan, PlanStatus
from rollingjoint.plotting.parts import LIMIT_COLOR, PALETTE
from rollingjoint.plotting.planar import plot_family
from rollingjoint.plotting.spatial import plot_arm

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_POSES = 5  # that are drawn
_FIRST, _LAST = 0.35, 1.0  # shares of a colour map


def plot_plan(plan: Plan) -> Figure:
    """A figure of a plan: some poses, the path and the way of the tip on the left, lengths and tensions on the right.

    Steps that snap are crosses on the way, and lines over time; the way is dotted in detours.
    """
    with naming_extras():
        from matplotlib import colormaps
        from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 5.6), layout="constrained")
    left, right = cast("Any", figure.subfigures)(1, 2, width_ratios=(1.15, 1.0))
    shown = np.unique(np.linspace(0, len(plan.times) - 1, _POSES).astype(int))
    colors = [colormaps["Blues"](share) for share in np.linspace(_FIRST, _LAST, len(shown))]
    rows = [plan.equilibria.row(int(step)) for step in shown]
    planar = rows[0].tip.shape == (2,)
    ax: Any = left.add_subplot() if planar else left.add_subplot(projection="3d")
    tips, targets = plan.tip, _places(plan)
    if planar:
        plot_family(rows, ["" for _ in rows], ax, colors=colors, tendons=False, legend=False)
        ax.set_aspect("equal", adjustable="datalim")
        if plan.equilibria.walls is not None:
            tips = np.array([to_world(base, tip) for base, tip in zip(plan.equilibria.walls.base, tips, strict=True)])
    else:
        for row, color in zip(rows, colors, strict=True):
            plot_arm(row, ax, tendons=False, contacts=False, color=color)
    ax.plot(*targets.T, color=PALETTE[1], linewidth=2.5, label="path", zorder=8)
    off = plan.status == PlanStatus.DETOUR
    for mask, style in ((~off, "-"), (off, ":")):
        way = np.where((mask | np.append(mask[1:], False))[:, None], tips, np.nan)
        label = "tip, in a detour" if style == ":" else "tip"
        ax.plot(*way.T, style, color=PALETTE[5], linewidth=1.4, label=label, zorder=9)
    ax.plot(*tips[plan.snapped].T, "x", color=LIMIT_COLOR, markersize=8, markeredgewidth=2, label="snap", zorder=10)
    handles, labels = ax.get_legend_handles_labels()
    used = {"path", "tip", *(["tip, in a detour"] if off.any() else []), *(["snap"] if plan.snapped.any() else [])}
    pairs = [(handle, label) for handle, label in zip(handles, labels, strict=True) if label in used]
    ax.legend(*zip(*pairs, strict=True), loc="upper left", fontsize=8)
    above, below = right.subplots(2, 1, sharex=True)
    for j in range(plan.lengths.shape[1]):
        drawn: dict[str, Any] = {"color": PALETTE[j % len(PALETTE)], "linewidth": 1.4}
        above.plot(plan.times, plan.lengths[:, j] - plan.lengths[0, j], label=f"tendon {j}", **drawn)
        below.plot(plan.times, plan.tensions[:, j], **drawn)
    if plan.equilibria.walls is not None:
        below.plot(plan.times, plan.wall_force, "k--", linewidth=1.2, label="largest force of a wall")
        below.legend(fontsize=8)
    for axes in (above, below):
        for time in plan.times[plan.snapped]:
            axes.axvline(time, color=LIMIT_COLOR, linewidth=0.8)
        axes.grid(color="#E5E8EC", linewidth=0.6)
        axes.set_axisbelow(True)
    above.set(ylabel="change of the command [mm]")
    above.legend(fontsize=8)
    below.set(xlabel="time [s]", ylabel="tension [N]" if plan.equilibria.walls is None else "tension, force [N]")
    return figure


def _places(plan: Plan) -> Any:
    """Where the tip should be, (K, 2 or 3) [mm]."""
    targets, d = plan.targets, plan.tip.shape[1]
    if targets.shape[-2:] == (4, 4):
        return (targets[:, -1] if targets.ndim == 4 else targets)[..., :3, 3]
    return (targets[:, -1] if targets.ndim == 3 else targets)[:, :d]
