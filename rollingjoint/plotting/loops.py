"""Pictures of loops: the path of the tip, output over input, and the mechanism on its way around."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rollingjoint.chain.equilibrium import Equilibrium
from rollingjoint.errors import InvalidInput, naming_extras
from rollingjoint.plotting.film import Pixels, canvas_of, gif_path, pixels_of, save_gif
from rollingjoint.plotting.friction import tension_colors, tension_ends
from rollingjoint.plotting.parts import PALETTE
from rollingjoint.plotting.planar import plot_mechanism
from rollingjoint.statics.loop import Loop

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

_FRAMES = 40


def plot_loops(loops: Sequence[Loop], labels: Sequence[str]) -> Figure:
    """A figure of loops of one mechanism: path of the tip on the left, travel of the tip over the input on the right.

    The way from the middle to the first end, before any slip, is dashed.

    Args:
        loops: from trace_loop.
        labels: legend text of each.
    Raises:
        InvalidInput: no loops, or another number of labels.
    """
    with naming_extras():
        from matplotlib.figure import Figure

    if not loops or len(labels) != len(loops):
        raise InvalidInput("labels", list(labels), f"{len(loops)}, one per loop, and at least one")
    figure = Figure(figsize=(10.0, 4.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    for place, (loop, label) in enumerate(zip(loops, labels, strict=True)):
        color, first = PALETTE[place % len(PALETTE)], slice(None, len(loop.shares) - 2 * loop.steps)
        for part, style in (
            (first, {"linestyle": ":", "linewidth": 1.0}),
            (loop.cycle, {"linewidth": 1.3, "label": label}),
        ):
            left.plot(*_plane(loops[0], loop)[part].T, color=color, **style)
            right.plot(_input(loop)[part], moved(loops[0], loop)[part], color=color, **style)
    _finish(left, *_plane_names(loops[0]))
    left.set_aspect("equal", adjustable="datalim")
    _finish(right, _input_name(loops[0]), "tip along its travel [mm]")
    right.legend()
    return figure


def moved(first: Loop, loop: Loop) -> Array:
    """(K,) travel of the tip from the start of the first loop, along the way between the ends of that loop [mm]."""
    forward, _ = first.branches
    way = forward[-1] - forward[0]
    return (loop.path.tip - first.path.tip[0]) @ (way / (np.linalg.norm(way) or 1.0))


def save_animation(loop: Loop, path: str | Path) -> Path:
    """The path, after writing a GIF of a planar mechanism on its way around the last cycle of a loop.

    Tendons are coloured by their tension, and rings mark holes in which they stick.

    Raises:
        InvalidInput: an arm, another suffix than .gif, or a folder that does not exist.
    """
    if not isinstance(loop.path, Equilibrium):
        raise InvalidInput("loop", loop.path, "that of a planar chain", "An arm's loop is drawn by plot_loops.")
    return save_gif(_frames(loop), gif_path(path))


def _frames(loop: Loop) -> Iterator[Pixels]:
    """Pictures of the last cycle, (height, width, 3); moving parts are drawn on a constant background."""
    figure, canvas = canvas_of(9.0, 5.0)
    left, right = figure.add_axes((0.075, 0.11, 0.4, 0.82)), figure.add_axes((0.65, 0.11, 0.33, 0.82))
    scale, ends = figure.add_axes((0.5, 0.2, 0.014, 0.6)), tension_ends(loop.path)
    figure.colorbar(tension_colors(loop.path, ends), cax=scale, label="tension [N]")
    along, inputs = moved(loop, loop), _input(loop)
    right.plot(inputs[loop.cycle], along[loop.cycle], color=PALETTE[0])
    _finish(right, _input_name(loop), "tip along its travel [mm]")
    _finish(left, "x [mm]", "y [mm]")
    left.set(**_window(loop), aspect="equal", title="ringed holes: the tendon sticks in them")
    left.title.set_fontsize(10)
    canvas.draw()
    background = canvas.copy_from_bbox(figure.bbox)
    first = len(loop.shares) - 2 * loop.steps - 1
    for step in np.unique(np.linspace(first, len(loop.shares) - 1, _FRAMES + 1).astype(int))[:-1]:
        canvas.restore_region(background)
        before = {*left.get_children()}
        plot_mechanism(loop.path.row(step), left, tension_range=ends, numbers=False, contacts=False, legend=False)
        left.set(**_window(loop))
        moving = sorted({*left.get_children()} - before, key=lambda artist: artist.get_zorder())
        for artist in [*moving, *right.plot(inputs[step], along[step], "o", color=PALETTE[5], markersize=8)]:
            figure.draw_artist(artist)
            artist.remove()
        yield pixels_of(canvas)


def _window(loop: Loop) -> dict[str, tuple[float, float]]:
    """Limits of square axes that hold the mechanism throughout the last cycle [mm]."""
    points = loop.path.poses[loop.cycle][..., :2].reshape(-1, 2)
    x, y = 0.5 * (points.min(axis=0) + points.max(axis=0))
    half = 0.5 * float(np.ptp(points, axis=0).max()) + 0.2 * loop.path.chain.length
    return {"xlim": (x - half, x + half), "ylim": (y - half, y + half)}


def _plane(first: Loop, loop: Loop) -> Array:
    """(K, 2) tips of a planar mechanism, or of an arm in the plane that fits the first loop best [mm]."""
    tips, others = loop.path.tip, first.path.tip
    if tips.shape[1] == 2:
        return tips
    _, _, axes = np.linalg.svd(others - others.mean(axis=0), full_matrices=False)
    return (tips - others[0]) @ axes[:2].T


def _plane_names(loop: Loop) -> tuple[str, str]:
    if loop.path.tip.shape[1] == 2:
        return "x of the tip [mm]", "y of the tip [mm]"
    return "tip in the plane of its path [mm]", "across [mm]"


def _leader(loop: Loop) -> int:
    """The first of the tendons with the largest swing."""
    return int(np.argmax(np.abs(loop.swing)))


def _input(loop: Loop) -> Array:
    """(K,) input of the tendon with the largest swing, from the middle [mm] or [N]."""
    return loop.shares * loop.swing[_leader(loop)]


def _input_name(loop: Loop) -> str:
    kind = "length [mm]" if loop.given == "lengths" else "tension [N]"
    return f"change of tendon {_leader(loop)}'s {kind}"


def _finish(ax: Axes, x: str, y: str) -> None:
    ax.set(xlabel=x, ylabel=y)
    ax.grid(color="#E5E8EC", linewidth=0.6)
    ax.set_axisbelow(True)
