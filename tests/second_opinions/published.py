"""The published algorithms for rolling-contact chains, in plain NumPy: an independent second opinion.

J. Ha, C. Kim and C. Kim, "Incorporating General Contact Surfaces in the Kinematics of Tendon-Driven
Rolling-Contact Joint Mechanisms". Symbols and equation numbers are the paper's, except that links count from 0:
joint i lies between the child surface of link i and the parent surface of link i + 1. The unknowns are the arc
lengths s_i and the contact forces f_i, six equations a link, solved by the recursion of sec. IV-C; tendon lengths
are met by the gradient method of sec. V-C. Nothing is shared with the compiled solver but the surfaces.

Where the printed equations had to be read with care (the tests check every derivative by finite differences):
- (27): the I is the 6x3 matrix [I; 0], because delta eta_n = 0.
- (45): the second adjoint in D_s,i is that of T_c,i.
- (52): printed as a row; it is the first column (-[q]^T R^T [f]; R^T [f]) of a 3x3 matrix, as (51) shows.
- (55): right for a spring at the body's origin; at a point p the row of moments gains p x (force row).
- sec. V-C, step 5 computes the changes of the tensions, arc lengths and forces, not their values.
The paper leaves open the starting values, the step size alpha and what happens at the end of a surface: here s = 0,
f = (0, sum of tensions), alpha = 1/|J|^2, and an iteration that leaves a surface stops as not converged.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.chain.rolling import RollingChain, planar
from rollingjoint.checks import as_vector
from rollingjoint.errors import InvalidInput
from rollingjoint.load import Load
from tests.second_opinions.published_equations import Configuration, PublishedChain

if TYPE_CHECKING:
    from rollingjoint.chain.equilibrium import Equilibrium

Array = NDArray[np.float64]
_LARGEST = float(np.finfo(float).max)


@dataclass(frozen=True)
class PublishedSolution:
    """Where a published algorithm stopped; every number is finite, whether or not it converged.

    arc_lengths (n-1,) [mm]; contact_forces (n-1, 2) [N], tangential and normal on the distal link; poses (n, 3)
    as x, y [mm], angle [rad]; tensions (m,) [N]; lengths (m,) [mm]; residual: largest entry of (10) [N, N·mm];
    gradient: largest entry of (36) [mm²/N], 0 under given tensions.
    """

    arc_lengths: Array
    contact_forces: Array
    poses: Array
    tensions: Array
    lengths: Array
    iterations: int
    residual: float
    gradient: float
    converged: bool


def solve_tensions_published(
    mechanism: RollingChain,
    tensions: ArrayLike,
    loads: Sequence[Load] = (),
    start: PublishedSolution | Equilibrium | None = None,
    tolerance: float = 1e-10,
    max_iterations: int = 100,
) -> PublishedSolution:
    """Equilibrium under given tensions (m,) [N] by the plain Newton recursion of sec. IV-C.

    It stops as converged when every entry of (10) is within tolerance [N, N·mm]. Raises InvalidInput for wrong
    shapes only. Source: rolling-contact paper, (9), (10), (20)-(27).
    """
    tau, valid = _finite_inputs("tensions", tensions, planar(mechanism).n_tendons)
    s, f = _starting_values(mechanism, tau, start)
    with np.errstate(all="ignore"):
        state = Configuration(PublishedChain(mechanism, loads), s, f, tau)
        iterations = 0
        while not state.balanced(tolerance) and iterations < max_iterations:
            next_state = _moved(state, _correction(state), np.zeros_like(tau))
            if next_state is None:
                break
            state, iterations = next_state, iterations + 1
        return _solution(state, iterations, 0.0, valid and state.balanced(tolerance))


def solve_lengths_published(
    mechanism: RollingChain,
    lengths: ArrayLike,
    loads: Sequence[Load] = (),
    tensions: ArrayLike | None = None,
    start: PublishedSolution | Equilibrium | None = None,
    step: float | None = None,
    tolerance: float = 1e-10,
    gradient_tolerance: float = 1e-10,
    max_iterations: int = 2000,
) -> PublishedSolution:
    """Equilibrium whose tendon lengths are nearest the lengths asked for (m,) [mm], by sec. V-C.

    tensions: starting values (m,) [N], default ones. step: the paper's fixed alpha [N²/mm²]; None takes
    1/|J|² (spectral norm) anew in every iteration. gradient_tolerance bounds every entry of (36) [mm²/N]. The
    tensions are not kept positive: the paper has no such step. Raises InvalidInput for wrong shapes only.
    Source: rolling-contact paper, (28)-(37).
    """
    m = planar(mechanism).n_tendons
    desired, lengths_valid = _finite_inputs("lengths", lengths, m)
    tau, tensions_valid = _finite_inputs("tensions", np.ones(m) if tensions is None else tensions, m)
    s, f = _starting_values(mechanism, tau, start)
    with np.errstate(all="ignore"):
        state = Configuration(PublishedChain(mechanism, loads), s, f, tau)
        iterations = 0
        gradient, change, delta_tau = _descent(state, desired, step)
        while not (done := state.balanced(tolerance) and gradient <= gradient_tolerance):
            next_state = _moved(state, change, delta_tau)
            if next_state is None or iterations == max_iterations:
                break
            state, iterations = next_state, iterations + 1
            gradient, change, delta_tau = _descent(state, desired, step)
        return _solution(state, iterations, gradient, done and lengths_valid and tensions_valid)


def solve_recursion(state: Configuration, right_hand_sides: Array) -> Array:
    """Changes delta x_i (n, 6, k) of (21) for right-hand sides epsilon_i (n, 6, k); raises LinAlgError."""
    n, k = right_hand_sides.shape[0], right_hand_sides.shape[2]
    product, constant = np.eye(6), np.zeros((6, k))
    for (P, Q), epsilon in zip(state.recursions, right_hand_sides[1:], strict=True):
        product, constant = P @ product, P @ constant + Q @ epsilon  # (25), (26)
    ends = np.linalg.solve(np.hstack([np.eye(6)[:, :3], -product[:, 3:]]), constant)  # (27)
    x = np.zeros((n, 6, k))
    x[0, 3:] = ends[3:]
    for i, (P, Q) in enumerate(state.recursions, start=1):
        x[i] = P @ x[i - 1] + Q @ right_hand_sides[i]
    return x


def newton_step(state: Configuration) -> Array:
    """Changes (n-1, 3) of (s_i, f_i) that cancel the residuals to first order (steps 2 and 3 of both algorithms)."""
    epsilon = np.zeros((state.problem.n, 6, 1))
    epsilon[:, 3:, 0] = -state.h
    return solve_recursion(state, epsilon)[:-1, 3:, 0]


def length_jacobian(state: Configuration) -> tuple[Array, Array]:
    """J (m, m) of (35) and the rows (n-1, 3, m) of H_i (34) for (s_i, f_i), by one impulse a tendon."""
    epsilon = np.zeros((state.problem.n, 6, len(state.tau)))
    epsilon[:, 3:] = -state.F  # (32)
    H = solve_recursion(state, epsilon)[:-1, 3:]
    return state.dgaps @ H[:, 0], H


def _descent(state: Configuration, desired: Array, step: float | None) -> tuple[float, Array | None, Array]:
    """Largest entry of g (36), and the changes of (s_i, f_i) and of the tensions in steps 3 to 6 of sec. V-C.

    The same blocks serve the correction of (10) and the impulse tests, as the frames change only in step 2. The
    largest float and no change where the chain is singular.
    """
    try:
        J, H = length_jacobian(state)
        gradient = (state.lengths - desired) @ J
        alpha = 1.0 / np.linalg.norm(J, 2) ** 2 if step is None else step
        delta_tau = -alpha * gradient  # (37)
        return float(np.abs(gradient).max()), newton_step(state) + H @ delta_tau, delta_tau
    except np.linalg.LinAlgError:
        return _LARGEST, None, np.zeros_like(desired)


def _correction(state: Configuration) -> Array | None:
    try:
        return newton_step(state)
    except np.linalg.LinAlgError:
        return None


def _moved(state: Configuration, change: Array | None, delta_tau: Array) -> Configuration | None:
    """The state after a change (n-1, 3) of (s_i, f_i), or None where it is not finite or leaves a surface."""
    if change is None:
        return None
    s, f, tau = state.s + change[:, 0], state.f + change[:, 1:], state.tau + delta_tau
    low, high = state.problem.limits.T
    if not (np.all((s >= low) & (s <= high)) and np.all(np.isfinite(f)) and np.all(np.isfinite(tau))):
        return None
    moved = Configuration(state.problem, s, f, tau)
    return moved if np.isfinite(moved.residual) else None


def _solution(state: Configuration, iterations: int, gradient: float, converged: bool) -> PublishedSolution:
    poses = np.array([(T[0, 2], T[1, 2], 0.0) for T in state.T])
    poses[1:, 2] = np.cumsum(state.angles)
    residual, gradient = np.nan_to_num([state.residual, gradient], nan=_LARGEST).tolist()
    return PublishedSolution(
        state.s, state.f, poses, state.tau, state.lengths, iterations, residual, gradient, converged
    )


def _finite_inputs(name: str, values: ArrayLike, m: int) -> tuple[Array, bool]:
    """The values as floats with 0 in place of what is not finite, and whether all were finite."""
    array = as_vector(name, values, m, "one per tendon")
    finite = np.isfinite(array)
    return np.where(finite, array, 0.0), bool(finite.all())


def _starting_values(
    mechanism: RollingChain, tau: Array, start: PublishedSolution | Equilibrium | None
) -> tuple[Array, Array]:
    """s and f of the start, or s = 0 and the sum of the tensions across each joint pressing on it."""
    if start is not None:
        if np.shape(start.arc_lengths) != (mechanism.n_joints,):
            raise InvalidInput("start", start.arc_lengths, f"a solution of a chain with {mechanism.n_joints} joints")
        return np.clip(start.arc_lengths, *mechanism.joint_limits.T), np.array(start.contact_forces, float)
    f = np.zeros((mechanism.n_joints, 2))
    for tension, holes in zip(tau, mechanism.hole_points, strict=True):
        f[: len(holes) - 1, 1] += tension
    return np.zeros(mechanism.n_joints), f
