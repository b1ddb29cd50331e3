"""Recordings of a rig, JSON Lines or CSV: motor positions, tensions and tips over time (docs/rig.md)."""

from __future__ import annotations

import csv
import json
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from rollingjoint.chain.chain import AnyChain
from rollingjoint.checks import as_integer, as_positive
from rollingjoint.errors import ConfigError, InvalidInput
from rollingjoint.io.mechanism_file import load_mechanism, mechanism_from_dict, mechanism_to_dict

Array = NDArray[np.float64]

FORMAT, VERSION = "rollingjoint-recording", 1
LARGEST_FILE = 2**28  # bytes: 13 hours of two tendons at 20 Hz
LONGEST_LINE = 100_000  # characters
MOST_STEPS = 2_000  # that an identification goes through; longer recordings are thinned
READINGS = ("motors", "tensions", "tip")
LARGEST = 10_000.0  # of any reading [mm, N]
LOWEST_TENSION = -5.0  # that noise and drift of a load cell explain [N]: tendons pull
_INFINITE = 1e300  # numbers beyond it are none
_NEARLY = 0.95  # of the steps that may be left: thinning looks for no better distance
_WINDOW = 16  # steps in which the next turning point is looked for first
_AXES = "xyz"


@dataclass(frozen=True)
class RecordedRun:
    """An unbroken stretch of a recording: T readings of m tendons.

    Args:
        t: when motors were read, rising, (T,) [s].
        motors: unstretched tendon that every motor leaves, more is slacker, (T, m) [mm].
        tensions: of load cells at the motors, (T, m) [N]; NaN: not read.
        tips: (T, 2 or 3) [mm], in the frame of the base; NaN: not seen.
        name: of the run.
    """

    t: Array
    motors: Array
    tensions: Array
    tips: Array
    name: str = "1"

    def __post_init__(self) -> None:
        count = len(self.t)
        if count < 2 or not np.isfinite(self.motors).all() or not np.isfinite(self.t).all():
            raise InvalidInput(f"run {self.name}", count, "at least 2 steps with finite times and motor positions")
        for name, unit in (("motors", "mm"), ("tensions", "N"), ("tips", "mm")):
            values = getattr(self, name)
            if (far := np.abs(values) > LARGEST).any():
                allowed = f"numbers from {-LARGEST:g} to {LARGEST:g} [{unit}]"
                hint = "Leave out what was not read."
                raise InvalidInput(f"{name} of run {self.name}", float(values[far][0]), allowed, hint)
        if (pushes := self.tensions < LOWEST_TENSION).any():
            allowed = f"numbers from {LOWEST_TENSION:g} to {LARGEST:g} [N], positive where a tendon pulls"
            hint = "Turn the sign of the load cell, or weigh it again without a tendon."
            raise InvalidInput(f"tensions of run {self.name}", float(self.tensions[pushes][0]), allowed, hint)
        if (np.diff(self.t) <= 0).any():
            raise InvalidInput(
                f"times of run {self.name}",
                float(self.t[np.argmin(np.diff(self.t))]),
                "rising times",
                'Give each unbroken stretch its own "run".',
            )

    def rows(self, kept: NDArray[np.int64]) -> RecordedRun:
        """The run with these steps alone."""
        return replace(self, **{name: getattr(self, name)[kept] for name in ("t", "motors", "tensions", "tips")})


@dataclass(frozen=True)
class RigRecording:
    """What a rig recorded.

    Args:
        runs: with equal numbers of tendons.
        mechanism: as designed; None where the file names none.
        header: the whole first line of the file.
        events: interventions, faults and remarks in order, each with its time `t` [s].
    """

    runs: Sequence[RecordedRun]
    mechanism: AnyChain | None = None
    header: Mapping[str, Any] = field(default_factory=dict)
    events: Sequence[Mapping[str, Any]] = ()

    def __post_init__(self) -> None:
        shapes = {(run.motors.shape[1], run.tips.shape[1]) for run in self.runs}
        if len(shapes) != 1:
            raise InvalidInput("runs (tendons, coordinates of the tip)", sorted(shapes), "equal numbers in all runs")

    @property
    def n_tendons(self) -> int:
        """Number of tendons."""
        return int(self.runs[0].motors.shape[1])

    @property
    def steps(self) -> int:
        """Number of readings in all runs."""
        return sum(len(run.t) for run in self.runs)

    @property
    def sees_tip(self) -> bool:
        """Whether any tip was seen."""
        return any(bool(np.isfinite(run.tips).any()) for run in self.runs)

    def thinned(self, most: int = MOST_STEPS) -> RigRecording:
        """The recording with at most about `most` steps; itself where it has no more.

        Steps are left out where motors stood or moved least; turning points of every motor stay, since play and
        friction remember them.
        """
        as_integer("most", most, 2)
        if self.steps <= most:
            return self
        travel = max(float(np.ptp(run.motors, axis=0).max()) for run in self.runs)
        low, high, count = 0.0, max(travel, 1e-9), 0
        for _ in range(40):
            if _NEARLY * most <= count <= most:
                break
            middle = 0.5 * (low + high)
            count = sum(len(_turning_points(run.motors, middle)) for run in self.runs)
            low, high = (middle, high) if count > most else (low, middle)
        return replace(self, runs=[run.rows(_turning_points(run.motors, high)) for run in self.runs])


