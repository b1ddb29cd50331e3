"""Named mechanisms of every family."""

from __future__ import annotations

from collections.abc import Callable

from rollingjoint.checks import as_choice
from rollingjoint.mechanism import AnyMechanism
from rollingjoint.planar.presets import five_link, two_segment, uniform
from rollingjoint.spatial.presets import flexible_arm, small_arm
from rollingjoint.statics.families import FAMILIES

__all__ = ["PRESETS", "five_link", "flexible_arm", "preset", "small_arm", "two_segment", "uniform"]

PRESETS: dict[str, Callable[[], AnyMechanism]] = {
    name: build for family in FAMILIES for name, build in family.presets.items()
}
"""What makes each of them, by its name."""


def preset(name: str) -> AnyMechanism:
    """The named mechanism with its default dimensions.

    Raises:
        InvalidInput: an unknown name.
    """
    return PRESETS[as_choice("preset", name, tuple(PRESETS))]()
