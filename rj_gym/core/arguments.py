"""What callers give to environments, checked: seeds; numbers, masks and pictures of lanes, modes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from rollingjoint.checks import as_integer
from rollingjoint.errors import InvalidInput, naming_extras

MOST_LANES = 2**20  # some gigabytes of arrays


def checked_count(num_envs: object) -> int:
    """The number of lanes; raises InvalidInput."""
    allowed = f"a whole number of lanes from 1 to {MOST_LANES}"
    return as_integer("num_envs", num_envs, 1, MOST_LANES, allowed=allowed)


def checked_lanes(render_lanes: object, lanes: int) -> Sequence[int]:
    """The lanes to draw, all for None; raises InvalidInput."""
    if render_lanes is None:
        return range(lanes)
    allowed = f"a list of lanes from 0 to {lanes - 1}, or None for all of them"
    given = _listed(render_lanes)
    if given is None:
        raise InvalidInput("render_lanes", render_lanes, allowed)
    return tuple(as_integer("one of render_lanes", lane, 0, lanes - 1, allowed=allowed) for lane in given)


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
        allowed = f"an AutoresetMode or one of {', '.join(repr(known.value) for known in AutoresetMode)}"
        raise InvalidInput("autoreset_mode", mode, allowed) from None


def checked_mask(mask: object, lanes: int, begun: bool) -> NDArray[np.bool_]:
    """The lanes to reset, (lanes,): all by default, and all before any has `begun`; raises InvalidInput."""
    if mask is None:
        return np.ones(lanes, bool)
    chosen = np.asarray(mask)
    if chosen.shape != (lanes,) or chosen.dtype != bool or not chosen.any():
        allowed = f"{lanes} booleans, one per lane, at least one of them True"
        raise InvalidInput("options['reset_mask']", mask, allowed)
    if not begun and not chosen.all():
        raise InvalidInput("options['reset_mask']", mask, "all True: no lane has begun yet")
    return chosen.copy()


def checked_seed(seed: object, what: str = "seed", allowed: str = "a whole number, 0 or more, or None") -> int | None:
    """The seed, also a NumPy integer, or None; raises InvalidInput."""
    return None if seed is None else as_integer(what, seed, 0, allowed=allowed)


def checked_seeds(seed: object, lanes: int) -> Sequence[int | None]:
    """One seed per lane: seed + i from a number, None where random numbers go on; raises InvalidInput."""
    allowed = f"a whole number, 0 or more, or None; or {lanes} of these, one per lane"
    given = _listed(seed)
    if given is None:
        first = checked_seed(seed, allowed=allowed)
        return [None if first is None else first + lane for lane in range(lanes)]
    if len(given) != lanes:
        raise InvalidInput("seed", seed, allowed)
    return [checked_seed(one, f"seed of lane {lane}") for lane, one in enumerate(given)]


def _listed(values: object) -> Sequence[object] | None:
    """The items of a list, a tuple or an array; None for anything else, text too."""
    if isinstance(values, np.ndarray) and values.ndim:
        return values.tolist()
    return values if isinstance(values, Sequence) and not isinstance(values, str | bytes) else None