def _turning_points(motors: Array, distance: float) -> NDArray[np.int64]:
    """Steps at which some motor has moved by a distance since the last such step, or turned after such a way, (K,)."""
    turns, window = [0], _WINDOW
    while (start := turns[-1]) + 1 < len(motors):
        ahead = motors[start : start + window]
        low, high = np.minimum.accumulate(ahead), np.maximum.accumulate(ahead)
        is_far = (np.maximum(high - ahead, ahead - low) > distance).any(axis=1)
        if is_far.any():
            step = int(is_far.argmax())
            way = ahead[: step + 1]
            extremes = {int(place) for place in (*way.argmin(axis=0), *way.argmax(axis=0)) if 0 < place < step}
            turns += [start + place for place in (*sorted(extremes), step)]
            window = max(_WINDOW, 2 * step)
        elif start + window < len(motors):
            window *= 2
        else:
            break
    return np.array(turns if len(turns) > 1 else [0, len(motors) - 1])


def read_recording(path: str | Path, remark: Callable[[str], object] = warnings.warn) -> RigRecording:
    """The recording in a file: JSON Lines, or CSV where its name ends in .csv.

    The last line of a run that was cut off is left out, and so are steps without a time or a motor position.

    Args:
        path: of the file. remark: called with a line that counts steps left out, if there are any.
    Raises:
        ConfigError: a file that cannot be read, a wrong key or number, with the line.
    """
    path = Path(path)
    if path.exists() and not path.is_file():
        raise ConfigError("recording", str(path), "a file of JSON Lines or CSV, no folder or device")
    try:
        if (size := path.stat().st_size) > LARGEST_FILE:
            raise ConfigError(f"size of {path}", size, f"at most {LARGEST_FILE:,} bytes", "Split it into parts.")
        content = path.read_bytes()
    except OSError as error:
        raise ConfigError("recording", str(path), "a readable file", error.strerror or "") from None
    text = content.decode("utf-8", errors="replace")
    header, lines = _csv_lines(text, str(path)) if path.suffix.lower() == ".csv" else _json_lines(text, str(path))
    mechanism = None if header.get("mechanism") is None else _mechanism(header["mechanism"], path)
    return _recording(header, lines, mechanism, str(path), remark)


def _mechanism(value: object, path: Path) -> AnyChain:
    if isinstance(value, Mapping):
        return mechanism_from_dict(value, f"{path}: mechanism", str(value.get("name", "")))
    beside = path.parent / str(value)
    return load_mechanism(beside if beside.is_file() else str(value))


def _json_lines(text: str, where: str) -> tuple[Mapping[str, Any], Iterable[tuple[str, Mapping[str, Any]]]]:
    """The header, and the lines after it with their places."""
    lines = text.splitlines()
    parsed = []
    for number, line in enumerate(lines, 1):
        if not line.strip():
            continue
        place = f"{where}: line {number}"
        if len(line) > LONGEST_LINE:
            raise ConfigError(place, f"{len(line):,} characters", f"at most {LONGEST_LINE:,}")
        try:
            values = json.loads(line, parse_constant=lambda name: None if name == "NaN" else float(name))
        except (ValueError, RecursionError):
            if number == len(lines) and not text.endswith("\n"):
                break  # cut off while it was written
            raise ConfigError(place, line[:40], "one JSON object") from None
        if not isinstance(values, dict):
            raise ConfigError(place, line[:40], "one JSON object")
        parsed.append((place, values))
    if not parsed or parsed[0][1].get("format") != FORMAT:
        hint = 'The first line is {"format": "' + FORMAT + '", "version": 1, "mechanism": "five_link"}.'
        raise ConfigError(f"{where}: line 1", parsed[0][1] if parsed else "", f"the format {FORMAT!r}", hint)
    version = as_integer(f"{where}: version", parsed[0][1].get("version", VERSION), 1, VERSION, error=ConfigError)
    if "rate" in parsed[0][1]:
        as_positive(f"{where}: rate", parsed[0][1]["rate"], "a positive number of steps per second", ConfigError)
    return {**parsed[0][1], "version": version}, parsed[1:]


