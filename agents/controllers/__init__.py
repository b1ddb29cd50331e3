"""Controllers to compare a policy with, one per file: examples of how to plug in one's own.

All see nothing but the observation, and know the mechanism as it is before anything is randomised.

Modules:
    do_nothing: no increments.
    open_loop: the model inverse, without feedback.
    friction_open_loop: the same where tendons rub.
    jacobian_feedback: damped resolved rate.
    smith_predictor: the same on the pose that the model predicts from a late picture.
    load_estimate: the same under the estimated load.
    predictive: model-predictive control over one step.
    filters: banks of Kalman filters.
    filter_feedback: Jacobian feedback on what they estimate.
    filter_predictive: predictive control on it.
    privileged_teacher: Jacobian feedback on the true state.
    opponents: the opponents of learning in every world, with tuned settings from tuned.yaml.
    tune: the command that tunes them.
    search_space: where their settings are searched.
    feedback_settings: settings of feedback.
    kernels: moves of tendons and motors, compiled.
    assumed_play: tendons behind a play of assumed width.
    measured: the model of a mechanism where it was measured.
    measured_chain: that of a planar chain.
    measured_arm: that of a flexible arm.
    model_inverse: tensions that put the model's tip nearest to a target.
    residual: a controller and what a learned policy adds to it.
    responses: how tip and tensions respond to tendon increments.
"""

from agents.controllers.do_nothing import DoNothing
from agents.controllers.jacobian_feedback import JacobianFeedback
from agents.controllers.load_estimate import LoadEstimate
from agents.controllers.open_loop import OpenLoop
from agents.controllers.predictive import Predictive
from agents.evaluation.controller import Controller
from rj_gym.core.config import TaskConfig

__all__ = ["DoNothing", "JacobianFeedback", "LoadEstimate", "OpenLoop", "Predictive", "baselines", "without_baselines"]


NEED_POSES = ("predictive", "load estimate", "jacobian feedback")
"""Those that need measured poses, of all links of a planar chain."""


def baselines(poses: bool = True) -> dict[str, Controller]:
    """A new one of each, by the name that reports give it; without measured `poses`, of those that need none."""
    each: dict[str, Controller] = {
        "predictive": Predictive(),
        "load estimate": LoadEstimate(),
        "jacobian feedback": JacobianFeedback(),
        "open loop": OpenLoop(),
        "do nothing": DoNothing(),
    }
    return {name: controller for name, controller in each.items() if poses or name not in NEED_POSES}


def without_baselines(config: TaskConfig) -> str:
    """Why some baselines cannot drive a tracking environment, one line; empty where all can."""
    if config.sees_all:
        return ""
    pose, names = config.sensing.pose, ", ".join(NEED_POSES)
    return f"Left out, for they need measured poses, of all links of a chain (sensing.pose is {pose!r}): {names}."
