"""The flexible-joint arm, many equilibria at once and one at a time, beside other ways to the same equilibrium."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rollingjoint import (
    HingeChain,
    HingeEquilibrium,
    flexible_arm,
    set_threads,
    solve_lengths,
    solve_lengths_batch,
    solve_tensions,
    solve_tensions_batch,
)
from rollingjoint.load import Gravity
from speed_rows.batch import threads_in_words
from speed_rows.machine import threads
from speed_rows.mujoco_arm import MujocoArm
from speed_rows.row import Row, Target, timed_row
from speed_rows.scipy_arm import angles_by_root
from speed_rows.sizes import Sizes
from speed_rows.timing import Contestant, race

TITLE = "The flexible-joint arm"
TEXT = """`flexible_arm()` hanging: 32 hinges in space, 8 tendons. Every solve has a command of its own, up to 0.5 N or
0.5 mm from that of the equilibrium that it starts at, and ends with a residual below 1e-8 N·mm. *Batch* is one call
for all of them, *public* one call for each.

The peers: `scipy.optimize.root` on the same residual (`scipy_arm.py`; plain NumPy, numerical Jacobian), and the same
arm in MuJoCo (`mujoco_arm.py`; it balances at our equilibria), which needs a simulation until it rests, with damping,
armature and time step tuned for the shortest way to rest. MuJoCo's is compiled code called from Python a few times
per solve."""

HANG = (0.0, 0.0, 1.0)
PULL = np.array([8.0, 0.0, 0.0, 0.0, 3.0, 3.0, 0.0, 0.0])  # N
REST_SPEED = 3e-3  # rad/s and rad/s²

Array = NDArray[np.float64]


class Cases(NamedTuple):
    """Commands near one equilibrium, (n, 8) each."""

    arm: HingeChain
    loads: list[Gravity]
    start: HingeEquilibrium
    tensions: Array
    lengths: Array

    @property
    def starts(self) -> Array:
        """The angles to start from, for every command, (n, 32) [rad]."""
        return np.tile(self.start.joint_angles, (len(self.tensions), 1))


def cases(count: int) -> Cases:
    """This many commands, the same in every run."""
    arm, rng = flexible_arm(), np.random.default_rng(0)
    loads = [arm.gravity(HANG)]
    start = solve_tensions(arm, PULL, loads)
    tensions = PULL + rng.uniform(0.0, 0.5, (count, 8))
    lengths = start.lengths - PULL / arm.stiffnesses + rng.uniform(-0.5, 0.5, (count, 8))
    return Cases(arm, loads, start, tensions, lengths)


def measure(sizes: Sizes, images: Path) -> Iterator[Row]:
    """Rows of the section."""
    every = cases(sizes.walk)
    for given in ("tensions", "lengths"):
        for count in dict.fromkeys([1, threads()]):
            set_threads(count)
            contestants = {"ours": Contestant(batch_of(every, given), sizes.walk)}
            what = f"{given}, batch of {sizes.walk:,}, {threads_in_words(count)}"
            yield timed_row(what, "µs", race(contestants, sizes.repeats), Target(100.0) if count == 1 else None)
    for given in ("tensions", "lengths"):
        few = min(sizes.slow_peer_solves, sizes.walk)
        contestants = {
            "ours": Contestant(one_by_one(every, given), sizes.walk),
            "scipy.optimize.root": Contestant(partial(by_root, every, given, few), few),
        }
        notes = {"scipy.optimize.root": f"equal to {_apart(every, given, few):.0e} rad"}
        if given == "tensions":
            contestants["MuJoCo until rest"], notes["MuJoCo until rest"] = _mujoco(every, few)
        yield timed_row(f"{given}, public", "µs", race(contestants, sizes.repeats), Target(100.0), "", notes)


def batch_of(every: Cases, given: str) -> Callable[[], HingeEquilibrium]:
    """A call that solves all cases at once."""
    solve = solve_tensions_batch if given == "tensions" else solve_lengths_batch
    starts = every.starts
    return lambda: solve(every.arm, getattr(every, given), every.loads, starts)


def one_by_one(every: Cases, given: str) -> Callable[[], list[HingeEquilibrium]]:
    """A call that solves them as a user would, one after the other."""
    solve = solve_tensions if given == "tensions" else solve_lengths
    return lambda: [solve(every.arm, command, every.loads, every.start) for command in getattr(every, given)]


def by_root(every: Cases, given: str, count: int) -> Array:
    """Hinge angles of the first cases, found by SciPy, (count, 32) [rad]."""
    commands = [{"tensions": None, "lengths": None, given: row} for row in getattr(every, given)[:count]]
    return np.array([angles_by_root(every.arm, HANG, every.start.joint_angles, **command) for command in commands])


def _apart(every: Cases, given: str, count: int) -> float:
    """Largest difference of SciPy's angles from ours [rad]."""
    return float(np.abs(by_root(every, given, count) - batch_of(every, given)().joint_angles[:count]).max())


def _mujoco(every: Cases, count: int) -> tuple[Contestant | str, str]:
    """The simulation of the first cases, one from the other, and how near it comes to ours."""
    try:
        simulated = MujocoArm(every.arm, HANG)
    except ImportError:
        return "not installed", ""
    simulated.place(every.start.joint_angles)

    def settle() -> Array:
        tips = []
        for tensions in every.tensions[:count]:
            simulated.pull(tensions)
            simulated.settle(REST_SPEED)
            tips.append(simulated.tip)
        return np.array(tips)

    off = np.linalg.norm(settle() - batch_of(every, "tensions")().tip[:count], axis=1).max()
    return Contestant(settle, count), f"its tip is then up to {off:.2f} mm off"
