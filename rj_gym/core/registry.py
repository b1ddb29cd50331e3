"""The table of registered environments: for every id its classes, its folder, its settings and its task."""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, overload

import gymnasium

from rollingjoint.errors import ConfigError

if TYPE_CHECKING:
    from rj_gym.core.config import TaskConfig
    from rj_gym.core.settings import Settings
    from rj_gym.core.task import Task
    from rj_gym.core.tracking_task import TrackingTask


@dataclass(frozen=True)
class Registration:
    """One environment id; everything that it names is imported when it is first needed.

    Args:
        env_id: the id.
        stem: of its classes: <stem>Env in the folder's env.py, and <stem>VectorEnv in its vector.py for make_vec.
        folder: of rj_gym.
        settings: the class of its settings, in the folder's `settings_module`.
        task: the class of its task, in the folder's task.py.
        tracks: whether the task is to track a target with the tip.
        settings_module: config, or worlds: other defaults of the settings in config.
    """

    env_id: str
    stem: str
    folder: str
    settings: str
    task: str
    tracks: bool = True
    settings_module: str = "config"

    @property
    def classes(self) -> dict[str, str]:
        """The names of its classes and the modules that they are in."""
        modules = {f"{self.stem}Env": "env", f"{self.stem}VectorEnv": "vector", self.settings: self.settings_module}
        return {name: f"rj_gym.{self.folder}.{module}" for name, module in modules.items()}


_WORLD: dict[str, Any] = {"settings_module": "worlds"}
TABLE = (
    Registration("rj_gym/RollingJoint-v0", "RollingJoint", "planar", "TrackingConfig", "PlanarTask"),
    Registration("rj_gym/RollingJointGoal-v0", "RollingJointGoal", "planar", "TrackingConfig", "PlanarTask"),
    Registration("rj_gym/FlexibleArm-v0", "FlexibleArm", "arm", "FlexibleArmConfig", "ArmTask"),
    Registration("rj_gym/FlexibleArmGoal-v0", "FlexibleArmGoal", "arm", "FlexibleArmConfig", "ArmTask"),
    Registration("rj_gym/Instrument-v0", "Instrument", "planar", "InstrumentConfig", "PlanarTask", **_WORLD),
    Registration(
        "rj_gym/InstrumentShift-v0", "InstrumentShift", "planar", "InstrumentShiftConfig", "PlanarTask", **_WORLD
    ),
    Registration("rj_gym/SlowCamera-v0", "SlowCamera", "planar", "SlowCameraConfig", "PlanarTask", **_WORLD),
    Registration("rj_gym/LatePose-v0", "LatePose", "planar", "LatePoseConfig", "PlanarTask", **_WORLD),
    Registration("rj_gym/ArmInstrument-v0", "ArmInstrument", "arm", "ArmInstrumentConfig", "ArmTask", **_WORLD),
    Registration("rj_gym/CurvatureDesign-v0", "CurvatureDesign", "design", "DesignConfig", "DesignTask", tracks=False),
)


def register_envs() -> None:
    """Register every id that is not registered yet."""
    for row in TABLE:
        if row.env_id not in gymnasium.registry:
            gymnasium.register(
                row.env_id,
                entry_point=f"rj_gym.{row.folder}.env:{row.stem}Env",
                vector_entry_point=f"rj_gym.{row.folder}.vector:{row.stem}VectorEnv",
                disable_env_checker=True,  # the environments themselves check their input and the order of calls
                order_enforce=False,
            )


def settings_of(env_id: str) -> type[Settings]:
    """The class of the settings of a registered id; raises ConfigError for another id."""
    for row in TABLE:
        if row.env_id == env_id:
            kind: type[Settings] = late(f"rj_gym.{row.folder}.{row.settings_module}", row.settings)
            return kind
    raise ConfigError("environment", env_id, f"one of {', '.join(row.env_id for row in TABLE)}")


@overload
def task_of(config: TaskConfig) -> TrackingTask: ...
@overload
def task_of(config: Settings) -> Task: ...
def task_of(config: Settings) -> Any:
    """The task of these settings.

    Raises:
        ConfigError, MechanismError: settings of no task, or a mechanism that cannot be loaded.
    """
    names = [kind.__name__ for kind in type(config).__mro__]
    for row in TABLE:
        if row.settings in names:
            return late(f"rj_gym.{row.folder}.task", row.task)(config)
    raise ConfigError("settings", config, f"of {', '.join(dict.fromkeys(row.settings for row in TABLE))}")


def late(module: str, name: str) -> Any:
    """An attribute of a module, which is imported when this is called."""
    return getattr(importlib.import_module(module), name)
