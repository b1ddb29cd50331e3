"""The model of a mechanism at its measurements, with or without an estimate of the load; one class per kind of chain.

Of a planar chain the poses of all links are measured. In space only the tip is: the pose is the model's.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from agents.controllers.controller import HANGING, Array, Mask, Reading, restarted
from agents.controllers.steps import choose
from rj_gym.tracking.task import TrackingTask
from rollingjoint import Equilibrium, HingeChain, RollingChain, SpatialChain, solve_lengths_batch
from rollingjoint.chain.solution import Solution
from rollingjoint.load import LOAD_COLUMNS, SPATIAL_LOAD_COLUMNS, WorldForce, spatial_load_table
from rollingjoint.transmission import unstretched_length

_LINK, _FX, _MOMENT = (LOAD_COLUMNS.index(name) for name in ("link", "fx", "moment"))
_TURN = 1e-5  # rad, of central differences
_FORCE = slice(SPATIAL_LOAD_COLUMNS.index("fx"), SPATIAL_LOAD_COLUMNS.index("fz") + 1)
_STEP = 1e-4  # rad and N, of the differences by the unknowns
_LARGEST = 3.0  # rad of tilt, N of payload: bounds of the estimate


class MeasuredModel(Protocol):
    """A model of B episodes side by side at their measurements.

    Attributes:
        nominal_loads: those that the model knows of: none, or the weight of an arm that hangs.
        stiffens: whether higher tensions stiffen the mechanism, so that they are worth going for.
    """

    nominal_loads: Any
    stiffens: bool

    def reset(self, mask: Mask) -> None:
        """Begin episodes, (B,): forget their estimates."""

    def unloaded(self, reading: Reading) -> Solution:
        """The model where it was measured, the load unknown."""

    def loaded(self, reading: Reading) -> tuple[Solution, Array]:
        """The model under the loads estimated from the measurements, and these loads, (B, rows, columns)."""


class Measurement(Protocol):
    """A pose and tensions of the same moment, as Reading has them."""

    @property
    def joint_angles(self) -> Array:
        """(B, n - 1) [rad]."""

    @property
    def tensions(self) -> Array:
        """(B, m) [N]."""


class MeasuredChain:
    """A planar chain, of which the poses of all links are measured."""

    nominal_loads = ()
    stiffens = True  # only tensions hold the links together

    def __init__(self, task: TrackingTask) -> None:
        self.mechanism: RollingChain = task.mechanism

    def reset(self, mask: Mask) -> None:
        """No effect, for it has no memory."""

    def unloaded(self, reading: Reading) -> Equilibrium:
        """The model at the measured pose and tensions, B rows."""
        return measured_equilibrium(self.mechanism, reading)

    def loaded(self, reading: Reading) -> tuple[Equilibrium, Array]:
        """The model under the estimated loads, and these, (B, 1, 11)."""
        measured = self.unloaded(reading)
        loads = estimated_loads(measured)
        return solve_lengths_batch(self.mechanism, unstretched(measured), loads, measured), loads


def measured_equilibrium(mechanism: RollingChain, reading: Measurement) -> Equilibrium:
    """The model at the measured pose and tensions, B rows.

    The load is unknown: whatever the tendons leave unbalanced is taken as moments on the links that stay as they are.
    Commands are computed from pose and tensions, so actuator offsets do not enter. Tension limits are not applied:
    where a motor keeps a tension limit its command follows, and the law of the elastic tendon still holds.
    """
    return solve_lengths_batch(mechanism, *balanced(mechanism, reading), reading.joint_angles)


def balanced(mechanism: RollingChain, reading: Measurement) -> tuple[Array, Array]:
    """Commands (B, m) [mm], and load tables (B, n - 1, columns) of moments, under which the measured pose balances."""
    moments = _joint_moments(mechanism, reading)
    loads = np.zeros((*moments.shape, len(LOAD_COLUMNS)))
    loads[..., _LINK] = np.arange(1, mechanism.n_links)
    loads[..., _MOMENT] = -np.diff(moments, axis=1, append=0.0)
    lengths = mechanism.tendon_lengths(reading.joint_angles)
    return unstretched_length(lengths, reading.tensions, mechanism.stiffnesses), loads


def estimated_loads(measured: Equilibrium, noise: float = 1.0) -> Array:
    """Load tables (B, 1, 11): the force at one link's origin that best explains the unbalanced moments of the tendons.

    Statics: the moment of a force at joint i is that about its contact point. For every link the force that explains
    the moments best is found by regularised least squares; the most likely link is chosen.

    Args:
        measured: from measured_equilibrium.
        noise: error of a joint moment that is as likely as a load of 1 N [N·mm]. It regularises forces along the
            chain, which have little moment.
    """
    moments = (measured.tendon_rates @ measured.tensions[..., None])[..., 0]
    rows = np.ascontiguousarray(np.swapaxes(measured.pose_jacobian[:, 1:, :2], -1, -2))
    columns = np.swapaxes(rows, -1, -2)
    forces = np.linalg.solve(columns @ rows + noise**2 * np.eye(2), columns @ moments[:, None, :, None])
    remainder = moments[:, None] - (rows @ forces)[..., 0]
    unlikely = np.sum(remainder**2, axis=-1) + noise**2 * np.sum(forces[..., 0] ** 2, axis=-1)
    likeliest = unlikely.argmin(axis=1)
    loads = np.zeros((len(likeliest), 1, len(LOAD_COLUMNS)))
    loads[:, 0, _LINK] = 1 + likeliest
    loads[:, 0, _FX : _FX + 2] = forces[np.arange(len(likeliest)), likeliest, :, 0]
    return loads


def _joint_moments(mechanism: RollingChain, reading: Measurement) -> Array:
    """Moments that balance the measured tensions at the measured joint angles, (B, n - 1) [N·mm]."""
    turns = _TURN * np.eye(mechanism.n_joints)  # a joint's angle changes the tendons' gaps at this joint alone
    longer, shorter = (mechanism.tendon_lengths(reading.joint_angles[:, None] + turn) for turn in (turns, -turns))
    return ((longer - shorter) / (2 * _TURN) @ reading.tensions[..., None])[..., 0]


def hanging_loads(arm: HingeChain | SpatialChain) -> Array:
    """The load table of an arm's weights and of a payload of 1 N in the last row, both along HANGING."""
    payload = WorldForce(-1, HANGING, point=(0.0, 0.0, 0.0))
    return np.concatenate([spatial_load_table([load], arm.n_links) for load in (arm.gravity(HANGING), payload)])


