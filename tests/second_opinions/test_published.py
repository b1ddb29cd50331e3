"""The published algorithms: reference values, their own derivatives, and agreement with the compiled solver."""

from dataclasses import fields

import numpy as np
import pytest

import rollingjoint as rj
from rollingjoint.load import load_table
from tests.second_opinions.published import (
    length_jacobian,
    newton_step,
    solve_lengths_published,
    solve_recursion,
    solve_tensions_published,
)
from tests.second_opinions.published_equations import Configuration, PublishedChain, body_load
from tests.second_opinions.se2 import dual_adjoint, dual_bracket, transform

PUSH = [rj.WorldForce(-1, (0.5, 0.0))]

# Independent converged runs of the published code on exact surfaces: docs/theory.md, section 6.
REFERENCES = [
    (
        (1, 1),
        [],
        (-0.15594338, 0, 0.06710133, 0),
        (-35.03561037, 69.60112173, 0.50177674),
        (90.42168368, 100.25741404),
    ),
    (
        (3, 1),
        [],
        (-5.13349827, -5.07716223, -5.04360711, -5.06756391),
        (-52.50007618, 52.36303285, 1.25320624),
        (84.84775587, 109.527958),
    ),
    (
        (6, 3),
        PUSH,
        (-0.34681328, -1.30887697, -2.135447, -2.87021633),
        (-40.71209929, 65.17434381, 0.78907714),
        (87.90132497, 103.43104757),
    ),
]

EVERY_LOAD = [
    rj.WorldForce(2, (0.3, -0.2), moment=4.0, point=(3.0, -5.0)),
    rj.BodyWrench(-1, (-0.1, 0.4), moment=-2.0, point=(1.0, 6.0)),
    rj.Spring(1, 0.02, anchor=(20.0, 40.0), point=(-4.0, 2.0)),
    rj.Gravity([0.05] * 5, direction=(1.0, -2.0)),
]


@pytest.mark.parametrize(("tensions", "loads", "arc_lengths", "tip", "lengths"), REFERENCES)
def test_tension_recursion_meets_the_reference_values(tensions, loads, arc_lengths, tip, lengths):
    solution = solve_tensions_published(rj.five_link(), tensions, loads)
    assert solution.converged
    assert solution.arc_lengths == pytest.approx(arc_lengths, abs=1e-6)
    assert solution.poses[-1, :2] == pytest.approx(tip[:2], abs=1e-6)
    assert solution.poses[-1, 2] == pytest.approx(tip[2], abs=1e-8)
    assert solution.lengths == pytest.approx(lengths, abs=1e-6)


def test_length_descent_meets_the_reference_least_squares():
    solution = solve_lengths_published(rj.five_link(), (86.02, 107.82))
    assert solution.converged
    assert solution.tensions[0] / solution.tensions[1] == pytest.approx(2.391373, abs=1e-6)
    assert solution.arc_lengths == pytest.approx((-4.245950, -4.173385, -4.131163, -4.164325), abs=1e-6)
    assert solution.poses[-1] == pytest.approx((-49.982644, 55.787229, 1.120584), abs=1e-6)
    assert solution.lengths == pytest.approx((85.559594, 107.627472), abs=1e-6)


def random_case(seed):
    """A mechanism, tensions and loads drawn from a seed."""
    rng = np.random.default_rng(seed)
    mechanism = (rj.five_link(), rj.uniform(n=int(rng.integers(2, 8))), rj.two_segment())[seed % 3]
    tensions = rng.uniform(2.0, 6.0, mechanism.n_tendons)
    link = int(rng.integers(1, mechanism.n_links))
    loads = [
        rj.WorldForce(link, rng.uniform(-0.3, 0.3, 2), rng.uniform(-2, 2), rng.uniform(-5, 5, 2)),
        rj.BodyWrench(-1, rng.uniform(-0.1, 0.1, 2), point=rng.uniform(-5, 5, 2)),
        rj.Spring(-1, rng.uniform(0.0, 0.002), rng.uniform(-50, 50, 2), rng.uniform(-5, 5, 2)),
        rj.Gravity(rng.uniform(0.0, 0.03, mechanism.n_links)),
    ]
    return mechanism, tensions, loads[: int(rng.integers(0, 5))]


