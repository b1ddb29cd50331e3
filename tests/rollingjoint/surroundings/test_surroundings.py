"""Walls, outlines and lumens as users write them, and the arrays of kernels that they become."""

import math
import pickle

import numpy as np
import pytest

from rollingjoint import (
    Bare,
    Capsule,
    Disc,
    HalfPlane,
    InvalidInput,
    Lumen,
    Polygon,
    Profile,
    Sleeve,
    Surroundings,
    WallFriction,
    five_link,
    solve_tensions,
    uniform,
)
from tests.rollingjoint.walls.test_reference import CASES, chain_of, name_of, walls_of

UP = (0.0, 0.0, math.pi / 2)
S_BEND = Lumen([30, 40, 40, 20], [0, 0.02, -0.02, 0], 8.0, UP, stiffness=2.0)


def test_sleeve_has_points_and_a_bar_along_the_axis_of_every_moving_link():
    chain = uniform(9, height=10, radius=7, half_width=5, tendon_offset=3.5)
    rows = Sleeve(5.0).rows(chain.links)
    first, second = chain.links[3].parent.start, chain.links[3].child.start
    assert rows.points.shape == (16, 5) and rows.bars.shape == (8, 6)
    assert np.allclose(rows.bars[2], [3, *first, *second, 5.0], atol=0)
    middle = 0.5 * np.add(first, second)
    assert np.allclose(rows.points[4:6], [[3, *middle, 5.0, 5.0], [3, *second, 5.0, 5.0]], atol=1e-15)
    assert np.allclose(Sleeve(5.0, points=5).rows(chain.links).points[:, 4], 2.0)


def test_sleeve_covers_the_ends_of_surfaces_by_default():
    chain = five_link()
    link = chain.links[2]  # its axis is the y axis
    ends = np.concatenate([surface.point(np.array(surface.limits)) for surface in (link.parent, link.child)])
    assert Sleeve().rows(chain.links).bars[1, 5] == pytest.approx(np.abs(ends[:, 0]).max(), abs=1e-12)


def test_bare_outline_has_the_sides_moved_inwards_and_the_face_of_the_tip():
    chain = five_link()
    rows = Bare(1.0).rows(chain.links)
    link = chain.links[1]
    low, high = (surface.point(surface.limits[0]) + np.array([1.0, 0.0]) for surface in (link.parent, link.child))
    assert rows.points.shape == (4 * 2 * 3 + 1, 5) and rows.bars.shape == (4 * 2 + 2, 6)
    assert np.allclose(rows.bars[0], [1, *low, *high, 1.0], atol=1e-12)
    assert np.allclose(rows.points[:3, 1:3], [low, 0.5 * (low + high), high], atol=1e-12)
    tip = np.subtract(chain.links[-1].child.start, [0.0, 1.0])
    assert np.allclose(rows.points[-1, :4], [4, *tip, 1.0], atol=1e-12)
    assert np.allclose(rows.bars[-2, 3:5], tip) and np.allclose(rows.bars[-1, 1:3], tip)
    assert rows.points[:, 0].min() == 1  # link 0 belongs to the drive


def test_arrays_hold_one_row_per_wall_with_its_law():
    walls = [
        HalfPlane((2.0, 0.0), -25.0, stiffness=5.0),
        Disc((1, 2), 3, friction=WallFriction(0.4, 0.1)),
        Capsule((0, 0), (1, 1), 2, toe=0.5),
        S_BEND,
        Polygon([(0, 0), (4, 0), (0, 4)]),
    ]
    chain = five_link()
    arrays = Surroundings(walls, Sleeve(8.0), WallFriction(0.2)).arrays(chain)
    assert arrays.planes.tolist() == [[[1.0, 0.0, -25.0, 5.0, 0.0, 0.2, 0.05, 0.0]]]
    assert arrays.discs.tolist() == [[[1.0, 2.0, 3.0, 1.0, 0.0, 0.4, 0.1, 0.0]]]
    assert arrays.capsules.shape == (1, 4, 10) and arrays.capsules[0, 0].tolist() == [
        0,
        0,
        1,
        1,
        2,
        1,
        0.5,
        0.2,
        0.05,
        0,
    ]
    assert arrays.capsules[0, 3, :5].tolist() == [0, 4, 0, 0, 0.5]
    assert arrays.lumens.tolist() == [[[2.0, 0.0, 0.2, 0.05, 0.0]]] and arrays.rigid.tolist() == [0.0]
    assert arrays.pieces.shape == (1, 4, 9) and arrays.pieces[0, :, 3].tolist() == [0.0, 0.02, -0.02, 0.0]
    assert arrays.pieces[0, :, 5].tolist() == [0, 30, 70, 110] and not arrays.pieces[0, :, 8].any()


