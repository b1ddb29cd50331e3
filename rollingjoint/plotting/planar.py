"""Pictures of planar chains and their equilibria; matplotlib is imported only when one is drawn.

Lengths are in mm on both axes. Forces are arrows with their scale (mm per N) in the legend.
Colours are the Okabe-Ito palette, which colour-blind readers can tell apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rollingjoint.chain.equilibrium import Equilibrium
from rollingjoint.chain.rolling import RollingChain, planar
from rollingjoint.errors import InvalidInput, naming_extras
from rollingjoint.plotting.friction import draw_gap_tensions
from rollingjoint.plotting.parts import (
    BASE_ALPHA,
    LINK_COLOR,
    ORDER,
    PALETTE,
    arrow_scale,
    draw_contacts,
    draw_link,
    draw_links,
    draw_loads,
    draw_tendons,
    number_links,
)
from rollingjoint.plotting.walls import draw_pressed, draw_surroundings, force_colors, in_world, wall_arrow_scale

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]


def plot_mechanism(
    mechanism: RollingChain | Equilibrium,
    ax: Axes | None = None,
    *,
    tendons: bool = True,
    loads: bool = True,
    contacts: bool = True,
    numbers: bool = True,
    label: str | None = None,
    color: str = LINK_COLOR,
    load_scale: float | None = None,
    contact_scale: float | None = None,
    tension_range: tuple[float, float] | None = None,
    walls: bool = True,
    wall_scale: float | None = None,
    legend: bool = True,
) -> Axes:
    """Axes with links, tendons, loads and contact forces drawn, and walls with the forces on links that press on them.

    Among walls everything is in their frame, where the base may be anywhere.
    After a step with friction the gaps are coloured by their tension, and rings mark holes in which a tendon sticks.

    Args:
        mechanism: an equilibrium, or a mechanism, drawn at s = 0 without forces.
        ax: axes to draw on; new ones when None.
        tendons: draw the tendons; a slack one is dashed.
        loads: draw forces, moments and springs.
        contacts: draw contact forces, and mark contacts at the end of a surface.
        numbers: label every link with its index.
        label: legend text of the links.
        color: colour of the links.
        load_scale, contact_scale: mm of arrow per N; chosen from the largest force when None.
        tension_range: with friction, tensions at both ends of the colours [N]; taken from the equilibrium when None.
        walls: draw the walls around an equilibrium, the outline of its links, and where they press on walls.
        wall_scale: mm of arrow per N of wall force; chosen from the largest force when None.
        legend: put a legend to the right of the axes, and with friction a scale of the colours below.
    Raises:
        InvalidInput: a batch of equilibria, or no planar chain.
    """
    equilibrium = mechanism if isinstance(mechanism, Equilibrium) else None
    chain = _planar(mechanism)
    poses = chain.poses(chain.neutral_angles) if equilibrium is None else equilibrium.poses
    if poses.ndim != 2:
        raise InvalidInput("equilibrium", poses.shape, "one equilibrium, poses (n, 3)", "Solve a single row.")
    ax = _new_axes() if ax is None else ax
    if equilibrium is not None and equilibrium.walls is not None:
        equilibrium = in_world(equilibrium)
        poses = equilibrium.poses
        if walls:
            draw_surroundings(ax, [equilibrium])
            draw_pressed(ax, equilibrium, wall_scale, scale=legend)
    draw_links(ax, chain, poses, color, label)
    if numbers:
        number_links(ax, chain, poses)
    if tendons and equilibrium is not None and equilibrium.friction is not None:
        draw_gap_tensions(ax, equilibrium, tension_range, scale=legend)
    elif tendons:
        draw_tendons(ax, chain, poses, None if equilibrium is None else equilibrium.tensions)
    if equilibrium is not None and contacts:
        draw_contacts(ax, equilibrium, contact_scale)
    if equilibrium is not None and loads:
        draw_loads(ax, equilibrium, load_scale)
    return _finish(ax, legend)


def plot_family(
    equilibria: Sequence[Equilibrium],
    labels: Sequence[str],
    ax: Axes | None = None,
    *,
    tendons: bool = False,
    loads: bool = True,
    walls: bool = True,
    colors: Sequence[str] | None = None,
    legend: bool = True,
) -> Axes:
    """Axes with several equilibria over one another, one colour each, their load arrows on one scale.

    Among walls everything is in their frame, so that equilibria with different bases show how a chain is pushed in.

    Args:
        equilibria: to draw, the first at the back.
        labels: legend text of each.
        ax: axes to draw on; new ones when None.
        tendons, loads: draw them too.
        walls: draw the walls around equilibria, and where links press on them.
        colors: one per equilibrium; the palette when None, repeated if there are more than it holds.
        legend: put a legend to the right of the axes.
    Raises:
        InvalidInput: no equilibria, or another number of labels or colours.
    """
    if not equilibria:
        raise InvalidInput("equilibria", list(equilibria), "one or more equilibria")
    colors = [PALETTE[i % len(PALETTE)] for i in range(len(equilibria))] if colors is None else colors
    for name, values in (("labels", labels), ("colors", colors)):
        if len(values) != len(equilibria):
            raise InvalidInput(name, list(values), f"{len(equilibria)} entries, one per equilibrium")
    chains = [_planar(eq) for eq in equilibria]
    ax = _new_axes() if ax is None else ax
    equilibria = [in_world(eq) for eq in equilibria]
    scale = arrow_scale(equilibria)
    touching = [eq for eq in equilibria if eq.walls is not None] if walls else []
    if touching:
        draw_surroundings(ax, touching, outline=False)
        forces, tones = wall_arrow_scale(touching), force_colors(touching)
        for i, eq in enumerate(touching):
            draw_pressed(ax, eq, forces, tones, scale=legend and i == len(touching) - 1)
    drawn: list[tuple[RollingChain, Array]] = []
    for eq, chain, label, color in zip(equilibria, chains, labels, colors, strict=True):
        draw_links(ax, chain, eq.poses, color, label, base=False)
        if not any(chain is base and np.array_equal(pose, eq.poses[0]) for base, pose in drawn):
            draw_link(ax, chain.links[0], eq.poses[0], LINK_COLOR, BASE_ALPHA)
            drawn.append((chain, eq.poses[0]))
        if tendons:
            for line in chain.tendon_polyline(eq.poses):
                ax.plot(*line.T, color=color, linewidth=1.2, zorder=ORDER["tendon"])
        if loads:
            draw_loads(ax, eq, scale)
    return _finish(ax, legend)


def _planar(mechanism: RollingChain | Equilibrium) -> RollingChain:
    return mechanism.chain if isinstance(mechanism, Equilibrium) else planar(mechanism, "plot_arm draws arms of beads.")


def _new_axes() -> Axes:
    with naming_extras():
        from matplotlib import pyplot

    return pyplot.subplots(figsize=(6.4, 6.4), layout="constrained")[1]


def _finish(ax: Axes, legend: bool) -> Axes:
    ax.set_aspect("equal")
    ax.margins(0.06)
    ax.autoscale_view()
    ax.set(xlabel="x [mm]", ylabel="y [mm]")
    ax.grid(color="#E5E8EC", linewidth=0.6)
    ax.set_axisbelow(True)
    if legend:
        _legend(ax)
    return ax


def _legend(ax: Axes) -> None:
    """Each label once, link bodies first, to the right of the axes."""
    from matplotlib.patches import Patch

    unique = {text: handle for handle, text in zip(*ax.get_legend_handles_labels(), strict=True)}
    ordered = sorted(unique, key=lambda text: not isinstance(unique[text], Patch))
    if ordered:
        handles = [unique[text] for text in ordered]
        ax.legend(handles, ordered, loc="upper left", bbox_to_anchor=(1.02, 1.0), borderaxespad=0.0)
