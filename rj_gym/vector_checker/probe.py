"""The environment under test in one autoreset mode, and a rollout that checks share."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from copy import deepcopy
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, TypeAlias

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import concatenate, create_empty_array, iterate

from rj_gym.vector_checker.values import arrays_in, difference, in_short

AnyVectorEnv: TypeAlias = VectorEnv[Any, Any, Any]
RETURNED = {
    "reset": ("observations", "infos"),
    "step": ("observations", "rewards", "terminations", "truncations", "infos"),
}


class Failure(Exception):
    """The claim of a check does not hold."""


class Inapplicable(Exception):
    """A check that does not apply to this environment, and why."""


@dataclass(frozen=True)
class RecordedCall:
    """One call of reset or step.

    Attributes:
        returned: the returned objects themselves, by name.
        copy: the returned objects, copied at once.
    """

    returned: dict[str, Any]
    copy: dict[str, Any]

    @property
    def is_step(self) -> bool:
        """Whether this was a step."""
        return "rewards" in self.copy

    @property
    def observations(self) -> Any:
        """Observations of all lanes, copied."""
        return self.copy["observations"]

    @property
    def infos(self) -> Any:
        """Infos of all lanes, copied."""
        return self.copy["infos"]

    @property
    def rewards(self) -> Any:
        """Rewards of a step, copied."""
        return self.copy["rewards"]

    @property
    def ends(self) -> tuple[Any, Any]:
        """Terminations and truncations of a step, copied."""
        return self.copy["terminations"], self.copy["truncations"]

    @property
    def ended(self) -> Any:
        """Which lanes this step terminated or truncated."""
        return np.logical_or(*self.ends)


@dataclass(frozen=True)
class Probe:
    """The environment under test, for checks.

    Attributes:
        make: a new environment in an autoreset mode, or always the same one if it `is_built`.
        mode, other_modes: the mode under test, and others that `make` can build.
        seed, n_steps: of every rollout.
        max_episode_steps: the stated time limit.
        scalar: a new scalar environment like one lane.
        warnings: warnings of the environment so far.
    """

    make: Callable[[AutoresetMode | None], AnyVectorEnv]
    mode: AutoresetMode | None
    other_modes: tuple[AutoresetMode, ...]
    seed: int
    n_steps: int
    max_episode_steps: int | None
    scalar: Callable[[], gymnasium.Env[Any, Any]] | None
    is_built: bool
    warnings: list[str] = field(default_factory=list)

    @contextmanager
    def env(self, mode: AutoresetMode | None = None) -> Iterator[AnyVectorEnv]:
        """An environment for one check, closed afterwards; the mode is the one under test unless named."""
        env = self.make(mode or self.mode)
        try:
            yield env
        finally:
            if not self.is_built:
                with suppress(Exception):  # a separate check is about closing
                    env.close()

    @cached_property
    def played(self) -> tuple[AnyVectorEnv, list[RecordedCall]]:
        """An environment (closed by now) and its rollout."""
        with self.env() as env:
            return env, self.play(env, self.actions(env))

    @property
    def rollout(self) -> list[RecordedCall]:
        """The rollout that checks share: seeded, n_steps sampled actions."""
        return self.played[1]

    @cached_property
    def repetition(self) -> list[RecordedCall]:
        """The same rollout, played once more; in a new environment, unless one was given."""
        with self.env() as env:
            return self.play(env, self.actions(env))

    @property
    def num_envs(self) -> int:
        """Number of lanes."""
        return self.played[0].num_envs

    def actions(self, env: AnyVectorEnv) -> list[Any]:
        """The sampled actions of every rollout; the environment's own sampling stays as it is."""
        space = deepcopy(env.action_space)
        space.seed(self.seed)
        return [space.sample() for _ in range(self.n_steps)]

    def equal_actions(self, env: AnyVectorEnv) -> list[Any]:
        """Sampled actions that are the same in every lane."""
        space = deepcopy(env.single_action_space)
        space.seed(self.seed)
        return [batch(space, [space.sample()] * env.num_envs) for _ in range(self.n_steps)]

    def play(
        self, env: AnyVectorEnv, actions: Sequence[Any], *, seed: int | None = None, spoil: bool = False
    ) -> list[RecordedCall]:
        """A seeded reset and the steps after it; see play_on."""
        calls = [reset(env, seed=self.seed if seed is None else seed)]
        if spoil:
            overwrite(calls[0].returned)
        return calls + play_on(env, actions, spoil=spoil)

    def lanes(self, observations: Any) -> list[Any]:
        """The observation of each lane."""
        return list(iterate(self.played[0].observation_space, observations))

    def reset_lanes(self, env: AnyVectorEnv, **arguments: Any) -> list[Any]:
        """The observation of each lane after a reset."""
        return self.lanes(reset(env, **arguments).observations)

    @cached_property
    def has_own_streams(self) -> bool:
        """Whether every lane has separate random numbers, seeded with seed + lane."""
        with self.env() as env:
            lanes, later = (self.reset_lanes(env, seed=self.seed + shift) for shift in (0, 1))
        return not difference(lanes[1:], later[:-1], "lanes")

    def require_repeatable(self) -> None:
        """Raise Inapplicable where a rollout does not repeat itself, so that none can be compared with another."""
        if calls_difference(self.repetition, self.rollout):
            raise Inapplicable("rollouts of one seed differ")

    def require_own_streams(self) -> None:
        """Raise Inapplicable where lanes share their random numbers, so that no lane can be repeated by itself."""
        self.require_repeatable()
        if not self.has_own_streams:
            raise Inapplicable("lanes do not have random numbers of their own, seeded with seed + lane")


