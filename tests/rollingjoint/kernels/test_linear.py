"""Linear algebra on the free joints of a chain, part by part, against NumPy's."""

import numpy as np
import pytest

from rollingjoint._numba.jit import standalone
from rollingjoint.kernels import linear, long_chain, long_lu, newton

cholesky, cholesky_solve = standalone(linear.cholesky), standalone(linear.cholesky_solve)
largest, smallest_real_part = standalone(linear.largest), standalone(linear.smallest_real_part)
descent_step, downhill_step = standalone(linear.descent_step), standalone(linear.downhill_step)
lu_step, damped_step = standalone(linear.lu_step), standalone(linear.damped_step)
new_sweep, factor, substitute = map(standalone, (long_chain.new_sweep, long_chain.factor, long_chain.substitute))
first_shift = standalone(long_chain.first_shift)
factor_lu, substitute_lu = map(standalone, (long_lu.factor_lu, long_lu.substitute_lu))
escape_direction = standalone(newton.escape_direction)

N = 6
MASKS = ([True, False, True, True, False, True], [False, True, True, True, True, False])


@pytest.fixture
def rng():
    return np.random.default_rng(0)


@pytest.fixture(params=MASKS, ids=["the last joint is free", "the last joint is held"])
def free(request):
    return np.array(request.param)


def matrix(rng, free, *eigenvalues):
    """A symmetric matrix whose free joints have these eigenvalues; held ones have large entries."""
    turn, _ = np.linalg.qr(rng.normal(size=(4, 4)))
    H = 100.0 * rng.normal(size=(N, N))
    H[np.ix_(free, free)] = turn @ np.diag(eigenvalues) @ turn.T
    return H


def among(H, free):
    """The rows and columns of the free joints."""
    return H[np.ix_(free, free)]


def spread(values, free):
    """Values of the free joints, zero at the held ones."""
    step = np.zeros(N)
    step[free] = values
    return step


def test_the_cholesky_factor_is_of_the_shifted_symmetric_part(rng, free):
    H, L = matrix(rng, free, 1.0, 2.0, 5.0, 9.0), np.full((N, N), np.nan)
    skew = rng.normal(size=(N, N))
    ratio = cholesky(H + skew - skew.T, free, 0.5, L)
    symmetric = 0.5 * (among(H, free) + among(H, free).T) + 0.5 * np.eye(4)
    expected = np.linalg.cholesky(symmetric)
    np.testing.assert_allclose(np.tril(among(L, free)), expected, rtol=0, atol=1e-12)
    size = np.abs(among(H + skew - skew.T, free)).max() + 0.5
    assert ratio == pytest.approx(np.min(np.diag(expected) ** 2) / size, rel=1e-9)
    assert cholesky(matrix(rng, free, -1e-3, 2.0, 5.0, 9.0), free, 0.0, L) == -1.0
    assert cholesky(H, np.zeros(N, bool), 0.0, L) == 1.0


@pytest.mark.slow
@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e5])
def test_steps_on_free_joints_are_newtons_and_held_joints_stay(rng, free, scale):
    H, r = scale * matrix(rng, free, 1.0, 2.0, 5.0, 9.0), scale * rng.normal(size=N)
    expected, L = spread(np.linalg.solve(among(H, free), -r[free]), free), np.empty((N, N))
    for solve in (
        lambda out: cholesky(H, free, 0.0, L) > 0.0 and cholesky_solve(L, free, r, out),
        lambda out: descent_step(H, free, r, L, out),
        lambda out: downhill_step(H, free, r, L, out),
        lambda out: lu_step(H, free, r, out),
        lambda out: damped_step(H, free, r, 0.0, L, out),
    ):
        step = np.full(N, 7.0)
        solve(step)
        np.testing.assert_allclose(step, expected, rtol=1e-9, atol=0)


def test_along_negative_curvature_a_step_descends_by_its_magnitude(rng, free):
    H, r, step = matrix(rng, free, -3.0, -0.5, 2.0, 9.0), rng.normal(size=N), np.full(N, 7.0)
    values, vectors = np.linalg.eigh(among(H, free))
    descent_step(H, free, r, np.empty((N, N)), step)
    expected = spread(-vectors @ ((vectors.T @ r[free]) / np.abs(values)), free)
    np.testing.assert_allclose(step, expected, rtol=1e-9, atol=1e-12)
    assert step @ r < 0.0


