"""The table of registered environments: for every id its classes, its settings and its task."""

from __future__ import annotations

import importlib
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, overload

import gymnasium

from rj_gym.core.settings import Settings, made_settings
from rj_gym.core.task import Task
from rj_gym.tracking.config import TaskConfig
from rj_gym.tracking.task import TrackingTask
from rollingjoint.errors import ConfigError


@dataclass(frozen=True)
class Registration:
    """One environment id; the modules that it names are imported when they are first needed.

    Args:
        env_id: the id.
        stem: of its classes: <stem>Env in the folder's env.py, and <stem>VectorEnv in its vector.py for make_vec.
        family: of mechanisms: "planar", "arm" or "many" for the tracking tasks, "design", or "surroundings".
        settings: the class of its settings, in the folder's `settings_module`.
        settings_module: config, or worlds: other defaults of the settings in config.
    """

    env_id: str
    stem: str
    family: str
    settings: str
    settings_module: str = "config"

    @property
    def version(self) -> int:
        """Of the environment: 1 of rj_gym/Instrument-v1."""
        return version_of(self.env_id)

    @property
    def world(self) -> str:
        """The id without its version, which all versions share."""
        return self.env_id.rpartition("-v")[0]

    @property
    def has_goals(self) -> bool:
        """Whether it is a goal environment."""
        return self.stem.endswith("Goal")

    @property
    def tracks(self) -> bool:
        """Whether the task is to track a target with the tip."""
        return self.family in ("planar", "arm", "many")

    @property
    def has_policies(self) -> bool:
        """Whether policies for it can be shipped: for tasks of a mechanism that is driven by its tendons."""
        return self.family != "design"

    @property
    def folder(self) -> str:
        """The package that its classes are in."""
        return "rj_gym.tracking" if self.family in ("planar", "arm") else f"rj_gym.{self.family}"

    @property
    def classes(self) -> dict[str, str]:
        """The names of its classes and the modules that they are in."""
        modules = {f"{self.stem}Env": "env", f"{self.stem}VectorEnv": "vector", self.settings: self.settings_module}
        return {name: f"{self.folder}.{module}" for name, module in modules.items()}

    @property
    def settings_class(self) -> Any:
        """The class of its settings."""
        return late(self.classes[self.settings], self.settings)

    @property
    def env_class(self) -> Any:
        """The class of its scalar environment."""
        return late(f"{self.folder}.env", f"{self.stem}Env")


_FIRST = tuple(
    Registration(f"rj_gym/{stem}-v0", stem, family, *settings)
    for stem, family, *settings in (
        ("RollingJoint", "planar", "TrackingConfig"),
        ("RollingJointGoal", "planar", "TrackingConfig"),
        ("FlexibleArm", "arm", "FlexibleArmConfig"),
        ("FlexibleArmGoal", "arm", "FlexibleArmConfig"),
        ("PitchYaw", "arm", "PitchYawConfig"),
        ("Instrument", "planar", "InstrumentConfig", "worlds"),
        ("InstrumentShift", "planar", "InstrumentShiftConfig", "worlds"),
        ("SlowCamera", "planar", "SlowCameraConfig", "worlds"),
        ("LatePose", "planar", "LatePoseConfig", "worlds"),
        ("ArmInstrument", "arm", "ArmInstrumentConfig", "worlds"),
        ("ManyMechanisms", "many", "ManyMechanismsConfig"),
        ("ManyMechanismsInSpace", "many", "ManyMechanismsInSpaceConfig"),
        ("CurvatureDesign", "design", "DesignConfig"),
        ("CoDesign", "design", "CoDesignConfig"),
        ("Lumen", "surroundings", "LumenConfig"),
        ("Obstacles", "surroundings", "ObstaclesConfig"),
        ("HiddenWall", "surroundings", "HiddenWallConfig"),
    )
)

TABLE = _FIRST + tuple(
    Registration(f"rj_gym/{row.stem}-v1", f"{row.stem}V1", row.family, f"{row.stem}V1Config", row.settings_module)
    for row in _FIRST
    if row.settings_module == "worlds" or row.stem == "Obstacles"
)


