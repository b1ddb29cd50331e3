"""All kernels compiled in advance, in processes side by side, for `rj warmup` and before tests.

A group is a function that calls its kernels. Groups share no kernel that takes long, or one waits for the other.
Other packages add groups by entry points of the group `rollingjoint.kernels`, each of which names a tuple of Groups.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from importlib.metadata import entry_points
from typing import IO

import numpy as np
from numpy.typing import NDArray

from rollingjoint import transmission
from rollingjoint._numba.cache import without_compiling
from rollingjoint.chain.chain import AnyChain
from rollingjoint.chain.presets import five_link, pitch_yaw, small_arm, uniform
from rollingjoint.friction import CapstanFriction, FrictionState
from rollingjoint.inverse import reach
from rollingjoint.statics.reactions import hinge_reactions
from rollingjoint.statics.solve import solve_lengths, solve_lengths_batch, solve_tensions
from rollingjoint.surroundings import Disc, Sphere, Surroundings, WallFriction

ENTRY_POINTS = "rollingjoint.kernels"
FAMILIES = ("planar", "arm", "space")
"""Kinds of mechanisms: planar chains, arms, and chains in space."""
_PAUSE = 0.05  # s between two looks at the processes
_PROGRAM = """
import importlib, os, queue, signal, sys, threading
signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent, which ends this process
done, sys.stdout = sys.stdout, sys.stderr
functions = queue.SimpleQueue()
def listen():
    while line := os.read(0, 4096):  # the next line is written when the function of the last one has returned
        functions.put(line.decode().split())
    os._exit(1)  # the parent has closed the pipe, or is gone
threading.Thread(target=listen, daemon=True).start()
while function := functions.get():
    getattr(importlib.import_module(function[0]), function[1])()
    print(end=".", file=done, flush=True)
os._exit(0)  # to free the compiler's memory takes seconds
"""


@dataclass(frozen=True)
class Group:
    """Kernels that one process compiles.

    Args:
        title: the solver that they belong to, for people.
        use: a function at the top level of a module, which calls them all.
        after: title of a group with further kernels that it needs; empty if there is none.
        family: one of FAMILIES, of one kind of mechanism, or empty: groups of one family have parts in common, which a
            process that compiles several of them types once.
        walls: whether they are of mechanisms among walls.
    """

    title: str
    use: Callable[[], object]
    after: str = ""
    family: str = ""
    walls: bool = False

    @property
    def is_kept(self) -> bool:
        """True if all its kernels are on disk, and work; loads them."""
        try:
            with without_compiling():
                self.use()
        except Exception:  # NotCompiled, or an error, which the process that compiles them will tell
            return False
        return True


class WarmupProgress:
    """Reports of `compile_kernels`; this base class ignores them."""

    def started(self, group: Group) -> None:
        """A process compiles the group."""

    def ended(self, group: Group, seconds: float, error: str) -> None:
        """Its compilation has ended after `seconds` [s]; error: one line if it failed, else empty."""

    def waits(self) -> None:
        """Called several times a second."""


def all_groups(families: Sequence[str] = FAMILIES, walls: bool = True) -> tuple[Group, ...]:
    """The groups of this package and of installed packages that add some.

    Args:
        families: those of these, and the groups of no family. walls: also of mechanisms among walls.
    """
    added = [group for entry in sorted(entry_points(group=ENTRY_POINTS)) for group in entry.load()]
    return tuple(group for group in (*GROUPS, *added) if group.family in (*families, "") and (walls or not group.walls))


def missing(groups: Sequence[Group]) -> list[Group]:
    """The groups with a kernel that is not on disk."""
    return [group for group in groups if not group.is_kept]


def compile_kernels(groups: Sequence[Group], progress: WarmupProgress | None = None) -> bool:
    """Compile the kernels of some groups, in one process per processor.

    Groups that others wait for come first, and a process that has compiled a group goes on with one of the same family
    if it can. However it ends, none of the processes goes on.

    Returns:
        True if all could be compiled.
    """
    progress = progress or WarmupProgress()
    waiting, well = list(groups), True
    with _compilers() as compilers:
        while waiting or any(compiler.group for compiler in compilers):
            while (pair := _next(waiting, compilers)) is not None:
                compiler, group = pair
                waiting.remove(group)
                compiler.begin(group)
                progress.started(group)
            for compiler in [compiler for compiler in compilers if compiler.has_ended]:
                group, seconds, error = compiler.end_group()
                if error:
                    compilers.remove(compiler)
                    well = False
                progress.ended(group, seconds, error)
            progress.waits()
            time.sleep(_PAUSE)
        for compiler in compilers:
            compiler.dismiss()
    return well


def _next(waiting: Sequence[Group], compilers: list[_CompilerProcess]) -> tuple[_CompilerProcess, Group] | None:
    """An idle process, started if need be, and a group for it; None if no group can begin."""
    busy = {group.title for group in waiting} | {compiler.group.title for compiler in compilers if compiler.group}
    awaited = {group.after for group in waiting}
    ready = [group for group in waiting if group.after not in busy]
    ready.sort(key=lambda group: group.title not in awaited)
    idle = [compiler for compiler in compilers if compiler.group is None]
    if not ready:
        return None
    for compiler in idle:
        for group in ready:
            if group.family == compiler.family:
                return compiler, group
    if not idle and len(compilers) < _processors():
        idle.append(_CompilerProcess())
        compilers += idle
    return (idle[0], ready[0]) if idle else None


def _processors() -> int:
    """Number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@dataclass
