"""A task described in a few sentences, from its settings."""

from __future__ import annotations

import math

from rj_gym.registry import task_of
from rj_gym.tracking.config import (
    ArmRandomizationConfig,
    FlexibleArmConfig,
    FrictionConfig,
    LoadConfig,
    PayloadConfig,
    RandomizationConfig,
    TaskConfig,
)
from rj_gym.tracking.sensing import ActuationConfig, SensingConfig


def description(config: TaskConfig) -> str:
    """A task with these settings in a few sentences."""
    mechanism = task_of(config).mechanism
    path = f"follows a path through {config.target.waypoints} points"
    way = "goes to a fixed target" if config.target.process == "fixed" else path
    tensions = f"tensions of {config.start_tension:g} N"
    start = {"random": "random tensions", "measured": f"measured {tensions}"}.get(config.start, tensions)
    sentences = [
        f"Mechanism {mechanism.name or 'without a name'} ({mechanism.parts}, {mechanism.n_tendons} tendons, "
        f"{mechanism.length:g} mm): the tip {way} in {config.episode_steps} steps of at most "
        f"{config.action_scale_mm:g} mm of each tendon, from {start}.",
        *(_arm_loads(config) if isinstance(config, FlexibleArmConfig) else _loads(config)),
        _rubbing(config.friction),
        _actuation(config.actuation),
        _sensing(config.sensing),
        _noise(config.randomization),
        _randomised(config.randomization),
    ]
    return " ".join(sentence for sentence in sentences if sentence)


def load_range(load: LoadConfig | PayloadConfig, low: float, high: float) -> str:
    """Loads between two magnitudes, in words."""
    return f"drifting up to {high:g} N" if load.process == "ou" else f"{low:g} to {high:g} N"


def _loads(config: TaskConfig) -> list[str]:
    load, observed = config.load, "is observed" if config.observe_load else "is not observed"
    where = "the tip" if load.link == "tip" else "a random link"
    low, high = load.magnitude
    ways = {
        "constant": f"A constant force of {low:g} to {high:g} N pulls at {where}.",
        "step": f"A force of {low:g} to {high:g} N pulls at {where} and jumps to another one every "
        f"{load.hold_steps:g} steps on average.",
        "ou": f"A force of up to {high:g} N pulls at {where} and drifts (Ornstein-Uhlenbeck, correlation time "
        f"{load.correlation_steps:g} steps).",
    }
    return [ways[load.process], f"The load {observed}."]


def _arm_loads(config: FlexibleArmConfig) -> list[str]:
    load, observed = config.load, "are observed" if config.observe_load else "are not observed"
    low, high = load.magnitude
    low_tilt, high_tilt = (f"{math.degrees(angle):.0f}" for angle in config.gravity.tilt)
    tilted = f"by {low_tilt} to {high_tilt}" if config.gravity.tilt[0] else f"by up to {high_tilt}"
    ways = {
        "constant": f"a payload of {low:g} to {high:g} N hangs from its tip.",
        "step": f"a payload of {low:g} to {high:g} N hangs from its tip and changes every {load.hold_steps:g} steps on "
        "average.",
        "ou": f"a payload of {low:g} to {high:g} N hangs from its tip and drifts (Ornstein-Uhlenbeck, correlation time "
        f"{load.correlation_steps:g} steps).",
    }
    anywhere = config.gravity.tilt[0] == 0.0 and config.gravity.tilt[1] >= math.pi
    hangs = "It is held at any attitude;" if anywhere else f"The arm hangs from a base that is tilted {tilted}°;"
    turned = "The tip frame has to turn into that of the target, too." if config.orientation else ""
    return [hangs, ways[load.process], f"{'Attitude' if anywhere else 'Tilt'} and payload {observed}.", turned]


def _rubbing(settings: FrictionConfig | None) -> str:
    if settings is None:
        return ""
    low, high = settings.mu
    drawn = f"of {low:g}" if low == high else f"between {low:g} and {high:g}"
    whose = "the same for all tendons" if settings.shared else "its own for every tendon"
    return f"Tendons rub in their holes, by a hidden coefficient {drawn}, {whose}."


