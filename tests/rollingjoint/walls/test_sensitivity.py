"""Derivatives of equilibria among walls against differences of solves."""

import numpy as np
import pytest

import rollingjoint as rj
from rollingjoint import sensitivity
from tests.rollingjoint.walls.scenes import CHAIN, LIMITS, REST, S_BEND, cycle, s_bend, way_in

AROUND = rj.Surroundings(
    [
        rj.Lumen([40, 60], [0.0, 0.015], radii=8.0, start=(0.0, 0.0, np.pi / 2), stiffness=1.5),
        rj.Disc((6.0, 62.0), 3.0, stiffness=2.0),
        rj.HalfPlane((0.9, -0.3), -40.0),
    ],
    rj.Sleeve(5.0),
)
COMMANDS = REST + np.array([[-1.0, 0.9, -0.5, 0.4], [0.8, -0.9, 0.4, -0.5], [1.5, -1.4, 0.2, -0.2]])
BASES = np.array([[0.3, 2.0, 0.03], [0.0, 10.0, -0.04], [-0.5, 18.0, 0.0]])


def moved(base, motion):
    """The pose of a base after a motion in its own frame."""
    x, y, angle = base
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([x + cos * motion[0] - sin * motion[1], y + sin * motion[0] + cos * motion[1], angle + motion[2]])


def slope(results, at, h):
    """Central difference of fourth order, (poses, insertion force); None where a contact opens or closes meanwhile."""
    steps = [results(way * h) for way in (-2, -1, 1, 2)]
    pressing = {tuple(contact.candidate for contact in step.wall_contacts) for step in (at, *steps)}
    if len(pressing) > 1:
        return None
    weights = np.array([1.0, -8.0, 8.0, -1.0]) / (12.0 * h)
    return tuple(
        sum(w * getattr(step, name) for w, step in zip(weights, steps, strict=True))
        for name in ("poses", "insertion_force")
    )


@pytest.mark.parametrize("row", range(3))
def test_derivatives_without_friction(row):
    command, base = COMMANDS[row], BASES[row]

    def solve(command=command, base=base, loads=(), start=None):
        settings = {"tension_limits": LIMITS, "surroundings": AROUND}
        return rj.solve_lengths(CHAIN, command, loads, base=base, start=start, **settings).require()

    at = solve()
    assert len(at.wall_contacts) >= 2
    axes, checked = np.eye(4), 0
    by_length, by_base = sensitivity.dposes_dlengths(at), sensitivity.dposes_dbase(at)
    by_load = sensitivity.dposes_dload(at, -1)
    ways = [
        (
            lambda way, j=j: solve(command + way * axes[j], start=at),
            by_length[..., j],
            sensitivity.dinsertion_dlengths(at)[j],
        )
        for j in range(4)
    ]
    ways += [
        (
            lambda way, j=j: solve(base=moved(base, way * np.eye(3)[j]), start=at),
            by_base[..., j],
            sensitivity.dinsertion_dbase(at)[j],
        )
        for j in range(3)
    ]
    ways += [
        (lambda way, j=j: solve(loads=[rj.WorldForce(-1, way * np.eye(2)[j])], start=at), by_load[..., j], None)
        for j in range(2)
    ]
    for number, (results, poses, force) in enumerate(ways):
        found = slope(results, at, 2e-4 if number == 6 else 2e-3)
        if found is None:
            continue
        checked += 1
        np.testing.assert_allclose(poses, found[0], atol=1e-6 * max(1.0, np.abs(poses).max()))
        if force is not None:
            assert force == pytest.approx(found[1], rel=1e-6, abs=1e-6)
    assert checked >= 7


def test_derivatives_by_tensions():
    tensions, base = np.array([4.0, 2.0, 2.0, 3.0]), BASES[1]

    def solve(tensions, start=None):
        return rj.solve_tensions(CHAIN, tensions, surroundings=AROUND, base=base, start=start).require()

    at = solve(tensions)
    assert at.wall_contacts
    for j, axis in enumerate(np.eye(4)):
        found = slope(lambda way, axis=axis: solve(tensions + way * axis, start=at), at, 2e-3)
        poses, force = sensitivity.dposes_dtensions(at)[..., j], sensitivity.dinsertion_dtensions(at)[j]
        np.testing.assert_allclose(poses, found[0], atol=1e-6 * max(1.0, np.abs(poses).max()))
        assert force == pytest.approx(found[1], rel=1e-6, abs=1e-6)


def test_without_walls_the_base_moves_nothing():
    free = rj.solve_lengths(CHAIN, COMMANDS[0])
    assert not sensitivity.dposes_dbase(free).any() and not sensitivity.dinsertion_dbase(free).any()
    assert not sensitivity.dinsertion_dlengths(free).any()


def test_derivatives_between_rigid_walls():
    around, base = rj.Surroundings([S_BEND], rj.Sleeve(5.0), rigid=True), np.array([0.0, 20.0, 0.0])

    def solve(way, start=None):
        settings = {"tension_limits": LIMITS, "surroundings": around}
        return rj.solve_lengths(CHAIN, COMMANDS[0], base=moved(base, [0, way, 0]), start=start, **settings).require()

    at = solve(0.0)
    found = slope(lambda way: solve(way, at), at, 1e-2)
    assert at.wall_contacts and found is not None
    np.testing.assert_allclose(sensitivity.dposes_dbase(at)[..., 1], found[0], atol=1e-5)


def test_one_sided_derivatives_with_friction():
    """As the step goes on: on one side of it at least, where contacts stick or slip as before."""
    around, offs = s_bend(0.15), []
    settings = {"tension_limits": LIMITS, "surroundings": around}
    commands, bases = cycle(24, cycles=1)
    begin = rj.trace(CHAIN, way_in()[0], base=way_in()[1], **settings).row(-1)
    path = rj.trace(CHAIN, commands, base=bases, history=begin, **settings).require()
    for k in range(1, 24, 2):
        before, at, h = path.row(k - 1), path.row(k), 1e-4
        jacobian = np.concatenate([sensitivity.dposes_dlengths(at), sensitivity.dposes_dbase(at)[..., 1:2]], axis=-1)
        for j in range(5):
            here = []
            for way in (h, -h):
                command, base = commands[k].copy(), bases[k].copy()
                (command if j < 4 else base)[j if j < 4 else 1] += way
                step = rj.solve_lengths(CHAIN, command, base=base, history=before, **settings).require()
                slope = (step.poses - at.poses) / way
                here.append(np.abs(slope - jacobian[..., j]).max() / max(1e-3, np.abs(jacobian[..., j]).max()))
            offs.append(min(here))
    assert np.median(offs) < 1e-5 and np.quantile(offs, 0.9) < 1e-3
