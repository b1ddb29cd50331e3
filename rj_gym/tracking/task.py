"""The base of the tracking tasks: bring the tip of a mechanism to a target by moving its tendons."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from operator import itemgetter
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rj_gym.core.columns import (
    EFFORT,
    ERROR,
    FAILURE,
    FORCE,
    LINK,
    SMOOTHNESS,
    STATUS,
    STICKING,
    TARGET,
    TENSIONS,
    TIP,
    TRACKING,
    WORK,
)
from rj_gym.core.generators import Random, Shapes, UniformBlock, Uniforms, blocks_of
from rj_gym.core.info import STATUS_NAMES, only_lane
from rj_gym.core.task import POSITION_BOUND, Entry, ObservedError, Task
from rj_gym.tracking import observation
from rj_gym.tracking.arrays import Rules
from rj_gym.tracking.config import TaskConfig
from rj_gym.tracking.draws import KeptRows, TrackingDraws, friction_shapes, hold, homed, target_shape
from rj_gym.tracking.hardware import hardware_rules, hardware_shapes
from rj_gym.tracking.kernels import friction_columns
from rj_gym.tracking.options import NOTHING_FIXED, TrackingOptions, checked_options
from rj_gym.tracking.terms import AppliedTerms
from rollingjoint.checks import as_floats
from rollingjoint.compiled import CONSTANT, MU
from rollingjoint.errors import InvalidInput
from rollingjoint.io.mechanism_file import load_mechanism

Array = NDArray[np.float64]

_TERMS = {"tracking": TRACKING, "effort": EFFORT, "smoothness": SMOOTHNESS, "failure": FAILURE}
_STATUS_NAMES = STATUS_NAMES.tolist()


class TrackingTask(Task):
    """A tracking task of one configuration, as environments and controllers see it; no method changes anything.

    Attributes:
        config: its settings. mechanism: before randomisation.
        length: of the mechanism [mm]. neutral_lengths: of its tendons at rest, (m,) [mm].
        dimension: number of coordinates of a position.
        target_numbers: of a target: its position and, with orientation, a rotation matrix row by row.
        has_friction: whether episodes take steps with friction.
    Raises:
        ConfigError, MechanismError: a mechanism that cannot be loaded, or none of this task.
    """

    own_columns: ClassVar[int] = 0  # of readings that only this task has
    LOAD_COLUMNS: ClassVar[tuple[str, ...]]  # of a load table
    mechanism: Any

    def __init__(self, config: TaskConfig) -> None:
        self.config = config
        mechanism = config.mechanism
        self.mechanism = load_mechanism(mechanism, config.MECHANISM) if isinstance(mechanism, str) else mechanism
        self.length = float(self.mechanism.length)
        self.action_size = self.mechanism.n_tendons
        self.neutral_lengths: Array = np.array(self.mechanism.neutral_lengths, dtype=float)
        self._columns = TENSIONS + 2 * self.action_size  # of readings that every tracking task has
        self._plain = self._columns + self.own_columns  # of readings without the truth and friction
        self._places = self._vectors()
        self._parts = itemgetter(*self._places.values())
        self.has_friction = bool(config.has_friction(self.mechanism))
        self.target_numbers = config.target_numbers
        self._goal_size = len(self.goal_bounds())
        self.observes_truth = config.privileged == "observation"
        self._truths = len(self.privileged_entries()) if config.privileged != "off" else 0
        self._own_rewards, self._own_ends = config.terms.columns(self._plain + self._truths)
        self.own_ends = bool(self._own_ends)
        self._blocks = self._uniform_blocks()
        self.kept_rows = KeptRows()

    def entries(self, goal: bool = False) -> list[Entry]:
        """The entries of the observation vector; `goal` leaves out target and errors."""
        return self.own_entries(goal) + self.config.terms.entries

    def own_entries(self, goal: bool = False) -> list[Entry]:
        """The entries of the task itself, without the settings' terms."""
        return observation.observation_entries(self.config, self.mechanism, goal)

    def observed_error(self, goal: bool = False) -> ObservedError:
        """Where the observation vector has the tip error; raises ConfigError where it does not have it."""
        return observation.observed_error(self.config, self.entries(goal))

    def applied_terms(self) -> AppliedTerms | None:
        """The settings' terms at work, None where there are none that take part in a step."""
        terms = self.config.terms
        if not terms.act:
            return None
        return AppliedTerms(terms, self._plain + self._truths, self.dimension, self.action_size)

    def terminated(self, readings: Array) -> NDArray[np.bool_]:
        """Which episodes have terminated, by their status or an end of the settings' terms, (B,)."""
        ended = super().terminated(readings)
        for _, column in self._own_ends:
            ended |= readings[:, column] > 0.5
        return ended

    def privileged_entries(self) -> list[Entry]:
        """The entries of the privileged state, whether or not the settings show it."""
        return observation.privileged_entries(self.config, self.mechanism)

    @property
    @abstractmethod
    def pictured(self) -> list[str]:
        """Names of the observation's entries that pictures fill and `Tangent.poses` has, in its order."""

    @abstractmethod
    def pictured_values(self, poses: Array) -> Array:
        """Values of the entries `pictured`, for poses of lanes, (B, k) [mm, 1]."""

    @abstractmethod
    def tips(self, poses: Array) -> Array:
        """Positions and, with orientation, frames of the tips of poses of lanes, (B, target_numbers) [mm, 1]."""

    def checked_options(self, options: Mapping[str, Any] | None) -> TrackingOptions:
        """Values that the options of a reset fix; raises InvalidInput for options that cannot be used."""
        return checked_options(options, self.config, self.mechanism)

    def sample(self, rngs: Random, fixed: TrackingOptions | None = None) -> TrackingDraws:
        """One episode per generator, with fixed values in place of drawn ones; each draws the same count of numbers."""
        uniforms = Uniforms(self._blocks, rngs)
        draws = self.draws(uniforms, fixed or NOTHING_FIXED)
        draws = draws if fixed is None or fixed is NOTHING_FIXED else hold(draws, fixed)
        return homed(self.config, draws) if self.config.start == "measured" else draws

    @abstractmethod
    def draws(self, uniforms: Uniforms, fixed: TrackingOptions) -> TrackingDraws:
        """Episodes from uniform numbers, with the fixed mechanism if there is one."""

    def of_designs(self, mechanisms: Sequence[Any], designs: NDArray[np.int64]) -> dict[str, Any]:
        """The fields of draws that lanes with these designs have from their mechanisms."""
        return {"stiffnesses": self.kept_rows.of(mechanisms, "stiffnesses").take(designs, axis=0)}

    @abstractmethod
    def own_uniforms(self) -> tuple[Shapes, Shapes]:
        """Shapes of the uniform numbers of an episode that loads, and mechanisms, are drawn from."""

    @abstractmethod
    def new_loads(self, lanes: int) -> Array:
        """Load tables of lanes before they begin, (lanes, rows, columns); the force that changes in the last row."""

    @abstractmethod
    def new_results(self, lanes: int) -> Any:
        """Room for equilibria of lanes, as the mechanism's solver fills it."""

    @abstractmethod
    def measured_shapes(self) -> tuple[tuple[int, ...], int]:
        """Shape of the measurement errors of a step, and how many numbers a picture has."""

    @abstractmethod
    def scene(self, trail: Array, readings: Array, shared: dict[str, Any]) -> Any:
        """The scene of a lane's picture; `shared`: the fields of a TrackingScene."""

    @abstractmethod
    def renderer(self) -> Any:
        """A renderer of the scenes."""

    def varied_mechanisms(self, state: Any, lanes: int) -> Any:
        """The variations of the nominal mechanism that `Variations.get_state` has described; raises InvalidInput."""
        raise InvalidInput("state: mechanisms", state, "mechanisms of the size of this environment's")

    def own_sampled(self, draws: Any, targets: Array) -> dict[str, Any]:
        """Entries of info["sampled"] of this task alone, fresh arrays (B, ...); targets: (B, 1 or T + 1, numbers)."""
        return {}

    def begin_readings(self, readings: Array, draws: Any) -> None:
        """Fill the columns of readings (B, columns) that stay the same in an episode."""
        readings[:, LINK] = draws.links

    def privileged_bounds(self) -> tuple[Array, Array]:
        """Lowest and highest value of every privileged entry, (K,) each."""
        entries = self.privileged_entries()
        return np.array([entry.low for entry in entries]), np.array([entry.high for entry in entries])

    def privileged(self, readings: Array) -> NDArray[np.float32]:
        """The privileged state, (..., K), from readings (..., columns)."""
        return readings[..., self._plain : self._plain + self._truths].astype(np.float32)

    @abstractmethod
    def load_tables(self, episodes: Any, step: int) -> Array:
        """The true loads of E episodes at a step, tables (E, rows, columns)."""

    @abstractmethod
    def base_load_tables(self, episodes: Any) -> Array:
        """Loads of the unloaded states, in which episodes begin and targets are found, tables (E, rows, columns)."""

    def goals(self, positions: Array) -> NDArray[np.float32]:
        """Positions (..., d) [mm] in units of the length, within the bounds of the goal spaces."""
        return np.clip(positions / self.length, -POSITION_BOUND, POSITION_BOUND).astype(np.float32)

    def goal_bounds(self) -> Array:
        """Largest size of every entry of a goal."""
        return np.full(self.dimension, POSITION_BOUND)

    def achieved_goals(self, readings: Array) -> NDArray[np.float32]:
        """Where tips are, from readings (..., columns)."""
        return self.goals(readings[..., TIP : TIP + self.dimension])

    def desired_goals(self, readings: Array) -> NDArray[np.float32]:
        """Where they should be."""
        return self.goals(readings[..., TARGET : TARGET + self.dimension])

    def checked_goals(self, achieved: ArrayLike, desired: ArrayLike) -> tuple[Array, Array]:
        """Goals (..., d) as floats; InvalidInput unless they are finite numbers of shapes that fit each other."""
        d = self._goal_size
        allowed = f"finite numbers of shape ({d},), or (..., {d}) in batches of one size"
        goals = as_floats("achieved_goal", achieved, allowed), as_floats("desired_goal", desired, allowed)
        for what, goal in zip(("achieved_goal", "desired_goal"), goals, strict=True):
            if goal.shape[-1:] != (d,) or not math.isfinite(np.vdot(goal, goal)):
                raise InvalidInput(what, goal.tolist(), allowed)
        if goals[0].shape != goals[1].shape and not _broadcast(*goals):
            raise InvalidInput("shapes of achieved_goal and desired_goal", (goals[0].shape, goals[1].shape), allowed)
        return goals

    def goal_reward(self, achieved: ArrayLike, desired: ArrayLike) -> Array:
        """Reward of the Goal environment for goals (..., d), (...)."""
        reward = self.config.reward
        difference = np.asarray(achieved, dtype=float) - np.asarray(desired, dtype=float)
        error = self.length * np.linalg.norm(difference, axis=-1)
        if reward.goal == "sparse":
            return -(error > reward.goal_tolerance_mm).astype(float)
        return -error / reward.error_scale_mm

    def reached(self, readings: Array) -> Any:
        """Whether the target is reached within the tolerance, from readings (..., columns)."""
        return readings[..., ERROR] <= self.config.reward.goal_tolerance_mm

    def reward_info(self, readings: Array) -> dict[str, Array]:
        """The terms of the reward, (B,) each: parts of the readings."""
        terms = {name: readings[:, column] for name, column in self._own_rewards}
        return {name: readings[:, column] for name, column in _TERMS.items()} | terms

    def state_info(self, readings: Array) -> dict[str, Any]:
        """Entries of info in every step, arrays (B, ...): parts of the readings, and copies."""
        vectors = {name: readings[:, place] for name, place in self._places.items()}
        base = {
            "error_mm": readings[:, ERROR],
            "status": STATUS_NAMES[readings[:, STATUS].astype(np.intp)],
            "tip": vectors["tip"],
            "target": vectors["target"],
            "load": {"link": readings[:, LINK].astype(np.int64), "force": vectors["force"]},
            "tensions": vectors["tensions"],
            "command": vectors["command"],
        }
        return base | self.truth_info(readings) | self.friction_info(readings) | self.ends_info(readings)

    def single_info(self, readings: Array, numbers: list[float]) -> dict[str, Any]:
        """state_info and reward_info of one lane: Python numbers, `numbers`, and parts of its readings (columns,)."""
        tip, target, force, tensions, command = self._parts(readings)  # faster than one subscript each
        info = {
            "error_mm": numbers[ERROR],
            "status": _STATUS_NAMES[int(numbers[STATUS])],
            "tip": tip,
            "target": target,
            "load": {"link": int(numbers[LINK]), "force": force},
            "tensions": tensions,
            "command": command,
            "reward_terms": {
                "tracking": numbers[TRACKING],
                "effort": numbers[EFFORT],
                "smoothness": numbers[SMOOTHNESS],
                "failure": numbers[FAILURE],
            },
        }
        if len(numbers) == self._plain:
            return info
        row = readings[None]
        info["reward_terms"] |= {name: numbers[column] for name, column in self._own_rewards}
        if self.config.terms.ends:
            info["ends"] = only_lane(self.ends_info(row)["ends"])
        return info | only_lane(self.truth_info(row) | self.friction_info(row))

    def ends_info(self, readings: Array) -> dict[str, Any]:
        """The info of the ends of the settings' terms, arrays (B,): empty where there are none."""
        ends = {name: readings[:, column] > 0.5 for name, column in self._own_ends}
        return {"ends": ends} if ends else {}

    @property
    def friction_acts(self) -> bool:
        """Whether poses of some episode depend on the way to them."""
        drawn, (arm, _) = self.config.friction, self.mechanism.rolling_coefficients
        coefficients = self.mechanism.friction_coefficients
        highest = coefficients[:, MU].max() if drawn is None else drawn.mu[1]
        return bool(highest > 0.0 or arm > 0.0 or np.any(coefficients[:, CONSTANT] > 0.0))

    @property
    def columns(self) -> int:
        """How many columns readings have."""
        return self._plain + self._truths + self.config.terms.width + self.friction_columns

    @property
    def friction_columns(self) -> int:
        """Number of columns of readings about friction."""
        return friction_columns(self.mechanism.n_joints, self.action_size) if self.has_friction else 0

    def truth_info(self, readings: Array) -> dict[str, Any]:
        """The privileged state for info, arrays (B, ...); empty where the settings do not ask for it."""
        return {"privileged": self.privileged(readings)} if self.config.privileged == "info" else {}

    def friction_info(self, readings: Array) -> dict[str, Any]:
        """Entries of info about friction, arrays (B, ...); empty without friction."""
        if not self.has_friction:
            return {}
        n_joints, m = self.mechanism.n_joints, self.action_size
        columns = readings[:, readings.shape[1] - self.friction_columns :]
        shape, middle = (len(columns), n_joints, m), STICKING + n_joints * m
        return {
            "sticking": columns[:, STICKING:middle].reshape(shape) > 0.5,
            "gap_tensions": columns[:, middle:].reshape(shape),
            "dissipated_work": columns[:, WORK],
        }

    def rules(self, goal: bool = False) -> Rules:
        """The parameters that all lanes share, as the kernels take them."""
        config, reward = self.config, self.config.reward
        entries = self.own_entries(goal)
        low, high = (np.array([getattr(entry, side) for entry in entries]) for side in ("low", "high"))
        return Rules(
            dimension=self.dimension,
            slips=self.mechanism.slips,
            action_scale=config.action_scale_mm,
            length=self.length,
            command_scale=config.command_scale_mm,
            error_scale=reward.error_scale_mm,
            angle_scale=getattr(reward, "angle_scale_rad", 1.0),
            highest_tension=config.tension_range[1],
            force_scale=observation.load_scale(config),
            effort=reward.effort,
            smoothness=reward.smoothness,
            failure_penalty=reward.failure_penalty,
            precision=reward.precision,
            orientation=config.orientation,
            observe_tensions=config.observe_tensions,
            observe_target=not goal,
            observe_load=config.observe_load,
            neutral_lengths=self.neutral_lengths,
            low=low.astype(np.float32),
            high=high.astype(np.float32),
            first_seen=observation.first_seen(config, self.mechanism),
            force_column=self.LOAD_COLUMNS.index("fx"),
            hardware=hardware_rules(config, self.mechanism, self.privileged_bounds(), self._plain),
        )

    def _vectors(self) -> dict[str, slice]:
        """Where vectors are in the readings."""
        middle, end = TENSIONS + self.action_size, TENSIONS + 2 * self.action_size
        places = {"tip": TIP, "target": TARGET, "force": FORCE}
        vectors = {name: slice(first, first + self.dimension) for name, first in places.items()}
        return vectors | {"tensions": slice(TENSIONS, middle), "command": slice(middle, end)}

    def _uniform_blocks(self) -> dict[str, UniformBlock]:
        """The uniform numbers of an episode, in the order in which they are drawn."""
        config, m, (loads, mechanisms) = self.config, self.action_size, self.own_uniforms()
        errors = self.measured_shapes()[0]
        shapes: Shapes = {"target": target_shape(config, m), **loads}
        shapes |= {"start": (m,), "stiffness": (m,), "actuator": (m,), **mechanisms}
        if config.randomization.sensor_noise:
            shapes["noise"] = (config.episode_steps + 1, *errors, 2)
        shapes |= friction_shapes(config, m) | hardware_shapes(config, m, errors[-1])
        return blocks_of(shapes | config.terms.uniforms)


def _broadcast(first: Array, second: Array) -> bool:
    """Whether arrays of these shapes fit each other."""
    try:
        np.broadcast_shapes(first.shape, second.shape)
    except ValueError:
        return False
    return True
