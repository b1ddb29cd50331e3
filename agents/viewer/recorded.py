"""Recorded episodes in files: controller, environment, seed and actions, from which the simulation repeats them.

{"rolling-joint episodes": 1, "episodes": [{"name": "you", "environment": {"id": ..., "settings": {...}},
 "seed": 3, "actions": [[0.2, -0.2], ...], "error_mm": 0.41}, ...]}
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.results.environment import plain
from agents.runs.checked_json import LARGEST, parse_json
from agents.runs.checks import integer, number, optional, prefixed
from agents.runs.environment import EnvConfig
from agents.runs.files import write_bytes
from agents.viewer.drive import Film, Repeated, filmed
from rollingjoint.checked_yaml import entries, mapping, text
from rollingjoint.errors import ConfigError, InvalidInput
from rollingjoint.io.mechanism_file import mechanism_from_dict

MARK = "rolling-joint episodes"
VERSION = 1
KEYS = ("name", "environment", "seed", "actions", "error_mm")
WRITTEN = "a file of episodes that rj view wrote, or a dataset that rj dataset wrote"


@dataclass(frozen=True)
class Record:
    """One recorded episode.

    Args:
        name: of the controller. env: a tracking environment. seed: of its reset.
        actions: (T, m), within the bounds of the space.
        error_mm: mean tip error over the last 10 steps when it was recorded; None where that is not known.
    """

    name: str
    env: EnvConfig
    seed: int
    actions: NDArray[np.float32]
    error_mm: float | None = None

    @classmethod
    def of(cls, film: Film) -> Record:
        """The record of an episode, of a running one until now; raises InvalidInput before its first step."""
        if not film.actions:
            raise InvalidInput("episode", "no step", "an episode of at least one step")
        return cls(film.name, film.env, film.seed, np.array(film.actions), film.last_10_mm)

    def film(self) -> Film:
        """The episode, computed again; raises RollingJointError where the actions do not fit the environment."""
        return filmed(self.name, self.env, Repeated(self.actions), self.seed)

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        environment = {"id": self.env.id, "settings": plain(self.env)}
        values = self.name, environment, self.seed, self.actions.tolist(), self.error_mm
        return dict(zip(KEYS, values, strict=True))

    @classmethod
    def from_dict(cls, values: Any) -> Record:
        """The record in plain values; raises ConfigError that names the key."""
        content = mapping("episode", values, KEYS, KEYS)
        environment = mapping("environment", content["environment"], ("id", "settings"), ("id", "settings"))
        return cls(
            text("name", content["name"]),
            _environment(text("environment.id", environment["id"]), environment["settings"]),
            integer(0)("seed", content["seed"]),
            _actions(content["actions"]),
            optional(number(0.0))("error_mm", content["error_mm"]),
        )


def file_of(films: Sequence[Film]) -> bytes:
    """The file of these episodes; raises InvalidInput for one without a step."""
    episodes = [Record.of(film).to_dict() for film in films]
    return (json.dumps({MARK: VERSION, "episodes": episodes}) + "\n").encode()


def write_records(path: Path, films: Sequence[Film]) -> None:
    """Write these episodes, whole or not at all; raises InvalidInput for one without a step."""
    write_bytes(path, file_of(films))


def read_records(path: Path) -> list[Record]:
    """The episodes in a file, or in the folder of a Minari dataset.

    Raises:
        InvalidInput: a file or folder of another kind, a damaged one, or a dataset without the extra `data`.
    """
    if path.is_dir():
        return list(_in_dataset(path))
    if not path.is_file() or path.stat().st_size > LARGEST:
        raise InvalidInput("episodes", str(path), WRITTEN)
    return records_in(path.read_bytes(), str(path))


def records_in(content: bytes, source: str) -> list[Record]:
    """The episodes in a file's bytes, which messages call `source`; raises InvalidInput for other bytes."""
    try:
        values = parse_json(content, source)
    except ConfigError as error:
        raise InvalidInput("episodes", source, WRITTEN, str(error)) from error
    if not isinstance(values, Mapping) or values.get(MARK) != VERSION:
        raise InvalidInput("episodes", source, WRITTEN)
    with prefixed(f"{source}: "):
        return [Record.from_dict(episode) for episode in entries("episodes", values.get("episodes"))]


def _in_dataset(path: Path) -> Iterator[Record]:
    """The episodes of a dataset that rj dataset wrote."""
    from agents.evaluation.minari_dataset import read_dataset, recorded_by

    steps, (name, environment) = read_dataset(path), recorded_by(path)
    env = _environment(environment["id"], environment["settings"])
    ends = np.cumsum(steps.lengths)
    for seed, first, end in zip(steps.seeds.tolist(), ends - steps.lengths, ends, strict=True):
        yield Record(name, env, seed, steps.actions[first:end])


def _environment(env_id: str, settings: Mapping[str, Any]) -> EnvConfig:
    """The environment of complete plain settings."""
    values = mapping("environment.settings", settings, tuple(settings) if isinstance(settings, Mapping) else ())
    env = EnvConfig(env_id, settings={**values, "mechanism": mechanism_from_dict(values.get("mechanism"))})
    if not env.is_built_in_tracking:
        raise InvalidInput("environment.id", env_id, "a tracking environment of rj_gym")
    return env


def _actions(values: Any) -> NDArray[np.float32]:
    allowed = "rows of numbers in [-1, 1], one row per step and one number per tendon"
    try:
        actions = np.array(values, np.float32)
    except (TypeError, ValueError):
        raise InvalidInput("actions", values, allowed) from None
    if actions.ndim != 2 or not len(actions) or not (np.abs(actions) <= 1.0).all():
        raise InvalidInput("actions", values, allowed)
    return actions
