"""A run folder: everything needed to repeat a training run and to use its policy.

    config.yaml          the configuration, complete: environment settings and overrides written in
    command.txt          the command as typed; one more line for every --resume
    mechanism.yaml       the mechanism, where the environment names a mechanism file
    versions.json        Python, packages, platform
    seeds.json           seeds of training and of the evaluations during training
    policy.safetensors   the policy at the end (or where training was stopped), with its normaliser; commands read it
    policy.parameters.safetensors   in its place, of a policy that has no form in NumPy
    policy.zip           the same with its critic, for programs of yours that use Stable-Baselines3
    normaliser.pkl       its VecNormalize, for the same
    best/                these files of the policy with the smallest mean tip error in the evaluations
    checkpoints/         STEPS/ with these files at that time; the newest two hold all that --resume needs
    logs/                progress.csv and TensorBoard events
    evaluations.csv      tip error in the evaluations during training
    evaluation/          report, pictures and animation, written by rj evaluate
    error.txt            the traceback, if training failed
    lock                 held by the training that runs

Next to these files FILE.sha256 has the hash of FILE, for tables from the end of training on: a changed file is
refused where it is read. TensorBoard events have their own checksums; evaluation/, error.txt and lock have none.
Pickles (.pkl, .zip) are read with --trust alone, and only in folders of earlier versions, which have none of these
safetensors files.
"""

from __future__ import annotations

import csv
import importlib.metadata
import json
import os
import platform
import re
import shlex
import shutil
from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from agents.runs.checked_json import read_json
from agents.runs.config import TrainConfig, filled, load_config
from agents.runs.consent import consent
from agents.runs.environment import AT_THE_END
from agents.runs.files import RunFolderError, check_as_written, read_rows, write_hashed_bytes, write_hashed_text
from agents.runs.locks import alone_in
from rollingjoint.checked_yaml import dump_yaml
from rollingjoint.errors import ConfigError

UNFINISHED = re.compile(r"\.(.+\.)?\d+")  # names of files, and of checkpoints, until they are whole
PACKAGES = ("rollingjoint", "numpy", "scipy", "numba", "gymnasium", "stable-baselines3", "sb3-contrib", "torch")
_BEGUN_WITH = ("config.yaml", "command.txt", "mechanism.yaml", "versions.json", "seeds.json")
PROCESSOR = "time/processor_seconds"  # column of progress.csv: processor time, which does not depend on other work


class PolicyFiles(NamedTuple):
    """One policy of a run: one of two forms that commands read, and two pickles for Stable-Baselines3."""

    network: Path
    parameters: Path
    model: Path
    normaliser: Path

    @classmethod
    def within(cls, folder: Path) -> PolicyFiles:
        """The files of the policy in a folder."""
        names = "policy.safetensors", "policy.parameters.safetensors", "policy.zip", "normaliser.pkl"
        return cls(*(folder / name for name in names))

    @property
    def are_there(self) -> bool:
        """Whether there is a policy, in one form at least."""
        return any(path.is_file() for path in (self.network, self.parameters, self.model))


