"""Films as GIF files: a planar chain that is pushed in among walls, with the forces of the walls."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rollingjoint.chain.equilibrium import Equilibrium
from rollingjoint.errors import InvalidInput, naming_extras
from rollingjoint.plotting.figure import check_figure_path
from rollingjoint.plotting.planar import plot_mechanism
from rollingjoint.plotting.walls import (
    PRESSED_COLOR,
    draw_pressed,
    draw_surroundings,
    force_colors,
    in_world,
    wall_arrow_scale,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
Pixels = NDArray[np.uint8]

ANIMATED = "gif"
"""Suffix of animations."""
_COLORS, _DPI, _MILLISECONDS, _MOST_FRAMES = 256, 72, 110, 60
_LYING = (0.07, 0.5, 0.82, 0.48), (0.91, 0.5, 0.014, 0.46), (0.07, 0.11, 0.82, 0.26)  # chain, scale, force
_UPRIGHT = (0.06, 0.1, 0.42, 0.88), (0.5, 0.2, 0.014, 0.6), (0.65, 0.11, 0.33, 0.82)


def gif_path(path: str | Path) -> Path:
    """The path of an animation; InvalidInput for another suffix than .gif, or a folder that does not exist."""
    if not str(path).lower().endswith(f".{ANIMATED}"):
        raise InvalidInput("animation", str(path), f"a file name that ends in .{ANIMATED}")
    return check_figure_path(path, more=(ANIMATED,))


def save_gif(pictures: Iterable[Pixels], path: Path) -> Path:
    """The path, after writing pictures (height, width, 3) as an animation with one palette."""
    with naming_extras():
        from PIL import Image

    frames = [_coarse(picture) for picture in pictures]
    pixels = np.concatenate([frame.reshape(-1, 3) for frame in frames[:: len(frames) // 4 or 1]])
    colors, counts = np.unique(pixels, axis=0, return_counts=True)
    palette = Image.new("P", (1, 1))
    palette.putpalette(colors[np.argsort(-counts, kind="stable")[:_COLORS]].tobytes())
    first, *others = [Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    first.save(path, "GIF", save_all=True, append_images=others, duration=_MILLISECONDS, loop=0)
    return path


def canvas_of(width: float, height: float) -> tuple[Figure, Any]:
    """A figure of this size [inch] at the resolution of films, and its canvas."""
    with naming_extras():
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=_DPI)
    return figure, FigureCanvasAgg(figure)


def pixels_of(canvas: Any) -> Pixels:
    """The picture on a canvas, (height, width, 3)."""
    return np.array(canvas.buffer_rgba())[..., :3]


def save_wall_film(
    path: Sequence[Equilibrium], inputs: Sequence[float] | Array, file: str | Path, label: str = "feed [mm]"
) -> Path:
    """The path of the file, after writing a GIF of a path among walls: the chain, forces of the walls, insertion force.

    Args:
        path: equilibria, each the history or the start of the next; at most 60 of them are shown.
        inputs: the input of each, such as the way by which the base is pushed in.
        file: a name that ends in .gif.
        label: the name of the input, with its unit.
    Raises:
        InvalidInput: another number of inputs, equilibria without surroundings or in space, another suffix, no such
            folder.
    """
    if len(path) != len(inputs) or not path or any(eq.walls is None for eq in path):
        raise InvalidInput("path", f"{len(path)} equilibria", f"{len(inputs)} equilibria among walls, one per input")
    if len(path[0].tip) != 2:
        raise InvalidInput("path", path[0], "equilibria of a planar chain")
    return save_gif(_wall_pictures(path, np.asarray(inputs, float), label), gif_path(file))


def _wall_pictures(path: Sequence[Equilibrium], inputs: Array, label: str) -> Iterator[Pixels]:
    """Pictures of the path; moving parts are drawn on a constant background."""
    figure, canvas = canvas_of(9.0, 5.0)
    everywhere = [in_world(eq) for eq in path]
    places = np.concatenate([eq.poses[:, :2] for eq in everywhere])
    margin = 2.4 * float(max(eq.walls.walls.bars[..., 5].max() for eq in path if eq.walls is not None))
    low, high = places.min(axis=0) - margin, places.max(axis=0) + margin
    ax, bar, curve = (
        figure.add_axes(place) for place in (_LYING if np.ptp([low, high], axis=0).argmax() == 0 else _UPRIGHT)
    )
    draw_surroundings(ax, everywhere, outline=False)
    ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", xlabel="x [mm]", ylabel="y [mm]")
    colors, scale = force_colors(path), wall_arrow_scale(path)
    figure.colorbar(colors, cax=bar, label="normal force [N]")
    forces = np.array([eq.insertion_force for eq in path])
    curve.plot(inputs, forces, color=PRESSED_COLOR, linewidth=1.4)
    curve.set(xlabel=label, ylabel="insertion force [N]")
    curve.grid(color="#E5E8EC", linewidth=0.6)
    canvas.draw()
    limits: dict[str, Any] = {"xlim": ax.get_xlim(), "ylim": ax.get_ylim()}
    background = canvas.copy_from_bbox(figure.bbox)
    shown = np.unique(np.linspace(0, len(path) - 1, min(len(path), _MOST_FRAMES)).astype(int))
    for step in shown:
        canvas.restore_region(background)
        before = {*ax.get_children()}
        plot_mechanism(path[step], ax, walls=False, numbers=False, contacts=False, legend=False)
        draw_pressed(ax, path[step], scale, colors, scale=False)
        ax.set(**limits)
        moving = sorted({*ax.get_children()} - before, key=lambda artist: artist.get_zorder())
        for artist in [*moving, *curve.plot(inputs[step], forces[step], "o", color=PRESSED_COLOR, markersize=7)]:
            figure.draw_artist(artist)
            artist.remove()
        yield pixels_of(canvas)


def _coarse(picture: Pixels) -> Pixels:
    """The picture with 32 levels per colour, white and black exact, to save colours of the palette."""
    return np.bitwise_or(picture >> 3 << 3, picture >> 5, dtype=np.uint8)
