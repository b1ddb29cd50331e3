"""Episodes as a Minari dataset, written and read by Minari itself."""

from __future__ import annotations

import copy
import os
import re
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.envs.registration import EnvSpec
from numpy.typing import NDArray

from agents.controllers.controller import Controller
from agents.evaluation.recording import ERROR, Recording, record_episodes
from agents.runs.environment import EnvConfig, make_env, plain_settings
from agents.runs.files import RunFolderError
from agents.runs.seeds import DATA, TEST, VALIDATION
from rollingjoint import PRESETS, preset
from rollingjoint.checks import as_integer
from rollingjoint.errors import ConfigError, naming_extras
from rollingjoint.io.mechanism_file import mechanism_to_dict

with naming_extras():
    import h5py  # noqa: F401 (Minari's files; it would complain only when it writes one)
    import minari
    from minari.data_collector import EpisodeBuffer
    from minari.dataset.minari_storage import MinariStorage
    from minari.namespace import create_namespace, list_local_namespaces
    from minari.storage.datasets_root_dir import get_dataset_path

ENVIRONMENT = "rollingjoint_environment"  # its key in Minari's metadata
LANES = 512  # episodes side by side
ID = re.compile(r"([\w-]+/)*[\w-]+-v\d+")


@dataclass(frozen=True)
class Transitions:
    """All steps of a dataset, N of them, of E episodes one after the other; none leads from one into the next.

    Args:
        observations, next_observations: (N, entries), before and after each step; or dictionaries of such arrays.
        actions: (N, m). rewards, terminations, truncations: (N,).
        infos: by name, (N, ...), after each step.
        lengths: steps of every episode, (E,). seeds: of its reset, (E,), -1 where none is known.
    """

    observations: Any
    actions: NDArray[Any]
    rewards: NDArray[Any]
    next_observations: Any
    terminations: NDArray[np.bool_]
    truncations: NDArray[np.bool_]
    infos: Mapping[str, NDArray[Any]]
    lengths: NDArray[np.int64]
    seeds: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.rewards)

    @property
    def episode(self) -> NDArray[np.int64]:
        """The number of the episode that every step belongs to, (N,)."""
        return np.repeat(np.arange(len(self.lengths)), self.lengths)


