"""Rolling joints: the cells of angles, tables in memory, and gaps of holes with their rates."""

import numpy as np
import pytest

from rollingjoint import Profile, RollingContact, Surface
from rollingjoint._numba.jit import standalone
from rollingjoint.chain.joint_table import buckets
from rollingjoint.kernels import joints
from rollingjoint.kernels.joints import BUCKETS, CLOSED_GAP
from tests.rollingjoint.chain.spatial_chains import rolling_contact

locate, straight_gap, gap_rates = map(standalone, (joints.locate, joints.straight_gap, joints.gap_rates))


def flat_contact(*curvatures):
    """Surfaces that are nearly alike at one end, where cells are narrow."""
    steep = Profile.samples([-10.0, 10.0], curvatures)
    return RollingContact(
        0.0, Surface(steep, (0.0, -10.0)), Surface(Profile.constant(0.0, (-10.0, 10.0)), (0.0, 10.0)), 3.0
    )


@pytest.mark.parametrize(
    "contact",
    [rolling_contact(np.random.default_rng(0)), flat_contact(1e-7, 0.2), flat_contact(0.2, 1e-7)],
    ids=["broken", "flat at the highest angle", "flat at the lowest"],
)
def test_an_angle_is_looked_up_in_the_cell_that_begins_last_before_it(contact):
    cells = contact.table().cells
    per_radian, ends = buckets(cells)
    starts, low, high = cells[:, 0], cells[0, 0], cells[-1, 1]
    edges = low + (high - low) * np.arange(1, BUCKETS) / BUCKETS
    inside = np.concatenate([starts, cells[:, 1], cells.mean(axis=1, where=[True, True, False, False]), edges])
    for phi in [low, high, low - 0.1, high + 0.1, *inside, *np.nextafter(starts[1:], low)]:
        cell, u = locate(np.array([[low, high, per_radian]]), ends[None], cells, 0, phi)
        assert cell == max(np.searchsorted(starts, phi, side="right") - 1, 0)
        assert u == (phi - cells[cell, 2]) * cells[cell, 3]
        assert not low <= phi <= high or abs(u) < 1.001
    assert locate(np.array([[low, high, per_radian]]), ends[None], cells, 0, np.nan)[0] == 0


def test_tables_begin_at_a_cache_line_and_are_copies():
    values = np.arange(30.0).reshape(5, 6)
    for columns in range(1, 7):
        copy = joints.aligned(values[:, :columns])
        assert copy.ctypes.data % 64 == 0 and not np.shares_memory(copy, values)
        assert np.array_equal(copy, values[:, :columns])


def test_a_gap_is_closed_where_its_holes_meet():
    below = (0.1, 0.2, 0.0)
    for length, closed in ((0.0, True), (CLOSED_GAP, True), (1.01 * CLOSED_GAP, False), (3.0, False)):
        found = straight_gap(below, (0.1, 0.2, length))
        assert (found[0], found[3]) == (length, closed)
        assert found[2] == (0.0 if closed else 1.0 / length)
        assert found[1][2] == (length if closed else pytest.approx(1.0)) and found[1][:2] == (0.0, 0.0)


def wheel(theta, point, radius=3.0):
    """(contact, body point) of a wheel that rolls on a line, turned by theta; the point from the wheel's centre."""
    cos, sin = np.cos(theta), np.sin(theta)
    contact = np.array([-radius * theta, 0.0])
    arm = np.array([cos * point[0] - sin * point[1], radius + sin * point[0] + cos * point[1]])
    return contact, contact + arm


@pytest.mark.parametrize("aside", [0.0, 1.5])
def test_rates_of_a_gap_are_its_differences(aside):
    """A gap from a fixed hole to one on the wheel; `aside`: along the axis, in space."""
    below, point, h = np.array([0.5, -1.0]), (1.0, 0.7), 1e-4

    def length(theta):
        return np.hypot(np.linalg.norm(wheel(theta, point)[1] - below), aside)

    for theta in (-0.4, 0.1, 0.6):
        contact, above = wheel(theta, point)
        g = length(theta)
        direction = (above - below) / g
        rate, second = gap_rates(1.0, tuple(below), g, tuple(direction), 1.0 / g, tuple(contact), (-3.0, 0.0))
        before, after = length(theta - h), length(theta + h)
        assert rate == pytest.approx((after - before) / (2 * h), abs=1e-7)
        assert second == pytest.approx((after - 2 * g + before) / h**2, abs=1e-6)