@dataclass(frozen=True)
class RunFolder:
    """Paths of a run folder, and its configuration."""

    path: Path

    @classmethod
    def create(cls, path: Path, config: TrainConfig, command: Sequence[str], force: bool = False) -> RunFolder:
        """A new run folder with all that is known before training; it appears whole or not at all.

        Raises RunFolderError if the folder is there and holds something; `force` replaces an earlier run.
        """
        cls.check_free(path, force)
        partial = path.with_name(f".{path.name}.{os.getpid()}")
        try:
            partial.mkdir(parents=True)
            write_hashed_text(partial / "config.yaml", dump_yaml(_with_own_mechanism(config.to_dict(), partial)))
            write_hashed_text(partial / "command.txt", shlex.join(command) + "\n")
            write_hashed_text(partial / "versions.json", json.dumps(_made_with(), indent=2) + "\n")
            write_hashed_text(partial / "seeds.json", json.dumps(_seeds(config), indent=2) + "\n")
            if force and path.exists():
                cls(path)._give_way_to(partial)
            else:
                if path.exists():
                    path.rmdir()  # it is empty; Windows does not move onto an existing folder
                os.replace(partial, path)
        finally:
            shutil.rmtree(partial, ignore_errors=True)
        return cls(path)

    def _give_way_to(self, partial: Path) -> None:
        """Replace this folder by `partial`; raises RunFolderError where a training run holds it."""
        old = partial.with_name(f"{partial.name}.old")
        with self.locked():
            pass  # and free it again: Windows moves no folder in which a file is open
        os.replace(self.path, old)
        os.replace(partial, self.path)
        shutil.rmtree(old)

    @classmethod
    def open(cls, path: Path) -> RunFolder:
        """The run folder at `path`; raises RunFolderError if there is no run."""
        if not (path / "config.yaml").is_file():
            raise RunFolderError("run folder", str(path), "a folder with a config.yaml, written by rj train")
        return cls(path)

    @staticmethod
    def check_free(path: Path, force: bool) -> None:
        """Raise RunFolderError unless a run can be written to `path`."""
        if not path.exists() or (path.is_dir() and not any(path.iterdir())):
            return
        if not (path / "config.yaml").is_file():
            raise RunFolderError("run folder", str(path), "a new folder", "What is there is no run; it stays as it is.")
        if not force:
            hint = "There is a run already: --resume continues it, --force replaces it, --run-dir names another folder."
            raise RunFolderError("run folder", str(path), "a new folder", hint)

    def locked(self) -> AbstractContextManager[None]:
        """Hold the run folder alone; raises RunFolderError where another training holds it."""
        return alone_in(self.path, "run folder", "one in which no training runs")

    def restart(self) -> None:
        """Remove the files of a training run that was interrupted before its first checkpoint."""
        for folder in (self.logs, self.checkpoints, self.path / "best"):
            shutil.rmtree(folder, ignore_errors=True)
        self.evaluations.unlink(missing_ok=True)

    def tidy(self) -> None:
        """Remove partly written files of a killed training run, and the traceback of an earlier failure."""
        unfinished = [path for path in self.path.rglob(".*") if UNFINISHED.fullmatch(path.name)]
        for path in sorted(unfinished, reverse=True):
            if path.is_dir():
                shutil.rmtree(path)
            else:
                path.unlink()
        (self.path / "error.txt").unlink(missing_ok=True)

    def extend(self, total_timesteps: int, command: Sequence[str]) -> None:
        """Record the new end of the run, and the command that set it, if there is one."""
        values = filled(self.path / "config.yaml")
        write_hashed_text(self.path / "config.yaml", dump_yaml(values | {"total_timesteps": total_timesteps}))
        if not command:
            return
        commands = self.path / "command.txt"
        write_hashed_text(commands, commands.read_text("utf-8") + shlex.join(command) + "\n")

    def config(self, overrides: Sequence[str] = ()) -> TrainConfig:
        """The configuration of the run, with overrides on top; raises RunFolderError for damaged files."""
        check_as_written(*(self.path / name for name in _BEGUN_WITH))
        return load_config(self.path / "config.yaml", overrides)

    @property
    def begun_with(self) -> str:
        """The version of this project that wrote the folder, in words."""
        try:
            version = read_json(self.path / "versions.json")["rollingjoint"]
        except (ConfigError, LookupError, TypeError):
            return "an unknown version of rollingjoint"
        return f"rollingjoint {version}"

    @property
    def is_finished(self) -> bool:
        """Whether all steps are done and saved: the last thing that training writes is a checkpoint."""
        done = [int(path.name) for path in self.checkpoint_folders]
        return max(done, default=0) >= self.config().total_timesteps

    @property
    def training_seconds(self) -> float:
        """Processor time of the training to the last row of its log [s]; 0 where there is none."""
        return max((float(row.get(PROCESSOR) or 0) for row in read_rows(self.progress)), default=0.0)

    @property
    def logs(self) -> Path:
        """Folder of the training log."""
        return self.path / "logs"

    @property
    def progress(self) -> Path:
        """The training log as a table."""
        return self.logs / "progress.csv"

    @property
    def checkpoints(self) -> Path:
        """Folder of the checkpoints."""
        return self.path / "checkpoints"

    @property
    def checkpoint_folders(self) -> list[Path]:
        """The folders of the checkpoints; other folders are ignored."""
        return [path for path in self.checkpoints.glob("[0-9]*") if re.fullmatch("[0-9]{1,18}", path.name)]

    @property
    def evaluations(self) -> Path:
        """Tip errors in the evaluations during training."""
        return self.path / "evaluations.csv"

    @property
    def judged_by(self) -> str:
        """The column of evaluations.csv that its best policy is chosen by: in older runs always AT_THE_END."""
        column = self.config().env.judged_by
        return column if not self.evaluations.is_file() or column in self.evaluated else AT_THE_END

    @property
    def evaluated(self) -> Sequence[str]:
        """The columns of evaluations.csv; none if there is no file."""
        if not self.evaluations.is_file():
            return ()
        with self.evaluations.open(encoding="utf-8", newline="") as stream:
            return next(csv.reader(stream), ())

    @property
    def tables(self) -> tuple[Path, Path]:
        """The files that grow during training and are sealed when it ends."""
        return self.evaluations, self.progress

    @property
    def evaluation(self) -> Path:
        """Folder of the report that rj evaluate writes."""
        return self.path / "evaluation"

    def policy_files(self, which: str) -> PolicyFiles:
        """The files of a policy: "last", "best", or the steps of a checkpoint."""
        folders = {"last": self.path, "best": self.path / "best"}
        return PolicyFiles.within(folders.get(which, self.checkpoints / which))

    def saved_policy(self, which: str) -> PolicyFiles:
        """The files of a policy, as they were written; raises RunFolderError where there is none, or a damaged one."""
        files = self.policy_files(which)
        check_as_written(*files)
        if not files.are_there:
            raise RunFolderError("policy", str(files.network), "a saved policy", "Has the training run got that far?")
        return files

    def network_to_start_from(self) -> PolicyFiles:
        """The files of the best policy, as saved_policy; raises RunFolderError where it is in pickles alone."""
        files = self.saved_policy("best")
        if not files.network.is_file():
            hint = "Its pickle is not read. Train that run anew from its config.yaml: it is of an earlier version."
            raise RunFolderError("start_from", str(self.path), f"a run with best/{files.network.name}", hint)
        return files