def test_arrays_are_kept_for_the_same_links_and_made_anew_for_others():
    around, chain = Surroundings([HalfPlane((1, 0), -40)]), five_link()
    assert around.arrays(chain) is around.arrays(chain)
    assert around.arrays(uniform(9)).bars.shape == (1, 8, 6)
    assert around.arrays(chain).bars.shape == (1, 4, 6)
    assert pickle.loads(pickle.dumps(around)) == around


@pytest.mark.parametrize("case", CASES, ids=name_of)
def test_reference_cases_have_the_arrays_written_out_from_their_definitions(case):
    spec, chain = case["spec"], chain_of(case["spec"])
    around, (kind, size) = spec["sur"], spec["outline"]
    walls = [HalfPlane(row[:2], row[2], stiffness=row[3]) for row in around.get("planes", [])]
    walls += [Disc(row[:2], row[2], stiffness=row[3]) for row in around.get("discs", [])]
    walls += [Capsule(row[:2], row[2:4], row[4], stiffness=row[5]) for row in around.get("segs", [])]
    if "pieces" in around:
        lengths, curvatures, first, last = np.array(around["pieces"]).T
        law = {"stiffness": around["lumen_k"], "toe": around.get("toe", 0.0)}
        walls.append(Lumen(lengths, curvatures, [first[0], *last], around["start"], **law))
    outline = {"sleeve": Sleeve, "bare": Bare}[kind](size)
    friction = WallFriction(spec["mu"], case["presliding_mm"])
    arrays = Surroundings(walls, outline, friction, spec["rigid"]).arrays(chain)
    definitions = walls_of(case, chain)
    assert np.all(arrays.points[..., 4] > 0.0)
    for mine, definition in zip(arrays, definitions._replace(points=definitions.points[..., :4]), strict=True):
        mine = mine[..., : definition.shape[-1]]  # lengths of outline are for other walls
        np.testing.assert_allclose(mine, definition, rtol=0.0, atol=1e-12)


def test_a_stiffness_per_length_hardly_depends_on_the_number_of_points():
    chain = uniform(9, height=10, radius=7, half_width=5, tendon_offset=3.5)
    ratios = []
    for law in ({"stiffness": 1.0}, {"stiffness_per_length": 0.2}):
        forces = []
        for points in (20, 80):
            around = Surroundings([HalfPlane((1, 0), -4.0, **law)], Sleeve(5.0, points))
            forces.append(solve_tensions(chain, (4.0, 2.0), surroundings=around).require().wall_forces[:, 0].sum())
        ratios.append(forces[1] / forces[0])
    assert ratios[0] > 2.0 and ratios[1] == pytest.approx(1.0, abs=0.07)
    around = Surroundings([HalfPlane((1, 0), -40, stiffness_per_length=0.2)])
    assert around.arrays(chain).planes[0, 0].tolist() == [1.0, 0.0, -40.0, 0.2, 0.0, 0.0, 0.05, 1.0]


def test_lumen_goes_on_straight_at_both_ends_without_corners():
    t = np.array([-10.0, 0.0, 30.0, 70.0, 130.0, 150.0])
    pose = S_BEND.pose(t)
    assert np.allclose(pose[:3], [[0, -10, math.pi / 2], [0, 0, math.pi / 2], [0, 30, math.pi / 2]], atol=1e-12)
    assert pose[3, 2] == pytest.approx(math.pi / 2 + 0.8) and pose[4, 2] == pytest.approx(math.pi / 2)
    assert np.allclose(pose[3, :2], [-50 * (1 - math.cos(0.8)), 30 + 50 * math.sin(0.8)], atol=1e-10)
    assert np.allclose(pose[5, :2] - pose[4, :2], [0, 20], atol=1e-12)
    left, right = S_BEND.sides(t)
    assert np.allclose(np.hypot(*(left - right).T), 16.0)


