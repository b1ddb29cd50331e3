"""Surroundings of chains: walls, lumens and obstacles, and the outlines with which links touch them.

Mechanisms know nothing of them; solvers take them beside loads.

Modules:
    arcs: centre lines of arcs, around which lumens and tubes lie.
    file: surroundings as plain values.
    lumen: tubes around a centre line.
    moving: walls that are moved while a chain stays where it is.
    outline: outlines of links.
    shapes: walls and outlines to be drawn.
    table: all that surrounds a chain, and the arrays of kernels.
    tube: lumens in space.
    walls: walls of constant shape, and the law of a wall.
"""

from rollingjoint.surroundings.lumen import Lumen
from rollingjoint.surroundings.moving import walls_through
from rollingjoint.surroundings.outline import Bare, Outline, OutlineRows, Sleeve
from rollingjoint.surroundings.shapes import Strip, closed, wall_strips
from rollingjoint.surroundings.table import SPATIAL_WALLS, WALLS, Surroundings, wrong_walls
from rollingjoint.surroundings.tube import Tube
from rollingjoint.surroundings.walls import Capsule, Disc, HalfPlane, Plane, Polygon, Sphere, Wall, WallFriction

__all__ = [
    "SPATIAL_WALLS",
    "WALLS",
    "Bare",
    "Capsule",
    "Disc",
    "HalfPlane",
    "Lumen",
    "Outline",
    "OutlineRows",
    "Plane",
    "Polygon",
    "Sleeve",
    "Sphere",
    "Strip",
    "Surroundings",
    "Tube",
    "Wall",
    "WallFriction",
    "closed",
    "wall_strips",
    "walls_through",
    "wrong_walls",
]
