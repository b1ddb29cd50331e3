"""What an attack has done so far: counts, failures and the seeds of both, in a JSON file that later parts add to."""

import json
import os
import time
import traceback
from collections import Counter
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from tests.attack import found

LONGEST = 5.0  # s of processor time that a single thing may take


class Report:
    """One worker's counts and failures."""

    def __init__(self, part, seed):
        self.part, self.seed, self.round = part, seed, 0
        self.counts, self.worst, self.failures = Counter(), {}, []

    def count(self, what, number=1):
        """Count something that was done."""
        self.counts[what] += int(number)

    def longest(self, what, seconds):
        """Note how long something took; the longest is kept."""
        self.worst[what] = max(round(seconds, 2), self.worst.get(what, 0.0))

    def fail(self, what, **details):
        """Note a failure, with what it takes to do it again."""
        again = f"python -m tests.attack --parts {self.part} --seed {self.seed} --round {self.round}"
        self.failures.append({"part": self.part, "what": what[:500], "again": again})
        print(f"FAILED: {self.part}: {what[:500]}\n        again: {again}", flush=True)
        if "case" in details:
            found.keep_solve(details["case"], details["rows"][0])

    @contextmanager
    def limited(self, what, longest=LONGEST):
        """Fail if the body takes longer [s of processor time]."""
        begin = time.process_time()
        yield
        took = time.process_time() - begin
        if took > longest:
            self.fail(f"{what} took {took:.1f} s")

    def run(self, attack, number):
        """One round; an exception that nobody expects is a failure."""
        self.round = number
        rng = np.random.default_rng([self.seed, sum(self.part.encode()), number])
        begin = time.perf_counter()
        try:
            attack(rng, self)
        except Exception as error:
            traceback.print_exc()
            self.fail(f"traceback: {type(error).__name__}: {error}")
        self.count(f"rounds: {self.part}")
        self.count(f"seconds: {self.part}", round(time.perf_counter() - begin))


def load(path):
    """The sums of a file; empty ones where there is none."""
    empty = {"counts": {}, "worst": {}, "failures": [], "rounds": {}, "seeds": []}
    return empty | (json.loads(path.read_text("utf-8")) if path and path.exists() else {})


def add(path, sums, other):
    """Add what a worker has written to the sums, and save them."""
    for name, number in other["counts"].items():
        sums["counts"][name] = sums["counts"].get(name, 0) + number
    for name, seconds in other.get("worst", {}).items():
        sums["worst"][name] = max(seconds, sums["worst"].get(name, 0.0))
    sums["failures"] += other["failures"]
    if path:
        part = path.with_name(f".{path.name}.{os.getpid()}")
        part.write_text(json.dumps(sums, indent=1, sort_keys=True) + "\n", "utf-8")
        part.replace(path)


def summary(sums):
    """A table of everything counted, and the failures."""
    width = max(map(len, [*sums["counts"], *sums["worst"]]), default=0)
    lines = [f"{name:{width}}  {number:>12,}" for name, number in sorted(sums["counts"].items())]
    lines += [f"{name:{width}}  {seconds:>12,.2f}" for name, seconds in sorted(sums["worst"].items())]
    lines += [
        f"{'seeds':{width}}  {', '.join(map(str, sums['seeds']))}",
        f"{'failures':{width}}  {len(sums['failures']):>12,}",
    ]
    return "\n".join([*lines, *(f"  {each['part']}: {each['what']}\n    {each['again']}" for each in sums["failures"])])


def written(report, folder):
    """The file that a worker leaves for its parent."""
    path = Path(folder) / "worker.json"
    path.write_text(json.dumps({"counts": report.counts, "worst": report.worst, "failures": report.failures}), "utf-8")
    return path
