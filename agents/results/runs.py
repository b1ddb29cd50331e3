"""The finished runs below a folder, grouped: benchmarks, their recipes (configurations), the recipes' seeds."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from agents.controllers.controller import Array
from agents.policies.trained import load_driving
from agents.results.environment import common, episodes_key
from agents.runs.algorithms import PARAMETERS
from agents.runs.config import TrainConfig
from agents.runs.environment import EnvConfig
from agents.runs.files import RunFolderError, read_rows
from agents.runs.folder import PROCESSOR, RunFolder
from rj_gym import IDS
from rj_gym.tracking.config import TaskConfig
from rollingjoint.errors import RollingJointError

SEED = re.compile(r"seed_\d+")  # a run folder below its configuration's folder, as rj campaign names it
CHECKPOINT = "best"  # the one with the smallest error in the evaluations during training


@dataclass(frozen=True)
class FinishedRun:
    """A finished run: its configuration, its seed, its processor time [s], its evaluations during training.

    Args:
        seconds: including the runs that it began from.
        curve: steps done, mean tip error [mm] and processor time [s] at every evaluation, (3, evaluations).
    """

    folder: RunFolder
    config: TrainConfig
    seconds: float
    curve: Array

    @classmethod
    def read(cls, path: Path) -> FinishedRun:
        """The run in the folder at `path`; raises RollingJointError if it is broken or not finished."""
        folder = RunFolder.open(path)
        config = folder.config()
        if not config.env.is_built_in_tracking:
            raise RunFolderError("env.id", config.env.id, "an environment of rj_gym", "Others have no baselines.")
        if not folder.is_finished:
            hint = f"To go on: rj train --resume {path}"
            raise RunFolderError("run folder", str(path), f"a run of {config.total_timesteps} steps, all done", hint)
        try:
            load_driving(folder, CHECKPOINT)
            return cls(folder, config, sum(stage.training_seconds for stage in stages(folder)), _curve(folder))
        except RollingJointError:
            raise
        except Exception as error:  # any error of SB3, torch, pickle and csv about damaged files
            raise RunFolderError("run folder", str(path), "files that can be read", repr(error)) from error


@dataclass(frozen=True)
class Recipe:
    """A configuration that was trained with one seed or several."""

    name: str
    runs: Sequence[FinishedRun]

    @property
    def config(self) -> TrainConfig:
        """The configuration, with the first of the seeds."""
        return self.runs[0].config

    @property
    def seeds(self) -> list[int]:
        """The seeds of its runs."""
        return [run.config.seed for run in self.runs]

    @property
    def chosen(self) -> FinishedRun:
        """The run with the smallest error in the evaluations during training, which also chose its `best/`."""
        same = {run.folder.judged_by for run in self.runs}
        column = same.pop() if len(same) == 1 else "mean_mm"
        return min(self.runs, key=lambda run: min(float(row[column]) for row in read_rows(run.folder.evaluations)))

    @property
    def order(self) -> tuple[Any, ...]:
        """By algorithm, then by name."""
        return list(PARAMETERS).index(self.config.algorithm), self.config.her is not None, self.name


@dataclass(frozen=True)
class Benchmark:
    """Recipes for the same episodes, as agents.results.environment has it; `title` for headings and files."""

    title: str
    recipes: Sequence[Recipe]

    @property
    def env(self) -> EnvConfig:
        """The environment that baselines and floor see."""
        return common(self.recipes[0].config.env)

    @property
    def config(self) -> TaskConfig:
        """The settings of the environment."""
        config: TaskConfig = self.env.arguments()["config"]
        return config

    @cached_property
    def complexity(self) -> tuple[int, int]:
        """Which environment it is, planar chains first, and in how many settings it differs from the default one."""
        env_id = self.env.id
        default = EnvConfig(env_id).complete_settings()
        settings = self.recipes[0].config.env.complete_settings()
        return list(IDS).index(env_id), _differences(settings, default)


def file_name(title: str) -> str:
    """A title as part of a file name."""
    return re.sub(r"\W+", "_", title)


def find_benchmarks(root: Path) -> tuple[list[Benchmark], dict[Path, str]]:
    """The benchmarks of all finished runs below `root`, simple ones first; why other run folders are left out."""
    groups: dict[str, list[FinishedRun]] = {}
    left_out: dict[Path, str] = {}
    for path in _run_folders(root):
        try:
            run = FinishedRun.read(path)
            same = groups.setdefault(_without_seed(run.config), [])
            if run.config.seed in [run_before.config.seed for run_before in same]:
                raise RunFolderError("seed", run.config.seed, f"another one than that of {same[0].folder.path}")
            same.append(run)
        except RollingJointError as error:
            left_out[path] = str(error)
    grouped: dict[str, list[Recipe]] = {}
    names = _distinct([recipe_name(runs[0].folder.path) for runs in groups.values()])
    for name, runs in zip(names, groups.values(), strict=True):
        recipe = Recipe(name, sorted(runs, key=lambda run: run.config.seed))
        grouped.setdefault(episodes_key(recipe.config.env), []).append(recipe)
    sorted_recipes = [sorted(recipes, key=lambda recipe: recipe.order) for recipes in grouped.values()]
    titles = _distinct([_title(recipes) for recipes in sorted_recipes])
    benchmarks = [Benchmark(title, recipes) for title, recipes in zip(titles, sorted_recipes, strict=True)]
    return sorted(benchmarks, key=lambda benchmark: (benchmark.complexity, benchmark.title)), left_out


def stages(folder: RunFolder) -> list[RunFolder]:
    """The run and the earlier runs that it started from, the latest first, as far as their folders exist."""
    folders = [folder]
    while (start := folders[-1].config().start_from) and (Path(start) / "config.yaml").is_file():
        folders.append(RunFolder(Path(start)))
    return folders


def _run_folders(root: Path) -> Iterator[Path]:
    for path in sorted(root.rglob("config.yaml")):
        folder = path.parent
        if not any(part.startswith(".") for part in folder.relative_to(root).parts):  # an unfinished one
            yield folder


def _curve(folder: RunFolder) -> Array:
    rows = read_rows(folder.evaluations)
    steps, errors = (np.array([float(row[name]) for row in rows]) for name in ("steps", "mean_mm"))
    names = ("time/total_timesteps", PROCESSOR)
    log = [[float(row[name]) for name in names] for row in read_rows(folder.progress) if all(row.get(n) for n in names)]
    done, seconds = np.array([[0.0, 0.0], *log]).T  # short runs of learners that log seldom have no row
    return np.stack([steps, errors, np.interp(steps, done, seconds)])


def _without_seed(config: TrainConfig) -> str:
    """Equal for runs of one recipe, which may each begin from a run of their own seed."""
    start = config.start_from and str(_recipe_folder(Path(config.start_from)))
    return repr(config.content() | {"seed": 0, "start_from": start})


def recipe_name(folder: Path) -> str:
    """The name of a run folder's configuration: the parent's in CONFIGURATION/seed_K, else the folder's."""
    return _recipe_folder(folder.resolve()).name if SEED.fullmatch(folder.name) else folder.name


def _recipe_folder(folder: Path) -> Path:
    return folder.parent if SEED.fullmatch(folder.name) else folder


def _title(recipes: Sequence[Recipe]) -> str:
    """The name of the first configuration without its algorithm: ppo_fixed_target -> fixed target."""
    words = recipes[0].name
    words = words.removeprefix("plain_")
    for algorithm in sorted((*PARAMETERS, "her"), key=len, reverse=True):
        words = words.removeprefix(f"{algorithm}_")
    return words.replace("_", " ")


def _distinct(names: Sequence[str]) -> list[str]:
    """The names; where one comes again, with a number."""
    return [f"{name} {names[:i].count(name) + 1}" if name in names[:i] else name for i, name in enumerate(names)]


def _differences(values: Any, others: Any) -> int:
    if isinstance(values, Mapping) and isinstance(others, Mapping) and "tendons" not in values:
        return sum(_differences(values[key], others[key]) for key in values if key != "reward")
    return int(values != others)
