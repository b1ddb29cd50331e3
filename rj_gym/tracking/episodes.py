"""Running episodes of a tracking task: how they begin, go on, are saved and drawn."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rj_gym.core.arguments import check_whole, checked_array, checked_parts
from rj_gym.core.columns import LINK, REWARDS, STEP, TENSIONS, TIP
from rj_gym.core.episodes import NO_ROWS, EpisodeBuffer, Observation, Rows
from rj_gym.core.generators import Random
from rj_gym.tracking.arrays import Course, RunningEpisodes, StepInputs, StepResults, TaskArrays
from rj_gym.tracking.draws import over_time
from rj_gym.tracking.hardware import enter_hardware, new_hardware
from rj_gym.tracking.kernels import REFUSED, StepKernels, all_finite
from rj_gym.tracking.solver import LaneSolver, distinct
from rj_gym.tracking.tangent import Tangent, tangent_of
from rj_gym.tracking.task import TrackingTask
from rollingjoint.chain.stacks import Variations
from rollingjoint.chain.status import Status
from rollingjoint.compiled import MU, Floats, machine_code, run_in_threads, runs_at_once
from rollingjoint.errors import InvalidInput
from rollingjoint.io.mechanism_file import mechanism_from_dict, mechanism_to_dict
from rollingjoint.load import wrong_links

Array = NDArray[np.float64]

_ARRAY, _SINGLE = np.ndarray, np.dtype(np.float32)


class TrackingEpisodeBuffer(EpisodeBuffer):
    """Room for B episodes of a tracking task, with the number of the last `begin` in use.

    Attributes:
        course: targets, forces and errors of the episodes. state: poses, actions and readings.
        hardware: motors and sensors.
        solver: mechanisms, loads and equilibria of the lanes.
    """

    task: TrackingTask

    def __init__(self, task: TrackingTask, capacity: int, goal: bool = False) -> None:
        super().__init__(task, capacity, goal)
        self._rules = task.rules(goal)
        self._entries, self._action_shape = len(self._rules.low), (task.action_size,)
        self._at_once = runs_at_once(task.mechanism.n_joints)
        self._terms = task.applied_terms()
        self._kept_rest: tuple[tuple[Any, bytes], tuple[Array, Array, Array]] | None = None
        self._spare: TrackingEpisodeBuffer | None = None
        readings = np.zeros((capacity, task.columns))
        self.solver = LaneSolver(task, readings)
        self._make_room(readings)
        self._bind()

    def __getstate__(self) -> dict[str, Any]:
        bound = {"readings", "_all_finite", "_kernels", "_action", "_row", "_seen", "_at"}
        return {name: value for name, value in self.__dict__.items() if name not in bound}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__ |= state
        self._bind()

    def advance(self, ended: Rows = NO_ROWS) -> Observation:
        """One step of all lanes with the accepted actions, those that have ended too."""
        return self.advance_first(self.capacity)

    def step_alone(self, action: ArrayLike) -> tuple[Observation, Array]:
        """One step of the only lane, with an action (m,): its observation and readings, fresh. Raises as `accept`."""
        if type(action) is _ARRAY and action.dtype is _SINGLE and action.shape == self._action_shape:
            self._action[:] = action  # as `_accept` would, in half the time
        else:
            self._accept("action", action, self._action)
        if remainder := self._kernels.step(self._at, 0, 1):
            if remainder == REFUSED:
                raise InvalidInput("action", action, self._allowed(self._action.shape))
            self.complete(self._at, 0, 1)
        if self._terms is not None:
            (observation,) = self._terms.apply(self._seen[None])
            return observation.copy(), self._row.copy()
        return self._seen.copy(), self._row.copy()

    def observe(self) -> Observation:
        """The current observations of all lanes, (B, entries)."""
        observations = self._room(self.capacity)
        self._kernels.observe(observations)
        return observations if self._terms is None else self._terms.observed(observations)

    def tangent(self, count: int | None = None) -> Tangent:
        """The state of the first lanes, or all, and how it answers the tendons' commands."""
        offsets = self.course.actuator_offsets[:count]
        return tangent_of(self.task, self.solver, self.state, self.hardware, offsets)

    def accept_first(self, actions: Array) -> None:
        """Keep actions of the first lanes, (count, m), that were checked."""
        self._actions[: len(actions)] = actions

    @property
    def pins(self) -> int:
        """Address of the pins of TaskArrays, for the kernel `step`, until lanes have other mechanisms."""
        return self._kernels.pins

    def advance_first(self, count: int) -> Observation:
        """A step of the first lanes with the accepted actions; their fresh observations, (count, entries)."""
        observations = self._stepped(count)
        return observations if self._terms is None else self._terms.apply(observations)

    def _stepped(self, count: int) -> Observation:
        """`advance_first` without the settings' terms."""
        if count == 1 and self._at_once:
            if self._kernels.step(self._at, 0, 1):
                self.complete(self._at, 0, 1)
            return self._seen[None].copy()
        observations = self._room(count)
        self.step_into(observations.ctypes.data, count)
        return observations

    def step_into(self, address: int, count: int) -> None:
        """A step of the first lanes with the accepted actions; their observations, without terms, to an address."""

        def work(first: int, last: int) -> None:
            if self._kernels.step(address, first, last):
                self.complete(address, first, last)

        run_in_threads(work, count, self.state.angles.shape[1])

    def complete(self, address: int, first: int, last: int) -> None:
        """A step after lanes were left to the general solver, or to steps with friction."""
        self.solver.solve_the_rest(first, last, self._kernels.revise if self._rules.hardware.limits_pulls else None)
        self._kernels.finish(address, first, last)

    def restart(self, rows: Rows, rngs: Random, fixed: Any = None) -> tuple[dict[str, Any], Observation]:
        """New episodes in these lanes; where others go on, they begin in a second buffer."""
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

        Tendons are locked at the unloaded start tensions, then the load is applied in a step with the action 0, which
        is step 0. Offsets of motors come in when they are locked, or, where the start is measured, before.
        """
        count, m = len(rngs), self.task.action_size
        draws = self.task.sample(rngs, fixed)
        self._enter(draws)
        angles, poses, lengths = self._rest(draws)
        readings, state = self.state.readings[:count], self.state
        state.angles[:count], state.poses[:count] = angles, poses
        state.actions[:count] = self._actions[:count] = 0.0
        state.responses[:count], state.tip_rates[:count] = 0.0, 0.0
        commands = readings[:, TENSIONS + m : TENSIONS + 2 * m]
        readings[:, STEP] = -1.0
        readings[:, TENSIONS : TENSIONS + m] = draws.start_tensions
        commands[:] = lengths - draws.start_tensions / draws.stiffnesses
        if self.task.config.start == "measured":
            commands -= draws.actuator_offsets
        if draws.hardware is not None:
            enter_hardware(self.hardware, draws.hardware, commands, self._rules.hardware.limits_pulls)
        if self.solver.friction is not None:
            self.solver.begin_histories(draws, angles)
            if draws.hardware is not None:
                self.hardware.friction[:count] = self.solver.friction.law.tendons[:count, :, MU]
        self.solver.laws.low[:count], self.solver.laws.high[:count] = self.task.config.tension_range
        if self._terms is not None:
            self._terms.begin(count)
        observations = self.advance_first(count)
        readings[:, REWARDS] = 0.0
        if self._terms is not None:
            self._terms.forget(count)
        return draws, observations

    def sampled_info(self, draws: Any) -> dict[str, Any]:
        """info["sampled"] of the episodes that just began in the first lanes: fresh arrays (B, ...)."""
        times, count, friction = self.task.config.episode_steps + 1, len(draws), self.solver.friction
        names = [mechanism.name for mechanism in distinct(draws.mechanisms)]
        mechanisms = names * count if len(names) == 1 else [names[design] for design in draws.designs]
        return {
            "mechanism": np.array(mechanisms, dtype=object),
            "targets": over_time(self.course.targets[:count, :, : self.task.dimension], times),
            "link": draws.links,
            "forces": over_time(self.course.forces[:count], times),
            "start_tensions": draws.start_tensions,
            "stiffnesses": draws.stiffnesses,
            "actuator_offsets": draws.actuator_offsets,
            **({} if friction is None else {"friction_mu": friction.law.tendons[:count, :, MU].copy()}),
            **({} if draws.hardware is None else draws.hardware.sampled_info()),
            **self.task.own_sampled(draws, self.course.targets[:count]),
        }

    def _enter(self, draws: Any) -> None:
        """Put random numbers into the first lanes."""
        count, solver, course = len(draws), self.solver, self.course
        if solver.mechanisms != draws.mechanisms or len(solver.mechanisms) > 1:
            self._use(draws.mechanisms, draws.designs)
        course.stiffnesses[:count] = draws.stiffnesses
        course.actuator_offsets[:count] = draws.actuator_offsets
        if draws.noise is not None:
            course.noise[:count] = draws.noise
        if solver.friction is not None:
            solver.enter_friction(draws, self.task.config.friction)
        self.task.begin_readings(self.state.readings[:count], draws)
        solver.loads[:count] = self.task.load_tables(draws, 0)
        targets = self._aims(draws) if draws.targets is None else draws.targets
        self._widen(targets, draws.forces)
        self.course.targets[:count] = targets
        self.course.forces[:count] = draws.forces

    def _aims(self, draws: Any) -> Array:
        """Targets, (count, K, numbers) [mm]: tips of equilibria under the target tensions.

        They are loaded as the episode ends, if the settings want it; where that takes a joint to the end of its
        surfaces, or no such equilibrium is found, unloaded.
        """
        count, waypoints, _ = draws.target_tensions.shape
        aims = np.empty((count, waypoints, self.task.target_numbers))
        for k in range(waypoints):
            tensions = draws.target_tensions[:, k]
            if not self.task.config.target.loaded:
                aims[:, k] = self._tips_at(tensions)[0]
                continue
            aims[:, k], status = self._tips_at(tensions, draws.forces[:, -1])
            unloaded = status != int(Status.CONVERGED)
            if unloaded.any():
                aims[unloaded, k] = self._tips_at(tensions)[0][unloaded]
        return aims

    def _tips_at(self, tensions: Array, forces: Array | float = 0.0) -> tuple[Array, NDArray[np.int64]]:
        """Tips of the first lanes under tensions and forces, as targets specify them, and statuses."""
        self.solver.solve_at(tensions, forces)
        results, count = self.solver.results, len(tensions)
        return self.task.tips(results.poses[:count]), results.status[:count]

    def _rest(self, draws: Any) -> tuple[Array, Array, Array]:
        """Joint angles, poses and tendon lengths at the start tensions, without load; one row if all are alike.

        Episodes that begin alike share one solve, which is kept.
        """
        tensions, causes, mechanisms = draws.start_tensions, draws.rest_causes, self.solver.mechanisms
        alike = len(mechanisms) == 1 and (len(causes) == 1 or bool((causes == causes[0]).all()))
        key = (mechanisms[0], causes[0].tobytes())
        if alike and self._kept_rest is not None and self._kept_rest[0] == key:
            return self._kept_rest[1]
        rows = 1 if alike else len(tensions)
        self.solver.solve_at(tensions[:rows])
        results = self.solver.results
        pose = results.joint_angles[:rows].copy(), results.poses[:rows].copy(), results.lengths[:rows].copy()
        if alike:
            self._kept_rest = key, pose
        return pose

    def take(self, rows: Rows, source: TrackingEpisodeBuffer) -> None:
        """Continue the first lanes of another buffer in these rows."""
        count, solver, theirs = len(rows), self.solver, source.solver
        self._widen(source.course.targets, source.course.forces)
        for array, taken in zip(self._kept().values(), source._kept().values(), strict=True):
            array[rows] = taken[:count]
        solver.laws.low[rows], solver.laws.high[rows] = self.task.config.tension_range
        if self._take_variations(rows, source):
            return
        known = len(solver.mechanisms)
        if known == 1 and solver.mechanisms == theirs.mechanisms:
            return
        if isinstance(theirs.mechanisms, tuple) and theirs.mechanisms[:known] == solver.mechanisms:
            designs = solver.designs.copy()
            designs[rows] = theirs.designs[:count]
            self._use(theirs.mechanisms, designs)
        else:
            mechanisms = [solver.mechanisms[design] for design in solver.designs.tolist()]
            for row, design in zip(rows, theirs.designs[:count].tolist(), strict=True):
                mechanisms[row] = theirs.mechanisms[design]
            places = {mechanism: design for design, mechanism in enumerate(dict.fromkeys(mechanisms))}
            self._use(tuple(places), np.array([places[mechanism] for mechanism in mechanisms]))

    def keep(self, rows: Rows) -> None:
        """Have the first lanes go on where these are, in ascending order, and the others wait for their next start."""
        if len(rows):
            for array in self._kept().values():
                array[: len(rows)] = array[rows]
            self._use(self.solver.mechanisms, self.solver.designs[rows])
        self.readings[len(rows) :, STEP] = 0.0

    def _take_variations(self, rows: Rows, source: TrackingEpisodeBuffer) -> bool:
        """Continue mechanisms of another buffer where every lane of both has its own variation."""
        variations, theirs = self.solver.mechanisms, source.solver.mechanisms
        if not isinstance(variations, Variations) or not isinstance(theirs, Variations):
            return False
        lanes, designs = np.arange(self.capacity), source.solver.designs[: len(rows)]
        return bool((self.solver.designs == lanes).all()) and variations.take(rows, theirs, designs)

    def get_state(self) -> dict[str, Any]:
        """Everything that later steps depend on, copied: plain values and arrays."""
        mechanisms, designs = self._mechanism_state()
        return {
            "mechanisms": mechanisms,
            "designs": designs,
            "arrays": {name: array.copy() for name, array in self._kept().items()},
        }

    def set_state(self, state: Any) -> None:
        """Continue from a state of `get_state`; raises InvalidInput, and keeps its state, if it does not fit."""
        parts = checked_parts(state, ("mechanisms", "designs", "arrays"))
        mechanisms = self._mechanisms_in(parts["mechanisms"])
        designs = checked_array("designs", parts["designs"], self.solver.designs)
        check_whole("designs", designs, 0, len(mechanisms) - 1)
        arrays = checked_parts(parts["arrays"], tuple(self._kept()), "state: arrays")
        series = {name: arrays[f"course.{name}"] for name in ("targets", "forces")}
        for name, values in series.items():
            checked_array(name, values, self._of_length(getattr(self.course, name), values))
        for name, array in self._kept().items():
            if name.removeprefix("course.") not in series:
                checked_array(name, arrays[name], array)
        readings, links = arrays["state.readings"], self.task.mechanism.n_links
        check_whole("steps", readings[:, STEP], -1, self.task.config.episode_steps)
        check_whole("links", readings[:, LINK], 0, links - 1)
        wrong = wrong_links(arrays["loads"], self.task.LOAD_COLUMNS, links)
        check_whole("links of loads", np.zeros(0) if wrong is None else wrong, 0, links - 1)
        self._widen(**series)
        for name, array in self._kept().items():
            array[:] = arrays[name]
        self.solver.laws.low[:], self.solver.laws.high[:] = self.task.config.tension_range
        if self.solver.mechanisms != mechanisms:
            self._use(mechanisms, designs)
        else:
            self.solver.designs[:] = designs

    def _kept(self) -> dict[str, NDArray[Any]]:
        """The arrays (B, ...) that steps go on from, by name."""
        groups: dict[str, Any] = {"state": self.state, "course": self.course, "hardware": self.hardware}
        if (friction := self.solver.friction) is not None:
            groups |= {"friction law": friction.law, "friction history": friction.before}
        series = {
            f"{group}.{name}": array for group, arrays in groups.items() for name, array in arrays._asdict().items()
        }
        return {name: array for name, array in (series | {"loads": self.solver.loads}).items() if len(array)}

    def _of_length(self, stored: Array, values: Any) -> Array:
        """Room like a stored series, constant or over an episode as `values` are."""
        times = self.task.config.episode_steps + 1
        is_series = np.ndim(values) > 1 and np.shape(values)[1] == times
        return np.empty((len(stored), times if is_series else 1, *stored.shape[2:]))

    def _mechanism_state(self) -> tuple[Any, NDArray[np.int64]]:
        """The mechanisms that lanes have in plain values, None for the nominal one, and which of them each has."""
        mechanisms, designs = self.solver.mechanisms, self.solver.designs.copy()
        if isinstance(mechanisms, Variations):
            return mechanisms.get_state(), designs
        if len(mechanisms) == 1 and mechanisms[0] is self.task.mechanism:
            return None, designs
        used, designs = np.unique(designs, return_inverse=True)  # of those known, which may be more than lanes
        own = [mechanisms[design] for design in used.tolist()]
        return [mechanism_to_dict(mechanism) | {"name": mechanism.name} for mechanism in own], designs

    def _mechanisms_in(self, state: Any) -> Any:
        """The mechanisms that `_mechanism_state` has described; raises InvalidInput for others."""
        nominal = self.task.mechanism
        if state is None:
            return (nominal,)
        if isinstance(state, list) and 0 < len(state) <= self.capacity:
            mechanisms = tuple(mechanism_from_dict(content, "state: mechanisms") for content in state)
            sizes = {(type(mechanism), mechanism.n_links, mechanism.n_tendons) for mechanism in mechanisms}
            if sizes == {(type(nominal), nominal.n_links, nominal.n_tendons)}:
                return mechanisms
        return self.task.varied_mechanisms(state, self.capacity)

    def scene(self, trail: Array, lane: int = 0) -> Any:
        """The scene of one lane's picture; trail (steps, d) [mm] is where its tip has been."""
        readings, task, m = self.readings[lane], self.task, self.task.action_size
        rubbing = task.friction_info(self.readings[lane : lane + 1])
        shared = {
            "gap_tensions": rubbing["gap_tensions"][0] if rubbing else None,
            "mechanism": self.solver.mechanisms[self.solver.designs[lane]],
            "poses": self.state.poses[lane],
            "tensions": readings[TENSIONS : TENSIONS + m],
            "tension_range": task.config.tension_range,
            "targets": over_time(self.course.targets[lane, :, : task.dimension], task.config.episode_steps + 1),
            "tip": readings[TIP : TIP + task.dimension],
            "step": int(readings[STEP]),
        }
        return task.scene(trail, readings, shared)

    def renderer(self) -> Any:
        """A renderer of the scenes."""
        return self.task.renderer()

    def _make_room(self, readings: Array) -> None:
        """Make the arrays of all lanes: course, state, hardware."""
        task, solver, config = self.task, self.solver, self.task.config
        capacity, m, times = self.capacity, task.action_size, config.episode_steps + 1
        errors, picture = task.measured_shapes()
        noisy = times if config.randomization.sensor_noise else int(config.sensing.biased)
        self.course = Course(
            targets=np.zeros((capacity, times if config.target.process == "path" else 1, task.target_numbers)),
            forces=np.zeros((capacity, 1 if config.load.process == "constant" else times, task.dimension)),
            stiffnesses=solver.laws.stiffness,
            actuator_offsets=np.zeros((capacity, m)),
            noise=np.zeros((capacity, noisy, *errors)),
        )
        responses, contacts = _asked_for(solver.results)
        self.state = RunningEpisodes(
            angles=np.zeros_like(solver.results.joint_angles),
            responses=np.zeros_like(responses),
            poses=np.zeros_like(solver.results.poses),
            actions=np.zeros((capacity, 2, m)),
            readings=readings,
            tip_rates=np.zeros((len(contacts), 2, m)),
        )
        self.hardware = new_hardware(config, capacity, m, picture, task.dimension)

    def _use(self, mechanisms: Any, designs: NDArray[np.int64]) -> None:
        """Have the first lanes use these mechanisms."""
        if self.solver.use(mechanisms, designs):
            self._bind()

    def _widen(self, targets: Array, forces: Array) -> None:
        """Make room for series over time where constants were enough so far."""
        for name, series in (("targets", targets), ("forces", forces)):
            stored, times = getattr(self.course, name), series.shape[1]
            if times > stored.shape[1]:
                self.course = self.course._replace(**{name: np.repeat(stored, times, axis=1)})
                self._bind()

    def _bind(self) -> None:
        """Bind the kernels to the arrays."""
        solver, state, results = self.solver, self.state, self.solver.results
        if self._terms is not None:
            self._terms.bind(state)
        self.readings, self._action, self._row = state.readings, self._actions[0], state.readings[0]
        self._all_finite = machine_code(all_finite, Annotated[Floats, "B", "m"])
        n_links, noise = self.task.mechanism.n_links, self.course.noise
        *links, numbers = self.task.measured_shapes()[0]
        course = self.course._replace(noise=noise.reshape(*noise.shape[:2], *(links or [1]), numbers))
        responses, contacts = _asked_for(results)
        solved = StepResults(
            results.joint_angles,
            results.poses.reshape(self.capacity, n_links, -1),
            results.tensions,
            results.lengths,
            responses,
            contacts,
            results.status,
        )
        flat = state._replace(poses=state.poses.reshape(self.capacity, n_links, -1))  # a view
        inputs = StepInputs(self._actions, solver.starts, solver.laws.command, solver.laws.high, solver.loads)
        self._kernels = StepKernels(TaskArrays(self._rules, course, flat, self.hardware, inputs, solved, *solver.entry))
        self._seen = self._room(1)[0]
        self._at: int = self._seen.ctypes.data

    def _room(self, count: int) -> Observation:
        """Room for the observations of this number of lanes."""
        return np.empty((count, self._entries), np.float32)

    def _finite(self) -> bool:
        return bool(self._all_finite(self._actions))

    def _allowed(self, shape: tuple[int, ...]) -> str:
        if len(shape) == 1:
            return f"{shape[0]} finite numbers in [-1, 1], one per tendon"
        return f"finite numbers in [-1, 1] of shape {shape}"


def _asked_for(results: Any) -> tuple[Array, Array]:
    """How equilibria answer commands, and contacts, of results that have the former; else none."""
    if hasattr(results, "responses"):
        return results.responses, results.contacts
    n_joints, m = results.joint_angles.shape[1], results.tensions.shape[1]
    return np.zeros((0, n_joints, m)), np.zeros((0, n_joints, 4))
