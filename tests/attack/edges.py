"""Full disks, read-only folders, clocks that jump, and solvers and environments under malloc's and index checks."""

import os
import re
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from tests.attack import kills
from tests.attack.child import Child

MALLOC = {"MALLOC_CHECK_": "3", "MALLOC_PERTURB_": "165", "GLIBC_TUNABLES": "glibc.malloc.check=3"}
_SMALL = """
import numpy as np
from tests.attack import environments, ledger, solves
solves.ROWS = 1024
for part, number in ((solves, 3), (environments, 2)):
    report = ledger.Report(part.__name__.rpartition(".")[2], {seed})
    for each in range(number):
        report.run(part.attack, each)
    print(dict(report.counts))
    assert not report.failures, report.failures
"""


def attack(rng, report):
    """All of them once."""
    with tempfile.TemporaryDirectory(prefix="attack-") as folder:
        for what in (_file_limit, _full_disk, _read_only, _clock, _malloc):
            report.count(f"edges: {what.__name__.strip('_').replace('_', ' ')}")
            what(rng, report, Path(folder))


def _trained(report, what, folder, before=lambda: None, name="run"):
    """Exit code and output of a tiny training in a forked process, which does something before."""
    from agents import train

    run, log = folder / name, folder.parent / f"{folder.name}.log"
    log.unlink(missing_ok=True)

    def start():
        before()
        return train.main([*kills.TRAIN, "--run-dir", str(run)])

    child = Child(start, log)
    if not child.wait(120.0):
        child.kill()
        report.fail(f"{what}: training hangs")
    text = log.read_text("utf-8", "replace")
    log.unlink()
    if "Traceback" in text:
        report.fail(f"{what}: a traceback: {text[text.index('Traceback') :][-400:]}")
    return child.code, text


def _resumed(report, what, run):
    """A run that could not go on goes on, and ends as one that nothing stopped."""
    from agents import train

    begun = (run / "config.yaml").exists()
    words = ["--resume", str(run)] if begun else [*kills.TRAIN, "--run-dir", str(run), "--force"]
    child = Child(lambda: train.main(words), run.parent / "log")
    if not child.wait(120.0) or child.code != 0:
        text = (run.parent / "log").read_text()[-300:]
        report.fail(f"{what}: the run does not go on: exit code {child.code}: {text}")
    else:
        kills._equal_files(report, what, kills._weights(run), kills._weights(kills._whole_training()))
        report.count("runs that went on after a full disk")


def _refused(report, what, code, text):
    """It ended with code 2 and one line that says why."""
    errors = [line for line in text.splitlines() if line.startswith("error:")]
    if code != 2 or len(errors) != 1:
        report.fail(f"{what}: exit code {code}, {text[-300:]!r}")


def _file_limit(rng, report, folder):
    """RLIMIT_FSIZE: no file may grow beyond so many bytes."""
    import signal

    size = int(rng.choice([1, 200, 2000, 5000, 20_000, 60_000, 200_000]))

    def limited():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))

    place = folder / "limited"
    place.mkdir()
    code, text = _trained(report, f"files of at most {size} bytes", place, limited)
    if code not in (0, 99):  # 99: not even a line of output could be written
        if size > 2000:
            _refused(report, f"files of at most {size} bytes", code, text)
        _resumed(report, f"files of at most {size} bytes", place / "run")


def _full_disk(rng, report, folder):
    """A small file system in memory, where this process may mount one."""
    place = folder / "small"
    place.mkdir()
    size = int(rng.integers(40, 900))
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}k", "tmpfs", place], capture_output=True)
    if mounted.returncode:
        report.count("edges: no file system could be mounted")
        return
    try:
        code, text = _trained(report, f"a disk of {size} kB", place)
        if code != 0:
            _refused(report, f"a disk of {size} kB", code, text)
            subprocess.run(["mount", "-o", "remount,size=64m", place], check=True)
            _resumed(report, f"a disk of {size} kB", place / "run")
    finally:
        subprocess.run(["umount", "-l", place], check=True)


def _read_only(rng, report, folder):
    """A folder in which nothing can be written: not even root can make one under a file or in /proc."""
    for place in (Path("/proc/attack"), folder / "file" / "run"):
        (folder / "file").write_text("no folder")
        code, text = _trained(report, "a read-only folder", folder, name=str(place))
        _refused(report, "a read-only folder", code, text)
    if os.geteuid() != 0:
        closed = folder / "closed"
        closed.mkdir(mode=0o500)
        _refused(report, "a read-only folder", *_trained(report, "a read-only folder", closed))


def _clock(rng, report, folder):
    """Wall clocks that jump by years, back and forth, while a run trains: the same weights."""
    jumps = [float(jump) for jump in rng.normal(0.0, 1e8, 1000)]
    real = time.time

    def jumping():
        time.time = lambda: max(0.0, real() + jumps[int(real() * 50) % len(jumps)])

    place = folder / "clock"
    place.mkdir()
    code, text = _trained(report, "a clock that jumps", place, jumping)
    if code != 0:
        report.fail(f"a clock that jumps: exit code {code}: {text[-300:]}")
    else:
        kills._equal_files(
            report, "a clock that jumps", kills._weights(place / "run"), kills._weights(kills._whole_training())
        )


def _malloc(rng, report, folder):
    """Solvers and environments where glibc fills and checks memory."""
    checked(report, "malloc checks", MALLOC, int(rng.integers(1000)))


def checked(report, what, variables, seed):
    """A short attack on solvers and environments in a process with these environment variables."""
    done = subprocess.run(
        [sys.executable, "-c", _SMALL.replace("{seed}", str(seed))],
        env=os.environ | variables, capture_output=True, text=True, check=False,
    )  # fmt: skip
    if done.returncode != 0:
        report.fail(f"{what}: exit code {done.returncode}: {done.stderr[-400:]}")
    for kind, key in (("solves", "solves recomputed'"), ("environment steps", "environment steps'")):
        numbers = re.findall(f"'{key}: (\\d+)", done.stdout)
        report.count(f"{kind} under {what}", sum(map(int, numbers)))
