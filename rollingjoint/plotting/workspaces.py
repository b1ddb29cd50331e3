"""Pictures of workspaces: dexterity, force and stiffness over the cells in which the tip can be."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rollingjoint.errors import naming_extras
from rollingjoint.inverse.reachable import Workspace
from rollingjoint.plotting.parts import LINK_COLOR

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_ELLIPSES = 30  # that are drawn, about
_LONG = 1.2  # of their distance: longer diameter of a median ellipse


def plot_workspace(workspace: Workspace) -> Figure:
    """A figure of a workspace: dexterity, force in every direction, and stiffness of the softest direction.

    In the plane with compliance ellipses, one scale for all: the way of the tip under a small force that turns around.
    In space the half of the tips with the larger y is drawn.
    """
    with naming_extras():
        from matplotlib.figure import Figure

    planar = workspace.cells.shape[1] == 2
    figure = Figure(figsize=(13.0, 4.6), layout="constrained")
    values = {
        "dexterity [1]": workspace.dexterity,
        "force in every direction [N]": workspace.force,
        "stiffness, softest direction [N/mm]": workspace.principal_stiffness[0][:, 0],
    }
    for place, (title, numbers) in enumerate(values.items(), start=1):
        ax: Any = figure.add_subplot(1, 3, place, **({} if planar else {"projection": "3d"}))
        shown = np.where(np.isfinite(numbers), numbers, np.nan)
        drawn = _draw_cells(ax, workspace, shown) if planar else _draw_points(ax, workspace, shown)
        figure.colorbar(drawn, ax=ax, shrink=0.8, pad=0.05 if planar else 0.15)
        ax.set_title(title, fontsize=10)
        ax.set_aspect("equal")
        ax.set(xlabel="x [mm]", ylabel="y [mm]")
        links = workspace.equilibria.positions[int(np.argmax(workspace.dexterity))]
        ax.plot(*links.T, ".-", color=LINK_COLOR, linewidth=2.0)
        if planar:
            ax.set(**_frame(workspace, links))
        if planar and place == len(values):
            _draw_ellipses(ax, workspace)
    figure.suptitle(f"{workspace.equilibria.mechanism.name}: tips within {_limits(workspace)}")
    return figure


def _frame(workspace: Workspace, links: NDArray[np.float64]) -> dict[str, tuple[float, float]]:
    """Limits of axes that hold the cells and the links of an equilibrium."""
    side = workspace.cell
    points = np.concatenate([workspace.cells * side, (workspace.cells + 1) * side, links])
    low, high = points.min(axis=0) - 2 * side, points.max(axis=0) + 2 * side
    return {"xlim": (low[0], high[0]), "ylim": (low[1], high[1])}


def _limits(workspace: Workspace) -> str:
    low, high = (np.unique(limit) for limit in workspace.tension_limits)
    if low.size == high.size == 1:
        return f"tensions from {low[0]:g} to {high[0]:g} N"
    return "the tension limits"


def _draw_cells(ax: Any, workspace: Workspace, numbers: NDArray[np.float64]) -> Any:
    """The cells as squares of a colour each."""
    first, last = workspace.cells.min(axis=0), workspace.cells.max(axis=0)
    table = np.full(last - first + 1, np.nan)
    table[tuple((workspace.cells - first).T)] = numbers
    edges = [np.arange(first[k], last[k] + 2) * workspace.cell for k in (0, 1)]
    return ax.pcolormesh(*edges, table.T, cmap="viridis")


def _draw_points(ax: Any, workspace: Workspace, numbers: NDArray[np.float64]) -> Any:
    """The tips of one half as points."""
    tips = workspace.equilibria.tip
    half = tips[:, 1] >= np.median(tips[:, 1])
    ax.set_zlabel("z [mm]")
    return ax.scatter(*tips[half].T, c=numbers[half], s=6, cmap="viridis")


def _draw_ellipses(ax: Any, workspace: Workspace) -> None:
    """Compliance ellipses on a part of the cells."""
    from matplotlib.collections import EllipseCollection

    stride = max(1, round(np.sqrt(len(workspace.cells) / _ELLIPSES)))
    rows = np.flatnonzero((workspace.cells % stride == 0).all(axis=1))
    stiffnesses, axes = workspace.principal_stiffness
    semi = 1.0 / stiffnesses[rows]
    scale = _LONG * stride * workspace.cell / (2.0 * np.median(semi[:, 0]))
    angles = np.degrees(np.arctan2(axes[rows, 1, 0], axes[rows, 0, 0]))
    sizes = 2.0 * scale * semi
    places = workspace.equilibria.tip[rows]
    style = {"offsets": places, "offset_transform": ax.transData, "facecolor": "none", "edgecolor": "black"}
    ax.add_collection(EllipseCollection(sizes[:, 0], sizes[:, 1], angles, units="xy", linewidth=0.9, **style))
    ax.set_xlabel(f"x [mm]; ellipses: 1 mm is {1.0 / scale:.2g} mm/N")
