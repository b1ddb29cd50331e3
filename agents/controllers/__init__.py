"""Controllers: anything that maps observations to actions. Each file is an example of how to write one's own.

Controllers that are not marked as privileged see the observation alone, and know the mechanism as it is before any
randomisation.

Modules:
    controller: the protocol, readings of observations, and the controller without actions.
    open_loop: the model inverse, without feedback; also where tendons rub.
    jacobian_feedback: damped resolved rate.
    smith_predictor: the same on the pose that the model predicts from a late picture.
    predictive: the same under the estimated load, and model-predictive control over one step.
    mpc: model-predictive control over a receding horizon.
    horizon: its plans, compiled.
    filters: banks of Kalman filters.
    filter_feedback: Jacobian feedback, and predictive control, on their estimates.
    smoother: Jacobian feedback on the estimate of a full-information smoother.
    arm_smoother: the smoother of an arm, from the settings of its task.
    among_walls: feedback and plans in the tasks among walls.
    command_tree: a tree of commands through the model with contact, among discs.
    fitted_wall: feedback on a hidden wall that is fitted to commands and tensions.
    privileged_feedback: Jacobian feedback on the true state.
    own_models: a controller that computes with one mechanism, where lanes have different ones.
    policy: a model of Stable-Baselines3.
    residual: a controller and a learned policy that adds to its actions.
    tuned: a table of controllers by world, with tuned settings from tuned.yaml.
    search_space: where their settings are searched.
    measured: the model of a mechanism at its measurements.
    steps: responses of a model, bounded steps on them, and the settings of feedback.
    kernels: moves of tendons and motors, compiled.
"""

from agents.controllers.controller import Controller, DoNothing, FunctionController, Reading
from agents.controllers.jacobian_feedback import JacobianFeedback
from agents.controllers.mpc import Mpc
from agents.controllers.open_loop import OpenLoop
from agents.controllers.predictive import LoadEstimate, Predictive
from rj_gym.tracking.config import TaskConfig

__all__ = [
    "Controller",
    "DoNothing",
    "FunctionController",
    "JacobianFeedback",
    "LoadEstimate",
    "Mpc",
    "OpenLoop",
    "Predictive",
    "Reading",
    "untuned_controllers",
    "why_left_out",
]


NEED_POSES = ("mpc", "predictive", "load estimate", "jacobian feedback")
"""Those that need measured poses, of all links of a planar chain."""


def untuned_controllers(poses: bool = True) -> dict[str, Controller]:
    """A new one of each that needs no tuning, by its name in reports; without `poses`, of those that need none."""
    controllers: dict[str, Controller] = {
        "mpc": Mpc(),
        "predictive": Predictive(),
        "load estimate": LoadEstimate(),
        "jacobian feedback": JacobianFeedback(),
        "open loop": OpenLoop(),
        "do nothing": DoNothing(),
    }
    return {name: controller for name, controller in controllers.items() if poses or name not in NEED_POSES}


def why_left_out(config: TaskConfig) -> str:
    """Why some of them cannot drive a tracking environment, one line; empty where all can."""
    if config.sees_all:
        return ""
    pose, names = config.sensing.pose, ", ".join(NEED_POSES)
    return f"Left out, for they need measured poses, of all links of a chain (sensing.pose is {pose!r}): {names}."


baselines, without_baselines = untuned_controllers, why_left_out  # their names until 0.1.0
