"""How near the model comes to two flexible arms of others: parameters from their recordings, errors on files held out.

    python benchmarks/foreign_arms.py --robot v4 --fit FOLDER --score FILE.csv
    python benchmarks/foreign_arms.py --robot v6 --fit FOLDER --variants       # inner splits of every variant
    python benchmarks/foreign_arms.py --robot v4 --fit FOLDER --picture FILE.png

The arms are those of the Continuum Robotics Lab (opencr-mujoco, arXiv 2606.22397, MIT), three segments of three tendons
each. FOLDER holds its recordings as ROBOT_*.csv with the columns timestamp [s], pattern_label, nine of the form
servo_N_mm, motors in the order of segments, positive pulls in [mm], and tip_x, tip_y, tip_z by motion capture [mm].
The project ships none. Rows of the scored file that are in FOLDER too are left out of the fit.

An error is the root mean square distance of measured and modelled tips [mm], both less their mean over the scored rows;
the turn between the frames is fitted. The model is a HingeChain of ten hinges a segment, about x and y in turn; all
its parameters have a nominal value and a standard deviation, the fit is the largest posterior. Variants add parameters
and are judged by families of patterns that the fit has not seen. The second row of a result adds a Gaussian process of
what is left, over motors and their past; it is no physics. --bound says what could be reached: errors of such a process
without any model, and of both together, where rows, patterns, families or the end of a recording are held out.
"""

from __future__ import annotations

import argparse
import csv
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rollingjoint import (
    Bead,
    BeadTendon,
    HingeChain,
    HingeEquilibrium,
    InvalidInput,
    TorsionSpring,
    set_threads,
    solve_lengths_batch,
)
from rollingjoint.chain import se3
from rollingjoint.load import SPATIAL_LOAD_COLUMNS
from rollingjoint.tables import markdown_table
from rollingjoint.transmission import play_step

Array = NDArray[np.float64]

TENDONS, SEGMENTS, HINGES = 9, 3, 10
BELOW = np.arange(TENDONS) // 3 >= np.arange(SEGMENTS)[:, None]  # tendons that pass a segment, (3, 9)
TIP_COLUMNS = "tip_x", "tip_y", "tip_z"
RADIUS = 4.5  # of the circle of holes [mm]


class Robot(NamedTuple):
    """An arm as its authors describe it."""

    lengths: tuple[float, float, float]  # of the segments [mm]
    azimuths: tuple[float, float, float]  # of the first tendon of every segment [rad]
    turn: float  # of the frame of motion capture about z [rad]


ROBOTS = {
    "v4": Robot((60.0, 62.5, 64.0), (-3.0589, -2.5615, -2.0506), 0.0),
    "v6": Robot((100.0, 100.0, 22.0), (0.0, 0.5236, 1.0472), np.pi),
}


class Parameter(NamedTuple):
    """Nominal values and the standard deviation of one kind; logarithms where `log`."""

    nominal: tuple[float, ...]
    deviation: float
    unit: str
    log: bool = False


def parameters_of(robot: Robot) -> dict[str, Parameter]:
    """All kinds of parameters by name."""
    azimuths = tuple(first + k * 2.0 * np.pi / 3.0 for first in robot.azimuths for k in range(3))
    return {
        "bending stiffness": Parameter((3000.0,) * 3, 0.5, "N·mm²", log=True),
        "tendon stiffness": Parameter((9.0,) * 3, 1.0, "N/mm", log=True),
        "offset": Parameter((-0.3,) * TENDONS, 0.5, "mm"),
        "shift in pulls": Parameter((0.0,) * TENDONS, 0.7, "mm"),
        "frame": Parameter((0.0,) * 3, 0.1, "rad"),
        "azimuth": Parameter(azimuths, 0.1, "rad"),
        "length": Parameter(robot.lengths, 3.0, "mm"),
        "gain": Parameter((1.0,) * TENDONS, 0.1, ""),
        "delay": Parameter((0.0,), 0.3, "s"),
        "rest curvature": Parameter((0.0,) * 6, 0.15, "rad"),
        "play": Parameter((0.05,) * TENDONS, 0.1, "mm"),
        "axial compliance": Parameter((0.02,) * 3, 0.02, "mm/N"),
        "bending friction": Parameter((0.1, 5e-4), 0.7, "of the stiffness, rad/mm", log=True),
        "weight": Parameter((0.0,) * 3, 1e-3, "N/mm"),
        "twist": Parameter((0.0,) * 3, 0.1, "rad"),
    }