def test_lumen_through_points_has_tangent_arcs_in_its_corners():
    points = np.array([[0, 0], [0, 50], [40, 80], [40, 140]], float)
    lumen = Lumen.through(points, [8, 8, 6, 6], 25.0)
    assert np.allclose(lumen.pose(lumen.length)[:2], points[-1], atol=1e-9)
    assert np.allclose(np.abs(np.array(lumen.curvatures)[[1, 3]]), 1 / 25)
    assert lumen.radii[2] == 8 and lumen.radii[3] == 6  # constant in the arcs
    # the straight lines lie on those of the polyline
    assert np.allclose(lumen.pose(lumen.borders[1] - 1e-3)[0], 0.0, atol=1e-12)
    middle = lumen.pose(0.5 * (lumen.borders[2] + lumen.borders[3]))
    assert np.cross(np.append(points[2] - points[1], 0), np.append(middle[:2] - points[1], 0))[2] == pytest.approx(
        0, abs=1e-9
    )
    assert Lumen.through([(0, 0), (0, 30)], 5.0, 10.0).curvatures == (0.0,)


def test_lumen_along_a_profile_stays_within_the_tolerance():
    profile = Profile.polynomial([0.0, 4e-4, -3e-6], (-20.0, 90.0))
    errors, pieces = [], []
    for tolerance in (0.1, 0.01, 1e-3):
        lumen = Lumen.along(profile, [8.0, 7.0, 7.5], (3.0, 4.0, 0.3), tolerance)
        s = np.linspace(-20.0, 90.0, 333)
        turn = 0.3 - float(profile.turning(-20.0))
        rotation = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
        exact = (profile.curve(s) - profile.curve(-20.0)) @ rotation.T + (3.0, 4.0)
        errors.append(np.hypot(*(lumen.pose(s + 20.0)[:, :2] - exact).T).max() / tolerance)
        pieces.append(len(lumen.lengths))
        assert lumen.radius(55.0) == pytest.approx(7.0)
    assert max(errors) <= 1.001 and pieces[0] < pieces[2] < 300
    assert len(Lumen.along(Profile.piecewise_constant([0, 30, 70], [0.0, 0.02]), 8.0).lengths) == 2