def test_where_curvature_vanishes_a_step_is_long_and_finite(rng, free):
    H, r, step = matrix(rng, free, 0.0, 1.0, 2.0, 4.0), rng.normal(size=N), np.empty(N)
    descent_step(H, free, r, np.empty((N, N)), step)
    assert np.abs(step).max() == pytest.approx(
        np.abs(r[free] @ np.linalg.eigh(among(H, free))[1][:, 0]) * 2.5e9, rel=2.0
    )
    H[np.ix_(free, free)] = 0.0
    descent_step(H, free, r, np.empty((N, N)), step)
    assert np.all(np.isfinite(step)) and np.all(step[~free] == 0.0)


def test_elimination_takes_unsymmetric_matrices_and_refuses_singular_ones(rng, free):
    A, r, step = 3.0 * np.eye(N) + rng.normal(size=(N, N)), rng.normal(size=N), np.full(N, 7.0)
    first, second = np.flatnonzero(free)[:2]
    A[first, first] = 0.0  # the first pivot is another row's
    assert lu_step(A, free, r, step)
    np.testing.assert_allclose(step, spread(np.linalg.solve(among(A, free), -r[free]), free), rtol=1e-10, atol=1e-13)
    A[second] = 2.0 * A[first]
    assert not lu_step(A, free, r, step)


def test_elimination_without_exchange_says_where_it_does_not_descend(rng, free):
    A, r, step = 5.0 * np.eye(N) + rng.normal(size=(N, N)), rng.normal(size=N), np.full(N, 7.0)
    assert downhill_step(A, free, r, np.empty((N, N)), step)
    np.testing.assert_allclose(step, spread(np.linalg.solve(among(A, free), -r[free]), free), rtol=1e-10, atol=1e-13)
    assert not downhill_step(-A, free, r, np.empty((N, N)), step)
    first, second = np.flatnonzero(free)[:2]
    turning, uphill = np.eye(N), np.zeros(N)
    turning[first, second], turning[second, first] = 9.0, -9.0
    turning[first, first], turning[second, second] = 1e-3, -1e-3  # pivots are positive, and the step turns too far
    uphill[first] = 1.0
    assert not downhill_step(turning, free, uphill, np.empty((N, N)), step)


def test_a_damped_step_is_that_of_levenberg_and_marquardt(rng, free):
    A, r, step = rng.normal(size=(N, N)), rng.normal(size=N), np.full(N, 7.0)
    damped_step(A, free, r, 0.3, np.empty((N, N)), step)
    normal = among(A, free).T @ among(A, free)
    expected = np.linalg.solve(normal + 0.3 * np.abs(normal).max() * np.eye(4), -among(A, free).T @ r[free])
    np.testing.assert_allclose(step, spread(expected, free), rtol=1e-9, atol=1e-13)
    first, second = np.flatnonzero(free)[:2]
    A[first], A[:, first] = A[second], A[:, second]  # singular: damped as little as it needs
    damped_step(A, free, r, 0.0, np.empty((N, N)), step)
    gradient = among(A, free).T @ r[free]
    assert np.all(np.isfinite(step)) and step[free] @ gradient < 0.0


@pytest.mark.slow
def test_the_leftmost_eigenvalue_and_the_largest_entry_are_of_the_free_joints(rng, free):
    A = rng.normal(size=(N, N))
    A[1] = A[:, 4] = 50.0
    assert smallest_real_part(A, free) == pytest.approx(np.linalg.eigvals(among(A, free)).real.min())
    assert largest(A, free) == np.abs(among(A, free)).max()


def test_a_saddle_is_left_along_its_most_negative_curvature(rng, free):
    H, step = matrix(rng, free, -3.0, -0.5, 2.0, 9.0), np.full(N, 7.0)
    escape_direction(H, free, step)
    vector = np.linalg.eigh(among(H, free))[1][:, 0]
    leader = vector[np.argmax(np.abs(vector))]
    np.testing.assert_allclose(step, spread(0.1 * np.sign(leader) * vector, free), rtol=1e-9, atol=1e-13)


