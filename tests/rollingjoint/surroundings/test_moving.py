"""Walls that pass through a chain at rest when they are moved."""

import numpy as np
import pytest

from rollingjoint import Capsule, Disc, HalfPlane, InvalidInput, Lumen, Plane, Polygon, Sphere, Surroundings, Tube
from rollingjoint.surroundings import walls_through

UPRIGHT = np.array([(0.0, 0.0), (1.0, 20.0), (-1.0, 40.0), (0.0, 60.0)])
IN_SPACE = np.insert(UPRIGHT, 1, 0.0, axis=1)


def through(first, last, line=UPRIGHT):
    return walls_through(Surroundings(first), Surroundings(last), line)


def test_a_disc_that_is_dragged_across_is_noticed_and_one_around_the_tip_is_not():
    assert through([Disc((20, 30), 5)], [Disc((-20, 30), 5)]) == [0]
    assert through([Disc((20, 30), 5)], [Disc((6, 30), 5)]) == []
    assert through([Disc((20, 70), 5)], [Disc((-20, 70), 5)]) == []
    assert through([Disc((20, 30), 5), HalfPlane((1, 0), -9)], [Disc((20, 30), 5), HalfPlane((1, 0), 9)]) == []


def test_ends_corners_and_bends_are_noticed():
    assert through([Capsule((9, 30), (30, 40), 2)], [Capsule((-9, 30), (12, 40), 2)]) == [0]
    square = [(9, 20), (20, 20), (20, 30), (9, 30)]
    assert through([Polygon(square)], [Polygon([(x - 30, y) for x, y in square])]) == [0]
    bend = Lumen([30, 30], [0.0, 0.05], 8.0, start=(0.0, 0.0, np.pi / 2))
    assert through([bend], [Lumen([30, 30], [0.0, 0.05], 8.0, start=(30.0, 0.0, np.pi / 2))]) == [0]
    assert through([bend], [Lumen([30, 30], [0.0, 0.05], 8.0, start=(5.0, 0.0, np.pi / 2))]) == []


def test_walls_in_space_are_noticed():
    assert through([Sphere((20, 0, 30), 5)], [Sphere((-20, 1, 30), 5)], IN_SPACE) == [0]
    assert through([Sphere((20, 12, 30), 5)], [Sphere((-20, 12, 30), 5)], IN_SPACE) == []
    rod = Capsule((9, -30, 30), (9, 30, 35), 2)
    assert through(
        [Plane((1, 0, 0), -9), rod], [Plane((1, 0, 0), -9), Capsule((-9, -30, 30), (-9, 30, 35))], IN_SPACE
    ) == [1]
    assert through([rod], [Capsule((9, -30, 80), (9, 30, 85), 2)], IN_SPACE) == []
    bend = {"lengths": [30, 30], "curvatures": [0.0, 0.05], "directions": [0.0, 0.0], "radii": 8.0}
    assert through([Tube(**bend)], [Tube(**bend, start=(-30, 0, 0))], IN_SPACE) == [0]


def test_walls_that_are_not_the_same_are_refused():
    with pytest.raises(InvalidInput, match="the walls before, Disc"):
        through([Disc((20, 30), 5)], [HalfPlane((1, 0))])
    with pytest.raises(InvalidInput, match=r"\(k, 2\)"):
        through([Disc((20, 30), 5)], [Disc((9, 30), 5)], IN_SPACE)
