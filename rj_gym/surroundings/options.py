"""Options of `reset` that hold something of the tasks among walls fixed, checked before anything changes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rj_gym.core.arguments import checked_keys, finite_floats
from rollingjoint.checks import as_number
from rollingjoint.errors import InvalidInput
from rollingjoint.surroundings import Disc, HalfPlane, Lumen

Array = NDArray[np.float64]

LUMEN_OPTIONS, OBSTACLES_OPTIONS, WALL_OPTIONS = ("lumen", "depth"), ("discs", "target"), ("wall", "target")

MOST_PIECES = 16  # of the lumen of an option


def lumen_options(options: Mapping[str, Any] | None) -> dict[str, Any]:
    """Checked options of the lumen task: a "lumen" in place of a random one, the "depth" of the target in it [mm]."""
    fixed = dict(checked_keys(options, LUMEN_OPTIONS))
    if "lumen" in fixed and not (isinstance(fixed["lumen"], Lumen) and len(fixed["lumen"].lengths) <= MOST_PIECES):
        allowed = f"a rollingjoint.Lumen of at most {MOST_PIECES} pieces, the first of them straight"
        raise InvalidInput("options['lumen']", fixed["lumen"], allowed)
    if "depth" in fixed:
        fixed["depth"] = as_number("options['depth']", fixed["depth"], 0.0, 500.0)
    return fixed


def obstacles_options(options: Mapping[str, Any] | None, count: int) -> dict[str, Any]:
    """Checked options of the task among obstacles: "discs", as many as the settings have, and a "target" (2,) [mm]."""
    fixed = _with_target(options, OBSTACLES_OPTIONS)
    if "discs" in fixed:
        discs = fixed["discs"]
        if not isinstance(discs, list | tuple) or len(discs) != count or not all(isinstance(d, Disc) for d in discs):
            raise InvalidInput("options['discs']", discs, f"a list of {count} rollingjoint.Disc")
    return fixed


def wall_options(options: Mapping[str, Any] | None) -> dict[str, Any]:
    """Checked options of the task at a hidden wall: a "wall", a HalfPlane, and a "target" (2,) of the tip [mm]."""
    fixed = _with_target(options, WALL_OPTIONS)
    if "wall" in fixed and not isinstance(fixed["wall"], HalfPlane):
        raise InvalidInput("options['wall']", fixed["wall"], "a rollingjoint.HalfPlane")
    return fixed


def _with_target(options: Mapping[str, Any] | None, keys: tuple[str, ...]) -> dict[str, Any]:
    fixed = dict(checked_keys(options, keys))
    if fixed and len(fixed) < len(keys):
        raise InvalidInput("options", sorted(fixed), f"{' and '.join(keys)} together, or neither")
    if "target" in fixed:
        target: Array = finite_floats("options['target']", fixed["target"])
        if target.shape != (2,):
            raise InvalidInput("options['target']", fixed["target"], "two numbers x, y [mm]")
        fixed["target"] = target.copy()
    return fixed
