"""What `reset(options=...)` may hold fixed in the design task, checked before anything changes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rj_gym.design.task import DesignTask, Fixed
from rollingjoint.checks import as_floats
from rollingjoint.design import MARGINS
from rollingjoint.errors import InvalidInput

Array = NDArray[np.float64]

OPTIONS = ("design", "target_design", "forces", "tensions")


def checked_options(options: Mapping[str, Any] | None, task: DesignTask) -> Fixed:
    """What the options hold fixed.

    Args:
        options: any of "design" (d,), to begin with, in [-1, 1], valid or not; "target_design" (d,), a valid one whose
            shapes are the targets; "forces" (K, 2) [N]; "tensions" (K, 2), above 0 [N].
        task: the task.
    Raises:
        InvalidInput: an unknown key or a value that cannot be used.
    """
    if options is None:
        return Fixed()
    if not isinstance(options, Mapping):
        raise InvalidInput("reset options", options, f"a dictionary with keys among {', '.join(OPTIONS)}")
    for key in options:
        if key not in OPTIONS:
            raise InvalidInput("reset options key", key, f"one of {', '.join(OPTIONS)}")
    vector, pairs = (task.space.dimensions,), (task.config.cases, 2)
    fixed = Fixed(
        _numbers(options, "design", vector, -1.0, 1.0),
        _numbers(options, "target_design", vector, -1.0, 1.0),
        _numbers(options, "tensions", pairs, np.nextafter(0.0, 1.0), 1e12),
        _numbers(options, "forces", pairs, -1e12, 1e12),
    )
    if fixed.target_design is not None:
        _check_valid(fixed.target_design, task)
    return fixed


def _numbers(options: Mapping[str, Any], key: str, shape: tuple[int, ...], low: float, high: float) -> Array | None:
    if key not in options:
        return None
    within = "above 0" if low > 0 else f"in [{low:g}, {high:g}]"
    what, allowed = f"options[{key!r}]", f"numbers {within} of shape {shape}"
    numbers = as_floats(what, options[key], allowed)
    if numbers.shape != shape or not np.all((low <= numbers) & (numbers <= high)):
        raise InvalidInput(what, options[key], allowed)
    return numbers


def _check_valid(design: Array, task: DesignTask) -> None:
    margins = task.margins(design)
    worst = int(margins.argmin())
    if margins[worst] < 0:
        what = f"margin {MARGINS[worst]!r} of options['target_design']"
        raise InvalidInput(what, float(margins[worst]), "0 or more", "Take a valid design, see DesignSpace.margins.")
