"""Controllers to compare a policy with, one per file: examples of how to plug in one's own.

All see nothing but the observation, and know the mechanism as it is before anything is randomised.

Modules:
    do_nothing: no increments.
    open_loop: the model inverse, without feedback.
    jacobian_feedback: damped resolved rate.
    load_estimate: the same under the estimated load.
    predictive: model-predictive control over one step.
    measured: the model of a mechanism where it was measured.
    measured_chain: that of a planar chain.
    measured_arm: that of a flexible arm.
    model_inverse: tensions that put the model's tip nearest to a target.
    responses: how tip and tensions respond to tendon increments.
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
