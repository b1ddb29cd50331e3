"""Episodes of a policy or run folder over many seeds, or recorded ones; the best, the median and the worst."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from functools import cached_property, partial
from pathlib import Path

import numpy as np

from agents.controllers.controller import Array
from agents.policies.loading import list_policies
from agents.policies.trained import load_driving
from agents.results.environment import episodes_key
from agents.runs.environment import EnvConfig
from agents.runs.folder import RunFolder
from agents.viewer.controllers import POLICY, OfferedController, offered_controllers, worlds
from agents.viewer.drive import Film
from agents.viewer.recorded import Record, read_records
from rollingjoint.checks import as_choice, suggestion
from rollingjoint.errors import InvalidInput

SEEDS = range(10_000, 10_200)
"""The episodes that rj evaluate plays by default."""

RANKS = ("best", "median", "worst")


class EpisodeSet(ABC):
    """Episodes of one controller in one environment, one per seed.

    Attributes:
        name: of the controller. env: the environment. seeds: of the episodes.
    """

    name: str
    env: EnvConfig
    seeds: Sequence[int]

    @property
    @abstractmethod
    def errors(self) -> Array:
        """Mean tip error over the last 10 steps of every episode, (E,) [mm]."""

    @abstractmethod
    def film(self, seed: int) -> Film:
        """The episode with this seed; raises InvalidInput where it is none of these."""

    def ranked(self) -> dict[str, int]:
        """The seeds of the best, the median and the worst episode."""
        order = np.argsort(self.errors, kind="stable")
        return {rank: self.seeds[order[at]] for rank, at in zip(RANKS, (0, len(order) // 2, -1), strict=True)}

    def error(self, seed: int) -> float:
        """The mean tip error over the last 10 steps of one episode [mm]; raises as `film`."""
        self._check(seed)
        return float(self.errors[list(self.seeds).index(seed)])

    def seed_of(self, which: str) -> int:
        """The seed of the "best", "median" or "worst" episode, or the seed in digits.

        Raises:
            InvalidInput: anything else.
        """
        if which in RANKS:
            return self.ranked()[which]
        if not which.isdecimal():
            raise InvalidInput("episode", which, f"{', '.join(RANKS)} or a seed")
        self._check(int(which))
        return int(which)

    def films(self, seed: int, beside: Sequence[str] = ()) -> list[Film]:
        """One episode under this controller and under others; raises InvalidInput for a name that is not known."""
        others = self.beside()
        controllers = [others[as_choice("beside", name, list(others))] for name in beside]
        return [self.film(seed), *(controller.film(seed) for controller in controllers)]

    def beside(self) -> dict[str, OfferedController]:
        """Other controllers that can drive in the same episodes, by name."""
        offered = offered_controllers(self.env)
        return {name: controller for name, controller in offered.items() if name != self.name}

    def _check(self, seed: int) -> None:
        if seed not in self.seeds:
            raise InvalidInput("seed", seed, f"one of the {len(self.seeds)} of {self.name}")


class DrivenEpisodes(EpisodeSet):
    """Episodes that a controller drives on demand."""

    def __init__(self, controller: OfferedController, seeds: Sequence[int] = SEEDS) -> None:
        self.controller, self.name, self.env, self.seeds = controller, controller.name, controller.env, seeds

    @cached_property
    def errors(self) -> Array:
        """Mean tip error over the last 10 steps of every episode, (E,) [mm]."""
        return self.controller.errors(self.seeds)

    def film(self, seed: int) -> Film:
        """The episode with this seed; raises InvalidInput where it is none of these."""
        self._check(seed)
        return self.controller.film(seed)


class RecordedEpisodes(EpisodeSet):
    """Recorded episodes of one controller in one environment, computed again from their actions.

    Args:
        records: of different seeds, at least one.
    """

    def __init__(self, records: Sequence[Record]) -> None:
        self.records = {record.seed: record for record in records}
        self.name, self.env, self.seeds = records[0].name, records[0].env, list(self.records)

    @cached_property
    def errors(self) -> Array:
        """Mean tip error over the last 10 steps of every episode, (E,) [mm]."""
        return np.array([film.last_10_mm for film in self._films.values()])

    def film(self, seed: int) -> Film:
        """The episode with this seed; raises InvalidInput where it is none of these."""
        self._check(seed)
        return self._films[seed]

    @cached_property
    def _films(self) -> dict[int, Film]:
        return {seed: record.film() for seed, record in self.records.items()}


def run_episodes_of(path: Path, which: str = "best", seeds: Sequence[int] = SEEDS) -> DrivenEpisodes:
    """Episodes of the policy in a run folder, read as rj evaluate reads it.

    Args:
        which: "best", "last" or the steps of a checkpoint.
    Raises:
        RunFolderError, PolicyError: no run, or a policy that cannot be read.
        InvalidInput: a run of another task than tracking.
        ConfigError: seeds that training has used.
    """
    run = RunFolder.open(path)
    config = run.config()
    if not config.env.is_built_in_tracking:
        raise InvalidInput("run", str(path), "a run in a tracking environment", f"Its environment is {config.env.id}.")
    config.check_unused(range(min(seeds), max(seeds) + 1))
    load_driving(run, which)
    return DrivenEpisodes(OfferedController(path.resolve().name, config.env, partial(load_driving, run, which)), seeds)


def of_shipped_policies() -> list[EpisodeSet]:
    """Episodes of all shipped policies, each in its own environment."""
    controllers = [controller for env in worlds().values() for controller in offered_controllers(env).values()]
    return [DrivenEpisodes(controller) for controller in controllers if controller.name.startswith(POLICY)]


def episodes_of(name: str) -> list[EpisodeSet]:
    """Episodes of the shipped policy of this name, or those recorded in this file or folder.

    Raises:
        InvalidInput: neither.
    """
    if name in list_policies():
        return [episodes for episodes in of_shipped_policies() if episodes.name == f"{POLICY}{name}"]
    if not Path(name).exists():
        allowed = f"a file or folder of episodes, or one of {', '.join(list_policies())}"
        raise InvalidInput("episodes", name, allowed, suggestion(name, list_policies()))
    return list(recorded_episodes(Path(name)))


def recorded_episodes(path: Path) -> list[RecordedEpisodes]:
    """The episodes in a file that the viewer wrote, or in a folder that rj dataset wrote; one per controller.

    Raises:
        InvalidInput: anything else.
    """
    return grouped(read_records(path))


def grouped(records: Sequence[Record]) -> list[RecordedEpisodes]:
    """Recorded episodes as sets, one per controller and environment."""
    groups: dict[tuple[str, str], list[Record]] = {}
    for record in records:
        groups.setdefault((record.name, episodes_key(record.env)), []).append(record)
    return [RecordedEpisodes(group) for group in groups.values()]
