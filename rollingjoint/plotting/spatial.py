"""Pictures of chains in three dimensions; matplotlib is imported only when one is drawn.

Lengths are in mm on all axes. Beads, and links between their holes, are tubes around these; contact surfaces have the
width of their lines. Tendons are coloured by their tension, contact lines by their tilting margin.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rollingjoint.chain.equilibrium import EquilibriumInSpace
from rollingjoint.chain.hinge import HingeChain
from rollingjoint.chain.spatial import SpatialChain
from rollingjoint.chain.spatial_equilibrium import FRICTION, SpatialEquilibrium
from rollingjoint.errors import InvalidInput, naming_extras
from rollingjoint.load import SPATIAL_LOAD_COLUMNS
from rollingjoint.plotting.contact_lines import ABOVE_BODIES, draw_contacts, draw_holding, draw_surfaces
from rollingjoint.plotting.friction import STICKS, piece_tensions, tension_colors
from rollingjoint.plotting.parts import LINK_COLOR, PALETTE
from rollingjoint.plotting.walls_in_space import draw_pressed_in_space, draw_surroundings_in_space, in_world

if TYPE_CHECKING:
    from mpl_toolkits.mplot3d import Axes3D

Array = NDArray[np.float64]

_SIDES = 16  # of a bead
_SLACK = 1e-9  # N
_SLIMMEST = 0.5  # width of the axes, in heights: tick labels of narrower ones overlap
_FX, _SPRING = (SPATIAL_LOAD_COLUMNS.index(name) for name in ("fx", "k"))
_FORCE, _ANCHOR = slice(_FX, _FX + 3), slice(_SPRING + 1, _SPRING + 4)


def plot_arm(
    arm: HingeChain | SpatialChain | EquilibriumInSpace,
    ax: Axes3D | None = None,
    *,
    tendons: bool = True,
    loads: bool = True,
    contacts: bool = True,
    walls: bool = True,
    friction: float = FRICTION,
    label: str | None = None,
    color: str = LINK_COLOR,
    tension_range: tuple[float, float] | None = None,
) -> Axes3D:
    """Axes with beads or links, tendons, forces and contact lines drawn; draw several arms by passing the axes on.

    A contact line is green where the less pressed of its ends carries a quarter of the normal force or more, orange
    where it carries less, red where it would lift; a dot marks the centre of pressure. Arrows are forces on the upper
    link, of teeth where friction does not suffice, and of straps where an end would lift. After a step with friction
    the gaps are coloured by their tension, and rings mark holes in which a tendon sticks.

    Args:
        arm: an equilibrium, or a mechanism, which is drawn at rest.
        ax: 3-D axes to draw on; new ones when None.
        tendons: draw the tendons; dashed if slack, thin if of unknown tension.
        loads: draw the dead forces that are not weights of beads, as arrows, and springs, as dotted lines.
        contacts: draw the contact lines of an equilibrium with rolling contacts, coloured by their tilting margin.
        walls: draw the walls around an equilibrium, and where it presses on them; everything is in their frame then.
        friction: coefficient of the contact lines, beside which teeth carry a force.
        label: legend text of the beads or links.
        color: their colour.
        tension_range: with friction, tensions at both ends of the colours [N]; taken from the equilibrium when None.
    Raises:
        InvalidInput: a batch of equilibria, a coefficient that is none.
    """
    equilibrium = arm if isinstance(arm, EquilibriumInSpace) else None
    chain = equilibrium.mechanism if equilibrium is not None else arm
    if not isinstance(chain, HingeChain | SpatialChain) or (equilibrium is not None and equilibrium.poses.ndim != 3):
        raise InvalidInput(
            "arm", arm, "a chain in space, or one HingeEquilibrium or SpatialEquilibrium", "Solve a single row."
        )
    around, equilibrium = equilibrium, None if equilibrium is None else in_world(equilibrium)
    poses = chain.poses(chain.neutral_angles) if equilibrium is None else equilibrium.poses
    ax = _new_axes() if ax is None else ax
    _draw_tubes(ax, chain, poses, color, label)
    if isinstance(chain, SpatialChain):
        draw_surfaces(ax, chain, poses, color)
    if tendons and equilibrium is not None and equilibrium.friction is not None:
        _draw_gap_tensions(ax, chain, equilibrium, tension_range)
    elif tendons:
        _draw_tendons(ax, chain, poses, None if equilibrium is None else equilibrium.tensions)
    if equilibrium is not None and loads:
        _draw_forces(ax, chain, equilibrium)
        _draw_springs(ax, equilibrium)
    if contacts and isinstance(chain, SpatialChain) and isinstance(equilibrium, SpatialEquilibrium):
        draw_contacts(ax, equilibrium)
        draw_holding(ax, equilibrium, friction)
    if walls and around is not None and around.walls is not None:
        draw_surroundings_in_space(ax, [around])
        draw_pressed_in_space(ax, around)
    return _finish(ax)


def _new_axes() -> Axes3D:
    with naming_extras():
        from matplotlib import pyplot

    figure = pyplot.figure(figsize=(6.4, 6.4), layout="constrained")
    return figure.add_subplot(projection="3d")


def _draw_tubes(ax: Axes3D, chain: HingeChain | SpatialChain, poses: Array, color: str, label: str | None) -> None:
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    around = np.linspace(0.0, 2 * np.pi, _SIDES + 1)
    radius = 1.15 * max(chain.hole_radius, 0.1 * chain.length / chain.n_joints)
    rim = radius * np.array([np.cos(around), np.sin(around), 0 * around])
    faces: list[Array] = []
    bodies = list(enumerate(chain.body_ends.tolist(), start=1))
    if isinstance(chain, SpatialChain):
        base = chain.outlines()[0]
        bodies.append((0, [base.low, base.high]))
    for k, ends in bodies:
        low, high = ((poses[k, :3, :3] @ (rim + np.array([[0.0], [0.0], [z]]))).T + poses[k, :3, 3] for z in ends)
        faces += [np.array([low[i], low[i + 1], high[i + 1], high[i]]) for i in range(_SIDES)]
    ax.add_collection3d(Poly3DCollection(faces, facecolor=color, edgecolor="none", alpha=0.25, label=label))
    ax.plot(*poses[:, :3, 3].T, color=color, linewidth=1.5)
    ax.auto_scale_xyz(*np.concatenate(faces).T, had_data=ax.has_data())


def _draw_tendons(ax: Axes3D, chain: HingeChain | SpatialChain, poses: Array, tensions: Array | None) -> None:
    largest = max(float(np.max(tensions)), _SLACK) if tensions is not None else 1.0
    for j, line in enumerate(chain.tendon_polyline(poses)):
        tension = 0.0 if tensions is None else float(tensions[j])
        style = "--" if tensions is not None and tension <= _SLACK else "-"
        width = 0.8 + 1.8 * tension / largest
        name = f"tendon {j}: {tension:.3g} N" if tension > _SLACK else None
        ax.plot(*line.T, style, color=PALETTE[j % len(PALETTE)], linewidth=width, label=name, zorder=ABOVE_BODIES)


def _draw_gap_tensions(
    ax: Axes3D, chain: HingeChain | SpatialChain, equilibrium: EquilibriumInSpace, ends: tuple[float, float] | None
) -> None:
    from mpl_toolkits.mplot3d.art3d import Line3DCollection

    colors = tension_colors(equilibrium, ends)
    for j, line in enumerate(chain.tendon_polyline(equilibrium.poses)):
        holes = line[(len(line) + 1) % 2 :]  # from the hole below the first gap
        tones = colors.to_rgba(piece_tensions(equilibrium, j)[1:])  # the tendon is drawn from the hole below gap 0
        pieces = list(np.stack([holes[:-1], holes[1:]], axis=1))
        ax.add_collection3d(Line3DCollection(pieces, colors=tones, linewidths=2.0))
        links = np.arange(1, len(holes) - 1) // 2  # of the holes below the last link's
        sticking = holes[:-2][equilibrium.sticking[links, j]]
        if len(sticking):
            ax.plot(*sticking.T, **{**STICKS, "markersize": 4})
    ax.figure.colorbar(colors, ax=ax, shrink=0.5, pad=0.12, label="tension [N]")


def _draw_forces(ax: Axes3D, chain: HingeChain | SpatialChain, equilibrium: EquilibriumInSpace) -> None:
    """Draws arrows of the dead forces, except at mass centres: weights would hide the arm."""
    rows = equilibrium.loads[np.linalg.norm(equilibrium.loads[:, _FORCE], axis=1) > 0]
    weights = chain.own_weight((0.0, 0.0, 1.0))
    centres = np.full((chain.n_links, 3), np.nan) if weights is None else np.array(weights.points)
    rows = np.array([row for row in rows if not np.allclose(row[1:4], centres[int(row[0])])]).reshape(-1, rows.shape[1])
    scale = 0.2 * chain.length / max(np.linalg.norm(rows[:, _FORCE], axis=1), default=1.0)
    for row in rows:
        T = equilibrium.poses[int(row[0])]
        at = T[:3, :3] @ row[1:4] + T[:3, 3]
        size = float(np.linalg.norm(row[_FORCE]))
        ax.quiver(*at, *(scale * row[_FORCE]), color="black", linewidth=1.5, label=f"{size:.3g} N")


def _draw_springs(ax: Axes3D, equilibrium: EquilibriumInSpace) -> None:
    for row in equilibrium.loads[equilibrium.loads[:, _SPRING] > 0]:
        T = equilibrium.poses[int(row[0])]
        ends = np.array([T[:3, :3] @ row[1:4] + T[:3, 3], row[_ANCHOR]])
        ax.plot(*ends.T, ":", color="black", linewidth=1.5, label=f"spring {row[_SPRING]:.3g} N/mm")


def _finish(ax: Axes3D) -> Axes3D:
    from matplotlib.ticker import MaxNLocator

    ax.set(xlabel="x [mm]", ylabel="y [mm]", zlabel="z [mm]")
    ax.patch.set_visible(False)  # else it hides labels of axes to its left
    height = float(np.diff(ax.get_zlim())[0])
    for low, high, set_limits in ((*ax.get_xlim(), ax.set_xlim), (*ax.get_ylim(), ax.set_ylim)):
        middle, half = 0.5 * (low + high), 0.5 * max(high - low, _SLIMMEST * height)
        set_limits(middle - half, middle + half)
    ax.set_aspect("equal")
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_locator(MaxNLocator(3))
    ax.zaxis.set_major_locator(MaxNLocator(6))
    ax.zaxis.labelpad = 12
    unique = {text: handle for handle, text in zip(*ax.get_legend_handles_labels(), strict=True)}
    if unique:
        ax.legend(unique.values(), unique.keys(), loc="upper left", fontsize="small")
    return ax
