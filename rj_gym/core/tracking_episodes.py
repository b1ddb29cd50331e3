"""Running episodes of a tracking task, whichever mechanism it has.

What a task has of its own, its arrays, loads, solver and kernels, is in a subclass.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from functools import partial
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rj_gym.core.draws import of_lanes, over_time
from rj_gym.core.episodes import NO_ROWS, EpisodeBuffer, Observation, Rows
from rj_gym.core.generators import Random
from rj_gym.core.kernels import LINK, REFUSED, REWARDS, STEP, TENSIONS, TIP, all_finite, keep_history
from rj_gym.core.tracking_task import TrackingTask
from rollingjoint.compiled import (
    MU,
    N_COEFFICIENTS,
    PRESLIDING,
    Floats,
    FrictionArrays,
    FrictionLaw,
    History,
    Integers,
    Singles,
    TendonLaw,
    machine_code,
    new_friction_arrays,
    run_in_threads,
)
from rollingjoint.errors import InvalidInput
from rollingjoint.mechanism import stack

Array = NDArray[np.float64]
FLAT = Annotated[Singles, "B x entries"]  # observations as kernels fill them
_COUNTS, _STATUS = Annotated[Integers, "B", "m"], Annotated[Integers, "B"]
_READINGS = Annotated[Floats, "B", "columns"]


class TrackingEpisodeBuffer(EpisodeBuffer):
    """Room for B episodes of a tracking task, as many of them in use as the last `begin` was asked for."""

    _BOUND: ClassVar[tuple[str, ...]] = ()  # made by `_bind`, left out of pickles
    _batch: ClassVar[Any]  # the module of the family that solves batches
    _FORCE: ClassVar[slice]  # columns of a load table, of the force in its last row that acts only while episodes run
    course: Any  # what is fixed when an episode begins
    state: Any  # where running episodes are
    _loads: Array  # (B, rows, columns)
    _results: Any
    _solve: Any  # a PinnedRange, or a LaneByLane; without friction
    _rub: Any  # steps with friction: FrictionSteps, or None
    _step: Callable[..., int]  # (observation, first, last) -> lanes whose solve and `_finish` remain to be done
    _finish: Callable[..., object]  # (observation, first, last)
    _finite: Callable[[], bool]

    def __init__(self, task: TrackingTask, capacity: int, goal: bool = False) -> None:
        super().__init__(task, capacity, goal)
        n_joints, m = task.mechanism.n_joints, task.mechanism.n_tendons
        self.mechanisms: tuple[Any, ...] = (task.mechanism,)
        self.designs = np.zeros(capacity, np.int64)
        self._rules: Any = task.rules(goal)
        self._entries = len(self._rules.low)
        self._starts = np.zeros((capacity, n_joints))
        self._kept_rest: tuple[tuple[Any, bytes], tuple[Array, Array, Array]] | None = None
        self._spare: TrackingEpisodeBuffer | None = None
        self._make_room()
        command, low, high = (np.zeros((capacity, m)) for _ in range(3))
        self._laws = TendonLaw(command, self.course.stiffnesses, low, high)
        self._friction = _no_history(capacity, n_joints, m) if task.has_friction else None
        self._bind()

    def advance(self, ended: Rows = NO_ROWS) -> Observation:
        """One step of all lanes with the accepted actions, those that have ended too."""
        return self._advance(self.capacity).reshape(self.capacity, -1)

    def step_alone(self, action: ArrayLike) -> Observation:
        """One step of the only lane, with an action (m,); its fresh observation, (entries,). Raises as `accept`."""
        self._accept("action", action, self._action)
        observation = np.empty(self._entries, np.float32)
        if left := self._step(observation, 0, 1):
            if left == REFUSED:
                raise InvalidInput("action", action, self._allowed(self._action.shape))
            self._complete(observation, 0, 1)
        return observation

    def restart(self, rows: Rows, rngs: Random, fixed: Any = None) -> tuple[dict[str, Any], Observation]:
        """New episodes in these lanes; where others go on, they begin in a buffer beside this one."""
        if len(rows) == self.capacity:
            draws, observations = self.begin(rngs, fixed)
            return self.sampled_info(draws), observations
        if self._spare is None or self._spare.capacity < len(rows):
            self._spare = type(self)(self.task, len(rows), self.goal)
        draws, observations = self._spare.begin(rngs, fixed)
        self.take(rows, self._spare)
        return self._spare.sampled_info(draws), observations

    def begin(self, rngs: Random, fixed: Any = None) -> tuple[Any, Observation]:
        """New episodes in the first lanes, one per generator, with their observations, (len(rngs), entries).

        Tendons are locked at the unloaded start tensions, then the load is applied.
        """
        count, m = len(rngs), self._actions.shape[1]
        draws = self.task.sample(rngs, fixed)
        self._enter(draws)
        angles, poses, lengths = self._rest(draws)
        readings = self.state.readings[:count]
        self.state.angles[:count] = angles
        self.state.poses[:count] = poses
        self.state.actions[:count] = self._actions[:count] = 0.0
        readings[:, STEP] = -1.0
        readings[:, TENSIONS : TENSIONS + m] = draws.start_tensions
        readings[:, TENSIONS + m : TENSIONS + 2 * m] = lengths - draws.start_tensions / draws.stiffnesses
        if self._rub is not None:
            self._begin_histories(draws, angles)
        self._laws.low[:count], self._laws.high[:count] = self.task.config.tension_range
        observation = self._advance(count)
        readings[:, REWARDS] = 0.0
        return draws, observation.reshape(count, -1)

    def read_alone(self) -> Array:
        """The readings of the only lane, (columns,): a copy."""
        return self._row.copy()

    def observe(self) -> Observation:
        """The current observations of all lanes, (B, entries)."""
        observation = np.empty(self.capacity * self._entries, np.float32)
        self._observe(observation)
        return observation.reshape(self.capacity, -1)

    def take(self, rows: Rows, other: TrackingEpisodeBuffer) -> None:
        """Continue the first lanes of another buffer in these rows."""
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

    def sampled_info(self, draws: Any) -> dict[str, Any]:
        """What was drawn for the episodes that just began in the first lanes: fresh arrays (B, ...)."""
        times, count = self.task.config.episode_steps + 1, len(draws)
        rubbing = {} if self._friction is None else {"friction_mu": self._friction.law.tendons[:count, :, MU].copy()}
        names = np.array([mechanism.name for mechanism in draws.mechanisms], dtype=object)
        return {
            "mechanism": names[draws.designs],
            "targets": over_time(self.course.targets[:count, :, : self.task.dimension], times),
            "link": draws.links,
            "forces": over_time(self.course.forces[:count], times),
            "start_tensions": draws.start_tensions,
            "stiffnesses": draws.stiffnesses,
            "actuator_offsets": draws.actuator_offsets,
            **rubbing,
        }

    def _shared_scene(self, trail: Array, lane: int) -> dict[str, Any]:
        """The fields of a TrackingScene."""
        readings, config, d = self.readings[lane], self.task.config, self.task.dimension
        rubbing = self.task.friction_info(self.readings[lane : lane + 1])
        return {
            "gap_tensions": rubbing["gap_tensions"][0] if rubbing else None,
            "mechanism": self.mechanisms[self.designs[lane]],
            "poses": self.state.poses[lane],
            "tensions": readings[TENSIONS : TENSIONS + self._actions.shape[1]],
            "tension_range": config.tension_range,
            "targets": over_time(self.course.targets[lane, :, :d], config.episode_steps + 1),
            "tip": readings[TIP : TIP + d],
            "trail": trail,
            "step": int(readings[STEP]),
        }

    def __getstate__(self) -> dict[str, Any]:
        bound = ("readings", "_finite", "_step", "_solve", "_rub", "_finish", "_action", "_row", *self._BOUND)
        return {name: value for name, value in self.__dict__.items() if name not in bound}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__ |= state
        self._bind()

    def _allowed(self, shape: tuple[int, ...]) -> str:
        if len(shape) == 1:
            return f"{shape[0]} finite numbers in [-1, 1], one per tendon"
        return f"finite numbers in [-1, 1] of shape {shape}"

    @abstractmethod
    def _make_room(self) -> None:
        """Make the arrays of the task: course, state, loads, results."""

    @abstractmethod
    def _enter_loads(self, draws: Any) -> None:
        """Put into the first lanes what loads and a task's own numbers depend on."""

    @abstractmethod
    def _tips(self, count: int) -> Array:
        """What a target specifies, of the solved first lanes' tips, (count, d) [mm]."""

    @abstractmethod
    def _bind_step(self) -> None:
        """The kernels that go around the solve: `_step`, `_finish`."""

    @abstractmethod
    def _observe(self, observation: Observation) -> None:
        """Fill the flat observation anew."""

    def _kept(self) -> tuple[NDArray[Any], ...]:
        """The arrays (B, ...) that steps go on from."""
        rubbing = () if self._friction is None else (*self._friction.law, *self._friction.before)
        return *self.state, *self.course, self._loads, *rubbing

    def _advance(self, count: int) -> Observation:
        """A step of the first lanes; their fresh observations, flat."""
        observation = np.empty(count * self._entries, np.float32)

        def work(first: int, last: int) -> None:
            if self._step(observation, first, last):
                self._complete(observation, first, last)

        run_in_threads(work, count, self.state.angles.shape[1])
        return observation

    def _complete(self, observation: Observation, first: int, last: int) -> None:
        """A step after lanes were left to the solver for all cases, or to steps with friction."""
        (self._rub or self._solve).solve_the_rest(first, last)
        self._finish(observation, first, last)

    def _enter(self, draws: Any) -> None:
        """Put what was drawn into the first lanes."""
        count = len(draws)
        if self.mechanisms != draws.mechanisms or len(self.mechanisms) > 1:
            self._use(draws.mechanisms, draws.designs)
        course = self.course
        self.state.readings[:count, LINK] = draws.links
        course.stiffnesses[:count] = draws.stiffnesses
        course.actuator_offsets[:count] = draws.actuator_offsets
        if draws.noise is not None:
            course.noise[:count] = draws.noise
        if self._friction is not None:
            self._enter_friction(self._friction, draws)
        self._enter_loads(draws)
        targets = self._aims(draws.target_tensions) if draws.targets is None else draws.targets
        self._widen(targets, draws.forces)
        self.course.targets[:count] = targets
        self.course.forces[:count] = draws.forces

    def _enter_friction(self, friction: FrictionArrays, draws: Any) -> None:
        """Put coefficients of friction into the first lanes: the drawn ones in place of the mechanisms'."""
        law, config, count = friction.law, self.task.config.friction, len(draws)
        law.tendons[:count] = of_lanes([each.friction_coefficients for each in draws.mechanisms], draws.designs)
        law.rolling[:count] = of_lanes([each.rolling_coefficients for each in draws.mechanisms], draws.designs)
        if config is not None:
            law.tendons[:count, :, PRESLIDING] = config.presliding
        if draws.friction_mu is not None:
            law.tendons[:count, :, MU] = draws.friction_mu

    def _begin_histories(self, draws: Any, angles: Array) -> None:
        """Histories of the first lanes: at these poses without friction nothing has slipped."""
        count = len(draws)
        self._laws.low[:count], self._starts[:count] = draws.start_tensions, angles
        self._rub.begin(0, count)

    def _aims(self, tensions: Array) -> Array:
        """Targets, (count, K, d) [mm]: tips of the unloaded equilibria under tensions (count, K, m)."""
        aims = np.empty((*tensions.shape[:2], self.course.targets.shape[2]))
        for k in range(tensions.shape[1]):
            self._solve_unloaded(tensions[:, k])
            aims[:, k] = self._tips(len(aims))
        return aims

    def _rest(self, draws: Any) -> tuple[Array, Array, Array]:
        """Joint angles, poses and tendon lengths at the start tensions, without load; one row if all are alike.

        Episodes that begin alike share one solve, which is kept.
        """
        tensions, causes = draws.start_tensions, draws.rest_causes
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
        """Bind the kernels to the arguments that stay the same."""
        self._neutral_angles = np.array([mechanism.neutral_angles for mechanism in self.mechanisms])
        self.readings, self._action, self._row = self.state.readings, self._actions[0], self.state.readings[0]
        self._finite = partial(machine_code(all_finite, Annotated[Floats, "B", "m"]), self._actions)
        batches = self._batches()
        self._solve = self._on_lanes([self._batch.PinnedRange(batch) for batch in batches])
        self._rub = None if self._friction is None else self._bound_friction(self._friction, batches)
        self._bind_step()

    def _batches(self) -> list[Any]:
        """What is solved: one batch, or one per mechanism where their tendons end on different links."""
        arrays = self._laws, self._loads, self._starts, self._results
        try:
            return [self._batch.BatchArrays(stack(self.mechanisms), self.designs, *arrays)]
        except InvalidInput:
            alone = np.zeros_like(self.designs)
            return [self._batch.BatchArrays(each.arrays, alone, *arrays) for each in self.mechanisms]

    def _on_lanes(self, solvers: Sequence[Any]) -> Any:
        """The only solver, or all of them, each for the lanes with its mechanism."""
        return solvers[0] if len(solvers) == 1 else LaneByLane(solvers, self.designs)

    def _bound_friction(self, friction: FrictionArrays, batches: list[Any]) -> FrictionSteps:
        """Steps with friction of these batches."""
        steps, begins = (
            self._on_lanes([partial(work, batch, friction) for batch in batches])
            for work in (self._batch.step_range, self._batch.begin_range)
        )
        crossed = np.array([mechanism.last_links for mechanism in self.mechanisms], np.int64)[self.designs]
        kinds = FrictionArrays, _COUNTS, _STATUS, _READINGS, int, int
        keep = partial(machine_code(keep_history, *kinds), friction, crossed, self._results.status, self.readings)
        return FrictionSteps(steps, keep, begins)


