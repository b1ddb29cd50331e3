"""Inverse statics: the tendon lengths, or tensions, that bring a mechanism where it should be (docs/inverse.md).

Modules:
    aims: stiffness of the tip, and its force on walls.
    constrained: least squares under linear inequalities.
    goal: links and where they should be, in the form of the kernels.
    reachable: where the tip can be, and how well it moves, presses and holds there.
    result: results of the functions.
    search: the functions.
    searches: searches of many targets side by side, by the kernel.
    starts: equilibria to start from.
    steps: a step by solves of the whole model: among walls, with friction, joint limits and aims.
    warm: a single search from a known equilibrium.
"""

from rollingjoint.inverse.reachable import Workspace, workspace
from rollingjoint.inverse.result import Reach, ReachStatus
from rollingjoint.inverse.search import all_solutions, reach, reach_batch
from rollingjoint.inverse.searches import PREFERENCES

__all__ = ["PREFERENCES", "Reach", "ReachStatus", "Workspace", "all_solutions", "reach", "reach_batch", "workspace"]
