"""The equations of the published algorithm at one configuration: residuals, blocks and load derivatives.

Symbols and numbers are those of the rolling-contact paper; links count from 0, and joint i lies between the child
surface of link i and the parent surface of link i + 1. Read published.py first.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rollingjoint.chain.rolling import RollingChain
from rollingjoint.errors import InvalidInput
from rollingjoint.load import LOAD_COLUMNS, Load, load_table, pair_columns
from rollingjoint.profile import Surface
from tests.second_opinions.se2 import adjoint, dual_adjoint, dual_bracket, inverse, skew, transform, turned

Array = NDArray[np.float64]

_LINK, _MOMENT, _SPRING = (LOAD_COLUMNS.index(name) for name in ("link", "moment", "k"))
_POINT, _FORCE, _BODY, _ANCHOR = pair_columns("p", "f", "b", "a")
_KNOWN = np.r_[_LINK, _POINT, _FORCE, _BODY, _MOMENT, _SPRING, _ANCHOR]  # columns of a load table


class PublishedChain:
    """Surfaces, tendon holes and load rows of a mechanism, by link: what does not change during an iteration."""

    def __init__(self, mechanism: RollingChain, loads: Sequence[Load]):
        self.links = mechanism.links
        self.n = mechanism.n_links
        self.limits = np.asarray(mechanism.joint_limits, float)
        self.p = [holes[:, 0] for holes in mechanism.hole_points]
        self.c = [holes[:, 1] for holes in mechanism.hole_points]
        self.channels = np.array([np.linalg.norm(c - p, axis=1).sum() for p, c in zip(self.p, self.c, strict=True)])
        table = load_table([*mechanism.springs, *loads], self.n)
        if np.any(np.delete(table, _KNOWN, axis=1)):
            raise InvalidInput("loads", loads, "loads that act on one link", "The published algorithms have no other.")
        self.load_rows = [table[table[:, _LINK] == i] for i in range(self.n)]

    def passes(self, i: int) -> list[int]:
        """Tendons that cross joint i."""
        return [j for j, holes in enumerate(self.p) if len(holes) - 1 > i]


class Configuration:
    """Everything the recursion needs at given s (n-1,), f (n-1, 2) and tensions: residuals and blocks by link."""

    def __init__(self, problem: PublishedChain, s: Array, f: Array, tau: Array):
        self.problem, self.s, self.f, self.tau = problem, s, f, tau
        n, m, links = problem.n, len(tau), problem.links
        self.T_c = [_surface_frame(links[i].child, s[i]) for i in range(n - 1)]
        self.T_p = [_surface_frame(links[i + 1].parent, s[i]) for i in range(n - 1)]
        self.u_c = [float(links[i].child.curvature(s[i])) for i in range(n - 1)]
        self.u_p = [float(links[i + 1].parent.curvature(s[i])) for i in range(n - 1)]
        self.angles = [
            links[i].child.tangent_angle(s[i]) - links[i + 1].parent.tangent_angle(s[i]) for i in range(n - 1)
        ]
        self.G = [c @ inverse(p) for c, p in zip(self.T_c, self.T_p, strict=True)]
        self.T = [np.eye(3)]
        for relative in self.G:
            self.T.append(self.T[-1] @ relative)  # (9)
        self.gaps = np.zeros((m, n - 1))
        self.dgaps = np.zeros((m, n - 1))
        self.h = np.zeros((n, 3))
        self.F = np.zeros((n, 3, m))
        self.C = np.zeros((n, 3, 3))
        self.D_s = np.zeros((n, 3))
        self.E_s = np.zeros((n, 3))
        for i in range(n - 1):
            self._add_tendons(i)
            self._add_contact(i)
        for i in range(1, n):
            wrench, self.C[i] = body_load(problem.load_rows[i], self.T[i])
            self.h[i] += self.F[i] @ tau + wrench

    def _add_tendons(self, i: int) -> None:
        """Tendon terms of (10), (19), (30) and (33) at joint i, on the links either side."""
        problem, G, G_inverse = self.problem, self.G[i], inverse(self.G[i])
        spin = self.u_c[i] - self.u_p[i]
        for j in problem.passes(i):
            p, c = problem.p[j][i + 1], problem.c[j][i]
            v, dv = _gap(G, spin, p, c, self.T_p[i][:2, 2])
            w, dw = _gap(G_inverse, -spin, c, p, self.T_c[i][:2, 2])
            v_hat, dv_hat = _direction(v, dv)
            w_hat, dw_hat = _direction(w, dw)
            self.gaps[j, i] = np.linalg.norm(v)
            self.dgaps[j, i] = v_hat @ dv
            self.F[i, :, j] += _wrench_at(c, v_hat)
            self.F[i + 1, :, j] += _wrench_at(p, w_hat)
            self.D_s[i] += _wrench_at(c, self.tau[j] * dv_hat)
            self.E_s[i + 1] += _wrench_at(p, self.tau[j] * dw_hat)

    def _add_contact(self, i: int) -> None:
        """Contact-force terms of (10) and (45) at joint i."""
        f = np.array([0.0, *self.f[i]])
        self.h[i] -= dual_adjoint(self.T_c[i]) @ f
        self.h[i + 1] += dual_adjoint(self.T_p[i]) @ f
        self.D_s[i] -= dual_adjoint(self.T_c[i]) @ dual_bracket(self.xi_c(i)) @ f
        self.E_s[i + 1] += dual_adjoint(self.T_p[i]) @ dual_bracket(self.xi_p(i)) @ f

    def xi_c(self, i: int) -> Array:
        """Velocity (u, 1, 0) of the child frame of joint i along the arc length."""
        return np.array([self.u_c[i], 1.0, 0.0])

    def xi_p(self, i: int) -> Array:
        """Velocity (u, 1, 0) of the parent frame of joint i along the arc length."""
        return np.array([self.u_p[i], 1.0, 0.0])

    @cached_property
    def recursions(self) -> list[tuple[Array, Array]]:
        """P_i and Q_i of links 1 to n - 1."""
        return [self._recursion(i) for i in range(1, self.problem.n)]

    def _recursion(self, i: int) -> tuple[Array, Array]:
        """P_i and Q_i of (22) for link i >= 1, from the blocks A to E of (44)."""
        A = -adjoint(inverse(self.G[i - 1]))
        B = np.zeros((3, 3))
        B[:, 0] = -adjoint(self.T_p[i - 1]) @ (self.xi_c(i - 1) - self.xi_p(i - 1))
        last = i == self.problem.n - 1
        D = np.eye(3) if last else np.column_stack([self.D_s[i], -dual_adjoint(self.T_c[i])[:, 1:]])
        E = np.column_stack([self.E_s[i], dual_adjoint(self.T_p[i - 1])[:, 1:]])
        D_inverse, zero = np.linalg.inv(D), np.zeros((3, 3))
        Q = np.block([[np.eye(3), zero], [-D_inverse @ self.C[i], D_inverse]])
        return -Q @ np.block([[A, B], [zero, E]]), Q

    @property
    def lengths(self) -> Array:
        """Tendon lengths (m,) [mm] (28)."""
        return self.problem.channels + self.gaps.sum(axis=1)

    @property
    def residual(self) -> float:
        """Largest entry of (10) [N, N·mm]."""
        return float(np.abs(self.h[1:]).max())

    def balanced(self, tolerance: float) -> bool:
        """Whether (10) holds within the tolerance [N, N·mm]."""
        return bool(self.residual <= tolerance)


def _surface_frame(surface: Surface, s: float) -> Array:
    x, y, angle = surface.pose(s)
    return transform(np.array([x, y]), angle)


def _gap(G: Array, spin: float, far: Array, near: Array, far_contact: Array) -> tuple[Array, Array]:
    """v of (13), from the near hole to the far one in the near link's frame, and its arc-length derivative (31)."""
    R = G[:2, :2]
    return R @ far + G[:2, 2] - near, skew(spin) @ R @ (far - far_contact)