def _csv_lines(text: str, where: str) -> tuple[Mapping[str, Any], Iterable[tuple[str, Mapping[str, Any]]]]:
    """The same of a table with the columns t, motor0, motor1 ..., tension0 ..., tip_x, tip_y, tip_z, run."""
    reader = csv.DictReader(text.splitlines())
    names = [name.strip() for name in reader.fieldnames or ()]
    m = sum(name.removeprefix("motor").isdecimal() for name in names if name.startswith("motor"))
    groups = {
        "motors": [f"motor{j}" for j in range(m)],
        "tensions": [f"tension{j}" for j in range(m)] if "tension0" in names else [],
        "tip": [f"tip_{axis}" for axis in _AXES if f"tip_{axis}" in names],
    }
    wanted = ["t", *(name for group in groups.values() for name in group)]
    if m == 0 or (missing := [name for name in wanted if name not in names]):
        allowed = "the columns t [s], motor0, motor1 ... [mm]; perhaps tension0 ... [N], tip_x, tip_y [mm], run"
        raise ConfigError(f"{where}: columns", names[:20], allowed, f"Missing: {', '.join(missing)}." if m else "")

    def lines() -> Iterator[tuple[str, Mapping[str, Any]]]:
        for number, row in enumerate(reader, 2):
            place = f"{where}: line {number}"
            cells = {(name or "").strip(): cell for name, cell in row.items() if isinstance(cell, str)}
            values: dict[str, Any] = {"t": _cell(place, "t", cells)}
            for key, columns in groups.items():
                numbers = [_cell(place, name, cells) for name in columns]
                values[key] = None if key != "motors" and all(value is None for value in numbers) else numbers
            yield place, values | ({"run": cells["run"]} if "run" in cells else {})

    return {"format": FORMAT, "version": VERSION}, lines()


def _cell(place: str, name: str, cells: Mapping[str, str]) -> float | None:
    text = cells.get(name, "").strip()
    if text.lower() in ("", "nan", "null"):
        return None
    try:
        return float(text)
    except ValueError:
        raise ConfigError(f"{place}: {name}", text, "a number, or nothing where it was not read") from None


def _recording(
    header: Mapping[str, Any],
    lines: Iterable[tuple[str, Mapping[str, Any]]],
    mechanism: AnyChain | None,
    where: str,
    remark: Callable[[str], object],
) -> RigRecording:
    steps: dict[str, list[tuple[float, list[float], list[float], list[float]]]] = {}
    events, width, axes, run = [], 0, 2 if mechanism is None else mechanism.dimension, "1"
    unread = 0  # steps without a time or a motor position
    for place, values in lines:
        run = str(values.get("run", run))
        if "event" in values and values["event"] is not None:
            events.append(values)
        if values.get("motors") is None:
            unread += "motors" in values or "event" not in values
            continue
        motors = _numbers(f"{place}: motors", values["motors"], width)
        width = len(motors)
        if "tip" in values and values["tip"] is not None and not any(map(len, steps.values())):
            axes = max(axes, len(values["tip"])) if isinstance(values["tip"], list) else axes
        tensions = _numbers(f"{place}: tensions", values.get("tensions"), width)
        tip = _numbers(f"{place}: tip", values.get("tip"), axes)
        (t,) = _numbers(f"{place}: t", [values.get("t")], 1)
        if np.isfinite([t, *motors]).all():
            steps.setdefault(run, []).append((t, motors, tensions, tip))
        else:
            unread += 1
    runs = []
    for name, rows in steps.items():
        if len(rows) > 1:
            try:
                columns = [np.array(column, float) for column in zip(*rows, strict=True)]
                runs.append(RecordedRun(columns[0], columns[1], columns[2], columns[3], name))
            except InvalidInput as error:
                raise ConfigError(f"{where}: {error.what}", error.value, error.allowed, error.hint) from None
    if not runs:
        allowed = "a run of at least two steps with finite times and motor positions"
        hint = 'Steps are lines such as {"t": 0.05, "motors": [90.1, 97.2], "tensions": [3.0, 2.9]}, or rows of CSV.'
        raise ConfigError(f"{where}: longest run", max(map(len, steps.values()), default=0), allowed, hint)
    if mechanism is not None and mechanism.n_tendons != width:
        raise ConfigError(f"{where}: motors", width, f"{mechanism.n_tendons}, one per tendon of the mechanism")
    alone, total = sum(len(rows) == 1 for rows in steps.values()), unread + sum(map(len, steps.values()))
    if left_out := unread + alone:
        reasons = f"{unread} without a time or a motor position, {alone} alone in a run"
        remark(f"{where}: {left_out} of {total} steps left out ({reasons})")
    return RigRecording(runs, mechanism, header, events)


