"""Options of `reset` that hold something of the planar task fixed, checked before anything changes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rj_gym.core.options import TrackingOptions, shared_options, vector_series
from rj_gym.planar.config import TrackingConfig
from rollingjoint.chain.rolling import RollingChain
from rollingjoint.checks import as_integer
from rollingjoint.errors import InvalidInput
from rollingjoint.load import link_index

Array = NDArray[np.float64]

OPTIONS = ("target", "load", "mechanism", "start", "friction", "actuator_offsets", "play_mm", "sheath_friction")


@dataclass(frozen=True)
class PlanarOptions(TrackingOptions):
    """Values that a reset fixes: see TrackingOptions, and the load."""

    links: int | None = None
    forces: Array | None = None


NOTHING_FIXED = PlanarOptions()


def checked_options(options: Mapping[str, Any] | None, config: TrackingConfig, nominal: RollingChain) -> PlanarOptions:
    """What the options hold fixed.

    Args:
        options: any of "target": (2,) or (T + 1, 2) [mm]; "load": {"link": link, "force": (2,) or (T + 1, 2) [N]};
            "mechanism": preset name, file or RollingChain with as many links and tendons as the nominal one;
            "start": tensions (m,) [N] within the tension range; "friction": coefficients, a number or (m,);
            "actuator_offsets" [mm], "play_mm" and "sheath_friction" likewise.
        config: the settings.
        nominal: the mechanism before randomisation.
    Raises:
        InvalidInput: an unknown key or a value that cannot be used.
    """
    if options is None:
        return NOTHING_FIXED
    times = config.episode_steps + 1
    fixed = shared_options(options, OPTIONS, config, nominal)
    if "target" in options:
        fixed["targets"] = vector_series("options['target']", options["target"], "xy", times, "mm")
    if "load" in options:
        fixed["links"], fixed["forces"] = _load(options["load"], nominal.n_links, times)
    return PlanarOptions(**fixed)


def _load(value: object, n_links: int, times: int) -> tuple[int, Array]:
    if not isinstance(value, Mapping) or set(value) != {"link", "force"}:
        raise InvalidInput("options['load']", value, "{'link': link, 'force': (fx, fy)} [N]")
    what, allowed = "options['load']['link']", f"a moving link, 1 to {n_links - 1} or -1 (the tip)"
    link = link_index(as_integer(what, value["link"], allowed=allowed), n_links)
    if link == 0:
        raise InvalidInput(what, value["link"], allowed)
    return link, vector_series("options['load']['force']", value["force"], "xy", times, "N")
