"""The environment of a benchmark: its identity, its plain form in files, and changed settings."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from agents.results.record import BenchmarkRecord
from agents.runs.environment import EnvConfig, plain_settings
from rj_gym.registry import task_of
from rollingjoint.io.mechanism_file import mechanism_from_dict, mechanism_to_dict

OWN_MATTER = ("reward", "observe_history", "privileged")
"""Settings that a learner chooses for itself: they change neither the episodes nor the information about them."""


def common(env: EnvConfig) -> EnvConfig:
    """The environment that all controllers of a benchmark share: one observed vector, no setting of a learner."""
    settings = {name: value for name, value in env.settings.items() if name not in OWN_MATTER}
    return EnvConfig(env.id.replace("Goal-", "-"), settings=settings)


def episodes_key(env: EnvConfig) -> str:
    """Equal for tracking environments with the same episodes and the same measurements in them."""
    shared = common(env)
    settings = {name: value for name, value in shared.complete_settings().items() if name not in OWN_MATTER}
    return json.dumps([shared.id, settings], sort_keys=True)


def plain(env: EnvConfig) -> dict[str, Any]:
    """All settings of the common environment as JSON has them, the mechanism as its numbers."""
    config = common(env).arguments()["config"]
    mechanism = mechanism_to_dict(task_of(config).mechanism)
    settings: dict[str, Any] = json.loads(json.dumps(plain_settings(config) | {"mechanism": mechanism}))
    return settings


def environment_of(record: BenchmarkRecord) -> EnvConfig:
    """The environment of a record; raises ConfigError or MechanismError where this version does not have it."""
    settings = dict(record.settings)
    return EnvConfig(record.env_id, settings=settings | {"mechanism": mechanism_from_dict(settings["mechanism"])})


def changed(env: EnvConfig, changes: Mapping[str, Any]) -> EnvConfig:
    """The environment with these nested settings changed; raises ConfigError for settings that it refuses."""
    return EnvConfig(env.id, env.n_envs, _merged(env.settings, changes))


def setting(env: EnvConfig, *keys: str) -> Any:
    """A setting by its nested keys, defaults included; None where the environment has no such setting."""
    value: Any = env.arguments()["config"]
    for key in keys:
        value = getattr(value, key, None)
    return value


def _merged(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    settings = dict(below)
    for key, value in above.items():
        settings[key] = _merged(settings.get(key) or {}, value) if isinstance(value, Mapping) else value
    return settings
