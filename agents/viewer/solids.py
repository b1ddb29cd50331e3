"""The links of a mechanism as triangles, and the lines of its tendons, for any drawing in space.

A planar chain lies in the plane z = 0, each link as thick as it is drawn; others are where their poses say. Links of a
chain in space are plates between their holes, with their contact surfaces over the width of the lines.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rj_gym.tracking.render import TrackingScene
from rollingjoint import HingeChain, Link, RollingChain, SpatialChain

Array = NDArray[np.float64]
Shape = tuple[int, Array, NDArray[np.uint32]]
"""A link, with vertices and faces of a Solid."""
Strand = tuple[Array, float]
"""Points of a line, (K, 3) [mm], and its tension [N]."""

DEPTH = 0.16  # of a planar link, in lengths of the chain
SIDES = 24  # of a bead
HOLE_SIDES = 10  # of the rim of a hole
HOLE = 0.11  # radius of the rim of a hole, in radii of the circle of the holes
PLATE = 2.5  # radius of the base of an arm, in radii of the circle of the holes
STRIP = 12  # points along a contact surface of a chain in space
ALONG = 48  # points along each surface of a planar link


@dataclass(frozen=True)
class Solid:
    """Triangles of one shape and the links that have it.

    Args:
        vertices: in the frame of the link, (V, 3) [mm]. faces: (F, 3), counter-clockwise from outside.
        links: which ones. marked: whether it marks holes, in a darker colour.
    """

    vertices: Array
    faces: NDArray[np.uint32]
    links: tuple[int, ...]
    marked: bool = False


def solids(mechanism: RollingChain | HingeChain | SpatialChain) -> list[Solid]:
    """The shapes of all links, equal ones once; the base of an arm is a plate."""
    if isinstance(mechanism, SpatialChain):
        return _distinct(_plates(mechanism)) + _distinct(_rims(mechanism), marked=True)
    return _distinct(_chain(mechanism) if isinstance(mechanism, RollingChain) else _tubes(mechanism))


def _distinct(shapes: Iterable[Shape], marked: bool = False) -> list[Solid]:
    """Every shape once, with the links that have it."""
    by_shape: dict[bytes, Solid] = {}
    for link, vertices, faces in shapes:
        key = vertices.tobytes()
        links = by_shape[key].links if key in by_shape else ()
        by_shape[key] = Solid(vertices, faces, (*links, link), marked)
    return list(by_shape.values())


def frames(poses: ArrayLike) -> Array:
    """Frames of all links in space, (n, 4, 4), from poses (n, 3) of a chain or (n, 4, 4) of an arm."""
    array = np.asarray(poses, float)
    if array.ndim == 3:
        return array
    placed = np.tile(np.eye(4), (len(array), 1, 1))
    cos, sin = np.cos(array[:, 2]), np.sin(array[:, 2])
    placed[:, 0, 0], placed[:, 0, 1], placed[:, 1, 0], placed[:, 1, 1] = cos, -sin, sin, cos
    placed[:, :2, 3] = array[:, :2]
    return placed


def front(mechanism: RollingChain | HingeChain | SpatialChain) -> float:
    """The height of the front of a planar chain's links above the plane z = 0, on which lines are drawn [mm]."""
    return 0.5 * DEPTH * mechanism.length


def in_space(points: ArrayLike, z: float = 0.0) -> Array:
    """Points (..., 2) in the plane at this height, or points (..., 3) as they are, (..., 3)."""
    array = np.asarray(points, float)
    if array.shape[-1] == 3:
        return array
    return np.concatenate([array, np.full((*array.shape[:-1], 1), z)], axis=-1)


def strands(mechanism: Any, poses: ArrayLike, tensions: Sequence[float] | Array) -> list[Strand]:
    """The lines of all tendons and their tensions, without friction."""
    lines = mechanism.tendon_polyline(poses)
    return [(in_space(line, front(mechanism)), float(tension)) for line, tension in zip(lines, tensions, strict=True)]


def strands_of(scene: TrackingScene) -> list[Strand]:
    """The parts of all tendons in a scene, each with its own tension where they rub."""
    flat = isinstance(scene.mechanism, RollingChain)
    lines = scene.mechanism.tendon_polyline(scene.poses)
    parts = [part for j, line in enumerate(lines) for part in scene.tendon_parts(j, line, from_hole=flat)]
    return [(in_space(points, front(scene.mechanism)), tension) for points, tension in parts]


def _chain(mechanism: RollingChain) -> list[Shape]:
    return [(k, *_thick(link, DEPTH * mechanism.length)) for k, link in enumerate(mechanism.links)]


def _thick(link: Link, depth: float) -> tuple[Array, NDArray[np.uint32]]:
    """A link between its two surfaces, `depth` [mm] thick."""
    parent, child = (surface.point(np.linspace(*surface.limits, ALONG)) for surface in (link.parent, link.child))
    return slab(parent, child, depth)