def require_equal(actual: Any, expected: Any, where: str, *, dtypes: bool = True) -> None:
    """Raise Failure, naming the first difference, unless two nested values are equal."""
    fail_on(difference(actual, expected, where, dtypes=dtypes))


def calls_difference(calls: Sequence[RecordedCall], expected: Sequence[RecordedCall], context: str = "") -> str | None:
    """The first difference between the results of two sequences of calls, as far as both go; None if there is none."""
    pairs = enumerate(zip(calls, expected, strict=False))
    texts = (difference(call.copy, reference.copy, f"call {n}{context}: results") for n, (call, reference) in pairs)
    return next((text for text in texts if text), None)


def fail_on(fault: str | None) -> None:
    """Raise Failure if there is a fault."""
    if fault:
        raise Failure(fault)


def reset(env: AnyVectorEnv, **arguments: Any) -> RecordedCall:
    """One call of reset."""
    return _call("reset", env.reset(**arguments))


def step(env: AnyVectorEnv, actions: Any) -> RecordedCall:
    """One call of step."""
    return _call("step", env.step(actions))


def play_on(env: AnyVectorEnv, actions: Sequence[Any], *, spoil: bool = False) -> list[RecordedCall]:
    """Steps with these actions; with autoreset disabled, a masked reset before the step after an end.

    With `spoil`, everything that goes in or comes out is overwritten once it is copied.
    """
    calls: list[RecordedCall] = []
    for action in actions:
        if calls and env.metadata.get("autoreset_mode") is AutoresetMode.DISABLED and calls[-1].ended.any():
            calls.append(reset(env, options={"reset_mask": calls[-1].ended}))
            if spoil:
                overwrite(calls[-1].returned)
        argument = deepcopy(action)
        calls.append(step(env, argument))
        if spoil:
            overwrite([argument, calls[-1].returned])
    return calls


def batch(space: gymnasium.Space[Any], items: Sequence[Any]) -> Any:
    """One batch of the items of a space."""
    empty: Any = create_empty_array(space, len(items), fn=np.zeros)
    return concatenate(space, items, empty)


def overwrite(value: Any) -> None:
    """Fill every array that can be written: NaN in floats, the opposite in booleans, one more in integers."""
    for _, array in arrays_in(value, "value"):
        if not array.flags.writeable:
            continue
        if array.dtype == bool:
            np.logical_not(array, out=array)
        elif np.issubdtype(array.dtype, np.inexact):
            array.fill(np.nan)
        elif np.issubdtype(array.dtype, np.integer):
            array += 1


def _call(method: str, returned: Any) -> RecordedCall:
    names = RETURNED[method]
    if not isinstance(returned, tuple) or len(returned) != len(names):
        raise Failure(f"{method} returned {in_short(returned)}, expected ({', '.join(names)})")
    results = dict(zip(names, returned, strict=True))
    return RecordedCall(results, deepcopy(results))
