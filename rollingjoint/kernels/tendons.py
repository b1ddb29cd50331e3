"""Tendons: tensions, their rates and their energy from the lengths, and the balance at a joint.

For numbers and SIMD lanes alike.
"""

from __future__ import annotations

from rollingjoint._numba.jit import part
from rollingjoint._numba.simd import where
from rollingjoint.transmission.kernels import at_limit, elastic_tension


@part(inline=True)
def evaluate_tendons(law, state):
    """Fill tensions and their rates; returns (energy, magnitude of its terms)."""
    zero = 0.0 * state.angle[0]
    energy, magnitude = zero, zero
    for j in range(state.length.size):
        length, k, low, high = state.length[j], law.stiffness[j], law.low[j], law.high[j]
        stretch = length - law.command[j]
        tension = elastic_tension(length, law.command[j], k, low, high)
        # 1/2 k stretch² while elastic; beyond a limit the line that continues it
        term = tension * stretch - 0.5 * tension * tension / k
        state.tension[j] = tension
        state.elastic[j] = where(at_limit(k * stretch, low, high), 0.0, k)
        energy = energy + term
        magnitude = magnitude + abs(term) + abs(tension * length)
    return energy, magnitude


@part(inline=True)
def fill_residual(tendon_joints, state, i, spring, moment):
    """Fill r = spring + sum of tension × g' - moment of the loads about the axis, at joint i.

    Returns the sum of the terms' magnitudes, every tension with a lever of at least 1 mm.
    """
    gap, tension = state.gap, state.tension
    residual, size = spring - moment, abs(spring) + abs(moment)
    for j in range(tension.size):
        if i < tendon_joints[j]:
            torque = tension[j] * gap[i, j, 1]
            residual = residual + torque
            size = size + where(abs(torque) > tension[j], abs(torque), tension[j])
    state.residual[i] = residual
    return size