def _numbers(where: str, value: object, size: int) -> list[float]:
    """Numbers, NaN for null; `size` of them unless that is 0."""
    if value is None:
        return [np.nan] * size
    allowed = f"{size} numbers" if size else "a list of numbers"
    if not isinstance(value, list) or not value or (size and len(value) != size):
        raise ConfigError(where, value, allowed)
    for number in value:
        if number is not None and (isinstance(number, bool) or not isinstance(number, (int, float))):
            raise ConfigError(where, value, f"{allowed}, null where not read")
        if number is not None and abs(number) > _INFINITE:
            raise ConfigError(where, number, f"{allowed} that are finite, null where not read")
    return [np.nan if number is None else float(number) for number in value]


class RecordingWriter:
    """A recording that grows line by line, whole after each of them.

    Args:
        path: of the new file. mechanism: as designed. header: more of the first line, plain values.
    Raises:
        InvalidInput: a file that is already there, or cannot be written.
    """

    def __init__(self, path: str | Path, mechanism: AnyChain | None = None, **header: Any) -> None:
        self.path = Path(path)
        if self.path.exists():
            raise InvalidInput("recording", str(path), "a new file", "Move the other one, or take another name.")
        described = {} if mechanism is None else {"mechanism": mechanism_to_dict(mechanism)}
        try:
            self._stream = self.path.open("w", encoding="utf-8")
        except OSError as error:
            raise InvalidInput("recording", str(path), "a file that can be written", error.strerror or "") from None
        self._write({"format": FORMAT, "version": VERSION} | described | header, digits=None)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def step(self, t: float, motors: Iterable[float], tensions: Iterable[float] | None = None, **others: Any) -> None:
        """A line of readings; others: `tip`, `action`, `goal`, `run`, `late`, `retries`, `event`."""
        self._write({"t": t, "motors": motors, "tensions": tensions} | others)

    def event(self, t: float, event: str, **others: Any) -> None:
        """A line without readings."""
        self._write({"t": t, "event": event} | others)

    def _write(self, values: Mapping[str, Any], digits: int | None = 9) -> None:
        plain = {name: _plain(value, digits) for name, value in values.items() if value is not None}
        self._stream.write(json.dumps(plain, allow_nan=False) + "\n")
        self._stream.flush()

    def close(self) -> None:
        """End the file."""
        self._stream.close()


def write_recording(recording: RigRecording, path: str | Path) -> None:
    """Write a whole recording as JSON Lines."""
    header = {name: value for name, value in recording.header.items() if name not in ("format", "version", "mechanism")}
    with RecordingWriter(path, recording.mechanism, **header) as writer:
        for run in recording.runs:
            for t, motors, tensions, tip in zip(run.t, run.motors, run.tensions, run.tips, strict=True):
                seen = {"tip": tip} if np.isfinite(tip).any() else {}
                writer.step(float(t), motors, tensions if np.isfinite(tensions).any() else None, run=run.name, **seen)


def _plain(value: Any, digits: int | None) -> Any:
    """Plain values for JSON: null for what is not finite, numbers rounded to digits unless that is None."""
    if isinstance(value, np.ndarray):
        return _plain(value.tolist(), digits)
    if isinstance(value, Mapping):
        return {str(key): _plain(item, digits) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item, digits) for item in value]
    if isinstance(value, (float, np.floating)):
        number = float(value)
        return None if not np.isfinite(number) else number if digits is None else round(number, digits)
    return value.item() if isinstance(value, np.generic) else value