class _CompilerProcess:
    """A process that compiles one group after the other."""

    messages: IO[bytes] = field(default_factory=tempfile.TemporaryFile)
    done: IO[bytes] = field(default_factory=tempfile.TemporaryFile)  # a byte for every group
    group: Group | None = None  # the group in work
    family: str = ""  # of the group it began last
    started: float = 0.0  # when it began that [s]
    n_groups: int = 0  # number of groups begun

    def __post_init__(self) -> None:
        command = [sys.executable, "-P", "-c", _PROGRAM]
        self.process = subprocess.Popen(
            command, env=_same_imports(), stdin=subprocess.PIPE, stdout=self.done, stderr=self.messages
        )

    def begin(self, group: Group) -> None:
        """Have it compile a group."""
        self.group, self.family, self.started = group, group.family, time.perf_counter()
        self.n_groups += 1
        self._tell(f"{group.use.__module__} {group.use.__name__}")

    def dismiss(self) -> None:
        """Tell it that there are no more groups."""
        self._tell("")
        self.process.wait()

    def _tell(self, line: str) -> None:
        assert self.process.stdin is not None
        with suppress(OSError):  # it has died, which has_ended sees
            os.write(self.process.stdin.fileno(), f"{line}\n".encode())

    @property
    def has_ended(self) -> bool:
        """True if it has compiled its group, or died of it."""
        return self.group is not None and (self._is_done() or self.process.poll() is not None)

    def _is_done(self) -> bool:
        return os.fstat(self.done.fileno()).st_size >= self.n_groups

    def end_group(self) -> tuple[Group, float, str]:
        """The group that it has ended, the time taken [s], and the error in one line, or ""."""
        assert self.group is not None
        group, self.group = self.group, None
        error = "" if self._is_done() else self._error()
        return group, time.perf_counter() - self.started, error

    def _error(self) -> str:
        """Reason why the process has ended, in one line."""
        self.process.communicate()
        with self.done, self.messages:
            self.messages.seek(0)
            lines = self.messages.read().decode(errors="replace").strip().splitlines()
        return lines[-1].strip() if lines else f"ended with exit code {self.process.returncode}"

    def end(self) -> None:
        """End the process, and wait for that."""
        self.process.kill()
        self.process.communicate()
        self.done.close()
        self.messages.close()


def _same_imports() -> dict[str, str]:
    """An environment in which a process imports from the same folders as this one."""
    return os.environ | {"PYTHONPATH": os.pathsep.join(path or os.getcwd() for path in sys.path)}


@contextmanager
def _compilers() -> Iterator[list[_CompilerProcess]]:
    """A list of processes, which are ended with the context."""
    compilers: list[_CompilerProcess] = []
    try:
        yield compilers
    finally:
        for compiler in compilers:
            compiler.end()


