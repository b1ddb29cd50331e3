"""The base of every settings class: construction from plain dictionaries, and fields that are checked once."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from typing import Any, ClassVar, Self, TypeVar

from rollingjoint.checks import suggestion
from rollingjoint.errors import ConfigError

Range = tuple[float, float]
S = TypeVar("S", bound="Settings")

LONGEST_EPISODE = 100_000
"""Steps of an episode at most: targets and loads of all of them are drawn when it begins."""


class Settings:
    """Frozen settings, built from keywords or plain dictionaries."""

    _SECTION: ClassVar[str] = ""  # the text before the names of the fields in messages

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """The defaults with `values` on top; nested settings are dictionaries.

        Raises:
            ConfigError: an unknown key (with the nearest valid one) or a value out of range.
        """
        return cls().updated(values)

    def updated(self, values: Mapping[str, Any]) -> Self:
        """These settings with `values` on top; a nested dictionary changes only the keys that it names."""
        if not isinstance(values, Mapping):
            raise ConfigError(type(self).__name__, values, "a dictionary of settings")
        check_keys(f"{type(self).__name__} key", values, [f.name for f in fields(self)])  # type: ignore[arg-type]
        merged = {}
        for key, value in values.items():
            current = getattr(self, key)
            nested = isinstance(current, Settings) and isinstance(value, Mapping)
            merged[key] = current.updated(value) if nested else value
        return replace(self, **merged)  # type: ignore[type-var]

    def _check(self, check: Callable[..., Any], *names: str, **allowed: Any) -> None:
        """Replace fields by their values from a function of rollingjoint.checks; ConfigError where it refuses."""
        for name in names:
            self._set(name, check(self._SECTION + name, getattr(self, name), **allowed, error=ConfigError))

    def _check_nested(self, kinds: Mapping[str, type[Settings]]) -> None:
        """Build nested settings that are given as dictionaries; ConfigError for anything else."""
        for name, kind in kinds.items():
            value = getattr(self, name)
            if isinstance(value, Mapping):
                self._set(name, kind.from_dict(value))
            elif not isinstance(value, kind):
                raise ConfigError(name, value, f"a dictionary or a {kind.__name__}")

    def _set(self, name: str, value: object) -> None:
        """Set a field while these frozen settings are being built."""
        object.__setattr__(self, name, value)


def made_settings(kind: type[S], config: S | Mapping[str, Any] | None, changes: Mapping[str, Any], goal: bool) -> S:
    """The settings of an environment: of its class, or from a dictionary, with changes on top.

    Raises:
        ConfigError: settings that cannot be used, or not with goals.
    """
    settings = config if isinstance(config, kind) else kind.from_dict(config or {})  # type: ignore[arg-type]
    settings = settings.updated(changes)
    if goal and getattr(settings, "is_instrumented", False):
        allowed = "their defaults in a Goal environment"
        hint = "Its achieved_goal is the true tip; use the id without Goal."
        raise ConfigError("sensing, actuation, observe_history, privileged", "changed", allowed, hint)
    if goal and (rewards := getattr(getattr(settings, "terms", None), "rewards", None)):
        hint = "Its reward is compute_reward of the goals alone."
        raise ConfigError("terms.rewards", sorted(rewards), "none in a Goal environment", hint)
    return settings


def check_keys(what: str, values: Mapping[str, Any], valid: list[str]) -> None:
    """Raise ConfigError for a key that is not valid, with the nearest valid one."""
    for key in values:
        if key not in valid:
            raise ConfigError(what, key, f"one of {', '.join(valid)}", suggestion(str(key), valid))
