"""Friction in the tendons' holes and at walls at once: balance of every link, and batches."""

import numpy as np
import pytest

import rollingjoint as rj
from rollingjoint._numba.jit import standalone
from rollingjoint.chain.solution import stacked
from rollingjoint.kernels.gaps import nearest_on_segment, way_around
from tests.rollingjoint.walls.scenes import CHAIN, LIMITS, REST, RUBBING, S_BEND, cycle, s_bend

MU, RADIUS, LUMEN = 0.25, 5.0, 7.0


@pytest.fixture(scope="module")
def path():
    commands, bases = cycle(40, cycles=1)
    return rj.trace(RUBBING, commands, tension_limits=LIMITS, surroundings=s_bend(MU), base=bases).require()


def curvature_at(place, base):
    """Curvature of the centre line nearest to a place in the base frame."""
    along = np.linspace(0.0, S_BEND.length, 20001)
    line = S_BEND.pose(along)[:, :2] - base[:2]
    t = along[np.argmin(((line - place) ** 2).sum(axis=1))]
    return S_BEND.curvatures[int(np.searchsorted(np.cumsum(S_BEND.lengths), t))]


def wrench(step, link):
    """Force and moment about the origin of the base frame of the walls on a link, from its contacts alone.

    Friction is the derivative of the way along the wall, the arc length of the wall and the turn of the outline.
    """
    total = np.zeros(3)
    for contact in step.wall_contacts:
        if contact.link != link:
            continue
        right = np.array([contact.normal[1], -contact.normal[0]])
        centre = contact.place + (RADIUS + contact.gap) * contact.normal
        tangent = right if right[1] > 0.0 else -right  # the lumen goes up
        side = -np.sign(tangent[0] * contact.normal[1] - tangent[1] * contact.normal[0])
        turn = side * curvature_at(centre, step.walls.base)
        scale = (1.0 - turn * (LUMEN - RADIUS)) / (1.0 - turn * (LUMEN - RADIUS - contact.gap))
        force = contact.force * contact.normal + scale * contact.friction * right
        np.testing.assert_allclose(contact.force_on_link, force, atol=1e-9)
        moment = centre[0] * force[1] - centre[1] * force[0] + RADIUS * contact.friction
        total += [*force, moment]
    return total


@pytest.mark.slow
def test_every_link_is_in_balance_under_tendons_that_rub_and_walls_that_rub(path):
    most = 0.0
    for k in range(5, len(path.status), 5):
        step = path.row(k)
        holes = RUBBING.tendon_polyline(step.poses)
        ex, ey = step.contact_tangents.T
        along, across = step.contact_forces.T
        between = np.stack([along * ex - across * ey, along * ey + across * ex], axis=-1)
        for i in range(RUBBING.n_joints):
            total = sum(wrench(step, link) for link in range(i + 1, RUBBING.n_links))
            pulls = [(between[i], step.contact_points[i])]
            for j, polyline in enumerate(holes):
                if len(polyline) > 2 * (i + 1):
                    below, above = polyline[2 * i + 1], polyline[2 * i + 2]
                    pulls += [(step.gap_tensions[i, j] * (below - above) / np.linalg.norm(below - above), above)]
            for force, point in pulls:
                total = total + np.array([*force, point[0] * force[1] - point[1] * force[0]])
            np.testing.assert_allclose(total, 0.0, atol=1e-7)
        most = max(most, max((abs(contact.friction) for contact in step.wall_contacts), default=0.0))
        for contact in step.wall_contacts:
            assert abs(contact.friction) <= MU * contact.force * (1.0 + 1e-12)
            assert contact.force > 0.0 and contact.gap < 0.0
    assert most > 0.05
    assert np.ptp(path.gap_tensions[:, :4], axis=1).max() > 0.05  # holes rub as well


def test_both_kinds_of_friction_add_to_the_work(path):
    assert (path.walls.work > -0.02).all() and path.walls.work.sum() > 1.0
    assert path.friction.work.sum() > 1.0
    np.testing.assert_allclose(path.dissipated_work, path.walls.work + path.friction.work)


def test_rows_of_a_batch_are_single_steps_to_the_last_bit(path):
    commands, bases = cycle(40, cycles=1)
    rows = [3, 11, 25, 38]
    before = [path.row(row) for row in rows]
    settings = {"tension_limits": LIMITS, "surroundings": s_bend(MU)}
    histories = stacked(before)
    batch = rj.solve_lengths_batch(
        RUBBING, commands[np.add(rows, 1)], history=histories, base=bases[np.add(rows, 1)], **settings
    )
    assert batch.ok.all()
    for place, (row, history) in enumerate(zip(rows, before, strict=True)):
        single = rj.solve_lengths(RUBBING, commands[row + 1], history=history, base=bases[row + 1], **settings)
        taken = batch.row(place)
        for name in ("joint_angles", "gap_tensions", "wall_forces", "dissipated_work", "friction_states"):
            assert np.array_equal(getattr(single, name), getattr(taken, name)), name
        assert np.array_equal(single.walls.states, taken.walls.states)
        assert np.array_equal(single.joint_angles, path.joint_angles[row + 1])


def test_a_contact_that_opens_on_one_side_of_a_lumen_begins_anew_on_the_other():
    """Sideways across a straight lumen nothing slides; the way along one wall says nothing about the other."""
    around = rj.Surroundings(
        [rj.Lumen([200.0], [0.0], 8.0, (0.0, -20.0, np.pi / 2))], rj.Sleeve(5.0), rj.WallFriction(0.2)
    )
    step = None
    for x in (-1.0, 4.0):
        step = rj.solve_lengths(
            CHAIN, REST, tension_limits=LIMITS, surroundings=around, base=(x, 0.0, 0.0), history=step
        ).require()
    assert len(step.wall_contacts) >= 2 and all(contact.normal[0] < -0.9 for contact in step.wall_contacts)
    assert max(abs(contact.state) for contact in step.wall_contacts) < 0.1
    pushed = rj.solve_lengths(
        CHAIN, REST, tension_limits=LIMITS, surroundings=around, base=(4.0, 0.02, 0.0), history=step
    ).require()
    assert pushed.insertion_force > 0.0 and all(0.2 < contact.state < 0.6 for contact in pushed.wall_contacts)


@pytest.mark.parametrize("side, end", [(-1.0, 0.0), (1.0, 0.0), (-1.0, 30.0), (1.0, 30.0)])
def test_friction_at_a_wall_that_gives_way_does_not_jump_where_a_side_meets_an_end(side, end):
    """The rate of the way along a pressed capsule; beyond the blend it is the derivative of the way."""
    length, inner, outer, depth = 30.0, 4.0, 5.0, 0.5
    nearest, around = standalone(nearest_on_segment), standalone(way_around)

    def way(u):
        place = nearest(u, side * (inner + outer - depth), 0.0, 0.0, 1.0, 0.0, length)
        return np.array(around(place, 1.0, 0.0, length, inner, outer))

    jump = abs(way(end + 1e-9)[1] - way(end - 1e-9)[1])
    assert jump < 1e-6 and abs(way(end + 0.006)[1] - way(end - 0.006)[1]) > 0.05
    for u in (end - 0.4, end - 0.006, end + 0.006, end + 0.4):
        assert way(u)[1] == pytest.approx((way(u + 1e-6)[0] - way(u - 1e-6)[0]) / 2e-6, abs=1e-6)
    for u in (end - 0.003, end + 0.003):
        slope = (way(u + 1e-7)[1] - way(u - 1e-7)[1]) / 2e-7
        assert way(u)[3] == pytest.approx(slope, rel=0.02)
