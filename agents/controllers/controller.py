"""The Controller protocol, readings of observations in mm, rad and N, and the controller without actions."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, wraps
from inspect import signature
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray

from agents.runs.additions import Addition
from agents.runs.consent import imported
from agents.runs.environment import EnvConfig, make_vector_env
from rj_gym.tracking.arrays import AGE
from rj_gym.tracking.task import TrackingTask
from rollingjoint import solve_lengths_batch
from rollingjoint.errors import ConfigError, InvalidInput
from rollingjoint.transmission import elastic_tension

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
AnyEnv = gymnasium.Env[Any, Any] | VectorEnv[Any, Any, Any]
HANGING = (0.0, 0.0, 1.0)  # the nominal direction of gravity, of an arm


class Controller(ABC):
    """Maps observations to actions, for B episodes side by side.

    A subclass has `act`, where it remembers anything `reset`, and where it depends on the task `bind`. An episode must
    not depend on the other ones. Actions are also requested for episodes that have ended, and ignored.

    Attributes:
        privileged: whether it needs the true state, which no robot measures: observations are then dictionaries, with
            the state under "privileged". Tables mark such controllers.
        one_mechanism: whether it computes with the mechanism of its task. Where lanes have different ones, each has a
            copy of it (agents.controllers.own_models); other controllers see the observations of all lanes.
        wrappers: Gymnasium's wrappers, as of a training configuration, through which it acts; others act without.
        task: the tracking task; None where the environment is not one of rj_gym.
    """

    privileged: bool = False
    one_mechanism: bool = True
    wrappers: Sequence[Addition] = ()
    task: Any = None

    def __init_subclass__(cls, **arguments: Any) -> None:
        super().__init_subclass__(**arguments)
        act = cls.__dict__.get("act")
        if act is not None and "seen" in signature(act).parameters:  # as classes of users were written for 0.1.0
            cls.act = _given_readings(act)  # type: ignore

    def bind(self, task: TrackingTask | None) -> None:
        """Take over the task of the environment, before the first reset; raises InvalidInput: of many mechanisms."""
        if self.one_mechanism and hasattr(task, "own_task"):
            hint = "agents.controllers.own_models.OwnModels gives every mechanism a copy of it."
            raise InvalidInput(
                "task", "of many mechanisms", f"of one, for {type(self).__name__} computes with it", hint
            )
        self.task = task

    def reset(self, mask: Mask) -> None:  # noqa: B027 (most controllers have no memory)
        """Begin new episodes where the mask (B,) is true; all of them after `bind`."""

    @abstractmethod
    def act(self, observations: Any) -> NDArray[Any]:
        """The actions, (B, m) in [-1, 1]: the share of action_scale_mm by which each tendon is pulled in.

        Args:
            observations: as the environment gives them: (B, n) float32, or a dictionary of such arrays where it has
                goals or shows the true state.
        """

    def begin(self, task: TrackingTask | AnyEnv | None, episodes: int | None = None) -> None:
        """Bind the task, and begin this many episodes together.

        Args:
            task: or an environment, scalar or vector, whose task it is; None for one that is not of rj_gym.
            episodes: None means one, or one for each copy in a vector environment.
        Raises:
            InvalidInput: no task and no environment.
        """
        self.bind(_task_of(task))
        copies: int = getattr(task, "num_envs", 1)
        self.reset(np.ones(copies if episodes is None else episodes, bool))

    def read(self, observations: Any) -> Reading:
        """The observations in mm, rad and N."""
        return observations if isinstance(observations, Reading) else Reading(observations, self.task)


def _task_of(given: TrackingTask | AnyEnv | None) -> TrackingTask | None:
    """The task that is given, or that of an environment of rj_gym; None for an environment of another package."""
    if isinstance(given, gymnasium.Env | VectorEnv):
        task = getattr(given.unwrapped, "task", None)
        return task if isinstance(task, TrackingTask) else None
    if given is None or isinstance(given, TrackingTask):
        return given
    raise InvalidInput("task", given, "a tracking task, env.unwrapped.task, or the environment itself")


def _given_readings(act: Callable[[Any, Any], NDArray[Any]]) -> Callable[[Any, Any], NDArray[Any]]:
    """The method, with observations read."""

    @wraps(act)
    def read_and_act(self: Controller, observations: Any) -> NDArray[Any]:
        return act(self, self.read(observations))

    return read_and_act


class DoNothing(Controller):
    """Leaves the tendons as they are: the minimum for every other controller to beat."""

    def reset(self, mask: Mask) -> None:
        """Remember how many episodes and tendons there are."""
        self.shape = len(mask), self.task.mechanism.n_tendons

    def act(self, observations: Any) -> Array:
        """No increments, (B, m)."""
        return np.zeros(self.shape)


class FunctionController(Controller):
    """A function as a controller.

    Args:
        function: from observations (B, n), or such a dictionary, to actions (B, m). Where it has a method reset, that
            is called when episodes begin.
    """

    one_mechanism = False

    def __init__(self, function: Callable[[Any], Any]) -> None:
        self.function = function

    def reset(self, mask: Mask) -> None:
        """Let the function begin new episodes, if it has a memory; raises InvalidInput unless all begin."""
        if hasattr(self.function, "reset"):
            _check_all(mask)
            self.function.reset()

    def act(self, observations: Any) -> NDArray[Any]:
        """The values of the function, (B, m)."""
        return np.asarray(self.function(plain(observations)))


class EarlierController(Controller):
    """An object with `begin(task, episodes)` and `act(seen)`, which until 0.1.0 were all of a controller.

    Args:
        controller: the object. Its `act` is given a Reading.
    """

    def __init__(self, controller: Any) -> None:
        self.controller, self.privileged = controller, bool(getattr(controller, "privileged", False))
        if hasattr(controller, "estimates"):
            self.estimates = controller.estimates

    def reset(self, mask: Mask) -> None:
        """Begin all episodes; raises InvalidInput for some of them."""
        _check_all(mask)
        self.controller.begin(self.task, len(mask))

    def act(self, observations: Any) -> NDArray[Any]:
        """Its actions, (B, m)."""
        actions: NDArray[Any] = self.controller.act(self.read(observations))
        return actions


def _check_all(mask: Mask) -> None:
    if not mask.all():
        raise InvalidInput("episodes that begin", int(mask.sum()), f"all {len(mask)}", "It has no reset(mask).")


def as_controller(source: Any) -> Controller:
    """A controller itself, or one made of a function, or an object with begin and act; else raises InvalidInput."""
    if isinstance(source, Controller):
        return source
    if callable(getattr(source, "begin", None)) and callable(getattr(source, "act", None)):
        return EarlierController(source)
    if callable(source):
        return FunctionController(source)
    raise InvalidInput("controller", source, "a Controller, or a function from observations to actions")


def load_controller(text: str) -> Controller:
    """The controller that "FILE.py:NAME" or "MODULE:NAME" stands for; this runs the code there.

    NAME is a controller, or a class or function that makes without arguments a controller or a function from
    observations to actions.

    Raises:
        ConfigError: code that cannot be imported, or that makes something else.
    """
    module, _, name = text.rpartition(":")
    allowed = "FILE.py:NAME or MODULE:NAME, of a controller or of what makes one without arguments"
    try:
        attribute = getattr(imported(module), name)
        controller = attribute if hasattr(attribute, "act") and not isinstance(attribute, type) else attribute()
        return as_controller(controller)
    except Exception as error:  # whatever the code there raises
        raise ConfigError("controller", text, allowed, f"{type(error).__name__}: {error}") from error


def env_for(env: EnvConfig, controller: Any) -> EnvConfig:
    """The environment as a controller needs it: a privileged one is also given the true state."""
    if not getattr(controller, "privileged", False):
        return env
    settings: Mapping[str, object] = {**env.settings, "privileged": "observation"}
    return EnvConfig(env.id, env.n_envs, settings)


def envs_for(env: EnvConfig, controller: Controller, count: int, **arguments: Any) -> VectorEnv[Any, Any, Any]:
    """The vector environment in which a controller acts, `count` copies; raises ConfigError as make_vector_env."""
    return make_vector_env(env_for(env, controller), count, controller.wrappers, **arguments)


def plain(observations: Any) -> Any:
    """Observations as the environment gave them, read or not."""
    return observations.observation if isinstance(observations, Reading) else observations


def saturated(actions: NDArray[Any]) -> NDArray[Any]:
    """Actions within [-1, 1]."""
    return np.clip(actions, -1.0, 1.0)


def restarted(values: Array, mask: Mask, start: Array) -> Array:
    """Values (B, ...), replaced by `start` (B, ...) in the rows of the mask (B,)."""
    if mask.all():
        return start
    return np.where(mask.reshape(-1, *[1] * (start.ndim - 1)), start, values)


@dataclass(frozen=True)
class Reading:
    """The observations of B episodes in mm, rad and N; each quantity is read when it is asked for.

    Positions have d coordinates, 2 of a planar chain and 3 of an arm. Only a planar chain shows `poses` of its links.

    Args:
        observation: as the environment gave it: (B, entries) float32, or a dict of such arrays where it has goals or
            shows the privileged state.
        task: the tracking task; without it only the observation can be read.
    """

    observation: Any
    task: TrackingTask | None = None

    @property
    def sees(self) -> str:
        """The measured part of the pose: "all", "tip" or "none"."""
        return self._task.config.sensing.pose

    @property
    def picture_age(self) -> Array:
        """How many steps old the measured pose is, (B,): 0 where poses are never late."""
        ages = self._entries("picture age") if "picture age" in self._places else np.zeros((self._count, 1))
        return AGE * ages[:, 0]

    @property
    def picture_is_new(self) -> NDArray[np.bool_]:
        """Whether the measured pose came in this step, (B,)."""
        new = self._entries("picture new") if "picture new" in self._places else np.ones((self._count, 1))
        return new[:, 0] > 0.5

    @property
    def privileged(self) -> Array:
        """The privileged state, (B, K), of an environment that shows it with its observation, in its units."""
        if not isinstance(self.observation, Mapping) or "privileged" not in self.observation:
            raise InvalidInput("privileged", self._task.config.privileged, "'observation'", "This controller needs it.")
        return np.asarray(self.observation["privileged"], float)

    @property
    def tip(self) -> Array:
        """Measured position of the tip, (B, d) [mm].

        Raises:
            InvalidInput: it is not measured; so do the properties below that need a pose.
        """
        self._need("all", "tip")
        return self._task.length * self._entries(*(f"{self._tip_name} {axis}" for axis in self._axes))

    @property
    def target(self) -> Array:
        """Where the tip should be now, (B, d) [mm]."""
        if self._has_goals:
            return self._task.length * np.asarray(self.observation["desired_goal"], float)[:, : len(self._axes)]
        return self._task.length * self._entries(*(f"target {axis}" for axis in self._axes))

    @property
    def error(self) -> Array:
        """Target minus measured tip, (B, d) [mm]."""
        return self.target - self.tip

    @cached_property
    def poses(self) -> Array:
        """Measured x, y, angle of every link, base first, (B, n, 3) [mm, rad]; joints turn by less than half a turn."""
        self._need("all")
        n = self._task.mechanism.n_links
        entries = [f"link {k} {what}" for k in range(1, n) for what in ("x", "y", "cos angle", "sin angle")]
        x, y, cos, sin = np.moveaxis(self._entries(*entries).reshape(-1, n - 1, 4), -1, 0)
        turns = np.diff(np.arctan2(sin, cos), axis=1, prepend=0.0)
        angles = np.cumsum((turns + np.pi) % (2 * np.pi) - np.pi, axis=1)
        poses = np.zeros((len(x), n, 3))
        poses[:, 1:] = np.stack([self._task.length * x, self._task.length * y, angles], axis=-1)
        return poses

    @property
    def joint_angles(self) -> Array:
        """Measured joint angles, (B, n - 1) [rad]."""
        return np.diff(self.poses[..., 2], axis=1)

    @property
    def commands(self) -> Array:
        """Commanded tendon lengths, (B, m) [mm]: measured motor positions, which differ by play from the tendons'."""
        tendons = range(self._task.mechanism.n_tendons)
        offsets = self._entries(*(f"tendon {j} command" for j in tendons))
        return self._task.neutral_lengths + self._task.config.command_scale_mm * offsets

    @cached_property
    def tensions(self) -> Array:
        """Measured tensions, (B, m) [N]; where they are not observed, the model's at pose and commands.

        The pose of an arm is not measured either: then they are the hanging arm's under the commands.
        """
        config, mechanism = self._task.config, self._task.mechanism
        if config.observe_tensions:
            tendons = range(mechanism.n_tendons)
            return config.tension_range[1] * self._entries(*(f"tendon {j} tension" for j in tendons))
        if self._task.dimension == 3:
            hanging, limits = [mechanism.gravity(HANGING)], config.possible_tensions
            return solve_lengths_batch(mechanism, self.commands, hanging, tension_limits=limits).tensions
        lengths = mechanism.tendon_lengths(self.joint_angles)
        return elastic_tension(lengths, self.commands, mechanism.stiffnesses, *config.possible_tensions)

    @property
    def last_actions(self) -> Array | None:
        """The actions of the last step, (B, m); None where the observation does not show them."""
        names = [f"tendon {j} action, lag 1" for j in range(self._task.mechanism.n_tendons)]
        return self._entries(*names) if names[0] in self._places else None

    def _need(self, *poses: str) -> None:
        if self.sees not in poses:
            allowed = " or ".join(map(repr, poses))
            raise InvalidInput("sensing.pose", self.sees, allowed, "This controller needs measured poses.")

    @property
    def _has_goals(self) -> bool:
        return isinstance(self.observation, Mapping) and "desired_goal" in self.observation

    @property
    def _count(self) -> int:
        """B."""
        return len(self.observation["observation"] if isinstance(self.observation, Mapping) else self.observation)

    @property
    def _axes(self) -> str:
        return "xyz"[: self._task.dimension]

    @property
    def _shows_tip_alone(self) -> bool:
        """Whether the tip is the only measured part of the pose, as of an arm."""
        return "tip x" in self._places

    @property
    def _tip_name(self) -> str:
        """The name of the tip in the observation: of a planar chain it is the last link."""
        return "tip" if self._shows_tip_alone else f"link {self._task.mechanism.n_links - 1}"

    @property
    def _task(self) -> TrackingTask:
        if self.task is None:
            raise InvalidInput("environment", "not one of rj_gym", "rj_gym/...", "This controller needs its task.")
        return self.task

    @cached_property
    def _places(self) -> dict[str, int]:
        return {entry.name: place for place, entry in enumerate(self._task.entries(self._has_goals))}

    def _entries(self, *names: str) -> Array:
        """These entries of the observation, (B, len(names)), in their units."""
        vectors = self.observation["observation"] if isinstance(self.observation, Mapping) else self.observation
        return np.take(np.asarray(vectors, float), self._columns(names), axis=1)  # C order: kernels compile once

    def _columns(self, names: Sequence[str]) -> list[int]:
        missing = [name for name in names if name not in self._places]
        if missing:
            hint = "The environment does not show what this controller needs."
            raise InvalidInput("observation entry", missing[0], f"one of {', '.join(self._places)}", hint)
        return [self._places[name] for name in names]


Seen = Reading  # its name until 0.1.0
