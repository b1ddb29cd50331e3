"""Load cells behind a serial amplifier that answers "R" with "sequence,newton,newton...*sum" in a line.

The sum is that of all bytes before the star, modulo 256, in hexadecimal.
"""

from __future__ import annotations

import numpy as np

from agents.rig.pace import LoopClock
from agents.rig.protocols import Array, BusLost, RigError, RigReading

MOST_BAD = 3  # answers in a row that may be missing or wrong


def cell_line(sequence: int, values: Array) -> bytes:
    """A line of the amplifier."""
    body = f"{sequence}," + ",".join(f"{value:.3f}" for value in values)
    return f"{body}*{sum(body.encode()) & 0xFF:02X}\n".encode()


def read_line(line: bytes, count: int) -> tuple[int, Array] | None:
    """Sequence number and values of a line; None for a line that is damaged or has values that are not finite."""
    body, star, check = line.strip().rpartition(b"*")
    try:
        if not star or sum(body) & 0xFF != int(check, 16):
            return None
        sequence, *values = body.decode("ascii").split(",")
        numbers = np.array([float(value) for value in values])
        return (int(sequence), numbers) if len(numbers) == count and np.isfinite(numbers).all() else None
    except ValueError:
        return None


class SerialCells:
    """The amplifier. A missing or wrong answer counts as the last one, with its time, up to three times in a row.

    Args:
        port: serial port. count: of load cells. clock: of readings. baud: rate. timeout: of an answer [s].
    """

    def __init__(self, port: str, count: int, clock: LoopClock, baud: int = 115_200, timeout: float = 0.02) -> None:
        from agents.rig.dynamixel import PORT_ERRORS  # isort: skip (it names the extra `rig`)
        import serial

        self._errors = PORT_ERRORS
        self.count, self.clock, self._bad = count, clock, 0
        self._last: RigReading | None = None
        self._sequence = -1
        try:
            self._port = serial.Serial(port, baud, timeout=timeout)
        except serial.SerialException as error:
            raise BusLost(f"load cells: {error.strerror or error}; is cells.port of the rig's file right?") from error

    def read(self) -> RigReading:
        """Tensions [N]; raises RigError after more than three wrong answers, BusLost without a port."""
        while (reading := self._tried()) is None:
            continue
        return reading

    def _tried(self) -> RigReading | None:
        """A reading; None before the first good answer, for which the amplifier is asked again."""
        try:
            self._port.reset_input_buffer()
            self._port.write(b"R\n")
            line: bytes = self._port.readline()
        except self._errors as error:
            raise BusLost(f"load cells: {error}") from error
        content = read_line(line, self.count)
        if content is None or content[0] == self._sequence:
            self._bad += 1
            if self._bad > MOST_BAD:
                raise RigError(f"load cells answer {line[:40]!r}, wrong or old for the {self._bad}th time in a row")
            return None if self._last is None else RigReading(self._last.values, self._last.t, self._bad)
        self._bad, self._sequence = 0, content[0]
        self._last = RigReading(content[1], self.clock.now())
        return self._last

    def close(self) -> None:
        """Leave the port."""
        self._port.close()
