"""One simulated servo, by its control table: an XM430-W350 with the behaviour that its e-manual describes."""

from __future__ import annotations

import math
from enum import IntEnum

from agents.rig.simulated.protocol2 import ErrorNumber

TICKS = 4096  # per turn
MODEL, FIRMWARE = 1020, 46
AMPERE_PER_COUNT = 2.69e-3
NEWTON_METRE_PER_AMPERE = 1.78  # 4.1 N m stalled at 2.3 A
RPM_PER_COUNT, FASTEST_RPM = 0.229, 46.0  # unloaded at 12 V
WATCHDOG_UNIT = 0.020  # s
TRIPPED = 0xFF  # of the watchdog
MOST_TURNS = 256  # of a goal in extended position mode
OVERLOAD = 0x20
_EEPROM_END = 64


class At(IntEnum):
    """Addresses of the control table."""

    MODEL = 0
    FIRMWARE = 6
    ID = 7
    BAUD = 8
    RETURN_DELAY = 9
    MODE = 11
    CURRENT_LIMIT = 38
    HIGHEST = 48
    LOWEST = 52
    TORQUE = 64
    STATUS_RETURN = 68
    HARDWARE_ERROR = 70
    WATCHDOG = 98
    GOAL_CURRENT = 102
    PROFILE_VELOCITY = 112
    GOAL = 116
    TICK = 120
    MOVING = 122
    CURRENT = 126
    VELOCITY = 128
    POSITION = 132


POSITION_MODE, EXTENDED_MODE, CURRENT_MODE = 3, 4, 5  # the last is position with limited current, over many turns
_READ_ONLY = ((0, 7), (70, 1), (120, 4), (124, 23))
_GOALS = ((100, 2), (102, 2), (104, 4), (108, 4), (112, 4), (116, 4))


class Servo:
    """A servo.

    Args:
        ident: its id. ticks: where its horn stands. now: the time [s]. lag: time constant near the goal [s].

    Attributes:
        position: of the horn, in ticks, turns counted. heard: when a packet came for anybody [s].
        stopped: whether the watchdog has stopped it.
    """

    def __init__(self, ident: int, ticks: float, now: float, lag: float = 0.008) -> None:
        self.ident, self.position, self.lag, self.heard, self.stopped = ident, float(ticks), lag, now, False
        self.table = bytearray(256)
        first = {(At.MODEL, 2): MODEL, (At.FIRMWARE, 1): FIRMWARE, (At.ID, 1): ident, (At.BAUD, 1): 3}
        first |= {(At.RETURN_DELAY, 1): 250, (At.MODE, 1): POSITION_MODE, (At.CURRENT_LIMIT, 2): 1193}
        first |= {(At.HIGHEST, 4): 4095, (At.STATUS_RETURN, 1): 2, (At.GOAL_CURRENT, 2): 1193}
        for (at, size), value in first.items():
            self.put(at, size, value)
        self.put(At.GOAL, 4, round(self.position))
        self.put(At.POSITION, 4, round(self.position))

    def put(self, at: int, size: int, value: int) -> None:
        """Set an entry of the table."""
        self.table[at : at + size] = int(value).to_bytes(size, "little", signed=value < 0)

    def get(self, at: int, size: int, signed: bool = False) -> int:
        """An entry of the table."""
        return int.from_bytes(self.table[at : at + size], "little", signed=signed)

    @property
    def is_on(self) -> bool:
        """Whether it has torque."""
        return self.table[At.TORQUE] == 1

    @property
    def goal(self) -> int:
        """Its goal in ticks."""
        return self.get(At.GOAL, 4, signed=True)

    def write(self, at: int, content: bytes) -> ErrorNumber:
        """Obey a write; the error of its answer."""
        size = len(content)
        if _touches(at, size, _READ_ONLY) or (at < _EEPROM_END and self.is_on):
            return ErrorNumber.ACCESS
        if self.table[At.WATCHDOG] == TRIPPED and _touches(at, size, _GOALS):
            return ErrorNumber.DATA_RANGE
        if at == At.GOAL and size == 4:
            goal = int.from_bytes(content, "little", signed=True)
            low, high = self.get(At.LOWEST, 4), self.get(At.HIGHEST, 4)
            if self.table[At.MODE] != POSITION_MODE:
                low, high = -MOST_TURNS * TICKS, MOST_TURNS * TICKS
            if not low <= goal <= high:
                return ErrorNumber.DATA_LIMIT
        if at == At.TORQUE and content[0] == 1:
            if self.table[At.HARDWARE_ERROR]:
                return ErrorNumber.RESULT_FAIL
            if not self.is_on:
                self.put(At.GOAL, 4, round(self.position))
        self.table[at : at + size] = content
        if at == At.WATCHDOG:
            self.stopped = False
        return ErrorNumber.NONE

    def fail(self, bits: int = OVERLOAD) -> None:
        """A hardware error: torque goes, and every status packet says so until a reboot."""
        self.table[At.HARDWARE_ERROR] |= bits
        self.table[At.TORQUE] = 0

    def reboot(self) -> None:
        """Errors, torque and the number of turns are gone."""
        for at in (At.HARDWARE_ERROR, At.TORQUE, At.WATCHDOG):
            self.table[at] = 0
        self.stopped = False
        self.position %= TICKS
        self.put(At.GOAL, 4, round(self.position))

    def watch(self, now: float) -> None:
        """Let the watchdog stop it where nothing has been heard for too long."""
        patience = self.table[At.WATCHDOG]
        if self.is_on and 0 < patience < 128 and now - self.heard > WATCHDOG_UNIT * patience:
            self.table[At.WATCHDOG] = TRIPPED
            self.stopped = True

    def moved(self, duration: float) -> float:
        """Where the horn is after a while with torque: at a limited speed, then slowing down exponentially."""
        if not self.is_on or self.stopped:
            return self.position
        profile = self.get(At.PROFILE_VELOCITY, 4) * RPM_PER_COUNT or FASTEST_RPM
        speed = min(profile, FASTEST_RPM) / 60.0 * TICKS
        way = self.goal - self.position
        knee = speed * self.lag
        far = max(abs(way) - knee, 0.0)
        fast = min(duration, far / speed)
        rest = abs(way) - speed * fast
        return self.position + math.copysign(abs(way) - rest * math.exp(-(duration - fast) / self.lag), way)

    def force_limit(self, radius_mm: float) -> float:
        """The tension at which its current limit lets it pull no further [N]."""
        counts = self.get(At.CURRENT_LIMIT, 2)
        if self.table[At.MODE] == CURRENT_MODE:
            counts = min(counts, self.get(At.GOAL_CURRENT, 2))
        return counts * AMPERE_PER_COUNT * NEWTON_METRE_PER_AMPERE / (radius_mm * 1e-3)

    def tell(self, now: float, tension: float, sign: float, radius_mm: float, velocity: float) -> None:
        """Fill the readings of the table; velocity: in ticks per second."""
        counts = tension * radius_mm * 1e-3 / NEWTON_METRE_PER_AMPERE / AMPERE_PER_COUNT
        self.put(At.TICK, 2, int(now * 1e3) % 32768)
        self.put(At.CURRENT, 2, int(max(min(sign * counts, 32767), -32767)))
        self.put(At.VELOCITY, 4, int(velocity / TICKS * 60.0 / RPM_PER_COUNT))
        self.put(At.POSITION, 4, round(self.position))
        self.table[At.MOVING] = int(abs(self.goal - self.position) > 2)


def _touches(at: int, size: int, ranges: tuple[tuple[int, int], ...]) -> bool:
    return any(first < at + size and at < first + count for first, count in ranges)