def _with_own_mechanism(values: dict[str, Any], folder: Path) -> dict[str, Any]:
    """The plain configuration; a mechanism file that it names is copied into `folder` and named there."""
    mechanism = values["env"]["settings"].get("mechanism")
    if isinstance(mechanism, str) and Path(mechanism).is_file():
        write_hashed_bytes(folder / "mechanism.yaml", Path(mechanism).read_bytes())
        values["env"]["settings"]["mechanism"] = "mechanism.yaml"
    return values


def _made_with() -> dict[str, Any]:
    """Plain values for versions.json: versions, and the modules that the command imported; they are never read."""
    return versions() | ({"imported": consent().names} if consent().modules else {})


def _seeds(config: TrainConfig) -> dict[str, Any]:
    """Plain values for seeds.json: first and last of each range."""
    return {"training": config.seed} | {use: [used[0], used[-1]] for use, used in config.seeds.items()}


def versions(*more: str) -> dict[str, str]:
    """Versions of Python, of our packages and of `more`, and the platform."""
    packages = {"python": platform.python_version()}
    for name in (*PACKAGES, *more):
        try:
            packages[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            packages[name] = "not installed as a package"
    return packages | {"platform": platform.platform(), "processor": platform.machine(), "cores": str(os.cpu_count())}