_MU = CapstanFriction(0.1)


def planar_solver() -> None:
    """Solve a planar chain."""
    chain = five_link()
    taut = solve_lengths(chain, chain.neutral_lengths - 0.5)
    assert taut.arc_lengths.size and taut.friction_state.states.size and chain.poses(taut.joint_angles).size


def planar_batches() -> None:
    """Solve planar chains side by side."""
    chain = five_link()
    assert solve_lengths_batch(chain, [chain.neutral_lengths - 0.5] * 2).joint_angles.size


def general_planar_solver() -> None:
    """Solve a long chain, as chains with slack tendons are solved."""
    long = uniform(40)
    assert solve_tensions(long, np.ones(long.n_tendons)).stiffness.size


def planar_friction() -> None:
    """Take a step of a planar chain with friction."""
    assert _step_with_friction(five_link()).size


def general_planar_solver_with_friction() -> None:
    """Take a step of a long chain with friction."""
    assert _step_with_friction(uniform(40)).size


def planar_solver_among_walls() -> None:
    """Solve a planar chain among walls, and check the next step for obstacles passed."""
    _among_walls(five_link(), Surroundings([Disc((20.0, 30.0), 5.0)]))


def arm_solver_among_walls() -> None:
    """Solve an arm among walls."""
    _among_walls(small_arm(), Surroundings([Sphere((30.0, 0.0, 60.0), 5.0)]))


def spatial_solver_among_walls() -> None:
    """Solve a chain in space among walls."""
    _among_walls(pitch_yaw(2), Surroundings([Sphere((30.0, 0.0, 20.0), 5.0)]))


def _among_walls(chain: AnyChain, around: Surroundings) -> None:
    """Solve a chain among walls, and the next step."""
    first = solve_lengths(chain, chain.neutral_lengths - 0.5, surroundings=around)
    second = solve_lengths(chain, chain.neutral_lengths - 0.5, surroundings=around, start=first)
    assert second.stiffness.size and isinstance(second.wall_contacts, list)


def planar_friction_among_walls() -> None:
    """Take a step of a planar chain with friction in its holes and at walls."""
    around = Surroundings([Disc((20.0, 30.0), 5.0)], friction=WallFriction(0.1))
    assert _step_with_friction(five_link(), surroundings=around).size


def arm_friction_among_walls() -> None:
    """Take a step of an arm with friction in its holes and at walls."""
    around = Surroundings([Sphere((30.0, 0.0, 60.0), 5.0)], friction=WallFriction(0.1))
    assert _step_with_friction(small_arm(), surroundings=around).size


def spatial_friction_among_walls() -> None:
    """Take a step of a chain in space with friction in its holes and at walls."""
    around = Surroundings([Sphere((30.0, 0.0, 20.0), 5.0)], friction=WallFriction(0.1))
    assert _step_with_friction(pitch_yaw(2), surroundings=around).size


def motors_and_sheaths() -> None:
    """Move a motor with play, sheath and tension limits."""
    tendon, motor, half, friction = 90.0, 89.0, 0.5, 0.3
    moved = transmission.play_step(tendon, motor, half)
    ratio = transmission.sheath_ratio(friction, transmission.sheath_direction(moved, motor, half))
    assert transmission.play_place(moved, motor, half) == transmission.play_contact(tendon, motor, half) == 1.0
    assert ratio > 1.0 and transmission.play_inverse(moved, -1.0, half) < motor
    assert transmission.at_limit(transmission.limited_tension(20.0, 0.5, 15.0), 0.5, 15.0)


def arm_solver() -> None:
    """Solve an arm."""
    arm = small_arm()
    taut = solve_tensions(arm, np.ones(arm.n_tendons))
    assert taut.stiffness.size and taut.friction_state.states.size and hinge_reactions(taut).size


def arm_batches() -> None:
    """Solve arms side by side."""
    arm = small_arm()
    assert solve_lengths_batch(arm, [arm.neutral_lengths - 0.1] * 2).joint_angles.size


