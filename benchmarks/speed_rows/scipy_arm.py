"""The statics of a hinge chain given to scipy.optimize.root: what one would write without a solver of one's own.

Unknowns are the hinge angles, equations the moments about the hinges; plain NumPy, whole arrays at once where that is
possible, numerical Jacobian. "exact" tendons and the weights of the beads only.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import root

from rollingjoint import HingeChain
from rollingjoint.chain import se3

Array = NDArray[np.float64]

TOLERANCE = 1e-11  # relative, of the angles


def angles_by_root(
    arm: HingeChain, gravity: tuple[float, float, float], start: Array, tensions: Array | None, lengths: Array | None
) -> Array:
    """Hinge angles (n - 1,) [rad] under given tensions, or given unstretched lengths (m,) [N, mm].

    Raises:
        RuntimeError: SciPy gives up.
    """
    axes = np.array([bead.axis for bead in arm.beads])
    springs = np.array([bead.stiffness for bead in arm.beads])
    spacings = np.array([bead.spacing for bead in arm.beads])[:, None]
    weights = np.outer([bead.weight for bead in arm.beads], np.array(gravity) / np.linalg.norm(gravity))
    hung = np.cumsum(weights[::-1], axis=0)[::-1]  # weight beyond every hinge
    square, b, c = np.moveaxis(arm.arrays.gaps[0, ..., :3], -1, 0)
    crosses, channels = square > 0, arm.arrays.channels[0]

    def residual(theta: Array) -> Array:
        steps, frames = se3.rotation(theta[:, None] * axes), np.empty((len(theta) + 1, 3, 3))
        frames[0] = np.eye(3)
        for i, step in enumerate(steps):
            frames[i + 1] = frames[i] @ step
        ways = spacings * frames[1:, :, 2]
        hinges = np.cumsum(ways, axis=0) - ways
        turning = np.cumsum(np.cross(hinges + 0.5 * ways, weights)[::-1], axis=0)[::-1] - np.cross(hinges, hung)
        moments = np.einsum("iab,ib,ia->i", frames[:-1], axes, turning)
        cos, sin = np.cos(theta)[:, None], np.sin(theta)[:, None]
        gaps = np.sqrt(np.where(crosses, square - 2.0 * (b * cos + c * sin), 1.0))
        rates = np.where(crosses, (b * sin - c * cos) / gaps, 0.0)
        pull = tensions
        if lengths is not None:
            stretch = channels + np.where(crosses, gaps, 0.0).sum(axis=0) - lengths
            pull = np.maximum(arm.stiffnesses * stretch, 0.0)
        return springs * (theta - arm.neutral_angles) + rates @ pull - moments

    solution = root(residual, start, method="hybr", options={"xtol": TOLERANCE})
    if not solution.success and np.abs(solution.fun).max() > 1e-8:
        raise RuntimeError(f"scipy.optimize.root: {solution.message}")
    return solution.x
