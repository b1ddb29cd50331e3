"""What a new process waits for."""

from __future__ import annotations

import statistics
import tempfile
from collections.abc import Iterator
from pathlib import Path

from speed_rows.processes import seconds_of_process
from speed_rows.row import Row, Target
from speed_rows.sizes import LEFT_OUT, Sizes

TITLE = "Start-up"
ONCE = True
TEXT = """New processes; the time that a bare interpreter takes is subtracted, medians of several. Python finds its
bytecode on disk, as from the second start on. A first solve is a process that imports rollingjoint and calls
`solve_lengths` once: with compiled kernels on disk what it takes beyond the import, with an empty cache folder all of
it."""

FIRST_SOLVE = "import rollingjoint as rj; m = rj.five_link(); rj.solve_lengths(m, m.neutral_lengths - 0.5)"
FIRST_STEP = (
    "import gymnasium, rj_gym; env = gymnasium.make('rj_gym/RollingJoint-v0'); env.reset(seed=0); "
    "env.step(env.action_space.sample())"
)
WARMUP = "from rollingjoint.cli import main; main({})"
PLANAR = "warmup", "planar", "--without-walls"

PHYSICS, ENVIRONMENTS = "import rollingjoint", "import rj_gym"
WARM = {  # the program, what it is compared with, the target
    PHYSICS: (PHYSICS, "", Target(0.4)),
    ENVIRONMENTS: (ENVIRONMENTS, "", Target(0.6)),
    "first solve after the import, kernels on disk": (FIRST_SOLVE, PHYSICS, Target(0.5)),
    "first environment step after the import, kernels on disk": (FIRST_STEP, ENVIRONMENTS, None),
}
COLD = {
    "first solve ever, kernels compiled": (FIRST_SOLVE, Target(15.0)),
    f"`rj {' '.join(PLANAR)}` ever": (WARMUP.format([*PLANAR]), Target(20.0)),
    "`rj warmup` ever": (WARMUP.format(["warmup"]), Target(20.0)),
}


def measure(sizes: Sizes, images: Path) -> Iterator[Row]:
    """Rows of the section."""
    programs = {"": "pass", **{what: code for what, (code, _, _) in WARM.items()}}
    for code in programs.values():
        seconds_of_process(code)  # files into memory, kernels onto disk
    times: dict[str, list[float]] = {what: [] for what in programs}
    for _ in range(sizes.process_starts):
        for what, code in programs.items():
            times[what].append(seconds_of_process(code))
    for what, (_, before, target) in WARM.items():
        note = f"best {min(times[what]) - min(times[before]):.2f} s"
        value = statistics.median(times[what]) - statistics.median(times[before])
        yield Row(what, value, "s", f"median of {sizes.process_starts}", target, note=note)
    for what, (code, target) in COLD.items():
        if not sizes.minutes:
            yield Row(what, None, "s", "", target, note=LEFT_OUT)
            continue
        with tempfile.TemporaryDirectory() as folder:
            value = seconds_of_process(code, {"ROLLINGJOINT_CACHE": folder}) - statistics.median(times[""])
        yield Row(what, value, "s", "once, empty cache folder", target)
