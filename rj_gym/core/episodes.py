"""Running episodes of a task side by side, in arrays that are kept from step to step: what every task shares.

A scalar environment has one lane. What a task has of its own, its arrays, loads, solver and kernels, is in a subclass.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rj_gym.core.generators import Generators
from rj_gym.planar.kernels import LINK, REFUSED, REWARDS, STEP, TENSIONS, all_finite
from rollingjoint.checks import as_floats
from rollingjoint.compiled import Floats, Singles, machine_code, run_in_threads
from rollingjoint.errors import InvalidInput
from rollingjoint.planar.batch import TendonLaw

if TYPE_CHECKING:
    from rj_gym.core.task import Task

Array = NDArray[np.float64]
Observation = NDArray[np.float32]
FLAT = Annotated[Singles, "B x entries"]  # observations as kernels fill them


class TaskLanes(ABC):
    """Room for B episodes of a task, as many of them in use as the last `begin` was asked for.

    `state` and `course` change in every call: who hands out parts of them takes copies.

    Args:
        task: the task.
        capacity: B.
        goal: whether observations leave out target and tip error.
    """

    _BOUND: ClassVar[tuple[str, ...]] = ()  # what `_bind` makes, and what a pickle leaves out
    _FORCE: ClassVar[slice]  # columns of a load table, of the force in its last row that acts only while episodes run
    course: Any  # what is fixed when an episode begins
    state: Any  # where running episodes are
    _loads: Array  # (B, rows, columns)
    _results: Any
    _solve: Any  # PinnedRange, or what has its interface
    _step: Callable[..., int]  # (observation, first, last) -> lanes whose solve and `_finish` remain to be done
    _finish: Callable[..., object]  # (observation, first, last)

    def __init__(self, task: Task, capacity: int, goal: bool) -> None:
        self.task, self.capacity = task, capacity
        n_joints, m = task.mechanism.n_joints, task.mechanism.n_tendons
        self.mechanisms: tuple[Any, ...] = (task.mechanism,)
        self.designs = np.zeros(capacity, np.int64)
        self._rules: Any = task.rules(goal)
        self._entries = len(self._rules.low)
        self._actions = np.zeros((capacity, m))
        self._starts = np.zeros((capacity, n_joints))
        self._kept_rest: tuple[tuple[Any, bytes], tuple[Array, Array, Array]] | None = None
        self._make_room()
        command, low, high = (np.zeros((capacity, m)) for _ in range(3))
        self._laws = TendonLaw(command, self.course.stiffnesses, low, high)
        self._bind()

    def accept(self, actions: ArrayLike) -> None:
        """Keep actions, (B, m), for `advance`.

        Raises:
            InvalidInput: actions that are not finite numbers of that shape; nothing has changed then.
        """
        self._accept("actions", actions, self._actions)
        if not self._finite():
            raise InvalidInput("actions", actions, _allowed(self._actions.shape))

    def advance(self) -> Observation:
        """One step of all lanes with the accepted actions; fresh observations, (B, entries)."""
        return self._advance(self.capacity).reshape(self.capacity, -1)

    def step_alone(self, action: ArrayLike) -> Observation:
        """One step of the only lane, with an action (m,); its fresh observation, (entries,). Raises as `accept`."""
        self._accept("action", action, self._action)
        observation = np.empty(self._entries, np.float32)
        if left := self._step(observation, 0, 1):
            if left == REFUSED:
                raise InvalidInput("action", action, _allowed(self._action.shape))
            self._complete(observation, 0, 1)
        return observation

    def begin(self, rngs: Sequence[np.random.Generator] | Generators, fixed: Any = None) -> tuple[Any, Observation]:
        """New episodes in the first lanes, one per generator, with their observations, (len(rngs), entries).

        Tendons are locked at the unloaded start tensions, then the load is applied.
        """
        count, m = len(rngs), self._actions.shape[1]
        episodes = self.task.sample(rngs, fixed)
        self._enter(episodes)
        angles, poses, lengths = self._rest(episodes)
        readings = self.state.readings[:count]
        self.state.angles[:count] = angles
        self.state.poses[:count] = poses
        self.state.actions[:count] = self._actions[:count] = 0.0
        readings[:, STEP] = -1.0
        readings[:, TENSIONS : TENSIONS + m] = episodes.start_tensions
        readings[:, TENSIONS + m : TENSIONS + 2 * m] = lengths - episodes.start_tensions / episodes.stiffnesses
        self._laws.low[:count], self._laws.high[:count] = self.task.config.tension_range
        observation = self._advance(count)
        readings[:, REWARDS] = 0.0
        return episodes, observation.reshape(count, -1)

    def read_alone(self) -> Array:
        """The readings of the only lane, (columns,): a copy."""
        return self._readings.copy()

    def observe(self) -> Observation:
        """The observations of all lanes once more, (B, entries)."""
        observation = np.empty(self.capacity * self._entries, np.float32)
        self._observe(observation)
        return observation.reshape(self.capacity, -1)

    def take(self, rows: NDArray[np.int64], other: TaskLanes) -> None:
        """Go on in these rows with the first lanes of another room."""
        count = len(rows)
        self._widen(other.course.targets, other.course.forces)
        for mine, theirs in zip(self._kept(), other._kept(), strict=True):
            mine[rows] = theirs[:count]
        if self.mechanisms != other.mechanisms or len(self.mechanisms) > 1:
            mechanisms = [self.mechanisms[design] for design in self.designs]
            for row, design in zip(rows, other.designs[:count], strict=True):
                mechanisms[row] = other.mechanisms[design]
            designs = {mechanism: design for design, mechanism in enumerate(dict.fromkeys(mechanisms))}
            self._use(tuple(designs), np.array([designs[mechanism] for mechanism in mechanisms]))

    @abstractmethod
    def scene(self, trail: Array, lane: int = 0) -> Any:
        """What a picture of one lane shows; trail (steps, 2 or 3) [mm] is where its tip has been."""

    def __getstate__(self) -> dict[str, Any]:
        bound = ("_finite", "_step", "_solve", "_finish", "_action", "_readings", *self._BOUND)
        return {name: value for name, value in self.__dict__.items() if name not in bound}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__ |= state
        self._bind()

    @abstractmethod
    def _make_room(self) -> None:
        """Make the arrays of the task: course, state, loads, results."""

    @abstractmethod
    def _enter_loads(self, episodes: Any) -> None:
        """Put into the first lanes what loads and a task's own numbers depend on."""

    @abstractmethod
    def _tips(self, count: int) -> Array:
        """What a target says of the tip, of the solved first lanes, (count, d) [mm]."""

    @abstractmethod
    def _bound_solve(self) -> Any:
        """The solve of a range of lanes; lane by lane where mechanisms cannot be stacked."""

    @abstractmethod
    def _bind_step(self) -> None:
        """The kernels that go around the solve: `_step`, `_finish`."""

    @abstractmethod
    def _observe(self, observation: Observation) -> None:
        """Fill the flat observation anew."""

    def _kept(self) -> tuple[NDArray[Any], ...]:
        """The arrays (B, ...) that steps go on from."""
        return *self.state, *self.course, self._loads

    def _accept(self, what: str, actions: ArrayLike, place: Array) -> None:
        """Put actions of the right shape into their place.

        Raises:
            InvalidInput: others.
        """
        if isinstance(actions, np.ndarray) and actions.dtype.kind == "f":
            values: NDArray[Any] = actions
        else:
            values = as_floats(what, actions, _allowed(place.shape))
        if values.shape != place.shape:
            raise InvalidInput(what, actions, _allowed(place.shape))
        place[...] = values

    def _advance(self, count: int) -> Observation:
        """A step of the first lanes; their fresh observations, flat."""
        observation = np.empty(count * self._entries, np.float32)

        def work(first: int, last: int) -> None:
            if self._step(observation, first, last):
                self._complete(observation, first, last)

        run_in_threads(work, count, self.state.angles.shape[1])
        return observation

    def _complete(self, observation: Observation, first: int, last: int) -> None:
        """A step after lanes were left to the solver for all cases."""
        self._solve.solve_the_rest(first, last)
        self._finish(observation, first, last)

    def _enter(self, episodes: Any) -> None:
        """Put what was drawn into the first lanes."""
        count = len(episodes)
        if self.mechanisms != episodes.mechanisms or len(self.mechanisms) > 1:
            self._use(episodes.mechanisms, episodes.designs)
        course = self.course
        self.state.readings[:count, LINK] = episodes.links
        course.stiffnesses[:count] = episodes.stiffnesses
        course.actuator_offsets[:count] = episodes.actuator_offsets
        if episodes.noise is not None:
            course.noise[:count] = episodes.noise
        self._enter_loads(episodes)
        targets = self._aims(episodes.target_tensions) if episodes.targets is None else episodes.targets
        self._widen(targets, episodes.forces)
        self.course.targets[:count] = targets
        self.course.forces[:count] = episodes.forces

    def _aims(self, tensions: Array) -> Array:
        """What the tips of the unloaded equilibria at tensions (count, K, m) give for targets, (count, K, d) [mm]."""
        aims = np.empty((*tensions.shape[:2], self.course.targets.shape[2]))
        for k in range(tensions.shape[1]):
            self._solve_unloaded(tensions[:, k])
            aims[:, k] = self._tips(len(aims))
        return aims

    def _rest(self, episodes: Any) -> tuple[Array, Array, Array]:
        """Joint angles, poses and tendon lengths at the start tensions, without load; one row if all are alike.

        Episodes that begin alike share one solve, which is kept.
        """
        tensions, causes = episodes.start_tensions, episodes.rest_causes
        alike = len(self.mechanisms) == 1 and bool((causes == causes[0]).all())
        kept = (self.mechanisms[0], causes[0].tobytes())
        if alike and self._kept_rest is not None and self._kept_rest[0] == kept:
            return self._kept_rest[1]
        rows = 1 if alike else len(tensions)
        self._solve_unloaded(tensions[:rows])
        results = self._results
        rest = results.joint_angles[:rows].copy(), results.poses[:rows].copy(), results.lengths[:rows].copy()
        if alike:
            self._kept_rest = kept, rest
        return rest

    def _solve_unloaded(self, tensions: Array) -> None:
        """Solve the first lanes under tensions (count, m), without load, from their neutral poses."""
        count = len(tensions)
        self._laws.command[:count] = 0.0
        self._laws.low[:count] = self._laws.high[:count] = tensions
        self._loads[:count, -1, self._FORCE] = 0.0
        self._starts[:count] = self._neutral_angles[self.designs[:count]]
        if count == 1:
            self._solve(0, 1)
        else:
            run_in_threads(self._solve, count, self.state.angles.shape[1])

    def _widen(self, targets: Array, forces: Array) -> None:
        """Make room for series over time where constants were enough so far."""
        for name, series in (("targets", targets), ("forces", forces)):
            kept, times = getattr(self.course, name), series.shape[1]
            if times > kept.shape[1]:
                self.course = self.course._replace(**{name: np.repeat(kept, times, axis=1)})
                self._bind()

    def _use(self, mechanisms: tuple[Any, ...], designs: NDArray[np.int64]) -> None:
        """Have the first lanes use these mechanisms."""
        self.mechanisms = mechanisms
        self.designs[:] = 0
        self.designs[: len(designs)] = designs
        self._bind()

    def _bind(self) -> None:
        """The kernels with all arguments that stay."""
        self._neutral_angles = np.array([mechanism.neutral_angles for mechanism in self.mechanisms])
        self._action, self._readings = self._actions[0], self.state.readings[0]
        self._finite = partial(machine_code(all_finite, Annotated[Floats, "B", "m"]), self._actions)
        self._solve = self._bound_solve()
        self._bind_step()


class LaneByLane:
    """What PinnedRange does, for mechanisms that do not fit into one stack: a solver of a range of lanes for each."""

    entry = pins = 0

    def __init__(self, solvers: Sequence[Callable[[int, int], object]], designs: NDArray[np.int64]) -> None:
        self._solvers, self._designs = solvers, designs

    def __call__(self, first: int, last: int) -> None:
        """Solve lanes first to last - 1."""
        for lane in range(first, last):
            self._solvers[self._designs[lane]](lane, lane + 1)

    solve_the_rest = __call__


def _allowed(shape: tuple[int, ...]) -> str:
    """What actions have to be, in words."""
    if len(shape) == 1:
        return f"{shape[0]} finite numbers in [-1, 1], one per tendon"
    return f"finite numbers in [-1, 1] of shape {shape}"


def over_time(series: Array, times: int) -> Array:
    """A fresh series (..., times, d) from one that has one entry where nothing changes, (..., 1 or times, d)."""
    spread = np.empty((*series.shape[:-2], times, series.shape[-1]))
    spread[...] = series
    return spread
