"""Checks of the fields of a design space; lists become tuples."""

from __future__ import annotations

from typing import Any

from rollingjoint.checks import as_boolean, as_choice, as_integer, as_number, as_range
from rollingjoint.errors import ConfigError

_ALLOWED = {  # name: smallest, largest, unit
    "convexity": (-1.0, 1.0, "1/mm"),
    "angle": (-1.5, 1.5, "rad"),
    "height": (0.1, 1000.0, "mm"),
    "half_width": (0.1, 1000.0, "mm"),
    "hole": (0.01, 1000.0, "mm"),
    "stiffness": (1e-6, 1e6, "N/mm"),
    "smallest_radius": (0.01, 1000.0, "mm"),
    "wall": (0.1, 1000.0, "mm"),
}
_NUMBERS = ("stiffness", "smallest_radius", "wall")

MOST_LINKS, MOST_KNOTS = 1000, 201


def checked(settings: dict[str, Any]) -> dict[str, Any]:
    """The fields of a design space, ranges as pairs of floats.

    Raises:
        ConfigError: a value that cannot be used.
    """
    values = dict(settings)
    allowed = f"2 to {MOST_LINKS} links, the base included"
    values["n_links"] = as_integer("n_links", settings["n_links"], 2, MOST_LINKS, allowed=allowed, error=ConfigError)
    odd = f"an odd number from 3 to {MOST_KNOTS}"
    knots = as_integer("knots", settings["knots"], 3, MOST_KNOTS, allowed=odd, error=ConfigError)
    if knots % 2 == 0:
        raise ConfigError("knots", knots, odd, f"Take {knots + 1}: one knot lies at s = 0.")
    values["knots"] = knots
    as_choice("curve", settings["curve"], ("linear", "cubic"), ConfigError)
    for name in ("symmetric", "alike"):
        as_boolean(name, settings[name], ConfigError)
    for name, (smallest, largest, unit) in _ALLOWED.items():
        if name in _NUMBERS:
            allowed = f"a number from {smallest:g} to {largest:g} {unit}"
            values[name] = as_number(name, settings[name], smallest, largest, allowed=allowed, error=ConfigError)
        else:
            values[name] = as_range(name, settings[name], smallest, largest, unit=unit, error=ConfigError)
    if values["symmetric"] and values["angle"] != (0.0, 0.0):
        raise ConfigError(
            "angle", settings["angle"], "(0, 0) for symmetric links", "Set symmetric to false, or angle to (0, 0)."
        )
    if values["hole"][0] + values["wall"] > values["half_width"][1]:
        raise ConfigError(
            "hole",
            settings["hole"],
            f"holes that can lie {values['wall']:g} mm (wall) inside the ends of the surfaces,"
            f" {values['half_width'][1] - values['wall']:g} mm or less",
            "Move the holes inwards, or widen half_width.",
        )
    ranges = [values[name] for name in _ALLOWED if name not in _NUMBERS]
    if all(low == high for low, high in ranges):
        raise ConfigError("ranges", ranges, "one or more with low < high", "A design space needs a dimension.")
    return values
