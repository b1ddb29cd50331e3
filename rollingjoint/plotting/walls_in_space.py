"""Walls around chains in space in pictures: planes, capsules and tubes as surfaces, contacts coloured by their force.

Everything is drawn in the frame of the walls, in mm.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rollingjoint.chain import se3
from rollingjoint.chain.equilibrium import EquilibriumInSpace
from rollingjoint.kernels.spatial_walls import SpatialWalls
from rollingjoint.kernels.walls import STIFFNESS
from rollingjoint.load import SPATIAL_LOAD_COLUMNS
from rollingjoint.plotting.parts import nice_scale, scale_text
from rollingjoint.plotting.walls import PRESSED_COLOR, STICKS_COLOR, WALL_COLOR, force_colors
from rollingjoint.surroundings.tube import Frames, Tube, carried

if TYPE_CHECKING:
    from matplotlib.cm import ScalarMappable
    from mpl_toolkits.mplot3d import Axes3D

Array = NDArray[np.float64]

_AROUND, _ALONG = 25, 2.0  # points around a surface; mm from ring to ring of a tube
_ALPHA = 0.18
_FORCE_AND_ANCHOR = SPATIAL_LOAD_COLUMNS.index("fx"), SPATIAL_LOAD_COLUMNS.index("ax")


def in_world(equilibrium: Any) -> Any:
    """The equilibrium with poses and loads in the frame of its walls; unchanged without walls."""
    if equilibrium.walls is None:
        return equilibrium
    base, loads = base_pose(equilibrium), equilibrium.loads.copy()
    first, anchor = (slice(columns, columns + 3) for columns in _FORCE_AND_ANCHOR)
    loads[:, first] = loads[:, first] @ base[:3, :3].T
    loads[:, anchor] = loads[:, anchor] @ base[:3, :3].T + base[:3, 3]
    changes = {"poses": base @ equilibrium.poses, "loads": loads}
    if hasattr(equilibrium, "contact_points"):
        changes["contact_points"] = equilibrium.contact_points @ base[:3, :3].T + base[:3, 3]
    return replace(equilibrium, **changes)


def base_pose(equilibrium: EquilibriumInSpace) -> Array:
    """The frame of the base among the walls, (4, 4) [mm]."""
    assert equilibrium.walls is not None
    base = equilibrium.walls.base
    return np.asarray(se3.pose(se3.rotation(base[3:]), base[:3]), float)


def draw_surroundings_in_space(ax: Axes3D, equilibria: Sequence[EquilibriumInSpace]) -> None:
    """Draws the walls around equilibria in the world, each wall once."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    around = [(eq, eq.walls) for eq in equilibria if eq.walls is not None]
    places = np.concatenate([(base_pose(eq) @ eq.poses)[:, :3, 3] for eq, _ in around])
    stacks = {(id(step.walls), int(step.which)): step.walls for _, step in around}
    for (_, which), walls in stacks.items():
        for surface in wall_surfaces(walls, which, places):
            grid = np.stack([surface[:-1, :-1], surface[1:, :-1], surface[1:, 1:], surface[:-1, 1:]], axis=2)
            faces = Poly3DCollection(
                list(grid.reshape(-1, 4, 3)), facecolor=WALL_COLOR, edgecolor="none", alpha=_ALPHA, label="wall"
            )
            ax.add_collection3d(faces)
            ax.auto_scale_xyz(*surface.reshape(-1, 3).T, had_data=ax.has_data())


def draw_pressed_in_space(
    ax: Axes3D,
    equilibrium: EquilibriumInSpace,
    arrow_scale: float | None = None,
    colors: ScalarMappable | None = None,
    scale: bool = True,
) -> None:
    """As walls.draw_pressed, of a chain in space."""
    contacts = equilibrium.wall_contacts if equilibrium.walls is not None else []
    if not contacts:
        return
    points, forces = places_and_forces_in_space(equilibrium)
    per_newton = arrow_scale_in_space([equilibrium]) if arrow_scale is None else arrow_scale
    colors = force_colors([equilibrium]) if colors is None else colors
    tones = colors.to_rgba(np.array([touch.force for touch in contacts]))
    edges = [STICKS_COLOR if touch.sticks else "black" for touch in contacts]
    ax.scatter(*points.T, s=28, c=tones, edgecolors=edges, linewidths=1.2, depthshade=False, zorder=10)
    label = f"wall force ({scale_text(per_newton)})"
    ax.quiver(*points.T, *(per_newton * forces).T, color=PRESSED_COLOR, linewidth=1.6, label=label, zorder=9)
    if STICKS_COLOR in edges:
        ax.plot([], [], [], "o", markerfacecolor="white", markeredgecolor=STICKS_COLOR, label="sticks")
    if scale:
        ax.figure.colorbar(colors, ax=ax, shrink=0.5, pad=0.12, label="normal force of walls [N]")


def arrow_scale_in_space(equilibria: Sequence[EquilibriumInSpace]) -> float:
    """mm of arrow per N for the largest force of any contact with a wall."""
    forces = [np.linalg.norm(places_and_forces_in_space(eq)[1], axis=1) for eq in equilibria if eq.wall_contacts]
    return nice_scale(np.concatenate([*forces, np.zeros(1)]), max(eq.mechanism.length for eq in equilibria))


