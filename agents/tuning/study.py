"""The configuration of a study: a training configuration, ranges of its keys, how a trial is scored; read from YAML."""

from __future__ import annotations

import copy
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from agents.runs.checked_json import parse_json
from agents.runs.checks import (
    boolean,
    check_fields,
    choice,
    episode_count,
    integer,
    integers,
    number,
    prefixed,
    seed_number,
)
from agents.runs.config import TrainConfig, load_config, overlap
from agents.runs.environment import AT_THE_END, LAST_10
from rollingjoint.checked_yaml import entries, mapping, read_yaml
from rollingjoint.errors import ConfigError

if TYPE_CHECKING:
    from optuna.trial import Trial

SCORES = (LAST_10, AT_THE_END, "median_mm", "p95_mm")
PRUNERS = ("median", "halving", "none")
trial_count = integer(0, 100_000)
RESERVED = {"rj evaluate": range(10_000, 100_000), "evaluations of other runs": range(1_000_000, 2_000_000)}


@dataclass(frozen=True)
class Range:
    """Numbers from `low` to `high`, whole ones if both are; `log`: every factor is as likely."""

    low: float
    high: float
    log: bool = False

    @property
    def whole(self) -> bool:
        """Whether only whole numbers are meant."""
        return isinstance(self.low, int) and isinstance(self.high, int)

    @property
    def examples(self) -> tuple[Any, ...]:
        """Its ends."""
        return self.low, self.high

    def draw(self, trial: Trial, key: str) -> float:
        """The value that the trial tries."""
        suggest = trial.suggest_int if self.whole else trial.suggest_float
        return suggest(key, self.low, self.high, log=self.log)  # type: ignore[arg-type]

    def value(self, raw: Any) -> Any:
        """The value that the study's journal holds as `raw`."""
        return raw

    def to_dict(self) -> dict[str, Any]:
        """Plain values for YAML."""
        return {"low": self.low, "high": self.high, "log": self.log}

    def __str__(self) -> str:
        kind = "whole numbers" if self.whole else "numbers"
        return f"{kind} from {self.low:g} to {self.high:g}{', logarithmic' if self.log else ''}"


@dataclass(frozen=True)
class Choices:
    """One of these values, of any kind."""

    choices: tuple[Any, ...]

    @property
    def examples(self) -> tuple[Any, ...]:
        """All of them."""
        return self.choices

    def draw(self, trial: Trial, key: str) -> Any:
        """The value that the trial tries."""
        return self.value(trial.suggest_categorical(key, [json.dumps(choice) for choice in self.choices]))

    def value(self, raw: Any) -> Any:
        """The value that the study's journal holds as `raw`: JSON, since it takes no lists."""
        return parse_json(raw, "value in the journal")

    def to_dict(self) -> dict[str, Any]:
        """Plain values for YAML."""
        return {"choices": list(self.choices)}

    def __str__(self) -> str:
        return "one of " + ", ".join(json.dumps(choice) for choice in self.choices)


@dataclass(frozen=True)
class StudyConfig:
    """A study.

    Args:
        train: the training of every trial, except for the keys in `space`.
        space: the searched ranges, by dotted key of the training configuration (a number is an index of a list).
        score: score of a trial, smaller is better: the mean tip error of its last evaluation over the last 10 steps,
            or the mean, the median or the 95th percentile of the errors at the end of the episodes. Without it
            `last_10_mm` in tracking tasks, else `mean_mm`.
        training_seeds: a trial trains once with each; its score is the mean.
        episodes: number of evaluation episodes of a trial.
        first_seed: seed of the first of them; neither training nor `rj evaluate` may use their seeds.
        pruner: ends trials that fall behind: the median of the earlier ones, or successive halving.
        startup: number of first trials, which are drawn at random and never ended early.
        trials: number of trials.
        seed: seed of the search itself.
    """

    train: TrainConfig
    space: Mapping[str, Range | Choices]
    score: Annotated[str, choice(*SCORES)] = ""
    training_seeds: Annotated[Sequence[int], integers(0, 2**31)] = (1,)
    episodes: Annotated[int, episode_count] = 100
    first_seed: Annotated[int, seed_number] = 2_000_000
    pruner: Annotated[str, choice(*PRUNERS)] = "median"
    startup: Annotated[int, trial_count] = 8
    trials: Annotated[int, trial_count] = 20
    seed: Annotated[int, seed_number] = 0

    def __post_init__(self) -> None:
        object.__setattr__(self, "score", self.score or self.train.env.judged_by)
        entries("training_seeds", self.training_seeds)
        check_fields(self)
        self._check_seeds()
        for key, values in self.space.items():
            for example in values.examples:
                self._check_fits(key, example)

    def _check_seeds(self) -> None:
        """Raise ConfigError for evaluation seeds that something else uses."""
        count, ours = self.train.env.n_envs, range(self.first_seed, self.first_seed + self.episodes)
        used = RESERVED | {f"training with seed {seed}": range(seed, seed + count) for seed in self.training_seeds}
        for who, seeds in used.items():
            if overlap(ours, seeds):
                raise ConfigError("first_seed", self.first_seed, f"seeds that {who} does not use: {seeds}")

    def _check_fits(self, key: str, value: Any) -> None:
        try:
            self.trained({key: value}, self.training_seeds[0])
        except ConfigError as error:
            hint = error.hint or "Every value must fit the configuration by itself."
            raise ConfigError(f"space: {key}: {error.what}", error.value, error.allowed, hint) from error

    def trained(self, values: Mapping[str, Any], seed: int) -> TrainConfig:
        """The training of a trial with these values by key and this seed; raises ConfigError if they do not fit."""
        config = with_values(self.train, values)
        evaluation = replace(config.evaluation, episodes=self.episodes, seed=self.first_seed)
        return replace(config, seed=seed, evaluation=evaluation)

    def drawn(self, trial: Trial) -> dict[str, Any]:
        """The values that the trial tries, by key."""
        return {key: values.draw(trial, key) for key, values in self.space.items()}

    def values(self, raw: Mapping[str, Any]) -> dict[str, Any]:
        """The values by key that the study's journal holds as `raw`."""
        return {key: self.space[key].value(value) for key, value in raw.items()}

    def to_dict(self) -> dict[str, Any]:
        """Plain values for YAML; load_study reads them."""
        plain = {name: getattr(self, name) for name in SETTINGS}
        space = {key: values.to_dict() for key, values in self.space.items()}
        return plain | {"training_seeds": list(self.training_seeds), "space": space, "train": self.train.to_dict()}


