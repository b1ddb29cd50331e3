"""The view of a camera from a picture of a board with a square grid of dots, which lies where the balls will be."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.camera.balls import find_balls
from rollingjoint.camera.view import PlaneView
from rollingjoint.checks import as_positive
from rollingjoint.errors import InvalidInput

Array = NDArray[np.float64]

LEAST_DOTS = 20
_NEAR = 0.35  # of a pitch: a dot belongs to the place of the grid within it
_CENTRE_SD = 0.03  # half diagonals: belief about the centre of the distortion
_DOT_SD = 1e-4  # half diagonals: of dots, 0.1 pixels or so, beside that belief


@dataclass(frozen=True)
class BoardView:
    """A view, and how well it explains the board.

    Args:
        view: of the camera; x to the right and y up in the picture. pixels: of the dots that were used, (N, 2).
        places: where the grid has them [mm], (N, 2). errors: of the view there, (N, 2) [mm].
    """

    view: PlaneView
    pixels: Array
    places: Array
    errors: Array

    @property
    def rms(self) -> float:
        """Root mean square distance of dots from where the view has them [mm]."""
        return float(np.sqrt((self.errors**2).sum(axis=1).mean()))


def view_of_board(picture: ArrayLike, pitch: float, kind: str = "dark") -> BoardView:
    """The view of a camera from a picture of a board in the plane of the balls.

    Args:
        picture: as of find_balls. pitch: of the square grid of dots, the same in both directions [mm].
        kind: of the dots.
    Raises:
        InvalidInput: fewer than 20 dots that form a grid, or a picture that find_balls refuses.
    """
    from scipy.optimize import least_squares

    as_positive("pitch", pitch, "a positive number [mm]")
    shape = np.shape(picture)
    dots = find_balls(picture, kind)
    places, members = _on_a_grid(dots)
    if len(members) < LEAST_DOTS:
        hint = "Fill the picture with the board, lit evenly."
        raise InvalidInput("dots of the board", len(members), f"{LEAST_DOTS} or more that form a square grid", hint)
    pixels, places = dots[members], pitch * (places - np.round(places.mean(axis=0)))
    bare = PlaneView((shape[1], shape[0]), np.eye(3))
    normalised = (pixels - bare.middle) / bare.half_diagonal
    first = _homography(places, normalised)
    scale = np.array([1.0 / np.abs(places).max()] * 2 + [1.0])  # columns of like size

    def view(values: Array) -> PlaneView:
        H = np.append(values[:8], 1.0).reshape(3, 3) * scale
        return PlaneView(bare.size, H, (float(values[8]), float(values[9])), (float(values[10]), float(values[11])))

    def misfit(values: Array) -> Array:
        errors = (view(values).pixels(places) - pixels) / bare.half_diagonal
        errors = np.nan_to_num(errors, nan=1.0)
        return np.concatenate([errors.ravel() / _DOT_SD, values[10:] / _CENTRE_SD])

    start = np.concatenate([(first / scale).ravel()[:8], np.zeros(4)])
    best = view(least_squares(misfit, start, method="trf", x_scale="jac", loss="soft_l1", f_scale=3.0).x)
    return BoardView(best, pixels, places, best.places(pixels) - places)


def _homography(places: Array, normalised: Array) -> Array:
    """The homography that takes places to normalised pixels, by the direct linear transformation, (3, 3)."""
    size = np.abs(places).max()
    x, y = (places / size).T
    u, v = normalised.T
    one, zero = np.ones_like(x), np.zeros_like(x)
    rows = np.concatenate(
        [
            np.stack([x, y, one, zero, zero, zero, -u * x, -u * y, -u], axis=1),
            np.stack([zero, zero, zero, x, y, one, -v * x, -v * y, -v], axis=1),
        ]
    )
    H = np.linalg.svd(rows)[2][-1].reshape(3, 3)
    return np.asarray(H / H[2, 2] / np.array([size, size, 1.0]))


def _on_a_grid(dots: Array) -> tuple[Array, NDArray[np.int64]]:
    """Whole places on a grid, x to the right and y up, and the dots that have them, (N, 2), (N,)."""
    from scipy.spatial import KDTree

    if len(dots) < 5:
        return np.empty((0, 2)), np.empty(0, np.int64)
    tree = KDTree(dots)
    first = int(tree.query(dots.mean(axis=0))[1])
    steps = dots[tree.query(dots[first], 5)[1][1:]] - dots[first]
    right = steps[int(np.argmax(steps[:, 0] - np.abs(steps[:, 1])))]
    up = steps[int(np.argmax(-steps[:, 1] - np.abs(steps[:, 0])))]
    places, steps_at, waiting = {first: (0, 0)}, {first: (right, up)}, [first]
    taken = {(0, 0)}
    while waiting:
        here = waiting.pop(0)
        right, up = steps_at[here]
        for direction, (i, j) in enumerate([(1, 0), (-1, 0), (0, 1), (0, -1)]):
            there = places[here][0] + i, places[here][1] + j
            distance, neighbour = tree.query(dots[here] + i * right + j * up)
            neighbour = int(neighbour)
            if (
                there in taken
                or neighbour in places
                or distance > _NEAR * min(np.linalg.norm(right), np.linalg.norm(up))
            ):
                continue
            way = (dots[neighbour] - dots[here]) * (i + j)
            places[neighbour], steps_at[neighbour] = there, (way, up) if direction < 2 else (right, way)
            taken.add(there)
            waiting.append(neighbour)
    members = np.array(sorted(places))
    return np.array([places[k] for k in members], float), members
