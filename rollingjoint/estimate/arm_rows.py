"""Hidden numbers of an arm followed along histories of its motors: the expected measurements, and their derivatives.

Every row is a vector of hidden numbers (arm_hidden.py). At each step its tendons are where the play operator takes
them, its equilibrium is solved with friction in the holes, and all that is measured is differentiated by all hidden
numbers. Symbols: r residual, A = dr/dangle; T tension, k stiffness of a tendon.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rollingjoint.chain.batch import begin_range, free_joints, pivots_of, step_range, stiffnesses, tip_rates
from rollingjoint.chain.hinge import HingeChain
from rollingjoint.chain.spatial import SpatialChain
from rollingjoint.compiled import (
    MU,
    N_COEFFICIENTS,
    PRESLIDING,
    FrictionLaw,
    History,
    PinnedRange,
    TendonLaw,
    new_friction_arrays,
    run_in_threads,
)
from rollingjoint.estimate.arm_derivatives import RubbedTendons, add_rows, add_tendon_causes, pass_on, solve_rows
from rollingjoint.estimate.arm_hidden import ArmPrior
from rollingjoint.estimate.arrays import MotorHistory
from rollingjoint.kernels.arrays import AT_LIMIT
from rollingjoint.load import SPATIAL_LOAD_COLUMNS
from rollingjoint.transmission import play_contact, play_step, sheath_direction, sheath_ratio

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

Arm = HingeChain | SpatialChain

_LINK, _POINT, _FORCE = (SPATIAL_LOAD_COLUMNS.index(name) for name in ("link", "px", "fx"))
_OF_ALL = ("tendon_joints", "cells", "coefficients")  # fields of an arm's arrays that all designs share
_NARROW = 1e-6  # mm: half the width of a play that is none
_LOST = 100.0  # cost of a step without a usable equilibrium
_YIELD = 1e-6  # mm: a motor that is farther from where it was asked to go has given way
_LEAST_TENSION = 1e-3  # N: motors that are set by load cells hold at least that
_LARGEST_TENSION = 1e4  # N: motors stand where they were measured, whatever the tension


class ArmLaw(NamedTuple):
    """The limits of tension of an arm, its start, and the errors of its measurements.

    start_tension: of all tendons before the payload acts [N]. start_sd: of the lengths that follow from it [mm].
    low, high: tensions at which motors take their tendons along; inf: not known [N]. limit_sd: of these; inf: they are
    not used [N].
    tension_sd: of a measured tension [N]. tension_share: the same in proportion to it. robust: standard deviations
    beyond which a residual counts linearly. presliding: of the holes [mm].
    cells_at_tendons: whether load cells are behind the sheath. measured: whether it is load cells that show the start
    tension, of motors with their offsets.
    """

    start_tension: float
    start_sd: float
    low: float
    high: float
    limit_sd: float
    tension_sd: float
    tension_share: float
    robust: float
    presliding: float
    cells_at_tendons: bool = False
    measured: bool = False


def tip_covariance(information: Array, tip_by: Array, sds: Array) -> Array:
    """Covariance of the tip given all measurements, (R, d, d) [mm²].

    Args:
        information: of the hidden numbers in units of their standard deviations, lower triangle, (R, K, K).
        tip_by: (R, d, K). sds: (K,); numbers with a standard deviation of 0 are taken as known.
    """
    lower, unknown = np.tril(information), np.flatnonzero(sds)
    whole = (lower + np.swapaxes(np.tril(lower, -1), 1, 2))[:, unknown[:, None], unknown]
    by = (tip_by * sds)[:, :, unknown]
    return np.asarray(by @ np.linalg.solve(whole, np.swapaxes(by, 1, 2)))


@dataclass
class ArmRows:
    """Rows of hidden numbers, how far they have been followed, and the normal equations of the measurements.

    Changes of hidden numbers are in units of their standard deviations in the normal equations.

    Args:
        episodes: (R,). numbers: (R, K). steps: that have been followed, (R,).
        played: commands of the tendons behind the play [mm], by_width, by_place: their derivatives, (R, m).
        angles: of the equilibrium, (R, J) [rad]. states, slips, grips: of the holes, as in FrictionState, (R, J, m).
        states_by: derivatives of z + s/δ of the holes, (R, J, m, K).
        information, slope: the lower triangle (R, K, K), and (R, K). cost: (R,).
        misfit: the part of it that measurements have, (R,).
        tip: (R, 3) [mm]. tip_by: (R, 3, K). tensions: (R, m) [N]. tensions_by: (R, m, K).
    """

    episodes: Integers
    numbers: Array
    steps: Integers
    played: Array
    by_width: Array
    by_place: Array
    angles: Array
    states: Array
    slips: Array
    grips: Array
    states_by: Array
    information: Array
    slope: Array
    cost: Array
    misfit: Array
    tip: Array
    tip_by: Array
    tensions: Array
    tensions_by: Array

    def tip_covariance(self, sds: Array) -> Array:
        """Covariance of the tip given all measurements, (R, 3, 3) [mm²]: see tip_covariance."""
        return tip_covariance(self.information, self.tip_by, sds)

    @classmethod
    def of(cls, episodes: Integers, numbers: Array, n_joints: int, m: int) -> ArmRows:
        """Rows at the start of their histories."""
        R, K = numbers.shape
        holes = (n_joints, m)
        shapes = (
            [(m,)] * 3 + [(n_joints,)] + [holes] * 3 + [(*holes, K), (K, K), (K,), (), (), (3,), (3, K), (m,), (m, K)]
        )
        return cls(episodes, numbers, np.zeros(R, np.int64), *(np.zeros((R, *shape)) for shape in shapes))

    def take(self, rows: Integers) -> ArmRows:
        """A copy of some rows."""
        return ArmRows(*(getattr(self, each.name)[rows] for each in fields(self)))

    def put(self, rows: Integers, other: ArmRows, places: Integers | slice = slice(None)) -> None:
        """Replace rows by the rows of another object at these places."""
        for each in fields(self):
            getattr(self, each.name)[rows] = getattr(other, each.name)[places]


@dataclass(frozen=True)
class _ArmEquilibria:
    """Equilibria of R rows, with dr/dangle (R, J, J) and the friction in the holes, None without it."""

    batch: Any
    usable: NDArray[np.bool_]
    A: Array
    friction: Any

    @property
    def free(self) -> NDArray[np.bool_]:
        return free_joints(self.batch)


class FollowedArm:
    """An arm with a prior and a law, along whose rows histories are followed.

    Args:
        arm: nominal, an arm with exact tendons or a chain in space. prior: of the hidden numbers. law: of its
            measurements.
    """

    def __init__(self, arm: Arm, prior: ArmPrior, law: ArmLaw) -> None:
        self.arm, self.prior, self.law = arm, prior, law
        self._table = np.zeros((arm.n_links, len(SPATIAL_LOAD_COLUMNS)))  # weights, and the payload in the last row
        self._table[:, _LINK] = [*range(1, arm.n_links), arm.n_joints]
        self._table[:-1, _POINT : _POINT + 3] = arm.centres

    def begun(self, episodes: Integers, numbers: Array) -> ArmRows:
        """Rows of hidden numbers (R, K) at the start of the histories of these episodes."""
        return ArmRows.of(episodes.copy(), numbers, self.arm.n_joints, self.arm.n_tendons)

    def followed(self, history: MotorHistory, episodes: Integers, numbers: Array) -> ArmRows:
        """Rows of hidden numbers (R, K) along the histories of these episodes."""
        rows = self.begun(episodes, numbers)
        self.follow(rows, history)
        return rows

    def follow(self, rows: ArmRows, history: MotorHistory) -> None:
        """Follow rows to the last step of their histories."""
        while (going := np.flatnonzero(rows.steps < history.counts[rows.episodes])).size:
            for step in np.unique(rows.steps[going]).tolist():
                due = going[rows.steps[going] == step]
                part = rows if len(due) == len(rows.steps) else rows.take(due)
                self._advance(part, history, step)
                if part is not rows:
                    rows.put(due, part)

    def _advance(self, rows: ArmRows, history: MotorHistory, step: int) -> None:
        """Follow all rows by a step, which is the same for all."""
        motors, shifts, tensions = (values[rows.episodes, step] for values in history[1:4])
        start = self._begin(rows, motors) if step == 0 else None
        if start is None:
            self._move_tendons(rows, motors, shifts)
        solved = self._step(rows)
        self._differentiate(rows, solved)
        if start is not None:
            self._take_start(rows, *start)
        self._take_tensions(rows, motors, shifts, tensions)
        lost = ~(solved.usable & np.isfinite(rows.cost))
        rows.cost[lost] += _LOST
        rows.misfit[lost] += _LOST
        rows.steps += 1

    def _begin(self, rows: ArmRows, motors: Array) -> tuple[Array, Array]:
        """Begin with the prior, and with tendons that are at the start tension and have not slipped.

        Returns:
            How far lengths at the start tension are from where tendons are, (R, m) [mm], and the derivatives by
            the hidden numbers of the tendons' places less the lengths, (R, m, K).
        """
        prior, at, law, each = self.prior, self.prior.layout, self.law, np.arange(self.arm.n_tendons)
        off = np.divide(prior.means - rows.numbers, prior.sds, out=np.zeros_like(rows.numbers), where=prior.sds > 0.0)
        rows.information[:], rows.slope[:] = np.eye(at.total), off
        rows.cost[:], rows.misfit[:] = 0.5 * (off**2).sum(axis=1), 0.0
        half, places = rows.numbers[:, at.half_widths : at.frictions], rows.numbers[:, at.places : at.gains]
        rows.played[:], rows.by_width[:], rows.by_place[:] = motors - 2.0 * places * half, -2.0 * places, -2.0 * half
        tensions, tensions_by = self._start_tensions(rows, motors)
        solved = self._start(rows, tensions)
        tendons, causes = self._tendons(rows, solved), self._load_causes(rows, solved, 0.0)
        add_tendon_causes(tendons, tensions_by, rows.states_by, at.holes, at.hinges - at.holes == 1, causes)
        turns, lengths_by = self._turns(rows, solved, causes), np.empty_like(tensions_by)
        pass_on(tendons, turns, law.presliding, True, rows.states_by, lengths_by)
        stiffnesses_now = self._stiffnesses(rows)
        columns = tensions_by / stiffnesses_now[:, :, None] - lengths_by
        columns[:, each, at.half_widths + each] += rows.by_width
        columns[:, each, at.places + each] += rows.by_place
        factors = rows.numbers[:, at.stiffnesses : at.half_widths]
        columns[:, each, at.stiffnesses + each] -= tensions / (stiffnesses_now * factors)
        away = solved.batch.results.lengths - tensions / stiffnesses_now - rows.played
        if law.measured:
            away -= rows.numbers[:, at.offsets : at.stiffnesses]
            columns[:, each, at.offsets + each] += 1.0
        return away, columns

    def _start_tensions(self, rows: ArmRows, motors: Array) -> tuple[Array, Array]:
        """Tensions before the payload acts, (R, m) [N], and their derivatives by the hidden numbers, (R, m, K)."""
        at, law, each = self.prior.layout, self.law, np.arange(self.arm.n_tendons)
        tensions, tensions_by = np.full_like(rows.played, law.start_tension), np.zeros_like(rows.tensions_by)
        if not law.measured:
            return tensions, tensions_by
        gain, zero = self.prior.cells(rows.numbers)
        tensions = (tensions - zero) / gain
        share = np.ones_like(tensions)
        if not law.cells_at_tendons:
            half, friction = self._sheaths(rows)
            place = sheath_direction(rows.played, motors, half)
            share = 1.0 / sheath_ratio(friction, place)
            tensions = share * tensions
            tensions_by[:, each, at.frictions + each] = -tensions * place
            inside = (half > 0.0) & (np.abs(place) < 1.0)
            tensions_by[:, each, at.places + each] = np.where(inside, 2.0 * friction * tensions, 0.0)
        if at.gains < at.zeros:
            tensions_by[:, each, at.gains + each] = -tensions / gain
            tensions_by[:, each, at.zeros + each] = -share / gain
        held = tensions > max(law.low, _LEAST_TENSION)
        return np.where(held, tensions, max(law.low, _LEAST_TENSION)), np.where(held[:, :, None], tensions_by, 0.0)

    def _sheaths(self, rows: ArmRows) -> tuple[Array, Array]:
        """Half widths of the play, 0 where there is none, and coefficients of friction, (R, m) each."""
        at = self.prior.layout
        half = rows.numbers[:, at.half_widths : at.frictions]
        return np.where(half > _NARROW, half, 0.0), rows.numbers[:, at.frictions : at.places]

    def _take_start(self, rows: ArmRows, away: Array, columns: Array) -> None:
        """Take in that tendons begin at the start tension, but those which are at a limit as soon as they are held."""
        law, margin = self.law, 3.0 * self.law.tension_sd
        slack, tight = rows.tensions <= law.low + margin, rows.tensions >= law.high - margin
        yielded = (slack & (away > 0.0)) | (tight & (away < 0.0))
        self._add(rows, columns, np.where(yielded, np.nan, away), np.full_like(away, law.start_sd))

    def _move_tendons(self, rows: ArmRows, motors: Array, shifts: Array) -> None:
        half = rows.numbers[:, self.prior.layout.half_widths : self.prior.layout.frictions]
        sides = play_contact(rows.played, motors - shifts, half)
        moved = sides != 0.0
        rows.by_width[moved], rows.by_place[moved] = sides[moved], 0.0
        rows.played[:] = play_step(rows.played, motors - shifts, half) + shifts

    def _stiffnesses(self, rows: ArmRows) -> Array:
        at = self.prior.layout
        values: Array = self.arm.stiffnesses * rows.numbers[:, at.stiffnesses : at.half_widths]
        return values

    def _batch(self, rows: ArmRows, laws: TendonLaw, starts: Array, pays: float) -> Any:
        """The batch of rows, with room for its results; `pays`: 1 where the payload acts, else 0."""
        arm, at, R = self.arm, self.prior.layout, len(rows.steps)
        tables = self.load_tables(rows.numbers, pays)
        springs = arm.arrays.springs * rows.numbers[:, at.hinges : at.weights]
        stack = arm.arrays._asdict()
        stack |= {name: np.repeat(each, R, axis=0) for name, each in stack.items() if name not in _OF_ALL}
        chain = type(arm.arrays)(**(stack | {"springs": springs}))
        results = arm.kernels.new_results(R, arm.n_joints, arm.n_tendons)
        return arm.kernels.batch_arrays(chain, np.arange(R), laws, tables, starts.copy(), results)

    def load_tables(self, numbers: Array, pays: float = 1.0) -> Array:
        """Weights and payload of hidden numbers (R, K) as loads, (R, J + 1, columns); `pays` as of `_batch`."""
        at = self.prior.layout
        tables = np.repeat(self._table[None], len(numbers), axis=0)
        sizes = np.concatenate([self._weights(numbers), pays * numbers[:, at.payload, None]], axis=1)
        tables[:, :, _FORCE : _FORCE + 3] = sizes[:, :, None] * self._gravity(numbers)[:, None]
        return tables

    def _friction(self, rows: ArmRows) -> Any:
        at, R, n_joints = self.prior.layout, len(rows.steps), self.arm.n_joints
        coefficients = np.zeros((R, self.arm.n_tendons, N_COEFFICIENTS))
        coefficients[:, :, PRESLIDING] = self.law.presliding
        coefficients[:, :, MU] = rows.numbers[:, at.holes : at.hinges]
        rolling = np.tile(self.arm.rolling_coefficients, (R, 1))
        history = History(rows.states, rows.slips, rows.grips, rows.angles.copy(), np.zeros((R, n_joints)))
        return new_friction_arrays(FrictionLaw(coefficients, rolling), history)

    def _start(self, rows: ArmRows, tensions: Array) -> _ArmEquilibria:
        """Equilibria at tensions (R, m) without payload and friction; begins the history of the holes."""
        R, J = len(rows.steps), self.arm.n_joints
        laws = TendonLaw(np.zeros_like(tensions), np.ones_like(tensions), tensions, tensions.copy())
        batch = self._batch(rows, laws, np.tile(self.arm.neutral_angles, (R, 1)), 0.0)
        run_in_threads(PinnedRange(self.arm.kernels, batch), R, J)
        rows.angles[:] = batch.starts[:] = batch.results.joint_angles
        friction = self._friction(rows)
        begin_range(batch, friction, 0, R)
        rows.states[:], rows.slips[:], rows.grips[:] = friction.before[:3]
        A, _ = stiffnesses(self.arm.kernels, batch)
        return _ArmEquilibria(batch, batch.results.status <= AT_LIMIT, A, None)

    def _step(self, rows: ArmRows) -> _ArmEquilibria:
        """Equilibria of the next step; the history of the holes goes on from them."""
        at, R, kernels = self.prior.layout, len(rows.steps), self.arm.kernels
        commands = rows.played + rows.numbers[:, at.offsets : at.stiffnesses]
        laws = TendonLaw(
            commands, self._stiffnesses(rows), np.zeros_like(commands), np.full_like(commands, _LARGEST_TENSION)
        )
        batch, friction = self._batch(rows, laws, rows.angles, 1.0), self._friction(rows)
        run_in_threads(partial(step_range, kernels, batch, friction), R, self.arm.n_joints)
        A, _ = stiffnesses(kernels, batch, friction)
        usable = batch.results.status <= AT_LIMIT
        rows.angles[usable] = batch.results.joint_angles[usable]
        for values, after in zip((rows.states, rows.slips, rows.grips), friction.after, strict=False):
            values[usable] = after[usable]
        return _ArmEquilibria(batch, usable, A, friction)

    def _tendons(self, rows: ArmRows, solved: _ArmEquilibria) -> RubbedTendons:
        at, results = self.prior.layout, solved.batch.results
        alike = np.repeat(results.tensions[:, None], self.arm.n_joints, axis=1)
        gap_tensions = alike if solved.friction is None else solved.friction.tension
        mu = rows.numbers[:, at.holes : at.hinges] * np.ones((1, self.arm.n_tendons))
        crossed = np.array(self.arm.last_links, np.int64)
        tensions = results.tensions, gap_tensions
        return RubbedTendons(crossed, results.rates, *tensions, rows.states, rows.grips, mu)

    def _differentiate(self, rows: ArmRows, solved: _ArmEquilibria) -> None:
        """Fill tip, tensions and their derivatives, and pass the holes' derivatives on."""
        at, results, m = self.prior.layout, solved.batch.results, self.arm.n_tendons
        tendons, each = self._tendons(rows, solved), np.arange(m)
        by_command = np.zeros((len(rows.steps), m, at.total))  # derivatives of the commands
        by_command[:, each, at.offsets + each] = 1.0
        by_command[:, each, at.half_widths + each] = rows.by_width
        by_command[:, each, at.places + each] = rows.by_place
        motors_by = -results.elastic[:, :, None] * by_command
        pulls = results.elastic > 0.0
        factors = rows.numbers[:, at.stiffnesses : at.half_widths]
        motors_by[:, each, at.stiffnesses + each] = np.where(pulls, results.tensions / factors, 0.0)
        causes = self._load_causes(rows, solved, 1.0)
        add_tendon_causes(tendons, motors_by, rows.states_by, at.holes, at.hinges - at.holes == 1, causes)
        turns, lengths_by = self._turns(rows, solved, causes), np.empty_like(motors_by)
        pass_on(tendons, turns, self.law.presliding, False, rows.states_by, lengths_by)
        rows.tensions[:] = results.tensions
        rows.tensions_by[:] = results.elastic[:, :, None] * lengths_by + motors_by
        rows.tip[:] = results.poses[:, -1, :3, 3]
        rows.tip_by[:] = tip_rates(self.arm.kernels, solved.batch) @ turns

    def _turns(self, rows: ArmRows, solved: _ArmEquilibria, causes: Array) -> Array:
        """Derivatives of the joint angles, (R, J, K): 0 for joints at a limit and where there is no equilibrium."""
        free = solved.free & solved.usable[:, None]
        A = np.where(free[:, :, None] & free[:, None], solved.A, np.eye(causes.shape[1]))
        turns: Array = np.where(free[:, :, None], causes, 0.0)
        solve_rows(A, turns)
        return turns

    def _load_causes(self, rows: ArmRows, solved: _ArmEquilibria, pays: float) -> Array:
        """Torques by hidden numbers of gravity, payload, hinges and weights, (R, J, K) [N·mm per unit]."""
        arm, at, poses = self.arm, self.prior.layout, solved.batch.results.poses
        R, J = len(rows.steps), arm.n_joints
        gravity, weights = self._gravity(rows.numbers), self._weights(rows.numbers)
        payload = pays * rows.numbers[:, at.payload]
        rotations, origins = poses[:, :, :3, :3], poses[:, :, :3, 3]
        pivots = pivots_of(arm.kernels, solved.batch.results)
        axes = (rotations[:, :-1] @ arm.arrays.axes[0][:, :, None])[..., 0]
        centres = origins[:, 1:] + (rotations[:, 1:] @ arm.centres[:, :, None])[..., 0]
        tip = origins[:, -1:] - pivots
        beyond = weights[:, ::-1].cumsum(axis=1)[:, ::-1, None]
        moments = (weights[:, :, None] * centres)[:, ::-1].cumsum(axis=1)[:, ::-1]
        moments = moments - beyond * pivots + payload[:, None, None] * tip
        levers = np.cross(gravity[:, None], axes)  # torque about an axis of a force along gravity, per distance
        causes = np.zeros((R, J, at.total))
        x, y, z = gravity.T
        by_gravity = np.cross(axes, moments)
        for axis, across in enumerate((x, y)):
            causes[:, :, axis] = by_gravity[:, :, axis] - by_gravity[:, :, 2] * (across / z)[:, None]
        causes[:, :, at.payload] = pays * (levers * tip).sum(axis=2)
        turned = levers @ np.swapaxes(centres, 1, 2) - (levers * pivots).sum(axis=2, keepdims=True)
        causes[:, :, at.weights : at.total] = np.triu(turned) * arm.weights
        each, angles = np.arange(J), solved.batch.results.joint_angles
        causes[:, each, at.hinges + each] = -arm.arrays.springs[0] * (angles - arm.arrays.joints[0, :, 2])
        return causes

    def _gravity(self, numbers: Array) -> Array:
        """Directions, (R, 3)."""
        across = numbers[:, :2]
        return np.concatenate([across, np.sqrt(1.0 - (across**2).sum(axis=1, keepdims=True))], axis=1)

    def _weights(self, numbers: Array) -> Array:
        at = self.prior.layout
        values: Array = self.arm.weights * numbers[:, at.weights : at.total]
        return values

    def _take_tensions(self, rows: ArmRows, motors: Array, shifts: Array, measured: Array) -> None:
        """Take the measured tensions of a step in, and that a motor which gives way is at its limit."""
        at, law, each = self.prior.layout, self.law, np.arange(self.arm.n_tendons)
        half, friction = self._sheaths(rows)
        gain, zero = self.prior.cells(rows.numbers)
        place = 0.0 * half if law.cells_at_tendons else sheath_direction(rows.played, motors, half)
        ratio = gain * sheath_ratio(friction, place)
        shown = ratio * rows.tensions
        columns = ratio[:, :, None] * rows.tensions_by
        inside = (half > 0.0) & (np.abs(place) < 1.0) & (not law.cells_at_tendons)
        pull = np.divide(shown * friction, half, out=np.zeros_like(half), where=inside)
        columns[:, each, at.half_widths + each] += pull * (rows.by_width - place)
        columns[:, each, at.places + each] += pull * rows.by_place
        columns[:, each, at.frictions + each] += shown * place
        if at.gains < at.zeros:
            columns[:, each, at.gains + each] += shown / gain
            columns[:, each, at.zeros + each] += 1.0
        expected = shown + zero
        self._add(rows, columns, measured - expected, np.hypot(law.tension_sd, law.tension_share * expected))
        yielded = np.abs(shifts) > _YIELD
        if yielded.any() and law.limit_sd < math.inf:
            limits = np.where(shifts > 0.0, law.high, law.low)
            off = np.where(yielded, limits - rows.tensions, np.nan)
            self._add(rows, rows.tensions_by, off, np.full_like(off, law.limit_sd))

    def _add(self, rows: ArmRows, columns: Array, off: Array, sds: Array) -> None:
        """Add measurements to the normal equations: they are `off` (R, M) from the expected ones; NaN: none.

        columns: derivatives of the expected ones, (R, M, K). sds: standard deviations, (R, M).
        """
        robust, shown = self.law.robust, np.isfinite(off)
        residual = np.where(shown, np.abs(off) / sds, 0.0)
        far = residual > robust
        weight = np.where(shown, np.divide(robust, residual, out=np.ones_like(residual), where=far), 0.0)
        cost = np.where(far, robust * (residual - 0.5 * robust), 0.5 * residual**2).sum(axis=1)
        rows.cost += cost
        rows.misfit += cost
        scaled = columns * (self.prior.sds / sds[:, :, None])
        add_rows(scaled, weight, np.where(shown, off, 0.0) / sds, rows.information, rows.slope)
