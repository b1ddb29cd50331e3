"""Many runs, trained some at a time."""

from __future__ import annotations

import os
import re
import sys
import traceback
from collections.abc import Mapping, MutableSequence, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from agents.executors.driver import work_through
from agents.executors.folders import FolderUnit, Home, marked
from agents.executors.options import LOCAL, executor_of
from agents.executors.progress import Progress
from agents.executors.protocol import Executor
from agents.executors.worker import output_to
from agents.runs.checks import integer
from agents.runs.command_line import finished, signals_seen, typed_command
from agents.runs.config import load_config
from agents.runs.consent import check_pickles
from agents.runs.environment import in_words
from agents.runs.files import RunFolderError, read_rows
from agents.runs.folder import RunFolder
from agents.training.old_checkpoint import old_state
from rollingjoint.checked_yaml import entries, mapping, read_yaml, text
from rollingjoint.errors import ConfigError, RollingJointError


@dataclass(frozen=True)
class Member:
    """One run of a campaign: a configuration and a seed.

    Args:
        changes: "section.key=value" each, on top of the configuration.
        name: of the configuration with these changes; empty: that of its file.
    """

    config: Path
    seed: int
    changes: tuple[str, ...] = ()
    name: str = ""

    def __str__(self) -> str:
        return f"{self.recipe} seed {self.seed}"

    @property
    def recipe(self) -> str:
        """The name of the folder of its configuration, and in tables."""
        return self.name or self.config.stem

    @property
    def overrides(self) -> tuple[str, ...]:
        """Changes of the configuration by the run."""
        return *self.changes, f"seed={self.seed}", "torch_threads=1"

    def folder(self, out: Path) -> Path:
        """Its run folder in the folder of the campaign."""
        return out / self.recipe / f"seed_{self.seed}"

    def begun(self, out: Path) -> bool | None:
        """Whether its run has begun; None if it is finished.

        Raises RollingJointError where the folder holds another configuration, or a checkpoint in pickles that are not
        allowed, and for a run that cannot be started from.
        """
        folder = self.folder(out)
        if not (folder / "config.yaml").is_file():
            self._check_start()
            return False
        run = RunFolder.open(folder)
        if run.config().content() != load_config(self.config, self.overrides).content():
            hint = "To train what the file says now, remove that folder or give another --out."
            raise RunFolderError("run folder", str(folder), f"what {self.config} says", hint)
        if run.is_finished:
            return None
        check_pickles(*(old_state(folder) for folder in sorted(run.checkpoint_folders)))
        return True

    def _check_start(self) -> None:
        """Raise RunFolderError for a run to start from that is here, and that a new run would refuse."""
        start = load_config(self.config, self.overrides).start_from
        if start is not None and RunFolder(Path(start)).policy_files("best").are_there:
            RunFolder(Path(start)).network_to_start_from()

    def create(self, out: Path) -> RunFolder:
        """Its run folder before training; raises RollingJointError where another file or folder is there."""
        folder = self.folder(out)
        changes = [word for override in self.overrides for word in ("--set", override)]
        command = typed_command("rj train", ["--config", str(self.config), "--run-dir", str(folder), *changes])
        return RunFolder.create(folder, load_config(self.config, self.overrides), command)


def load_campaign(path: Path) -> list[Member]:
    """The runs that a campaign file lists; raises ConfigError that names the file and the place in it."""
    runs = mapping(str(path), read_yaml(path), ["runs"], ["runs"])["runs"]
    members: dict[tuple[str, int], Member] = {}
    for place, item in enumerate(entries(f"{path}: runs", runs)):
        where = f"{path}: runs[{place}]"
        item = mapping(where, item, ["config", "seeds", "set", "name"], ["config", "seeds"])
        config = Path(os.path.normpath(path.parent / text(f"{where}.config", item["config"])))
        changes, name = _changes(where, item)
        for seed in entries(f"{where}.seeds", item["seeds"]):
            member = Member(config, integer(0, 2**31)(f"{where}.seeds", seed), changes, name)
            load_config(config, member.overrides)
            if members.setdefault((member.recipe, member.seed), member) is not member:
                hint = "A run folder is named after both."
                raise ConfigError(where, str(member), "every name of a configuration with every seed once", hint)
    return list(members.values())


