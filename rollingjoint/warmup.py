"""All kernels compiled in advance, in processes side by side: what `rj warmup` and the tests begin with.

A group is a function whose calls need its kernels. Groups share no kernel that takes long, or one waits for the other.
Other packages add groups by entry points of the group `rollingjoint.kernels`, each of which names a tuple of Groups.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib.metadata import entry_points
from typing import IO

import numpy as np
from numpy.typing import NDArray

from rollingjoint._numba.cache import only_what_is_kept
from rollingjoint.friction import CapstanFriction, FrictionState
from rollingjoint.mechanism import AnyMechanism
from rollingjoint.presets import five_link, small_arm, uniform
from rollingjoint.statics.solve import solve_lengths, solve_lengths_batch, solve_tensions

ENTRY_POINTS = "rollingjoint.kernels"
_PAUSE = 0.05  # s between two looks at the processes
_PROGRAM = """
import importlib, os, signal, sys, threading
signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent, which ends this process
def end_with_parent():
    os.read(0, 1)  # nothing comes until the parent closes the pipe, or is gone
    os._exit(1)
threading.Thread(target=end_with_parent, daemon=True).start()
getattr(importlib.import_module(sys.argv[1]), sys.argv[2])()
"""


@dataclass(frozen=True)
class Group:
    """Kernels that one process compiles.

    Args:
        title: what they belong to, for people.
        use: a function at the top level of a module, which calls them all.
        after: title of a group whose kernels it needs, too; empty if there is none.
    """

    title: str
    use: Callable[[], object]
    after: str = ""

    @property
    def is_kept(self) -> bool:
        """Whether all its kernels are on disk, and work; loads them."""
        try:
            with only_what_is_kept():
                self.use()
        except Exception:  # NotCompiled, or an error, which the process that compiles them will tell
            return False
        return True


class Progress:
    """What a run tells of itself; this one says nothing."""

    def started(self, group: Group) -> None:
        """A process compiles the group."""

    def ended(self, group: Group, seconds: float, error: str) -> None:
        """It has ended after so many seconds [s], with an error in one line if it could not."""

    def waits(self) -> None:
        """Called several times a second."""


def all_groups() -> tuple[Group, ...]:
    """Those of this package and of the installed packages that add some."""
    added = [group for found in sorted(entry_points(group=ENTRY_POINTS)) for group in found.load()]
    return (*GROUPS, *added)


def missing(groups: Sequence[Group]) -> list[Group]:
    """The groups of which some kernel is not on disk."""
    return [group for group in groups if not group.is_kept]


def compile_kernels(groups: Sequence[Group], progress: Progress | None = None) -> bool:
    """Compile the kernels of some groups, each in a process, as many at once as there are processors.

    However it ends, none of the processes goes on.

    Returns:
        whether all could be compiled.
    """
    progress = progress or Progress()
    waiting, well = list(groups), True
    with _processes() as running:
        while waiting or running:
            busy = {group.title for group in [*waiting, *(one.group for one in running)]}
            ready = [group for group in waiting if group.after not in busy]
            for group in ready[: max(0, _processors() - len(running))]:
                waiting.remove(group)
                running.append(_Running(group))
                progress.started(group)
            for one in [one for one in running if one.process.poll() is not None]:
                running.remove(one)
                error = one.error()
                well = well and not error
                progress.ended(one.group, time.perf_counter() - one.begin, error)
            progress.waits()
            time.sleep(_PAUSE)
    return well


def _processors() -> int:
    """How many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@dataclass
class _Running:
    """A process that compiles a group."""

    group: Group
    said: IO[bytes] = field(default_factory=tempfile.TemporaryFile)
    begin: float = field(default_factory=time.perf_counter)  # s

    def __post_init__(self) -> None:
        use = self.group.use
        command = [sys.executable, "-P", "-c", _PROGRAM, use.__module__, use.__name__]
        self.process = subprocess.Popen(
            command, env=_same_imports(), stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=self.said
        )

    def end(self) -> None:
        """End the process, and wait for that."""
        self.process.kill()
        self.process.communicate()
        self.said.close()

    def error(self) -> str:
        """Why the process, which has ended, has failed, in one line; empty if it has not."""
        self.process.communicate()
        with self.said:
            self.said.seek(0)
            lines = self.said.read().decode(errors="replace").strip().splitlines()
        if not self.process.returncode:
            return ""
        return lines[-1].strip() if lines else f"ended with exit code {self.process.returncode}"


def _same_imports() -> dict[str, str]:
    """An environment in which a process imports from where this one does."""
    return os.environ | {"PYTHONPATH": os.pathsep.join(path or os.getcwd() for path in sys.path)}


@contextmanager
def _processes() -> Iterator[list[_Running]]:
    """A list of processes; those that are still in it at the end are ended."""
    running: list[_Running] = []
    try:
        yield running
    finally:
        for one in running:
            one.end()


_MU = CapstanFriction(0.1)


def planar_solver() -> None:
    """Solve a planar chain."""
    chain = five_link()
    taut = solve_lengths(chain, chain.neutral_lengths - 0.5)
    assert taut.arc_lengths.size and taut.friction_state.states.size


def planar_batches() -> None:
    """Solve planar chains side by side."""
    chain = five_link()
    assert solve_lengths_batch(chain, [chain.neutral_lengths - 0.5] * 2).joint_angles.size


def planar_special_cases() -> None:
    """Solve a long chain, as chains with slack tendons are solved."""
    long = uniform(40)
    assert solve_tensions(long, np.ones(long.n_tendons)).stiffness.size


def planar_friction() -> None:
    """Take a step of a planar chain with friction."""
    assert _step_with_friction(five_link()).size


def planar_friction_special_cases() -> None:
    """Take a step of a long chain with friction."""
    assert _step_with_friction(uniform(40)).size


def arm_solver() -> None:
    """Solve an arm."""
    arm = small_arm()
    taut = solve_tensions(arm, np.ones(arm.n_tendons))
    assert taut.stiffness.size and taut.friction_state.states.size


def arm_friction() -> None:
    """Take a step of an arm with friction."""
    assert _step_with_friction(small_arm()).size


def _step_with_friction(mechanism: AnyMechanism) -> NDArray[np.float64]:
    """Stiffness after a step of a mechanism where nothing has slipped before [N·mm/rad]."""
    rubbing, n_joints = mechanism.replace(friction=_MU), mechanism.n_joints
    hole = np.zeros((n_joints, mechanism.n_tendons))
    history = FrictionState(hole, hole, hole, np.array(mechanism.neutral_angles), np.zeros(n_joints))
    return solve_tensions(rubbing, np.linspace(2.0, 1.0, mechanism.n_tendons), history=history).stiffness


# Those that take longest come first, so that processors are idle for as short a time as possible at the end.
GROUPS = (
    Group("the arm's solver with friction", arm_friction),
    Group("the planar solver for special cases", planar_special_cases),
    Group("the planar solver with friction for special cases", planar_friction_special_cases),
    Group("the planar solver with friction", planar_friction),
    Group("the planar solver", planar_solver),
    Group("the planar solver of batches", planar_batches),
    Group("the arm's solver", arm_solver),
)
