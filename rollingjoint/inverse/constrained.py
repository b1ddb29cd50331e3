"""Least squares under linear inequalities, for a handful of unknowns."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_PARALLEL = 1e-12  # length of a constraint's gradient that is none
_INFEASIBLE = 1e-14  # square of the distance from the constraints' cone at which no point keeps them


def constrained_least_squares(A: Array, b: Array, G: Array, h: Array) -> Array | None:
    """The x, (n,), with the least |A x - b|² and G x >= h; None where no x keeps the constraints.

    Args:
        A: (C, n), of rank n. b: (C,). G: (K, n). h: (K,).
    Source: Lawson and Hanson, Solving Least Squares Problems, 1974, ch. 23: the problem as one of least distance, and
        that as one with non-negative unknowns.
    """
    from scipy.optimize import nnls

    Q, R = np.linalg.qr(A)
    centre = Q.T @ b
    if np.abs(np.diagonal(R)).min() == 0.0:
        return None
    gradients = np.linalg.solve(R.T, G.T).T  # of z = R x - centre
    bounds = h - gradients @ centre
    lengths = np.linalg.norm(gradients, axis=1)
    active = lengths > _PARALLEL
    gradients, bounds = gradients[active] / lengths[active, None], bounds[active] / lengths[active]
    if (bounds <= 0.0).all():
        return np.linalg.solve(R, centre)
    scale = float(np.abs(bounds).max())
    goal = np.append(np.zeros(len(centre)), 1.0)
    try:
        u, _ = nnls(np.vstack([gradients.T, bounds / scale]), goal)
    except RuntimeError:  # too many iterations
        return None
    r = np.vstack([gradients.T, bounds / scale]) @ u - goal
    if -r[-1] < _INFEASIBLE:
        return None
    return np.asarray(np.linalg.solve(R, centre - scale * r[:-1] / r[-1]))