def filled_sweep(rng, columns):
    """A Sweep of a positive definite matrix, and the matrix."""
    sweep = new_sweep(N, columns)
    sweep.U[:], sweep.V[:] = rng.normal(size=(N, columns)), rng.normal(size=(N, columns))
    below = np.tril(sweep.U @ sweep.V.T, -1)
    sweep.diagonal[:] = np.abs(below + below.T).sum(1) + rng.uniform(1.0, 2.0, N)
    return sweep, below + below.T + np.diag(sweep.diagonal)


def test_the_sweep_of_a_long_chain_is_the_dense_factor(rng, free):
    sweep, H = filled_sweep(rng, 2)
    r, step = rng.normal(size=N), np.full(N, 7.0)
    pivots = np.diag(np.linalg.cholesky(among(H, free) + 0.7 * np.eye(4))) ** 2
    size = sweep.diagonal[free].max() + 0.7
    assert factor(sweep, free, 0.7) == pytest.approx(pivots.min() / size)
    substitute(sweep, free, r, step)
    np.testing.assert_allclose(
        step, spread(np.linalg.solve(among(H, free) + 0.7 * np.eye(4), -r[free]), free), rtol=1e-10
    )


@pytest.mark.slow
@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e4])
def test_an_indefinite_long_chain_is_shifted_no_more_than_four_times_too_much(rng, free, scale):
    sweep, H = filled_sweep(rng, 2)
    sweep.diagonal[:] -= np.linalg.eigvalsh(H)[1]
    sweep.U[:], sweep.diagonal[:] = scale * sweep.U, scale * sweep.diagonal
    lowest = np.linalg.eigvalsh(scale * (H - np.diag(np.diag(H))) + np.diag(sweep.diagonal))[0]
    everything = np.ones(N, bool)
    shift = first_shift(sweep, everything)
    assert -lowest < shift <= 4.0 * -lowest * (1.0 + 1e-6)


def test_the_unsymmetric_sweep_is_elimination_without_exchange(rng, free):
    lower, upper = (N, 2), (N, 3)
    lu = long_lu.LongLu(*map(np.zeros, (lower, lower, upper, upper, lower, upper, N)))
    for generators in (lu.U, lu.V, lu.P, lu.Q):
        generators[:] = rng.normal(size=generators.shape)
    A = np.tril(lu.U @ lu.V.T, -1) + np.triu(lu.P @ lu.Q.T, 1)
    diagonal = np.abs(A).sum(1) + np.abs(A).sum(0)
    r, step = rng.normal(size=N), np.full(N, 7.0)
    dense = among(A + np.diag(diagonal), free) + 0.4 * np.eye(4)
    minors = [1.0, *(np.linalg.det(dense[:k, :k]) for k in range(1, 5))]
    pivots = np.divide(minors[1:], minors[:-1])
    assert factor_lu(lu, diagonal, free, 0.4) == pytest.approx(pivots.min() / (diagonal[free].max() + 0.4))
    substitute_lu(lu, free, r, step)
    np.testing.assert_allclose(step, spread(np.linalg.solve(dense, -r[free]), free), rtol=1e-10, atol=1e-14)
    assert factor_lu(lu, -diagonal, free, 0.0) == -1.0


@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_matrices_that_are_not_finite_raise_nothing(wrong):
    H, free, step = np.diag([2.0, 3.0, 5.0]), np.ones(3, bool), np.zeros(3)
    H[1, 1] = wrong
    assert smallest_real_part(H, free) == -np.inf
    descent_step(H, free, np.array([1.0, -2.0, 4.0]), np.empty((3, 3)), step)
    assert np.array_equal(step, [-1.0, 2.0, -4.0])
    escape_direction(H, free, step)
    assert np.abs(step).max() == pytest.approx(0.1)
    free[1] = False  # what is held does not count
    assert smallest_real_part(H, free) == pytest.approx(2.0)
