"""The configuration of a training run: frozen, checked once when built, read from YAML."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from agents.runs.schedules import check_boolean, check_choice, check_integer, check_number
from agents.runs.algorithms import PARAMETERS, check_hindsight, check_parameters
from rollingjoint.checked_yaml import mapping, parse_yaml, read_yaml
from rollingjoint.errors import ConfigError

if TYPE_CHECKING:
    from rj_gym.core.config import TaskConfig


@dataclass(frozen=True)
class EnvConfig:
    """The environment: Gymnasium id, copies that are stepped together, and settings.

    For ids of rj_gym the settings are the keys of its settings class; else arguments of gymnasium.make.
    """

    id: str = "rj_gym/RollingJoint-v0"
    n_envs: int = 16
    settings: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not isinstance(self.id, str) or not self.id:
            raise ConfigError("env.id", self.id, "the id of a Gymnasium environment")
        check_integer("env.n_envs", self.n_envs, 1, 1024)
        if not isinstance(self.settings, Mapping):
            raise ConfigError("env.settings", self.settings, "a mapping of settings to values")
        self.arguments()

    def arguments(self) -> dict[str, Any]:
        """Keyword arguments for gymnasium.make; raises ConfigError for settings the environment does not have."""
        if not self.id.startswith("rj_gym/"):
            return dict(self.settings)
        from rj_gym import settings_of

        kind = settings_of(self.id)
        try:
            return {"config": kind.from_dict(copy.deepcopy(dict(self.settings)))}
        except ConfigError as error:
            raise ConfigError(f"env.settings: {error.what}", error.value, error.allowed, error.hint) from error

    @property
    def episode_steps(self) -> int | None:
        """Steps of an episode; None for an environment that is not one of rj_gym."""
        config = self.arguments().get("config") if self.id.startswith("rj_gym/") else None
        return None if config is None else config.episode_steps


def plain_settings(config: TaskConfig) -> dict[str, Any]:
    """All settings of a tracking environment but the mechanism, as plain values."""
    either_task: Any = config
    values = asdict(replace(either_task, mechanism=""))
    del values["mechanism"]
    return values


@dataclass(frozen=True)
class PolicyConfig:
    """The networks: hidden layers, activation, first log standard deviation (PPO).

    `value_hidden` are the hidden layers of the value functions; None: those of the policy.
    """

    hidden: Sequence[int] = (64, 64)
    value_hidden: Sequence[int] | None = None
    activation: str = "tanh"
    log_std_init: float = 0.0

    def __post_init__(self) -> None:
        for name in ("hidden", "value_hidden"):
            widths = getattr(self, name)
            if widths is not None or name == "hidden":
                object.__setattr__(self, name, _layer_widths(f"policy.{name}", widths))
        check_choice("policy.activation", self.activation, ("tanh", "relu", "elu"))
        check_number("policy.log_std_init", self.log_std_init, -10.0, 3.0)


def _layer_widths(what: str, widths: Any) -> tuple[int, ...]:
    if not isinstance(widths, list | tuple):
        raise ConfigError(what, widths, "a list of layer widths")
    for width in widths:
        check_integer(what, width, 1, 4096)
    return tuple(widths)


@dataclass(frozen=True)
class HerConfig:
    """Hindsight experience replay: `goals` relabelled transitions to every real one, and which states become goals.

    Source: Andrychowicz et al., Hindsight Experience Replay, 2017.
    """

    goals: int = 4
    strategy: str = "future"

    def __post_init__(self) -> None:
        check_integer("her.goals", self.goals, 1, 100)
        check_choice("her.strategy", self.strategy, ("future", "final", "episode"))


@dataclass(frozen=True)
class NormaliseConfig:
    """Running normalisation of observations and rewards (VecNormalize)."""

    observation: bool = True
    reward: bool = True

    def __post_init__(self) -> None:
        check_boolean("normalise.observation", self.observation)
        check_boolean("normalise.reward", self.reward)


@dataclass(frozen=True)
class EvaluationConfig:
    """Evaluation during training: every so many steps, on `episodes` fixed seeds from `seed` on."""

    every: int = 50_000
    episodes: int = 40
    seed: int = 1_000_000

    def __post_init__(self) -> None:
        check_integer("evaluation.every", self.every, 1)
        check_integer("evaluation.episodes", self.episodes, 1)
        check_integer("evaluation.seed", self.seed, 0, 2**31)


@dataclass(frozen=True)
class TrainConfig:
    """Everything that a training run depends on; steps are counted over all environments together."""

    algorithm: str = "ppo"
    total_timesteps: int = 1_000_000
    seed: int = 0
    env: EnvConfig = field(default_factory=EnvConfig)
    parameters: Mapping[str, Any] = field(default_factory=dict)
    policy: PolicyConfig = field(default_factory=PolicyConfig)
    normalise: NormaliseConfig = field(default_factory=NormaliseConfig)
    her: HerConfig | None = None
    evaluation: EvaluationConfig = field(default_factory=EvaluationConfig)
    checkpoint_every: int = 250_000
    torch_threads: int = 1

    def __post_init__(self) -> None:
        check_choice("algorithm", self.algorithm, tuple(PARAMETERS))
        check_integer("total_timesteps", self.total_timesteps, 1)
        check_integer("seed", self.seed, 0, 2**31)
        check_integer("checkpoint_every", self.checkpoint_every, 1)
        check_integer("torch_threads", self.torch_threads, 1, 256)
        check_parameters(self.algorithm, self.parameters, self.env.n_envs)
        if self.her is not None:
            check_hindsight(self.algorithm, self.parameters, self.env.n_envs, self.env.episode_steps)

    @classmethod
    def from_dict(cls, values: Any) -> TrainConfig:
        """The configuration in plain values; raises ConfigError naming the key."""
        values = dict(mapping("top level", values, [f.name for f in fields(cls)]))
        for name, section in SECTIONS.items():
            if name in values and not (name == "her" and values[name] is None):
                values[name] = section(**mapping(name, values[name], [f.name for f in fields(section)]))
        return cls(**values)

    def to_dict(self) -> dict[str, Any]:
        """Plain values, ready for YAML; from_dict gives the same configuration back."""
        values = asdict(self)
        for name in ("hidden", "value_hidden"):
            widths = values["policy"][name]
            values["policy"][name] = None if widths is None else list(widths)
        return values


SECTIONS: dict[str, type] = {
    "env": EnvConfig,
    "policy": PolicyConfig,
    "normalise": NormaliseConfig,
    "her": HerConfig,
    "evaluation": EvaluationConfig,
}


def load_config(path: str | Path, overrides: Sequence[str] = ()) -> TrainConfig:
    """The configuration in a YAML file, with "section.key=value" overrides on top.

    `env.file` names a YAML file of environment settings, relative to this file; `env.settings` goes on top of it.
    Raises ConfigError that names the file, the key and the nearest valid key.
    """
    path = Path(path)
    values = _section(read_yaml(path), str(path))
    source = f"{path} with --set" if overrides else str(path)
    try:
        values = apply_overrides(values, overrides)
        if isinstance(values.get("env"), dict):
            values["env"] = _resolve_env(values["env"], path.parent)
        return TrainConfig.from_dict(values)
    except ConfigError as error:
        raise ConfigError(f"{source}: {error.what}", error.value, error.allowed, error.hint) from error


def apply_overrides(values: dict[str, Any], overrides: Sequence[str]) -> dict[str, Any]:
    """A copy of nested values with each "section.key=value" set; the value is read as YAML."""
    values = copy.deepcopy(values)
    for text in overrides:
        keys, equals, value = text.partition("=")
        *sections, key = keys.strip().split(".")
        if not equals or not key or not all(sections):
            raise ConfigError("--set", text, "section.key=value, for example parameters.gamma=0.9")
        place = values
        for section in sections:
            if not isinstance(place.setdefault(section, {}), dict):
                raise ConfigError("--set", text, f"a key of a section; '{section}' is a value")
            place = place[section]
        place[key] = parse_yaml(value, f"--set {text}")
    return values


def _resolve_env(env: dict[str, Any], folder: Path) -> dict[str, Any]:
    """The env section with the settings of `env.file` read in and mechanism files found beside their configuration."""
    env = dict(mapping("env", env, ["file", *(f.name for f in fields(EnvConfig))]))
    name = env.pop("file", None)
    settings = _with_mechanism(env.get("settings"), folder)
    if name is not None:
        if not isinstance(name, str):
            raise ConfigError("env.file", name, "the path of a YAML file")
        path = folder / name
        settings = _merged(_with_mechanism(_section(read_yaml(path), str(path)), path.parent), settings)
    return env | {"settings": settings}


def _section(values: object, where: str) -> dict[str, Any]:
    """A copy of a mapping read from YAML; nothing is an empty one."""
    if values is not None and not isinstance(values, dict):
        raise ConfigError(where, values, "a mapping of keys to values")
    return dict(values or {})


def _with_mechanism(settings: Any, folder: Path) -> dict[str, Any]:
    """The settings; a `mechanism` that names a file in `folder` gets its whole path."""
    settings = _section(settings, "env.settings")
    mechanism = settings.get("mechanism")
    if isinstance(mechanism, str) and (folder / mechanism).is_file():
        settings["mechanism"] = str((folder / mechanism).resolve())
    return settings


def _merged(below: dict[str, Any], above: dict[str, Any]) -> dict[str, Any]:
    both = dict(below)
    for key, value in above.items():
        nested = isinstance(value, dict) and isinstance(both.get(key), dict)
        both[key] = _merged(both[key], value) if nested else value
    return both
