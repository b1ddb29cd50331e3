"""Settings and devices that cannot be used, each refused in one line that says what can be used instead."""

from __future__ import annotations

from typing import Any

import torch

from rj_gym.core.registry import TABLE, Registration
from rj_gym.planar.task import PlanarTask
from rollingjoint.differentiable import SideBySide
from rollingjoint.errors import InvalidInput

_INSTEAD = 'gymnasium.make_vec(id, num_envs, "vector_entry_point") has it, on the CPU.'


def checked_id(env_id: object) -> Registration:
    """The row of a planar tracking task in the table of environments; raises InvalidInput."""
    planar = {row.env_id: row for row in TABLE if row.folder == "planar"}
    if not isinstance(env_id, str) or env_id not in planar:
        raise InvalidInput("env_id", env_id, f"one of {', '.join(planar)}", _INSTEAD)
    return planar[env_id]


def checked_device(device: object) -> torch.device:
    """The device, the CPU or a CUDA device that is there; raises InvalidInput."""
    allowed = 'a torch device, "cpu" or "cuda"'
    try:
        chosen = torch.device(device)
    except (RuntimeError, TypeError):
        raise InvalidInput("device", device, allowed) from None
    if chosen.type not in ("cpu", "cuda"):
        raise InvalidInput("device", device, allowed, "Numbers have 64 bits.")
    if chosen.type == "cuda" and (chosen.index or 0) >= torch.cuda.device_count():
        raise InvalidInput("device", device, f"{allowed}; CUDA devices found: {torch.cuda.device_count()}")
    return chosen


def check_task(task: PlanarTask) -> None:
    """Refuse, with InvalidInput, what the formulas on the device leave out."""
    config, mechanism = task.config, task.mechanism
    friction: Any = config.friction or mechanism.friction
    if task.has_friction:
        raise InvalidInput("friction", friction, "None, and a mechanism without friction", _INSTEAD)
    check_mechanism("mechanism", mechanism, task)


def check_mechanism(what: str, mechanism: Any, task: PlanarTask) -> None:
    """Refuse, with InvalidInput, a mechanism that the tables on the device cannot hold beside the task's."""
    if mechanism.springs:
        raise InvalidInput(f"springs of {what}", mechanism.springs, "none", _INSTEAD)
    if mechanism.n_joints > SideBySide.most_joints:
        raise InvalidInput(f"joints of {what}", mechanism.n_joints, f"{SideBySide.most_joints} at most", _INSTEAD)
    if mechanism.has_friction:
        raise InvalidInput(f"friction of {what}", mechanism.friction, "none", _INSTEAD)
    if mechanism.last_links != task.mechanism.last_links:
        allowed = f"{task.mechanism.last_links}, as those of the environment's mechanism"
        raise InvalidInput(f"last links of the tendons of {what}", mechanism.last_links, allowed, _INSTEAD)