def _changes(where: str, item: Mapping[str, Any]) -> tuple[tuple[str, ...], str]:
    """The changes of the configuration in an entry of a campaign file, and the name for it; none where it has none."""
    changes = (
        tuple(text(f"{where}.set", change) for change in entries(f"{where}.set", item["set"])) if "set" in item else ()
    )
    name = text(f"{where}.name", item["name"]) if "name" in item else ""
    if ("name" in item) != ("set" in item):
        raise ConfigError(
            where, list(item), "`set` and `name` together", "A changed configuration has a name of its own."
        )
    if name and not re.fullmatch(r"\w[\w.-]*", name):
        raise ConfigError(f"{where}.name", name, "letters, digits, _, - and . , as in the name of a folder")
    return changes, name


@dataclass(frozen=True)
class Campaign:
    """Runs to train into a folder.

    Args:
        jobs: processes, where `cluster` is "local"; else it is a Ray cluster, as for agents.executors.options.
    """

    members: Sequence[Member]
    out: Path
    jobs: int = 1
    cluster: str = LOCAL

    def train(self) -> int:
        """Train the unfinished runs; the exit code. A run that fails does not stop the others."""
        waiting, failed = self._plan()
        with executor_of(self.cluster, self.jobs) as executor, signals_seen() as signals:
            failed |= self._work(executor, waiting, signals)
        code = finished(len(self.members), failed, signals, (self.out / "command.txt").read_text("utf-8").split())
        if code == 0:
            print(f"All {len(self.members)} runs are finished.\nNext: rj results {self.out}")
        return code

    def _plan(self) -> tuple[list[Member], dict[Member, str]]:
        """The runs to train, and why others cannot be trained."""
        progress, failed = dict[Member, bool | None](), dict[Member, str]()
        for member in self.members:
            try:
                progress[member] = member.begun(self.out)
            except RollingJointError as error:
                failed[member] = str(error)
        states = list(progress.values())
        where = f"{self.jobs} at a time" if self.cluster == LOCAL else f"on the cluster {self.cluster}"
        print(
            f"{states.count(None)} runs are finished, {states.count(True)} begun, {states.count(False)} new; {where}",
            flush=True,
        )
        for member, reason in failed.items():
            print(f"cannot be trained: {member}: {reason}", file=sys.stderr, flush=True)
        return [member for member, state in progress.items() if state is not None], failed

    def _work(self, executor: Executor, waiting: Sequence[Member], signals: MutableSequence[int]) -> dict[Member, str]:
        """Train them all; why some failed. With a signal running ones save, and no more are started."""
        failed, done = dict[Member, str](), 0
        with marked(self.out) as home, Progress(len(waiting), "run") as progress:
            units = (TrainingUnit.of(member, self.out, home) for member in waiting)
            for ended in work_through(executor, units, progress, signals):
                done += 1
                if ended.failure:
                    failed[ended.unit.member] = ended.failure
                    progress.write(f"{ended.unit.name} failed")
                else:
                    progress.write(f"{done:>4} of {len(waiting)}  {self._summary(ended.unit.member)}")
        return failed

    def _summary(self, member: Member) -> str:
        run = RunFolder(member.folder(self.out))
        error = in_words(run.judged_by, float(read_rows(run.evaluations)[-1][run.judged_by]))
        return f"{member}: {run.training_seconds:.0f} s, {error}"


@dataclass(frozen=True)
class TrainingUnit(FolderUnit):
    """The training of one run, in its run folder.

    Args:
        out: the folder of the campaign as it was typed.
    """

    member: Member = Member(Path(), 0)
    out: Path = Path()

    @classmethod
    def of(cls, member: Member, out: Path, home: Home) -> TrainingUnit:
        """The unit of a run."""
        place = member.folder(Path()).as_posix()
        return cls(str(member), train_in, (), home, place, member=member, out=out)

    def call(self, attempt: int) -> tuple[Any, tuple[Any, ...]]:
        """Function and arguments; a new run folder is made before, which is all that training reads."""
        if not (self.member.folder(self.out) / "config.yaml").is_file():
            self.member.create(self.out)
        return super().call(attempt)


def train_in(folder: Path) -> None:
    """Train the run in its folder to the end, from its newest checkpoint on; output goes to FOLDER.log.

    Raises:
        RollingJointError: it cannot be trained.
        KeyboardInterrupt: it was stopped by a signal, and has saved.
    """
    from agents.training.learn import resume

    run = RunFolder.open(folder)
    is_begun = bool(run.checkpoint_folders)
    with output_to(folder.with_name(f"{folder.name}.log")):
        try:
            code = resume(folder, command=typed_command("rj train", ["--resume", str(folder)]) if is_begun else ())
        except RollingJointError:
            raise
        except Exception:  # the log says where
            traceback.print_exc()
            raise
    if code:
        raise KeyboardInterrupt
