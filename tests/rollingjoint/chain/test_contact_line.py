"""Forces on teeth and straps of contact lines, against linear programmes over pressure, friction, teeth and straps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import linprog

from rollingjoint import InvalidInput, WorldForce, pitch_yaw, solve_tensions, solve_tensions_batch
from rollingjoint.chain.contact_line import least_tooth_force
from tests.rollingjoint.chain.spatial_chains import contact_frames, random_chain, random_loads
from tests.rollingjoint.chain.test_spatial import hinged
from tests.second_opinions import spatial_reference as reference

SIDES, POINTS = 64, 9
AROUND = 2 * np.pi * np.arange(SIDES) / SIDES
ROUND = np.stack([np.cos(AROUND), np.sin(AROUND)])  # corners of the unit circle, along the tangent and the axis


def least(reaction, half_width, mu, straps, shoulders):
    """The smallest force on equally strong teeth at both ends that a linear programme finds; inf where there is none.

    Variables: a pressure and the corners of its friction disc at points along the line, the corners of the discs of the
    teeth at both ends, or two ways along the tangent, and the force. Straps pull with given tensions at both ends.
    """
    places = np.linspace(-half_width, half_width, POINTS)
    corners = ROUND if shoulders else np.array([[1.0, -1.0], [0.0, 0.0]])
    plane = lambda z, ways: np.stack([ways[0], 0 * ways[0], ways[1], 0 * ways[0], z * ways[0]])  # noqa: E731
    frictions = [plane(z, ROUND) for z in places]
    teeth = [plane(z, corners) for z in (half_width, -half_width)]
    pressures = np.array([[0.0, 1.0, 0.0, -z, 0.0] for z in places]).T
    balance = np.hstack([pressures, *frictions, *teeth, np.zeros((5, 1))])
    count, ways = balance.shape[1], corners.shape[1]
    limits = np.zeros((POINTS + 2, count))
    for k in range(POINTS):
        limits[k, k], limits[k, POINTS + k * SIDES : POINTS + (k + 1) * SIDES] = -mu, 1.0
    for k in range(2):
        begin = POINTS * (1 + SIDES) + k * ways
        limits[POINTS + k, begin : begin + ways], limits[POINTS + k, -1] = 1.0, -1.0
    pulled = reaction[:5] + np.array([0.0, straps.sum(), 0.0, -half_width * (straps[0] - straps[1]), 0.0])
    cost = np.zeros(count)
    cost[-1] = 1.0
    done = linprog(cost, limits, np.zeros(POINTS + 2), balance, pulled)
    return done.fun if done.status == 0 else np.inf


def least_straps(reaction, half_width):
    """The smallest sum of strap tensions at both ends beside any pressure along the line: a linear programme."""
    places = np.linspace(-half_width, half_width, POINTS)
    pressures = np.stack([np.ones(POINTS), -places])
    straps = np.array([[-1.0, -1.0], [half_width, -half_width]])
    cost = np.r_[np.zeros(POINTS), 1.0, 1.0]
    done = linprog(cost, A_eq=np.hstack([pressures, straps]), b_eq=[reaction[1], reaction[3]])
    return done.x[-2:]


def ends(reaction, half_width):
    tilt, twist = reaction[3] / half_width, reaction[4] / half_width
    return 0.5 * (reaction[1] + np.array([-tilt, tilt])), 0.5 * (reaction[0] + np.array([twist, -twist]))


@pytest.mark.slow
@pytest.mark.parametrize("shoulders", [True, False])
@pytest.mark.parametrize("mu", [0.0, 0.15, 0.4])
def test_tooth_forces_are_the_least_of_a_linear_programme(mu, shoulders):
    """On random wrenches, some of which friction holds, some of which lift an end. Polygons are up to 0.0012 inside."""
    rng, finite, zero = np.random.default_rng(5), 0, 0
    for _ in range(40):
        half_width = rng.uniform(1.0, 4.0)
        reaction = rng.normal(size=5) * [2.0, 3.0, 0.4, 6.0, 6.0] + [0.0, 3.0, 0.0, 0.0, 0.0]
        normal, side = ends(reaction, half_width)
        straps = np.maximum(-normal, 0.0)
        programme = least(reaction, half_width, mu, straps, shoulders)
        force = float(least_tooth_force(normal, side, np.array(reaction[2]), mu, shoulders))
        if np.isinf(force):
            assert not shoulders and abs(reaction[2]) > 0.998 * mu * np.maximum(normal, 0.0).sum()
            assert programme == np.inf
            continue
        finite, zero = finite + 1, zero + (force == 0.0)
        scale = np.abs(side).max() + np.abs(reaction[2]) + mu * np.abs(normal).max()
        assert -1e-7 < programme - force < 3e-3 * scale or abs(reaction[2]) > 0.99 * mu * np.maximum(normal, 0.0).sum()
    assert finite > (5 if mu or shoulders else -1) and (zero > 0 or mu < 0.3)


def test_strap_forces_are_the_least_of_a_linear_programme():
    rng = np.random.default_rng(8)
    for half_width in (0.5, 1.0):
        chain = pitch_yaw(4)
        chain = chain.replace(joints=[replace(joint, half_width=half_width) for joint in chain.joints])
        for _ in range(10):
            pull = WorldForce(-1, tuple(0.6 * rng.normal(size=3)), tuple(6.0 * rng.normal(size=3)))
            at = solve_tensions(chain, rng.uniform(0.1, 3.0, 4), [pull])
            for reaction, straps in zip(at.reactions, at.strap_forces, strict=True):
                assert straps == pytest.approx(least_straps(reaction, half_width), abs=1e-7)
            assert np.all((at.strap_forces > 0.0).any(axis=1) == (at.tilting_margins < 0.0))


def test_tooth_margins_are_the_reference():
    for case in reference.cases():
        at = reference.solved(case)
        for margin, checks in zip(at.tooth_margins(), case["expected"]["contact_checks"], strict=True):
            assert margin == (np.inf if checks is None else pytest.approx(checks["tooth_margin"], abs=1e-9))


def test_no_force_is_left_to_teeth_and_straps_where_friction_and_pressure_hold():
    chain = random_chain(np.random.default_rng(1), n=6, joint=hinged)
    for seed in range(6):
        rng = np.random.default_rng(seed)
        at = solve_tensions(chain, rng.uniform(1.0, 6.0, 4), random_loads(rng, chain, False))
        required = at.friction_required
        for mu in (0.05, 0.3):
            forces = at.tooth_forces(mu)
            lifted = np.isinf(required)
            assert np.array_equal(forces[~lifted] > 1e-9, required[~lifted] > mu + 1e-9)
            assert np.all(forces <= at.tooth_forces(0.0) + 1e-9) and np.all(forces <= at.tooth_forces(mu, False) + 1e-9)
        hinges = np.array([not np.isfinite(joint.line) for joint in chain.joints])
        assert not forces[hinges].any() and not at.strap_forces[hinges].any()
        assert np.all(np.isinf(at.tooth_margins()[hinges]))


def test_frames_are_those_of_the_surfaces_and_batches_are_single_solves():
    chain = random_chain(np.random.default_rng(2), n=6, joint=hinged)
    tensions = np.random.default_rng(3).uniform(1.0, 5.0, (4, 4))
    rows = solve_tensions_batch(chain, tensions)
    for k, row in enumerate(tensions):
        at = solve_tensions(chain, row)
        assert at.contact_frames == pytest.approx(contact_frames(chain, at), abs=1e-9)
        for name in ("contact_frames", "strap_forces"):
            assert getattr(rows, name)[k] == pytest.approx(getattr(at, name), abs=1e-7)
        assert rows.tooth_forces(0.1)[k] == pytest.approx(at.tooth_forces(0.1), abs=1e-7)


@pytest.mark.parametrize("friction", [np.nan, -0.1, "steel", None, np.inf])
def test_coefficients_that_are_none_are_refused(friction):
    at = solve_tensions(pitch_yaw(2), [2.0] * 4)
    for margins in (at.slip_margins, at.tooth_forces):
        with pytest.raises(InvalidInput, match=r"friction = .*expected a coefficient, 0 or more"):
            margins(friction)
    with pytest.raises(InvalidInput, match="pressure_angle"):
        at.tooth_margins(1.6)
