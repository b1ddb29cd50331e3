"""Modules under the names that they had until version 0.1.0: pickles name the classes in them, and go on loading."""

from __future__ import annotations

import sys

import rollingjoint.chain as chains
from rollingjoint.chain import chain, equilibrium, friction_step, hinge, presets, rolling, solution, tendon, variations
from rollingjoint.kernels import arrays, friction, hinges
from rollingjoint.kernels import rolling as rolling_kernels

sys.modules |= {
    "rollingjoint.friction_step": friction_step,
    "rollingjoint.kernels.planar.arrays": rolling_kernels,
    "rollingjoint.kernels.shared.arrays": arrays,
    "rollingjoint.kernels.shared.friction": friction,
    "rollingjoint.kernels.spatial.arrays": hinges,
    "rollingjoint.mechanism": chain,
    "rollingjoint.planar": chains,  # imported before its modules
    "rollingjoint.planar.chain": rolling,
    "rollingjoint.planar.equilibrium": equilibrium,
    "rollingjoint.planar.variations": variations,
    "rollingjoint.presets": presets,
    "rollingjoint.solution": solution,
    "rollingjoint.spatial.chain": hinge,
    "rollingjoint.spatial.equilibrium": equilibrium,
    "rollingjoint.tendon": tendon,
}