def places_and_forces_in_space(equilibrium: EquilibriumInSpace) -> tuple[Array, Array]:
    """Place of every contact, and force on the link there, in the world, (C, 3) each [mm, N]."""
    base = base_pose(equilibrium)
    places, forces = (
        np.array([getattr(touch, name) for touch in equilibrium.wall_contacts]).reshape(-1, 3) @ base[:3, :3].T
        for name in ("place", "force_on_link")
    )
    return places + base[:3, 3], forces


def wall_surfaces(walls: SpatialWalls, which: int, places: Array) -> Iterator[Array]:
    """Grids of points, (k, l, 3), on all walls of one stack; planes and ends of tubes as far as places are near.

    Args:
        walls, which: the stack, and the index of the surroundings in it.
        places: of the links in the world, (k, 3) [mm].
    """
    centre = 0.5 * (places.min(axis=0) + places.max(axis=0))
    reach = 0.6 * float(np.ptp(places, axis=0).max()) + 2.0 * float(walls.bars[which, :, 7].max())
    for row in walls.planes[which]:
        if row[4 + STIFFNESS] > 0.0:
            normal = row[:3]
            first, second = _across(normal)
            corner = centre - (normal @ centre - row[3]) * normal
            sides = np.linspace(-reach, reach, 2)
            yield corner + sides[:, None, None] * first + sides[None, :, None] * second
    for row in walls.capsules[which]:
        if row[7 + STIFFNESS] > 0.0:
            yield _capsule(row[:3], row[3:6], max(float(row[6]), 0.005 * reach))
    for tube in wall_tubes(walls, which):
        yield _tube(tube, places, reach)


def wall_tubes(walls: SpatialWalls, which: int) -> list[Tube]:
    """The tubes of one stack."""
    tubes = []
    for number in range(walls.tubes.shape[1]):
        rows = walls.pieces[which]
        rows = rows[(rows[:, 13] == number) & (rows[:, 10] > 0.0)]
        if len(rows):
            first: Any = tuple(rows[0, :3].tolist()), tuple(rows[0, 3:6].tolist())
            straight = Tube([1.0], [0.0], [0.0], 1.0, *first).frames
            frames, angles = Frames(*(part[:1] for part in straight)), []
            for row in rows:
                (tangent,), (sideways,) = frames.tangents, frames.sideways
                angles.append(float(np.arctan2(row[6:9] @ np.cross(tangent, sideways), row[6:9] @ sideways)))
                frames = carried(frames, row[10:11], row[9:10], np.array(angles[-1:]))
            radii = [*rows[:, 11].tolist(), float(rows[-1, 12])]
            tubes.append(Tube(rows[:, 10].tolist(), rows[:, 9].tolist(), angles, radii, *first))
    return tubes


def _tube(tube: Tube, places: Array, near: float) -> Array:
    """A grid on the wall of a tube, with its straight ends as far as places within a distance of them."""
    ends = tube.frames_at([0.0, tube.length])
    ahead = [(places - point) @ tangent for point, tangent in zip(ends.points, ends.tangents, strict=True)]
    close = [np.linalg.norm(places - point, axis=1) < near for point in ends.points]
    before = min(0.0, float(ahead[0][close[0]].min(initial=0.0)))
    beyond = max(0.0, float(ahead[1][close[1]].max(initial=0.0)))
    count = 2 + int((tube.length + beyond - before) / _ALONG)
    t = np.union1d(np.linspace(before, tube.length + beyond, count), tube.borders)
    frames, radii = tube.frames_at(t), tube.radius(t)
    rings = [frames.directions(np.full(len(t), angle)) for angle in np.linspace(0.0, 2.0 * np.pi, _AROUND)]
    return np.stack([frames.points + radii[:, None] * ring for ring in rings], axis=1)


def _capsule(first: Array, second: Array, radius: float) -> Array:
    """A grid on a capsule, or on a sphere where both ends are in one place."""
    way = second - first
    length = float(np.linalg.norm(way))
    axis = way / length if length > 0.0 else np.array([0.0, 0.0, 1.0])
    sideways, across = _across(axis)
    quarter = np.linspace(0.0, 0.5 * np.pi, _AROUND // 4)
    along = np.concatenate([-radius * np.cos(quarter), length + radius * np.sin(quarter)])
    out = radius * np.concatenate([np.sin(quarter), np.cos(quarter)])
    turn = np.linspace(0.0, 2.0 * np.pi, _AROUND)
    round_it = np.cos(turn)[:, None] * sideways + np.sin(turn)[:, None] * across
    return first + along[:, None, None] * axis + out[:, None, None] * round_it


def _across(axis: Array) -> tuple[Array, Array]:
    """Two unit vectors across an axis, and across each other."""
    helper = np.eye(3)[int(np.argmin(np.abs(axis)))]
    first = np.cross(axis, helper)
    first /= np.linalg.norm(first)
    return first, np.cross(axis, first)
