"""Own reward terms, observation entries, ends of episodes, targets and loads of the tracking tasks.

`Terms` is a setting of every tracking environment. Its functions get many lanes at a time: at a step all lanes, at a
reset the ones that restart; a scalar environment is one lane. They may be compiled: `Step` and `Start` are NamedTuples
of arrays, which functions under `numba.njit` take as they are.

After every step, and at a reset after step 0, the update of the memory is called first, then the rewards, the ends and
the observations, each in the order of its definition. The rewards and ends of step 0 are dropped. A function that keeps
numbers from call to call needs a `Memory`: the rows of an array are the lanes of a call, and are no lane numbers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rj_gym.core.columns import ERROR, FORCE, LINK, REWARD, STEP, TARGET, TENSIONS, TIP
from rj_gym.core.settings import Settings
from rj_gym.core.task import Entry
from rollingjoint.checks import as_choice, as_integer
from rollingjoint.errors import ConfigError, InvalidInput

if TYPE_CHECKING:
    from rj_gym.tracking.arrays import RunningEpisodes

Array = NDArray[np.float64]

REWARDS = ("add", "replace")
"""How own reward terms stand to those of the task."""

_BUILT_IN = ("tracking", "effort", "smoothness", "failure", "orientation")
_MOST_UNIFORMS = 100_000


class Step(NamedTuple):
    """Where B running episodes are after a step, or at their start: d coordinates, m tendons, n links.

    Views of the environment's own arrays, read-only, which the next step changes. Poses, tip and tensions are true
    values, without the errors of sensors.
    """

    step: NDArray[np.float64]  # (B,) steps taken, 0 at the start
    action: Array  # (B, m) within [-1, 1]
    previous_action: Array  # (B, m)
    tip: Array  # (B, d) mm
    target: Array  # (B, d) mm
    error_mm: Array  # (B,) distance of the tip from the target
    tensions: Array  # (B, m) N
    commands: Array  # (B, m) commanded tendon lengths, mm
    joint_angles: Array  # (B, n - 1) rad
    poses: Array  # of all links, (B, n, 3) mm, mm, rad in the plane, (B, n, 4, 4) in space
    load_link: Array  # (B,)
    load_force: Array  # (B, d) N
    reward: Array  # (B,) the sum of the task's own terms
    memory: Array  # (B, width) of a Memory, after its update; width 0 without one


class Start(NamedTuple):
    """The argument of a function that draws targets or loads when B episodes begin."""

    uniforms: Array  # (B, k) random numbers in [0, 1) of each episode's own generator
    episode_steps: int  # T
    length: float  # of the mechanism, mm


@dataclass(frozen=True)
class Observed:
    """Own entries of the observation, which follow the task's.

    Args:
        entries: name, unit, lowest and highest value of each.
        function: their values in a Step, (B, len(entries)); they are clipped to the bounds.
    """

    entries: Sequence[Entry]
    function: Callable[[Step], Array]

    def __post_init__(self) -> None:
        _check_function("observations", self.function)
        allowed = "a list of Entry(name, unit, low, high), low below high"
        try:
            entries = tuple(Entry(*entry) for entry in self.entries)
            ordered = bool(entries) and all(entry.low < entry.high for entry in entries)
        except TypeError:
            raise ConfigError("entries of an observation", self.entries, allowed) from None
        if not ordered:
            raise ConfigError("entries of an observation", self.entries, allowed)
        object.__setattr__(self, "entries", entries)


@dataclass(frozen=True)
class Drawn:
    """Own targets or loads: a function of random numbers.

    Args:
        function: of a Start.
        uniforms: how many random numbers an episode needs, k.
    """

    function: Callable[[Start], Array]
    uniforms: int = 0

    def __post_init__(self) -> None:
        _check_function("targets, loads", self.function)
        as_integer("uniforms", self.uniforms, low=0, high=_MOST_UNIFORMS, error=ConfigError)


@dataclass(frozen=True)
class Memory:
    """Numbers of every lane that last from step to step of an episode.

    They are part of the environment's state: an episode begins with the starting values, and get_state, set_state,
    pickles and the checkpoints of a training have them.

    Args:
        start: the values before step 0, (width,).
        update: of a Step whose memory is still the one of the step before; the values after this step, (B, width), or
            (B,) where the width is 1. It is called once per step, step 0 included, before all other functions.
    """

    start: Sequence[float]
    update: Callable[[Step], Array]

    def __post_init__(self) -> None:
        _check_function("update of a memory", self.update)
        allowed = "a list of at least one finite number"
        try:
            start = tuple(float(value) for value in self.start)
        except (TypeError, ValueError):
            raise ConfigError("start of a memory", self.start, allowed) from None
        if not start or not all(map(math.isfinite, start)):
            raise ConfigError("start of a memory", self.start, allowed)
        object.__setattr__(self, "start", start)


@dataclass(frozen=True)
class Terms(Settings):
    """Additions to a tracking task's reward, observation, end, targets and loads.

    Args:
        rewards: terms of the reward by name, functions of a Step, (B,) each. They stand in info["reward_terms"].
        reward: "add" them to the reward of the task, or "replace" it; its own terms stay in info then.
        observations: own entries of the observation.
        ends: reasons to end an episode by name, functions of a Step, booleans (B,) each. They terminate it, and
            info["ends"] says which of them hold.
        targets: positions of the tip, (B, 1 or T + 1, d) [mm]: one for the episode, or one per step; with the
            orientation of arms followed by the rotation matrix row by row.
        target_tensions: tendon tensions, (B, 1 or T + 1, m) [N], with equilibria that have their tips at the targets,
            so that every target can be reached. Not together with targets.
        loads: forces at the origin of the loaded link, (B, 1 or T + 1, 2) [N]; of arms weights at the tip,
            (B, 1 or T + 1) [N].
        memory: numbers that last from step to step, `memory` of a Step.
    """

    _SECTION = "terms."
    rewards: Mapping[str, Callable[[Step], Array]] = field(default_factory=dict)
    reward: str = "add"
    observations: Sequence[Observed] = ()
    ends: Mapping[str, Callable[[Step], NDArray[np.bool_]]] = field(default_factory=dict)
    targets: Drawn | None = None
    target_tensions: Drawn | None = None
    loads: Drawn | None = None
    memory: Memory | None = None

    def __post_init__(self) -> None:
        self._check(as_choice, "reward", choices=REWARDS)
        for section in ("rewards", "ends"):
            named = getattr(self, section)
            if not isinstance(named, Mapping):
                raise ConfigError(f"terms.{section}", named, "a dictionary of functions by name")
            for name, function in named.items():
                _check_function(f"terms.{section}[{name!r}]", function)
                if name in _BUILT_IN:
                    raise ConfigError(f"terms.{section}", name, f"a name other than {', '.join(_BUILT_IN)}")
        if self.reward == "replace" and not self.rewards:
            raise ConfigError("terms.reward", self.reward, '"add" without own rewards')
        if self.targets is not None and self.target_tensions is not None:
            raise ConfigError("terms.target_tensions", "given", "None beside targets")
        observations = self.observations
        if not isinstance(observations, Sequence) or not all(isinstance(term, Observed) for term in observations):
            raise ConfigError("terms.observations", observations, "a list of Observed")
        for name in ("targets", "target_tensions", "loads"):
            if not isinstance(getattr(self, name), Drawn | None):
                raise ConfigError(f"terms.{name}", getattr(self, name), "Drawn(function, uniforms) or None")
        if not isinstance(self.memory, Memory | None):
            raise ConfigError("terms.memory", self.memory, "Memory(start, update) or None")

    @property
    def entries(self) -> list[Entry]:
        """The own entries of the observation, in order."""
        return [entry for term in self.observations for entry in term.entries]

    def columns(self, first: int) -> tuple[list[tuple[str, int]], list[tuple[str, int]]]:
        """Names and columns of readings of the terms of the reward and of the ends, from a first column on."""
        rewards = [(name, column) for column, name in enumerate(self.rewards, first)]
        return rewards, [(name, column) for column, name in enumerate(self.ends, first + len(rewards))]

    @property
    def act(self) -> bool:
        """Whether any of the functions take part in steps."""
        return bool(self.rewards or self.ends or self.observations or self.memory)

    @property
    def width(self) -> int:
        """How many columns of readings the rewards, the ends and the memory need."""
        return len(self.rewards) + len(self.ends) + len(self.start)

    @property
    def start(self) -> Sequence[float]:
        """The starting values of the memory, none without one."""
        return self.memory.start if self.memory else ()

    @property
    def uniforms(self) -> dict[str, tuple[int, ...]]:
        """Shapes of the random numbers that an episode needs, by name."""
        drawn = {name: getattr(self, name) for name in ("targets", "target_tensions", "loads")}
        return {f"own {name}": (term.uniforms,) for name, term in drawn.items() if term is not None and term.uniforms}


def checked_series(name: str, values: Any, start: Start, shape: tuple[int, ...]) -> Array:
    """The series that a function gave for a Start, (B, 1 or T + 1, *shape).

    Raises:
        InvalidInput: numbers of another shape, or that are not finite.
    """
    series = np.asarray(values, float)
    allowed = [(len(start.uniforms), times, *shape) for times in (1, start.episode_steps + 1)]
    if series.shape not in allowed or not np.isfinite(series).all():
        raise InvalidInput(name, series, f"finite numbers of shape {allowed[0]} or {allowed[1]}")
    return np.ascontiguousarray(series)


class AppliedTerms:
    """The terms of a task at work on the arrays of an episode buffer.

    Args:
        terms: the settings. first: the first of their columns in readings, which are those of the rewards, the ends and
            the memory. dimension: of a position. n_tendons: m.
    """

    def __init__(self, terms: Terms, first: int, dimension: int, n_tendons: int) -> None:
        self._terms, self._d, self._m = terms, dimension, n_tendons
        last = first + terms.width
        self._rewards = slice(first, first + len(terms.rewards))
        self._memory = slice(last - len(terms.start), last)
        self._start = np.array(terms.start)
        self._low, self._high = (
            np.array([getattr(entry, side) for entry in terms.entries]) for side in ("low", "high")
        )
        self._steps: dict[int, Step] = {}  # by the number of lanes: making one takes as long as a small function

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_steps": {}}

    def bind(self, state: RunningEpisodes) -> None:
        """Work on these arrays from now on."""
        self._state, self._steps = state, {}

    def begin(self, count: int) -> None:
        """Give the first lanes the memory of new episodes, for their step 0."""
        self._state.readings[:count, self._memory] = self._start

    def forget(self, count: int) -> None:
        """Set the terms of the reward to 0 in the first lanes, whose step 0 has been taken."""
        self._state.readings[:count, self._rewards] = 0.0

    def apply(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        """Update the memory and fill the own columns of the first lanes; their observations with the own entries.

        Raises:
            InvalidInput: a function that gives numbers of another shape, or that are not finite.
        """
        count, terms = len(observations), self._terms
        readings, step, column = self._state.readings[:count], self._step(count), self._rewards.start
        total: Array | float = 0.0
        if terms.memory is not None:
            readings[:, self._memory] = _remembered(terms.memory.update(step), step.memory.shape)
        for section, functions in (("rewards", terms.rewards), ("ends", terms.ends)):
            for name, function in functions.items():
                values = _values(section, name, function(step), (count,))
                readings[:, column] = values
                column += 1
                total = total + values if section == "rewards" else total
        if terms.reward == "replace":
            readings[:, REWARD] = total
        elif terms.rewards:
            readings[:, REWARD] += total
        return self.observed(observations)

    def observed(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        """The observations of the first lanes with the own entries; raises as `apply`."""
        count, parts = len(observations), [observations]
        first = 0
        for term in self._terms.observations:
            name, last = term.entries[0].name, first + len(term.entries)
            values = _values("observations", name, term.function(self._step(count)), (count, last - first))
            parts.append(np.clip(values, self._low[first:last], self._high[first:last]).astype(np.float32))
            first = last
        return observations if first == 0 else np.hstack(parts)

    def _step(self, count: int) -> Step:
        """The first lanes, as functions see them."""
        if (record := self._steps.get(count)) is not None:
            return record
        state, d, m = self._state, self._d, self._m
        readings = state.readings[:count]
        views = Step(
            step=readings[:, STEP],
            action=state.actions[:count, 0],
            previous_action=state.actions[:count, 1],
            tip=readings[:, TIP : TIP + d],
            target=readings[:, TARGET : TARGET + d],
            error_mm=readings[:, ERROR],
            tensions=readings[:, TENSIONS : TENSIONS + m],
            commands=readings[:, TENSIONS + m : TENSIONS + 2 * m],
            joint_angles=state.angles[:count],
            poses=state.poses[:count],
            load_link=readings[:, LINK],
            load_force=readings[:, FORCE : FORCE + d],
            reward=readings[:, REWARD],
            memory=readings[:, self._memory],
        )
        self._steps[count] = step = Step(*map(_read_only, views))
        return step


def _read_only(view: Array) -> Array:
    """The same view, which a function cannot write to by mistake."""
    view = view.view()
    view.flags.writeable = False
    return view


def _values(section: str, name: str, values: Any, shape: tuple[int, ...]) -> Array:
    """The values of a function as finite floats of a shape; raises InvalidInput."""
    what = f"terms.{section}[{name!r}]"
    return _finite(what, _numbers(what, values, shape), shape)


def _numbers(what: str, values: Any, shape: tuple[int, ...]) -> Array:
    """The values as floats; raises InvalidInput for anything that is no array of them."""
    try:
        return np.asarray(values, float)
    except (TypeError, ValueError):
        raise InvalidInput(what, values, f"finite numbers of shape {shape}") from None


def _remembered(values: Any, shape: tuple[int, ...]) -> Array:
    """The values of an update as finite floats (B, width), a column where there is one; raises InvalidInput."""
    if values is None:
        raise InvalidInput("terms.memory", values, f"finite numbers of shape {shape}", "The update returns nothing.")
    array = _numbers("terms.memory", values, shape)
    if array.ndim == 1 and shape[1] == 1:
        array = array[:, None]
    return _finite("terms.memory", array, shape)


def _finite(name: str, array: Array, shape: tuple[int, ...]) -> Array:
    if array.shape != shape or not math.isfinite(array.sum()):
        raise InvalidInput(name, array, f"finite numbers of shape {shape}")
    return array


def _check_function(name: str, function: object) -> None:
    if not callable(function):
        raise ConfigError(name, function, "a function")