def loads_along(table: Array, directions: Array, payloads: Array) -> Array:
    """Load tables (B, rows, columns): `hanging_loads` along directions (B, 3), under payloads (B,) [N]."""
    tables = np.repeat(table[None], len(directions), axis=0)
    tables[:, -1, _FORCE] *= payloads[:, None]
    tables[..., _FORCE] = tables[..., _FORCE.stop - 1, None] * directions[:, None]
    return tables


class MeasuredArm:
    """An arm under its commands: under nominal gravity, or under the gravity and payload that explain the measurements.

    Every step refines three numbers: the vector by which the direction of gravity is turned from the nominal one (two
    numbers), and the payload at the tip, which acts along gravity.

    Args:
        task: with the mechanism, and the tension range.

    Attributes:
        stiffens: True where joints are contacts, which tensions hold together; they soften hinges.
    """

    STEPS = 2  # of Gauss-Newton in every step of control
    TIP = 1.0  # mm: likely error of the model's tip
    TENSION = 0.05  # N: of a tension
    LIKELY = (1.0, 1.0, 1.0)  # rad, rad and N: turn of gravity, and payload

    def __init__(self, task: TrackingTask) -> None:
        self.mechanism: HingeChain | SpatialChain = task.mechanism
        self.stiffens = self.mechanism.slips
        self.nominal_loads = [self.mechanism.gravity(HANGING)]
        self.estimate = np.empty(0)
        self._rows = hanging_loads(self.mechanism)
        tension = self.TENSION if task.config.observe_tensions else np.inf
        self._spreads = np.array([*[self.TIP] * 3, *[tension] * self.mechanism.n_tendons])
        self._starts: Array | None = None

    def reset(self, mask: Mask) -> None:
        """Begin episodes, (B,): they hang without a payload, and solves start at rest."""
        self.estimate = restarted(self.estimate, mask, np.zeros((len(mask), 3)))
        if mask.all() or self._starts is None:
            self._starts = None
        else:
            self._starts = restarted(self._starts, mask, np.tile(self.mechanism.neutral_angles, (len(mask), 1)))

    def unloaded(self, reading: Reading) -> Solution:
        """The model under the commands and nominal gravity, its tendons elastic and at the measured tensions."""
        equilibria = solve_lengths_batch(self.mechanism, reading.commands, self.nominal_loads, self._starts)
        self._starts = equilibria.joint_angles
        elastic = np.broadcast_to(self.mechanism.stiffnesses, reading.tensions.shape)
        return replace(equilibria, tensions=reading.tensions, tendon_stiffness=elastic)

    def loaded(self, reading: Reading) -> tuple[Solution, Array]:
        """The model under the commands and the estimated loads, and these, (B, rows, columns)."""
        best, loads = self._under(reading, self.estimate)
        lowest = self._unlikely(reading, best, self.estimate)
        for _ in range(self.STEPS):
            trial = self.possible(self.estimate + self._change(reading, best))
            equilibria, table = self._under(reading, trial, best)
            unlikely = self._unlikely(reading, equilibria, trial)
            better = unlikely < lowest
            self.estimate, lowest = np.where(better[:, None], trial, self.estimate), np.minimum(lowest, unlikely)
            best, loads = choose(better, equilibria, best), np.where(better[:, None, None], table, loads)
        self._starts = best.joint_angles
        return best, loads

    def possible(self, estimate: Array) -> Array:
        """The nearest estimates within their bounds, (B, 3): payloads are 0 or more."""
        nearest = np.clip(estimate, -_LARGEST, _LARGEST)
        nearest[:, 2] = np.maximum(nearest[:, 2], 0.0)
        return nearest

    def tables(self, estimate: Array) -> Array:
        """Load tables (B, rows, columns) of the estimates (B, 3): the weights and the payload along gravity."""
        turn = np.linalg.norm(estimate[:, :2], axis=1, keepdims=True)
        direction = np.concatenate([estimate[:, :2] * np.sinc(turn / np.pi), np.cos(turn)], axis=1)
        return loads_along(self._rows, direction, estimate[:, 2])

    def _under(self, reading: Reading, estimate: Array, near: Solution | None = None) -> tuple[Solution, Array]:
        """The model under the commands and these loads, and their tables."""
        tables, starts = self.tables(estimate), self._starts if near is None else near.joint_angles
        return solve_lengths_batch(self.mechanism, reading.commands, tables, starts), tables

    def _change(self, reading: Reading, equilibrium: Solution) -> Array:
        """The Gauss-Newton step of the estimate, (B, 3)."""
        misses, prior = self._misses(reading, equilibrium), 1.0 / np.array(self.LIKELY)
        columns = []
        for unknown in range(3):
            shifted, _ = self._under(reading, self.estimate + _STEP * np.eye(3)[unknown], equilibrium)
            columns.append((self._misses(reading, shifted) - misses) / _STEP)
        rates = np.stack(columns, axis=-1)
        square = np.swapaxes(rates, 1, 2) @ rates + np.diag(prior**2)
        slope = np.einsum("bim,bi->bm", rates, misses) + prior**2 * self.estimate
        return -np.linalg.solve(square, slope[..., None])[..., 0]

    def _misses(self, reading: Reading, model: Solution) -> Array:
        """Model minus measured tip and tensions, in units of their likely errors, (B, 3 + m)."""
        return np.concatenate([model.tip - reading.tip, model.tensions - reading.tensions], axis=1) / self._spreads

    def _unlikely(self, reading: Reading, model: Solution, estimate: Array) -> Array:
        """The cost of an estimate, (B,)."""
        deviation = estimate / np.array(self.LIKELY)
        cost = np.sum(self._misses(reading, model) ** 2, axis=1) + np.sum(deviation**2, axis=1)
        return np.where(model.ok, cost, np.inf)


