"""Dynamixel XM430-W350 behind the manufacturer's SDK, Protocol 2.0, in current-based position mode over many turns.

Faults of the SDK (4.1, Python) around which this driver is built: it drops the error byte of answers to synchronous
reads, and with it hardware errors; it gives up where servos answer in another order; answers have no number, so that a
late one is taken for the next, and cut to its length; a port stays "in use" after an exception or Ctrl-C; the pattern
FF FF FD, which goals beyond 32 turns contain, goes out unstuffed; it spins while it waits, by a clock that may be set.
"""

from __future__ import annotations

import math
import sys
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import dynamixel_sdk as dxl
import numpy as np
import serial
from numpy.typing import NDArray

from agents.rig.pace import LoopClock
from agents.rig.protocols import Array, BusLost, HardwareAlert, RigError, RigReading
from agents.rig.spool import Spools
from rollingjoint.checks import as_integer, as_number, as_positive
from rollingjoint.errors import ConfigError

MODEL = 1020  # XM430-W350, the only one that is promised
FASTEST_RPM = 46.0
AMPERE_PER_COUNT, NEWTON_METRE_PER_AMPERE = 2.69e-3, 1.78
MOST_TURNS = 31  # beyond 32 the SDK sends goals that no motor understands
WATCHDOG_UNIT, TRIPPED = 0.020, 0xFF
LEAST_WATCHDOG_STEPS = 3.0

_MODEL, _MODEL_SIZE = 0, 6  # with the four bytes behind it: no other part is as long
_RETURN_DELAY, _MODE, _CURRENT_POSITION = 9, 11, 5
_CURRENT_LIMIT, _TORQUE, _HARDWARE_ERROR, _WATCHDOG, _GOAL_CURRENT, _GOAL, _POSITION = 38, 64, 70, 98, 102, 116, 132
_FIRST, _SIZE = _TORQUE, 72  # the block of every reading: torque, error, watchdog, goal, counter, current, position
_TICK, _CURRENT = 120, 126
_ALERT, _CRC = 0x80, 3
_TICK_RANGE = 1 << 15  # the servo's counter of milliseconds
_RUN_OUT = 40  # ticks that a motor may be turned by its tendon until torque is on, which takes that place as its goal
_OLD_MS = 12.0  # by which an answer may lag behind the clock before it counts as one to an earlier question
_RETRIES = 2
PORT_ERRORS: tuple[type[Exception], ...] = (serial.SerialException, OSError, TypeError)
if sys.platform != "win32":
    import termios

    PORT_ERRORS = (*PORT_ERRORS, termios.error)  # of a cable that is pulled; pyserial lets it through


class _Port(dxl.PortHandler):
    """The SDK's port, which waits in the kernel, by a clock that nobody sets, and is free again after an exception."""

    blocking_s, sent = 0.002, 0
    latency_ms: float

    def setupPort(self, cflag_baud: Any) -> Any:  # noqa: N802 (the SDK's name)
        opened = super().setupPort(cflag_baud)
        self.ser.timeout = self.blocking_s
        return opened

    def getCurrentTime(self) -> float:  # noqa: N802
        return time.monotonic() * 1e3

    def setPacketTimeout(self, packet_length: int) -> None:  # noqa: N802
        self.packet_start_time = self.getCurrentTime()
        self.packet_timeout = self.tx_time_per_byte * packet_length + self.latency_ms

    def readPort(self, length: int) -> Any:  # noqa: N802
        return self._tried("reading", super().readPort, length)

    def writePort(self, packet: Any) -> Any:  # noqa: N802
        self.sent += len(packet)
        return self._tried("writing", super().writePort, packet)

    def clearPort(self) -> Any:  # noqa: N802
        return self._tried("clearing", super().clearPort)

    def _tried(self, what: str, function: Any, *arguments: Any) -> Any:
        try:
            return function(*arguments)
        except PORT_ERRORS as error:
            self.is_using = False
            raise BusLost(f"{what} {self.port_name}: {error}") from error


@dataclass(frozen=True)
class DynamixelSettings:
    """A bus of motors.

    Args:
        port: serial port. ids: of the motors, one per tendon. baud: rate.
        current_limit: tension at which motors pull no further by their limit of current [N]; None: as configured.
        watchdog_s: after which motors stop by themselves where nothing comes; 0: never. It must hold three steps.
    """

    port: str
    ids: Sequence[int]
    baud: int = 1_000_000
    current_limit: float | None = None
    watchdog_s: float = 0.4

    def __post_init__(self) -> None:
        for ident in self.ids:
            as_integer("ids", ident, 0, 252, error=ConfigError)
        if not self.ids or len(set(self.ids)) < len(self.ids):
            raise ConfigError("ids", list(self.ids), "different numbers from 0 to 252, one per tendon")
        as_number("watchdog_s", self.watchdog_s, 0.0, 127 * WATCHDOG_UNIT, error=ConfigError)
        if self.current_limit is not None:
            as_positive("current_limit", self.current_limit, "a tension above 0 [N], or nothing", ConfigError)


