"""The finished runs below a folder, grouped: benchmarks, their recipes (configurations), the recipes' seeds."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from agents.evaluation.controller import Array
from agents.evaluation.policy import Policy
from agents.runs.algorithms import PARAMETERS
from agents.runs.config import TrainConfig
from agents.runs.environment import EnvConfig
from agents.runs.files import RunFolderError, read_rows
from agents.runs.folder import PROCESSOR, RunFolder
from rj_gym import IDS
from rj_gym.core.config import TaskConfig
from rollingjoint.errors import RollingJointError

HEAVIER = 1.5  # times the largest load of training
POLICY = "best"  # the one with the smallest error in the evaluations during training


@dataclass(frozen=True)
class Run:
    """A finished run: its configuration, its seed, its processor time [s], its evaluations during training.

    Args:
        curve: steps done, mean tip error [mm] and processor time [s] at every evaluation, (3, evaluations).
    """

    folder: RunFolder
    config: TrainConfig
    seconds: float
    curve: Array

    @classmethod
    def read(cls, path: Path) -> Run:
        """The run in the folder at `path`; raises RollingJointError if it is broken or not finished."""
        folder = RunFolder.open(path)
        config = folder.config()
        if not config.env.is_tracking:
            raise RunFolderError("env.id", config.env.id, "an environment of rj_gym", "Others have no baselines.")
        if not folder.is_finished:
            hint = f"To go on: python -m agents.train --resume {path}"
            raise RunFolderError("run folder", str(path), f"a run of {config.total_timesteps} steps, all done", hint)
        try:
            Policy.load(folder, POLICY)
            return cls(folder, config, folder.training_seconds, _curve(folder))
        except RollingJointError:
            raise
        except Exception as error:  # whatever SB3, torch, pickle and csv make of damaged files
            raise RunFolderError("run folder", str(path), "files that can be read", repr(error)) from error


@dataclass(frozen=True)
class Recipe:
    """A configuration that was trained with one seed or several."""

    name: str
    runs: Sequence[Run]

    @property
    def config(self) -> TrainConfig:
        """The configuration, with the first of the seeds."""
        return self.runs[0].config

    @property
    def seeds(self) -> list[int]:
        """The seeds of its runs."""
        return [run.config.seed for run in self.runs]

    @property
    def chosen(self) -> Run:
        """The run with the smallest mean error in the evaluations during training."""
        return min(self.runs, key=lambda run: float(np.min(run.curve[1])))

    @property
    def order(self) -> tuple[Any, ...]:
        """By algorithm, then by name."""
        return list(PARAMETERS).index(self.config.algorithm), self.config.her is not None, self.name


@dataclass(frozen=True)
class Benchmark:
    """Recipes for the same episodes: equal environment settings except the reward; `title` for headings and files."""

    title: str
    recipes: Sequence[Recipe]

    @property
    def env(self) -> EnvConfig:
        """The environment that baselines and floor see."""
        env = self.recipes[0].config.env
        return EnvConfig(_without_goal(env.id), settings=dict(env.settings))

    @property
    def config(self) -> TaskConfig:
        """The settings of the environment."""
        config: TaskConfig = self.env.arguments()["config"]
        return config

    @property
    def file(self) -> str:
        """The title as part of a file name."""
        return re.sub(r"\W+", "_", self.title)

    @cached_property
    def complexity(self) -> tuple[int, int]:
        """Which environment it is, planar chains first, and in how many settings it differs from the default one."""
        env_id = self.env.id
        default = EnvConfig(env_id).complete_settings()
        settings = self.recipes[0].config.env.complete_settings()
        return list(IDS).index(env_id), _differences(settings, default)

    @property
    def has_heavier(self) -> bool:
        """Whether there are loads beyond those of training; not where loads are observed, in units of the largest."""
        return self.config.load.magnitude[1] > 0 and not self.config.observe_load


def heavier(env: EnvConfig) -> EnvConfig:
    """The environment with loads from the largest one on, to HEAVIER times that."""
    largest = env.arguments()["config"].load.magnitude[1]
    load = dict(env.settings.get("load") or {}) | {"magnitude": [largest, HEAVIER * largest]}
    return EnvConfig(env.id, env.n_envs, dict(env.settings) | {"load": load})


def find_benchmarks(root: Path) -> tuple[list[Benchmark], dict[Path, str]]:
    """The benchmarks of all finished runs below `root`, simple ones first; why other run folders are left out."""
    groups: dict[str, list[Run]] = {}
    left_out: dict[Path, str] = {}
    for path in _run_folders(root):
        try:
            run = Run.read(path)
            same = groups.setdefault(_without_seed(run.config), [])
            if run.config.seed in [other.config.seed for other in same]:
                raise RunFolderError("seed", run.config.seed, f"another one than that of {same[0].folder.path}")
            same.append(run)
        except RollingJointError as error:
            left_out[path] = str(error)
    grouped: dict[str, list[Recipe]] = {}
    names = _distinct([_name(runs[0].folder.path, root) for runs in groups.values()])
    for name, runs in zip(names, groups.values(), strict=True):
        recipe = Recipe(name, sorted(runs, key=lambda run: run.config.seed))
        grouped.setdefault(_episodes_key(recipe.config), []).append(recipe)
    sorted_recipes = [sorted(recipes, key=lambda recipe: recipe.order) for recipes in grouped.values()]
    titles = _distinct([_title(recipes) for recipes in sorted_recipes])
    found = [Benchmark(title, recipes) for title, recipes in zip(titles, sorted_recipes, strict=True)]
    return sorted(found, key=lambda one: (one.complexity, one.title)), left_out


def _run_folders(root: Path) -> Iterator[Path]:
    for path in sorted(root.rglob("config.yaml")):
        folder = path.parent
        if not any(part.startswith(".") for part in folder.relative_to(root).parts):  # an unfinished one
            yield folder


def _curve(folder: RunFolder) -> Array:
    found = read_rows(folder.evaluations)
    steps, errors = (np.array([float(row[name]) for row in found]) for name in ("steps", "mean_mm"))
    names = ("time/total_timesteps", PROCESSOR)
    log = [[float(row[name]) for name in names] for row in read_rows(folder.progress) if all(row.get(n) for n in names)]
    done, seconds = np.array(log).T
    return np.stack([steps, errors, np.interp(steps, done, seconds)])


def _without_seed(config: TrainConfig) -> str:
    return repr(config.content() | {"seed": 0})


def _episodes_key(config: TrainConfig) -> str:
    """Equal for configurations with the same episodes and the same observations of them."""
    return repr((_without_goal(config.env.id), config.env.complete_settings() | {"reward": None}))


def _without_goal(env_id: str) -> str:
    """The id of the same task whose observation is one vector."""
    return env_id.replace("Goal-", "-")


def _name(folder: Path, root: Path) -> str:
    """What to call the configuration of a run folder: CONFIGURATION/seed_K, or a folder of its own name."""
    return folder.resolve().parent.name if re.fullmatch(r"seed_\d+", folder.name) else folder.name


def _title(recipes: Sequence[Recipe]) -> str:
    """The name of the first configuration without that of its algorithm: ppo_fixed_target -> fixed target."""
    words = recipes[0].name.split("_")
    while len(words) > 1 and words[0] in (*PARAMETERS, "her"):
        words.pop(0)
    return " ".join(words)


def _distinct(names: Sequence[str]) -> list[str]:
    """The names; where one comes again, with a number."""
    return [f"{name} {names[:i].count(name) + 1}" if name in names[:i] else name for i, name in enumerate(names)]


def _differences(values: Any, others: Any) -> int:
    if isinstance(values, Mapping) and isinstance(others, Mapping) and "tendons" not in values:
        return sum(_differences(values[key], others[key]) for key in values if key != "reward")
    return int(values != others)
