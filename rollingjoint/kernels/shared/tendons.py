"""The tendon law: tensions, their rates and their energy from the lengths; of numbers and of SIMD lanes alike."""

from __future__ import annotations

from rollingjoint._numba.jit import part
from rollingjoint._numba.simd import where
from rollingjoint.transmission.kernels import at_limit, limited_tension


@part(inline=True)
def evaluate_tendons(law, state):
    """Fill tensions and their rates; returns (energy, magnitude of its terms)."""
    zero = 0.0 * state.angle[0]
    energy, magnitude = zero, zero
    for j in range(state.length.size):
        length, k, low, high = state.length[j], law.stiffness[j], law.low[j], law.high[j]
        stretch = length - law.command[j]
        pull = k * stretch
        tension = limited_tension(pull, low, high)
        # 1/2 k stretch² while elastic; beyond a limit the line that continues it
        term = tension * stretch - 0.5 * tension * tension / k
        state.tension[j] = tension
        state.elastic[j] = where(at_limit(pull, low, high), 0.0, k)
        energy = energy + term
        magnitude = magnitude + abs(term) + abs(tension * length)
    return energy, magnitude