@pytest.mark.slow
def test_tension_recursion_equals_the_compiled_solver_on_random_cases():
    compared = 0
    for seed in range(60):
        mechanism, tensions, loads = random_case(seed)
        published = solve_tensions_published(mechanism, tensions, loads)
        compiled = rj.solve_tensions(mechanism, tensions, loads)
        if not published.converged or compiled.status != rj.Status.CONVERGED:
            continue
        compared += 1
        for quantity in ("arc_lengths", "contact_forces", "lengths"):
            np.testing.assert_allclose(
                getattr(published, quantity),
                getattr(compiled, quantity),
                rtol=0,
                atol=1e-8,
                err_msg=f"{seed}",
            )
        np.testing.assert_allclose(published.poses[:, :2], compiled.poses[:, :2], rtol=0, atol=1e-8)
        np.testing.assert_allclose(published.poses[:, 2], compiled.poses[:, 2], rtol=0, atol=1e-10)
    assert compared >= 50


def test_length_descent_equals_the_compiled_least_squares_without_loads():
    compared = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        mechanism = (rj.five_link(), rj.uniform(n=int(rng.integers(2, 8))))[seed % 2]
        reachable = rj.solve_tensions(mechanism, rng.uniform(2.0, 6.0, 2)).lengths
        desired = reachable + rng.uniform(-1.0, 1.0, 2)
        published = solve_lengths_published(mechanism, desired)
        compiled = rj.solve_lengths(mechanism, desired, method="least_squares")
        if not published.converged or compiled.status != rj.Status.CONVERGED:
            continue
        compared += 1
        np.testing.assert_allclose(published.poses, compiled.poses, rtol=0, atol=1e-9)
        np.testing.assert_allclose(published.lengths, compiled.lengths, rtol=0, atol=1e-9)
    assert compared >= 15


@pytest.mark.parametrize("tensions", [(6.0, 3.0), (4.0, 5.0)])
def test_compiled_least_squares_under_a_load_is_where_the_published_descent_rests(tensions):
    mechanism = rj.five_link()
    desired = rj.solve_tensions(mechanism, tensions, PUSH).lengths
    compiled = rj.solve_lengths(mechanism, desired, PUSH, method="least_squares")
    published = solve_lengths_published(
        mechanism, desired, PUSH, tensions=compiled.tensions, start=compiled, gradient_tolerance=1e-8
    )
    assert published.converged
    np.testing.assert_allclose(published.poses, compiled.poses, rtol=0, atol=1e-8)
    np.testing.assert_allclose(published.tensions, compiled.tensions, rtol=0, atol=1e-7)


def test_published_descent_under_a_load_creeps_towards_the_compiled_answer():
    mechanism = rj.five_link()
    compiled = rj.solve_lengths(
        mechanism, rj.solve_tensions(mechanism, (6, 3), PUSH).lengths, PUSH, method="least_squares"
    )
    distances = []
    for steps in (20, 100, 300):
        published = solve_lengths_published(mechanism, compiled.lengths, PUSH, tensions=(5, 3), max_iterations=steps)
        distances.append(np.linalg.norm(published.poses[-1, :2] - compiled.tip))
        assert published.iterations == steps and not published.converged
    assert distances[0] > distances[1] > distances[2] > 0.1


def loaded_state(change=0.0, direction=None):
    """A state of the five-link mechanism away from equilibrium, moved by change along direction (n-1, 3)."""
    direction = np.zeros((4, 3)) if direction is None else direction
    s = np.array([-2.0, 1.5, 3.0, -4.0]) + change * direction[:, 0]
    f = np.array([[0.3, 5.0], [-0.5, 7.0], [0.2, 6.0], [1.0, 8.0]]) + change * direction[:, 1:]
    return Configuration(PublishedChain(rj.five_link(), EVERY_LOAD), s, f, np.array([4.0, 3.0]))


def test_recursion_inverts_the_central_difference_of_the_residuals():
    direction = np.random.default_rng(1).normal(size=(4, 3))
    slope = (loaded_state(1e-5, direction).h - loaded_state(-1e-5, direction).h) / 2e-5
    right_hand_sides = np.zeros((5, 6, 1))
    right_hand_sides[:, 3:, 0] = slope
    recovered = solve_recursion(loaded_state(), right_hand_sides)[:-1, 3:, 0]
    np.testing.assert_allclose(recovered, direction, rtol=0, atol=1e-6)


def test_newton_step_from_near_equilibrium_squares_the_residual():
    solution = solve_tensions_published(rj.five_link(), (4, 3), EVERY_LOAD)
    problem = PublishedChain(rj.five_link(), EVERY_LOAD)
    near = Configuration(problem, solution.arc_lengths + 1e-3, solution.contact_forces, solution.tensions)
    step = newton_step(near)
    after = Configuration(problem, near.s + step[:, 0], near.f + step[:, 1:], near.tau)
    assert after.residual < 1e-3 * near.residual


