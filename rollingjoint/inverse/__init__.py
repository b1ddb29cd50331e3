"""Inverse statics: the tendon lengths, or tensions, that bring a mechanism where it should be (docs/inverse.md).

Modules:
    goal: links and where they should be, in the form of the kernels.
    reach: the functions.
    result: their results.
    starts: equilibria to start from.
    warm: a single search from a known equilibrium.
"""

from rollingjoint.inverse.reach import PREFERENCES, all_solutions, reach, reach_batch
from rollingjoint.inverse.result import Reach, ReachStatus

__all__ = ["PREFERENCES", "Reach", "ReachStatus", "all_solutions", "reach", "reach_batch"]
