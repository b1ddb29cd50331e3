"""Surroundings in pictures: walls, lumens, obstacles, the outline of the links, and contacts coloured by their force.

Everything is drawn in the frame of the walls, in mm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rollingjoint.chain.equilibrium import Equilibrium
from rollingjoint.chain.outline import rotation, to_world
from rollingjoint.chain.solution import Solution
from rollingjoint.chain.wall_step import WallStep
from rollingjoint.errors import InvalidInput, naming_extras
from rollingjoint.load import pair_columns
from rollingjoint.plotting.parts import ORDER, ArrowStyle, draw_arrow, nice_scale, scale_text
from rollingjoint.surroundings.shapes import closed, outline_shapes, wall_strips

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

WALL_COLOR, PRESSED_COLOR = "#C9A78F", "#8C1D40"
_WALL: dict[str, Any] = {"facecolor": WALL_COLOR, "edgecolor": "#7D5A45", "linewidth": 1.0, "alpha": 0.55, "zorder": 1}
_SKIN: dict[str, Any] = {"color": "#5B6B82", "linewidth": 0.7, "zorder": ORDER["link"], "label": "outline"}
STICKS_COLOR = "#0072B2"
_FORCES, _STATES = "YlOrRd", "PuOr"  # colour maps
_ARROW = ArrowStyle(PRESSED_COLOR, 1.8, ORDER["load"])
_FORCE, _ANCHOR = pair_columns("f", "a")


def in_world(eq: Equilibrium) -> Equilibrium:
    """The equilibrium with poses, contacts and loads in the frame of its walls; unchanged without walls."""
    if eq.walls is None:
        return eq
    base = eq.walls.base
    poses, loads = eq.poses.copy(), eq.loads.copy()
    poses[:, :2], poses[:, 2] = to_world(base, poses[:, :2]), poses[:, 2] + base[2]
    loads[:, _FORCE], loads[:, _ANCHOR] = loads[:, _FORCE] @ rotation(base[2]).T, to_world(base, loads[:, _ANCHOR])
    tangents = eq.contact_tangents @ rotation(base[2]).T
    points = to_world(base, eq.contact_points)
    return replace(eq, poses=poses, loads=loads, contact_points=points, contact_tangents=tangents)


def draw_surroundings(ax: Axes, equilibria: Sequence[Equilibrium], outline: bool = True) -> None:
    """Draws the walls around equilibria in the world, each wall once, and the outlines with which links touch them."""
    around = [(eq, eq.walls) for eq in equilibria if eq.walls is not None]
    drawn: list[tuple[int, int]] = []
    places = np.concatenate([eq.poses[:, :2] for eq, _ in around])
    for eq, step in around:
        if (id(step.walls), int(step.which)) not in drawn:
            drawn.append((id(step.walls), int(step.which)))
            _draw_walls(ax, step, places)
        for link, strip in outline_shapes(step.walls, int(step.which)) if outline else ():
            ax.plot(*to_world(eq.poses[link], closed(strip)).T, **_SKIN)


def draw_pressed(
    ax: Axes,
    eq: Equilibrium,
    arrow_scale: float | None = None,
    colors: ScalarMappable | None = None,
    scale: bool = True,
) -> None:
    """Draws the contacts of one equilibrium with walls: a dot coloured by normal force, and the force on the link.

    A ring in place of a dot's edge means that the contact sticks.

    Args:
        ax: axes to draw on, in mm.
        eq: an equilibrium among walls.
        arrow_scale: mm of arrow per N; chosen from the largest force when None.
        colors: of normal forces; from 0 to the largest when None.
        scale: draw a scale of the colours below.
    """
    if eq.walls is None or not eq.wall_contacts:
        return
    contacts, places, forces = eq.wall_contacts, *places_and_forces(eq)
    arrow_scale = wall_arrow_scale([eq]) if arrow_scale is None else arrow_scale
    for place, force in zip(places, forces, strict=True):
        draw_arrow(ax, place, arrow_scale * force, eq.chain.length, _ARROW, f"wall force ({scale_text(arrow_scale)})")
    colors = force_colors([eq]) if colors is None else colors
    tones = colors.to_rgba(np.array([touch.force for touch in contacts]))
    edges = [STICKS_COLOR if touch.sticks else "black" for touch in contacts]
    x, y = places.T
    ax.scatter(x, y, s=34, c=tones, edgecolors=edges, linewidths=1.3, zorder=ORDER["load"] + 0.5)
    if STICKS_COLOR in edges:
        ax.plot([], [], "o", markerfacecolor="white", markeredgecolor=STICKS_COLOR, markeredgewidth=1.4, label="sticks")
    if scale:
        label = "normal force of walls [N]"
        ax.figure.colorbar(colors, ax=ax, location="bottom", shrink=0.7, pad=0.12, label=label)


def wall_arrow_scale(equilibria: Sequence[Equilibrium]) -> float:
    """mm of arrow per N for the largest force of any contact with a wall."""
    forces = [np.hypot(*places_and_forces(eq)[1].T) for eq in equilibria if eq.wall_contacts]
    return nice_scale(np.concatenate([*forces, np.zeros(1)]), max(eq.chain.length for eq in equilibria))


def places_and_forces(eq: Equilibrium) -> tuple[Array, Array]:
    """Place of every contact, and force on the link there, in the world, (C, 2) each [mm, N]."""
    assert eq.walls is not None
    contacts, base = eq.wall_contacts, eq.walls.base
    places, forces = (
        np.array([getattr(touch, name) for touch in contacts]).reshape(-1, 2) for name in ("place", "force_on_link")
    )
    return to_world(base, places), forces @ rotation(base[2]).T


def force_colors(equilibria: Sequence[Solution]) -> ScalarMappable:
    """Colours of normal forces, from 0 to the largest of all equilibria."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    forces = [touch.force for eq in equilibria for touch in eq.wall_contacts]
    return ScalarMappable(Normalize(0.0, max(forces, default=1.0)), _FORCES)


