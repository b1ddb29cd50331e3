"""All families of mechanisms, and the family of a mechanism."""

from __future__ import annotations

import functools

from rollingjoint.errors import InvalidInput
from rollingjoint.family import Family
from rollingjoint.mechanism import AnyMechanism
from rollingjoint.planar.family import PLANAR
from rollingjoint.spatial.family import SPATIAL

FAMILIES = (PLANAR, SPATIAL)

KINDS = " or ".join(f"a {family.kind.__name__}" for family in FAMILIES)
"""The classes of mechanisms, for messages."""


def family_of(mechanism: AnyMechanism) -> Family:
    """The family of one mechanism.

    Raises:
        InvalidInput: no mechanism.
    """
    family = family_of_kind(type(mechanism))
    if family is None:
        raise InvalidInput("mechanism", mechanism, KINDS, "rollingjoint.preset(name) makes a named one.")
    return family


@functools.cache
def family_of_kind(kind: type) -> Family | None:
    """The family of a class of mechanisms, None for any other class."""
    return next((family for family in FAMILIES if issubclass(kind, family.kind)), None)
