"""Surroundings of planar chains: walls, lumens and obstacles, and the outlines with which links touch them.

Mechanisms know nothing of them; solvers take them beside loads.

Modules:
    file: surroundings as plain values.
    fitting: centre lines of arcs through points.
    lumen: tubes around a centre line.
    outline: outlines of links.
    shapes: walls and outlines to be drawn.
    table: all that surrounds a chain, and the arrays of kernels.
    walls: walls of constant shape, and the law of a wall.
"""

from rollingjoint.surroundings.lumen import Lumen
from rollingjoint.surroundings.outline import Bare, Outline, OutlineRows, Sleeve
from rollingjoint.surroundings.shapes import Strip, closed, wall_strips
from rollingjoint.surroundings.table import WALLS, Surroundings
from rollingjoint.surroundings.walls import Capsule, Disc, HalfPlane, Polygon, Wall, WallFriction

__all__ = [
    "WALLS",
    "Bare",
    "Capsule",
    "Disc",
    "HalfPlane",
    "Lumen",
    "Outline",
    "OutlineRows",
    "Polygon",
    "Sleeve",
    "Strip",
    "Surroundings",
    "Wall",
    "WallFriction",
    "closed",
    "wall_strips",
]
