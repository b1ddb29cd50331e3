"""Two records of one row beside each other: what differs, and whether the list of allowed differences has it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from guard_rows.record import ABSENT, Record

EXACT = (0.0, 0.0)
_NEAR = 1e-6  # an old value on the list is that of one machine; last bits differ on another


@dataclass
class Difference:
    """What differs in one field of a row: the first place, and over all places how many and how far."""

    row: str
    field: str
    case: str
    old: Any
    new: Any
    place: tuple[int, ...] = ()  # in the array of that case
    count: int = 1
    largest: float = float("inf")  # inf where numbers cannot be subtracted
    reason: str = ""  # why it is allowed

    @property
    def where(self) -> str:
        """The first place, in words."""
        return f"{self.case} {list(self.place)}" if self.place else self.case

    def __str__(self) -> str:
        off = "" if np.isinf(self.largest) else f", at most {self.largest:.3g} off"
        more = f" ({self.count:,} values{off})" if self.count > 1 else ""
        allowed = f" [allowed: {self.reason}]" if self.reason else ""
        return f"{self.field}: {self.old} -> {self.new} at {self.where}{more}{allowed}"


@dataclass
class Result:
    """What is reported of a row."""

    row: str
    sample: str
    differences: list[Difference] = field(default_factory=list)
    figure: str = ""  # of a timing: the ratio and its interval
    inputs: str = ""  # of the first difference, where they were drawn

    @property
    def ok(self) -> bool:
        """Whether every difference is allowed."""
        return all(one.reason for one in self.differences)


def compare(row: str, before: Record | None, after: Record | None) -> Result:
    """Every field of a row that differs."""
    if before is None or after is None:
        values = [ABSENT if one is None else f"{one.count:,} answers" for one in (before, after)]
        return Result(row, "", [Difference(row, "row", "the whole row", *values)])
    keys = [*before.arrays, *(key for key in after.arrays if key not in before.arrays)]
    found: dict[str, Difference] = {}
    for case, name in keys:
        limits = _limits(before.rule, name)
        if limits is None:
            continue
        values = (record.arrays.get((case, name)) for record in (before, after))
        for one in _differences(row, case, name, *values, limits, before.unsteady.get(case)):
            first = found.setdefault(name, one)
            if first is not one:
                first.count, first.largest = first.count + one.count, max(first.largest, one.largest)
    left_out = sum(int(rows.sum()) for rows in before.unsteady.values())
    sample = f"{before.count:,}" + (f", {left_out} unsteady left out" if left_out else "")
    return Result(row, sample, list(found.values()))


def _limits(rule: Mapping[str, Any] | None, name: str) -> tuple[float, float] | None:
    """How far a field may be off, absolute and relative; None if it is not compared."""
    if rule is None:
        return EXACT
    found = rule.get(name, rule.get("*"))
    return None if found is None else (found[0], found[1])


def _differences(
    row: str,
    case: str,
    name: str,
    old: NDArray[Any] | None,
    new: NDArray[Any] | None,
    limits: tuple[float, float],
    unsteady: NDArray[np.bool_] | None,
) -> Iterator[Difference]:
    """The difference of one field of one case, if there is one."""
    if old is None or new is None:
        yield Difference(row, name, case, *(ABSENT if one is None else _text(one) for one in (old, new)))
        return
    kinds = [f"{one.dtype} {one.shape}" for one in (old, new)]
    if old.shape != new.shape or (old.dtype != new.dtype and "U" not in (old.dtype.kind, new.dtype.kind)):
        yield Difference(row, name, case, *kinds)
        return
    apart, off = _apart(old, new, limits)
    if unsteady is not None and apart.ndim and len(apart) == len(unsteady):
        apart = apart & ~unsteady.reshape(-1, *[1] * (apart.ndim - 1))
    if apart.any():
        place = tuple(int(k) for k in np.argwhere(apart)[0])
        values = (_text(one[place]) for one in (old, new))
        yield Difference(row, name, case, *values, place, int(apart.sum()), float(np.max(off[apart])))


def _apart(old: NDArray[Any], new: NDArray[Any], limits: tuple[float, float]) -> tuple[NDArray[np.bool_], Any]:
    """Where two arrays of one shape differ by more than the limits, and how far; NaN equals NaN, 0 is not -0."""
    if old.dtype.kind != "f" or new.dtype.kind != "f":
        off = np.abs(new.astype(float) - old.astype(float)) if old.dtype.kind in "biu" else np.full(old.shape, np.inf)
        return np.asarray(old != new), off
    nothing = np.isnan(old) & np.isnan(new)
    with np.errstate(invalid="ignore"):
        off = np.where(nothing | (old == new), 0.0, np.abs(new - old))
    off = np.where(np.isnan(off), np.inf, off)
    if limits == EXACT:
        bits = f"i{old.dtype.itemsize}"
        return ~nothing & (np.array(old, order="C").view(bits) != np.array(new, order="C").view(bits)), off
    absolute, relative = limits
    return off > absolute + relative * np.abs(np.where(nothing, 0.0, old)), off


def _text(value: NDArray[Any]) -> Any:
    """A value as plain data: a number, a text, or the kind of an array."""
    return value.item() if value.ndim == 0 else f"{value.dtype} {value.shape}"


class Allowances:
    """The list of differences that are allowed: a YAML file, a list of mappings.

    Keys: `row`, `field` and `reason`; `old`, the first old value that differs; and either `new`, with `count` where
    more than one value differs, or `tolerance`, how far any value may be off. For a timing `limit` instead of these.
    """

    def __init__(self, path: Path) -> None:
        entries = yaml.safe_load(path.read_text("utf-8")) if path.exists() else None
        self.entries: list[dict[str, Any]] = entries or []
        self.used: list[int] = []
        for number, entry in enumerate(self.entries):
            needed = {"row", "reason", "limit"} if "limit" in entry else {"row", "field", "reason", "old"}
            if not needed <= entry.keys() or ("limit" in entry) + ("new" in entry) + ("tolerance" in entry) != 1:
                keys = "row, field, reason, old and one of new and tolerance; of a timing row, reason and limit"
                raise SystemExit(f"{path}: entry {number + 1} = {entry}: expected the keys {keys}.")

    def apply(self, result: Result) -> None:
        """Give the differences of a row that are allowed their reason."""
        for one in result.differences:
            for number, entry in enumerate(self.entries):
                if entry["row"] == one.row and entry.get("field") == one.field and _covers(entry, one):
                    one.reason = entry["reason"]
                    self.used.append(number)

    def limit(self, row: str, limit: float) -> tuple[float, str]:
        """The limit of a timing's row, and why it is another one than usual."""
        for number, entry in enumerate(self.entries):
            if entry["row"] == row and "limit" in entry:
                self.used.append(number)
                return float(entry["limit"]), entry["reason"]
        return limit, ""

    def unused(self, rows: set[str]) -> list[str]:
        """Entries of the rows that were compared which nothing needs any more."""
        left = [entry for k, entry in enumerate(self.entries) if k not in self.used and entry["row"] in rows]
        return [f"{entry['row']}: {entry.get('field', 'limit')} ({entry['reason']})" for entry in left]


def _covers(entry: Mapping[str, Any], one: Difference) -> bool:
    if not _alike(entry["old"], one.old):
        return False
    if "tolerance" in entry:
        return one.largest <= float(entry["tolerance"])
    return _alike(entry["new"], one.new) and one.count <= int(entry.get("count", 1))


def _alike(listed: Any, value: Any) -> bool:
    if isinstance(listed, int | float) and isinstance(value, int | float):
        return bool(np.isclose(listed, value, rtol=_NEAR, atol=0.0, equal_nan=True))
    return str(listed) == str(value)
