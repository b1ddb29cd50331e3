"""Servos and a load-cell amplifier on two pseudo-terminals, served by a thread, with a plant on the spools."""

from __future__ import annotations

import math
import os
import select
import struct
import threading
from collections.abc import Callable
from typing import Any

import numpy as np

from agents.rig.cells import cell_line
from agents.rig.pace import LoopClock
from agents.rig.protocols import Array
from agents.rig.simulated.faults import Faults
from agents.rig.simulated.plant import Plant
from agents.rig.simulated.protocol2 import ALERT, BROADCAST, ErrorNumber, Instruction, Packet, PacketStream, status
from agents.rig.simulated.servo import CURRENT_MODE, FIRMWARE, MODEL, TICKS, At, Servo

_HALVINGS = 10  # to where a current limit ends a pull
_RUNS_OUT = 40.0, 5.0  # mm/s at most, N for 1 mm: how a tendon turns a motor without torque


class SimulatedBus:
    """A bus with one servo per tendon of a plant, ids from 1, and an amplifier of load cells.

    Args:
        plant: on the spools. clock: of servos. radius_mm: of the spools. signs: 1 where rising ticks pull in, (m,);
            None: drawn. seed: of that, and of where horns stand.
        configured: whether servos have been in use: torque on, many turns, limited current.

    Attributes:
        port, cell_port: what the SDK and the driver of load cells open.
        faults: on demand. servos: by id. received: bytes that have come. alive: whether anybody answers.
        watched: functions that are called with (id, goal in ticks, servo) before a goal is taken.
    """

    def __init__(
        self,
        plant: Plant,
        clock: LoopClock,
        radius_mm: float = 10.0,
        signs: tuple[int, ...] | None = None,
        seed: int = 1,
        configured: bool = True,
    ) -> None:
        m, rng = len(plant.q), np.random.default_rng(seed)
        self.plant, self.clock, self.radius_mm = plant, clock, radius_mm
        self.signs = rng.choice([-1.0, 1.0], m) if signs is None else np.asarray(signs, float)
        self.servos = {1 + j: Servo(1 + j, int(rng.integers(0, TICKS)), clock.now()) for j in range(m)}
        if configured:
            for servo in self.servos.values():
                servo.put(At.MODE, 1, CURRENT_MODE)
                servo.put(At.RETURN_DELAY, 1, 0)
                servo.put(At.TORQUE, 1, 1)
        self.mm_per_tick = 2.0 * math.pi * radius_mm / TICKS
        self._origin, self._q0 = np.array([servo.position for servo in self.servos.values()]), plant.q.copy()
        self.faults, self.lock = Faults(seed), threading.RLock()
        self.watched: list[Callable[[int, int, Servo], None]] = []
        self._time, self.received, self._sequence, self._last_line = clock.now(), 0, 0, b""
        self._stream, self._cell_rest = PacketStream(), b""
        import pty  # Windows has none
        import tty

        (self._bus, bus_end), (self._cell, cell_end) = pty.openpty(), pty.openpty()
        self._bus_end, self._wake = bus_end, os.pipe()
        for end in (self._bus, bus_end, self._cell, cell_end):
            tty.setraw(end)
        self._open = {self._bus, bus_end, self._cell, cell_end, *self._wake}
        self.port, self.cell_port = os.ttyname(bus_end), os.ttyname(cell_end)
        self.alive = True
        self.plant.weighed()  # whatever has to compile does so before anybody asks
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def lengths(self, ticks: Array) -> Array:
        """Positions q of the plant [mm] at these ticks."""
        return np.asarray(self._q0 - self.signs * self.mm_per_tick * (ticks - self._origin))

    def advance(self) -> None:
        """Everything up to now: horns turn towards their goals, as far as speed and current let them."""
        now = self.clock.now()
        duration, self._time = now - self._time, now
        if duration <= 0.0:
            return
        servos = list(self.servos.values())
        before = np.array([servo.position for servo in servos])
        for servo in servos:
            servo.watch(now)
        after = np.array([self._turned(j, servo, duration) for j, servo in enumerate(servos)])
        saved = self.plant.saved()
        self.plant.move(self.lengths(after))
        limits = np.array([servo.force_limit(self.radius_mm) for servo in servos])
        pulls = self.signs * (after - before) > 0.0
        if (pulls & (self.plant.motor_tensions > limits)).any():
            after = self._stalled(before, after, limits, pulls, saved)
        for j, servo in enumerate(servos):
            servo.position = float(after[j])
        tensions = self.plant.motor_tensions
        for j, servo in enumerate(servos):
            velocity = (after[j] - before[j]) / duration
            servo.tell(now, float(tensions[j]), float(self.signs[j]), self.radius_mm, velocity)

    def _turned(self, j: int, servo: Servo, duration: float) -> float:
        if servo.is_on:
            return servo.moved(duration)
        fastest, force = _RUNS_OUT
        way = min(float(self.plant.motor_tensions[j]) / force, fastest * duration)
        return servo.position - float(self.signs[j]) * way / self.mm_per_tick

    def _stalled(self, before: Array, after: Array, limits: Array, pulls: Any, saved: Any) -> Array:
        """Ticks where motors that pull stop at their current limits, one after the other."""
        shares = np.ones(len(after))
        for j in np.flatnonzero(pulls):
            low, high = 0.0, 1.0
            for _ in range(_HALVINGS):
                shares[j] = 0.5 * (low + high)
                self.plant.restore(saved)
                self.plant.move(self.lengths(before + shares * (after - before)))
                low, high = (low, shares[j]) if self.plant.motor_tensions[j] > limits[j] else (shares[j], high)
            shares[j] = low if low < 1.0 - 2.0**-_HALVINGS else 1.0
        self.plant.restore(saved)
        at = before + shares * (after - before)
        self.plant.move(self.lengths(at))
        return np.asarray(at)

    def _serve(self) -> None:
        while self.alive:
            try:
                ready, _, _ = select.select([self._bus, self._cell, self._wake[0]], [], [], 0.5)
                if self._bus in ready:
                    content = os.read(self._bus, 4096)
                    with self.lock:
                        for one in self._stream.feed(content):
                            self._obey(one)
                        self.received += len(content)
                if self._cell in ready:
                    self._weigh(os.read(self._cell, 256))
            except OSError:
                return

    def _send(self, answers: list[tuple[int, bytes]]) -> None:
        for ident, raw in reversed(answers) if self.faults.reversed_ids else answers:
            outgoing = self.faults.sent(ident, raw)
            if outgoing is None:
                continue
            content, late = outgoing
            if late > 0.0:
                threading.Timer(late, self._write_late, (content,)).start()
            else:
                os.write(self._bus, content)

    def _write_late(self, content: bytes) -> None:
        if self.alive:
            try:
                os.write(self._bus, content)
            except OSError:
                return

    def _obey(self, one: Packet) -> None:
        servos = self.servos
        to = list(servos.values()) if one.ident == BROADCAST else [servos[one.ident]] if one.ident in servos else []
        if not one.intact:
            self._send([_answer(servo, ErrorNumber.CRC) for servo in to if one.ident != BROADCAST])
            return
        self.advance()
        for servo in servos.values():
            servo.heard = self._time
        given = one.parameters
        if one.instruction == Instruction.PING:
            self._send([_answer(servo, 0, struct.pack("<HB", MODEL, FIRMWARE)) for servo in to])
        elif one.instruction == Instruction.READ and len(given) == 4:
            at, size = struct.unpack("<HH", given)
            self._send([_answer(servo, 0, bytes(servo.table[at : at + size])) for servo in to])
        elif one.instruction == Instruction.WRITE and len(given) > 2:
            (at,) = struct.unpack_from("<H", given)
            answers = [_answer(servo, self._written(servo, at, given[2:])) for servo in to]
            self._send([] if one.ident == BROADCAST else answers)
        elif one.instruction == Instruction.SYNC_READ:
            at, size = struct.unpack_from("<HH", given)
            listed = [servos[ident] for ident in given[4:] if ident in servos]
            self._send([_answer(servo, 0, bytes(servo.table[at : at + size])) for servo in listed])
        elif one.instruction == Instruction.SYNC_WRITE:
            at, size = struct.unpack_from("<HH", given)
            for place in range(4, len(given), 1 + size):
                if given[place] in servos:
                    self._written(servos[given[place]], at, given[place + 1 : place + 1 + size])
        elif one.instruction == Instruction.REBOOT:
            self._send([_answer(servo, 0) for servo in to])
            for servo in to:
                servo.reboot()
        else:
            self._send([_answer(servo, ErrorNumber.INSTRUCTION) for servo in to])

    def _written(self, servo: Servo, at: int, content: bytes) -> int:
        if at == At.GOAL and len(content) == 4:
            for watch in self.watched:
                watch(servo.ident, int.from_bytes(content, "little", signed=True), servo)
        return servo.write(at, content)

    def _weigh(self, content: bytes) -> None:
        self._cell_rest += content
        while b"\n" in self._cell_rest:
            request, self._cell_rest = self._cell_rest.split(b"\n", 1)
            if request.strip() != b"R":
                continue
            with self.lock:
                self.advance()
                values = self.plant.weighed()
            if self.faults.cells == "nan":
                values[:] = np.nan
            self._sequence += 1
            line = cell_line(self._sequence, values)
            outgoing = self.faults.weighed(line, self._last_line)
            self._last_line = line if self.faults.cells != "frozen" else self._last_line
            if outgoing is not None:
                os.write(self._cell, outgoing)

    def unplug(self) -> None:
        """Pull the cable of the bus."""
        self.alive = False
        os.write(self._wake[1], b"x")
        self._thread.join(2.0)
        self._close(self._bus, self._bus_end)

    def close(self) -> None:
        """End the thread, and free the terminals."""
        self.alive = False
        if self._open:
            os.write(self._wake[1], b"x")
            self._thread.join(2.0)
            self._close(*self._open)

    def _close(self, *files: int) -> None:
        """Close those that are open: the number of a closed one may be another's by now."""
        for file in self._open.intersection(files):
            self._open.remove(file)
            os.close(file)


def _answer(servo: Servo, error: int, content: bytes = b"") -> tuple[int, bytes]:
    return servo.ident, status(servo.ident, error | (ALERT if servo.table[At.HARDWARE_ERROR] else 0), content)