def _no_history(capacity: int, n_joints: int, n_tendons: int) -> FrictionArrays:
    """Friction of so many lanes that has still to be filled."""
    law = FrictionLaw(np.ones((capacity, n_tendons, N_COEFFICIENTS)), np.ones((capacity, 2)))
    states, slips, grips = (np.zeros((capacity, n_joints, n_tendons)) for _ in range(3))
    angles, rolling = (np.zeros((capacity, n_joints)) for _ in range(2))
    return new_friction_arrays(law, History(states, slips, grips, angles, rolling))


class FrictionSteps:
    """In place of PinnedRange where steps have friction: a step that stands becomes the history of the next one."""

    def __init__(self, *works: Callable[[int, int], object]) -> None:
        self._step, self._keep, self.begin = works

    def solve_the_rest(self, first: int, last: int) -> None:
        """The steps of lanes first to last - 1."""
        self._step(first, last)
        self._keep(first, last)


class LaneByLane:
    """In place of PinnedRange where mechanisms cannot be stacked: one solver per mechanism."""

    entry = pins = 0

    def __init__(self, solvers: Sequence[Callable[[int, int], object]], designs: NDArray[np.int64]) -> None:
        self._solvers, self._designs = solvers, designs

    def __call__(self, first: int, last: int) -> None:
        """Solve lanes first to last - 1."""
        for lane in range(first, last):
            self._solvers[self._designs[lane]](lane, lane + 1)

    solve_the_rest = __call__