def register_envs() -> None:
    """Register every id that is not registered yet; Gymnasium then does not call first versions out of date."""
    warnings.filterwarnings("ignore", r".*rj_gym/\S+ is out of date", DeprecationWarning)
    for row in TABLE:
        if row.env_id not in gymnasium.registry:
            gymnasium.register(
                row.env_id,
                entry_point=f"{row.folder}.env:{row.stem}Env",
                vector_entry_point=f"{row.folder}.vector:{row.stem}VectorEnv",
                disable_env_checker=True,  # the environments themselves check their input and the order of calls
                order_enforce=False,
            )


def row_of(env_id: str) -> Registration | None:
    """The row of an id, or of the class of rj_gym that is the entry point of an id registered elsewhere; else None.

    The module of "module:id" is not imported here.
    """
    for row in TABLE:
        if row.env_id == env_id:
            return row
    spec = gymnasium.registry.get(env_id.rpartition(":")[2])
    if spec is None or not isinstance(spec.entry_point, str):
        return None
    module, _, name = spec.entry_point.partition(":")
    classes = {f"{row.stem}Env": row for row in TABLE}
    return classes.get(name) if module.partition(".")[0] == "rj_gym" else None


def registered_settings(env_id: str, changes: Mapping[str, Any]) -> Settings:
    """The settings with which an id of rj_gym, or one that is registered elsewhere for its classes, is made.

    Args:
        changes: settings on top of those that it was registered with.
    Raises:
        ConfigError: settings that cannot be used, or an id that `row_of` does not have.
    """
    kind, arguments = settings_of(env_id), _registered_arguments(env_id)
    if not arguments:
        return kind.from_dict(changes)
    is_goal = bool((row := row_of(env_id)) and row.has_goals)
    return made_settings(kind, arguments.pop("config", None), arguments | dict(changes), is_goal)


def making_arguments(env_id: str, config: Settings) -> dict[str, Any]:
    """The arguments of gymnasium.make for these settings, also where the id was registered with other ones."""
    names = _registered_arguments(env_id).keys() - {"config"}
    return {"config": config, **{name: getattr(config, name) for name in names}}


def _registered_arguments(env_id: str) -> dict[str, Any]:
    """The settings among the arguments that an id was registered with, and `config`."""
    spec = gymnasium.registry.get(env_id.rpartition(":")[2])
    names = {"config", *(field.name for field in fields(settings_of(env_id)))}  # type: ignore[arg-type]
    return {} if spec is None else {name: value for name, value in spec.kwargs.items() if name in names}


def settings_of(env_id: str) -> type[Settings]:
    """The class of the settings of an id, as `row_of` has it; raises ConfigError for another id."""
    if (row := row_of(env_id)) is not None:
        kind: type[Settings] = row.settings_class
        return kind
    raise ConfigError("environment", env_id, f"one of {', '.join(row.env_id for row in TABLE)}")


def registration_of(config: Settings) -> Registration | None:
    """The row of the class of these settings, or of the nearest base class that has one; None where there is none.

    Environments with and without goals share settings; their row is the one without.
    """
    rows = {row.settings: row for row in reversed(TABLE)}
    return next((rows[kind.__name__] for kind in type(config).__mro__ if kind.__name__ in rows), None)


def version_of(env_id: str) -> int:
    """The version of an environment, 1 of rj_gym/Instrument-v1; 0 for an id without one."""
    number = env_id.rpartition("-v")[2]
    return int(number) if number.isdecimal() else 0


@overload
def task_of(config: TaskConfig) -> TrackingTask: ...
@overload
def task_of(config: Settings) -> Task: ...
def task_of(config: Settings) -> Any:
    """The task of these settings.

    Raises:
        ConfigError, MechanismError: settings of no task, or a mechanism that cannot be loaded.
    """
    if (row := registration_of(config)) is not None:
        return row.env_class.task_class(config)
    raise ConfigError("settings", config, f"of {', '.join(dict.fromkeys(row.settings for row in TABLE))}")


def late(module: str, name: str) -> Any:
    """An attribute of a module, which is imported when this is called."""
    return getattr(importlib.import_module(module), name)