def _actuation(settings: ActuationConfig) -> str:
    """How motors move tendons, where that is not exact."""
    (smallest, largest), (low, high) = settings.play_mm, settings.sheath_friction
    parts = {
        f"a play of {_between(smallest, largest)} mm between motor and tendon": largest,
        f"sheath friction of {_between(low, high)} that its motor measures with the tension": high,
    }
    hidden = [text for text, size in parts.items() if size]
    slow = settings.rate_limit_mm is not None
    limit = _between(*settings.tension_limit) if settings.tension_limit else "the highest tension"
    stops = "A motor that pulls stops where the tension before the sheath is its limit"
    return " ".join(
        sentence
        for sentence, applies in (
            (f"Every tendon has {' and '.join(hidden)}, hidden.", bool(hidden)),
            (f"Motors move by at most {settings.rate_limit_mm or 0:g} mm in a step.", slow),
            (f"Actions act {settings.delay} steps late.", settings.delay > 0),
            (f"Motors give way at a tension of {limit} N.", settings.tension_limit and settings.limit_at == "tendon"),
            (f"{stops}, {limit} N.", settings.limit_at == "motor"),
            (f"Motors rest within {settings.dead_band_mm:g} mm of where they are commanded.", settings.dead_band_mm),
        )
        if applies
    )


def _sensing(settings: SensingConfig) -> str:
    """The measured part of the pose; empty where the whole pose is measured at every step."""
    sight = {"none": "Neither pose nor tip is measured.", "tip": "Of the pose only the tip is measured."}
    often = "at every step" if settings.period == 1 else f"at every {settings.period}th step"
    late = settings.pose != "none" and (settings.period > 1 or settings.delay > 0)
    biased = f"{settings.position_bias_mm:g} mm and {settings.angle_bias_rad:g} rad"
    motors = f"{settings.encoder_noise_mm:g} mm"
    return " ".join(
        sentence
        for sentence, applies in (
            (sight.get(settings.pose, ""), settings.pose in sight),
            (f"A picture of the pose comes {often}, {settings.delay} steps late.", late),
            (f"Measured poses are off by up to {biased}.", settings.position_bias_mm or settings.angle_bias_rad),
            (f"Measured tensions are noisy (standard deviation {settings.tension_noise:g} N).", settings.tension_noise),
            (f"Measured motor positions are noisy (standard deviation {motors}).", settings.encoder_noise_mm),
        )
        if applies
    )


def _between(low: float, high: float) -> str:
    return f"{low:g}" if low == high else f"{low:g} to {high:g}"


def _noise(settings: RandomizationConfig | ArmRandomizationConfig) -> str:
    noise = f"{settings.position_noise_mm:g} mm and {settings.angle_noise_rad:g} rad"
    return f"Measured poses are noisy (standard deviations {noise})." if settings.sensor_noise else ""


def _randomised(settings: RandomizationConfig | ArmRandomizationConfig) -> str:
    parts = {f"tendon stiffness by up to {100 * settings.stiffness_spread:g} %": settings.stiffness_spread}
    if isinstance(settings, ArmRandomizationConfig):
        hinges, weights = settings.hinge_stiffness_spread, settings.weight_spread
        parts |= {
            f"every hinge by up to {100 * hinges:g} %": hinges,
            f"every weight by up to {100 * weights:g} %": weights,
        }
    else:
        surfaces = f"{settings.link_tolerance_mm:g} mm and {settings.link_tolerance_rad:g} rad"
        parts[f"contact surfaces by up to {surfaces}"] = settings.link_tolerance_mm or settings.link_tolerance_rad
    parts[f"motors by up to {settings.actuator_offset_mm:g} mm"] = settings.actuator_offset_mm
    off = [text for text, size in parts.items() if size]
    return f"In every episode other things are off: {', '.join(off)}." if off else ""
