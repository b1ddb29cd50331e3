"""Modules under the names that they had until version 0.1.0: pickles name the classes in them, and go on loading."""

from __future__ import annotations

import sys
from functools import wraps
from types import ModuleType
from typing import Any, NoReturn

from rj_gym import registry, rendering, tracking
from rj_gym.core import arguments, info
from rj_gym.tracking import (
    arm,
    arrays,
    config,
    draws,
    env,
    hardware,
    observation,
    options,
    planar,
    render,
    sensing,
    tangent,
    task,
    vector,
    worlds,
)
from rollingjoint.errors import InvalidInput


class FormerEnvironment:
    """Takes the place of parts of a whole environment in pickles: earlier versions were made of other parts."""

    def __new__(cls, *parts: object) -> NoReturn:
        """Raise InvalidInput, with the way to go on."""
        hint = "Make the environment anew; set_state() takes what get_state() of the earlier version has given."
        raise InvalidInput("pickle of an environment", "one of an earlier version", "one of this version", hint)


def _refuse_other_fields(arrays_class: Any) -> None:
    """Have pickles refused in which this NamedTuple has another number of fields."""
    make = arrays_class.__new__

    @wraps(make)
    def checked(cls: type, *values: Any, **named: Any) -> Any:
        complete = len(values) + len(named) == len(arrays_class._fields)
        return make(cls, *values, **named) if complete else FormerEnvironment(*values)

    arrays_class.__new__ = checked


for _class in (arrays.HardwareRules, arrays.Rules, arrays.Hardware):  # in every environment, unpickled first
    _refuse_other_fields(_class)
_episodes: Any = ModuleType("former episodes")
_info: Any = info
_episodes.PlanarEpisodeBuffer = _episodes.ArmEpisodeBuffer = _info.Places = FormerEnvironment
sys.modules |= {
    "rj_gym.core.config": config,
    "rj_gym.core.draws": draws,
    "rj_gym.core.hardware_draws": hardware,
    "rj_gym.core.observation": observation,
    "rj_gym.core.options": options,
    "rj_gym.core.registry": registry,
    "rj_gym.core.sensing": sensing,
    "rj_gym.core.sole_use": arguments,
    "rj_gym.core.state": arguments,
    "rj_gym.core.tangent": tangent,
    "rj_gym.core.tracking_task": task,
    "rj_gym.rendering.canvas": rendering,
    "rj_gym.rendering.tracking": render,
    "rj_gym.planar": tracking,
    "rj_gym.arm": tracking,
}
for _folder, _own in (("planar", planar), ("arm", arm)):
    _modules = {"config": config, "env": env, "observation": observation, "options": options}
    _modules |= {
        "episodes": _episodes,
        "render": render,
        "sampling": _own,
        "task": _own,
        "vector": vector,
        "worlds": worlds,
    }
    sys.modules |= {f"rj_gym.{_folder}.{_name}": _module for _name, _module in _modules.items()}
