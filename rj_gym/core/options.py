"""Options of `reset` that hold something fixed, checked before anything changes: what every tracking task has."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rj_gym.core.config import TaskConfig
from rj_gym.core.sensing import LARGEST_PLAY, LARGEST_SHEATH
from rollingjoint.checks import as_floats
from rollingjoint.errors import InvalidInput
from rollingjoint.friction import LARGEST_MU
from rollingjoint.io.mechanism_file import load_mechanism

Array = NDArray[np.float64]

LARGEST = 1e12  # in millimetres and newtons; the solvers take no more

LARGEST_OFFSET = 20.0  # mm, of a motor

_RANGES = (  # option, field, largest value
    ("play_mm", "play", LARGEST_PLAY),
    ("sheath_friction", "sheath_friction", LARGEST_SHEATH),
)
_WITH = "Make one with friction={'mu': 0.1}."


@dataclass(frozen=True)
class TrackingOptions:
    """Values that a reset fixes, the same in every lane; None is drawn.

    Shapes as in TrackingDraws and HardwareDraws without the lane axis. A fixed mechanism is not randomised.
    """

    mechanism: Any = None
    targets: Array | None = None
    start_tensions: Array | None = None
    friction_mu: Array | None = None
    actuator_offsets: Array | None = None
    play: Array | None = None
    sheath_friction: Array | None = None


def checked_keys(options: Mapping[str, Any] | None, known: Sequence[str]) -> Mapping[str, Any]:
    """The options, empty for None; InvalidInput unless they are a dictionary with known keys."""
    if options is None:
        return {}
    if not isinstance(options, Mapping):
        raise InvalidInput("reset options", options, f"a dictionary with keys among {', '.join(known)}")
    for key in options:
        if key not in known:
            raise InvalidInput("reset options key", key, f"one of {', '.join(known)}")
    return options


def shared_options(
    options: Mapping[str, Any], known: Sequence[str], config: TaskConfig, nominal: Any
) -> dict[str, Any]:
    """What options of every tracking task hold fixed, fields of TrackingOptions; InvalidInput for others."""
    checked_keys(options, known)
    fixed: dict[str, Any] = {}
    if "mechanism" in options:
        fixed["mechanism"] = _like_mechanism(options["mechanism"], nominal, config)
    if "start" in options:
        fixed["start_tensions"] = _start_tensions(options["start"], config, nominal.n_tendons)
    if "friction" in options:
        fixed["friction_mu"] = _friction_mu(options["friction"], config, nominal)
    return fixed | _motors(options, config, nominal.n_tendons)


def _like_mechanism(value: object, nominal: Any, config: TaskConfig) -> Any:
    """The mechanism of an option; InvalidInput unless it has as many links and tendons as the nominal one."""
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
    """What options hold fixed of motors, fields of TrackingOptions; InvalidInput where there is nothing of the kind."""
    fixed: dict[str, Any] = {}
    for key, name, largest in _RANGES:
        if key in options:
            what = f"options['{key}']"
            if getattr(config.actuation, key)[1] == 0:
                hint = f"Make one with actuation={{'{key}': [0, 0.5]}}."
                raise InvalidInput(what, options[key], f"only in an environment with {key}", hint)
            fixed[name] = _per_tendon(what, options[key], n_tendons, 0.0, largest)
    if "actuator_offsets" in options:
        what, given = "options['actuator_offsets']", options["actuator_offsets"]
        fixed["actuator_offsets"] = _per_tendon(what, given, n_tendons, -LARGEST_OFFSET, LARGEST_OFFSET)
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


def finite_floats(what: str, value: object) -> Array:
    """The values as an array; InvalidInput for anything but numbers of size LARGEST at most."""
    array = as_floats(what, value, "numbers")
    if not np.all(np.abs(array) <= LARGEST):
        raise InvalidInput(what, value, f"finite numbers from -{LARGEST:g} to {LARGEST:g}")
    return array
