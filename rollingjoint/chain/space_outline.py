"""Outlines of links in space for any drawing; no drawing library is imported."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class SpatialOutline(NamedTuple):
    """The drawing of a link in space, in its frame: a round plate between its holes, and rails that roll.

    Attributes:
        low, high: z of the lowest and the highest hole, the faces of the plate [mm].
        strips: its contact surfaces over the width of their lines, each (count, 2, 3) [mm].
        rails: the closed bodies from these surfaces to the plate, as polygons (k, 3), counter-clockwise from outside.
    """

    low: float
    high: float
    strips: list[Array]
    rails: list[list[Array]]


def rail(strip: Array, low: float, high: float) -> list[Array]:
    """The closed body between a contact surface and the nearer face of a plate."""
    above = float(strip[..., 2].mean()) > 0.5 * (low + high)
    floor = strip.copy()
    floor[..., 2] = min(high, strip[..., 2].min()) if above else max(low, strip[..., 2].max())
    faces = [np.array([strip[0, 0], floor[0, 0], floor[0, 1], strip[0, 1]])]
    faces.append(np.array([strip[-1, 1], floor[-1, 1], floor[-1, 0], strip[-1, 0]]))
    for (a, b), (c, d), (e, f), (g, h) in zip(strip[:-1], strip[1:], floor[:-1], floor[1:], strict=True):
        faces += [np.array(corners) for corners in ([a, b, d, c], [e, g, h, f], [a, c, g, e], [b, f, h, d])]
    return faces if above else [face[::-1] for face in faces]
