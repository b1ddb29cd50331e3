"""Running episodes of a tracking task, whichever mechanism it has."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rj_gym.core.columns import LINK, STEP, TENSIONS, TIP
from rj_gym.core.draws import over_time
from rj_gym.core.episodes import NO_ROWS, Observation, Rows
from rj_gym.core.generators import Random
from rj_gym.core.hardware import MOTOR
from rj_gym.core.kernels import AT_LIMIT, REFUSED
from rj_gym.core.starting_episodes import StartingEpisodes
from rj_gym.core.state import check_whole, checked_array, checked_parts
from rj_gym.core.tangent import FREE_OF_LIMITS, REACH, Tangent
from rollingjoint.chain.stacks import Variations
from rollingjoint.compiled import run_in_threads
from rollingjoint.errors import InvalidInput
from rollingjoint.io.mechanism_file import mechanism_from_dict, mechanism_to_dict
from rollingjoint.load import wrong_links
from rollingjoint.transmission import at_limit

Array = NDArray[np.float64]

_ARRAY, _SINGLE = np.ndarray, np.dtype(np.float32)


class TrackingEpisodeBuffer(StartingEpisodes):
    """Room for B episodes of a tracking task, as many of them in use as the last `begin` was asked for."""

    def advance(self, ended: Rows = NO_ROWS) -> Observation:
        """One step of all lanes with the accepted actions, those that have ended too."""
        return self._advance(self.capacity)

    def step_alone(self, action: ArrayLike) -> tuple[Observation, Array]:
        """One step of the only lane, with an action (m,): its observation and readings, fresh. Raises as `accept`."""
        if type(action) is _ARRAY and action.dtype is _SINGLE and action.shape == self._action_shape:
            self._action[:] = action  # as `_accept` would, in half the time
        else:
            self._accept("action", action, self._action)
        if left := self._step(self._at, 0, 1):
            if left == REFUSED:
                raise InvalidInput("action", action, self._allowed(self._action.shape))
            self._complete(self._at, 0, 1)
        return self._seen.copy(), self._row.copy()

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

    def tangent(self) -> Tangent:
        """The state of all lanes and how it answers the tendons' commands.

        With friction, of steps that would follow: holes that stick go on sticking, the others sliding.
        """
        m, d = self._actions.shape[1], self.task.dimension
        readings, (low, high) = self.readings.copy(), self.task.config.tension_range
        tensions, commands = readings[:, TENSIONS : TENSIONS + m], readings[:, TENSIONS + m : TENSIONS + 2 * m]
        rates = self._rates(d)
        self._laws.low[:], self._laws.high[:] = low, high
        active, nothing = len(self.hardware.motors) > 0, np.zeros_like(tensions)
        return Tangent(
            motors=self.hardware.motors[:, MOTOR].copy() if active else commands,
            commands=commands,
            tensions=tensions,
            tips=readings[:, TIP : TIP + d],
            poses=self._pictured(self.state.poses),
            half_play=self.hardware.half_play.copy() if active else nothing,
            sheath=self.hardware.sheath.copy() if active else nothing,
            held=at_limit(tensions, low, high),
            tip_rates=rates[:, :d],
            pose_rates=rates[:, d + 2 * m :],
            tension_rates=rates[:, d : d + m],
            length_rates=rates[:, d + m : d + 2 * m],
        )

    def _rates(self, d: int) -> Array:
        """Tip, tensions, lengths and poses by d command, (B, d + 2 m + k, m), as Tangent has them; 0 where unknown."""
        held, found = self._held(), []
        usable = np.ones(self.capacity, bool)
        for change in np.vstack([np.zeros(held.shape[1]), REACH * np.eye(held.shape[1])]):
            self._solve_near(held + change)
            results = self._results
            answers = self._tips(self.capacity)[:, :d], results.tensions, results.lengths
            found.append(np.hstack([*answers, self._pictured(results.poses)]))
            usable &= self._results.status <= AT_LIMIT
        rates = np.stack([(changed - found[0]) / REACH for changed in found[1:]], axis=-1)
        return np.where(usable[:, None, None], rates, 0.0)

    def _held(self) -> Array:
        """Commands of all lanes with their offsets, (B, m) [mm]; tendons at a limit are held at it in `_solve_near`."""
        m, laws = self._actions.shape[1], self._laws
        tensions, (low, high) = self.readings[:, TENSIONS : TENSIONS + m], self.task.config.tension_range
        limited = at_limit(tensions, low, high)
        laws.low[:] = np.where(limited, tensions, 0.0)
        laws.high[:] = np.where(limited, tensions, FREE_OF_LIMITS * high)
        held: Array = self.readings[:, TENSIONS + m : TENSIONS + 2 * m] + self.course.actuator_offsets
        return held

    def _solve_near(self, commands: Array) -> None:
        """Solve all lanes under commands (B, m) [mm] from where they are; with friction, the steps there."""
        self._laws.command[:], self._starts[:] = commands, self.state.angles
        run_in_threads(self._rub or self._solve, self.capacity, self.state.angles.shape[1])

    def observe(self) -> Observation:
        """The current observations of all lanes, (B, entries)."""
        observations = self._room(self.capacity)
        self._observe(observations.ctypes.data)
        return observations

    def take(self, rows: Rows, other: TrackingEpisodeBuffer) -> None:
        """Continue the first lanes of another buffer in these rows."""
        count = len(rows)
        self._widen(other.course.targets, other.course.forces)
        for mine, theirs in zip(self._kept().values(), other._kept().values(), strict=True):
            mine[rows] = theirs[:count]
        if self._take_variations(rows, other):
            return
        if self.mechanisms != other.mechanisms or len(self.mechanisms) > 1:
            mechanisms = [self.mechanisms[design] for design in self.designs.tolist()]
            for row, design in zip(rows, other.designs[:count].tolist(), strict=True):
                mechanisms[row] = other.mechanisms[design]
            designs = {mechanism: design for design, mechanism in enumerate(dict.fromkeys(mechanisms))}
            self._use(tuple(designs), np.array([designs[mechanism] for mechanism in mechanisms]))

    def get_state(self) -> dict[str, Any]:
        """Everything that later steps depend on, copied: plain values and arrays."""
        return {
            "mechanisms": self._mechanism_state(),
            "designs": self.designs.copy(),
            "arrays": {name: array.copy() for name, array in self._kept().items()},
        }

    def set_state(self, state: Any) -> None:
        """Continue from a state of `get_state`; raises InvalidInput, and changes nothing, if it does not fit."""
        parts = checked_parts(state, ("mechanisms", "designs", "arrays"))
        mechanisms = self._mechanisms_in(parts["mechanisms"])
        designs = checked_array("designs", parts["designs"], self.designs)
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
        wrong = wrong_links(arrays["loads"], self._LOAD_COLUMNS, links)
        check_whole("links of loads", np.zeros(0) if wrong is None else wrong, 0, links - 1)
        self._widen(**series)
        for name, array in self._kept().items():
            array[:] = arrays[name]
        self._laws.low[:], self._laws.high[:] = self.task.config.tension_range
        if self.mechanisms != mechanisms:
            self._use(mechanisms, designs)
        else:
            self.designs[:] = designs

    def _of_length(self, kept: Array, values: Any) -> Array:
        """Room like a series that is kept, constant or over an episode as `values` are."""
        times = self.task.config.episode_steps + 1
        whole = np.ndim(values) > 1 and np.shape(values)[1] == times
        return np.empty((len(kept), times if whole else 1, *kept.shape[2:]))

    def _mechanism_state(self) -> Any:
        """The mechanisms in plain values: None for the nominal one."""
        mechanisms = self.mechanisms
        if isinstance(mechanisms, Variations):
            return mechanisms.get_state()
        if len(mechanisms) == 1 and mechanisms[0] is self.task.mechanism:
            return None
        return [mechanism_to_dict(mechanism) | {"name": mechanism.name} for mechanism in mechanisms]

    def _mechanisms_in(self, state: Any) -> Any:
        """The mechanisms that `_mechanism_state` has described; raises InvalidInput for others."""
        nominal = self.task.mechanism
        if state is None:
            return (nominal,)
        if isinstance(state, list) and 0 < len(state) <= self.capacity:
            mechanisms = tuple(mechanism_from_dict(content, "state: mechanisms") for content in state)
            sizes = {(type(each), each.n_links, each.n_tendons) for each in mechanisms}
            if sizes == {(type(nominal), nominal.n_links, nominal.n_tendons)}:
                return mechanisms
        return self._varied(state)

    def _varied(self, state: Any) -> Any:
        """The variations of the nominal mechanism that `Variations.get_state` has described; raises InvalidInput."""
        raise InvalidInput("state: mechanisms", state, "mechanisms of the size of this environment's")

    @abstractmethod
    def _pictured(self, poses: Array) -> Array:
        """What `TrackingTask.pictured` names, of these poses of all lanes, (B, k) [mm, 1]."""

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

    def _kept(self) -> dict[str, NDArray[Any]]:
        """The arrays (B, ...) that steps go on from, by name."""
        groups = {"state": self.state, "course": self.course, "hardware": self.hardware}
        if self._friction is not None:
            groups |= {"friction law": self._friction.law, "friction history": self._friction.before}
        kept = {f"{group}.{name}": one for group, arrays in groups.items() for name, one in arrays._asdict().items()}
        return {name: array for name, array in (kept | {"loads": self._loads}).items() if len(array)}

    def _take_variations(self, rows: Rows, other: TrackingEpisodeBuffer) -> bool:
        """Continue mechanisms of another buffer where every lane of both has a variation of its own."""
        mine, theirs = self.mechanisms, other.mechanisms
        if not isinstance(mine, Variations) or not isinstance(theirs, Variations):
            return False
        each = np.arange(self.capacity)
        return bool((self.designs == each).all()) and mine.take(rows, theirs, other.designs[: len(rows)])

    def _allowed(self, shape: tuple[int, ...]) -> str:
        if len(shape) == 1:
            return f"{shape[0]} finite numbers in [-1, 1], one per tendon"
        return f"finite numbers in [-1, 1] of shape {shape}"