def _direction(v: Array, dv: Array) -> tuple[Array, Array]:
    """The unit vector of (12) and its arc-length derivative (19)."""
    length = np.linalg.norm(v)
    unit = v / length
    return unit, (dv - unit * (unit @ dv)) / length


def _wrench_at(point: Array, force: Array) -> Array:
    """Ad*_I(q) (0, f): moment about the body's origin and force, of a force at a body point (11)."""
    return dual_adjoint(transform(point, 0.0)) @ np.array([0.0, *force])


def body_load(rows: Array, T: Array) -> tuple[Array, Array]:
    """External load F_ext (3,) on a link at pose T (3, 3), in its frame, and C = dF_ext/d xi (3, 3).

    rows: the link's rows of a load table. Source: rolling-contact paper, appendix C, at any body point.
    """
    R, t = T[:2, :2], T[:2, 2]
    F, C = np.zeros(3), np.zeros((3, 3))
    for row in rows:
        q, f, away, k = row[_POINT], row[_FORCE], t - row[_ANCHOR], row[_SPRING]
        force = R.T @ f + row[_BODY] - k * (R.T @ away + q)
        dforce = np.column_stack([R.T @ turned(f) - k * (R.T @ turned(away)), -k * np.eye(2)])
        F += np.array([row[_MOMENT] - turned(q) @ force, *force])
        C += np.vstack([-turned(q) @ dforce, dforce])
    return F, C
