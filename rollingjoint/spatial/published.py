"""The published statics of flexible-joint arms, in plain NumPy: an independent second opinion, readable and slow.

W. Feng, K. L. Walker, Y. Yang and F. Giorgio-Serchi, "Computing forward statics from tendon-length in flexible-joint
hyper-redundant manipulators". Symbols and equation numbers are the paper's: twists (w, v) and wrenches (m, f) in link
frames, which are at the mass centres here; A, L, W, G stacked over links; F_t a couple on the last bead of a segment.
FST is Newton's method on the angles (15), FSL on angles and tensions together (27), with the kernel that keeps tensions
positive (30). It shares only the numbers of the chain with the compiled solver.

Corrections, without which derivatives are wrong (the tests check them by finite differences):
- (16) lacks the stiffness K.
- (24): lambda is a compliance [mm/N], and l the length on the motor's side.
- (28): d tau / d f = -J^T dF_t/df, with the sign of (14).
- (31): df/du = f² / (f² + c), with f in place of u; as printed it is 0 at u = 0, where the iteration starts.
- (34), (35) are printed for twists in the other order; see se3.py.
- F_e of (14) acts from the arm on its surroundings: minus the load. A load of fixed direction turns in the tip's frame.

(27) fixes tensions up to co-contraction, which costs no length: of 40 equations for the paper's arm 36 are independent.
It knows no slack tendon, and lengths that no configuration has leave it without a solution.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.chain import se3
from rollingjoint.chain.hinge import HingeChain
from rollingjoint.checks import as_floats, as_vector

Array = NDArray[np.float64]

_RANK = 1e-9  # of the largest singular value; smaller values count as 0
_LONGEST = 0.5  # rad in any hinge in one iteration; the paper leaves the step size alpha open


@dataclass(frozen=True)
class PublishedArmSolution:
    """Last iterate of a published iteration; every number is finite, converged or not.

    joint_angles (n - 1,) [rad]; tensions (m,) [N]; lengths (m,) by (24) [mm]; residual: largest entry of (14) [N·mm];
    misfit: largest difference to the lengths asked for [mm], 0 where tensions were; iterations; converged.
    """

    joint_angles: Array
    tensions: Array
    lengths: Array
    residual: float
    misfit: float
    iterations: int
    converged: bool


class PublishedArm:
    """The statics (14) of a hinge chain under gravity and a wrench of fixed direction at its tip.

    Args:
        chain: beads and tendons; its tendon model is ignored.
        gravity: direction of the weights in the base frame; None for none.
        tip_force, tip_moment: on the arm, base frame [N, N·mm].
    """

    def __init__(
        self,
        chain: HingeChain,
        gravity: Sequence[float] | None = None,
        tip_force: Sequence[float] = (0.0, 0.0, 0.0),
        tip_moment: Sequence[float] = (0.0, 0.0, 0.0),
    ) -> None:
        n, s = chain.n_joints, np.array([bead.spacing for bead in chain.beads])
        axes = np.array([bead.axis for bead in chain.beads], float)
        down = np.zeros(3) if gravity is None else as_floats("gravity", gravity, "three numbers (x, y, z)")
        length = float(np.linalg.norm(down))
        self.V0 = np.concatenate([np.zeros(3), -down / length if length > 0 else down])  # per unit of weight
        self.load = np.array([*tip_moment, *tip_force], float)
        self.K, self.rest = np.array([bead.stiffness for bead in chain.beads]), chain.neutral_angles
        self.G = np.array([[0.0, 0.0, 0.0, *[bead.weight] * 3] for bead in chain.beads]).ravel()
        lever = np.column_stack([np.zeros((n, 2)), -0.5 * s])  # from the mass centre to the hinge
        self.A = np.concatenate([axes, -np.cross(axes, lever)], axis=1)
        before = np.concatenate([[0.0], s[:-1]])  # the base frame is at the first hinge
        self.M = np.array([se3.pose(np.eye(3), (0.0, 0.0, -0.5 * (a + b))) for a, b in zip(before, s, strict=True)])
        self.to_tip = se3.adjoint(se3.pose(np.eye(3), (0.0, 0.0, -0.5 * s[-1])))
        linear = chain.replace(model="linear")
        self.l0 = linear.tendon_lengths(np.zeros(n))
        self.P = np.array([linear.tendon_lengths(e) - self.l0 for e in np.eye(n)]).T  # coupling matrix of (24)
        self.couples = np.zeros((6 * n, chain.n_tendons))  # dF_t / df (29)
        for j, tendon in enumerate(chain.tendons):
            x, y = tendon.link_holes(chain.n_links)[-1]
            first = 6 * (tendon.last_link(chain.n_links) - 1)
            self.couples[first : first + 2, j] = -y, x

    def balance(self, theta: Array, f: Array) -> tuple[Array, Array, Array]:
        """(tau, d tau / d theta, d tau / d f): (14), (16) with K, and -J^T dF_t/df of (28)."""
        n = len(theta)
        T = se3.exp(-self.A * theta[:, None]) @ self.M  # T_{i,i-1}
        steps = se3.adjoint(T)
        moved = -se3.bracket(self.A) @ steps  # d Ad / d theta_i (20)
        L, A = self._stacked(steps)
        JT, V = A.T @ L.T, L[:, :6] @ (steps[0] @ self.V0)
        R = np.eye(3)
        for step in T:
            R = step[:3, :3] @ R  # of the base, seen from the link
        wrench = -np.concatenate([R @ self.load[:3], R @ self.load[3:]])  # F_e, in the tip's frame
        F = -self.couples @ f
        F[-6:] += self.to_tip.T @ wrench
        tau = JT @ (self.G * V + F) + self.K * (theta - self.rest)
        twist = (L @ A)[-6:-3]  # turn of the tip with every hinge, in the tip's frame
        slope = np.diag(self.K)
        outward = L.T @ (self.G * V + F)
        for i in range(n):
            rows = slice(6 * i, 6 * i + 6)
            from_below = V[6 * i - 6 : 6 * i] if i else self.V0
            gain = self.G * (L[:, rows] @ (moved[i] @ from_below))  # G dL Vb + G L dVb
            turned = -np.concatenate([np.cross(twist[:, i], wrench[:3]), np.cross(twist[:, i], wrench[3:])])
            gain[-6:] += self.to_tip.T @ turned
            slope[:, i] += JT @ gain
            if i:  # dL^T = L^T dW^T L^T (19)
                slope[:, i] += JT[:, 6 * i - 6 : 6 * i] @ (moved[i].T @ outward[rows])
        return tau, slope, -JT @ self.couples

    def _stacked(self, steps: Array) -> tuple[Array, Array]:
        """L (43) and A (38)."""
        n = len(steps)
        W, A = np.zeros((6 * n, 6 * n)), np.zeros((6 * n, n))
        for i in range(n):
            A[6 * i : 6 * i + 6, i] = self.A[i]
            if i:
                W[6 * i : 6 * i + 6, 6 * i - 6 : 6 * i] = steps[i]
        return np.asarray(np.linalg.inv(np.eye(6 * n) - W), float), A

    def lengths(self, theta: Array, f: Array, compliance: float) -> Array:
        """Tendon lengths on the motor's side (24), (m,) [mm]."""
        return self.P @ theta + self.l0 - compliance * f


