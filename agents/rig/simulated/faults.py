"""Faults of a simulated rig, on demand: on the wire, in motors, in load cells."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np


@dataclass
class Faults:
    """Probabilities per status packet, and what load cells do.

    Args:
        seed: of chance.
        lost, damaged, late, garbage: share of status packets. late_s: by how long [s of the wall].
        reversed_ids: whether servos answer in the other order. mute: ids that do not answer.
        echoed: whether the last answer of a servo comes again before each.
        cells: "", "nan", "silent", "frozen" or "damaged".
    """

    seed: int = 0
    lost: float = 0.0
    damaged: float = 0.0
    late: float = 0.0
    late_s: float = 0.02
    garbage: float = 0.0
    reversed_ids: bool = False
    mute: set[int] = field(default_factory=set)
    echoed: bool = False
    cells: str = ""
    counts: Counter[str] = field(default_factory=Counter)

    def __post_init__(self) -> None:
        self._rng = np.random.default_rng(self.seed)
        self._last: dict[int, bytes] = {}

    def _happens(self, name: str, share: float) -> bool:
        happened = share > 0.0 and bool(self._rng.random() < share)
        self.counts[name] += happened
        return happened

    def sent(self, ident: int, raw: bytes) -> tuple[bytes, float] | None:
        """What goes out in place of a status packet, and how late [s]; None: nothing."""
        raw, self._last[ident] = (self._last.get(ident, b"") if self.echoed else b"") + raw, raw
        if ident in self.mute or self._happens("lost", self.lost):
            return None
        if self._happens("damaged", self.damaged):
            place, bit = int(self._rng.integers(4, len(raw))), 1 << int(self._rng.integers(8))
            raw = raw[:place] + bytes([raw[place] ^ bit]) + raw[place + 1 :]
        if self._happens("garbage", self.garbage):
            raw = self._rng.bytes(int(self._rng.integers(1, 9))) + raw
        return raw, self.late_s if self._happens("late", self.late) else 0.0

    def weighed(self, line: bytes, last: bytes) -> bytes | None:
        """The line of a load-cell amplifier in place of this one; last: the one before."""
        if self.cells == "silent":
            return None
        if self.cells == "frozen":
            return last
        if self.cells == "damaged":
            return line[:2] + b"9" + line[3:] if len(line) > 3 else line
        return line
