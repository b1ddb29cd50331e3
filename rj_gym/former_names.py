"""Modules under the names that they had until version 0.1.0: pickles name the classes in them, and go on loading."""

from __future__ import annotations

import sys

from rj_gym import registry, tracking
from rj_gym.tracking import (
    arm,
    config,
    draws,
    env,
    episodes,
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

sys.modules |= {
    "rj_gym.core.config": config,
    "rj_gym.core.draws": draws,
    "rj_gym.core.hardware_draws": hardware,
    "rj_gym.core.observation": observation,
    "rj_gym.core.options": options,
    "rj_gym.core.registry": registry,
    "rj_gym.core.sensing": sensing,
    "rj_gym.core.tangent": tangent,
    "rj_gym.core.tracking_task": task,
    "rj_gym.rendering.tracking": render,
    "rj_gym.planar": tracking,
    "rj_gym.arm": tracking,
}
for _folder, _own in (("planar", planar), ("arm", arm)):
    _modules = {"config": config, "env": env, "episodes": episodes, "observation": observation, "options": options}
    _modules |= {"render": render, "sampling": _own, "task": _own, "vector": vector, "worlds": worlds}
    sys.modules |= {f"rj_gym.{_folder}.{_name}": _module for _name, _module in _modules.items()}