class Dynamixels:
    """Motors on a bus.

    Args:
        settings: of the bus. spools: of the motors. clock: of readings. step_s: of the loop, for the watchdog.
        patience_ms: with an answer.
    Raises:
        BusLost, HardwareAlert, RigError: a port or motors that cannot be used, after which nothing has moved.

    Attributes:
        counts: reads, retries, old answers, damaged ones, time-outs. ticks: of the last reading, (m,).
            currents: of it, in counts, (m,).
    """

    def __init__(
        self, settings: DynamixelSettings, spools: Spools, clock: LoopClock, step_s: float, patience_ms: float = 10.0
    ) -> None:
        self.settings, self.spools, self.clock = settings, spools, clock
        self.ids = list(settings.ids)
        if len(self.ids) != len(spools.signs):
            raise ConfigError("ids", self.ids, f"{len(spools.signs)}, one per spool")
        self._watchdog = round(settings.watchdog_s / WATCHDOG_UNIT)
        if 0 < settings.watchdog_s < LEAST_WATCHDOG_STEPS * step_s:
            least = math.ceil(LEAST_WATCHDOG_STEPS * step_s / WATCHDOG_UNIT) * WATCHDOG_UNIT
            hint = "A shorter one stops motors in every step, and nothing says so."
            raise ConfigError("watchdog_s", settings.watchdog_s, f"0, or {least:.2f} and more: three steps", hint)
        self.counts: Counter[str] = Counter()
        self.currents = np.zeros(len(self.ids), np.int64)
        self.ticks: NDArray[np.int64] | None = None
        self._read_at = 0.0
        self._counters: dict[int, tuple[int, float]] = {}
        self.handler = dxl.Protocol2PacketHandler()
        self.port = _Port(settings.port)
        self.port.latency_ms = patience_ms
        try:
            if not self.port.setBaudRate(settings.baud):
                raise BusLost(f"{settings.port}: no baud rate of {settings.baud}")
        except PORT_ERRORS as error:
            words = getattr(error, "strerror", None) or error
            raise BusLost(f"motors.port = {settings.port!r}: {words}; name the port of the motors") from error

    def connect(self) -> None:
        """Check every motor, and configure it; torque goes off only where the mode has to change."""
        self._drain()
        self._counters.clear()
        for ident in self.ids:
            self._check_model(ident)
            if error := self._block(ident)[_HARDWARE_ERROR - _FIRST]:
                raise HardwareAlert(f"motor {ident} has the hardware error {error:#04x}: find out why, then reboot it")
        for ident in self.ids:
            self._configure(ident)

    def _check_model(self, ident: int) -> None:
        try:
            model = int.from_bytes(self._asked_for(ident, _MODEL, _MODEL_SIZE)[:2], "little")
        except BusLost as error:
            raise BusLost(f"motor {ident} does not answer at {self.settings.port}: {error}") from error
        if model != MODEL:
            raise RigError(f"motor {ident} is model {model}; this driver knows {MODEL}, XM430-W350, alone")

    def _configure(self, ident: int) -> None:
        self._set(ident, _WATCHDOG, 1, 0)
        modes = self._modes(ident)
        for at, value in ((_RETURN_DELAY, 0), (_MODE, _CURRENT_POSITION)):
            if modes[at] != value:
                self._set(ident, _TORQUE, 1, 0)
                self._set(ident, at, 1, value)
        limit = int.from_bytes(self._asked_for(ident, _CURRENT_LIMIT, 2), "little")
        if self.settings.current_limit is not None:
            ampere = self.settings.current_limit * self.spools.radius_mm * 1e-3 / NEWTON_METRE_PER_AMPERE
            limit = min(limit, max(1, int(ampere / AMPERE_PER_COUNT)))
        goal = self._signed_in(self._block(ident), _POSITION, 4)
        self._set(ident, _GOAL, 4, goal)
        self._set(ident, _GOAL_CURRENT, 2, limit)
        self._set(ident, _TORQUE, 1, 1)
        self._set(ident, _WATCHDOG, 1, self._watchdog)
        block, modes = self._block(ident), self._modes(ident)
        for what, shown, value, margin in (
            ("mode", modes[_MODE], _CURRENT_POSITION, 0),
            ("goal", self._signed_in(block, _GOAL, 4), goal, _RUN_OUT),
            ("limit of current", self._signed_in(block, _GOAL_CURRENT, 2), limit, 0),
            ("torque", block[_TORQUE - _FIRST], 1, 0),
            ("watchdog", block[_WATCHDOG - _FIRST], self._watchdog, 0),
        ):
            if abs(shown - value) > margin:
                raise RigError(f"motor {ident} shows a {what} of {shown}, not {value}, after it was set")

    def _modes(self, ident: int) -> dict[int, int]:
        content = self._asked_for(ident, _RETURN_DELAY, _MODE + 1 - _RETURN_DELAY)
        return {at: content[at - _RETURN_DELAY] for at in (_RETURN_DELAY, _MODE)}

    def read(self) -> RigReading:
        """Positions [mm].

        Raises:
            HardwareAlert: an error, no torque, or a watchdog that has stopped a motor.
            RigError: positions that jumped: after a reboot the number of turns is lost.
            BusLost: no answer three times in a row.
        """
        before = self.counts["retries"]
        blocks = self._blocks(self.ids)
        now = self.clock.now()
        self._check(blocks)
        ticks = np.array([self._signed_in(blocks[ident], _POSITION, 4) for ident in self.ids])
        self.currents = np.array([self._signed_in(blocks[ident], _CURRENT, 2) for ident in self.ids])
        if self.ticks is not None:
            farthest = 1.5 * FASTEST_RPM / 60.0 * self.spools.ticks_per_turn * (now - self._read_at) + 40.0
            if (np.abs(ticks - self.ticks) > farthest).any():
                jump = (ticks - self.ticks).tolist()
                raise RigError(f"positions jumped by {jump} ticks: turns are lost after a reboot; home again")
        self.ticks, self._read_at = ticks, now
        return RigReading(self.spools.lengths(ticks), now, self.counts["retries"] - before)

    def _check(self, blocks: dict[int, bytes]) -> None:
        problems = []
        for ident, block in blocks.items():
            if error := block[_HARDWARE_ERROR - _FIRST]:
                problems.append(f"motor {ident} has the hardware error {error:#04x}")
            elif block[_WATCHDOG - _FIRST] == TRIPPED:
                problems.append(f"the watchdog has stopped motor {ident}")
            elif not block[_TORQUE - _FIRST]:
                problems.append(f"motor {ident} has no torque")
        if problems:
            raise HardwareAlert("; ".join(problems))

    def _block(self, ident: int) -> bytes:
        return self._asked_for(ident, _FIRST, _SIZE)

    def _asked_for(self, ident: int, at: int, size: int) -> bytes:
        return self._blocks([ident], at, size)[ident]

    def _blocks(self, ids: list[int], at: int = _FIRST, size: int = _SIZE) -> dict[int, bytes]:
        """A part of the table of every motor, whatever the order of answers; asked again where one is missing."""
        self.counts["reads"] += 1
        blocks: dict[int, bytes] = {}
        result = dxl.COMM_SUCCESS
        for _ in range(1 + _RETRIES):
            answered, result = self._asked(ids, at, size)
            blocks |= answered
            if len(blocks) == len(ids):
                return blocks
            self.counts["retries"] += 1
            self.counts["damaged" if result == dxl.COMM_RX_CORRUPT else "time-outs"] += 1
        missing = [ident for ident in ids if ident not in blocks]
        raise BusLost(f"motors {missing} did not answer {1 + _RETRIES} times: {self._words(result)}")

    def _asked(self, ids: list[int], at: int, size: int) -> tuple[dict[int, bytes], int]:
        """Answers have no number: only parts of unlike sizes are asked for, and the block tells its time."""
        blocks: dict[int, bytes] = {}
        self.port.is_using = False
        result = self.handler.syncReadTx(self.port, at, size, ids, len(ids), False)
        while result == dxl.COMM_SUCCESS and len(blocks) < len(ids):
            self.port.setPacketTimeout(size + 11)
            raw, result = self.handler.rxPacket(self.port, False)
            if result != dxl.COMM_SUCCESS:
                break
            ident, content = raw[4], bytes(raw[9 : 9 + size])
            if ident not in ids or raw[7] != 0x55 or raw[5] + 256 * raw[6] != size + 4:
                continue  # the answer to another question
            if at == _FIRST and self._is_old(ident, self._signed_in(content, _TICK, 2)):
                self.counts["old"] += 1
                continue
            blocks[ident] = content
        self.port.is_using = False
        return blocks, result

    def _is_old(self, ident: int, counter: int) -> bool:
        """Whether an answer is one to an earlier question, by the motor's own milliseconds."""
        now = self.clock.now()
        if ident in self._counters:
            first, then = self._counters[ident]
            passed = (counter - first + _TICK_RANGE // 2) % _TICK_RANGE - _TICK_RANGE // 2
            if (now - then) * 1e3 < _TICK_RANGE // 2 and (now - then) * 1e3 - passed > _OLD_MS:
                return True
        self._counters[ident] = counter, now
        return False

    def write(self, goals: Array) -> None:
        """Send goals [mm] to all motors at once; there is no answer. RigError for goals that cannot be sent."""
        if not np.isfinite(goals).all():
            raise RigError(f"goals {np.asarray(goals).tolist()} are not finite")
        ticks = self.spools.ticks(goals)
        if (np.abs(ticks) > MOST_TURNS * self.spools.ticks_per_turn).any():
            raise RigError(f"goals of {ticks.tolist()} ticks are beyond {MOST_TURNS} turns")
        self._send(ticks)

    def _send(self, ticks: NDArray[np.int64]) -> None:
        words: list[int] = []
        for ident, tick in zip(self.ids, ticks.tolist(), strict=True):
            words += [ident, *tick.to_bytes(4, "little", signed=True)]
        self.port.is_using = False
        result = self.handler.syncWriteTxOnly(self.port, _GOAL, 4, words, len(words))
        if result != dxl.COMM_SUCCESS:
            raise BusLost(f"goals could not be sent: {self._words(result)}")

    def hold(self) -> bool:
        """Goals where motors are, of each that answers; whether all were told."""
        try:
            self._drain()
        except RigError:
            return False
        held = True
        for ident in self.ids:
            try:
                held &= self._holds(ident)
            except RigError:
                held = False
        return held

    def _holds(self, ident: int) -> bool:
        """Give a motor its position as its goal; whether it shows it."""
        for _ in range(1 + _RETRIES):
            block = self._block(ident)
            if block[_HARDWARE_ERROR - _FIRST] or not block[_TORQUE - _FIRST]:
                return False  # it cannot hold
            if block[_WATCHDOG - _FIRST] == TRIPPED:
                return True  # it stands, and takes no goals
            at = self._signed_in(block, _POSITION, 4)
            self._set(ident, _GOAL, 4, at)
            if self._signed_in(self._block(ident), _GOAL, 4) == at:
                return True
        return False

    def release_watchdogs(self) -> None:
        """Let motors that their watchdogs have stopped take goals again, which are where they stand."""
        for ident in self.ids:
            self._set(ident, _WATCHDOG, 1, 0)
            self._set(ident, _GOAL, 4, self._signed_in(self._block(ident), _POSITION, 4))
            self._set(ident, _WATCHDOG, 1, self._watchdog)

    def reboot(self, ident: int) -> None:
        """Reboot a motor: torque goes, and its turns are lost, so that the rig has to be homed; BusLost: no answer."""
        self.port.is_using = False
        result, _ = self.handler.reboot(self.port, ident)
        if result != dxl.COMM_SUCCESS:
            raise BusLost(f"rebooting motor {ident}: {self._words(result)}")
        self.ticks = None
        self._counters.pop(ident, None)

    def close(self) -> None:
        """Leave the port. Motors go on holding, without watchdogs, which would not know that the loop has ended."""
        with suppress(RigError):  # a motor that is gone stays as it is
            for ident in self.ids:
                self._set(ident, _WATCHDOG, 1, 0)
        with suppress(*PORT_ERRORS):
            self.port.closePort()

    def _set(self, ident: int, at: int, size: int, value: int) -> None:
        content = list(int(value).to_bytes(size, "little", signed=value < 0))
        result, error = None, 0
        for _ in range(1 + _RETRIES):
            self.port.is_using = False
            result, error = self.handler.writeTxRx(self.port, ident, at, size, content)
            if result == dxl.COMM_SUCCESS and error & ~_ALERT != _CRC:
                break
            self.counts["retries"] += 1
            self._drain(0.005)
        if result != dxl.COMM_SUCCESS:
            raise BusLost(f"writing {at} of motor {ident}: {self._words(result)}")
        if error & _ALERT:
            raise HardwareAlert(f"writing {at} of motor {ident}: it reports a hardware error")
        if error:
            raise RigError(f"writing {at} of motor {ident}: {self.handler.getRxPacketError(error)}")

    def _drain(self, quiet: float = 0.01, longest: float = 0.5) -> None:
        """Read away what still comes: an answer has no number, and would be taken for the next."""
        self.port.is_using = False
        last = begun = time.monotonic()
        while time.monotonic() - begun < longest and time.monotonic() - last < quiet:
            if self.port.readPort(256):
                last = time.monotonic()

    def _words(self, result: int | None) -> str:
        return "" if result is None else str(self.handler.getTxRxResult(result)).replace("[TxRxResult] ", "")

    @staticmethod
    def _signed_in(block: bytes, at: int, size: int) -> int:
        return int.from_bytes(block[at - _FIRST : at - _FIRST + size], "little", signed=True)
