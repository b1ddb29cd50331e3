"""The springs that belong to a planar mechanism."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields, replace
from typing import Any

from rollingjoint.checks import as_number
from rollingjoint.errors import InvalidInput
from rollingjoint.load.kinds import SPRINGS, Load, in_words


def checked_springs(springs: object, n_links: int) -> tuple[Load, ...]:
    """The springs that belong to a planar mechanism, with plain numbers in their fields.

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
        for row in spring.rows(n_links):
            for column, value in row.items():
                as_number(f"springs[{i}] {column}", value)
        checked.append(
            replace(spring, **{each.name: _plain(each.type, getattr(spring, each.name)) for each in fields(spring)})
        )
    return tuple(checked)


def _plain(kind: object, value: Any) -> Any:
    """The value of a field of this annotation, in plain numbers."""
    if kind == "int":
        return int(value)
    return float(value) if kind == "float" else tuple(float(each) for each in value)
