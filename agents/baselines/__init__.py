"""Controllers to compare a policy with, one a file: examples of how to plug in one's own.

All see nothing but the observation, and know the mechanism as it is before anything is randomised.
"""

from agents.baselines.do_nothing import DoNothing
from agents.baselines.jacobian_feedback import JacobianFeedback
from agents.baselines.load_estimate import LoadEstimate
from agents.baselines.open_loop import OpenLoop
from agents.baselines.predictive import Predictive
from agents.evaluation.controller import Controller

__all__ = ["DoNothing", "JacobianFeedback", "LoadEstimate", "OpenLoop", "Predictive", "baselines"]


def baselines() -> dict[str, Controller]:
    """A new one of each, by the name that reports give it."""
    return {
        "predictive": Predictive(),
        "load estimate": LoadEstimate(),
        "jacobian feedback": JacobianFeedback(),
        "open loop": OpenLoop(),
        "do nothing": DoNothing(),
    }
