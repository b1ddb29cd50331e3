"""A table of the worlds: controllers that are tuned for each, with their settings."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

from agents.controllers.controller import Controller
from agents.controllers.filter_feedback import FilterFeedback, FilterFeedbackSettings, FilterPredictive
from agents.controllers.jacobian_feedback import JacobianFeedback
from agents.controllers.mpc import FilterMpc, FilterMpcSettings, SmootherMpc, SmootherMpcSettings
from agents.controllers.open_loop import OpenLoop
from agents.controllers.own_models import Nominal
from agents.controllers.search_space import Choice, LogUniform, Settings, Space, Uniform, with_settings
from agents.controllers.smith_predictor import SmithPredictor
from agents.controllers.smoother import SmootherFeedback, SmootherFeedbackSettings
from agents.controllers.steps import FeedbackSettings
from agents.runs.environment import EnvConfig
from rj_gym.registry import TABLE
from rollingjoint.checked_yaml import read_yaml
from rollingjoint.checks import as_choice, suggestion
from rollingjoint.errors import ConfigError

TUNED = Path(__file__).with_name("tuned.yaml")
BLIND = " blind"  # behind an id: its world where settings hide the tip, which its defaults show


@dataclass(frozen=True)
class Tunable:
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


def _smoother_in(env_id: str, bank: str) -> Callable[[Settings], Controller]:
    """Feedback on a smoother that falls back on the filters of this bank."""

    def make(settings: Settings) -> Controller:
        filters = {"filter": tuned_settings(env_id, bank)["filter"]}
        return SmootherFeedback(SmootherFeedbackSettings.from_dict(with_settings(filters, settings)))

    return make


def _nominal(make: Callable[[Settings], Controller]) -> Callable[[Settings], Controller]:
    """The same controller, told the number of links alone."""
    return lambda settings: Nominal(make(settings))


def _mpc_in(env_id: str, belief: str) -> Callable[[Settings], Controller]:
    """Predictive control from the tuned smoother of a world, or from a tuned bank or filter of this name."""

    def make(settings: Settings) -> Controller:
        base = with_settings(tuned_settings(env_id, belief), settings)
        if belief != "smoother":
            return FilterMpc(FilterMpcSettings.from_dict(base))
        filters = {"filter": tuned_settings(env_id, _FALL_BACK[_LATER.get(env_id, env_id)])["filter"]}
        return SmootherMpc(SmootherMpcSettings.from_dict(with_settings(filters, base)))

    return make


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


_FALL_BACK = {
    "rj_gym/Instrument-v0": "probing bank",
    "rj_gym/InstrumentShift-v0": "probing bank",
    "rj_gym/SlowCamera-v0": "bank of filters",
    "rj_gym/LatePose-v0": "bank of filters",
    "rj_gym/ArmInstrument-v0": "probing filter",
}
"""The banks that smoothers fall back on, by world."""

_SMOOTHER: Space = {
    "tension_sd": LogUniform(0.08, 0.3),
    "tension_share": LogUniform(0.001, 0.05),
    "robust": LogUniform(1.5, 6.0),
    "start_sd_mm": LogUniform(0.001, 0.1),
    "limit_sd": LogUniform(0.02, 0.5),
    "every": Choice([3, 6, 12]),
    "misfit": LogUniform(0.7, 5.0),
}
_SURE: Space = {"gain": Uniform(0.3, 1.0), "crossing": Uniform(0.8, 1.1), "dead_band_mm": LogUniform(0.005, 0.2)}


def _smoother(env_id: str) -> Tunable:
    space = _below("smoother", _SMOOTHER) | _below("feedback", _STEERING | _SURE) | _below("probe", _PROBE)
    return Tunable(_smoother_in(env_id, _FALL_BACK[env_id]), space)


def _smoother_of_pictures(env_id: str, play: bool) -> Tunable:
    smoother = _SMOOTHER | {"picture_share": LogUniform(0.7, 3.0)}
    space = _below("smoother", smoother) | _below("feedback", _STEERING | (_SURE if play else {}))
    return Tunable(_smoother_in(env_id, _FALL_BACK[env_id]), space, {"smoother": {"searches": 3}})


_PLANS: Space = {
    "mpc.bend": Uniform(0.0, 1.0),
    "mpc.fade": Uniform(0.3, 1.0),
    "mpc.solves": Choice([4, 6, 8]),
    "feedback.gain": Uniform(0.3, 1.0),
    "feedback.stiffen": LogUniform(0.003, 1.0),
    "feedback.damping": LogUniform(0.03, 2.0),
}
_PLANS_IN_PLAY: Space = _PLANS | _below(
    "feedback", {"crossing": _SURE["crossing"], "dead_band_mm": _SURE["dead_band_mm"]}
)


def _mpc(env_id: str, belief: str, play: bool = True) -> Tunable:
    return Tunable(_mpc_in(env_id, belief), _PLANS_IN_PLAY if play else _PLANS)


_OPEN_LOOP = Tunable(_open_loop, {"rest_tension": Uniform(3.0, 14.5)})
_ONE = {"filter": {"hypotheses": 1}}
_BLIND = {
    "open loop": _OPEN_LOOP,
    "kalman filter": Tunable(_filter, _of_filters(many=False), _ONE),
    "bank of filters": Tunable(_filter, _of_filters()),
    "probing bank": Tunable(_filter, _of_filters(probe=True)),
    "predictive bank": Tunable(_predictive, _of_filters(probe=True)),
    "smoother": _smoother("rj_gym/Instrument-v0"),
    "mpc": _mpc("rj_gym/Instrument-v0", "smoother"),
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
_BLIND_TUBE_SPACE: Space = _of_filters(many=False) | {
    "filter.force_walk": LogUniform(0.0003, 0.1),
    "filter.start_sd_mm": LogUniform(0.01, 1.0),
    "filter.offset_walk_mm": LogUniform(0.001, 0.1),
    "feedback.damping": LogUniform(0.1, 5.0),
    "feedback.far": LogUniform(0.001, 0.1),
    "feedback.dead_band_mm": LogUniform(0.005, 0.2),
}
_SHORTER_PROBE: Space = {"probe.sweep_mm": Choice([0.5, 1.0, 1.5]), "probe.pattern": Choice(["apart", "together"])}
_BLIND_TUBE = {
    "open loop": Tunable(_open_loop, {"rest_tension": Uniform(1.0, 14.5)}),
    "kalman filter": Tunable(_filter, _BLIND_TUBE_SPACE, _ONE),
    "probing filter": Tunable(_filter, _BLIND_TUBE_SPACE | _SHORTER_PROBE, _ONE),
}
_BLIND_ARM = {
    "open loop": Tunable(_open_loop, {"rest_tension": Uniform(1.0, 8.0)}),
    "kalman filter": Tunable(_filter, _ARM, _ONE),
    "probing filter": Tunable(_filter, _ARM | _SHORT_PROBE, _ONE),
    "bank of filters": Tunable(_filter, _ARM | _FEW),
    "probing bank": Tunable(_filter, _ARM | _FEW | _SHORT_PROBE),
}


_ARM_SMOOTHER: Space = (
    _below("smoother", {name: values for name, values in _SMOOTHER.items() if name != "start_sd_mm"})
    | {place: values for place, values in _ARM.items() if place.startswith("feedback.")}
    | _below("feedback", {"damping": LogUniform(0.05, 1.0), "crossing": Uniform(0.5, 1.1)})
    | _SHORT_PROBE
)


_MECHANISMS = f"rj_gym/ManyMechanisms-v0{BLIND}"
_WITHOUT_PLAY: Space = _below(
    "feedback", _STEERING | {"gain": Uniform(0.3, 1.0), "damping": LogUniform(0.03, 2.0)}
) | _below("probe", {"sweep_mm": Choice([0.0, 1.0, 2.0]), "pattern": Choice(["apart", "together"])})
_OF_MECHANISMS: Space = {
    "filter.force_walk": LogUniform(0.0003, 0.1),
    "filter.start_sd_mm": LogUniform(0.01, 3.0),
    "filter.offset_sd_mm": LogUniform(0.001, 0.6),
    "filter.offset_walk_mm": LogUniform(0.0003, 0.1),
    "filter.stiffness_sd": LogUniform(0.001, 0.25),
    "filter.tension_sd": _FILTER["tension_sd"],
    "filter.tension_share": _FILTER["tension_share"],
    **_WITHOUT_PLAY,
    "filter.tempering": _FILTER["tempering"],
}


def _smoother_of_mechanisms(tension_sd: LogUniform, tension_share: LogUniform, start_sd_mm: LogUniform) -> Space:
    smoother = _SMOOTHER | {"tension_sd": tension_sd, "tension_share": tension_share, "start_sd_mm": start_sd_mm}
    smoother |= {"every": Choice([1, 3, 6, 12]), "misfit": LogUniform(0.7, 50.0)}
    smoother |= {"searches": Choice([1, 2, 3]), "doubt": LogUniform(1.2, 5.0)}
    return _below("smoother", smoother) | _WITHOUT_PLAY


_TOLD = _smoother_of_mechanisms(LogUniform(0.05, 0.3), LogUniform(0.001, 0.05), LogUniform(0.001, 0.1))
_NOT_TOLD = _smoother_of_mechanisms(LogUniform(0.08, 3.0), LogUniform(0.001, 0.5), LogUniform(0.01, 3.0))
_BLIND_MECHANISMS = {  # told every design exactly; nominal ones the number of its links alone
    "open loop": _OPEN_LOOP,
    "kalman filter": Tunable(_filter, _OF_MECHANISMS, _ONE),
    "smoother": Tunable(_smoother_in(_MECHANISMS, "kalman filter"), _TOLD),
    "nominal open loop": Tunable(_nominal(_open_loop), _OPEN_LOOP.space),
    "nominal kalman filter": Tunable(_nominal(_filter), _OF_MECHANISMS, _ONE),
    "nominal smoother": Tunable(_nominal(_smoother_in(_MECHANISMS, "nominal kalman filter")), _NOT_TOLD),
}


_IN_SPACE = f"rj_gym/ManyMechanismsInSpace-v0{BLIND}"
_OF_TUBES: Space = _OF_MECHANISMS | {
    "feedback.damping": LogUniform(0.1, 5.0),
    "feedback.far": LogUniform(0.001, 0.1),
    "filter.force_walk": LogUniform(0.0003, 0.3),
}
_BLIND_TUBES = {  # as _BLIND_MECHANISMS; the smoother of arms knows no directions of gravity all around
    "open loop": Tunable(_open_loop, {"rest_tension": Uniform(1.0, 14.5)}),
    "kalman filter": Tunable(_filter, _OF_TUBES, _ONE),
    "nominal open loop": Tunable(_nominal(_open_loop), {"rest_tension": Uniform(1.0, 14.5)}),
    "nominal kalman filter": Tunable(_nominal(_filter), _OF_TUBES, _ONE),
}


def _assuming(play_mm: tuple[float, float], sheath_friction: tuple[float, float]) -> Settings:
    return {"filter": {"play_mm": list(play_mm), "sheath_friction": list(sheath_friction)}}


_MILD, _WORN = _assuming((0.5, 2.0), (0.0, 0.3)), _assuming((0.5, 3.0), (0.0, 0.6))

_FIRST: Mapping[str, Mapping[str, Tunable]] = {
    "rj_gym/Instrument-v0": _BLIND,
    "rj_gym/InstrumentShift-v0": {
        "open loop": _OPEN_LOOP,
        "bank of filters": Tunable(_filter, _of_filters(), _MILD),
        "probing bank": Tunable(_filter, _of_filters(probe=True), _MILD),
        "widened bank": Tunable(_filter, _of_filters(), _WORN),
        "widened probing bank": Tunable(_filter, _of_filters(probe=True), _WORN),
        "smoother": _smoother("rj_gym/InstrumentShift-v0"),
        "mpc": _mpc("rj_gym/InstrumentShift-v0", "smoother"),
    },
    "rj_gym/SlowCamera-v0": {
        "open loop": _OPEN_LOOP,
        "jacobian feedback": Tunable(_jacobian, _STEERING),
        "smith predictor": Tunable(_smith, _STEERING),
        "bank of filters": Tunable(_filter, _of_filters(play=False, pictures=True, many=False)),
        "predictive bank": Tunable(_predictive, _of_filters(play=False, pictures=True, many=False)),
        "smoother": _smoother_of_pictures("rj_gym/SlowCamera-v0", play=False),
        "mpc": _mpc("rj_gym/SlowCamera-v0", "smoother", play=False),
    },
    "rj_gym/LatePose-v0": {
        "open loop": _OPEN_LOOP,
        "jacobian feedback": Tunable(_jacobian, _STEERING | _ASSUMED_PLAY),
        "smith predictor": Tunable(_smith, _STEERING | _ASSUMED_PLAY),
        "kalman filter": Tunable(_filter, _of_filters(pictures=True, many=False), _ONE),
        "bank of filters": Tunable(_filter, _of_filters(pictures=True)),
        "smoother": _smoother_of_pictures("rj_gym/LatePose-v0", play=True),
        "mpc": _mpc("rj_gym/LatePose-v0", "smoother"),
    },
    "rj_gym/ArmInstrument-v0": _BLIND_ARM
    | {"smoother": Tunable(_smoother_in("rj_gym/ArmInstrument-v0", "probing filter"), _ARM_SMOOTHER)},
    f"rj_gym/PitchYaw-v0{BLIND}": _BLIND_TUBE,
    _MECHANISMS: _BLIND_MECHANISMS,
    _IN_SPACE: _BLIND_TUBES,
}
_LATER = {row.env_id: f"{row.world}-v0" for row in TABLE if row.version and row.tracks}  # and their first versions


def _later(env_id: str, first: str) -> Mapping[str, Tunable]:
    """The controllers of a later version: its smoother falls back on the bank with the settings of this version."""
    controllers = dict(_FIRST[first])
    if first in _FALL_BACK:
        smoother = controllers["smoother"]
        space = smoother.space | {"smoother.held_share": Uniform(0.0, 1.0)}  # limits differ from motor to motor there
        controllers["smoother"] = replace(smoother, make=_smoother_in(env_id, _FALL_BACK[first]), space=space)
    if "mpc" in controllers:
        controllers["mpc"] = replace(controllers["mpc"], make=_mpc_in(env_id, "smoother"))
    return controllers


WORLDS = {**_FIRST, **{env_id: _later(env_id, first) for env_id, first in _LATER.items()}}
"""By the name of a world, as of world_of: its controllers by name."""


def world_of(env: EnvConfig) -> str:
    """The name of an environment's world: its id, with BLIND behind it where only its settings hide pose and tip."""
    if not env.is_tracking:
        return env.id
    hidden, hidden_by_default = (each.arguments()["config"].sensing.pose == "none" for each in (env, EnvConfig(env.id)))
    return f"{env.id}{BLIND}" if hidden and not hidden_by_default else env.id


