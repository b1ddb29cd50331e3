"""The tables of joints whose surfaces are nearly alike at one place, where cells are narrow in the joint's angle."""

import numpy as np
import pytest

from rollingjoint import Link, Profile, RollingChain, Status, Surface, Tendon, WorldForce, five_link, solve_tensions
from rollingjoint.chain.joint_table import buckets, tabulate
from rollingjoint.kernels.joints import BUCKETS

HALF_WIDTH = 10.0


def flat_chain(least, slope, inside, turn=0.0):
    """Two links whose relative curvature falls to `least` at s = -10 or s = 0; the upper one turned at rest."""
    s = [-HALF_WIDTH, 0.0, HALF_WIDTH] if inside else [-HALF_WIDTH, HALF_WIDTH]
    distance = np.abs(np.array(s) - (0.0 if inside else -HALF_WIDTH))
    parent = Profile.samples(s, least + slope * distance)
    flat = Profile.constant(0.0, (-HALF_WIDTH, HALF_WIDTH))
    link = Link(Surface(parent, (0.0, -10.0), turn), Surface(flat, (0.0, 10.0)))
    return RollingChain([link, link], [Tendon.on_surfaces(-6.0), Tendon.on_surfaces(6.0)])


def near(place):
    """Arc lengths at a place and at distances of 1e-9 to 1 mm on both sides of it, within the surface."""
    distance = np.concatenate([[0.0], 10.0 ** np.arange(-9.0, 0.1, 0.1)])
    s = np.concatenate([place - distance[::-1], place + distance])
    return s[np.abs(s) <= HALF_WIDTH]


@pytest.mark.parametrize("turn", [0.0, 0.3])
@pytest.mark.parametrize("inside", [False, True])
@pytest.mark.parametrize(("least", "slope"), [(1e-7, 1e-2), (1e-6, 1e-2), (1e-4, 1e-3)])
def test_contacts_at_a_flat_spot_are_where_the_surfaces_say(least, slope, inside, turn):
    chain = flat_chain(least, slope, inside, turn)
    below, above = chain.links[0].child, chain.links[1].parent
    s = near(0.0 if inside else -HALF_WIDTH)
    angles = chain.joint_angles(s[:, None])
    kappa = np.abs(below.curvature(s) - above.curvature(s))
    assert np.all(np.abs(chain.arc_lengths(angles)[:, 0] - s) <= 1e-9 + 2e-15 / kappa)
    cos, sin = np.cos(angles[:, 0]), np.sin(angles[:, 0])
    arm = above.point(s)
    turned = np.stack([cos * arm[:, 0] - sin * arm[:, 1], sin * arm[:, 0] + cos * arm[:, 1]], axis=-1)
    assert np.abs(chain.poses(angles)[:, 1, :2] - (below.point(s) - turned)).max() < 1e-10


@pytest.mark.parametrize("least", [1e-7, 1e-6])
def test_a_contact_held_at_a_flat_end_is_at_that_end(least):
    chain = flat_chain(least, 1e-2, inside=False)
    held = solve_tensions(chain, [2.0, 1.0], [WorldForce(1, (0.0, 0.0), 500.0)])
    assert held.status is Status.AT_LIMIT
    assert held.arc_lengths == pytest.approx([-HALF_WIDTH], abs=1e-7)


@pytest.mark.parametrize("chain", [five_link(), flat_chain(1e-7, 1e-2, False), flat_chain(1e-7, 1e-2, True)])
def test_a_bucket_reaches_from_its_first_cell_to_its_last_and_no_further(chain):
    cells = tabulate(chain.links[0].child, chain.links[1].parent).cells
    per_radian, ends = buckets(cells)
    low, high = cells[0, 0], cells[-1, 1]
    assert per_radian == pytest.approx(BUCKETS / (high - low)) and len(ends) == 2 * BUCKETS
    edges = low + (high - low) * np.arange(BUCKETS + 1) / BUCKETS
    rounding, margin = 1e-14 * (high - low), 1e-9 * (high - low)
    for first, last, begin, end in zip(ends[::2], ends[1::2], edges[:-1], edges[1:], strict=True):
        within = np.flatnonzero((cells[:, 1] > begin - rounding) & (cells[:, 0] < end - rounding))
        around = np.flatnonzero((cells[:, 1] > begin - margin) & (cells[:, 0] <= end + margin))
        assert around[0] <= first <= within[0] and within[-1] <= last <= around[-1]
