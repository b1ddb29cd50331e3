"""Packets of Dynamixel Protocol 2.0, written from its description.

FF FF FD 00, id, length (2 bytes), instruction, parameters, CRC-16 (2 bytes), low bytes first; the length counts the
bytes after it. In instruction and parameters another FD follows each FF FF FD ("stuffing"). The CRC has the polynomial
0x8005, begins at 0 and covers everything before it.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntEnum

HEADER, PATTERN = b"\xff\xff\xfd\x00", b"\xff\xff\xfd"
BROADCAST = 0xFE
STATUS = 0x55
ALERT = 0x80  # bit of a status packet's error
_LONGEST = 1024
_CRC = 0x8005


class Instruction(IntEnum):
    """Instructions that simulated servos obey."""

    PING = 0x01
    READ = 0x02
    WRITE = 0x03
    REBOOT = 0x08
    SYNC_READ = 0x82
    SYNC_WRITE = 0x83


class ErrorNumber(IntEnum):
    """Errors of status packets."""

    NONE = 0
    RESULT_FAIL = 1
    INSTRUCTION = 2
    CRC = 3
    DATA_RANGE = 4
    DATA_LENGTH = 5
    DATA_LIMIT = 6
    ACCESS = 7


def _table() -> tuple[int, ...]:
    rows = []
    for byte in range(256):
        value = byte << 8
        for _ in range(8):
            value = ((value << 1) ^ _CRC if value & 0x8000 else value << 1) & 0xFFFF
        rows.append(value)
    return tuple(rows)


_TABLE = _table()


def crc16(content: bytes) -> int:
    """The CRC of bytes."""
    value = 0
    for byte in content:
        value = ((value << 8) & 0xFFFF) ^ _TABLE[(value >> 8) ^ byte]
    return value


def packet(ident: int, instruction: int, parameters: bytes = b"") -> bytes:
    """The bytes of a packet."""
    body = (bytes([instruction]) + parameters).replace(PATTERN, PATTERN + b"\xfd")
    content = HEADER + bytes([ident]) + struct.pack("<H", len(body) + 2) + body
    return content + struct.pack("<H", crc16(content))


def status(ident: int, error: int, parameters: bytes = b"") -> bytes:
    """The bytes of a status packet."""
    return packet(ident, STATUS, bytes([error]) + parameters)


@dataclass(frozen=True)
class Packet:
    """A received packet; intact: whether its CRC is right."""

    ident: int
    instruction: int
    parameters: bytes
    intact: bool


class PacketStream:
    """Packets out of a stream of bytes, with garbage between them left out."""

    def __init__(self) -> None:
        self._rest = bytearray()

    def feed(self, content: bytes) -> list[Packet]:
        """The packets that these bytes complete."""
        self._rest += content
        packets = []
        while (one := self._take()) is not None:
            packets.append(one)
        return packets

    def _take(self) -> Packet | None:
        while True:
            at = self._rest.find(HEADER)
            if at < 0:
                del self._rest[: max(len(self._rest) - 3, 0)]  # a header may have begun
                return None
            del self._rest[:at]
            if len(self._rest) < 7:
                return None
            (length,) = struct.unpack_from("<H", self._rest, 5)
            if not 3 <= length <= _LONGEST:
                del self._rest[:4]
                continue
            if len(self._rest) < 7 + length:
                return None
            raw = bytes(self._rest[: 7 + length])
            del self._rest[: 7 + length]
            body = raw[7:-2].replace(PATTERN + b"\xfd", PATTERN)
            return Packet(raw[4], body[0], body[1:], struct.unpack("<H", raw[-2:])[0] == crc16(raw[:-2]))