def slab(first: Array, second: Array, depth: float) -> tuple[Array, NDArray[np.uint32]]:
    """The solid between two edges in the plane, (k, 2) each, `depth` [mm] thick: front, back and the sides."""
    outline = np.concatenate([first, second[::-1]])
    count, last, along = len(outline), len(outline) - 1, len(first)
    vertices = np.concatenate([in_space(outline, 0.5 * depth), in_space(outline, -0.5 * depth)])
    face = [(k, k + 1, last - k) for k in range(along - 1)] + [
        (k + 1, last - k - 1, last - k) for k in range(along - 1)
    ]
    successors = np.roll(np.arange(count), -1)
    walls = [(k, k + count, j) for k, j in enumerate(successors)] + [
        (k + count, j + count, j) for k, j in enumerate(successors)
    ]
    faces = np.array([*face, *((c + count, b + count, a + count) for a, b, c in face), *walls], np.uint32)
    return _sharp(vertices, faces)


def grid_solid(grid: Array) -> tuple[Array, NDArray[np.uint32]]:
    """The surface through a grid of points, (k, l, 3)."""
    rows, columns = grid.shape[:2]
    k = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    faces = np.concatenate([np.stack([k, k + columns, k + 1], 1), np.stack([k + 1, k + columns, k + columns + 1], 1)])
    return grid.reshape(-1, 3), faces.astype(np.uint32)


def _tubes(chain: HingeChain) -> list[Shape]:
    """Tubes from hole to hole, on a plate that ends where the arm begins."""
    radius, plate = 0.97 * chain.hole_radius, 0.02 * chain.length
    tubes = [(k + 1, *_tube(radius, low, high)) for k, (low, high) in enumerate(chain.body_ends.tolist())]
    return [(0, *_tube(PLATE * chain.hole_radius, -plate, 0.0)), *tubes]


def _plates(chain: SpatialChain) -> list[Shape]:
    """Plates from hole to hole, and rails from there to the contact surfaces."""
    shapes: list[Shape] = []
    for link, outline in enumerate(chain.outlines(STRIP)):
        plate, _ = _tube(0.97 * chain.hole_radius, outline.low, outline.high)
        rails = [face[[0, 1, 2, 0, 2, 3]] for rail in outline.rails for face in rail]
        shapes.append((link, *_separate(np.concatenate([plate, *rails]))))
    return shapes


def _rims(chain: SpatialChain) -> list[Shape]:
    """Short tubes at the holes of all links, as far as the surface of a rail above them."""
    size, shapes = HOLE * chain.hole_radius, []
    for link, outline in enumerate(chain.outlines(STRIP)):
        holes = [points[link, side] for points in chain.hole_points if link < len(points) for side in (0, 1)]
        rims = []
        for hole in holes:
            levels = [hole[2], *(level for strip in outline.strips for level in _level(strip, hole))]
            middle = 0.5 * (outline.low + outline.high)
            outer = max(levels) if hole[2] > middle else min(levels)
            ends = outer - 0.5 * size, outer + 0.5 * size
            rims.append(_tube(size, *ends, HOLE_SIDES)[0] + [hole[0], hole[1], 0.0])
        if rims:
            shapes.append((link, *_separate(np.concatenate(rims))))
    return shapes


def _level(strip: Array, hole: Array) -> list[float]:
    """z of a contact surface above or below a hole on its side of the link, if it is there."""
    across, along = (strip[-1, 0] - strip[0, 0])[:2], (strip[0, 1] - strip[0, 0])[:2]
    lateral, axis = across / np.linalg.norm(across), along / np.linalg.norm(along)
    places, width = strip[:, 0, :2] @ lateral, np.sort(strip[0, :, :2] @ axis)
    inside = places[0] <= hole[:2] @ lateral <= places[-1] and width[0] <= hole[:2] @ axis <= width[1]
    same_side = strip[..., 2].mean() * hole[2] > 0.0
    return [float(np.interp(hole[:2] @ lateral, places, strip[:, 0, 2]))] if inside and same_side else []


def _tube(radius: float, low: float, high: float, sides: int = SIDES) -> tuple[Array, NDArray[np.uint32]]:
    turns = np.linspace(0.0, 2 * np.pi, sides, endpoint=False)
    ring = radius * np.stack([np.cos(turns), np.sin(turns)], axis=-1)
    vertices = np.concatenate([in_space(ring, low), in_space(ring, high), [(0, 0, low), (0, 0, high)]])
    k, j = np.arange(sides), np.roll(np.arange(sides), -1)
    below, above = np.full(sides, 2 * sides), np.full(sides, 2 * sides + 1)
    parts = [(k, j, k + sides), (j, j + sides, k + sides), (j, k, below), (k + sides, j + sides, above)]
    return _sharp(vertices, np.concatenate([np.stack(part, axis=1) for part in parts]).astype(np.uint32))


def _sharp(vertices: Array, faces: NDArray[np.uint32]) -> tuple[Array, NDArray[np.uint32]]:
    """The same triangles with separate corners, so that edges are not smoothed."""
    return _separate(vertices[faces].reshape(-1, 3))


def _separate(corners: Array) -> tuple[Array, NDArray[np.uint32]]:
    """Triangles of corners (3 F, 3) in turn."""
    return corners, np.arange(len(corners), dtype=np.uint32).reshape(-1, 3)
