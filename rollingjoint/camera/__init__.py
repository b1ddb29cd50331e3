"""Poses of links from photographs: three balls on every link, in a plane that a picture of a board has calibrated.

Modules:
    view: where points of the plane are in a picture, with the distortion of a lens, and back.
    balls: centres of balls in a picture.
    board: the view of a camera from a picture of a board of dots.
    links: which balls belong to which link, and the poses of links.
    photographs: pictures in files, and the poses of a mechanism in them.
"""

from rollingjoint.camera.balls import KINDS, find_balls
from rollingjoint.camera.board import BoardView, view_of_board
from rollingjoint.camera.links import LinkBalls
from rollingjoint.camera.photographs import Photographs, read_picture
from rollingjoint.camera.view import PlaneView, load_view, save_view

__all__ = [
    "KINDS",
    "BoardView",
    "LinkBalls",
    "Photographs",
    "PlaneView",
    "find_balls",
    "load_view",
    "read_picture",
    "save_view",
    "view_of_board",
]
