"""What a configuration adds to a training by name: wrappers of its environment, callbacks, a tracker.

A name is that of a class in a library's own list, or MODULE:CLASS of a module that the command allows (--import).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import Any, TypeVar

import gymnasium
from gymnasium.vector import VectorEnv, VectorRewardWrapper, VectorWrapper
from gymnasium.wrappers import vector

from agents.runs.checks import Check
from agents.runs.consent import check_named, imported
from rollingjoint.checks import suggestion
from rollingjoint.errors import ConfigError, MissingPackage, naming_extras

Addition = Mapping[str, Mapping[str, Any]]
"""{NAME: {argument: value}}, of one name."""

Env = TypeVar("Env", gymnasium.Env[Any, Any], VectorEnv[Any, Any, Any])

TRACKED = ("project", "entity", "group", "job_type", "name", "tags", "notes", "mode", "monitor_gym")
"""Arguments of wandb.init that a configuration may set."""

_MOST = 32
_WRITTEN = {"video_folder", "save_path"}  # arguments of Gymnasium's and Stable-Baselines3's classes that write files
_WRAPPERS = {"": "gymnasium.wrappers", "vector.": "gymnasium.wrappers.vector"}
_FILMING = (gymnasium.wrappers.RecordVideo, vector.RecordVideo)
_SHOWING = (gymnasium.wrappers.HumanRendering, vector.HumanRendering)
_OF_TRAINING = (
    *_FILMING,
    *_SHOWING,
    gymnasium.RewardWrapper,
    VectorRewardWrapper,
    gymnasium.wrappers.NormalizeReward,
    vector.NormalizeReward,
)
"""Wrappers that change neither what a policy sees nor what its actions do."""


def _checked(what: str, values: Any) -> tuple[Addition, ...]:
    if not isinstance(values, list | tuple) or len(values) > _MOST:
        raise ConfigError(what, values, f"a list of at most {_MOST}, each NAME or NAME: {{argument: value}}")
    return tuple(_addition(what, value) for value in values)


def _addition(what: str, value: Any) -> Addition:
    """An addition with its arguments written out; raises ConfigError."""
    named = {value: None} if isinstance(value, str) else value
    if isinstance(named, Mapping) and len(named) == 1 and all(isinstance(name, str) for name in named):
        ((name, arguments),) = named.items()
        arguments = {} if arguments is None else arguments
        if isinstance(arguments, Mapping) and all(isinstance(key, str) for key in arguments):
            for key in _WRITTEN & arguments.keys():
                _check_below(f"{what}: {name}.{key}", arguments[key])
            return {name: dict(arguments)}
    raise ConfigError(what, value, "NAME, or NAME: {argument: value}")


def _tracker(what: str, value: Any) -> Addition | None:
    if value is None:
        return None
    ((name, arguments),) = _addition(what, value).items()
    if name != "wandb":
        raise ConfigError(what, name, "null or wandb", "Others read logs/ in the run folder, or are callbacks.")
    if unknown := sorted(set(arguments) - set(TRACKED)):
        raise ConfigError(f"{what}.wandb", unknown[0], ", ".join(TRACKED), suggestion(unknown[0], TRACKED))
    return {name: arguments}


additions = Check(_checked, "a list of `NAME`, `NAME: {argument: value}`")
tracker = Check(_tracker, "null; `wandb`, `wandb: {argument: value}`")


def class_of(what: str, name: str, places: Mapping[str, str], kinds: tuple[type, ...]) -> type:
    """The class of this name: in a module of `places`, by the prefix of its name, or MODULE:CLASS.

    Raises:
        ConfigError: no such class, one that is no subclass of `kinds`, or a module that the command does not allow.
    """
    listed = {f"{prefix}{each}": place for prefix, place in places.items() for each in _classes(place, kinds)}
    ours = f"a class of {' or '.join(places.values())}"
    module, _, attribute = name.rpartition(":")
    if module:
        check_named(what, name, module, ours)
        place = imported(module)
    elif name in listed:
        place, attribute = import_module(listed[name]), name.rpartition(".")[2]
    else:
        raise ConfigError(what, name, f"{ours}, or MODULE:CLASS", suggestion(name, list(listed)))
    found = getattr(place, attribute, None)
    if not (isinstance(found, type) and issubclass(found, kinds)):
        raise ConfigError(what, name, f"a subclass of {' or '.join(kind.__name__ for kind in kinds)}")
    return found


def _classes(place: str, kinds: tuple[type, ...]) -> list[str]:
    """Names of the classes of these kinds in a module, without those that it loads when they are asked for."""
    members = vars(import_module(place)).items()
    return [name for name, value in members if isinstance(value, type) and issubclass(value, kinds)]


def made(what: str, kind: type, arguments: Mapping[str, Any], *first: Any) -> Any:
    """An instance of a class of `class_of`; whatever it raises becomes a ConfigError."""
    try:
        return kind(*first, **arguments)
    except MissingPackage:
        raise
    except Exception as error:  # of code that anybody may have written
        reason = f"{type(error).__name__}: {error}"
        raise ConfigError(what, dict(arguments), f"arguments that {kind.__name__} takes here", reason) from error


def _check_below(what: str, path: Any) -> None:
    """Raise ConfigError unless a file's path of something to be written stays below the working directory."""
    parts = str(path).replace("\\", "/").split("/")
    if ".." in parts or parts[0] in ("", "~") or ":" in parts[0]:
        raise ConfigError(what, path, "a path below the working directory, without ..")