SETTINGS = ("score", "training_seeds", "episodes", "first_seed", "pruner", "startup", "trials", "seed")


def load_study(path: Path) -> StudyConfig:
    """The study in a YAML file; raises ConfigError naming file and key.

    Its keys: `train`, a training configuration, or `config`, the file of one, relative to this file; changes
    to it in `set`; `space`; and the settings of StudyConfig.
    """
    with prefixed(f"{path}: "):
        values = dict(mapping("top level", read_yaml(path), ["config", "train", "set", "space", *SETTINGS], ["space"]))
        train = _training(values, path.parent)
        space = {str(key): _range(f"space: {key}", range_) for key, range_ in _keys("space", values).items()}
        return StudyConfig(train, space, **{name: values[name] for name in SETTINGS if name in values})


def _training(values: Mapping[str, Any], folder: Path) -> TrainConfig:
    if ("config" in values) == ("train" in values):
        raise ConfigError("config", values.get("config"), "a training configuration: either `config` or `train`")
    if "train" in values:
        train = TrainConfig.from_dict(values["train"])
    elif isinstance(values["config"], str):
        train = load_config(folder / values["config"])
    else:
        raise ConfigError("config", values["config"], "the path of a YAML file")
    return with_values(train, _keys("set", values))


def _keys(name: str, values: Mapping[str, Any]) -> dict[Any, Any]:
    section = values.get(name) or {}
    if not isinstance(section, Mapping):
        raise ConfigError(name, section, "keys of the training configuration and values")
    return dict(section)


def _range(where: str, value: Any) -> Range | Choices:
    """The range that plain values describe: {low, high, log} or {choices}."""
    if isinstance(value, Mapping) and "choices" in value:
        return Choices(tuple(entries(f"{where}.choices", mapping(where, value, ["choices"])["choices"])))
    value = mapping(where, value, ["low", "high", "log"], required=["low", "high"])
    low, high, log = value["low"], value["high"], value.get("log", False)
    boolean(f"{where}.log", log)
    number(number()(f"{where}.low", low))(f"{where}.high", high)
    if log and low <= 0:
        raise ConfigError(f"{where}.low", low, "a number above zero, since the range is logarithmic")
    return Range(low, high, log)


def with_values(config: TrainConfig, values: Mapping[str, Any]) -> TrainConfig:
    """The configuration with each dotted key set to its value; raises ConfigError for one that it does not take."""
    plain = copy.deepcopy(config.to_dict())
    for key, value in values.items():
        _set(plain, key, value)
    return TrainConfig.from_dict(plain)


def _set(plain: Any, key: str, value: Any) -> None:
    *sections, last = key.split(".")
    for section in sections:
        try:
            plain = plain[int(section)] if isinstance(plain, list) else plain.setdefault(section, {})
        except (ValueError, IndexError, AttributeError):
            raise ConfigError("key", key, "a dotted key of the training configuration", f"See {section!r}.") from None
    try:
        plain[int(last) if isinstance(plain, list) else last] = value
    except (ValueError, IndexError, TypeError):
        raise ConfigError("key", key, "a dotted key of the training configuration", f"See {last!r}.") from None
