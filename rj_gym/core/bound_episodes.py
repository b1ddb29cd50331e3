"""Arrays of a tracking task's episodes, and the kernels that are bound to them.

What a task has of its own, its arrays, loads, solver and kernels, is in a subclass.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from functools import partial
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from rj_gym.core.episodes import EpisodeBuffer, Observation
from rj_gym.core.friction_steps import FrictionSteps, LaneByLane, distinct, no_history
from rj_gym.core.hardware import Hardware
from rj_gym.core.kernels import all_finite, keep_history
from rj_gym.core.tracking_task import TrackingTask
from rollingjoint.chain.chain import Kernels
from rollingjoint.chain.stacks import Variations, stack
from rollingjoint.compiled import (
    Floats,
    FrictionArrays,
    Integers,
    Pinned,
    PinnedRange,
    TendonLaw,
    begin_range,
    machine_code,
    run_in_threads,
    runs_at_once,
    step_range,
)
from rollingjoint.errors import InvalidInput

Array = NDArray[np.float64]
_COUNTS, _STATUS = Annotated[Integers, "B", "m"], Annotated[Integers, "B"]
_READINGS = Annotated[Floats, "B", "columns"]


class BoundEpisodes(EpisodeBuffer):
    """Arrays with room for B episodes of a tracking task; a change of mechanisms or arrays binds the kernels anew."""

    _compiled: ClassVar[Any]  # the module of the task's compiled step, with TaskArrays and their parts
    _FORCE: ClassVar[slice]  # columns of a load table, of the force in its last row that acts only while episodes run
    _LOAD_COLUMNS: ClassVar[tuple[str, ...]]  # of a load table
    course: Any  # what is fixed when an episode begins
    state: Any  # where running episodes are
    hardware: Hardware  # motors and sensors
    _loads: Array  # (B, rows, columns)
    _results: Any
    _solve: Any  # a PinnedRange, or a LaneByLane; without friction
    _rub: Any  # steps with friction: FrictionSteps, or None
    _step: Callable[..., int]  # (address, first, last) -> lanes whose solve and `_finish` remain to be done
    _finish: Callable[..., object]  # (address, first, last); the address is that of observations (B, entries)
    _finite: Callable[[], bool]

    def __init__(self, task: TrackingTask, capacity: int, goal: bool = False) -> None:
        super().__init__(task, capacity, goal)
        n_joints, m = task.mechanism.n_joints, task.mechanism.n_tendons
        self.mechanisms: Sequence[Any] = (task.mechanism,)
        self.designs = np.zeros(capacity, np.int64)
        self._rules: Any = task.rules(goal)
        self._entries, self._action_shape = len(self._rules.low), (m,)
        self._at_once = runs_at_once(n_joints)
        self._starts = np.zeros((capacity, n_joints))
        self._kept_rest: tuple[tuple[Any, bytes], tuple[Array, Array, Array]] | None = None
        self._spare: Any = None
        self._make_room()
        command, low, high = (np.zeros((capacity, m)) for _ in range(3))
        self._laws = TendonLaw(command, self.course.stiffnesses, low, high)
        self._friction = no_history(capacity, n_joints, m) if task.has_friction else None
        self._bind()

    def __getstate__(self) -> dict[str, Any]:
        bound = {"readings", "_finite", "_step", "_solve", "_rub", "_finish", "_action", "_row", "_seen", "_at"}
        bound |= {"_pins", "_pinned"}
        return {name: value for name, value in self.__dict__.items() if name not in bound}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__ |= state
        self._bind()

    @property
    def _kernels(self) -> Kernels:
        """What the mechanism is solved by."""
        return self.task.mechanism.kernels

    @abstractmethod
    def _make_room(self) -> None:
        """Make the arrays of the task: course, state, loads, results."""

    @abstractmethod
    def _tips(self, count: int) -> Array:
        """What a target specifies, of the solved first lanes' tips, (count, d) [mm]."""

    def _bind_step(self) -> None:
        """The task's kernels: `_step`, `_finish`, and what `_observe` calls."""
        kernels, results = self._compiled, self._results
        solved = kernels.Solved(*(getattr(results, name) for name in kernels.Solved._fields))
        inputs = kernels.Inputs(self._actions, self._starts, self._laws.command, self._loads)
        solver = (self._solve.entry, self._solve.pins) if self._rub is None else (0, 0)
        arrays = kernels.TaskArrays(self._rules, self.course, self.state, self.hardware, inputs, solved, *solver)
        self._pinned = Pinned(arrays)
        self._pins = self._pinned.address_for(kernels.TaskArrays)
        self._step = partial(machine_code(kernels.step, int, int, int, int), self._pins)
        self._finish = partial(machine_code(kernels.finish, int, int, int, int), self._pins)

    def _observe(self, address: int) -> None:
        """Fill the observations of all lanes, (B, entries), anew."""
        self._compiled.observe(self._pins, address)

    def _advance(self, count: int) -> Observation:
        """A step of the first lanes; their fresh observations, (count, entries)."""
        if count == 1 and self._at_once:
            if self._step(self._at, 0, 1):
                self._complete(self._at, 0, 1)
            return self._seen[None].copy()
        observations = self._room(count)
        address = observations.ctypes.data

        def work(first: int, last: int) -> None:
            if self._step(address, first, last):
                self._complete(address, first, last)

        run_in_threads(work, count, self.state.angles.shape[1])
        return observations

    def _room(self, count: int) -> Observation:
        """Room for the observations of so many lanes."""
        return np.empty((count, self._entries), np.float32)

    def _complete(self, address: int, first: int, last: int) -> None:
        """A step after lanes were left to the solver for all cases, or to steps with friction."""
        (self._rub or self._solve).solve_the_rest(first, last)
        self._finish(address, first, last)

    def _solve_at(self, tensions: Array, forces: Array | float = 0.0) -> None:
        """Solve the first lanes under tensions (count, m) and forces (count, d), from their neutral poses."""
        count = len(tensions)
        self._laws.command[:count] = 0.0
        self._laws.low[:count] = self._laws.high[:count] = tensions
        self._loads[:count, -1, self._FORCE] = forces
        alike = len(self._neutral_angles) == 1
        self._starts[:count] = self._neutral_angles if alike else self._neutral_angles[self.designs[:count]]
        if count == 1:
            self._solve(0, 1)
        else:
            run_in_threads(self._solve, count, self.state.angles.shape[1])

    def _use(self, mechanisms: Sequence[Any], designs: NDArray[np.int64]) -> None:
        """Have the first lanes use these mechanisms."""
        self.mechanisms = mechanisms
        self.designs[:] = 0
        self.designs[: len(designs)] = designs
        self._bind()

    def _widen(self, targets: Array, forces: Array) -> None:
        """Make room for series over time where constants were enough so far."""
        for name, series in (("targets", targets), ("forces", forces)):
            kept, times = getattr(self.course, name), series.shape[1]
            if times > kept.shape[1]:
                self.course = self.course._replace(**{name: np.repeat(kept, times, axis=1)})
                self._bind()

    def _bind(self) -> None:
        """Bind the kernels to the arguments that stay the same."""
        mechanisms, self._rows = self.mechanisms, self.designs
        if isinstance(mechanisms, Variations):
            self._neutral_angles, self._rows = mechanisms.neutral_angles, mechanisms.designs[self.designs]
        else:
            self._neutral_angles = np.array([mechanism.neutral_angles for mechanism in mechanisms])
        self.readings, self._action, self._row = self.state.readings, self._actions[0], self.state.readings[0]
        self._finite = partial(machine_code(all_finite, Annotated[Floats, "B", "m"]), self._actions)
        batches = self._batches()
        self._solve = self._on_lanes([PinnedRange(self._kernels, batch) for batch in batches])
        self._rub = None if self._friction is None else self._bound_friction(self._friction, batches)
        self._bind_step()
        self._seen = self._room(1)[0]
        self._at: int = self._seen.ctypes.data

    def _batches(self) -> list[Any]:
        """What is solved: one batch, or one per mechanism where their tendons end on different links."""
        arrays = self._laws, self._loads, self._starts, self._results
        try:
            return [self._kernels.batch_arrays(stack(self.mechanisms), self._rows, *arrays)]
        except InvalidInput:
            alone = np.zeros_like(self.designs)
            return [self._kernels.batch_arrays(each.arrays, alone, *arrays) for each in self.mechanisms]

    def _on_lanes(self, solvers: Sequence[Any]) -> Any:
        """The only solver, or all of them, each for the lanes with its mechanism."""
        return solvers[0] if len(solvers) == 1 else LaneByLane(solvers, self.designs)

    def _bound_friction(self, friction: FrictionArrays, batches: list[Any]) -> FrictionSteps:
        """Steps with friction of these batches."""
        steps = self._on_lanes([partial(step_range, self._kernels, batch, friction) for batch in batches])
        begins = self._on_lanes([partial(begin_range, batch, friction) for batch in batches])
        last_links = np.array([mechanism.last_links for mechanism in distinct(self.mechanisms)], np.int64)
        crossed = last_links[self.designs if len(last_links) > 1 else np.zeros(self.capacity, np.int64)]
        kinds = FrictionArrays, _COUNTS, _STATUS, _READINGS, int, int
        keep = partial(machine_code(keep_history, *kinds), friction, crossed, self._results.status, self.readings)
        return FrictionSteps(steps, keep, begins)
