"""Inverse statics: the tendon lengths, or tensions, that bring a mechanism where it should be (docs/inverse.md).

Modules:
    goal: links and where they should be, in the form of the kernels.
    result: results of the functions.
    search: the functions.
    starts: equilibria to start from.
    warm: a single search from a known equilibrium.
"""

from rollingjoint.inverse.result import Reach, ReachStatus
from rollingjoint.inverse.search import PREFERENCES, all_solutions, reach, reach_batch

__all__ = ["PREFERENCES", "Reach", "ReachStatus", "all_solutions", "reach", "reach_batch"]
