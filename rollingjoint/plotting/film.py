"""Films as GIF files: a chain that is pushed in among walls, with the forces of the walls."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rollingjoint.chain.equilibrium import Equilibrium, EquilibriumInSpace
from rollingjoint.errors import InvalidInput, naming_extras
from rollingjoint.plotting import walls_in_space as space
from rollingjoint.plotting.figure import check_figure_path
from rollingjoint.plotting.parts import nice_scale
from rollingjoint.plotting.planar import plot_mechanism
from rollingjoint.plotting.spatial import plot_arm
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
_LYING = (0.07, 0.5, 0.82, 0.48), (0.91, 0.5, 0.014, 0.46), (0.085, 0.11, 0.805, 0.26)  # chain, scale, force
_UPRIGHT = (0.06, 0.1, 0.42, 0.88), (0.5, 0.2, 0.014, 0.6), (0.65, 0.11, 0.33, 0.82)
_SLENDER = 2.0  # times as high as wide: a chain in space that lies in the picture
_STANDS: dict[str, Any] = {"elev": 14.0, "azim": -62.0}
_LIES: dict[str, Any] = {"elev": 20.0, "azim": 8.0, "vertical_axis": "x"}


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
    path: Sequence[Equilibrium | EquilibriumInSpace],
    inputs: Sequence[float] | Array,
    file: str | Path,
    label: str = "feed [mm]",
) -> Path:
    """The path of the file, after writing a GIF of a path among walls: the chain, forces of the walls, insertion force.

    Args:
        path: equilibria, each the history or the start of the next; at most 60 of them are shown.
        inputs: the input of each, such as the way by which the base is pushed in.
        file: a name that ends in .gif.
        label: the name of the input, with its unit.
    Raises:
        InvalidInput: another number of inputs, equilibria without surroundings, another suffix, no such folder.
    """
    if len(path) != len(inputs) or not path or any(eq.walls is None for eq in path):
        raise InvalidInput("path", f"{len(path)} equilibria", f"{len(inputs)} equilibria among walls, one per input")
    pictures = _Pictures(path, np.asarray(inputs, float), label)
    in_space = isinstance(path[0], EquilibriumInSpace)
    return save_gif(pictures.in_space() if in_space else pictures.in_plane(), gif_path(file))


class _Pictures:
    """Pictures of a path among walls; arguments of save_wall_film."""

    def __init__(self, path: Sequence[Any], inputs: Array, label: str) -> None:
        self.path, self.inputs, self.label = path, inputs, label
        self.figure, self.canvas = canvas_of(9.0, 5.0)
        self.colors = force_colors(path)
        self.forces = np.array([eq.insertion_force for eq in path])
        self.steps = np.unique(np.linspace(0, len(path) - 1, min(len(path), _MOST_FRAMES)).astype(int))

    def _draw_curve(self, scale: Any, axes: Any) -> Any:
        """The axes, with the insertion force over the way drawn; scale: axes of the scale of normal forces."""
        self.figure.colorbar(self.colors, cax=scale, label="normal force [N]")
        axes.plot(self.inputs, self.forces, color=PRESSED_COLOR, linewidth=1.4)
        axes.set(xlabel=self.label, ylabel="insertion force [N]")
        axes.grid(color="#E5E8EC", linewidth=0.6)
        return axes

    def _draw_place(self, curve: Any, step: int) -> Any:
        """The dot on the curve of one step."""
        return curve.plot(self.inputs[step], self.forces[step], "o", color=PRESSED_COLOR, markersize=7)

    def in_plane(self) -> Iterator[Pixels]:
        """Pictures of planar chains; moving parts are drawn on a constant background."""
        path, figure, canvas = self.path, self.figure, self.canvas
        everywhere = [in_world(eq) for eq in path]
        places = np.concatenate([eq.poses[:, :2] for eq in everywhere])
        margin = 2.4 * float(max(eq.walls.walls.bars[..., 5].max() for eq in path))
        low, high = places.min(axis=0) - margin, places.max(axis=0) + margin
        ax, *others = (
            figure.add_axes(place) for place in (_LYING if np.ptp([low, high], axis=0).argmax() == 0 else _UPRIGHT)
        )
        draw_surroundings(ax, everywhere, outline=False)
        ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", xlabel="x [mm]", ylabel="y [mm]")
        curve, scale = self._draw_curve(*others), wall_arrow_scale(path)
        canvas.draw()
        limits: dict[str, Any] = {"xlim": ax.get_xlim(), "ylim": ax.get_ylim()}
        background = canvas.copy_from_bbox(figure.bbox)
        for step in self.steps:
            canvas.restore_region(background)
            before = {*ax.get_children()}
            plot_mechanism(path[step], ax, walls=False, numbers=False, contacts=False, legend=False)
            draw_pressed(ax, path[step], scale, self.colors, scale=False)
            ax.set(**limits)
            moving = sorted({*ax.get_children()} - before, key=lambda artist: artist.get_zorder())
            for artist in [*moving, *self._draw_place(curve, step)]:
                figure.draw_artist(artist)
                artist.remove()
            yield pixels_of(canvas)

    def in_space(self) -> Iterator[Pixels]:
        """Pictures of chains in space, each drawn as a whole: what is in front depends on the pose."""
        path, figure = self.path, self.figure
        places = np.concatenate([space.in_world(eq).poses[:, :3, 3] for eq in path])
        margin = 1.2 * float(max(eq.walls.walls.bars[..., 7].max() for eq in path))
        low, high = places.min(axis=0) - margin, places.max(axis=0) + margin
        size = high - low
        lies = size[2] > _SLENDER * size[:2].max()
        others = (_LYING if lies else _UPRIGHT)[1:]
        square = (-0.02, -0.08, 0.92, 1.656) if lies else (-0.02, 0.0, 0.556, 1.0)
        ax: Any = figure.add_axes(square, projection="3d", computed_zorder=False)
        space.draw_surroundings_in_space(ax, path)
        ax.set_axis_off()
        length = nice_scale(np.ones(1), size[2])
        rule = low - [0.5 * margin, 0.0, 0.0] + np.outer([0.0, length], [0.0, 0.0, 1.0])
        ax.plot(*rule.T, color="black", linewidth=2.0)
        ax.text(*rule[1], f"  {length:g} mm", verticalalignment="center")
        curve, scale = self._draw_curve(*map(figure.add_axes, others)), space.arrow_scale_in_space(path)
        for step in self.steps:
            before = {*ax.get_children()}
            plot_arm(path[step], ax, walls=False, loads=False, contacts=False).get_legend().remove()
            space.draw_pressed_in_space(ax, path[step], scale, self.colors, scale=False)
            ax.set(**dict(zip(("xlim", "ylim", "zlim"), zip(low, high, strict=True), strict=True)))
            ax.view_init(**_LIES if lies else _STANDS)
            ax.set_box_aspect(size)
            dot = self._draw_place(curve, step)
            self.canvas.draw()
            yield pixels_of(self.canvas)
            for artist in {*ax.get_children()} - before | {*dot}:
                artist.remove()


def _coarse(picture: Pixels) -> Pixels:
    """The picture with 32 levels per colour, white and black exact, to save colours of the palette."""
    return np.bitwise_or(picture >> 3 << 3, picture >> 5, dtype=np.uint8)