def check_wrappers(wrappers: Sequence[Addition]) -> None:
    """Raise ConfigError unless these are wrappers, of scalar environments alone or of vector environments alone."""
    kinds = [_wrapper(name) for each in wrappers for name in each]
    if len({issubclass(kind, VectorWrapper) for kind in kinds}) > 1:
        names = [name for each in wrappers for name in each]
        hint = "Those of vector environments are named vector.NAME."
        raise ConfigError("wrappers", names, "all of scalar environments, or all of vector environments", hint)


def _wrapper(name: str) -> type:
    found = class_of("wrappers", name, _WRAPPERS, (gymnasium.Wrapper, VectorWrapper))
    if issubclass(found, gymnasium.wrappers.NormalizeObservation | vector.NormalizeObservation):
        hint = "Its averages would be lost; normalise.observation keeps them with the policy."
        raise ConfigError("wrappers", name, "a wrapper without averages of observations", hint)
    return found


def are_scalar(wrappers: Sequence[Addition]) -> bool:
    """Whether there are wrappers, and they are those of scalar environments."""
    return any(not issubclass(_wrapper(name), VectorWrapper) for each in wrappers for name in each)


def of_policy(wrappers: Sequence[Addition]) -> tuple[Addition, ...]:
    """The wrappers that a policy acts through: all but those of rewards, videos and windows."""
    return tuple(each for each in wrappers if not _is(each, _OF_TRAINING))


class Unshown(gymnasium.Wrapper[Any, Any, Any, Any]):
    """A lane beside one in a window, with its render mode: Stable-Baselines3 wants one of all lanes."""

    render_mode = "human"


def are_shown(wrappers: Sequence[Addition]) -> bool:
    """Whether wrappers of scalar environments show one in a window."""
    return any(_is(each, _SHOWING) for each in wrappers)


def of_other_lanes(wrappers: Sequence[Addition]) -> tuple[Addition, ...]:
    """The wrappers of scalar environments but the first one: without videos and windows."""
    return tuple(each for each in wrappers if not _is(each, (*_FILMING, *_SHOWING)))


def rendering(wrappers: Sequence[Addition]) -> dict[str, str]:
    """The arguments of gymnasium.make that wrappers need which look at pictures."""
    looking = (*_FILMING, *_SHOWING, gymnasium.wrappers.AddRenderObservation)
    return {"render_mode": "rgb_array"} if any(_is(each, looking) for each in wrappers) else {}


def wrapped(env: Env, wrappers: Sequence[Addition]) -> Env:
    """The environment in its wrappers, the last one outermost; raises ConfigError for one that does not fit it."""
    for each in wrappers:
        ((name, arguments),) = each.items()
        kind = _wrapper(name)
        try:
            if issubclass(kind, _FILMING):
                with naming_extras("video"):
                    import moviepy  # type: ignore[import-not-found, unused-ignore]  # noqa: F401
            env = made(f"wrappers: {name}", kind, arguments, env)
        except (ConfigError, MissingPackage):
            env.close()
            raise
    return env


def _is(addition: Addition, kinds: tuple[type, ...]) -> bool:
    return any(issubclass(_wrapper(name), kinds) for name in addition)