def general_arm_solver() -> None:
    """Solve an arm with linear tendons, as arms that buckle are solved."""
    arm = small_arm().replace(model="linear")
    assert solve_tensions(arm, np.ones(arm.n_tendons)).joint_angles.size


def arm_friction() -> None:
    """Take a step of an arm with friction."""
    assert _step_with_friction(small_arm()).size


def general_arm_solver_with_friction() -> None:
    """Take a step of a long arm with friction."""
    assert _step_with_friction(small_arm(40)).size


def spatial_solver() -> None:
    """Solve a chain in space."""
    chain = pitch_yaw(2)
    assert solve_tensions(chain, np.ones(chain.n_tendons)).stiffness.size and chain.neutral_lengths.size


def spatial_friction() -> None:
    """Take a step of a chain in space with friction."""
    assert _step_with_friction(pitch_yaw(2)).size


def planar_inverse() -> None:
    """Reach targets with a planar chain."""
    _reach(five_link())


def arm_inverse() -> None:
    """Reach targets with an arm."""
    _reach(small_arm())


def spatial_inverse() -> None:
    """Reach targets with a chain in space."""
    _reach(pitch_yaw(2))


def _reach(mechanism: AnyChain) -> None:
    """Reach a tip, cold and warm."""
    tip = solve_tensions(mechanism, np.ones(mechanism.n_tendons)).tip
    cold = reach(mechanism, tip, tension_limits=(0.5, 2.0))
    assert reach(mechanism, tip, tension_limits=(0.5, 2.0), start=cold).lengths.size


def _step_with_friction(mechanism: AnyChain, surroundings: Surroundings | None = None) -> NDArray[np.float64]:
    """Stiffness after the first step of a mechanism [N·mm/rad]."""
    rubbing, n_joints = mechanism.replace(friction=_MU), mechanism.n_joints
    hole = np.zeros((n_joints, mechanism.n_tendons))
    history = FrictionState(hole, hole, hole, np.array(mechanism.neutral_angles), np.zeros(n_joints))
    tensions = np.linspace(2.0, 1.0, mechanism.n_tendons)
    return solve_tensions(rubbing, tensions, history=history, surroundings=surroundings).stiffness


# The longest come first, so that processors are idle for as short a time as possible at the end.
GROUPS = (
    Group("the arm's general solver with friction", general_arm_solver_with_friction, family="arm"),
    Group("the arm's solver with friction", arm_friction, family="arm"),
    Group("the planar solver among walls", planar_solver_among_walls, family="planar", walls=True),
    Group(
        "the planar solver with friction among walls",
        planar_friction_among_walls,
        after="the planar solver among walls",
        family="planar",
        walls=True,
    ),
    Group("the arm's solver among walls", arm_solver_among_walls, family="arm", walls=True),
    Group(
        "the arm's solver with friction among walls",
        arm_friction_among_walls,
        after="the arm's solver among walls",
        family="arm",
        walls=True,
    ),
    Group("the solver of chains in space among walls", spatial_solver_among_walls, family="space", walls=True),
    Group(
        "the solver of chains in space with friction among walls",
        spatial_friction_among_walls,
        after="the solver of chains in space among walls",
        family="space",
        walls=True,
    ),
    Group("the general planar solver", general_planar_solver, family="planar"),
    Group("the general planar solver with friction", general_planar_solver_with_friction, family="planar"),
    Group("the planar solver with friction", planar_friction, family="planar"),
    Group("the planar solver", planar_solver, family="planar"),
    Group("the planar solver of batches", planar_batches, family="planar"),
    Group("the arm's general solver", general_arm_solver, family="arm"),
    Group("the arm's solver of single chains", arm_solver, family="arm"),
    Group("the arm's solver", arm_batches, family="arm"),
    Group("the solver of chains in space with friction", spatial_friction, family="space"),
    Group("the solver of chains in space", spatial_solver, family="space"),
    Group("the inverse of planar chains", planar_inverse, after="the planar solver of batches", family="planar"),
    Group("the inverse of arms", arm_inverse, after="the arm's solver", family="arm"),
    Group("the inverse of chains in space", spatial_inverse, after="the solver of chains in space", family="space"),
    Group("motors and sheaths", motors_and_sheaths),
)
