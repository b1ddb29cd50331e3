"""Many runs, trained some at a time."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from agents.runs.checks import integer
from agents.runs.command_line import finished, signals_seen
from agents.runs.config import load_config
from agents.runs.files import RunFolderError, read_rows
from agents.runs.folder import RunFolder
from rollingjoint.checked_yaml import entries, mapping, read_yaml, text
from rollingjoint.errors import ConfigError, RollingJointError

POLL = 0.1  # seconds between two looks at the children


@dataclass(frozen=True)
class Member:
    """One run of a campaign: a configuration and a seed."""

    config: Path
    seed: int

    def __str__(self) -> str:
        return f"{self.config.stem} seed {self.seed}"

    @property
    def overrides(self) -> tuple[str, ...]:
        """What the run changes in the configuration."""
        return f"seed={self.seed}", "torch_threads=1"

    def folder(self, out: Path) -> Path:
        """Its run folder in the folder of the campaign."""
        return out / self.config.stem / f"seed_{self.seed}"

    def arguments(self, out: Path) -> list[str] | None:
        """Arguments of agents.train that begin or resume the run; None if it is finished.

        Raises RollingJointError where the folder holds another configuration.
        """
        folder = self.folder(out)
        if not (folder / "config.yaml").is_file():
            changes = [word for override in self.overrides for word in ("--set", override)]
            return ["--config", str(self.config), "--run-dir", str(folder), *changes]
        run = RunFolder.open(folder)
        if run.config().content() != load_config(self.config, self.overrides).content():
            hint = "To train what the file says now, remove that folder or give another --out."
            raise RunFolderError("run folder", str(folder), f"what {self.config} says", hint)
        return None if run.is_finished else ["--resume", str(folder)]


def load_campaign(path: Path) -> list[Member]:
    """The runs that a campaign file lists; raises ConfigError that names the file and the place in it."""
    runs = mapping(str(path), read_yaml(path), ["runs"], ["runs"])["runs"]
    members: dict[tuple[str, int], Member] = {}
    for place, item in enumerate(entries(f"{path}: runs", runs)):
        where = f"{path}: runs[{place}]"
        item = mapping(where, item, ["config", "seeds"], ["config", "seeds"])
        config = Path(os.path.normpath(path.parent / text(f"{where}.config", item["config"])))
        for seed in entries(f"{where}.seeds", item["seeds"]):
            member = Member(config, integer(0, 2**31)(f"{where}.seeds", seed))
            load_config(config, member.overrides)
            if members.setdefault((config.stem, member.seed), member) is not member:
                hint = "A run folder is named after both."
                raise ConfigError(where, str(member), "every name of a configuration with every seed once", hint)
    return list(members.values())


@dataclass(frozen=True)
class Campaign:
    """Runs to train into a folder, `jobs` of them at a time."""

    members: Sequence[Member]
    out: Path
    jobs: int

    def train(self) -> int:
        """Train what is not finished; the exit code. A run that fails does not stop the others."""
        waiting, failed = self._plan()
        with signals_seen() as signals:
            failed |= self._work(waiting, signals)
        code = finished(len(self.members), failed, signals, (self.out / "command.txt").read_text().strip())
        if code == 0:
            print(f"All {len(self.members)} runs are finished.\nNext: python -m agents.results {self.out}")
        return code

    def _plan(self) -> tuple[dict[Member, list[str]], dict[Member, str]]:
        """Arguments of agents.train by run, and why other runs cannot be trained."""
        waiting, failed = dict[Member, list[str]](), dict[Member, str]()
        for member in self.members:
            try:
                arguments = member.arguments(self.out)
            except RollingJointError as error:
                failed[member] = str(error)
            else:
                if arguments is not None:
                    waiting[member] = arguments
        begun = sum(arguments[0] == "--resume" for arguments in waiting.values())
        finished = len(self.members) - len(waiting) - len(failed)
        print(
            f"{finished} runs are finished, {begun} begun, {len(waiting) - begun} new; {self.jobs} at a time",
            flush=True,
        )
        return waiting, failed

    def _work(self, waiting: Mapping[Member, list[str]], signals: Sequence[int]) -> dict[Member, str]:
        """Train them all; why some failed. A signal goes to the children, which save; no more are started."""
        left, failed, told = dict(waiting), dict[Member, str](), 0
        running: dict[Member, subprocess.Popen[bytes]] = {}
        while running or (left and not signals):
            while left and len(running) < self.jobs and not signals:
                member = next(iter(left))
                running[member] = self._start(member, left.pop(member))
            if len(signals) > told:
                told = len(signals)
                for child in running.values():
                    child.terminate()
            for member in [member for member, child in running.items() if child.poll() is not None]:
                code = running.pop(member).returncode
                if code == 0:
                    self._say(member, len(waiting) - len(left) - len(running), len(waiting))
                elif not signals:
                    failed[member] = self._reason(member, code)
                    print(f"{member} failed", flush=True)
            time.sleep(POLL)
        return failed

    def _start(self, member: Member, arguments: Sequence[str]) -> subprocess.Popen[bytes]:
        """The process that trains, in its own process group, so that Ctrl-C reaches it through this one alone."""
        folder = member.folder(self.out)
        folder.parent.mkdir(parents=True, exist_ok=True)
        with folder.with_suffix(".log").open("wb") as log:
            command = [sys.executable, "-m", "agents.train", *arguments]
            return subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT, start_new_session=True
            )

    def _say(self, member: Member, count: int, total: int) -> None:
        run = RunFolder(member.folder(self.out))
        error = float(read_rows(run.evaluations)[-1]["mean_mm"])
        seconds = run.training_seconds
        print(f"{count:>4} of {total}  {member}: {seconds:.0f} s, mean tip error {error:.3f} mm", flush=True)

    def _reason(self, member: Member, code: int) -> str:
        """Why a run failed: its own one-line error, else how it ended."""
        log = member.folder(self.out).with_suffix(".log")
        said = [line for line in log.read_text(errors="replace").splitlines() if line.strip()]
        errors = [line.removeprefix("error: ") for line in said if line.startswith("error: ")]
        if code < 0:
            return f"ended by {signal.Signals(-code).name}; the same command goes on with it"
        return errors[-1] if errors else f"exit code {code}: {said[-1] if said else 'nothing said'}; see {log}"
