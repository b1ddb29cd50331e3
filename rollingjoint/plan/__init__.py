"""Plans: tendon lengths over time that lead a mechanism along a path of targets (docs/planning.md).

Modules:
    follow: the function.
    path: targets between those of a caller.
    result: its result.
"""

from rollingjoint.plan.follow import plan_path
from rollingjoint.plan.result import Plan, PlanStatus

__all__ = ["Plan", "PlanStatus", "plan_path"]
