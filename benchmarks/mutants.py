"""Break formulas one at a time and see whether their tests notice: the mutation score.

    python benchmarks/mutants.py                          # 50 mutants; about 40 minutes on one core
    python benchmarks/mutants.py --count 200 --seed 7     # others
    python benchmarks/mutants.py --of environments        # 50 of the environments' kernels
    python benchmarks/mutants.py --of spatial             # 50 of the kernels of rolling joints in space
    python benchmarks/mutants.py --list                   # what would be broken, and how; nothing is run
    python benchmarks/mutants.py --only 3 17              # these of the draw

A mutant is one change in the body of a function: of physics, of `rollingjoint/kernels`, of the table of joints or of
profiles; of rolling joints in space, of their kernels; of environments, of the compiled step of the tracking task or of
the laws of its motors. It is another operator, a lost sign, a reversed comparison, a doubled constant, an index or a
loop that is off by one; as many of each kind. It is made in a copy of the checkout, and its tests run until the first
failure: those that are likely to notice, then all of the subject. Compiled kernels that it does not reach are kept. It
is killed by a test that fails, by a process that dies, or by one that takes too long. One that survives lacks a test,
unless `benchmarks/mutants_equivalent.yaml` says why no test can tell it from the original. Exit code 0: no other
survives.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import yaml
from mutation_sites import KINDS, Site, sites_of

REPOSITORY = Path(__file__).resolve().parents[1]
SOURCES = {
    "physics": ("rollingjoint/kernels/**/*.py", "rollingjoint/chain/joint_table.py", "rollingjoint/profile.py"),
    "spatial": (
        "rollingjoint/kernels/contact*.py",
        "rollingjoint/kernels/joints.py",
        "rollingjoint/kernels/spatial_lanes.py",
    ),
    "environments": (
        "rj_gym/tracking/kernels.py",
        "rj_gym/tracking/measuring.py",
        "rj_gym/tracking/motors.py",
        "rollingjoint/transmission/kernels.py",
    ),
}
EQUIVALENT = Path(__file__).resolve().parent / "mutants_equivalent.yaml"
PATIENCE = 420.0  # s for one stage, four times what the slowest takes with kernels to compile

TESTS = "tests/rollingjoint"
CHAIN = f"{TESTS}/chain"
PLANAR = [f"{CHAIN}/test_equilibrium.py", f"{CHAIN}/test_joint_table.py"]
SPATIAL = [f"{CHAIN}/test_hinge_equilibrium.py", f"{CHAIN}/test_spatial_lanes.py", f"{CHAIN}/test_turns.py"]
CONTACTS = [
    f"{TESTS}/kernels/test_contacts.py",
    *(f"{CHAIN}/test_{name}.py" for name in ("spatial", "spatial_lanes", "spatial_friction")),
]
FRICTION = [f"{CHAIN}/test_friction.py", f"{CHAIN}/test_friction_jacobian.py"]
TRACKING = "tests/rj_gym/tracking"
EPISODES = [f"{TRACKING}/test_{name}.py" for name in ("hardware", "planar_env", "planar_task", "arm_task")]
FIRST = {  # the first pattern that is in a file's path: the tests that are likely to notice
    "rj_gym": EPISODES,
    "transmission": [f"{TESTS}/test_transmission.py", *EPISODES],
    "profile.py": [f"{TESTS}/test_profile.py"],
    "joint_table.py": [f"{CHAIN}/test_joint_table.py"],
    "contact|spatial_lanes": CONTACTS,
    "kernels/joints.py": [f"{TESTS}/kernels/test_joints.py", *PLANAR, *CONTACTS],
    "torsion": [f"{CHAIN}/test_torsion_spring.py"],
    "hinge|spatial": [*SPATIAL, f"{CHAIN}/test_hinge_friction.py"],
    "rubbed|friction|turns": [*FRICTION, f"{CHAIN}/test_turns.py"],
    "descent|settle": [f"{CHAIN}/test_descent.py", f"{CHAIN}/test_hard_cases.py"],
    "long_": [f"{TESTS}/kernels", f"{CHAIN}/test_long_chain.py"],
    "loads": [f"{CHAIN}/test_equilibrium.py", f"{CHAIN}/test_torsion_spring.py"],
    "lanes|batch": [f"{CHAIN}/test_batch.py", *PLANAR],
    "rolling": PLANAR,
    "": [f"{TESTS}/kernels", *PLANAR, *SPATIAL],
}
SECOND = {  # likewise: all tests of the subject that use the file
    "rj_gym|transmission": ["tests/rj_gym"],
    "contact|spatial_lanes": [f"{TESTS}/kernels", *SPATIAL, *CONTACTS],
    "": [f"{TESTS}/{name}" for name in ("kernels", "chain", "statics", "test_theory.py")],
}


@dataclass
class Verdict:
    """What became of a mutant.

    outcome: "killed", "survived" or "equivalent". by: the test that failed, or how the process ended; the argument, if
    equivalent. seconds: of all stages.
    """

    site: Site
    outcome: str
    by: str
    seconds: float


def main(argv: Sequence[str] | None = None) -> int:
    """Run the mutants; returns the exit code."""
    arguments = _arguments(argv)
    drawn = draw(arguments.of, arguments.count, arguments.seed)
    chosen = [number for number in range(len(drawn)) if arguments.only is None or number in arguments.only]
    if arguments.list:
        print(*(f"{number:3} {described(drawn[number])}" for number in chosen), sep="\n")
        return 0
    verdicts: list[Verdict] = []
    with tempfile.TemporaryDirectory(prefix="mutants-") as scratch:
        workplace = Workplace(Path(scratch))
        workplace.check({test for number in chosen for stage in stages_of(drawn[number].file) for test in stage})
        for number in chosen:
            verdicts.append(workplace.judge(drawn[number]))
            print(f"{number:3} {line_of(verdicts[-1])}", flush=True)
            if arguments.out:
                arguments.out.write_text(json.dumps([asdict(one) for one in verdicts], indent=1), "utf-8")
    print(summary(verdicts))
    return int(any(verdict.outcome == "survived" for verdict in verdicts))


def draw(subject: str, count: int, seed: int) -> list[Site]:
    """Sites of a subject of SOURCES at random, as many of each kind, in the order in which they are broken."""
    generator = random.Random(seed)
    files = sorted({path for pattern in SOURCES[subject] for path in REPOSITORY.glob(pattern)})
    every = [
        site for path in files for site in sites_of(path.relative_to(REPOSITORY).as_posix(), path.read_text("utf-8"))
    ]
    by_kind = [[site for site in every if site.kind == kind] for kind in KINDS]
    for sites in by_kind:
        generator.shuffle(sites)
    return [sites[turn] for turn in range(-(-count // len(KINDS))) for sites in by_kind if turn < len(sites)][:count]


def stages_of(file: str) -> list[list[str]]:
    """Tests to be run one list after the other on a mutant of the file."""
    return [next(tests for pattern, tests in stage.items() if re.search(pattern, file)) for stage in (FIRST, SECOND)]


class Workplace:
    """A copy of the checkout in which mutants are made and tested."""

    def __init__(self, scratch: Path) -> None:
        self.tree, self.cache, self.kept = scratch / "tree", scratch / "kernels", scratch / "kept"
        self.kept.mkdir(mode=0o700)
        command = ["git", "ls-files", "--cached", "--others", "--exclude-standard"]
        listed = subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True, check=True).stdout.splitlines()
        for name in filter(lambda name: (REPOSITORY / name).is_file(), listed):
            (self.tree / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(REPOSITORY / name, self.tree / name)

    def check(self, tests: set[str]) -> None:
        """Raise RuntimeError unless the tests pass on the original; its compiled kernels are kept for the mutants."""
        if failure := self._first_failure(sorted(tests), 4 * PATIENCE, self.kept):
            raise RuntimeError(f"without a mutant, too: {failure}")

    def judge(self, site: Site) -> Verdict:
        """Make a mutant, run its tests, and undo it."""
        begin, path = time.perf_counter(), self.tree / site.file
        if argument := argument_for(site):
            return Verdict(site, "equivalent", argument, 0.0)
        original = path.read_text("utf-8")
        path.write_text(site.mutated(original), "utf-8")
        try:
            failures = (self._first_failure(stage, PATIENCE) for stage in stages_of(site.file))
            failure = next(filter(None, failures), "")
        finally:
            path.write_text(original, "utf-8")
        return Verdict(site, "killed" if failure else "survived", failure, time.perf_counter() - begin)

    def _first_failure(self, tests: Sequence[str], patience: float, cache: Path | None = None) -> str:
        """The first test that fails, or how the process ended; "" if all pass.

        cache: the folder of compiled kernels; without one it is a copy of those that are kept, of which a mutant takes
        only what its change does not reach: a kernel's key holds the text of all that it is compiled from.
        """
        if cache is None:
            cache = self.cache
            shutil.rmtree(cache, ignore_errors=True)
            shutil.copytree(self.kept, cache)
        paths = os.pathsep.join([str(self.tree), *filter(None, [os.environ.get("PYTHONPATH")])])
        settings = {"PYTHONPATH": paths, "ROLLINGJOINT_CACHE": str(cache), "PYTHONDONTWRITEBYTECODE": "1"}
        command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", "--tb=no", *tests]
        with subprocess.Popen(
            command,
            cwd=self.tree,
            env=os.environ | settings,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        ) as process:
            try:
                printed, _ = process.communicate(timeout=patience)
            except subprocess.TimeoutExpired:
                return f"not done after {patience:.0f} s"
            finally:
                if process.poll() is None:  # it takes too long, or Ctrl-C ends the wait
                    os.killpg(process.pid, signal.SIGKILL)
        if process.returncode == 0:
            return ""
        failed = re.search(r"^(?:FAILED|ERROR) (.+?)(?: - |$)", printed, re.MULTILINE)
        return failed[1] if failed else f"pytest ended with {process.returncode}: {printed[-300:]}"


def argument_for(site: Site) -> str:
    """Why no test can tell the mutant from the original, or "" if nobody has said so."""
    return equivalents().get((Path(site.file).name, site.original, site.mutant), "")


def equivalents() -> dict[tuple[str, str, str], str]:
    """Why nothing can tell a mutant from the original, by the name of its file and its lines before and after."""
    listed = yaml.safe_load(EQUIVALENT.read_text("utf-8"))
    return {(one["file"], one["original"], one["mutant"]): one["because"] for one in listed}


def described(site: Site) -> str:
    """Where a mutant is, and its line before and after."""
    return f"{site.kind:10} {site.file}:{site.line}\n      - {site.original}\n      + {site.mutant}"


def line_of(verdict: Verdict) -> str:
    """A verdict in words."""
    return f"{verdict.outcome:10} {verdict.seconds:4.0f} s  {described(verdict.site)}\n      {verdict.by}"


def summary(verdicts: Sequence[Verdict]) -> str:
    """The score: killed mutants among those that are not equivalent."""
    counts = {name: sum(one.outcome == name for one in verdicts) for name in ("killed", "survived", "equivalent")}
    different = counts["killed"] + counts["survived"]
    score = f"{counts['killed'] / different:.0%}" if different else "none"
    return ", ".join(f"{count} {name}" for name, count in counts.items()) + f": score {score}"


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--of", choices=list(SOURCES), default="physics", help="what is broken (default physics)")
    parser.add_argument("--count", type=int, default=50, help="mutants to be drawn (default 50)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", type=int, nargs="+", metavar="NUMBER", help="these of the draw")
    parser.add_argument("--list", action="store_true", help="print the mutants and run nothing")
    parser.add_argument("--out", type=Path, metavar="FILE", help="write the verdicts here, JSON, as they come")
    return parser.parse_args(argv)


if __name__ == "__main__":
    sys.exit(main())
