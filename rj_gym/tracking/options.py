"""Options of `reset` that hold something of a tracking task fixed, checked before anything changes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rj_gym.core.arguments import checked_keys, finite_floats
from rj_gym.tracking.config import TaskConfig
from rj_gym.tracking.sensing import LARGEST_LIMIT, LARGEST_PLAY, LARGEST_SHEATH
from rollingjoint.checks import as_integer
from rollingjoint.errors import InvalidInput
from rollingjoint.friction import LARGEST_MU
from rollingjoint.io.mechanism_file import load_mechanism
from rollingjoint.load import link_index

Array = NDArray[np.float64]

OPTIONS = (
    "target",
    "load",
    "mechanism",
    "start",
    "friction",
    "actuator_offsets",
    "play_mm",
    "sheath_friction",
    "tension_limit",
)
ARM_OPTIONS = ("target", "load", "gravity", *OPTIONS[2:])

LARGEST_OFFSET = 20.0  # mm, of a motor

LOWEST_LIMIT = 0.1  # N, of a motor

_RANGES = (  # option, field, largest value
    ("play_mm", "play", LARGEST_PLAY),
    ("sheath_friction", "sheath_friction", LARGEST_SHEATH),
)
_ROTATION = 1e-6  # how far a target's rotation matrix may be from one
_WITH = "Make one with friction={'mu': 0.1}."


@dataclass(frozen=True)
class TrackingOptions:
    """Values that a reset fixes, the same in every lane; None is drawn.

    Shapes as in PlanarDraws, ArmDraws and HardwareDraws without the lane axis. A fixed mechanism is not randomised.
    """

    mechanism: Any = None
    targets: Array | None = None
    start_tensions: Array | None = None
    friction_mu: Array | None = None
    actuator_offsets: Array | None = None
    play: Array | None = None
    sheath_friction: Array | None = None
    tension_limits: Array | None = None
    links: int | None = None
    forces: Array | None = None
    gravity: Array | None = None
    payloads: Array | None = None


NOTHING_FIXED = TrackingOptions()


def checked_options(options: Mapping[str, Any] | None, config: TaskConfig, nominal: Any) -> TrackingOptions:
    """Values that the options fix.

    Args:
        options: any of "target": (d,) or (T + 1, d) [mm], with `orientation` poses (4, 4) or (T + 1, 4, 4); "load":
            {"link": link, "force": (2,) or (T + 1, 2) [N]}, of arms the payload, a number or (T + 1,) [N]; "gravity",
            of arms: its direction (3,); "mechanism": preset name, file or mechanism with the links and tendons of
            the nominal one; "start": tensions (m,) [N] within the tension range; "friction": coefficients, a number or
            (m,); "actuator_offsets" [mm], "play_mm", "sheath_friction" and "tension_limit" [N] likewise.
        config: the settings.
        nominal: the mechanism before randomisation.
    Raises:
        InvalidInput: an unknown key or a value that cannot be used.
    """
    if options is None:
        return NOTHING_FIXED
    checked_keys(options, OPTIONS if config.DIMENSION == 2 else ARM_OPTIONS)
    fixed: dict[str, Any] = {}
    if "mechanism" in options:
        fixed["mechanism"] = _like_mechanism(options["mechanism"], nominal, config)
    if "start" in options:
        fixed["start_tensions"] = _start_tensions(options["start"], config, nominal.n_tendons)
    if "friction" in options:
        fixed["friction_mu"] = _friction_mu(options["friction"], config, nominal)
    fixed |= _motors(options, config, nominal.n_tendons)
    if "target" in options:
        fixed["targets"] = _targets(options["target"], config)
    if "load" in options:
        fixed |= _load(options["load"], config, nominal)
    if "gravity" in options:
        fixed["gravity"] = _direction(options["gravity"])
    return TrackingOptions(**fixed)


def _targets(value: object, config: TaskConfig) -> Array:
    """Targets over time, (T + 1, d), with orientation (T + 1, 12); one row for the whole episode."""
    times = config.episode_steps + 1
    if config.orientation:
        return _poses(value, times)
    return vector_series("options['target']", value, "xyz"[: config.DIMENSION], times, "mm")


def _load(value: object, config: TaskConfig, nominal: Any) -> dict[str, Any]:
    """The load, fields of TrackingOptions."""
    times = config.episode_steps + 1
    if config.DIMENSION == 3:
        return {"payloads": _payloads(value, times)}
    link, forces = _force(value, nominal.n_links, times)
    return {"links": link, "forces": forces}


def _like_mechanism(value: object, nominal: Any, config: TaskConfig) -> Any:
    """The mechanism of an option; InvalidInput unless it has the nominal one's numbers of links and tendons."""
    mechanism: Any = value
    if isinstance(value, str):
        mechanism = load_mechanism(value, config.MECHANISM)
    if not isinstance(mechanism, config.MECHANISM):
        raise InvalidInput("options['mechanism']", value, config.MECHANISMS)
    counts, expected = _counts(mechanism), _counts(nominal)
    if counts != expected:
        raise InvalidInput(
            "options['mechanism'] (links, tendons)", counts, f"{expected}", "Make an environment with this mechanism."
        )
    if mechanism.has_friction and not config.has_friction(nominal):
        raise InvalidInput("options['mechanism'] has friction", True, "False in an environment without it", _WITH)
    return mechanism