def _draw_walls(ax: Axes, step: WallStep, places: Array) -> None:
    """Draws all walls of one stack; half planes and straight ends of lumens as far as links are near, at `places`."""
    for strip in wall_strips(step.walls, int(step.which), places):
        ax.fill(*closed(strip).T, label="wall", **_WALL)


def plot_wall_contacts(path: Sequence[Solution], inputs: Sequence[float], label: str = "feed [mm]") -> Figure:
    """A figure of a path among walls: stick and slip of every contact, and the force that drives the base.

    Args:
        path: equilibria, each the history of the next.
        inputs: the input of each, such as the way by which the base is pushed in.
        label: the name of the input, with its unit.
    Raises:
        InvalidInput: another number of inputs, or equilibria without surroundings.
    """
    if len(path) != len(inputs) or not path or any(eq.walls is None for eq in path):
        raise InvalidInput("path", f"{len(path)} equilibria", f"{len(inputs)} equilibria among walls, one per input")
    with naming_extras():
        from matplotlib import pyplot
    figure, (top, bottom) = pyplot.subplots(
        2, 1, figsize=(7.2, 5.4), sharex=True, height_ratios=(3, 2), layout="constrained"
    )
    touches = [(step, touch) for step, eq in enumerate(path) for touch in eq.wall_contacts]
    steps = np.array([step for step, _ in touches], int)
    columns = [(touch.link, touch.force, touch.state, touch.sticks) for _, touch in touches]
    links, forces, states, sticks = np.array(columns, float).reshape(-1, 4).T
    sizes = 6.0 + 60.0 * forces / max(forces.max(initial=0.0), 1e-12)
    image = top.scatter(
        steps, links, s=sizes, c=states, cmap=_STATES, vmin=-1, vmax=1, linewidths=0.3, edgecolors="grey"
    )
    held = sticks > 0.0
    top.plot(steps[held], links[held], "o", markersize=2.2, color=STICKS_COLOR, label="sticks")
    count = path[0].mechanism.n_links
    top.set(ylabel="link", yticks=range(1, count), ylim=(0.5, count - 0.5))
    if held.any():
        top.legend(loc="lower left")
    figure.colorbar(image, ax=top, label="state: ±1 slips", ticks=(-1, 0, 1))
    bottom.plot([eq.insertion_force for eq in path], color=PRESSED_COLOR, linewidth=1.6)
    bottom.set(xlabel="step", ylabel="insertion force [N]")
    other = bottom.twinx()
    other.plot(np.asarray(inputs, float), color="#5B6B82", linewidth=1.0, linestyle="--")
    other.set_ylabel(label)
    for ax in (top, bottom):
        ax.grid(color="#E5E8EC", linewidth=0.6)
        ax.set_axisbelow(True)
    return figure
