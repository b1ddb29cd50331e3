"""The file of a rig (YAML, read strictly), and its calibration beside it (JSON)."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from agents.rig.guard import GuardSettings
from agents.rig.loop import Rig
from agents.rig.pace import LoopClock, VirtualClock, WallClock
from agents.rig.protocols import RigPoses
from agents.rig.spool import Spools
from agents.runs.checked_json import read_json
from agents.runs.files import write_text
from rollingjoint.chain.chain import AnyChain
from rollingjoint.checked_yaml import mapping, number, numbers, read_yaml, text
from rollingjoint.checks import as_boolean, as_integer, as_number, as_positive
from rollingjoint.errors import ConfigError
from rollingjoint.identify import RecordingWriter
from rollingjoint.io.mechanism_file import load_mechanism

KEYS = ("mechanism", "rate", "looks", "motors", "cells", "guard", "camera", "simulated", "offsets", "identified")
MOTOR_KEYS = ("port", "baud", "ids", "signs", "radius_mm", "current_limit", "watchdog_s")
CELL_KEYS = ("port", "baud")
CAMERA_KEYS = ("grab", "view", "balls", "diameter", "kind")
SIMULATED_KEYS = ("robot", "generation", "wall")
BAUDS = (9_600, 57_600, 115_200, 1_000_000, 2_000_000, 3_000_000, 4_000_000, 4_500_000)  # of XM430 motors
FASTEST = 200.0  # Hz: four looks in each step take 1 ms or more each, with two motors at 1 Mbaud
CALIBRATION, CALIBRATION_KEYS = ".calibration.json", ("zero_ticks", "zero_mm", "signs", "radius_mm", "tension")


@dataclass(frozen=True)
class RigSettings:
    """A rig, as its file says.

    Args:
        path: of the file. mechanism: as designed. rate: of steps [Hz]. looks: in each.
        motors, cells: their keys, MOTOR_KEYS and CELL_KEYS. guard: limits.
        offsets: true lengths minus those of the calibration, (m,) [mm]; of `offsets`, or of the folder `identified`.
        simulated: a robot of the development set in software, in place of ports; None: hardware.
        camera: keys of a camera for the tip, KEYS of rollingjoint.camera.photographs and `grab`; None: no camera.
    """

    path: Path
    mechanism: AnyChain
    rate: float
    looks: int
    motors: Mapping[str, Any]
    cells: Mapping[str, Any]
    guard: GuardSettings
    offsets: tuple[float, ...]
    simulated: Mapping[str, Any] | None
    camera: Mapping[str, Any] | None = None

    @property
    def calibration_path(self) -> Path:
        """Where its calibration is."""
        return self.path.with_name(self.path.stem + CALIBRATION)

    def spools(self, calibrated: bool = True) -> Spools:
        """Its spools; by its calibration, or, not calibrated, with lengths from the present design at ticks 0.

        Raises:
            ConfigError: no calibration, a damaged one, or one of other motors.
        """
        m, signs = self.mechanism.n_tendons, tuple(self.motors["signs"])
        radius = float(self.motors["radius_mm"])
        if not calibrated:
            return Spools(radius, signs, (0,) * m, (0.0,) * m)
        if not self.calibration_path.is_file():
            hint = f"rj rig home {self.path} makes it."
            raise ConfigError("calibration", str(self.calibration_path), "the calibration of this rig", hint)
        where = str(self.calibration_path)
        content = mapping(where, read_json(self.calibration_path), CALIBRATION_KEYS, CALIBRATION_KEYS)
        ticks, lengths, kept = (_per_tendon(f"{where}: {name}", content[name], m) for name in CALIBRATION_KEYS[:3])
        if tuple(kept) != signs or content["radius_mm"] != radius:
            hint = f"Home again: rj rig home {self.path}."
            raise ConfigError("calibration", where, "one with the signs and the radius of the rig's file", hint)
        whole = (as_integer(f"{where}: zero_ticks", tick, error=ConfigError) for tick in ticks)
        return Spools(radius, signs, tuple(whole), tuple(lengths), self.offsets)

    def keep_calibration(self, ticks: Any, lengths: Any, tension: float) -> None:
        """Write the zero: ticks, and lengths there [mm]; tension: of homing [N]."""
        values = {
            "zero_ticks": [int(tick) for tick in ticks],
            "zero_mm": [round(float(length), 6) for length in lengths],
            "signs": list(self.motors["signs"]),
            "radius_mm": float(self.motors["radius_mm"]),
            "tension": tension,
        }
        write_text(self.calibration_path, json.dumps(values, indent=1) + "\n")


def load_rig(path: str | Path) -> RigSettings:
    """The rig of a file; raises ConfigError for a wrong key, type or number, with the place."""
    path, where = Path(path), str(path)
    top = mapping(where, read_yaml(path), KEYS, ("mechanism", "motors"))
    named = text(f"{where}: mechanism", top["mechanism"])
    beside = path.parent / named
    mechanism = load_mechanism(beside if beside.is_file() else named)
    m = mechanism.n_tendons
    simulated = None if top.get("simulated") is None else _simulated(f"{where}: simulated", top["simulated"])
    motors = _motors(f"{where}: motors", top["motors"], m, simulated is not None)
    cells = dict(mapping(f"{where}: cells", top.get("cells"), CELL_KEYS, () if simulated is not None else ("port",)))
    as_integer(f"{where}: cells.baud", cells.setdefault("baud", 115_200), 1, error=ConfigError)
    names = [field.name for field in fields(GuardSettings)]
    given = mapping(f"{where}: guard", top.get("guard"), names)
    guard = GuardSettings(**{name: number(f"{where}: guard.{name}", value) for name, value in given.items()})
    allowed = f"a number from 0.1 to {FASTEST:g} [Hz]"
    rate = as_number(f"{where}: rate", top.get("rate", 20.0), 0.1, FASTEST, allowed=allowed, error=ConfigError)
    looks = as_integer(f"{where}: looks", top.get("looks", 4), 1, 100, error=ConfigError)
    offsets = _offsets(where, top, path.parent, m)
    camera = (
        None if top.get("camera") is None else mapping(f"{where}: camera", top["camera"], CAMERA_KEYS, CAMERA_KEYS[:4])
    )
    if camera is not None and simulated is not None:
        raise ConfigError(f"{where}: camera", list(camera), "no camera beside 'simulated', which has a tracker")
    return RigSettings(path, mechanism, rate, looks, motors, cells, guard, offsets, simulated, camera)


def _motors(where: str, value: object, m: int, in_software: bool) -> dict[str, Any]:
    content = mapping(
        where, value, MOTOR_KEYS, ("radius_mm",) if in_software else ("port", "ids", "signs", "radius_mm")
    )
    motors: dict[str, Any] = {
        "ids": list(range(1, m + 1)),
        "signs": [1] * m,
        "baud": 1_000_000,
        "watchdog_s": 0.4,
    } | dict(content)
    for name, low, high in (("ids", 0, 252), ("signs", -1, 1)):
        values = _per_tendon(f"{where}.{name}", motors[name], m)
        motors[name] = [as_integer(f"{where}.{name}", each, low, high, error=ConfigError) for each in values]
    if 0 in motors["signs"]:
        allowed = "1 for motors whose rising ticks pull in, -1 for others"
        raise ConfigError(f"{where}.signs", motors["signs"], allowed)
    if motors["baud"] not in BAUDS:
        allowed = f"one of {', '.join(map(str, BAUDS))}, as in the motors"
        raise ConfigError(f"{where}.baud", motors["baud"], allowed)
    for name, unit in (("radius_mm", "mm"), ("current_limit", "N")):
        if motors.get(name) is not None:
            motors[name] = as_positive(f"{where}.{name}", motors[name], f"a positive number [{unit}]", ConfigError)
    return motors


def _simulated(where: str, value: object) -> dict[str, Any]:
    content = {"robot": 1000, "generation": 1, "wall": False} | dict(mapping(where, value, SIMULATED_KEYS))
    as_integer(f"{where}.robot", content["robot"], 0, error=ConfigError)
    as_integer(f"{where}.generation", content["generation"], 0, 1, error=ConfigError)
    as_boolean(f"{where}.wall", content["wall"], ConfigError)
    return content


def _offsets(where: str, top: Mapping[str, Any], folder: Path, m: int) -> tuple[float, ...]:
    """Offsets from the file itself, or from the folder that rj identify wrote."""
    values = top.get("offsets")
    if top.get("identified") is not None:
        from rollingjoint.identify.rig_files import IDENTIFIED

        if values is not None:
            raise ConfigError(f"{where}: offsets", values, "offsets or identified, not both")
        source = folder / text(f"{where}: identified", top["identified"]) / IDENTIFIED
        if not source.is_file():
            allowed = "a folder that rj identify has written, beside the rig's file"
            raise ConfigError(f"{where}: identified", top["identified"], allowed, f"There is no {source}.")
        content = read_yaml(source)
        values = content.get("offsets") if isinstance(content, Mapping) else None
        if values is None:
            raise ConfigError(str(source), values, "the key 'offsets'", "rj identify --output FOLDER writes it.")
    if values is None:
        return (0.0,) * m
    return tuple(_per_tendon(f"{where}: offsets", values, m))


def _per_tendon(where: str, value: object, m: int) -> list[float]:
    """Finite numbers, one for each of m tendons."""
    values = numbers(where, value)
    if len(values) != m:
        raise ConfigError(where, value, f"{m} numbers, one per tendon")
    return values


@contextmanager
def connected(
    settings: RigSettings, calibrated: bool = True, writer: RecordingWriter | None = None
) -> Iterator[tuple[Rig, Any]]:
    """The rig, connected, and its motors; on leaving they hold.

    Raises:
        RigError, ConfigError: ports, motors or a calibration that cannot be used.
    """
    from agents.rig.cells import SerialCells

    spools = settings.spools(calibrated)
    with _driver(settings, spools) as (motors, bus, clock):
        motors.connect()
        m, baud = settings.mechanism.n_tendons, settings.cells["baud"]
        port = str(settings.cells.get("port")) if bus is None else bus.cell_port
        cells = SerialCells(port, m, clock, baud, max(0.02, 1e-3 * _patience_ms(clock)))
        at_zero = np.array(spools.lengths_at_zero) if calibrated else motors.read().values
        poses = _tracker(settings, clock) if bus is None else _SimulatedTracker(bus, clock)
        with Rig(motors, cells, clock, at_zero, settings.guard, settings.rate, settings.looks, poses, writer) as rig:
            yield rig, motors


def reboot(settings: RigSettings, ident: int) -> None:
    """Reboot a motor after a hardware error, and forget the zero: its turns are lost, and it has no torque.

    Raises:
        ConfigError: no motor of the rig. RigError: a port that cannot be used, or no answer.
    """
    if ident not in settings.motors["ids"]:
        raise ConfigError("--id", ident, f"a motor of the rig: {settings.motors['ids']}")
    with _driver(settings, settings.spools(calibrated=False)) as (motors, _, _):
        try:
            motors.reboot(ident)
        finally:
            motors.close()
        settings.calibration_path.unlink(missing_ok=True)


@contextmanager
def _driver(settings: RigSettings, spools: Spools) -> Iterator[tuple[Any, Any, LoopClock]]:
    """Motors that are not connected yet, the simulated bus if there is one, and the clock."""
    from agents.rig.dynamixel import Dynamixels, DynamixelSettings

    bus: Any = None
    clock: LoopClock = WallClock()
    if settings.simulated is not None:
        bus, clock = simulated_bus(settings)
    port = str(settings.motors.get("port")) if bus is None else bus.port
    try:
        options = {name: settings.motors[name] for name in ("ids", "baud", "current_limit", "watchdog_s")
                   if settings.motors.get(name) is not None}  # fmt: skip
        bus_settings = DynamixelSettings(port=port, **options)
        motors = Dynamixels(bus_settings, spools, clock, 1.0 / settings.rate, _patience_ms(clock))
        if isinstance(clock, VirtualClock):
            clock.quiet.append(lambda: bus.received >= motors.port.sent)
        yield motors, bus, clock
    finally:
        if bus is not None:
            bus.close()


def _patience_ms(clock: LoopClock) -> float:
    """With an answer; on the virtual clock time stands still, and kernels may compile."""
    return 2000.0 if isinstance(clock, VirtualClock) else 10.0


def _tracker(settings: RigSettings, clock: LoopClock) -> RigPoses | None:
    """The camera of a rig's file; None where it has none."""
    if settings.camera is None:
        return None
    from agents.rig.camera import CameraPoses, grabber
    from rollingjoint.camera.photographs import photographs_from_dict

    where, content = f"{settings.path}: camera", dict(settings.camera)
    grab = grabber(f"{where}.grab", text(f"{where}.grab", content.pop("grab")), settings.path.parent)
    return CameraPoses(photographs_from_dict(where, content, settings.mechanism, settings.path.parent), grab, clock)


