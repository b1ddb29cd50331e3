"""Parts of pictures of planar chains: links, tendons, contact forces, loads.

Each function draws on given axes, in mm; rollingjoint.plotting.planar combines them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rollingjoint.chain.equilibrium import Equilibrium
from rollingjoint.chain.outline import link_outline, right_side, rotation, to_world
from rollingjoint.chain.rolling import Link, RollingChain
from rollingjoint.load import LOAD_COLUMNS, pair_columns

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

PALETTE = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#000000", "#F0E442")
"""Colours that people with colour blindness tell apart, in the order of use."""
LINK_COLOR, LOAD_COLOR, CONTACT_COLOR, LIMIT_COLOR = "#7A8699", "#D55E00", "#222222", "#B2182B"


class ArrowStyle(NamedTuple):
    """Colour, line width [points] and drawing order of one kind of arrow."""

    color: str
    width: float
    zorder: int


BASE_ALPHA, LINK_ALPHA = 0.55, 0.25
_ARROW_SHARE = 0.22  # longest arrow, as a share of the mechanism's length
_SLACK = 1e-9  # N
ORDER = {"link": 2, "tendon": 3, "contact": 5, "load": 6}
_CONTACT_ARROW = ArrowStyle(CONTACT_COLOR, 1.1, ORDER["contact"])
_LOAD_ARROW = ArrowStyle(LOAD_COLOR, 2.0, ORDER["load"])
_LINK, _MOMENT, _SPRING = (LOAD_COLUMNS.index(name) for name in ("link", "moment", "k"))
_POINT, _FORCE, _BODY, _ANCHOR = pair_columns("p", "f", "b", "a")


def draw_links(ax: Axes, chain: RollingChain, poses: Array, color: str, label: str | None, base: bool = True) -> None:
    """Draws the links at their poses, the base darker, with one label for all."""
    if base:
        draw_link(ax, chain.links[0], poses[0], color, BASE_ALPHA)
    for i in range(1, chain.n_links):
        draw_link(ax, chain.links[i], poses[i], color, LINK_ALPHA, label if i == 1 else None)


def draw_link(ax: Axes, link: Link, pose: Array, color: str, alpha: float, label: str | None = None) -> None:
    """Draws one link as a filled body."""
    from matplotlib.colors import to_rgba

    outline = to_world(pose, link_outline(link))
    style: dict[str, Any] = {"facecolor": to_rgba(color, alpha), "edgecolor": color, "linewidth": 1.2}
    ax.fill(*outline.T, zorder=ORDER["link"], label=label, **style)


def number_links(ax: Axes, chain: RollingChain, poses: Array) -> None:
    """Draws the index of every link to its right."""
    style: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": 8, "color": "#4A5260"}
    for i, (link, pose) in enumerate(zip(chain.links, poses, strict=True)):
        point = to_world(pose, np.array([right_side(link) + 0.025 * chain.length, 0.0]))
        ax.text(point[0], point[1], str(i), zorder=ORDER["tendon"], **style)
        ax.update_datalim([point])


def draw_tendons(ax: Axes, chain: RollingChain, poses: Array, tensions: Array | None) -> None:
    """Draws the tendons through their holes, with tensions in the legend; slack tendons are dashed."""
    for j, line in enumerate(chain.tendon_polyline(poses)):
        slack = tensions is not None and tensions[j] <= _SLACK
        force = "" if tensions is None else ", slack" if slack else f", {tensions[j]:.3g} N"
        style: dict[str, Any] = {"linestyle": "--" if slack else "-", "color": PALETTE[j % len(PALETTE)]}
        ax.plot(*line.T, linewidth=1.6, zorder=ORDER["tendon"], label=f"tendon {j}{force}", **style)
        ax.plot(*line.T, ".", markersize=4, color=style["color"], zorder=ORDER["tendon"])


def draw_contacts(ax: Axes, eq: Equilibrium, scale: float | None) -> None:
    """Draws contact forces on the distal links at `scale` mm per N, and a ring where a surface ends."""
    forces = contact_forces_world(eq)
    scale = nice_scale(np.linalg.norm(forces, axis=1), eq.chain.length) if scale is None else scale
    label = f"contact force ({scale_text(scale)})"
    for point, force in zip(eq.contact_points, forces, strict=True):
        draw_arrow(ax, point, scale * force, eq.chain.length, _CONTACT_ARROW, label)
    ended = ~eq.free_joints
    if ended.any():
        style: dict[str, Any] = {"markersize": 11, "markeredgewidth": 1.8, "markerfacecolor": "none"}
        points = eq.contact_points[ended].T
        ax.plot(*points, "o", color=LIMIT_COLOR, zorder=ORDER["load"], label="contact at surface end", **style)


def contact_forces_world(eq: Equilibrium) -> Array:
    """Contact force on the distal link of every joint, world frame, (n - 1, 2) [N]."""
    angles = [
        pose[2] + link.child.tangent_angle(s)
        for link, pose, s in zip(eq.chain.links, eq.poses, eq.arc_lengths, strict=False)
    ]
    return np.array([rotation(angle) @ force for angle, force in zip(angles, eq.contact_forces, strict=True)])


def draw_loads(ax: Axes, eq: Equilibrium, scale: float | None) -> None:
    """Draws every row of the load table: force at `scale` mm per N, moment as an arc, spring as a zigzag."""
    scale = arrow_scale([eq]) if scale is None else scale
    size, label = 0.06 * eq.chain.length, f"external force ({scale_text(scale)})"
    for row in eq.loads:
        pose, moment, stiffness = eq.poses[int(row[_LINK])], row[_MOMENT], row[_SPRING]
        point = to_world(pose, row[_POINT])
        force = row[_FORCE] + rotation(pose[2]) @ row[_BODY]
        draw_arrow(ax, point, scale * force, eq.chain.length, _LOAD_ARROW, label)
        if moment:
            _moment(ax, point, np.sign(moment) * size, f"external moment {moment:.3g} N·mm")
        if stiffness:
            _spring(ax, point, row[_ANCHOR], size, f"spring {stiffness:.3g} N/mm")


def arrow_scale(equilibria: Sequence[Equilibrium]) -> float:
    """mm of arrow per N for the largest force in any load table."""
    rows = np.concatenate([eq.loads for eq in equilibria])
    forces = np.linalg.norm(rows[:, _FORCE], axis=1) + np.linalg.norm(rows[:, _BODY], axis=1)
    return nice_scale(forces, max(eq.chain.length for eq in equilibria))


def nice_scale(forces: Array, length: float) -> float:
    """1, 2 or 5 times a power of ten, with the largest force at most the longest arrow [mm per N]."""
    largest = float(np.max(forces[np.isfinite(forces)], initial=0.0))
    if largest <= 0.0:
        return 1.0
    limit = _ARROW_SHARE * length / largest
    power = 10.0 ** np.floor(np.log10(limit))
    return float(power * max(step for step in (1, 2, 5) if step * power <= limit * (1 + 1e-9)))


def scale_text(scale: float) -> str:
    """The scale of arrows, for the legend."""
    return f"{scale:g} mm per N"


def draw_arrow(ax: Axes, tail: Array, vector: Array, length: float, style: ArrowStyle, label: str) -> None:
    """Draws an arrow on a mechanism of a length; none for a vector that is negligible or infinite."""
    share = np.hypot(*vector) / length
    if not 1e-6 < share < np.inf:
        return
    tip = tail + vector
    ax.annotate(
        "",
        tuple(tip),
        tuple(tail),
        arrowprops={
            "arrowstyle": "-|>",
            "color": style.color,
            "linewidth": style.width,
            "shrinkA": 0,
            "shrinkB": 0,
            "mutation_scale": float(np.clip(110 * share, 4, 11)),
        },
        zorder=style.zorder,
    )
    ax.update_datalim([tail, tip])
    ax.plot([], [], color=style.color, linewidth=style.width, marker=">", markersize=5, label=label)


def _moment(ax: Axes, centre: Array, radius: float, label: str) -> None:
    """Draws three quarters of a circle with a head; a positive radius turns counter-clockwise."""
    turn = np.sign(radius) * np.linspace(-0.75 * np.pi, 0.75 * np.pi, 40)
    arc = centre + abs(radius) * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    ax.plot(*arc.T, color=LOAD_COLOR, linewidth=2.0, zorder=ORDER["load"], label=label)
    draw_arrow(ax, arc[-4], arc[-1] - arc[-4], 5 * abs(radius), _LOAD_ARROW, "_")


def _spring(ax: Axes, point: Array, anchor: Array, size: float, label: str) -> None:
    """Draws a zigzag from the point to the anchor, a square."""
    span = anchor - point
    length = float(np.hypot(*span))
    if length > 0:
        normal = np.array([-span[1], span[0]]) / length
        turns = int(np.clip(length / (0.3 * size), 6, 60))
        along = np.concatenate([[0.0], np.linspace(0.15, 0.85, turns + 2), [1.0]])
        across = np.concatenate([[0.0, 0.0], np.resize([1.0, -1.0], turns), [0.0, 0.0]])
        zigzag = point + along[:, None] * span + 0.25 * size * across[:, None] * normal
        ax.plot(*zigzag.T, color=LOAD_COLOR, linewidth=1.2, zorder=ORDER["load"], label=label)
    ax.plot(*anchor, "s", color=LOAD_COLOR, markersize=6, zorder=ORDER["load"])
