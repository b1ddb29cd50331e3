"""One line of the speed page: what was measured, its target, and its peers in the same run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from speed_rows.timing import Timing

UNITS = {"ns": 1e-9, "µs": 1e-6, "ms": 1e-3, "s": 1.0}
HEAD = (
    "| what | value | target | limit | compared with | its value | times faster | sample |\n"
    "|---|--:|---|---|---|--:|--:|---|"
)
LIMIT = "limit"  # of all runners of a race, the one that does the least work that must be done


@dataclass(frozen=True)
class Target:
    """A bound that the value should keep: at most it, or at least it."""

    bound: float
    at_least: bool = False

    def met(self, value: float) -> bool:
        """Whether the value keeps the bound."""
        return value >= self.bound if self.at_least else value <= self.bound

    def text(self, value: float | None, unit: str) -> str:
        """The bound, and whether the value meets it."""
        bound = f"{'≥' if self.at_least else '≤'} {quantity(self.bound, unit)}"
        if value is None:
            return bound
        return f"{bound}: {'met' if self.met(value) else '**missed**'}"


@dataclass(frozen=True)
class Peer:
    """What a value is compared with, in the same unit; without a value, the note says why."""

    name: str
    value: float | None
    note: str = ""
    sample: str = ""


@dataclass(frozen=True)
class Row:
    """One measured value, in `unit`; without a value, the note says why. A unit that ends in /s is a rate."""

    what: str
    value: float | None
    unit: str
    sample: str = ""
    target: Target | None = None
    peers: tuple[Peer, ...] = ()
    note: str = ""
    limit: float | None = None  # the value of the bare kernel

    @property
    def missed(self) -> bool:
        """True for a value that misses its target."""
        return self.value is not None and self.target is not None and not self.target.met(self.value)

    def best(self, other: Row) -> Row:
        """The faster of two measurements of one thing, ours and every peer's; this one where the unit is no speed."""
        assert self.what == other.what and [peer.name for peer in self.peers] == [peer.name for peer in other.peers]
        if not _is_speed(self.unit):
            return self
        faster = other if _faster(other.value, self.value, self.unit) else self
        pairs = zip(self.peers, other.peers, strict=True)
        peers = tuple(b if _faster(b.value, a.value, self.unit) else a for a, b in pairs)
        limit = other.limit if _faster(other.limit, self.limit, self.unit) else self.limit
        return replace(faster, peers=peers, limit=limit)

    def times_faster(self, peer: Peer) -> float | None:
        """How many times faster this is than a peer; None where either is missing."""
        if not self.value or not peer.value:
            return None
        return self.value / peer.value if self.unit.endswith("/s") else peer.value / self.value

    def markdown(self) -> str:
        """Lines of a table under HEAD: one for the row, which holds the first peer, and one for each other peer."""
        value = quantity(self.value, self.unit) if self.value is not None else "–"
        target = self.target.text(self.value, self.unit) if self.target else ""
        ours = ". ".join(filter(None, [self.sample, self.note]))
        head = f"| {self.what} | {value} | {target} | {self._limit_cell()} |"
        if not self.peers:
            return f"{head} | | | {ours} |"
        first, *others = self.peers
        both = ours if first.sample in ("", self.sample) else f"{ours}; peer: {first.sample}"
        lines = [f"{head} {self._peer_cells(first)} | {both} |"]
        return "\n".join([*lines, *(f"| | | | | {self._peer_cells(peer)} | {peer.sample} |" for peer in others)])

    def _limit_cell(self) -> str:
        if not self.limit or not self.value:
            return ""
        above, ratio = self.unit.endswith("/s"), self.value / self.limit
        return f"{quantity(self.limit, self.unit)}, × {number(1.0 / ratio if above else ratio)}"

    def _peer_cells(self, peer: Peer) -> str:
        name = f"{peer.name} ({peer.note})" if peer.note else peer.name
        if peer.value is None:
            return f"{name} | – |"
        ratio = self.times_faster(peer)
        return f"{name} | {quantity(peer.value, self.unit)} | {'' if ratio is None else number(ratio)}"


def timed_row(
    what: str,
    unit: str,
    timings: Mapping[str, Timing | str],
    target: Target | None = None,
    note: str = "",
    peer_notes: Mapping[str, str] | None = None,
) -> Row:
    """The row of a race whose first runner is ours; the others are its peers, and one may be the LIMIT.

    In place of a timing a text says why a runner did not run.
    """
    limit = timings.get(LIMIT)
    (_, ours), *others = ((name, timing) for name, timing in timings.items() if name != LIMIT)
    notes = peer_notes or {}
    peers = [
        Peer(name, None, timing)
        if isinstance(timing, str)
        else Peer(name, in_unit(timing.seconds, unit), notes.get(name, ""), timing.sample)
        for name, timing in others
    ]
    if isinstance(ours, str):
        return Row(what, None, unit, "", target, tuple(peers), ours)
    least = in_unit(limit.seconds, unit) if isinstance(limit, Timing) else None
    return Row(what, in_unit(ours.seconds, unit), unit, ours.sample, target, tuple(peers), note, least)


def _is_speed(unit: str) -> bool:
    return unit in UNITS or unit.endswith("/s")


def _faster(value: float | None, than: float | None, unit: str) -> bool:
    """Whether a value is there and is faster."""
    if value is None or than is None:
        return value is not None
    return value > than if unit.endswith("/s") else value < than


def in_unit(seconds: float, unit: str) -> float:
    """A time per piece of work as a time or, where the unit ends in /s, as a rate."""
    return 1.0 / seconds if unit.endswith("/s") else seconds / UNITS[unit]


def quantity(value: float, unit: str) -> str:
    """A number with its unit; times in the unit that suits them."""
    if unit in UNITS:
        seconds = value * UNITS[unit]
        unit = next((name for name in reversed(UNITS) if abs(seconds) >= UNITS[name]), "ns")
        value = seconds / UNITS[unit]
    return f"{number(value)} {unit}".strip()


def number(value: float) -> str:
    """Three significant digits; millions as M."""
    if abs(value) >= 999_500:
        return f"{value / 1e6:.3g} M"
    if abs(value) >= 999.5:
        digits = 3 - len(str(int(abs(value))))
        return f"{round(value, digits):,.0f}"
    return f"{value:.3g}"
