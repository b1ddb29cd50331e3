"""Solves of drawn mechanisms, in every way that a user can ask for them. Runs inside a checkout."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

import rollingjoint as rj
from guard_rows.drawing import ALONE, ARM_KINDS, KINDS, LONG, Case, Sizes, arm_cases, planar_cases, variations
from guard_rows.record import Record
from rollingjoint.io.mechanism_file import mechanism_from_dict

PLACES = ("joint_angles", "poses", "tip", "tensions", "lengths", "status")
PLANAR = (
    *(*PLACES, "tendon_rates", "tendon_stiffness", "residual", "iterations", "ok", "free_joints"),
    *("contact_points", "contact_tangents", "contact_forces", "arc_lengths", "pressing_margins"),
)
MATRICES = ("stiffness", "smallest_eigenvalue")  # not of long chains: large, and eigenvalues take long
FRICTION = ("gap_tensions", "friction_states", "sticking", "slip", "dissipated_work")
DERIVATIVES = ("dposes_dlengths", "dtensions_dlengths")

ARMS = ("poses", "tip", "tensions", "lengths", "gap_tensions", "slip")  # in mm and N; rotations are in poses
ARM_RULE = {**dict.fromkeys(ARMS, (1e-7, 0.0)), "status": (0.0, 0.0)}
NUDGE, STEADY = 1e-11, 1e-7  # a change of the inputs, relative, and the answer that it may have [mm, N]

PREPARED, LEAST_SQUARES = 4, 4  # rows of a case that are solved so


def records(sizes: Sizes) -> Iterator[Record]:
    """Records of all rows."""
    for kind in KINDS:
        cases = list(planar_cases(kind, sizes.links))
        yield from _friction_records("planar", cases, None) if kind == "friction" else _planar_records(kind, cases)
        if kind == "plain":
            yield from (_least_squares(cases), _own_mechanisms(cases), _derivatives(cases))
        if kind == "all loads":
            yield _loads_per_row(cases)
    yield _loops()
    for kind in ARM_KINDS:
        cases = list(arm_cases(kind, sizes.arms))
        yield from _friction_records("arm", cases, ARM_RULE) if kind == "friction" else _arm_records(kind, cases)


class Asked:
    """A case as the checkout takes it."""

    def __init__(self, case: Case) -> None:
        self.name, self.given = case.name, case.given
        self.mechanism = mechanism_from_dict(case.mechanism)
        self.loads = [getattr(rj, name)(**arguments) for name, arguments in case.loads]
        neutral, length = self.mechanism.neutral_lengths, self.mechanism.length
        self.inputs = case.inputs if self.given == "tensions" else neutral + length * case.inputs
        self.options = {} if self.given == "tensions" else {"tension_limits": case.limits}

    def alone(self, row: int) -> Any:
        """The single solve of a row."""
        solve = rj.solve_tensions if self.given == "tensions" else rj.solve_lengths
        return solve(self.mechanism, self.inputs[row], self.loads, **self.options)

    def batch(self, inputs: Any = None, mechanism: Any = None, loads: Any = None, **options: Any) -> Any:
        """Some rows in one call."""
        solve = rj.solve_tensions_batch if self.given == "tensions" else rj.solve_lengths_batch
        values = self.inputs if inputs is None else inputs
        acting = self.loads if loads is None else loads
        return solve(self.mechanism if mechanism is None else mechanism, values, acting, **self.options, **options)


def planar_fields(case: Case) -> tuple[str, ...]:
    """What is compared of a chain."""
    return PLANAR if case.size >= LONG else (*PLANAR, *MATRICES)


def answers(found: Any, names: Sequence[str]) -> dict[str, Any]:
    """Fields of an equilibrium, what friction remembers of it included."""
    values = {name: getattr(found, name) for name in names}
    if "friction_states" in names:
        values |= {f"friction_state.{name}": value for name, value in found.friction_state._asdict().items()}
    return values


def _stacked(found: Sequence[Any], names: Sequence[str]) -> dict[str, Any]:
    each = [answers(one, names) for one in found]
    return {name: np.array([one[name] for one in each]) for name in each[0]}


def _planar_records(kind: str, cases: list[Case]) -> Iterator[Record]:
    """Single solves, prepared ones and batches: side by side up to 16 links, beyond by the solver for all cases."""
    alone, prepared, batch, warm = (
        Record(f"planar, {kind}: {way}") for way in ("alone", "prepared", "batch", "batch, warm")
    )
    for case in cases:
        asked, names, rows = Asked(case), planar_fields(case), len(case.inputs)
        alone.add(asked.name, _stacked([asked.alone(row) for row in range(min(ALONE, rows))], names))
        problem = rj.prepare(asked.mechanism, asked.loads, asked.given, **asked.options)
        prepared.add(asked.name, _stacked([problem.solve(values) for values in asked.inputs[:PREPARED]], names))
        first = asked.batch()
        batch.add(asked.name, answers(first, names))
        neighbours = np.roll(first.joint_angles, 1, axis=0)
        warm.add(asked.name, answers(asked.batch(starts=neighbours), names))
        for record, most in ((alone, ALONE), (prepared, PREPARED), (batch, rows), (warm, rows)):
            record.count += min(most, rows)
    yield from (alone, prepared, batch, warm)


def _friction_records(family: str, cases: list[Case], rule: dict[str, tuple[float, float]] | None) -> Iterator[Record]:
    """Paths step by step, and steps of batches whose rows have histories of their own."""
    path, batch = (Record(f"{family}, friction: {way}", rule) for way in ("path", "batch"))
    for case in cases:
        asked, names = Asked(case), (*(PLACES if rule else planar_fields(case)), *FRICTION)
        taken = rj.trace(asked.mechanism, asked.inputs[:ALONE], asked.loads, asked.given, **asked.options)
        path.add(asked.name, answers(taken, names))
        found = asked.batch(asked.inputs[:ALONE])
        for step in range(1, 3):
            found = asked.batch(asked.inputs[step * ALONE : (step + 1) * ALONE], history=found)
            batch.add(f"{asked.name}, step {step}", answers(found, names))
        path.count, batch.count = path.count + ALONE, batch.count + 3 * ALONE
        if rule:
            _mark_unsteady_path(path, asked, taken)
            _mark_unsteady_steps(batch, asked)
    yield from (path, batch)


def _mark_unsteady_path(record: Record, asked: Asked, taken: Any) -> None:
    inputs = (1.0 + NUDGE) * asked.inputs[:ALONE]
    nudged = rj.trace(asked.mechanism, inputs, asked.loads, asked.given, **asked.options)
    record.unsteady[asked.name] = _unsteady(taken, nudged)


def _mark_unsteady_steps(record: Record, asked: Asked) -> None:
    found, nudged = (asked.batch(factor * asked.inputs[:ALONE]) for factor in (1.0, 1.0 + NUDGE))
    for step in range(1, 3):
        rows = asked.inputs[step * ALONE : (step + 1) * ALONE]
        found, nudged = asked.batch(rows, history=found), asked.batch((1.0 + NUDGE) * rows, history=nudged)
        record.unsteady[f"{asked.name}, step {step}"] = _unsteady(found, nudged)


def _arm_records(kind: str, cases: list[Case]) -> Iterator[Record]:
    """Arms alone and in batches; rows that last bits of their inputs move visibly are marked."""
    alone, batch = (Record(f"arm, {kind}: {way}", ARM_RULE) for way in ("alone", "batch"))
    for case in cases:
        asked = Asked(case)
        found = asked.batch()
        unsteady = _unsteady(found, asked.batch((1.0 + NUDGE) * asked.inputs))
        batch.add(asked.name, answers(found, PLACES))
        batch.unsteady[asked.name] = unsteady
        alone.add(asked.name, _stacked([asked.alone(row) for row in range(ALONE)], PLACES))
        alone.unsteady[asked.name] = unsteady[:ALONE]
        alone.count, batch.count = alone.count + ALONE, batch.count + len(case.inputs)
    yield from (alone, batch)


def _unsteady(found: Any, nudged: Any) -> Any:
    """Which rows answer a nudge by more than a comparison may see, (rows,)."""
    moved = [np.abs(getattr(found, name) - getattr(nudged, name)) for name in ("tip", "tensions")]
    far = np.max([one.max(axis=-1) for one in moved], axis=0) > STEADY
    return far | (np.asarray(found.status) != np.asarray(nudged.status))


def _least_squares(cases: list[Case]) -> Record:
    record = Record("planar, plain: least squares")
    for case in (case for case in cases if case.given == "lengths" and case.size <= 40):
        asked = Asked(case)
        asked.options |= {"method": "least_squares"}
        record.add(asked.name, _stacked([asked.alone(row) for row in range(LEAST_SQUARES)], PLACES))
        record.count += LEAST_SQUARES
    return record


def _own_mechanisms(cases: list[Case]) -> Record:
    record = Record("planar, plain: batch with a mechanism per row")
    for case in cases:
        asked = Asked(case)
        rows = asked.inputs[:ALONE]
        each = [mechanism_from_dict(one) for one in variations(case.mechanism, len(rows))]
        record.add(asked.name, answers(asked.batch(rows, each), planar_fields(case)))
        record.count += len(rows)
    return record


def _loads_per_row(cases: list[Case]) -> Record:
    """Every row has its own share of the loads; tables are made of what single solves keep."""
    record = Record("planar, all loads: batch with loads per row")
    for case in cases:
        asked = Asked(case)
        own = [asked.loads[: k + 1] for k in range(len(asked.loads))]
        tables = [rj.solve_tensions(asked.mechanism, [1.0] * len(case.inputs[0]), one).loads for one in own]
        most = max(map(len, tables))
        stacked = np.array([np.pad(one, ((0, most - len(one)), (0, 0))) for one in tables])
        found = asked.batch(asked.inputs[: len(own)], loads=stacked)
        record.add(asked.name, answers(found, planar_fields(case)))
        record.count += len(own)
    return record


def _derivatives(cases: list[Case]) -> Record:
    record = Record("planar, plain: sensitivities")
    for case in cases:
        asked = Asked(case)
        for row in range(2):
            found = asked.alone(row)
            if found.ok and case.given == "lengths":
                case_name = f"{asked.name}, row {row}"
                record.add(case_name, {name: getattr(rj.sensitivity, name)(found) for name in DERIVATIVES})
                record.add(case_name, {"dposes_dload": rj.sensitivity.dposes_dload(found, -1)})
                record.count += 1
    return record


def _loops() -> Record:
    record = Record("planar, friction: loops")
    for name in ("five_link", "uniform"):
        rubbed = rj.preset(name).replace(friction=rj.CapstanFriction(0.1))
        loop = rj.trace_loop(rubbed, swing=(-5, 5), steps=40)
        figures = ("inputs", "branches", "width", "width_in_the_middle", "dissipated_work", "motor_work")
        record.add(name, {each: getattr(loop, each) for each in figures})
        record.count += len(loop.inputs)
    return record