def test_lumen_fits_points_of_arcs_with_noise():
    random = np.random.default_rng(1)
    exact = Lumen([60, 60], [0.015, -0.01], 6.0, (5.0, -3.0, 0.4))
    t = np.linspace(0.0, 120.0, 61)
    points = exact.pose(t)[:, :2] + random.normal(0.0, 0.03, (61, 2))
    lumen = Lumen.fit(points, np.linspace(6.0, 7.0, 61), 0.12)
    assert np.hypot(*(lumen.pose(t)[:, :2] - exact.pose(t)[:, :2]).T).max() < 0.1
    assert len(lumen.lengths) <= 6 and lumen.radii[-1] == pytest.approx(7.0, abs=1e-3)
    line = Lumen.fit([(0, 0), (0, 10), (0, 20)], 5.0, 0.01)
    assert line.curvatures == pytest.approx((0.0,), abs=1e-9)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: HalfPlane((0, 0)), "HalfPlane normal = (0, 0): expected a direction other than (0, 0)."),
        (lambda: HalfPlane((0, "1")), "HalfPlane normal = '1': expected a finite number [mm]."),
        (
            lambda: HalfPlane((0, 1), stiffness=0.0),
            "wall stiffness = 0.0: expected a number from 1e-06 to 1e+06 [N/mm].",
        ),
        (lambda: HalfPlane((0, 1), toe=-1.0), "wall toe = -1.0: expected 0 to 100 [mm]."),
        (lambda: HalfPlane((0, 1), friction=0.3), "wall friction = 0.3: expected a WallFriction or None."),
        (lambda: Disc((0, 1), 0.0), "Disc radius = 0.0: expected a number above 0 [mm]."),
        (lambda: Disc((0, math.nan), 1.0), "Disc centre = nan: expected a finite number [mm]."),
        (lambda: Capsule((0, 1), (0, 1)), "Capsule second = (0.0, 1.0): expected another point"),
        (
            lambda: Polygon([(0, 0), (1, 0)]),
            "Polygon points = [(0, 0), (1, 0)]: expected at least 3 points (x, y) [mm].",
        ),
        (lambda: Polygon([(0, 0), (4, 4), (4, 0), (0, 4)]), "edges that do not cross. Edges 0 and 2 do."),
        (lambda: Polygon([(0, 0), (0, 0), (4, 0)]), "corners in different places"),
        (lambda: WallFriction(1.5), "wall friction mu = 1.5: expected a number from 0 to 1."),
        (lambda: WallFriction(0.1, 0.0), "wall presliding = 0.0: expected 0.01 to 10 [mm]."),
        (lambda: Sleeve(-1.0), "Sleeve radius = -1.0: expected a number above 0 [mm]."),
        (lambda: Sleeve(5.0, 0), "Sleeve points = 0: expected an integer from 1 to 100."),
        (lambda: Bare(1.0, 1), "Bare points = 1: expected an integer from 2 to 100."),
        (lambda: Bare(20.0).rows(five_link().links), "less than half the width of link 1"),
        (lambda: Surroundings([]), "walls = (): expected at least one HalfPlane"),
        (lambda: Surroundings([Sleeve()]), "walls[0] = Sleeve(radius=None, points=2): expected HalfPlane"),
        (
            lambda: Surroundings(S_BEND),
            "expected a list of HalfPlane, Disc, Capsule, Polygon, Lumen, Plane, Sphere or Tube.",
        ),
        (lambda: Surroundings([S_BEND], 5.0), "outline = 5.0: expected a Sleeve or Bare."),
        (
            lambda: Surroundings([Disc((0, 0), 1, toe=0.1)], rigid=True),
            "walls[0] toe = 0.1: expected 0 for rigid walls.",
        ),
        (lambda: Surroundings([S_BEND], rigid=1), "rigid = 1: expected true or false."),
        (lambda: Lumen([], [], 5.0), "Lumen lengths = []: expected one or more numbers above 0 [mm]."),
        (lambda: Lumen([10, 10], [0.1], 5.0), "Lumen curvatures = [0.1]: expected 2 numbers, one per piece [1/mm]."),
        (
            lambda: Lumen([10], [0.0], [5.0, 5.0, 5.0]),
            "expected one positive number, or 2, one per border of the pieces",
        ),
        (
            lambda: Lumen([10, 10], [0.0, 0.2], 5.0),
            "Lumen radii = 5.0: expected less than the bend radius of piece 1, 5 mm. Else the inner wall folds.",
        ),
        (lambda: Lumen([10], [0.0], [5.0, 11.0]), "Piece 0 of 10 mm goes from 5 to 11 mm."),
        (lambda: Lumen([200.0], [0.05], 5.0), "stays clear of itself, its straight ends included"),
        (lambda: Lumen([80.0], [0.05], 5.0), "stays clear of itself, its straight ends included"),
        (
            lambda: Lumen([10], [0.0], 5.0, (0, 0)),
            "Lumen start = (0, 0): expected three numbers (x, y, angle) [mm, rad].",
        ),
        (lambda: Lumen.through([(0, 0), (0, 9), (9, 9)], 5.0, 10.0), "They take 10 mm of it."),
        (lambda: Lumen.through([(0, 0), (0, 0), (9, 9)], 5.0, 10.0), "neighbours in different places"),
        (lambda: Lumen.fit([(0, 0), (0, 20), (0, 10), (0, 30)], 5.0), "points in order along the lumen. Point 2"),
        (lambda: Lumen.fit([(0, 0), (5, 9), (7, 18)], 5.0, 1e-19), "1 arcs come within"),
        (lambda: Lumen.along(0.02, 5.0), "Lumen profile = 0.02: expected a Profile"),
        (lambda: Lumen.along(Profile.polynomial([0, 1e-4], (0, 90)), 5.0, tolerance=1e-9), "or more for this profile."),
    ],
)
def test_wrong_values_get_one_line(make, words):
    with pytest.raises(InvalidInput) as error:
        make()
    assert words in str(error.value) and "\n" not in str(error.value)


def test_a_half_turn_is_fine():
    assert Lumen([20, math.pi * 12, 20], [0, 1 / 12, 0], 6.0).length == pytest.approx(40 + 12 * math.pi)
