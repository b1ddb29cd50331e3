"""The springs that belong to a mechanism."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields, replace
from typing import Any

from rollingjoint.checks import as_number
from rollingjoint.errors import InvalidInput
from rollingjoint.load.kinds import SPRINGS, Load, in_words


def checked_springs(springs: object, n_links: int, dimension: int) -> tuple[Load, ...]:
    """The springs that belong to a mechanism in 2 or 3 dimensions, with plain numbers in their fields.

    Raises:
        InvalidInput: another kind of load, a link that does not exist, a number that is negative or not finite.
    """
    kinds = in_words(*SPRINGS)
    if not isinstance(springs, Iterable):
        raise InvalidInput("springs", springs, f"a list of {kinds}")
    checked = []
    for i, spring in enumerate(springs):
        if not isinstance(spring, SPRINGS):
            raise InvalidInput(f"springs[{i}]", spring, kinds)
        as_number(f"springs[{i}] stiffness", spring.stiffness, 0.0)
        for row in spring.rows(n_links) if dimension == 2 else spring.spatial_rows(n_links):
            for column, value in row.items():
                as_number(f"springs[{i}] {column}", value)
        checked.append(
            replace(
                spring,
                **{each.name: _plain(each.type, getattr(spring, each.name), dimension) for each in fields(spring)},
            )
        )
    return tuple(checked)


def _plain(kind: object, value: Any, dimension: int) -> Any:
    """The value of a field of this annotation, in plain numbers."""
    if kind == "int":
        return int(value)
    if kind == "float":
        return float(value)
    point = tuple(float(each) for each in value)
    return point + (0.0,) * (dimension - len(point))  # the origin of a link is (0, 0) by default