def _counts(mechanism: Any) -> tuple[int, int]:
    return mechanism.n_links, mechanism.n_tendons


def _start_tensions(value: object, config: TaskConfig, n_tendons: int) -> Array:
    """The tensions of an option, (m,); InvalidInput unless they are within the tension range."""
    tensions = finite_floats("options['start']", value)
    low, high = config.tension_range
    if tensions.shape != (n_tendons,) or np.any(tensions < low) or np.any(tensions > high) or np.any(tensions <= 0):
        raise InvalidInput("options['start']", value, f"{n_tendons} tensions > 0 within [{low:g}, {high:g}] N")
    return tensions


def _friction_mu(value: object, config: TaskConfig, nominal: Any) -> Array:
    """The coefficients of friction of an option, (m,); InvalidInput for others, and where there is no friction."""
    if not config.has_friction(nominal):
        raise InvalidInput("options['friction']", value, "only in an environment with friction", _WITH)
    return _per_tendon("options['friction']", value, nominal.n_tendons, 0.0, LARGEST_MU)


def _motors(options: Mapping[str, Any], config: TaskConfig, n_tendons: int) -> dict[str, Any]:
    """Values of motors that options fix, fields of TrackingOptions; InvalidInput where the settings leave them out."""
    fixed: dict[str, Any] = {}
    if "tension_limit" in options:
        what, limits = "options['tension_limit']", options["tension_limit"]
        if not config.actuation.limits_vary:
            hint = "Make one with actuation={'tension_limit': [10, 30]}."
            raise InvalidInput(what, limits, "only in an environment with actuation.tension_limit", hint)
        fixed["tension_limits"] = _per_tendon(what, limits, n_tendons, LOWEST_LIMIT, LARGEST_LIMIT)
    for key, name, largest in _RANGES:
        if key in options:
            what = f"options['{key}']"
            if getattr(config.actuation, key)[1] == 0:
                hint = f"Make one with actuation={{'{key}': [0, 0.5]}}."
                raise InvalidInput(what, options[key], f"only in an environment with {key}", hint)
            fixed[name] = _per_tendon(what, options[key], n_tendons, 0.0, largest)
    if "actuator_offsets" in options:
        what, offsets = "options['actuator_offsets']", options["actuator_offsets"]
        fixed["actuator_offsets"] = _per_tendon(what, offsets, n_tendons, -LARGEST_OFFSET, LARGEST_OFFSET)
    return fixed


def _per_tendon(what: str, value: object, n_tendons: int, low: float, high: float) -> Array:
    """Numbers of an option, (m,), from one or m; InvalidInput unless they are within [low, high]."""
    numbers = finite_floats(what, value)
    if numbers.shape not in ((), (n_tendons,)) or np.any(numbers < low) or np.any(numbers > high):
        raise InvalidInput(what, value, f"a number or {n_tendons} numbers from {low:g} to {high:g}")
    return np.array(np.broadcast_to(numbers, (n_tendons,)))


def vector_series(what: str, value: object, axes: str, times: int, unit: str) -> Array:
    """Finite vectors over time, (times, d), or (1, d): one for the whole episode; InvalidInput for anything else."""
    array, d = finite_floats(what, value), len(axes)
    if array.shape not in ((d,), (times, d)):
        allowed = f"({', '.join(axes)}) or an array of shape ({times}, {d}) over time [{unit}]"
        raise InvalidInput(what, value, allowed)
    return np.atleast_2d(array)


def _force(value: object, n_links: int, times: int) -> tuple[int, Array]:
    if not isinstance(value, Mapping) or set(value) != {"link", "force"}:
        raise InvalidInput("options['load']", value, "{'link': link, 'force': (fx, fy)} [N]")
    what, allowed = "options['load']['link']", f"a moving link, 1 to {n_links - 1} or -1 (the tip)"
    link = link_index(as_integer(what, value["link"], allowed=allowed), n_links)
    if link == 0:
        raise InvalidInput(what, value["link"], allowed)
    return link, vector_series("options['load']['force']", value["force"], "xy", times, "N")


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
