"""What `reset(options=...)` may hold fixed, checked before anything changes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rj_gym.core.config import TaskConfig, TrackingConfig
from rj_gym.planar.sampling import NOTHING_FIXED, Fixed
from rollingjoint.checks import as_floats
from rollingjoint.errors import InvalidInput
from rollingjoint.io.mechanism_file import load_mechanism
from rollingjoint.load import link_index
from rollingjoint.planar.chain import RollingChain

Array = NDArray[np.float64]

OPTIONS = ("target", "load", "mechanism", "start")


def checked_options(options: Mapping[str, Any] | None, config: TrackingConfig, nominal: RollingChain) -> Fixed:
    """What the options hold fixed.

    Args:
        options: any of "target": (2,) or (T + 1, 2) [mm]; "load": {"link": link, "force": (2,) or (T + 1, 2) [N]};
            "mechanism": preset name, file or RollingChain with as many links and tendons as the nominal one;
            "start": tensions (m,) [N] within the tension range.
    Raises:
        InvalidInput: an unknown key or a value that cannot be used.
    """
    if options is None:
        return NOTHING_FIXED
    check_keys(options, OPTIONS)
    times = config.episode_steps + 1
    fixed: dict[str, Any] = {}
    if "target" in options:
        fixed["targets"] = _series("options['target']", options["target"], times, "mm")
    if "load" in options:
        fixed["links"], fixed["forces"] = _load(options["load"], nominal.n_links, times)
    if "mechanism" in options:
        fixed["mechanism"] = like_mechanism(options["mechanism"], nominal, config)
    if "start" in options:
        fixed["start_tensions"] = start_option(options["start"], config, nominal.n_tendons)
    return Fixed(**fixed)


def check_keys(options: object, known: Sequence[str]) -> None:
    """Raise InvalidInput for options that are no dictionary with such keys."""
    if not isinstance(options, Mapping):
        raise InvalidInput("reset options", options, f"a dictionary with keys among {', '.join(known)}")
    for key in options:
        if key not in known:
            raise InvalidInput("reset options key", key, f"one of {', '.join(known)}")


def _load(value: object, n_links: int, times: int) -> tuple[int, Array]:
    if not isinstance(value, Mapping) or set(value) != {"link", "force"}:
        raise InvalidInput("options['load']", value, "{'link': link, 'force': (fx, fy)} [N]")
    link = value["link"]
    if isinstance(link, bool) or not isinstance(link, int | np.integer) or link_index(int(link), n_links) == 0:
        raise InvalidInput("options['load']['link']", link, f"a moving link, 1 to {n_links - 1} or -1 (the tip)")
    return link_index(int(link), n_links), _series("options['load']['force']", value["force"], times, "N")


def _series(what: str, value: object, times: int, unit: str) -> Array:
    """Finite (x, y) over time, (T + 1, 2), or (1, 2): one pair for the whole episode."""
    array = finite_floats(what, value)
    if array.shape not in ((2,), (times, 2)):
        raise InvalidInput(what, value, f"(x, y) or an array of shape ({times}, 2) over time [{unit}]")
    return np.atleast_2d(array)


def like_mechanism(value: object, nominal: Any, config: TaskConfig) -> Any:
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
    return mechanism


def _counts(mechanism: Any) -> tuple[int, int]:
    return mechanism.n_links, mechanism.n_tendons


def start_option(value: object, config: TaskConfig, n_tendons: int) -> Array:
    """The tensions of an option, (m,); InvalidInput unless they are within the tension range."""
    tensions = finite_floats("options['start']", value)
    low, high = config.tension_range
    if tensions.shape != (n_tendons,) or np.any(tensions < low) or np.any(tensions > high) or np.any(tensions <= 0):
        raise InvalidInput("options['start']", value, f"{n_tendons} tensions > 0 within [{low:g}, {high:g}] N")
    return tensions


def finite_floats(what: str, value: object) -> Array:
    """The values as an array; InvalidInput for anything but finite numbers."""
    array = as_floats(what, value, "numbers")
    if not np.all(np.isfinite(array)):
        raise InvalidInput(what, value, "finite numbers")
    return array