class MeasuredTube(MeasuredArm):
    """A chain in space without weight under its commands; every step refines the force at its tip (3) [N].

    Args:
        task: with the mechanism, and the tension range.
    """

    LIKELY = (0.3, 0.3, 0.3)  # N

    def possible(self, estimate: Array) -> Array:
        """The nearest estimates within their bounds, (B, 3)."""
        return np.clip(estimate, -_LARGEST, _LARGEST)

    def tables(self, estimate: Array) -> Array:
        """Load tables (B, rows, columns) of the forces (B, 3)."""
        tables = np.repeat(self._rows[None], len(estimate), axis=0)
        tables[:, -1, _FORCE] = estimate
        return tables


def measured_in_space(task: TrackingTask) -> MeasuredArm:
    """The model of a SpatialChain: with weights it hangs as an arm."""
    return MeasuredArm(task) if task.mechanism.weights.any() else MeasuredTube(task)


MODELS: dict[type, Callable[[TrackingTask], MeasuredModel]] = {
    RollingChain: MeasuredChain,
    HingeChain: MeasuredArm,
    SpatialChain: measured_in_space,
}


def measured_by(task: TrackingTask) -> MeasuredModel:
    """The model of a task's mechanism."""
    return MODELS[type(task.mechanism)](task)


def unstretched(equilibria: Solution) -> Array:
    """Commanded lengths that hold these equilibria, (B, m) [mm]."""
    return unstretched_length(equilibria.lengths, equilibria.tensions, equilibria.mechanism.stiffnesses)
