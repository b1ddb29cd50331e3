"""Small rigs in software for tests: a plant without friction in its holes, the real SDK, a virtual clock."""

from contextlib import contextmanager

import numpy as np

from agents.rig.cells import SerialCells
from agents.rig.dynamixel import Dynamixels, DynamixelSettings
from agents.rig.guard import GuardSettings
from agents.rig.loop import Rig
from agents.rig.pace import VirtualClock
from agents.rig.simulated.bus import SimulatedBus
from agents.rig.simulated.plant import Plant
from agents.rig.spool import Spools
from rollingjoint import five_link

RADIUS = 10.0
GUARD = GuardSettings(high=20.0, stop=30.0)


class Built:
    """A bus, its clock, and what drives it."""

    def __init__(self, plant=None, seed=1, configured=True, patience_ms=60.0, **motor_options):
        self.clock, self.patience_ms = VirtualClock(), patience_ms
        self.plant = plant or Plant(five_link(), play=1.0, sheath=0.2, seed=seed)
        self.bus = SimulatedBus(self.plant, self.clock, RADIUS, (1, -1), seed, configured)
        ticks = tuple(round(servo.position) for servo in self.bus.servos.values())
        self.spools = Spools(RADIUS, (1, -1), ticks, tuple(self.plant.q))
        self.home, self.step_s, self.motor_options = self.plant.q.copy(), 0.05, motor_options
        self.motors = self.new_motors()

    def new_motors(self):
        settings = DynamixelSettings(self.bus.port, (1, 2), **self.motor_options)
        motors = Dynamixels(settings, self.spools, self.clock, self.step_s, patience_ms=self.patience_ms)
        self.clock.quiet = [lambda: not self.bus.alive or self.bus.received >= self.sent_before + motors.port.sent]
        self.sent_before = self.bus.received
        return motors

    def rig(self, guard=GUARD, **options):
        """The loop, motors connected."""
        self.motors.connect()
        self.cells = SerialCells(self.bus.cell_port, 2, self.clock, timeout=1e-3 * self.patience_ms)
        return Rig(self.motors, self.cells, self.clock, self.home, guard, **options)

    def wait(self, seconds):
        """Let time pass with nothing said."""
        self.clock.sleep_until(self.clock.now() + seconds)
        with self.bus.lock:
            self.bus.advance()

    @property
    def positions(self):
        """True lengths [mm] of the motors."""
        with self.bus.lock:
            self.bus.advance()
            return self.plant.q.copy()


@contextmanager
def built(**options):
    """A rig that is freed at the end."""
    one = Built(**options)
    try:
        yield one
    finally:
        one.motors.close()
        one.bus.close()


class Watched:
    """Commands that no rig should get, as the servos see them."""

    def __init__(self, one, guard=GUARD):
        self.one, self.guard, self.unsafe, self.seen = one, guard, [], 0
        self.last = {ident: one.bus.servos[ident].goal for ident in one.bus.servos}
        one.bus.watched.append(self)

    def __call__(self, ident, goal, servo):
        mm, sign = self.one.bus.mm_per_tick, self.one.bus.signs[ident - 1]
        here, self.seen = servo.position, self.seen + 1
        moved = min(abs(goal - self.last[ident]), abs(goal - here)) * mm
        if moved > self.guard.step_mm + 0.05:
            self.unsafe.append(f"motor {ident} jumps by {moved:.2f} mm")
        pulled = sign * (goal - self.last[ident]) * mm
        if pulled > 0.05 and (self.one.plant.motor_tensions > self.guard.stop + 3.0).any():
            self.unsafe.append(f"motor {ident} pulls by {pulled:.2f} mm at {self.one.plant.motor_tensions} N")
        away = abs(float(self.one.bus.lengths(np.array([goal, goal]))[ident - 1]) - self.one.home[ident - 1])
        if away > self.guard.travel_mm + 0.05:
            self.unsafe.append(f"motor {ident} goes {away:.1f} mm away")
        self.last[ident] = goal