CALIBRATED = ("bending stiffness", "tendon stiffness", "offset", "frame")
GEOMETRY = (*CALIBRATED, "azimuth", "length", "gain")
MOVING = (*GEOMETRY, "delay", "rest curvature")
SETTLED = "shift in pulls", "twist", "axial compliance"
VARIANTS = {
    "stiffnesses, offsets, frame": CALIBRATED,
    "+ azimuths, lengths, gains": GEOMETRY,
    "+ delay, rest curvature": MOVING,
    "  and play": (*MOVING, "play"),
    "  and weight": (*MOVING, "weight"),
    "  and twist of the tendons' routes": (*MOVING, "twist"),
    "  and friction of bending": (*MOVING, "bending friction"),
    "  and axial compliance": (*MOVING, "axial compliance"),
    "  and axial compliance, friction, play": (*MOVING, "axial compliance", "bending friction", "play"),
    "  and shifts in pulls": (*MOVING, "shift in pulls"),
    "  and shifts in pulls, twist": (*MOVING, "shift in pulls", "twist"),
    "  and shifts in pulls, twist, axial compliance": (*MOVING, *SETTLED),
    "  and shifts in pulls, twist, axial compliance, friction, play": (*MOVING, *SETTLED, "bending friction", "play"),
}
CHOSEN = "  and shifts in pulls, twist, axial compliance"

NOISE = 5.0  # standard deviation of a tip's coordinate in the posterior [mm]
MOST_ROWS = 270  # of a fit
SWEEPS = 4  # over a recording, for what depends on tensions and on the past
EASE = 0.65  # of Newton's rates for an arm that does not bend: it does, and this settles soonest
STEPS = 10  # of a fit at most
REACH = 5.0, 15.0  # mm of motors, and of their past, over which a Gaussian process forgets
LEFT, SCATTER = 4.0, 1.0  # of a coordinate that physics leaves, and of what nothing explains [mm]
FREE, SLOPE = 20.0, 4.0  # of a coordinate where there is no physics [mm], and of its linear part [mm/mm]
LET_OUT = -7.0  # mm: a motor beyond it is slack for a pull of another, which was a session with its own zeros
FAMILIES = "pull", "seg", "pair12", "pair13", "pair23"


class Recording(NamedTuple):
    """Rows of a file in their order in time."""

    times: Array  # (n,) s
    labels: NDArray[np.str_]  # (n,)
    motors: Array  # (n, 9) mm
    tips: Array  # (n, 3) mm

    def rows(self, which: Any) -> Recording:
        """Some of its rows."""
        return Recording(*(column[which] for column in self))

    @property
    def families(self) -> NDArray[np.str_]:
        """Family of patterns of every row, or its label."""
        return np.array([next((name for name in FAMILIES if name in label), label) for label in self.labels.tolist()])


