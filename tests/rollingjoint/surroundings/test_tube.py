"""Tubes: centre lines of arcs in space, through points and fitted."""

import numpy as np
import pytest

from rollingjoint import InvalidInput, Lumen, Tube

ZIGZAG = [(0, 0, 0), (9, 0, 30), (-9, 9, 60), (9, -9, 90), (0, 9, 120), (9, 9, 150)]
CORNERS = [(0, 0, -60), (0, 0, 30), (12, 6, 60), (2, 18, 110)]


def test_a_centre_line_has_no_corners_and_arcs_of_its_curvatures():
    tube = Tube([30, 25, 40, 20], [0.0, 0.03, 0.02, 0.01], [0.0, 0.5, 2.0, -2.5], radii=8.0, tangent=(1, 2, 3))
    t, step = np.linspace(-20.0, tube.length + 20.0, 400), 1e-4
    frames = tube.frames_at(t)
    ahead = (tube.points(t + step) - tube.points(t - step)) / (2.0 * step)
    np.testing.assert_allclose(ahead, frames.tangents, atol=1e-5)
    inside = np.concatenate([[0.0], tube.borders[:-1]]) + 5.0
    turn = tube.frames_at(inside + step).tangents - tube.frames_at(inside).tangents
    np.testing.assert_allclose(np.linalg.norm(turn, axis=1) / step, [0.0, *tube.curvatures], atol=1e-6)
    assert np.abs(np.einsum("ka,ka->k", frames.tangents, frames.sideways)).max() < 1e-12


def test_a_frame_that_is_carried_along_does_not_twist():
    tube = Tube([30, 25, 40], [0.03, 0.03, 0.02], [0.0, 1.5, 3.0], radii=8.0)
    t, step = np.linspace(1.0, tube.length - 1.0, 50), 1e-4
    change = tube.frames_at(t + step).sideways - tube.frames_at(t - step).sideways
    across = np.cross(tube.frames_at(t).tangents, tube.frames_at(t).sideways)
    assert np.abs(np.einsum("ka,ka->k", change, across)).max() < 1e-9


def test_a_tube_through_points_touches_their_lines():
    tube = Tube.through(CORNERS, [17, 17, 16, 17], 40.0)
    np.testing.assert_allclose(tube.points(0.0), CORNERS[0], atol=1e-12)
    np.testing.assert_allclose(tube.points(tube.length), CORNERS[-1], atol=1e-9)
    assert sorted(set(np.round(tube.curvatures, 12))) == [0.0, 0.025]
    assert tube.length < sum(np.linalg.norm(np.diff(CORNERS, axis=0), axis=1))
    flat = Lumen.through([(0, 0), (0, 55), (-30, 90), (-30, 150)], [8, 8, 7, 7], 35.0)
    bent = Tube.through([(0, 0, 0), (0, 0, 55), (-30, 0, 90), (-30, 0, 150)], [8, 8, 7, 7], 35.0)
    t = np.linspace(-10.0, flat.length + 10.0, 50)
    np.testing.assert_allclose(bent.points(t)[:, [0, 2]], flat.points(t), atol=1e-9)
    np.testing.assert_allclose(bent.radius(t), flat.radius(t), atol=1e-12)


def test_a_fitted_tube_is_within_its_tolerance():
    exact = Tube.through(CORNERS, 8.0, 40.0)
    points = exact.points(np.linspace(0.0, exact.length, 30))
    fitted = Tube.fit(points, 8.0, tolerance=0.3)
    t = np.linspace(-20.0, fitted.length + 20.0, 6000)
    apart = np.linalg.norm(points[:, None] - fitted.points(t), axis=-1).min(axis=1)
    assert apart.max() < 0.31
    assert len(fitted.lengths) <= 12
    single = Tube([50.0], [0.02], [0.7], 8.0)
    assert len(Tube.fit(single.points(np.linspace(0.0, 50.0, 9)), 8.0, 1e-6).lengths) == 1


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Tube([30.0], [0.2], [0.0], 8.0), "less than the bend radius"),
        (lambda: Tube([30.0], [-0.1], [0.0], 8.0), "0 or more"),
        (lambda: Tube([30.0], [0.0], [0.0, 1.0], 8.0), "one per piece"),
        (lambda: Tube([300.0], [0.05], [0.0], 8.0), "stays clear of itself"),
        (lambda: Tube.through([(0, 0, 0), (0, 0, 50), (0, 0, 10)], 8.0, 20.0), "turn right back"),
        (lambda: Tube.through([(0, 0, 0), (0, 0, 20), (20, 0, 20)], 8.0, 40.0), "arcs that fit"),
        (lambda: Tube.fit(ZIGZAG, 8.0, 1e-6), "arcs reach"),
    ],
)
def test_tubes_that_cannot_be_are_refused(make, message):
    with pytest.raises(InvalidInput, match=message):
        make()