def simulated_bus(settings: RigSettings) -> tuple[Any, LoopClock]:
    """A robot behind a simulated bus, and its clock."""
    from agents.adaptation.robot import robot
    from agents.rig.simulated.bus import SimulatedBus
    from agents.rig.simulated.plant import Plant
    from rollingjoint import CapstanFriction

    content = settings.simulated or {}
    one = robot(content["robot"], content["generation"])
    if one.chain.n_tendons != settings.mechanism.n_tendons:
        allowed = f"a mechanism with the {one.chain.n_tendons} tendons of simulated robots, such as five_link"
        raise ConfigError(f"{settings.path}: mechanism", settings.mechanism.name, allowed)
    tendons = [
        replace(tendon, friction=CapstanFriction(mu))
        for tendon, mu in zip(one.chain.tendons, one.mu.tolist(), strict=True)
    ]
    chain = one.chain.replace(tendons=tendons)
    clock: LoopClock = WallClock() if content["wall"] else VirtualClock()
    plant = Plant(chain, one.play_mm, one.sheath_friction, one.motor_offsets, seed=one.number)
    signs, radius = tuple(settings.motors["signs"]), float(settings.motors["radius_mm"])
    return SimulatedBus(plant, clock, radius, signs, seed=one.number), clock


class _SimulatedTracker:
    """A camera at a simulated bench: the tip with noise."""

    def __init__(self, bus: Any, clock: LoopClock, noise: float = 0.2) -> None:
        self.bus, self.clock, self.noise = bus, clock, noise
        self._rng = np.random.default_rng(1)

    def read(self) -> Any:
        """Place of the tip [mm]."""
        from agents.rig.protocols import RigReading

        with self.bus.lock:
            tip = self.bus.plant.tip
        return RigReading(tip + self.noise * self._rng.standard_normal(len(tip)), self.clock.now())
