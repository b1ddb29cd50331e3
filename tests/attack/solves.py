"""Batches of random equilibria, each recomputed from geometry: poses, lengths, tensions, friction, balance."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from rollingjoint import HingeChain, RollingChain, SpatialChain, Status, solve_lengths_batch, solve_tensions_batch
from tests.attack import drawing
from tests.attack.arms import ArmGeometry
from tests.attack.law import tendon_energy, tendon_tensions
from tests.attack.ledger import LONGEST
from tests.attack.minima import minimum
from tests.attack.planar import PlanarGeometry
from tests.attack.space import SpaceGeometry

ROWS, HARD_ROWS = 8192, 512
LONGEST_WITH_FRICTION = 12.0  # s of processor time: 256 steps with friction of a taut arm of 32 hinges take 5
STEPS_WITH_FRICTION = 4
PLACE, LENGTH = 1e-7, 1e-7  # mm: how far poses and lengths may be off
BALANCE = 1e-7  # N·mm, and times 1e-7 of the sum of the terms: how far moments may be off
CLOSED = 1e-4  # mm: a gap below it has no direction that can be recomputed
HARD = 0.3  # of the rounds with planar chains without friction
MISSED = 4  # rows without an equilibrium, of one round, that the second solver looks at
_LIMITS = ((0.0, np.inf), (0.0, 15.0), (0.5, 30.0))
_AT_END = 1e-9  # rad
_DRAWN = {
    "planar": (drawing.draw_chain, drawing.draw_planar_loads),
    "arm": (drawing.draw_arm, drawing.draw_arm_loads),
    "space": (drawing.draw_space, drawing.draw_space_loads),
}
_SHARES = (0.4, 0.25, 0.35)
_GEOMETRIES = {RollingChain: PlanarGeometry, HingeChain: ArmGeometry, SpatialChain: SpaceGeometry}
_TITLES = {RollingChain: "planar chains", HingeChain: "arms", SpatialChain: "chains in space"}


@dataclass
class Case:
    """One batch and what it is to be recomputed from."""

    mechanism: Any
    given: str
    inputs: Any
    tables: Any
    starts: Any
    limits: tuple[float, float]
    before: Any = None  # the equilibria of the step before
    outside: Any = None  # forces and moments of walls on every link, (B, n, 2) and (B, n), and sums of terms, (B, n)

    def solve(self, rows=slice(None)):
        """The equilibria of some rows."""
        options = {"loads": self.tables[rows], "starts": self.starts[rows]}
        if self.before is not None:
            options["history"] = type(self.before)(*(array[rows] for array in self.before))
        if self.given == "tensions":
            return solve_tensions_batch(self.mechanism, self.inputs[rows], **options)
        return solve_lengths_batch(self.mechanism, self.inputs[rows], tension_limits=self.limits, **options)

    def faults(self, result, expected_invalid):
        """What is wrong, {name: (rows, how far)}, and how many rows were recomputed."""
        return _Recomputed(self, result).faults(expected_invalid)


class _Recomputed:
    def __init__(self, case, result):
        self.case, self.result = case, result
        self.geometry = geometry_of(case.mechanism)
        self.rows = np.flatnonzero(Status.usable(result.status))

    def faults(self, invalid):
        result, case, rows = self.result, self.case, self.rows
        found = {}
        status = np.asarray(result.status)
        _note(found, "status of unusable numbers", (status == Status.INVALID_INPUT) != invalid, np.arange(len(status)))
        for name in ("joint_angles", "poses", "tensions", "lengths", "tendon_rates"):
            bad = ~np.isfinite(getattr(result, name)).reshape(len(status), -1).all(axis=1)
            _note(found, f"finite {name}", bad, np.arange(len(status)))
        if not rows.size:
            return found, 0
        pick = _Rows(result, rows)
        cuts = self.geometry.cuts(self.geometry.coordinates(pick))
        gaps = np.where(self.geometry.crossed, cuts.gaps, np.inf)
        clear = gaps.reshape(len(rows), -1).min(axis=1) > CLOSED
        self._compare(found, "joint angles", cuts.angles, pick.joint_angles, 1e-9)
        self._compare(found, "poses", *self._places(cuts, pick), PLACE)
        lengths = self.geometry.lengths(cuts)
        self._compare(found, "lengths", lengths, pick.lengths, LENGTH)
        stiffnesses = np.array([tendon.stiffness for tendon in case.mechanism.tendons])
        motor = tendon_tensions(pick.lengths, case.inputs[rows], case.given, stiffnesses, case.limits)
        self._compare(found, "tensions", motor, pick.tensions, 1e-6)
        before = None if case.before is None else type(case.before)(*(array[rows] for array in case.before))
        tensions, states, slips = self.geometry.gap_tensions(cuts, pick.tensions, before, None)
        if before is not None:
            self._compare(found, "gap tensions", tensions, pick.gap_tensions, 1e-5, clear)
            self._compare(found, "friction states", states, pick.friction_states, 1e-5)
            self._compare(found, "slips", slips, pick.friction_state.slips, 1e-6)
            tensions = pick.gap_tensions
        outside = [[part[rows] for part in case.outside]] if case.outside is not None else []
        torque, size, normal = self.geometry.imbalance(cuts, case.tables[rows], tensions, before, *outside)
        self._balance(found, pick, torque, size, clear)
        if isinstance(self.geometry, SpaceGeometry):
            share = self.geometry.unbalanced(cuts, case.tables[rows], tensions, pick.reactions) / BALANCE
            _note(found, "balance of links", ~(share.max(axis=1) <= 1.0) & clear, rows, share.max(axis=1))
        elif normal is not None:
            forces = np.abs(normal - pick.contact_forces[..., 1]) / (1.0 + np.abs(normal))
            _note(found, "normal forces", (forces.max(axis=1) > 1e-6) & clear, rows, forces.max(axis=1))
        return found, int(clear.sum())

    def _compare(self, found, name, own, given, tolerance, which=True):
        off = np.abs(own - given).reshape(len(self.rows), -1).max(axis=1)
        _note(found, name, ~(off <= tolerance) & which, self.rows, off)

    def _places(self, cuts, pick):
        if self.geometry.dimension == 2:
            return cuts.poses, pick.poses
        own = np.concatenate([cuts.R, cuts.origins[..., None]], axis=-1)
        return own, pick.poses[..., :3, :]

    def _balance(self, found, pick, torque, size, clear):
        """A free joint is in balance; one at its limit is pushed against it."""
        low, high = limits_of(self.case.mechanism)
        allowed = BALANCE * (1.0 + size)
        at_low, at_high = pick.joint_angles <= low + _AT_END, pick.joint_angles >= high - _AT_END
        wrong = np.where(at_low, np.maximum(torque, 0.0), np.where(at_high, np.minimum(torque, 0.0), torque))
        wrong = np.abs(wrong) / allowed
        _note(found, "balance", ~(wrong.max(axis=1) <= 1.0) & clear, self.rows, wrong.max(axis=1))
        held = ((at_low | at_high) & (np.abs(torque) > allowed)).any(axis=1)
        _note(found, "status at limits", held & (pick.status == Status.CONVERGED) & clear, self.rows)


class _Rows:
    """The arrays of some rows of an equilibrium."""

    def __init__(self, result, rows):
        self._result, self._rows = result, rows

    def __getattr__(self, name):
        value = getattr(self._result, name)
        if isinstance(value, tuple):
            return type(value)(*(array[self._rows] for array in value))
        return np.asarray(value)[self._rows]


def limits_of(mechanism):
    """Smallest and largest angle of every joint, (J,) each [rad]."""
    if mechanism.dimension == 3:
        return np.array(mechanism.joint_limits).T
    ends = np.array([mechanism.joint_angles(s) for s in np.array(mechanism.joint_limits).T])
    return ends.min(axis=0), ends.max(axis=0)


def draw(rng, family, with_friction=False):
    """A case without history, with every row usable."""
    mechanism, loads = _DRAWN[family]
    chain = mechanism(rng, with_friction)
    given = str(rng.choice(["tensions", "lengths"]))
    rows = max(256, ROWS * 4 // max(4, chain.n_joints) // (4 if family != "planar" or with_friction else 1))
    tables = loads(rng, chain, rows, dead=rng.random() < 0.7)
    starts = np.repeat(np.array(chain.neutral_angles)[None], rows, axis=0)
    if rng.random() < 0.5:
        starts = starts + rng.normal(0.0, 0.1, starts.shape)
    limits = _LIMITS[rng.integers(3)]
    return Case(chain, given, drawing.draw_inputs(rng, chain, given, rows), tables, starts, limits)


def draw_hard(rng):
    """A case of a chain that is hard to solve, from cold starts."""
    chain, given, inputs, tables = drawing.draw_hard(rng, HARD_ROWS)
    starts = np.repeat(np.array(chain.neutral_angles)[None], HARD_ROWS, axis=0)
    return Case(chain, given, inputs, tables, starts, _LIMITS[rng.integers(3)])


def cases(rng, family=None):
    """(case, rows with unusable numbers) of one round, of that family or a random one; with friction a path."""
    family = str(rng.choice(list(_DRAWN), p=_SHARES)) if family is None else family
    with_friction = bool(rng.random() < 0.35)
    if family == "planar" and not with_friction and rng.random() < HARD:
        case = draw_hard(rng)
        yield case, np.zeros(len(case.inputs), bool)
        return
    case = draw(rng, family, with_friction)
    if not with_friction:
        yield case, drawing.spoil(rng, case.inputs, case.starts, case.tables)
        return
    begin = case.solve()
    yield case, np.zeros(len(case.inputs), bool)
    case.before, case.starts = begin.friction_state, np.array(begin.joint_angles)
    for _ in range(STEPS_WITH_FRICTION):
        change = rng.uniform(0.7, 1.3, case.inputs.shape) if case.given == "tensions" else None
        case.inputs = (
            case.inputs * change if change is not None else case.inputs + rng.normal(0, 1.0, case.inputs.shape)
        )
        result = case.solve()
        yield case, np.zeros(len(case.inputs), bool)
        case.before, case.starts = result.friction_state, np.array(result.joint_angles)


def attack(rng, report):
    """One round: some thousand rows, recomputed; a few of them solved again one by one; energies of a few."""
    for case, invalid in cases(rng):
        with report.limited("a batch", LONGEST if case.before is None else LONGEST_WITH_FRICTION):
            result = case.solve()
        found, checked = case.faults(result, invalid)
        report.count("solves", len(invalid))
        report.count("solves recomputed", checked)
        kind = f"solves recomputed: {_TITLES[type(case.mechanism)]}{'' if case.before is None else ' with friction'}"
        report.count(kind, checked)
        for status in Status:
            report.count(f"status {status.name}", int(np.sum(np.asarray(result.status) == status)))
        for name, (rows, off) in found.items():
            report.fail(f"{name}: {len(rows)} rows, worst {off:.3g}, first {rows[0]}", rows=rows[:4], case=case)
        again_alone(rng, case, result, report)
        if case.before is None:
            energies(rng, case, result, report)
            missed(rng, case, result, report)


def again_alone(rng, case, result, report):
    """A row is the same to the last bit in a batch of its own."""
    row = int(rng.integers(len(case.inputs)))
    alone = case.solve(slice(row, row + 1))
    for name in ("joint_angles", "poses", "tensions", "lengths", "status"):
        if not np.array_equal(getattr(alone, name)[0], getattr(result, name)[row], equal_nan=True):
            report.fail(f"row {row} alone has other {name}", rows=[row], case=case)


def energies(rng, case, result, report):
    """Where there is a potential, no small step away from an equilibrium lowers it."""
    rows = np.flatnonzero(np.asarray(result.status) == Status.CONVERGED)[:16]
    if not rows.size or not has_potential(case)[rows].all():
        return
    geometry = geometry_of(case.mechanism)
    pick, low_high = _Rows(result, rows), limits_of(case.mechanism)
    stiffnesses = np.array([tendon.stiffness for tendon in case.mechanism.tendons])
    potential = tendon_energy(case.inputs[rows], case.given, stiffnesses, case.limits)
    at, tables = geometry.coordinates(pick), case.tables[rows]
    free = ((pick.joint_angles > low_high[0] + 1e-3) & (pick.joint_angles < low_high[1] - 1e-3)).all(axis=1)
    least, here = np.inf, geometry.energy(at, tables, potential)
    for step in (1e-3, 1e-4):
        way = step * rng.normal(size=at.shape)
        for sign in (1.0, -1.0):
            there = geometry.energy(np.clip(at + sign * way, *geometry.limits), tables, potential)
            least = np.minimum(least, there - here)
    noise = 1e-9 * (1.0 + np.abs(here)) + 1e-9
    _report_lower(report, rows[free & (least < -noise)], case)
    report.count("energies compared by finite differences", int(free.sum()))


def missed(rng, case, result, report):
    """Where there is a potential, no row ends without an equilibrium while a bounded minimiser finds one."""
    failed = np.isin(np.asarray(result.status), (Status.UNSTABLE, Status.NOT_CONVERGED)) & has_potential(case)
    report.count("rows with a potential", int(has_potential(case).sum()))
    report.count("rows with a potential that end without an equilibrium", int(failed.sum()))
    rows = np.flatnonzero(failed)[:MISSED]
    if not rows.size:
        return
    geometry = geometry_of(case.mechanism)
    ends = geometry.coordinates(_Rows(result, rows))
    for row, end in zip(rows.tolist(), ends, strict=True):
        if minimum(rng, case, geometry, row, end) is not None:
            name = Status(int(result.status[row])).name
            report.fail(f"{name} where a minimiser finds a minimum: row {row}", rows=[row], case=case)


def has_potential(case):
    """Rows on which no force turns with its link, (B,)."""
    driving = case.tables[:, :, 7:16] if case.mechanism.dimension == 3 else case.tables[:, :, 5:7]
    return ~np.any(driving, axis=(1, 2))


def geometry_of(mechanism):
    """What recomputes the mechanism from its description."""
    return _GEOMETRIES[type(mechanism)](mechanism)


def _report_lower(report, rows, case):
    if rows.size:
        report.fail(f"energy falls away from an equilibrium: rows {rows[:4]}", rows=rows[:4], case=case)


def _note(found, name, wrong, rows, off=None):
    if wrong.any():
        found[name] = rows[wrong], float(np.max(off[wrong])) if off is not None else float(wrong.sum())
