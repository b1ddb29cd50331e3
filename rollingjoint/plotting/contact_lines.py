"""Contact surfaces and contact lines of chains in space, and the forces that keep the lines in place."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rollingjoint.chain.spatial import SpatialChain
from rollingjoint.chain.spatial_equilibrium import SpatialEquilibrium

if TYPE_CHECKING:
    from mpl_toolkits.mplot3d import Axes3D

Array = NDArray[np.float64]

ABOVE_BODIES = 20  # drawing order of lines, which bodies do not hide
_SLACK = 1e-9  # N
_ARROW = 0.12  # longest arrow of a force on teeth or straps, in lengths of the chain
_CONTACTS = (  # least share of the normal force that the tilting margin is, colour, text
    (0.5, "#2ca02c", "contact line, both ends pressed"),
    (0.0, "#ff9f1c", "contact line, one end pressed little"),
    (-np.inf, "#d62728", "contact line, one end lifts"),
)
_TEETH, _STRAPS = "#7b3294", "#d62728"


def draw_surfaces(ax: Axes3D, chain: SpatialChain, poses: Array, color: str) -> None:
    """Draws the contact surfaces of all links over the width of their lines, with the rails that carry them."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    surfaces: list[Array] = []
    rails: list[Array] = []
    for pose, outline in zip(poses, chain.outlines(), strict=True):
        for strip, rail in zip(outline.strips, outline.rails, strict=True):
            quads = np.stack([strip[:-1, 0], strip[1:, 0], strip[1:, 1], strip[:-1, 1]], axis=1)
            surfaces += list(quads @ pose[:3, :3].T + pose[:3, 3])
            rails += [face @ pose[:3, :3].T + pose[:3, 3] for face in rail]
    if surfaces:
        ax.add_collection3d(Poly3DCollection(rails, facecolor=color, edgecolor="none", alpha=0.18))
        ax.add_collection3d(Poly3DCollection(surfaces, facecolor=color, edgecolor="none", alpha=0.7))
        ax.auto_scale_xyz(*np.concatenate(surfaces).T, had_data=True)


def draw_contacts(ax: Axes3D, equilibrium: SpatialEquilibrium) -> None:
    """Draws contact lines, and dots where the normal force acts on those that it presses on both ends."""
    pressing = np.maximum(equilibrium.pressing_margins, _SLACK)
    for i, ends in _lines(equilibrium):
        share = equilibrium.tilting_margins[i] / pressing[i]
        color, text = next((color, text) for least, color, text in _CONTACTS if share >= least)
        ax.plot(*ends.T, color=color, linewidth=2.5, label=text, zorder=ABOVE_BODIES + 1)
        if share >= 0.0:
            place = equilibrium.centres_of_pressure[i] * equilibrium.contact_frames[i, 2]
            centre = (equilibrium.contact_points[i] + place)[:, None]
            edge = {"markeredgecolor": "black", "markeredgewidth": 0.5, "zorder": ABOVE_BODIES + 2}
            ax.plot(*centre, "o", color=color, markersize=4, **edge)


def draw_holding(ax: Axes3D, equilibrium: SpatialEquilibrium, friction: float) -> None:
    """Draws forces on the upper link, of teeth at the end that needs them more, and of straps at ends that lift."""
    teeth: list[tuple[Array, Array]] = []
    straps: list[tuple[Array, Array]] = []
    forces, pulls = equilibrium.tooth_forces(friction), equilibrium.strap_forces
    for i, ends in _lines(equilibrium):
        tangent, normal, axis = equilibrium.contact_frames[i]
        straps += [(at, -pull * normal) for at, pull in zip(ends, pulls[i], strict=True) if pull > _SLACK]
        if forces[i] > _SLACK:
            side, pressed = equilibrium.end_forces[i].T
            along = 0.5 * equilibrium.reactions[i, 2]
            needier = int(np.argmax(np.hypot(side, along) - friction * np.maximum(pressed, 0.0)))
            way = side[needier] * tangent + along * axis
            teeth.append((ends[needier], forces[i] * way / np.linalg.norm(way)))
    length = _ARROW * _chain(equilibrium).length
    _arrows(ax, teeth, length, _TEETH, f"teeth beside friction of {friction:g}")
    _arrows(ax, straps, length, _STRAPS, "straps")


def _lines(equilibrium: SpatialEquilibrium) -> list[tuple[int, Array]]:
    """Joints with a contact line, and its ends (2, 3) in the base frame, the one along the axis first [mm]."""
    half_widths = np.array([joint.line for joint in _chain(equilibrium).joints])
    shown = np.flatnonzero(np.isfinite(half_widths) & np.isfinite(equilibrium.reactions).all(axis=-1))
    reach = half_widths[:, None] * equilibrium.contact_frames[:, 2]
    return [(int(i), equilibrium.contact_points[i] + np.outer([1.0, -1.0], reach[i])) for i in shown]


def _chain(equilibrium: SpatialEquilibrium) -> SpatialChain:
    """The chain of a single equilibrium."""
    chain = equilibrium.mechanism
    assert isinstance(chain, SpatialChain)
    return chain


def _arrows(ax: Axes3D, forces: list[tuple[Array, Array]], length: float, color: str, name: str) -> None:
    """Draws forces at points, the largest one with that length [mm]."""
    if not forces:
        return
    points, vectors = (np.array(parts) for parts in zip(*forces, strict=True))
    largest = float(np.linalg.norm(vectors, axis=1).max())
    style = {"color": color, "linewidth": 1.8, "arrow_length_ratio": 0.35, "zorder": ABOVE_BODIES + 3}
    ax.quiver(*points.T, *(length / largest * vectors).T, label=f"{name}: up to {largest:.2g} N", **style)
