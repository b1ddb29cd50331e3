"""Calls of environments, checked: seeds, options, lanes, modes and saved states; and one call at a time."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Concatenate, ParamSpec, Protocol, TypeVar

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from rollingjoint.checks import as_floats, as_integer
from rollingjoint.errors import InvalidInput, RollingJointError, naming_extras

Array = NDArray[np.float64]

MOST_LANES = 2**20  # some gigabytes of arrays
LARGEST = 1e12  # in millimetres and newtons; the solvers take no more
HINT = "Take it from get_state() of an environment with these settings and this many lanes."


def checked_count(num_envs: object) -> int:
    """The number of lanes; raises InvalidInput."""
    allowed = f"a whole number of lanes from 1 to {MOST_LANES}"
    return as_integer("num_envs", num_envs, 1, MOST_LANES, allowed=allowed)


def checked_lanes(render_lanes: object, lanes: int) -> Sequence[int]:
    """The lanes to draw, all for None; raises InvalidInput."""
    if render_lanes is None:
        return range(lanes)
    allowed = f"a list of lanes from 0 to {lanes - 1}, or None for all of them"
    selection = _listed(render_lanes)
    if selection is None:
        raise InvalidInput("render_lanes", render_lanes, allowed)
    return tuple(as_integer("one of render_lanes", lane, 0, lanes - 1, allowed=allowed) for lane in selection)


def checked_render_mode(mode: str | None, modes: Sequence[str]) -> str | None:
    """The mode, None or one of `modes`.

    Raises:
        InvalidInput: another mode.
        MissingPackage: pygame, which draws, is not installed.
    """
    if mode not in (None, *modes):
        raise InvalidInput("render_mode", mode, f"None or one of {', '.join(map(repr, modes))}")
    if mode is not None:
        with naming_extras():
            import pygame  # noqa: F401
    return mode


def checked_autoreset_mode(mode: AutoresetMode | str) -> AutoresetMode:
    """The mode, also by its value; raises InvalidInput."""
    try:
        return AutoresetMode(mode)
    except ValueError:
        allowed = f"an AutoresetMode or one of {', '.join(repr(member.value) for member in AutoresetMode)}"
        raise InvalidInput("autoreset_mode", mode, allowed) from None


def checked_mask(mask: object, lanes: int, is_begun: bool) -> NDArray[np.bool_]:
    """The lanes to reset, (lanes,): all by default, and all until `is_begun`; raises InvalidInput."""
    if mask is None:
        return np.ones(lanes, bool)
    rows = np.asarray(mask)
    if rows.shape != (lanes,) or rows.dtype != bool or not rows.any():
        allowed = f"{lanes} booleans, one per lane, at least one of them True"
        raise InvalidInput("options['reset_mask']", mask, allowed)
    if not is_begun and not rows.all():
        raise InvalidInput("options['reset_mask']", mask, "all True: no lane has begun yet")
    return rows.copy()


def checked_seed(seed: object, what: str = "seed", allowed: str = "a whole number, 0 or more, or None") -> int | None:
    """The seed, also a NumPy integer, or None; raises InvalidInput."""
    return None if seed is None else as_integer(what, seed, 0, allowed=allowed)


def checked_seeds(seed: object, lanes: int) -> Sequence[int | None]:
    """One seed per lane: seed + i from a number, None where random numbers go on; raises InvalidInput."""
    allowed = f"a whole number, 0 or more, or None; or {lanes} of these, one per lane"
    seeds = _listed(seed)
    if seeds is None:
        first = checked_seed(seed, allowed=allowed)
        return [None if first is None else first + lane for lane in range(lanes)]
    if len(seeds) != lanes:
        raise InvalidInput("seed", seed, allowed)
    return [checked_seed(entry, f"seed of lane {lane}") for lane, entry in enumerate(seeds)]


def _listed(values: object) -> Sequence[object] | None:
    """The items of a list, a tuple or an array; None for anything else, text too."""
    if isinstance(values, np.ndarray) and values.ndim:
        return values.tolist()
    return values if isinstance(values, Sequence) and not isinstance(values, str | bytes) else None


def checked_keys(options: Mapping[str, Any] | None, keys: Sequence[str]) -> Mapping[str, Any]:
    """The options, empty for None; InvalidInput unless they are a dictionary with known keys."""
    if options is None:
        return {}
    if not isinstance(options, Mapping):
        raise InvalidInput("reset options", options, f"a dictionary with keys among {', '.join(keys)}")
    for key in options:
        if key not in keys:
            raise InvalidInput("reset options key", key, f"one of {', '.join(keys)}")
    return options


def finite_floats(what: str, value: object) -> Array:
    """The values as an array; InvalidInput for anything but numbers of size LARGEST at most."""
    array = as_floats(what, value, "numbers")
    if not np.all(np.abs(array) <= LARGEST):
        raise InvalidInput(what, value, f"finite numbers from -{LARGEST:g} to {LARGEST:g}")
    return array


def checked_parts(state: object, names: Sequence[str], where: str = "state") -> Mapping[str, Any]:
    """The parts of a state by name; raises InvalidInput unless it is a mapping with these keys and no others."""
    if not isinstance(state, Mapping) or set(state) != set(names):
        description = sorted(map(str, state)) if isinstance(state, Mapping) else type(state).__name__
        raise InvalidInput(where, description, f"a mapping with the keys {', '.join(sorted(names))}", HINT)
    return state


def checked_array(name: str, values: object, like: NDArray[Any]) -> NDArray[Any]:
    """The array, of the shape and type of `like`; raises InvalidInput for any other: kernels check neither."""
    if not isinstance(values, np.ndarray) or (values.shape, values.dtype) != (like.shape, like.dtype):
        description = (values.dtype.name, values.shape) if isinstance(values, np.ndarray) else type(values).__name__
        raise InvalidInput(f"state: {name}", description, f"an array {like.dtype.name} {like.shape}", HINT)
    return values


def check_whole(name: str, values: NDArray[Any], low: float, high: float) -> None:
    """Raise InvalidInput unless all values are whole numbers from low to high: kernels use them as indices."""
    good = (values >= low) & (values <= high) & (values == np.rint(values))
    if not good.all():
        raise InvalidInput(f"state: {name}", values[~good][0], f"whole numbers from {low:g} to {high:g}", HINT)


P = ParamSpec("P")
R = TypeVar("R")


class EnvironmentInUse(RollingJointError, RuntimeError):
    """A call of an environment while another call of it is running; the state is unchanged."""


class Usable(Protocol):
    """An object with methods that are used alone."""

    _calls: dict[str, Any]  # the running call, if there is one; empty at first


Self = TypeVar("Self", bound=Usable)


def used_alone(method: Callable[Concatenate[Self, P], R]) -> Callable[Concatenate[Self, P], R]:
    """The method, which raises EnvironmentInUse while another such method of the same object is running.

    A mark and no lock: no caller waits. `setdefault` marks in one step, whichever threads come together.
    """

    @functools.wraps(method)
    def alone(self: Self, *args: P.args, **kwargs: P.kwargs) -> R:
        calls, call = self._calls, object()
        try:
            if calls.setdefault("running", call) is not call:
                raise EnvironmentInUse(
                    f"{type(self).__name__}.{method.__name__}: another call of this environment is running. "
                    "Use it from one thread at a time, or make one environment per thread."
                )
            return method(self, *args, **kwargs)
        finally:
            if calls.get("running") is call:
                calls.clear()

    return alone