def read(path: Path) -> Recording:
    """The recording in a CSV file.

    Raises:
        InvalidInput: no such file, missing columns, no rows, an entry that is no finite number.
    """
    try:
        with path.open(newline="", encoding="utf-8") as file:
            table = list(csv.reader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InvalidInput("recording", str(path), f"a readable CSV file ({type(error).__name__})") from None
    head = table[0] if table else []
    motors = [name for name in head if name.startswith("servo_") and name.endswith("_mm")]
    missing = [name for name in ("timestamp", "pattern_label", *TIP_COLUMNS) if name not in head]
    if missing or len(motors) != TENDONS:
        allowed = f"timestamp, pattern_label, {TENDONS} of servo_N_mm, {', '.join(TIP_COLUMNS)}"
        raise InvalidInput(f"columns of {path.name}", ",".join(head) or "none", allowed)
    if len(table) < 3:
        raise InvalidInput(f"rows of {path.name}", len(table) - 1, "2 or more")
    places = [head.index(name) for name in ("timestamp", *motors, *TIP_COLUMNS)]
    label = head.index("pattern_label")
    for line, row in enumerate(table[1:], 2):
        if len(row) != len(head):
            raise InvalidInput(f"line {line} of {path.name}", f"{len(row)} entries", f"{len(head)}")
    try:
        numbers = np.array([[float(row[place]) for place in places] for row in table[1:]])
    except ValueError as error:
        raise InvalidInput(f"entries of {path.name}", str(error), "numbers") from None
    if not np.isfinite(numbers).all():
        line = int(np.flatnonzero(~np.isfinite(numbers).all(axis=1))[0]) + 2
        raise InvalidInput(f"line {line} of {path.name}", "not finite", "finite numbers")
    found = Recording(numbers[:, 0], np.array([row[label] for row in table[1:]]), numbers[:, 1:10], numbers[:, 10:])
    return found.rows(np.argsort(found.times, kind="stable"))


def read_folder(folder: Path, robot: str) -> Recording:
    """All recordings of a robot in a folder, every time once."""
    files = sorted(folder.glob(f"{robot}_*.csv"))
    if not files:
        raise InvalidInput("folder to fit", str(folder), f"a folder with recordings {robot}_*.csv")
    joined = Recording(*(np.concatenate(columns) for columns in zip(*map(read, files), strict=True)))
    return joined.rows(np.unique(joined.times, return_index=True)[1])


class Model:
    """An arm of others as a HingeChain, with the parameters of a variant free, the others without effect."""

    def __init__(self, robot: Robot, free: Sequence[str]) -> None:
        self.robot, self.kinds, self.free = robot, parameters_of(robot), tuple(free)
        self.size = sum(len(self.kinds[name].nominal) for name in self.free)

    def values(self, z: Array) -> dict[str, Array]:
        """Values of the free parameters at z standard deviations from the nominal ones, by name."""
        values = {}
        for name, part in self.parts(z).items():
            nominal, deviation, _, log = self.kinds[name]
            step = deviation * part
            values[name] = np.array(nominal) * np.exp(step) if log else np.array(nominal) + step
        return values

    def parts(self, z: Array) -> dict[str, Array]:
        """The part of z of every free parameter, by name."""
        ends = np.cumsum([len(self.kinds[name].nominal) for name in self.free])
        return dict(zip(self.free, np.split(z, ends[:-1]), strict=True))

    def value(self, values: dict[str, Array], name: str) -> Array:
        """Of a parameter: free, or the nominal one."""
        return values.get(name, np.array(self.kinds[name].nominal))

    def arm(self, values: dict[str, Array]) -> HingeChain:
        """The mechanism with these values."""
        lengths = np.maximum(self.value(values, "length"), 1.0)
        rest = self.value(values, "rest curvature").reshape(SEGMENTS, 2) * 2.0 / HINGES
        bending = self.value(values, "bending stiffness") / (2.0 * lengths / HINGES)
        weights = np.linalg.norm(self.value(values, "weight")) * lengths / HINGES
        beads = [
            Bead(
                lengths[s] / HINGES,
                "xy"[i % 2],
                bending[s],
                gap=0.9 * lengths[s] / HINGES,
                weight=weights[s],
                rest_angle=rest[s, i % 2],
            )
            for s in range(SEGMENTS)
            for i in range(HINGES)
        ]
        twist = np.concatenate([[0.0], np.cumsum(np.repeat(self.value(values, "twist") / HINGES, HINGES))])
        stiffnesses = self.value(values, "tendon stiffness")
        tendons = []
        for j, azimuth in enumerate(self.value(values, "azimuth")):
            end = (j // 3 + 1) * HINGES
            angles = azimuth + twist[: end + 1] - twist[end] if "twist" in values else np.array([azimuth])
            holes = RADIUS * np.column_stack([np.cos(angles), np.sin(angles)])
            tendons.append(BeadTendon([(x, y) for x, y in holes.tolist()], end, stiffnesses[j // 3]))
        return HingeChain(beads, tendons, "linear")

    def unstretched(self, values: dict[str, Array], arm: HingeChain, times: Array, motors: Array) -> Array:
        """Unstretched lengths that the motors leave at the times of a recording, (n, 9) [mm]."""
        if "delay" in values:
            motors = delayed(times, motors, values["delay"][0])
        if "play" in values:
            motors = behind_play(motors, np.abs(values["play"]))
        shift = np.where((motors < LET_OUT).any(axis=1, keepdims=True), self.value(values, "shift in pulls"), 0.0)
        offsets = self.value(values, "offset") + shift
        return np.asarray(arm.neutral_lengths + offsets - self.value(values, "gain") * motors, float)

    def solve(self, values: dict[str, Array], arm: HingeChain, lengths: Array) -> tuple[HingeEquilibrium, Array]:
        """Equilibria along a path of unstretched lengths, and the shortening of every segment, (n, 3) [mm].

        Sweeps over the whole path, all rows side by side: the segments shorten by their compliance times the tension
        of the tendons that pass them (Newton's method for taut tendons), and friction of bending is a torsion spring on
        every hinge that slips, by the play operator, where its moment would be larger than what friction carries.
        """
        loads: Any = []
        weight = self.value(values, "weight")
        if weight.any():
            loads = [arm.gravity(tuple((weight / np.linalg.norm(weight)).tolist()))]
        compliance = np.abs(values.get("axial compliance", np.zeros(SEGMENTS)))
        share, slip = values.get("bending friction", (0.0, 0.0))
        if share:
            springs = [TorsionSpring(i + 1, share * k, 0.0, i) for i, k in enumerate(arm.joint_stiffnesses)]
            loads = np.tile(arm.load_table([*springs, *loads]), (len(lengths), 1, 1))
            width = slip * 2.0 / HINGES * np.repeat(self.value(values, "length"), HINGES)
        shortening = np.zeros((len(lengths), SEGMENTS))
        found = solve_lengths_batch(arm, lengths, loads)
        for _ in range(SWEEPS if share or compliance.any() else 0):
            if share:
                anchor = np.zeros(arm.n_joints)
                for row, angle in enumerate(found.joint_angles):
                    anchor = np.clip(anchor, angle - width, angle + width)
                    loads[row, : arm.n_joints, SPATIAL_LOAD_COLUMNS.index("rest")] = anchor
            missing = compliance * (found.tensions @ BELOW.T) - shortening
            rates = (
                EASE * compliance[:, None] * (((found.tensions > 0.0) * arm.stiffnesses)[:, None, :] * BELOW) @ BELOW.T
            )
            shortening = shortening + np.linalg.solve(np.eye(SEGMENTS) + rates, missing[..., None])[..., 0]
            found = solve_lengths_batch(arm, lengths + shortening @ BELOW, loads, starts=found)
        return found, shortening

    def tips(self, z: Array, recording: Recording, thin: int = 1) -> Array:
        """Modelled tips at every `thin`-th row, (n, 3) [mm]; NaN where there is no equilibrium."""
        values = self.values(z)
        arm = self.arm(values)
        found, shortening = self.solve(
            values, arm, self.unstretched(values, arm, recording.times, recording.motors)[::thin]
        )
        ends = found.poses[:, HINGES::HINGES, :3, 3]
        parts = np.diff(ends, axis=1, prepend=0.0) * (1.0 - shortening / self.value(values, "length"))[..., None]
        turn = se3.rotation(self.value(values, "frame")) @ se3.rotation(np.array([0.0, 0.0, self.robot.turn]))
        return np.where(found.ok[:, None], parts.sum(axis=1), np.nan) @ turn.T

    def fit(self, parts: Sequence[Recording], start: Array | None = None, progress: str = "") -> Array:
        """z of the largest posterior for recordings, by Levenberg and Marquardt with differences, (size,)."""
        thin = max(1, sum(len(part.times) for part in parts) // MOST_ROWS)
        measured = np.concatenate([part.tips[::thin] for part in parts])

        def residuals(z: Array) -> Array:
            modelled = np.concatenate([self.tips(z, part, thin) for part in parts])
            return np.concatenate([apart(measured, modelled).ravel() / NOISE, z])

        z, damping = np.zeros(self.size) if start is None else start, 1e-2
        now = residuals(z)
        for step in range(STEPS):
            jacobian = np.column_stack([(residuals(z + 1e-3 * unit) - now) / 1e-3 for unit in np.eye(self.size)])
            normal, gradient = jacobian.T @ jacobian, jacobian.T @ now
            before = now @ now
            for _ in range(6):
                trial = z - np.linalg.solve(normal + damping * np.diag(np.diag(normal)), gradient)
                then = residuals(trial)
                if then @ then < before:  # false for NaN
                    break
                damping *= 5.0
            else:
                break
            z, now, damping = trial, then, max(damping / 5.0, 1e-6)
            if progress:
                error = NOISE * np.sqrt(np.sum(now[: -self.size] ** 2) / len(measured))
                print(f"\r{progress}: step {step + 1}, {error:.2f} mm   ", end="", file=sys.stderr, flush=True)
            if before - now @ now < 1e-3 * before:
                break
        if progress:
            print(file=sys.stderr)
        return z

    def fit_after(self, known: dict[str, Array], recording: Recording, progress: str = "") -> Array:
        """`fit` that starts at parts of z known from smaller variants, to which it adds its own."""
        start = [known.get(name, np.zeros(len(self.kinds[name].nominal))) for name in self.free]
        z = self.fit([recording], np.concatenate(start), progress)
        known.update(self.parts(z))
        return z


def delayed(times: Array, motors: Array, late: float) -> Array:
    """Motors `late` seconds ago, (n, 9) [mm]."""
    return np.column_stack([np.interp(times - late, times, column) for column in motors.T])


def behind_play(motors: Array, half_width: Array | float) -> Array:
    """Where tendons are that begin in the middle of plays, (n, 9) [mm]."""
    behind = motors[0]
    return np.array([behind := play_step(behind, motor, half_width) for motor in motors])


def apart(measured: Array, modelled: Array) -> Array:
    """Measured less modelled tips, both less their mean, (n, 3) [mm]."""
    return (measured - measured.mean(axis=0)) - (modelled - modelled.mean(axis=0))


def centred(values: Array) -> Array:
    """Less their mean."""
    return np.asarray(values - values.mean(axis=0))


def rms(measured: Array, modelled: Array) -> float:
    """Root mean square of the distance `apart` [mm]."""
    return float(np.sqrt(np.mean(np.sum(apart(measured, modelled) ** 2, axis=1))))


def past_of(recording: Recording) -> Array:
    """Motors 0.6, 2 and 10 s ago and behind plays of 0.3 and 1 mm, less motors now, (n, 45) [mm]."""
    times, motors = recording.times, recording.motors
    past = [delayed(times, motors, late) for late in (0.6, 2.0, 10.0)]
    past += [behind_play(motors, width) for width in (0.3, 1.0)]
    return np.hstack([values - motors for values in past])


class Process(NamedTuple):
    """A Gaussian process over motors and their past, with what it has seen.

    Args:
        motors, past: (n, 9) and (n, 45) [mm]. weights: of the rows, (n, 3) [1/mm].
        size: standard deviation of a coordinate [mm]. slope: of its linear part [mm/mm].
    """

    motors: Array
    past: Array
    weights: Array
    size: float
    slope: float

    @classmethod
    def of(cls, recording: Recording, values: Array, size: float = LEFT, slope: float = 0.0) -> Process:
        """Fitted to values (n, 3) [mm] at the rows of a recording."""
        bare = cls(recording.motors, past_of(recording), values, size, slope)
        covariance = bare.covariance(bare.motors, bare.past)
        return bare._replace(weights=np.linalg.solve(covariance + SCATTER**2 * np.eye(len(values)), values))

    def covariance(self, motors: Array, past: Array) -> Array:
        """With the rows that were seen, (k, n) [mm²]."""
        far = squared_distances(motors, self.motors) / REACH[0] ** 2
        far += squared_distances(past, self.past) / REACH[1] ** 2
        linear = motors @ self.motors.T + 0.3 * past @ self.past.T
        return np.asarray(self.size**2 * np.exp(-0.5 * far) + self.slope**2 * linear)

    def __call__(self, recording: Recording) -> Array:
        """The most likely values at the rows of a recording, (k, 3) [mm]."""
        return np.asarray(self.covariance(recording.motors, past_of(recording)) @ self.weights)


def squared_distances(rows: Array, others: Array) -> Array:
    """Of every row from all others, (k, n)."""
    return np.asarray((rows**2).sum(axis=1)[:, None] + (others**2).sum(axis=1) - 2.0 * rows @ others.T)


def inner_splits(recording: Recording) -> dict[str, NDArray[np.bool_]]:
    """Rows held out by name: families of patterns, and the last two fifths of the time."""
    splits = {name: recording.families == name for name in ("pull", "seg", "pair12")}
    late = recording.times > recording.times[0] + 0.6 * np.ptp(recording.times)
    return {name: held_out for name, held_out in {**splits, "late": late}.items() if 1 < held_out.sum() < len(late) - 1}


def variants_table(recording: Recording, robot: str, part: str = "") -> str:
    """Errors of variants on all rows and on every inner split, of those with `part` in their names."""
    splits = inner_splits(recording)
    fitted: dict[str, dict[str, Array]] = {name: {} for name in ("all", *splits)}
    rows = []
    for variant, free in ((name, free) for name, free in VARIANTS.items() if part in name):
        model, errors, with_process = Model(ROBOTS[robot], free), [], []
        for name, known in fitted.items():
            held_out = splits.get(name, np.zeros(len(recording.times), bool))
            train, test = recording.rows(~held_out), recording.rows(held_out if name != "all" else ~held_out)
            z = model.fit_after(known, train, f"{robot} {variant.strip()}, without {name if name != 'all' else 'none'}")
            modelled = model.tips(z, test)
            errors.append(rms(test.tips, modelled))
            process = Process.of(train, centred(train.tips - model.tips(z, train)))
            with_process.append(rms(test.tips, modelled + process(test)))
        rows.append((variant, model.size, errors))
        if variant == CHOSEN:
            rows.append(("the same and a Gaussian process", model.size, with_process))
    weights = [held_out.sum() for held_out in splits.values()]
    return markdown_table(
        ["variant", "numbers", "all fitted", *(f"{name} held out" for name in splits), "held out, all"],
        [
            [
                variant.strip(),
                str(size),
                *(f"{error:.2f}" for error in errors),
                f"{np.sqrt(np.average(np.square(errors[1:]), weights=weights)):.2f}",
            ]
            for variant, size, errors in rows
        ],
    )


def bound_table(recording: Recording, robot: str) -> str:
    """What could be reached on held-out parts: no model, the chosen one, and both; errors [mm].

    Parts are a fifth of the rows at random, a seventh of the patterns, a family of patterns, and the last two fifths of
    the time; physics is fitted anew for each of them, but for rows and patterns, where all rows are fitted.
    """
    rng = np.random.default_rng(0)
    patterns = np.array([label.removesuffix("_hold") for label in recording.labels.tolist()])
    rank = {name: place % 7 for place, name in enumerate(dict.fromkeys(patterns.tolist()))}
    group = np.array([rank[name] for name in patterns.tolist()])
    fifth = rng.permutation(len(patterns)) % 5
    families = recording.families
    late = inner_splits(recording)["late"]
    parts = {
        "a fifth of the rows": [fifth == k for k in range(5)],
        "a seventh of the patterns": [group == k for k in range(7)],
        "a family": [families == name for name in dict.fromkeys(families.tolist())],
        "the last two fifths of the time": [late],
    }
    model = Model(ROBOTS[robot], VARIANTS[CHOSEN])
    whole = model.fit([recording], progress=f"{robot}: all rows")
    rows = []
    for name, splits in parts.items():
        squares = np.zeros(3)
        for held_out in splits:
            train, test = recording.rows(~held_out), recording.rows(held_out)
            refits = name not in ("a fifth of the rows", "a seventh of the patterns")
            z = model.fit([train], whole, f"{robot}: without {name}") if refits else whole
            mean = train.tips.mean(axis=0)
            free = mean + Process.of(train, train.tips - mean, FREE, SLOPE)(test)
            modelled = model.tips(z, test)
            both = modelled + Process.of(train, centred(train.tips - model.tips(z, train)))(test)
            squares += [held_out.sum() * rms(test.tips, tips) ** 2 for tips in (free, modelled, both)]
        rows.append([name, *(f"{error:.2f}" for error in np.sqrt(squares / sum(part.sum() for part in splits)))])
    return markdown_table(["held out", "no model", "physics", "both"], rows)


def repeatability(
    recording: Recording, modelled: Array, apart: float = 0.5, pause: float = 5.0
) -> list[tuple[str, int, float]]:
    """Spread of tips at equal commands: pairs of rows with motors within `apart` mm, at least `pause` s apart.

    Small differences of commands are taken out by a model of the present command. Half of the mean square of the
    differences is the variance that no model can explain which knows the present command alone; the second number
    counts only rows whose motors were on the same way (no motor moved the other way in the last step), for models that
    know the past.
    """
    moves = np.diff(recording.motors, axis=0, prepend=recording.motors[:1])
    residuals, squares, same = recording.tips - modelled, [], []
    for row, time in enumerate(recording.times):
        near = np.abs(recording.motors - recording.motors[row]).max(axis=1) < apart
        near &= recording.times > time + pause
        differences = np.sum((residuals[near] - residuals[row]) ** 2, axis=1)
        squares.extend(differences)
        same.extend((moves[near] * moves[row] > -1e-3).all(axis=1))
    every, alike = np.array(squares), np.array(same, bool)
    kinds = ("any past", every), ("motors on the same way", every[alike])
    return [(what, len(chosen), float(np.sqrt(0.5 * chosen.mean()))) for what, chosen in kinds if len(chosen)]


def picture(path: Path, recording: Recording, modelled: Array, title: str) -> None:
    """Measured and modelled tips: paths from above, and coordinates against rows."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    from rollingjoint.plotting import save_figure

    measured = recording.tips - recording.tips.mean(axis=0)
    modelled = modelled - modelled.mean(axis=0)
    figure, axes = plt.subplot_mosaic([["above", "x"], ["above", "y"], ["above", "z"]], figsize=(13, 6))
    styles = (measured, {"color": "black", "label": "measured"}), (modelled, {"color": "#d55e00", "label": "modelled"})
    for tips, style in styles:
        axes["above"].plot(tips[:, 0], tips[:, 1], linewidth=0.8, **style)
        for k, name in enumerate("xyz"):
            axes[name].plot(tips[:, k], linewidth=0.9, **style)
            axes[name].set_ylabel(f"{name} [mm]")
    axes["above"].set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal", title=title)
    axes["above"].legend(loc="upper right")
    axes["z"].set_xlabel("row")
    figure.tight_layout()
    save_figure(figure, path, dpi=80)
    plt.close(figure)


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robot", required=True, choices=tuple(ROBOTS))
    parser.add_argument("--fit", required=True, type=Path, metavar="FOLDER", help="with ROBOT_*.csv to fit")
    parser.add_argument("--score", type=Path, metavar="FILE.csv", help="recording to score")
    text = "errors of every variant on inner splits, or of those with NAME in theirs: minutes"
    parser.add_argument("--variants", nargs="?", const="", metavar="NAME", help=text)
    parser.add_argument("--bound", action="store_true", help="what could be reached without a model: minutes")
    parser.add_argument(
        "--picture", type=Path, metavar="FILE.png", help="measured and modelled tips of the scored file"
    )
    given = parser.parse_args(arguments)
    set_threads(1)
    try:
        if given.picture:
            from rollingjoint.plotting.figure import check_figure_path

            check_figure_path(given.picture)
        recording = read_folder(given.fit, given.robot)
        scored = read(given.score) if given.score else recording
    except InvalidInput as error:
        parser.exit(2, f"{error}\n")
    if given.variants is not None:
        print(variants_table(recording, given.robot, given.variants))
    if given.bound:
        print(bound_table(recording, given.robot))
        return
    train = recording.rows(~np.isin(recording.times, scored.times)) if given.score else recording
    if len(train.times) < 50:
        parser.exit(
            2, f"{given.fit}: {len(train.times)} rows to fit that are not in the scored file: expected 50 or more\n"
        )
    known: dict[str, Array] = {}
    for free in (CALIBRATED, GEOMETRY, MOVING, VARIANTS[CHOSEN]):
        model = Model(ROBOTS[given.robot], free)
        z = model.fit_after(known, train, f"{given.robot}: fit of {model.size} numbers to {len(train.times)} rows")
        if free is GEOMETRY:
            without_past = model.tips(z, train)
    modelled = model.tips(z, scored)
    print(f"{given.robot}: {CHOSEN.strip()}; {len(train.times)} rows fitted, {len(scored.times)} scored")
    for name, values in model.values(z).items():
        unit = model.kinds[name].unit
        if name in ("play", "axial compliance"):  # of which the model takes the size
            values = np.abs(values)
        print(f"  {name}: {' '.join(f'{value:.4g}' for value in values)}" + (f" {unit}" if unit else ""))
    what = "fitted rows" if given.score is None else given.score.name
    print(f"physics: {rms(scored.tips, modelled):.2f} mm RMS on {what}")
    process = Process.of(train, centred(train.tips - model.tips(z, train)))
    print(
        f"physics and a Gaussian process of what it leaves: {rms(scored.tips, modelled + process(scored)):.2f} mm RMS"
    )
    for past, pairs, spread in repeatability(train, without_past):
        print(f"repeatability, {past}: {spread:.2f} mm over {pairs} pairs of rows with equal commands")
    if given.picture:
        picture(given.picture, scored, modelled, f"{given.robot}, {what}")


if __name__ == "__main__":
    main()
