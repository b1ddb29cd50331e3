"""The standing attack: python -m tests.attack --minutes 3, or --goals --out runs/attack.json for the long one.

Each part runs in a worker process of its own, slice after slice, so that a crash is seen and costs one slice. A failure
prints the command that does it again. docs/reliability.md says what is attacked and what came of it.
"""

import argparse
import faulthandler
import importlib
import json
import secrets
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import rj_gym.warmup
from rollingjoint.warmup import GROUPS
from tests.attack import ledger


class Part(NamedTuple):
    """A module of this package with a function `attack`."""

    share: float  # of the time; 0: only where it is asked for, or with goals
    counted: str  # what counts towards the goal
    goal: int
    patience: float = 1800.0  # s that a worker may take beyond its slice, on a crowded machine too


PARTS = {
    "solves": Part(0.1, "solves recomputed", 1_000_000),
    "walls": Part(0.05, "solves in contact", 100_000),
    "walls_in_space": Part(0.05, "solves in contact in space", 5_000),
    "environments": Part(0.2, "environment steps", 1_000_000),
    "inputs": Part(0.2, "inputs", 10_000),
    "kills": Part(0.2, "kills", 100),
    "signals": Part(0.1, "signals", 208),
    "edges": Part(0.1, "rounds: edges", 10),
    "checked": Part(0.0, "rounds: checked", 1, 7200.0),  # compiles all kernels a second time
}
SLICE = 60.0  # s; with goals four times that: what a worker needs first is made less often


def main(argv=None):
    """Exit code: 0 nothing failed, 1 something did."""
    parser = argparse.ArgumentParser(prog="python -m tests.attack", description="The standing attack.")
    parser.add_argument("--minutes", type=float, default=3.0, help="how long (default 3)")
    parser.add_argument("--parts", nargs="+", choices=PARTS, help="default: all")
    parser.add_argument("--seed", type=int, help="default: a random one, printed")
    parser.add_argument("--round", type=int, help="do one round of one part again, in this process")
    parser.add_argument("--goals", action="store_true", help="go on until every part has reached its goal")
    parser.add_argument("--out", type=Path, help="JSON file to which counts are added; the same command goes on")
    parser.add_argument("--worker", nargs=3, metavar=("FIRST", "SECONDS", "FOLDER"), help=argparse.SUPPRESS)
    arguments = parser.parse_args(argv)
    arguments.parts = arguments.parts or [name for name, part in PARTS.items() if part.share or arguments.goals]
    seed = secrets.randbits(32) if arguments.seed is None else arguments.seed
    if arguments.worker or arguments.round is not None:
        return _work(arguments.parts[0], seed, arguments)
    print(f"seed {seed}", flush=True)
    sums = ledger.load(arguments.out)
    sums["seeds"] = sorted({*sums["seeds"], seed})
    end = time.monotonic() + 60.0 * arguments.minutes
    try:
        for part in arguments.parts:
            _attack(part, seed, arguments, sums, end)
    except KeyboardInterrupt:
        print("interrupted; the same command goes on" if arguments.out else "interrupted")
    print(ledger.summary(sums))
    return 1 if sums["failures"] else 0


def _attack(part, seed, arguments, sums, end):
    """Slices of one part until its share of the time is over or, with goals, its goal is reached."""
    share, counted, goal, _ = PARTS[part]
    total = sum(PARTS[each].share for each in arguments.parts) or 1.0
    last = min(end, time.monotonic() + 60.0 * arguments.minutes * (share or 1.0) / total)
    while time.monotonic() < (end if arguments.goals else last):
        if arguments.goals and sums["counts"].get(counted, 0) >= goal:
            break
        limit = 4.0 * SLICE if arguments.goals else min(SLICE, last - time.monotonic())
        key = f"{part} {seed}"
        first = sums["rounds"].get(key, 0)
        done = _slice(part, seed, first, limit)
        sums["rounds"][key] = first + max(1, done["counts"].get(f"rounds: {part}", 0))
        ledger.add(arguments.out, sums, done)
        reached = sums["counts"].get(counted, 0)
        print(f"{part}: {reached:,} {counted}, {len(sums['failures'])} failures", flush=True)


def _slice(part, seed, first, seconds):
    """What one worker has counted; its crash or hang is a failure."""
    with tempfile.TemporaryDirectory(prefix="attack-") as folder:
        command = [sys.executable, "-m", "tests.attack", "--parts", part, "--seed", str(seed)]
        command += ["--worker", str(first), str(seconds), folder]
        begin = time.monotonic()
        child = subprocess.Popen(command)
        try:
            code = child.wait(seconds + PARTS[part].patience)
        except subprocess.TimeoutExpired:
            child.send_signal(signal.SIGABRT)
            code = child.wait()
        finally:
            if child.poll() is None:
                child.kill()
        path = Path(folder) / "worker.json"
        done = json.loads(path.read_text("utf-8")) if path.exists() else {"counts": {}, "failures": []}
        if code != 0:
            what = f"crash or hang: exit code {code} after {time.monotonic() - begin:.0f} s, round {first} or later"
            done["failures"].append({"part": part, "what": what, "again": " ".join(command[2:-4])})
        return done


def _work(part, seed, arguments):
    """Rounds of one part in this process."""
    faulthandler.enable()
    for group in (*GROUPS, *rj_gym.warmup.GROUPS):  # compiled where they are not kept yet, before anything is timed
        group.use()
    report = ledger.Report(part, seed)
    attack = importlib.import_module(f"tests.attack.{part}").attack
    if arguments.round is not None:
        report.run(attack, arguments.round)
        return 1 if report.failures else 0
    first, seconds, folder = arguments.worker
    end, number = time.monotonic() + float(seconds), int(first)
    while number == int(first) or time.monotonic() < end:
        report.run(attack, number)
        ledger.written(report, folder)
        number += 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
