"""The paper's 6 (n - 1) equations given to scipy.optimize.root: what one would write without a solver of one's own.

Unknowns of link i >= 1: its pose (x, y, angle), the contact's arc length and the contact force; equations: its pose
follows from the link before (9), and its wrenches balance (10). The equations are those of
tests.second_opinions.published_equations, written to be read.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import root

from rollingjoint import Equilibrium, RollingChain
from rollingjoint.load import Load
from tests.second_opinions.published_equations import Configuration, PublishedChain, body_load
from tests.second_opinions.se2 import transform

Array = NDArray[np.float64]

TOLERANCE = 1e-11  # relative, of the unknowns


def solve_by_root(
    mechanism: RollingChain,
    lengths: Array,
    loads: Sequence[Load],
    start: Equilibrium,
    tension_limits: tuple[float, float],
) -> Array:
    """Poses (n - 1, 3) of the moving links [mm, rad] at commanded tendon lengths (m,) [mm].

    Raises:
        RuntimeError: SciPy gives up.
    """
    unloaded, load_rows = PublishedChain(mechanism, ()), PublishedChain(mechanism, loads).load_rows
    nothing = np.zeros(mechanism.n_tendons)

    def residual(unknowns: Array) -> Array:
        poses, s, forces = _unpacked(unknowns)
        state = Configuration(unloaded, s, forces, nothing)
        tensions = np.clip(mechanism.stiffnesses * (state.lengths - lengths), *tension_limits)
        frames = [np.eye(3), *(transform(pose[:2], pose[2]) for pose in poses)]
        closure, balance = np.empty_like(poses), np.empty_like(poses)
        for i in range(1, mechanism.n_links):
            follows = frames[i - 1] @ state.G[i - 1]
            before = poses[i - 2, 2] if i > 1 else 0.0
            closure[i - 1] = *(frames[i][:2, 2] - follows[:2, 2]), poses[i - 1, 2] - before - state.angles[i - 1]
            balance[i - 1] = state.h[i] + state.F[i] @ tensions + body_load(load_rows[i], frames[i])[0]
        return np.concatenate([closure, balance]).ravel()

    solution = root(residual, _packed(start), method="hybr", options={"xtol": TOLERANCE})
    if not solution.success and np.abs(solution.fun).max() > 1e-8:
        raise RuntimeError(f"scipy.optimize.root: {solution.message}")
    return _unpacked(solution.x)[0]


def _packed(start: Equilibrium) -> Array:
    return np.column_stack([start.poses[1:], start.arc_lengths, start.contact_forces]).ravel()


def _unpacked(unknowns: Array) -> tuple[Array, Array, Array]:
    """Poses (n - 1, 3), arc lengths (n - 1,) and contact forces (n - 1, 2)."""
    table = unknowns.reshape(-1, 6)
    return table[:, :3], table[:, 3], table[:, 4:]