def test_length_jacobian_equals_central_differences_of_resolved_lengths():
    mechanism, tensions, h = rj.five_link(), np.array([4.0, 3.0]), 1e-4
    solution = solve_tensions_published(mechanism, tensions, EVERY_LOAD)
    state = Configuration(
        PublishedChain(mechanism, EVERY_LOAD), solution.arc_lengths, solution.contact_forces, tensions
    )
    columns = [
        solve_tensions_published(mechanism, tensions + h * unit, EVERY_LOAD).lengths
        - solve_tensions_published(mechanism, tensions - h * unit, EVERY_LOAD).lengths
        for unit in np.eye(2)
    ]
    np.testing.assert_allclose(length_jacobian(state)[0], np.stack(columns, axis=1) / (2 * h), rtol=0, atol=1e-6)


@pytest.mark.parametrize("load", EVERY_LOAD, ids=lambda load: type(load).__name__)
def test_load_derivative_equals_central_differences(load):
    table = load_table([load], 5)
    rows = table[table[:, 0] == table[-1, 0]]
    pose, h = transform(np.array([-12.0, 55.0]), 0.7), 1e-6
    columns = []
    for unit in np.eye(3):
        generator = np.zeros((3, 3))
        generator[:2, :2], generator[:2, 2] = [[0, -unit[0]], [unit[0], 0]], unit[1:]
        forward, _ = body_load(rows, pose @ (np.eye(3) + h * generator + 0.5 * h**2 * generator @ generator))
        backward, _ = body_load(rows, pose @ (np.eye(3) - h * generator + 0.5 * h**2 * generator @ generator))
        columns.append((forward - backward) / (2 * h))
    np.testing.assert_allclose(body_load(rows, pose)[1], np.stack(columns, axis=1), rtol=0, atol=1e-7)


def test_dual_adjoint_changes_along_a_surface_as_equation_8_says():
    surface, s, h = rj.five_link().links[0].child, 4.0, 1e-6
    frames = [transform(pose[:2], pose[2]) for pose in surface.pose(np.array([s - h, s, s + h]))]
    velocity = np.array([surface.curvature(s), 1.0, 0.0])
    slope = (dual_adjoint(frames[2]) - dual_adjoint(frames[0])) / (2 * h)
    np.testing.assert_allclose(slope, dual_adjoint(frames[1]) @ dual_bracket(velocity), rtol=0, atol=1e-8)


def test_following_a_growing_load_reaches_what_a_cold_start_does_not():
    mechanism, solution = rj.five_link(), None
    assert not solve_tensions_published(mechanism, (6, 3), [rj.WorldForce(-1, (1.5, 0.0))]).converged
    for force in (0.5, 1.0, 1.5):
        solution = solve_tensions_published(mechanism, (6, 3), [rj.WorldForce(-1, (force, 0.0))], start=solution)
        assert solution.converged
    compiled = rj.solve_tensions(mechanism, (6, 3), [rj.WorldForce(-1, (1.5, 0.0))])
    np.testing.assert_allclose(solution.poses, compiled.poses, rtol=0, atol=1e-8)


@pytest.mark.parametrize("tensions", [(np.nan, 1), (np.inf, 1), (0, 0), (-3, -2), (1e200, 1e-200)])
@pytest.mark.parametrize("force", [0.0, 1e3, 1e300, np.nan, np.inf])
def test_bad_numbers_give_finite_results_that_do_not_claim_convergence(tensions, force):
    loads = [rj.WorldForce(-1, (force, 0.0))]
    given = solve_tensions_published(rj.five_link(), tensions, loads)
    asked = solve_lengths_published(rj.five_link(), tensions, loads, tensions=tensions, max_iterations=20)
    for solution in (given, asked):
        assert all(np.all(np.isfinite(getattr(solution, field.name))) for field in fields(solution))
        if not np.all(np.isfinite([*tensions, force])):
            assert not solution.converged


def test_wrong_numbers_of_tensions_or_joints_are_named():
    with pytest.raises(rj.InvalidInput, match=r"tensions.*2 numbers, one per tendon"):
        solve_tensions_published(rj.five_link(), (1, 2, 3))
    with pytest.raises(rj.InvalidInput, match=r"start.*4 joints"):
        solve_tensions_published(rj.five_link(), (1, 2), start=solve_tensions_published(rj.uniform(n=3), (1, 2)))
