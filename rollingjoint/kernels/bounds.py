"""Joint angles between the limits of their joints: starts, steps, and the joints that a limit holds."""

from __future__ import annotations

from rollingjoint._numba.jit import part


@part
def begin(chain, start, angle):
    """Fill angle with the start, clipped to the surface limits."""
    for i in range(angle.size):
        angle[i] = min(max(start[i], chain.joints[i, 0]), chain.joints[i, 1])


@part
def move(chain, phi, step, t, angle):
    """Fill angle with phi + t step, clipped to the surface limits."""
    for i in range(angle.size):
        angle[i] = min(max(phi[i] + t * step[i], chain.joints[i, 0]), chain.joints[i, 1])


@part
def moved(angle, start):
    """True if a joint has left its start."""
    for i in range(angle.size):
        if abs(angle[i] - start[i]) > 1e-12:
            return True
    return False


@part
def mark_free(chain, state, prox, anchor, free):
    """Mark joints that are not held by a surface limit; returns the largest free |r|. The proximal term is included."""
    worst = 0.0
    for i in range(free.size):
        phi, lowest, highest = state.angle[i], chain.joints[i, 0], chain.joints[i, 1]
        residual = state.residual[i] + prox * (phi - anchor[i])
        held = (phi >= highest - 1e-13 and residual < 0.0) or (phi <= lowest + 1e-13 and residual > 0.0)
        free[i] = not held
        if free[i]:
            worst = max(worst, abs(residual))
    return worst


@part
def release_step(chain, state, free, step):
    """Hold joints at a limit that the step would leave outwards; returns True when it held any."""
    changed = False
    for i in range(free.size):
        if free[i] and step[i] != 0.0:
            phi, lowest, highest = state.angle[i], chain.joints[i, 0], chain.joints[i, 1]
            if (phi >= highest - 1e-13 and step[i] > 0.0) or (phi <= lowest + 1e-13 and step[i] < 0.0):
                free[i] = False
                changed = True
    return changed
