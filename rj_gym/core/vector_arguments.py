"""What callers give to native vector environments, checked: seeds, masks of lanes, autoreset modes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from rollingjoint.errors import InvalidInput


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


def checked_seeds(seed: int | Sequence[int | None] | None, lanes: int) -> Sequence[int | None]:
    """One seed per lane: seed + i from a number, None where random numbers go on; raises InvalidInput."""
    if seed is None:
        return [None] * lanes
    if isinstance(seed, int | np.integer):
        return [int(seed) + lane for lane in range(lanes)]
    if len(seed) != lanes:
        raise InvalidInput("seed", seed, f"a number, or {lanes} numbers, one per lane")
    return seed
