"""The smoother of an arm or a chain in space whose tip nobody sees, from the settings of its task."""

from __future__ import annotations

import math
from typing import Any, cast

from rj_gym.tracking.config import FlexibleArmConfig
from rj_gym.tracking.task import TrackingTask
from rollingjoint import HingeChain, SpatialChain
from rollingjoint.errors import InvalidInput
from rollingjoint.estimate import LARGEST_TILT, ArmEffort, ArmLaw, ArmPrior, ArmRanges, ArmSmoother, is_served


def check_arm(task: TrackingTask) -> FlexibleArmConfig:
    """The settings of a task with an arm, one that the smoother knows; raises InvalidInput for others."""
    config, arm, hint = cast(FlexibleArmConfig, task.config), task.mechanism, "That is what the smoother knows."
    if not is_served(arm) or not config.has_friction(arm) or config.friction is None:
        allowed = "exact tendons and drawn friction, without springs and rolling resistance"
        raise InvalidInput("mechanism", arm, allowed, hint)
    if config.load.process != "constant":
        raise InvalidInput("load.process", config.load.process, "'constant'", hint)
    if config.gravity.tilt[1] > LARGEST_TILT:
        raise InvalidInput("gravity.tilt", config.gravity.tilt, f"angles up to {LARGEST_TILT:g} rad", hint)
    if config.start == "random":
        raise InvalidInput("start", config.start, "'equal' or 'measured'", hint)
    if config.sensing.pose != "none":
        raise InvalidInput("sensing.pose", config.sensing.pose, "'none'", hint)
    if not config.observe_tensions:
        raise InvalidInput("observe_tensions", False, "True", "The smoother needs measured tensions.")
    return config


def arm_ranges(config: FlexibleArmConfig) -> ArmRanges:
    """The ranges of the hidden numbers of an arm's task that has friction."""
    random, actuation, friction, sensing = config.randomization, config.actuation, config.friction, config.sensing
    mu = (0.0, 0.0) if friction is None else friction.mu
    low, high = mu if isinstance(mu, tuple) else (mu, mu)

    def factors(spread: float) -> tuple[float, float]:
        return 1.0 - spread, 1.0 + spread

    return ArmRanges(
        tilt=config.gravity.tilt,
        payload=config.load.magnitude,
        offset_mm=(-random.actuator_offset_mm, random.actuator_offset_mm),
        stiffness=factors(random.stiffness_spread),
        hinge=factors(random.hinge_stiffness_spread),
        weight=factors(random.weight_spread),
        play_mm=actuation.play_mm,
        sheath_friction=actuation.sheath_friction,
        hole_friction=(low, high),
        gain=factors(sensing.tension_gain_error),
        zero=(-sensing.tension_offset, sensing.tension_offset),
        shared=friction is None or friction.shared,
    )


def arm_law(
    config: FlexibleArmConfig,
    start_sd: float,
    limit_sd: float,
    tension_sd: float,
    tension_share: float = 0.0,
    robust: float = math.inf,
) -> ArmLaw:
    """The law of the measurements in an arm's task that has friction, with these errors."""
    assert config.friction is not None
    return ArmLaw(
        start_tension=config.start_tension,
        start_sd=start_sd,
        low=config.yield_tensions[0],
        high=config.yield_tensions[1],
        limit_sd=limit_sd,
        tension_sd=tension_sd,
        tension_share=tension_share,
        robust=robust,
        presliding=config.friction.presliding,
        cells_at_tendons=config.sensing.tension_at == "tendon",
        measured=config.start == "measured",
    )


def arm_smoother_of(task: TrackingTask, settings: Any) -> ArmSmoother:
    """A smoother for a task with an arm, which it knows by its settings and its nominal mechanism.

    settings: SmootherFeedbackSettings.
    """
    config, arm, own = check_arm(task), cast(HingeChain | SpatialChain, task.mechanism), settings.smoother
    law = arm_law(config, own.start_sd_mm, own.limit_sd or math.inf, own.tension_sd, own.tension_share, own.robust)
    effort = ArmEffort(every=own.every, trusted_from=1 + settings.probe.length(config.action_scale_mm))
    return ArmSmoother(arm, ArmPrior.of(arm, arm_ranges(config)), law, effort, config.episode_steps + 1)
