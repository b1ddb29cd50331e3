"""Settings and devices that cannot be used, each refused in one line that names an alternative."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, fields
from typing import Any

import numpy as np
import torch

from rj_gym.core.settings import Settings
from rj_gym.registry import TABLE, Registration
from rj_gym.tracking.planar import PlanarTask
from rollingjoint.differentiable import SideBySide
from rollingjoint.errors import InvalidInput

TAKEN: Mapping[str, frozenset[str]] = {
    section: frozenset(names.split())
    for section, names in {
        "": "mechanism episode_steps action_scale_mm tension_range start start_tension start_tension_range "
        "command_scale_mm observe_tensions observe_load observe_history privileged",
        "load": "magnitude link process hold_steps correlation_steps",
        "target": "process tension_range waypoints loaded",
        "reward": "error_scale_mm effort smoothness failure_penalty goal goal_tolerance_mm precision",
        "randomization": "position_noise_mm angle_noise_rad stiffness_spread link_tolerance_mm link_tolerance_rad "
        "actuator_offset_mm",
        "sensing": "pose period delay position_bias_mm angle_bias_rad encoder_noise_mm encoder_resolution_mm "
        "tension_noise tension_resolution tension_at tension_gain_error tension_offset",
        "actuation": "play_mm sheath_friction rate_limit_mm delay dead_band_mm tension_limit limit_at "
        "current_resolution",
    }.items()
}
"""Names of the settings with which lanes on a device do what those of the native environment do, by section.

Any other is refused unless it is off: a setting at its default, a number of the reward at 0.
"""

_INSTEAD = 'gymnasium.make_vec(id, num_envs, "vector_entry_point") has it, on the CPU.'


def checked_id(env_id: object) -> Registration:
    """The row of a planar tracking task in the table of environments; raises InvalidInput."""
    planar = {row.env_id: row for row in TABLE if row.family == "planar"}
    if not isinstance(env_id, str) or env_id not in planar:
        raise InvalidInput("env_id", env_id, f"one of {', '.join(planar)}", _INSTEAD)
    return planar[env_id]


def checked_device(device: object) -> torch.device:
    """The device, the CPU or a CUDA device that is there; raises InvalidInput."""
    allowed = 'a torch device, "cpu" or "cuda"'
    try:
        selection = torch.device(device)
    except (RuntimeError, TypeError):
        raise InvalidInput("device", device, allowed) from None
    if selection.type not in ("cpu", "cuda"):
        raise InvalidInput("device", device, allowed, "Numbers have 64 bits.")
    if selection.type == "cuda" and (selection.index or 0) >= torch.cuda.device_count():
        raise InvalidInput("device", device, f"{allowed}; CUDA devices found: {torch.cuda.device_count()}")
    return selection


def check_task(task: PlanarTask) -> None:
    """Refuse, with InvalidInput, tasks outside the formulas on the device."""
    config, mechanism = task.config, task.mechanism
    friction: Any = config.friction or mechanism.friction
    if task.has_friction:
        raise InvalidInput("friction", friction, "None, and a mechanism without friction", _INSTEAD)
    _check_settings(config)
    check_mechanism("mechanism", mechanism, task)


def _check_settings(config: Settings) -> None:
    """Refuse, with InvalidInput, settings that are not known here, unless they are off."""
    for section, names in TAKEN.items():
        settings: Any = getattr(config, section) if section else config
        supported = names if section else names | TAKEN.keys()
        for name in [field.name for field in fields(settings) if field.name not in supported]:
            value, off = getattr(settings, name), _default(type(settings), name)
            if section == "reward" and isinstance(off, float):
                off = 0.0
            if not np.array_equal(value, off):
                what = f"{section}.{name}" if section else name
                raise InvalidInput(what, value, f"{off!r}, since lanes on a device do not have it", _INSTEAD)


def _default(kind: type[Settings], name: str) -> Any:
    """The default of a setting in the class that brought it; worlds may have others."""
    every = (getattr(base, "__dataclass_fields__", {}) for base in reversed(kind.__mro__))
    first = next(defaults[name] for defaults in every if name in defaults)
    return first.default if first.default_factory is MISSING else first.default_factory()


def check_mechanism(what: str, mechanism: Any, task: PlanarTask) -> None:
    """Refuse, with InvalidInput, a mechanism that the tables on the device cannot hold together with the task's."""
    if mechanism.springs:
        raise InvalidInput(f"springs of {what}", mechanism.springs, "none", _INSTEAD)
    if mechanism.n_joints > SideBySide.most_joints:
        raise InvalidInput(f"joints of {what}", mechanism.n_joints, f"{SideBySide.most_joints} at most", _INSTEAD)
    if mechanism.has_friction:
        raise InvalidInput(f"friction of {what}", mechanism.friction, "none", _INSTEAD)
    if mechanism.last_links != task.mechanism.last_links:
        allowed = f"{task.mechanism.last_links}, as those of the environment's mechanism"
        raise InvalidInput(f"last links of the tendons of {what}", mechanism.last_links, allowed, _INSTEAD)