def solve_tensions_published_arm(
    arm: PublishedArm, tensions: ArrayLike, alpha: float = 1.0, tolerance: float = 1e-9, max_iterations: int = 200
) -> PublishedArmSolution:
    """FST: the angles under given tensions (m,) [N], by (15) from the rest angles.

    Converged: every entry of (14) within tolerance [N·mm]. Raises InvalidInput for wrong shapes only.
    """
    f, theta = _per_tendon("tensions", tensions, arm), arm.rest.copy()
    with np.errstate(all="ignore"):
        for count in range(max_iterations + 1):
            tau, slope, _ = arm.balance(theta, f)
            if np.abs(tau).max() <= tolerance or count == max_iterations or not np.all(np.isfinite(slope)):
                break
            theta = theta - alpha * _shortened(np.linalg.pinv(slope, _RANK) @ tau, len(theta))
    return _solution(arm, theta, f, 0.0, tau, 0.0, count, bool(np.abs(tau).max() <= tolerance))


def solve_lengths_published_arm(
    arm: PublishedArm,
    lengths: ArrayLike,
    compliance: float = 0.0,
    c: float = 0.01,
    alpha: float = 1.0,
    tolerance: float = 1e-9,
    max_iterations: int = 200,
) -> PublishedArmSolution:
    """FSL: angles and tensions for given lengths (m,) [mm], by (27) with (30), from the rest angles and u = 0.

    compliance: lambda of (24) [mm/N], the paper's 0 for tendons that do not stretch. c: of the kernel [N²], to which
    a tendon that should be slack still pulls at about c / |u|. Converged: (14) and lengths within tolerance
    [N·mm, mm]. Raises InvalidInput for wrong shapes only.
    """
    targets, theta = _per_tendon("lengths", lengths, arm), arm.rest.copy()
    u, n = np.zeros_like(targets), len(theta)
    with np.errstate(all="ignore"):
        for count in range(max_iterations + 1):
            f = positive(u, c)
            tau, slope, by_tension = arm.balance(theta, f)
            miss = arm.lengths(theta, f, compliance) - targets
            worst = max(np.abs(tau).max(), np.abs(miss).max())
            rate = positive_rate(u, c)
            jacobian = np.block([[slope, by_tension * rate], [arm.P, np.diag(-compliance * rate)]])
            if worst <= tolerance or count == max_iterations or not np.all(np.isfinite(jacobian)):
                break
            step = _shortened(np.linalg.pinv(jacobian, _RANK) @ np.concatenate([tau, miss]), n)
            theta, u = theta - alpha * step[:n], u - alpha * step[n:]
    return _solution(arm, theta, f, compliance, tau, float(np.abs(miss).max()), count, bool(worst <= tolerance))


def positive(u: ArrayLike, c: float) -> Array:
    """The kernel f(u) = (u + sqrt(u² + 4 c)) / 2, written so that it stays positive far below 0."""
    u = np.asarray(u, float)
    root = np.sqrt(u * u + 4 * c)
    return np.where(u > 0, 0.5 * (u + root), 2 * c / (root - np.minimum(u, 0.0)))


def positive_rate(u: ArrayLike, c: float) -> Array:
    """df/du = f² / (f² + c): (31) with f in place of u."""
    f = positive(u, c)
    return np.asarray(f * f / (f * f + c), float)


def _per_tendon(name: str, values: ArrayLike, arm: PublishedArm) -> Array:
    return np.nan_to_num(as_vector(name, values, len(arm.l0), "one per tendon"))


def _shortened(step: Array, n: int) -> Array:
    """The step, scaled down to turn no hinge by more than _LONGEST."""
    return step * min(1.0, _LONGEST / max(float(np.abs(step[:n]).max()), 1e-300))


def _solution(
    arm: PublishedArm, theta: Array, f: Array, compliance: float, tau: Array, misfit: float, count: int, done: bool
) -> PublishedArmSolution:
    lengths = arm.lengths(theta, f, compliance)
    residual = float(np.nan_to_num(np.abs(tau).max(), nan=np.inf))
    return PublishedArmSolution(theta, f, lengths, residual, misfit, count, done)
