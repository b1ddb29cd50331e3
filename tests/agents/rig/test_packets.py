"""Packets of Protocol 2.0 against the e-manual's example and the manufacturer's SDK; streams with garbage."""

import dynamixel_sdk as dxl
import numpy as np
import pytest

from agents.rig.cells import cell_line, read_line
from agents.rig.simulated.protocol2 import PATTERN, Instruction, PacketStream, packet, status


def test_the_ping_of_the_manual_has_these_bytes():
    assert packet(1, Instruction.PING).hex() == "fffffd0001030001194e"
    assert status(1, 0, bytes([0x06, 0x04, 0x26])).hex() == "fffffd000107005500060426655d"


class Recorded:
    """A port that keeps what is written."""

    is_using, content = False, b""

    def clearPort(self):  # noqa: N802
        pass

    def writePort(self, values):  # noqa: N802
        self.content = bytes(values)
        return len(values)


def test_packets_have_the_bytes_of_the_sdk_where_it_need_not_stuff():
    rng, port, handler = np.random.default_rng(0), Recorded(), dxl.Protocol2PacketHandler()
    for _ in range(300):
        ident, at, size = int(rng.integers(0, 253)), int(rng.integers(0, 200)), int(rng.integers(1, 9))
        content = rng.choice([0, 1, 0x7F, 0xFD, 0xFF], size).astype(int).tolist()
        port.is_using = False
        handler.writeTxOnly(port, ident, at, size, content)
        parameters = at.to_bytes(2, "little") + bytes(content)
        if PATTERN not in bytes([Instruction.WRITE]) + parameters:
            assert port.content == packet(ident, Instruction.WRITE, parameters)


def test_packets_are_found_in_pieces_between_garbage_and_stuffed_ones_come_out_as_they_were():
    rng, stream, sent, got = np.random.default_rng(1), PacketStream(), [], []
    content = b""
    for _ in range(300):
        parameters = bytes(rng.choice([0, 0xFD, 0xFF], int(rng.integers(0, 12))).astype(np.uint8))
        sent.append(parameters)
        content += rng.bytes(int(rng.integers(0, 4))).replace(b"\xff", b"\x00") + packet(
            7, Instruction.WRITE, parameters
        )
    while content:
        size = int(rng.integers(1, 30))
        got += stream.feed(content[:size])
        content = content[size:]
    assert [one.parameters for one in got] == sent and all(one.intact for one in got)
    (broken,) = PacketStream().feed(packet(1, Instruction.PING)[:-1] + b"\x00")
    assert not broken.intact


@pytest.mark.parametrize("line", [b"", b"1,2,3", b"1,2,3*00", b"1,nan,3*" + b"%02X" % (sum(b"1,nan,3") & 255), b"x*y"])
def test_damaged_lines_of_load_cells_are_none(line):
    assert read_line(line, 2) is None
    sequence, values = read_line(cell_line(9, np.array([1.5, 2.0])), 2)
    assert sequence == 9 and values.tolist() == [1.5, 2.0]
