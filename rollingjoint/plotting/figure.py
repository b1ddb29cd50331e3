"""A figure of any mechanism or equilibrium, and figures as files; matplotlib is imported at the first figure."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rollingjoint.chain.chain import AnyChain
from rollingjoint.chain.equilibrium import Equilibrium, EquilibriumInSpace
from rollingjoint.chain.hinge import HingeChain
from rollingjoint.chain.rolling import RollingChain
from rollingjoint.chain.solution import Solution
from rollingjoint.chain.spatial import SpatialChain
from rollingjoint.chain.spatial_equilibrium import FRICTION
from rollingjoint.chain.status import Status
from rollingjoint.errors import InvalidInput, naming, naming_extras
from rollingjoint.load import SPATIAL_LOAD_COLUMNS
from rollingjoint.plotting.planar import plot_mechanism
from rollingjoint.plotting.spatial import plot_arm

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_FZ = SPATIAL_LOAD_COLUMNS.index("fz")


def figure_of(what: AnyChain | Solution, friction: float = FRICTION) -> Figure:
    """A new figure of a mechanism at rest, or of one equilibrium.

    Args:
        what: a mechanism, or an equilibrium of one.
        friction: coefficient of contact lines in space, beside which teeth carry a force; other pictures have none.
    """
    with naming_extras():
        from matplotlib.figure import Figure

    mechanism = what.mechanism if isinstance(what, Solution) else what
    figure = Figure(figsize=(6.4, 6.4))
    draw: Callable[[Any, Figure], Axes] = (
        _draw_chain if mechanism.dimension == 2 else partial(_draw_arm, friction=friction)
    )
    ax = draw(what, figure)
    ax.set_title(_title(what))
    return figure


def _draw_chain(what: RollingChain | Equilibrium, figure: Figure) -> Axes:
    return plot_mechanism(what, figure.subplots())


def _draw_arm(what: HingeChain | SpatialChain | EquilibriumInSpace, figure: Figure, friction: float) -> Axes:
    ax = plot_arm(what, figure.add_subplot(projection="3d"), friction=friction)
    if isinstance(what, EquilibriumInSpace) and what.loads[:, _FZ].sum() > 0:
        ax.invert_zaxis()  # a hanging arm
    legend = ax.get_legend()
    if isinstance(what, EquilibriumInSpace) and what.walls is not None and legend is not None:
        legend.set_loc("upper right")  # walls fill the axes, and would lie below it
        legend.set_bbox_to_anchor((0.0, 1.0), transform=ax.transAxes)
    return ax


def _title(what: AnyChain | Solution) -> str:
    """Name of the mechanism, with the status unless it is CONVERGED."""
    if not isinstance(what, Solution):
        return what.name
    name, status = what.mechanism.name, Status(int(what.status))
    return str(name) if status == Status.CONVERGED else f"{name}: {status.name}"


def save_figure(fig: Figure, path: str | Path, dpi: int = 150) -> Path:
    """The path, after writing the figure there in the format of its suffix.

    Raises:
        InvalidInput: a suffix that matplotlib cannot write, or a folder that does not exist.
    """
    path = check_figure_path(path)
    with naming(path):
        fig.savefig(path, dpi=dpi, bbox_inches="tight")
    return path


def check_figure_path(path: str | Path, more: Sequence[str] = ()) -> Path:
    """The path, checked for writing a figure.

    Args:
        path: of the file.
        more: suffixes that are fine in addition to the ones of matplotlib.

    Raises:
        InvalidInput: a suffix that matplotlib cannot write, or a folder that does not exist.
    """
    with naming_extras():
        from matplotlib.backend_bases import FigureCanvasBase

    path = Path(path)
    suffixes = sorted({*FigureCanvasBase.get_supported_filetypes(), *more})
    if path.suffix.lower().lstrip(".") not in suffixes:
        raise InvalidInput("picture", str(path), f"a file name that ends in one of .{', .'.join(suffixes)}")
    if not path.parent.is_dir():
        raise InvalidInput("picture", str(path), "a file in an existing folder", f"Create {path.parent} first.")
    return path