def tuned_controllers(world: str) -> dict[str, Controller]:
    """New controllers with their tuned settings, by name, as in tuned.yaml.

    A controller has in a later version of a world the settings that were tuned in its first until it has its own there.

    Raises:
        ConfigError: a world without any.
    """
    tunable = tunable_in(world)
    return {name: tunable[name].make(record["settings"]) for name, record in _tuned()[world].items()}


def tuned_settings(world: str, name: str) -> Settings:
    """The tuned settings of a controller; raises ConfigError where there is none of this name."""
    controllers = _tuned()[as_choice("world", world, list(WORLDS), error=ConfigError)]
    settings: Settings = controllers[as_choice("controller", name, list(controllers), error=ConfigError)]["settings"]
    return settings


def tunable_in(world: str) -> Mapping[str, Tunable]:
    """The controllers that are tuned for a world; raises ConfigError where there are none."""
    return WORLDS[as_choice("world", world, list(WORLDS), error=ConfigError)]


def hint(name: str, names: Iterable[str]) -> str:
    """A hint for a name that is none of these: the worlds that a controller of this name drives, or a similar one."""
    worlds = [env_id for env_id, controllers in WORLDS.items() if name in controllers]
    return f"It drives {', '.join(worlds)}." if worlds else suggestion(name, list(names))


@cache
def _tuned() -> Mapping[str, Any]:
    content: Any = read_yaml(TUNED)
    kept = {world: content.get(_LATER.get(world), {}) | content.get(world, {}) for world in WORLDS}
    return {world: {name: kept[world][name] for name in kept[world] if name in WORLDS[world]} for world in WORLDS}


opponents, opponents_of = tuned_controllers, tunable_in  # as they were called until 0.1.0
