"""The opponents of learning in every world, with their tuned settings."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from agents.controllers.feedback_settings import FeedbackSettings
from agents.controllers.filter_feedback import FilterFeedback, FilterFeedbackSettings
from agents.controllers.filter_predictive import FilterPredictive
from agents.controllers.jacobian_feedback import JacobianFeedback
from agents.controllers.open_loop import OpenLoop
from agents.controllers.search_space import Choice, LogUniform, Settings, Space, Uniform
from agents.controllers.smith_predictor import SmithPredictor
from agents.evaluation.controller import Controller
from rollingjoint.checked_yaml import read_yaml
from rollingjoint.checks import as_choice
from rollingjoint.errors import ConfigError

TUNED = Path(__file__).with_name("tuned.yaml")


@dataclass(frozen=True)
class Opponent:
    """A kind of controller in one world, and where its settings are searched.

    Args:
        make: the controller from its settings.
        space: where the others are searched. fixed: settings that are not.
    """

    make: Callable[[Settings], Controller]
    space: Space
    fixed: Settings = field(default_factory=dict)


def _open_loop(settings: Settings) -> Controller:
    return OpenLoop(**settings)


def _jacobian(settings: Settings) -> Controller:
    return JacobianFeedback(FeedbackSettings.from_dict(settings))


def _smith(settings: Settings) -> Controller:
    return SmithPredictor(FeedbackSettings.from_dict(settings))


def _filter(settings: Settings) -> Controller:
    return FilterFeedback(FilterFeedbackSettings.from_dict(settings))


def _predictive(settings: Settings) -> Controller:
    return FilterPredictive(FilterFeedbackSettings.from_dict(settings))


_STEERING: Space = {
    "gain": Uniform(0.05, 1.0),
    "stiffen": LogUniform(0.003, 1.0),
    "damping": LogUniform(0.03, 0.6),
    "far": LogUniform(0.01, 0.2),
}
_CROSSING: Space = {"crossing": Uniform(0.3, 1.2), "dead_band_mm": LogUniform(0.02, 0.5)}
_ASSUMED_PLAY: Space = _CROSSING | {"half_width_mm": Uniform(0.0, 1.5)}
_FILTER: Space = {
    "force_walk": LogUniform(0.001, 0.1),
    "start_sd_mm": LogUniform(0.1, 3.0),
    "offset_sd_mm": LogUniform(0.03, 0.6),
    "offset_walk_mm": LogUniform(0.001, 0.1),
    "stiffness_sd": LogUniform(0.01, 0.25),
    "tension_sd": LogUniform(0.08, 1.0),
    "tension_share": LogUniform(0.005, 0.3),
    "tempering": LogUniform(0.05, 1.0),
}
_PICTURES: Space = {
    "angle_sd": LogUniform(0.003, 0.04),
    "position_sd_mm": LogUniform(0.1, 2.0),
    "bias_sd_mm": LogUniform(0.02, 2.0),
    "bias_walk_mm": LogUniform(0.003, 0.3),
}
_PLAY: Space = {
    "width_share": Uniform(0.0, 0.5),
    "friction_share": Uniform(0.0, 0.5),
    "place_share": Uniform(0.0, 0.7),
}
_PROBE: Space = {"sweep_mm": Choice([2.0, 3.0, 4.0, 5.0]), "pattern": Choice(["apart", "together"])}
_MANY: Space = {"hypotheses": Choice([16, 32, 64])}


def _below(section: str, space: Space) -> Space:
    return {f"{section}.{name}": values for name, values in space.items()}


def _of_filters(play: bool = True, pictures: bool = False, many: bool = True, probe: bool = False) -> Space:
    """The space of a controller on filters."""
    filters = _FILTER | (_PLAY if play else {}) | (_PICTURES if pictures else {}) | (_MANY if many else {})
    steering = _STEERING | (_CROSSING if play else {})
    return _below("filter", filters) | _below("feedback", steering) | (_below("probe", _PROBE) if probe else {})


_OPEN_LOOP = Opponent(_open_loop, {"rest_tension": Uniform(3.0, 14.5)})
_ONE = {"filter": {"hypotheses": 1}}
_BLIND = {
    "open loop": _OPEN_LOOP,
    "kalman filter": Opponent(_filter, _of_filters(many=False), _ONE),
    "bank of filters": Opponent(_filter, _of_filters()),
    "probing bank": Opponent(_filter, _of_filters(probe=True)),
    "predictive bank": Opponent(_predictive, _of_filters(probe=True)),
}

_ARM: Space = _of_filters(many=False) | {
    "filter.offset_walk_mm": LogUniform(0.001, 0.5),
    "filter.tension_sd": LogUniform(0.1, 3.0),
    "feedback.damping": LogUniform(0.1, 3.0),
    "feedback.far": LogUniform(0.001, 0.1),
    "feedback.rest_tension": Uniform(1.5, 6.0),
}
_FEW: Space = {"filter.hypotheses": Choice([4, 8])}  # a filter of an arm takes 0.14 ms per step
_SHORT_PROBE: Space = {"probe.sweep_mm": Choice([1.0, 2.0, 3.0]), "probe.pattern": Choice(["apart", "together"])}
_BLIND_ARM = {
    "open loop": Opponent(_open_loop, {"rest_tension": Uniform(1.0, 8.0)}),
    "kalman filter": Opponent(_filter, _ARM, _ONE),
    "probing filter": Opponent(_filter, _ARM | _SHORT_PROBE, _ONE),
    "bank of filters": Opponent(_filter, _ARM | _FEW),
    "probing bank": Opponent(_filter, _ARM | _FEW | _SHORT_PROBE),
}


def _assuming(play_mm: tuple[float, float], sheath_friction: tuple[float, float]) -> Settings:
    return {"filter": {"play_mm": list(play_mm), "sheath_friction": list(sheath_friction)}}


_MILD, _WORN = _assuming((0.5, 2.0), (0.0, 0.3)), _assuming((0.5, 3.0), (0.0, 0.6))

WORLDS: Mapping[str, Mapping[str, Opponent]] = {
    "rj_gym/Instrument-v0": _BLIND,
    "rj_gym/InstrumentShift-v0": {
        "open loop": _OPEN_LOOP,
        "bank of filters": Opponent(_filter, _of_filters(), _MILD),
        "probing bank": Opponent(_filter, _of_filters(probe=True), _MILD),
        "widened bank": Opponent(_filter, _of_filters(), _WORN),
        "widened probing bank": Opponent(_filter, _of_filters(probe=True), _WORN),
    },
    "rj_gym/SlowCamera-v0": {
        "open loop": _OPEN_LOOP,
        "jacobian feedback": Opponent(_jacobian, _STEERING),
        "smith predictor": Opponent(_smith, _STEERING),
        "bank of filters": Opponent(_filter, _of_filters(play=False, pictures=True, many=False)),
        "predictive bank": Opponent(_predictive, _of_filters(play=False, pictures=True, many=False)),
    },
    "rj_gym/LatePose-v0": {
        "open loop": _OPEN_LOOP,
        "jacobian feedback": Opponent(_jacobian, _STEERING | _ASSUMED_PLAY),
        "smith predictor": Opponent(_smith, _STEERING | _ASSUMED_PLAY),
        "kalman filter": Opponent(_filter, _of_filters(pictures=True, many=False), _ONE),
        "bank of filters": Opponent(_filter, _of_filters(pictures=True)),
    },
    "rj_gym/ArmInstrument-v0": _BLIND_ARM,
}
"""By the id of an environment: its opponents by name."""


def opponents(env_id: str) -> dict[str, Controller]:
    """New controllers with their tuned settings, by name: those of tuned.yaml in this world.

    Raises:
        ConfigError: a world without opponents.
    """
    world = opponents_of(env_id)
    return {name: world[name].make(found["settings"]) for name, found in _tuned()[env_id].items()}


def tuned_settings(env_id: str, name: str) -> Settings:
    """The tuned settings of an opponent; raises ConfigError where there is none of this name."""
    known = _tuned()[as_choice("world", env_id, list(WORLDS), error=ConfigError)]
    settings: Settings = known[as_choice("opponent", name, list(known), error=ConfigError)]["settings"]
    return settings


def opponents_of(env_id: str) -> Mapping[str, Opponent]:
    """The opponents of a world; raises ConfigError where there are none."""
    return WORLDS[as_choice("world", env_id, list(WORLDS), error=ConfigError)]


@cache
def _tuned() -> Mapping[str, Any]:
    content: Any = read_yaml(TUNED)
    return {env_id: content.get(env_id, {}) for env_id in WORLDS}