def write_dataset(
    env: EnvConfig,
    controller: Controller,
    steps: int,
    where: str | Path,
    seed: int = DATA.start,
    infos: Sequence[str] = (ERROR,),
    about: Mapping[str, str] | None = None,
    progress: Any = None,
) -> Path:
    """The folder of a new Minari dataset with whole episodes of this controller, at least `steps` steps.

    The same arguments give the same episodes. An interrupted call leaves no folder.

    Args:
        env: a tracking environment of rj_gym. seed: of the first episode; the next ones have the numbers after it.
        where: id of the dataset, such as "joint/feedback-v0", for minari.load_dataset; or a folder.
        infos: of the environment's info, kept for every step, the reset included.
        about: more of Minari's metadata, such as `algorithm_name`, `author`, `description`.
        progress: called with the number of steps of every block of episodes.
    Raises:
        ConfigError: a number of steps below 1, seeds that tables are made of, an info or environment that is not there.
        RunFolderError: a dataset or folder that is there already.
    """
    total = as_integer("steps", steps, 1, 10**9, error=ConfigError)
    if not env.is_built_in_tracking:
        raise ConfigError("environment", env.id, "a tracking environment of rj_gym")
    length = env.episode_steps or 1
    _check_seeds(seed, -(-total // length))
    folder, name = _place(where)
    with _made(folder) as partial:
        storage = _new(partial / "data", env, name, dict(about or {}))
        first, written = 0, 0
        while written < total:
            seeds = range(seed + first, seed + first + min(LANES, -(-(total - written) // length)))
            _check_seeds(seeds.start, len(seeds))
            block = record_episodes(env, controller, seeds, infos)
            storage.update_episodes(_buffers(block, first))
            first, written = first + len(seeds), written + sum(episode.length for episode in block)
            if progress:
                progress(sum(episode.length for episode in block))
    _name_folders_of(name)
    return folder


def write_episodes(
    where: str | Path, spaces: tuple[Any, Any], episodes: Iterable[EpisodeBuffer], about: Mapping[str, str]
) -> Path:
    """The folder of a new Minari dataset with these episodes, which no simulation can repeat.

    Args:
        where: as of write_dataset. spaces: of observations and of actions. about: of Minari's metadata.
    Raises:
        RunFolderError: a dataset or folder that is there already.
    """
    folder, name = _place(where)
    with _made(folder) as partial:
        storage = MinariStorage.new(partial / "data", *spaces, None)
        storage.update_metadata({"dataset_id": name, "minari_version": minari.__version__, **about})
        storage.update_episodes(episodes)
    _name_folders_of(name)
    return folder


def read_dataset(where: str | Path) -> Transitions:
    """All steps of a Minari dataset: one of an id, or the one in a folder; raises RunFolderError if there is none."""
    data = _place(where)[0] / "data"
    try:
        dataset = minari.MinariDataset(data)
        episodes = list(dataset.storage.get_episodes(range(dataset.total_episodes)))
        metadata = list(dataset.storage.get_episode_metadata(range(dataset.total_episodes)))
    except (OSError, ValueError, KeyError, AssertionError, RecursionError) as error:
        raise RunFolderError("dataset", str(where), "a Minari dataset", f"{type(error).__name__}: {error}") from error
    column = {key: [run[key] for run in episodes] for key in ("actions", "rewards", "terminations", "truncations")}
    infos = [run["infos"] or {} for run in episodes]
    return Transitions(
        observations=_joined([run["observations"] for run in episodes], slice(None, -1)),
        next_observations=_joined([run["observations"] for run in episodes], slice(1, None)),
        **{key: np.concatenate(values) for key, values in column.items()},
        infos=_joined(infos, slice(1, None)),
        lengths=np.array([len(run) for run in column["rewards"]]),
        seeds=np.array([run.get("seed", -1) for run in metadata]),
    )


def recorded_by(where: str | Path) -> tuple[str, Mapping[str, Any]]:
    """The controller of a dataset that write_dataset wrote, and its environment: `id` and complete `settings`.

    Raises:
        RunFolderError: another dataset, or none.
    """
    allowed = "a dataset that rj dataset wrote"
    try:
        metadata = minari.MinariDataset(_place(where)[0] / "data").storage.metadata
        return str(metadata.get("algorithm_name", "recorded")), metadata[ENVIRONMENT]
    except (OSError, ValueError, KeyError, AssertionError, RecursionError) as error:
        raise RunFolderError("dataset", str(where), allowed, f"{type(error).__name__}: {error}") from error


def _check_seeds(first: int, episodes: int) -> None:
    """Raise ConfigError for negative seeds, and for seeds of the episodes that controllers are compared in."""
    seeds = range(as_integer("seed", first, 0, 2**31 - episodes, error=ConfigError), first + episodes)
    for reserved in (VALIDATION, TEST):
        if seeds.start < reserved.stop and reserved.start < seeds.stop:
            allowed = f"none of {reserved.start} to {reserved.stop - 1}: controllers are compared in these episodes"
            raise ConfigError("seeds", f"{seeds.start} to {seeds.stop - 1}", allowed)


def _place(where: str | Path) -> tuple[Path, str]:
    """Folder and id of a dataset; a text is an id where it looks like one and no such folder is there."""
    text = str(where)
    if isinstance(where, str) and ID.fullmatch(text) and not Path(text).is_dir():
        return get_dataset_path(text), text
    name = re.sub(r"[^\w-]", "_", Path(text).resolve().name) or "dataset"
    return Path(text).absolute(), name if ID.fullmatch(name) else f"{name}-v0"


@contextmanager
def _made(folder: Path) -> Iterator[Path]:
    """A folder that becomes this one when all is written, and vanishes otherwise."""
    if folder.exists():
        raise RunFolderError("dataset", str(folder), "a new folder or id", "Give another one.")
    folder.parent.mkdir(parents=True, exist_ok=True)
    partial = folder.with_name(f".{folder.name}.{os.getpid()}")
    partial.mkdir()
    try:
        yield partial
        os.replace(partial, folder)
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def _new(data: Path, env: EnvConfig, name: str, about: dict[str, Any]) -> MinariStorage:
    """An empty dataset that knows its environment."""
    instance = make_env(env)
    storage = MinariStorage.new(data, instance.observation_space, instance.action_space, _spec(env))
    instance.close()
    complete = {"id": env.id, "settings": env.complete_settings()}
    storage.update_metadata({"dataset_id": name, "minari_version": minari.__version__, ENVIRONMENT: complete, **about})
    return storage


def _name_folders_of(name: str) -> None:
    """Register the folders of an id with "/" as a namespace of Minari."""
    namespace = name.rpartition("/")[0]
    if namespace and namespace not in list_local_namespaces():
        create_namespace(namespace)


def _spec(env: EnvConfig) -> EnvSpec | None:
    """The spec of the environment for gymnasium.make, as JSON can hold it; None for a mechanism without a name."""
    config = env.arguments()["config"]
    mechanism = config.mechanism if isinstance(config.mechanism, str) else config.mechanism.name
    if mechanism is not config.mechanism and not _is_preset(config.mechanism):
        return None
    spec = copy.deepcopy(gymnasium.spec(env.id))
    spec.kwargs = {"config": plain_settings(config) | {"mechanism": mechanism}}
    return spec


def _is_preset(mechanism: Any) -> bool:
    name = mechanism.name
    return name in PRESETS and mechanism_to_dict(preset(name)) == mechanism_to_dict(mechanism)


def _buffers(block: Iterable[Recording], first: int) -> Iterator[EpisodeBuffer]:
    """Episodes as Minari takes them, numbered from `first` on."""
    for number, recording in zip(count(first), block, strict=False):
        ends: dict[str, Any] = {"terminations": recording.terminations, "truncations": recording.truncations}
        observations, infos = recording.observations, dict(recording.infos)
        yield EpisodeBuffer(
            number, recording.seed, None, observations, recording.actions, recording.rewards, **ends, infos=infos
        )


def _joined(episodes: Sequence[Any], times: slice) -> Any:
    """One array of the arrays of all episodes at these times; of dictionaries by key."""
    if isinstance(episodes[0], Mapping):
        return {key: _joined([episode[key] for episode in episodes], times) for key in episodes[0]}
    return np.concatenate([episode[times] for episode in episodes])
