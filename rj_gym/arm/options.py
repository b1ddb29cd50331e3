"""Options of `reset` that hold something of the arm's task fixed, checked before anything changes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rj_gym.arm.config import FlexibleArmConfig
from rj_gym.core.options import TrackingOptions, finite_floats, shared_options, vector_series
from rollingjoint.chain.hinge import HingeChain
from rollingjoint.errors import InvalidInput

Array = NDArray[np.float64]

OPTIONS = (
    "target",
    "load",
    "gravity",
    "mechanism",
    "start",
    "friction",
    "actuator_offsets",
    "play_mm",
    "sheath_friction",
)

_ROTATION = 1e-6  # how far a target's rotation matrix may be from one


@dataclass(frozen=True)
class ArmOptions(TrackingOptions):
    """Values that a reset fixes: see TrackingOptions, and the loads."""

    gravity: Array | None = None
    payloads: Array | None = None


NOTHING_FIXED = ArmOptions()


def checked_options(options: Mapping[str, Any] | None, config: FlexibleArmConfig, nominal: HingeChain) -> ArmOptions:
    """What the options hold fixed.

    Args:
        options: any of "target": (3,) or (T + 1, 3) [mm], with `orientation` poses (4, 4) or (T + 1, 4, 4); "load":
            payload, a number or (T + 1,) [N]; "gravity": its direction (3,); "mechanism": preset name, file or
            HingeChain with as many links and tendons as the nominal one; "start": tensions (m,) [N] within the
            tension range; "friction": coefficients, a number or (m,); "actuator_offsets" [mm], "play_mm" and
            "sheath_friction" likewise.
        config: the settings.
        nominal: the arm before randomisation.
    Raises:
        InvalidInput: an unknown key or a value that cannot be used.
    """
    if options is None:
        return NOTHING_FIXED
    times = config.episode_steps + 1
    fixed = shared_options(options, OPTIONS, config, nominal)
    if "target" in options and config.orientation:
        fixed["targets"] = _poses(options["target"], times)
    elif "target" in options:
        fixed["targets"] = vector_series("options['target']", options["target"], "xyz", times, "mm")
    if "load" in options:
        fixed["payloads"] = _payloads(options["load"], times)
    if "gravity" in options:
        fixed["gravity"] = _direction(options["gravity"])
    return ArmOptions(**fixed)


def _poses(value: object, times: int) -> Array:
    """Positions and rotation matrices row by row over time, (T + 1, 12) or (1, 12)."""
    array = finite_floats("options['target']", value)
    if array.shape not in ((4, 4), (times, 4, 4)):
        allowed = f"a pose (4, 4), or poses of shape ({times}, 4, 4) over time, with `orientation` [mm]"
        raise InvalidInput("options['target']", value, allowed)
    poses = array.reshape(-1, 4, 4)
    R = poses[:, :3, :3]
    turned = np.abs(R @ np.swapaxes(R, 1, 2) - np.eye(3)).max() < _ROTATION and np.all(np.linalg.det(R) > 0)
    if not turned or np.any(poses[:, 3] != (0, 0, 0, 1)):
        raise InvalidInput("options['target']", value, "rotation matrices, and last rows (0, 0, 0, 1)")
    return np.concatenate([poses[:, :3, 3], R.reshape(-1, 9)], axis=1)


def _payloads(value: object, times: int) -> Array:
    """Payloads over time, (T + 1,), or (1,): one for the whole episode."""
    array = finite_floats("options['load']", value)
    if array.shape not in ((), (times,)) or np.any(array < 0):
        raise InvalidInput("options['load']", value, f"a payload >= 0, or {times} of them over time [N]")
    return np.atleast_1d(array)


def _direction(value: object) -> Array:
    """A unit vector, (3,)."""
    array = finite_floats("options['gravity']", value)
    length = float(np.linalg.norm(array))
    if array.shape != (3,) or not 0 < length < np.inf:
        raise InvalidInput("options['gravity']", value, "a direction (x, y, z) other than (0, 0, 0)")
    return array / length
