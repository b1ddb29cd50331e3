"""Options of `reset` that hold something of the design task fixed, checked before anything changes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rj_gym.core.arguments import LARGEST, checked_keys
from rj_gym.design.config import DesignConfig
from rollingjoint.checks import as_floats
from rollingjoint.errors import InvalidInput

Array = NDArray[np.float64]

OPTIONS = ("design", "target_design", "forces", "tensions")


class DesignOptions(NamedTuple):
    """Values that a reset fixes, the same in every lane; None is drawn. Shapes as in DesignDraws, no B."""

    start_design: Array | None = None
    target_design: Array | None = None
    tensions: Array | None = None
    forces: Array | None = None


def checked_options(options: Mapping[str, Any] | None, config: DesignConfig) -> DesignOptions:
    """The values that the options fix; whether the target design is valid remains to be checked.

    Args:
        options: any of "design" (d,), to begin with, in [-1, 1], valid or not; "target_design" (d,), a valid one
            with the targets as its shapes; "forces" (K, 2), in space (K, 3) [N]; "tensions" (K, m), above 0 [N].
        config: the settings.
    Raises:
        InvalidInput: an unknown key or a value that cannot be used.
    """
    options, vector, cases = checked_keys(options, OPTIONS), (config.space.dimensions,), config.cases
    tensions, forces = (cases, config.space.plain.n_tendons), (cases, config.space.dimension)
    return DesignOptions(
        option_numbers(options, "design", vector, -1.0, 1.0),
        option_numbers(options, "target_design", vector, -1.0, 1.0),
        option_numbers(options, "tensions", tensions, np.nextafter(0.0, 1.0), LARGEST),
        option_numbers(options, "forces", forces, -LARGEST, LARGEST),
    )


def option_numbers(
    options: Mapping[str, Any], key: str, shape: tuple[int, ...], low: float, high: float
) -> Array | None:
    """The numbers of an option within bounds, None where it is not given; InvalidInput for others."""
    if key not in options:
        return None
    within = "above 0" if low > 0 else f"in [{low:g}, {high:g}]"
    what, allowed = f"options[{key!r}]", f"numbers {within} of shape {shape}"
    numbers = as_floats(what, options[key], allowed)
    if numbers.shape != shape or not np.all((low <= numbers) & (numbers <= high)):
        raise InvalidInput(what, options[key], allowed)
    return numbers
