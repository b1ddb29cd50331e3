"""Running episodes side by side, in arrays that are kept from step to step. A scalar environment has one lane."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rj_gym.render import Scene
from rj_gym.tracking import kernels
from rj_gym.tracking.generators import Generators
from rj_gym.tracking.kernels import FORCE, LINK, REWARDS, STEP, TENSIONS, Course, Inputs, Solved, State
from rj_gym.tracking.sampling import NOTHING_FIXED, Episodes, Fixed
from rj_gym.tracking.task import TrackingTask
from rollingjoint._jit import machine_code
from rollingjoint._threads import run_lanes
from rollingjoint.errors import InvalidInput, as_floats
from rollingjoint.lanes import PinnedRange, Problem, TendonLaw, new_results, solve_range, stack
from rollingjoint.load import LOAD_COLUMNS
from rollingjoint.rolling_chain import RollingChain

Array = NDArray[np.float64]
Observation = NDArray[np.float32]

_LINK, _FORCE = LOAD_COLUMNS.index("link"), slice(kernels.FX, kernels.FY + 1)
_BOUND = ("_finite", "_step", "_solve", "_finish", "_action", "_readings", "_pins", "_pinned")


class Lanes:
    """Room for B episodes of a task, as many of them in use as the last `begin` was asked for.

    `state` and `course` change in every call: who hands out parts of them takes copies.

    Args:
        task: the task.
        capacity: B.
        goal: whether observations leave out target and tip error.
    """

    def __init__(self, task: TrackingTask, capacity: int, goal: bool) -> None:
        self.task, self.capacity = task, capacity
        n, m = task.mechanism.n_links, task.mechanism.n_tendons
        self.mechanisms: tuple[RollingChain, ...] = (task.mechanism,)
        self.designs = np.zeros(capacity, np.int64)
        self.course = _new_course(task, capacity)
        self.state = State(
            np.zeros((capacity, n - 1)),
            np.zeros((capacity, n - 1, m)),
            np.zeros((capacity, n, 3)),
            np.zeros((capacity, 2, m)),
            np.zeros((capacity, TENSIONS + 2 * m)),
        )
        self._rules = task.rules(goal)
        self._entries = len(self._rules.low)
        self._actions = np.zeros((capacity, m))
        command, low, high = (np.zeros((capacity, m)) for _ in range(3))
        self._laws = TendonLaw(command, self.course.stiffnesses, low, high)
        self._loads = np.zeros((capacity, 1, len(LOAD_COLUMNS)))
        self._starts = np.zeros((capacity, n - 1))
        self._results = new_results(capacity, n - 1, m, contacts=False, responses=True)
        self._kept_rest: tuple[tuple[RollingChain, bytes], tuple[Array, Array, Array]] | None = None
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
            if left == kernels.REFUSED:
                raise InvalidInput("action", action, _allowed(self._action.shape))
            self._complete(observation, 0, 1)
        return observation

    def begin(
        self, rngs: Sequence[np.random.Generator] | Generators, fixed: Fixed = NOTHING_FIXED
    ) -> tuple[Episodes, Observation]:
        """New episodes in the first lanes, one per generator, with their observations, (len(rngs), entries).

        Tendons are locked at the unloaded start tensions, then the load is applied.
        """
        count, m = len(rngs), self._actions.shape[1]
        episodes = self.task.sample(rngs, fixed)
        self._enter(episodes)
        angles, poses, lengths = self._rest(episodes.start_tensions)
        readings = self.state.readings[:count]
        self.state.angles[:count] = angles
        self.state.responses[:count] = 0.0
        self.state.poses[:count] = poses
        self.state.actions[:count] = self._actions[:count] = 0.0
        readings[:, STEP] = -1.0
        readings[:, TENSIONS : TENSIONS + m] = episodes.start_tensions
        readings[:, TENSIONS + m :] = lengths - episodes.start_tensions / episodes.stiffnesses
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
        kernels.observe(self._pins, observation)
        return observation.reshape(self.capacity, -1)

    def take(self, rows: NDArray[np.int64], other: Lanes) -> None:
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

    def scene(self, trail: Array, lane: int = 0) -> Scene:
        """What a picture of one lane shows; trail (steps, 2) [mm] is where its tip has been."""
        readings, m = self.state.readings[lane], self._actions.shape[1]
        return Scene(
            mechanism=self.mechanisms[self.designs[lane]],
            poses=self.state.poses[lane],
            tensions=readings[TENSIONS : TENSIONS + m],
            tension_range=self.task.config.tension_range,
            targets=over_time(self.course.targets[lane], self.task.config.episode_steps + 1),
            force=readings[FORCE : FORCE + 2],
            link=int(readings[LINK]),
            trail=trail,
            step=int(readings[STEP]),
        )

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name not in _BOUND}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__ |= state
        self._bind()

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

        run_lanes(work, count, self.state.angles.shape[1])
        return observation

    def _complete(self, observation: Observation, first: int, last: int) -> None:
        """A step after lanes were left to the solver for all cases."""
        self._solve.solve_the_rest(first, last)
        self._finish(observation, first, last)

    def _enter(self, episodes: Episodes) -> None:
        """Put what was drawn into the first lanes."""
        count = len(episodes)
        if self.mechanisms != episodes.mechanisms or len(self.mechanisms) > 1:
            self._use(episodes.mechanisms, episodes.designs)
        course = self.course
        self._loads[:count, 0, _LINK] = self.state.readings[:count, LINK] = episodes.links
        course.stiffnesses[:count] = episodes.stiffnesses
        course.actuator_offsets[:count] = episodes.actuator_offsets
        if episodes.noise is not None:
            course.noise[:count] = episodes.noise
        targets = self._tips(episodes.target_tensions) if episodes.targets is None else episodes.targets
        self._widen(targets, episodes.forces)
        self.course.targets[:count] = targets
        self.course.forces[:count] = episodes.forces

    def _tips(self, tensions: Array) -> Array:
        """Tip positions of the unloaded equilibria at tensions (count, K, m), (count, K, 2) [mm]."""
        tips = np.empty((*tensions.shape[:2], 2))
        for k in range(tensions.shape[1]):
            self._solve_unloaded(tensions[:, k])
            tips[:, k] = self._results.poses[: len(tips), -1, :2]
        return tips

    def _rest(self, tensions: Array) -> tuple[Array, Array, Array]:
        """Joint angles, poses and tendon lengths under tensions (count, m), without load; one row if all are alike.

        Episodes that begin alike, as they do by default, share one solve, which is kept.
        """
        count = len(tensions)
        alike = len(self.mechanisms) == 1 and bool((tensions == tensions[0]).all())
        kept = (self.mechanisms[0], tensions[0].tobytes())
        if alike and self._kept_rest is not None and self._kept_rest[0] == kept:
            return self._kept_rest[1]
        rows = 1 if alike else count
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
        self._loads[:count, 0, _FORCE] = 0.0
        self._starts[:count] = self._neutral_angles[self.designs[:count]]
        if count == 1:
            self._solve(0, 1)
        else:
            run_lanes(self._solve, count, self.state.angles.shape[1])

    def _widen(self, targets: Array, forces: Array) -> None:
        """Make room for series over time where constants were enough so far."""
        for name, series in (("targets", targets), ("forces", forces)):
            kept, times = getattr(self.course, name), series.shape[1]
            if times > kept.shape[1]:
                self.course = self.course._replace(**{name: np.repeat(kept, times, axis=1)})
                self._bind()

    def _use(self, mechanisms: tuple[RollingChain, ...], designs: NDArray[np.int64]) -> None:
        """Have the first lanes use these mechanisms."""
        self.mechanisms = mechanisms
        self.designs[:] = 0
        self.designs[: len(designs)] = designs
        self._bind()

    def _bind(self) -> None:
        """The kernels with all arguments that stay."""
        self._neutral_angles = np.array([mechanism.neutral_angles for mechanism in self.mechanisms])
        self._solve = self._bound_solve()
        self._bind_step()

    def _bind_step(self) -> None:
        """The kernels that go around the solve."""
        results = self._results
        solved = Solved(*(getattr(results, name) for name in Solved._fields))
        inputs = Inputs(self._actions, self._starts, self._laws.command, self._loads)
        self._pinned = kernels.task_pins(self._rules, self.course, self.state, inputs, solved)
        self._pins = self._pinned[0].ctypes.data
        self._finite = partial(machine_code(kernels.all_finite, self._actions), self._actions)
        flat = np.empty(0, np.float32)
        bound = self._pins, self._solve.entry, self._solve.pins
        self._action, self._readings = self._actions[0], self.state.readings[0]
        self._step = partial(machine_code(kernels.step, *bound, flat, 0, 0), *bound)
        self._finish = partial(machine_code(kernels.finish, self._pins, flat, 0, 0), self._pins)

    def _bound_solve(self) -> PinnedRange | _LaneByLane:
        """The solve of a range of lanes; lane by lane where mechanisms cannot be stacked."""
        problem = (self._laws, self._loads, self._starts, self._results)
        try:
            return PinnedRange(Problem(stack(self.mechanisms), self.designs, *problem))
        except InvalidInput:  # tendons that end on different links
            return _LaneByLane(
                [Problem(stack([m]), np.zeros_like(self.designs), *problem) for m in self.mechanisms], self.designs
            )


class _LaneByLane:
    """What PinnedRange does, for mechanisms that do not fit into one stack: a problem for each."""

    entry = pins = 0

    def __init__(self, problems: Sequence[Problem], designs: NDArray[np.int64]) -> None:
        self._problems, self._designs = problems, designs

    def __call__(self, first: int, last: int) -> None:
        """Solve lanes first to last - 1."""
        for lane in range(first, last):
            solve_range(self._problems[self._designs[lane]], lane, lane + 1)

    solve_the_rest = __call__


def _allowed(shape: tuple[int, ...]) -> str:
    """What actions have to be, in words."""
    if len(shape) == 1:
        return f"{shape[0]} finite numbers in [-1, 1], one per tendon"
    return f"finite numbers in [-1, 1] of shape {shape}"


def over_time(series: Array, times: int) -> Array:
    """A fresh series (..., times, 2) from one that has one entry where nothing changes, (..., 1 or times, 2)."""
    spread = np.empty((*series.shape[:-2], times, 2))
    spread[...] = series
    return spread


def _new_course(task: TrackingTask, capacity: int) -> Course:
    config, moving, m = task.config, task.mechanism.n_links - 1, task.mechanism.n_tendons
    times = config.episode_steps + 1
    return Course(
        np.zeros((capacity, times if config.target.process == "path" else 1, 2)),
        np.zeros((capacity, 1 if config.load.process == "constant" else times, 2)),
        np.zeros((capacity, m)),
        np.zeros((capacity, m)),
        np.zeros((capacity, times if config.randomization.sensor_noise else 0, moving, 3)),
    )
