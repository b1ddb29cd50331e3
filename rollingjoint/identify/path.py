"""The equilibria of one run at given parameters, and derivatives of joint angles and tensions by them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rollingjoint.chain.chain import AnyChain
from rollingjoint.chain.solution import Solution
from rollingjoint.chain.status import Status
from rollingjoint.identify.lengths import NearestLengths
from rollingjoint.identify.measurements import Input, Measurements, Run, Step
from rollingjoint.statics.sensitivity import joint_response
from rollingjoint.statics.solve import solve_lengths, solve_tensions

Array = NDArray[np.float64]

_STILL = 1e-8  # a friction state below it is zero


class Reached(NamedTuple):
    """An equilibrium on a path, and whether there are readings of it."""

    equilibrium: Any
    read: bool


class Rates(NamedTuple):
    """Derivatives of an equilibrium: a column per tendon by its offset, then by the stiffness factor and by mu."""

    angles: Array  # (n - 1, P)
    tensions: Array  # (m, P), at the motors


def follow(
    measurements: Measurements, run: Run, mechanism: AnyChain, offsets: Array, nearest: NearestLengths
) -> list[Reached]:
    """The equilibria of a run in order, with friction also of the approaches, each step from the previous one.

    The first is the pose without friction, before any slip.
    """
    path: list[Reached] = []
    history: Any = None
    for number, step in enumerate(run.steps):
        passed = [*(step.approach if mechanism.has_friction else ()), step.input(measurements.given)]
        for place, entry in enumerate(passed, 1 - len(passed)):
            solve = _Solve(measurements, mechanism, step, offsets, nearest, (run.name, number, place))
            equilibrium = solve(entry, history)
            path.append(Reached(equilibrium, place == 0))
            if mechanism.has_friction and equilibrium.status <= Status.INDETERMINATE:
                history = equilibrium
    return path


class _Solve(NamedTuple):
    """A solve for the equilibrium of one input."""

    measurements: Measurements
    mechanism: AnyChain
    step: Step
    offsets: Array
    nearest: NearestLengths
    key: tuple[str, int, int]

    def __call__(self, entry: Input, history: Any) -> Any:
        if entry.given == "tensions":
            return solve_tensions(self.mechanism, entry.values, self.step.forces, history=history)
        lengths = np.array(entry.values) + self.offsets
        if self.measurements.method == "least_squares":
            return self.nearest.solve(self.mechanism, lengths, self.step.forces, history, self.key)
        limits = self.measurements.tension_limits
        return solve_lengths(self.mechanism, lengths, self.step.forces, tension_limits=limits, history=history)


def rates_along(path: Sequence[Reached], parameters: Mapping[str, Any]) -> list[Rates]:
    """Derivatives of every equilibrium of a path, of elastic tendons or under given tensions.

    By the implicit function theorem in every step: dphi = -A⁻¹ dr with the residual r and its Jacobian A of
    docs/theory.md, sections 4 and 9; friction states and slips carry their derivatives to the next step. One-sided
    where a hole is about to slip.
    """
    derivatives: list[Rates] = []
    carried: Array | None = None
    for equilibrium, _ in path:
        if equilibrium.ok:
            rates = _rates(equilibrium, parameters, carried)
            carried = _carried(equilibrium, rates, carried)
        else:  # no derivatives
            n_joints, n_tendons = equilibrium.tendon_rates.shape
            rates = Rates(np.zeros((n_joints, n_tendons + 2)), np.zeros((n_tendons, n_tendons + 2)))
        derivatives.append(rates)
    return derivatives


def _rates(equilibrium: Solution, parameters: Mapping[str, Any], carried: Array | None) -> Rates:
    slope, torques = equilibrium.tendon_stiffness, equilibrium.torques_per_tension
    by_factor = np.where(slope > 0, equilibrium.tensions, 0.0) / parameters["stiffness"]
    direct = np.column_stack([-np.diag(slope), by_factor, np.zeros_like(slope)])  # d tensions at the same angles
    torque = torques @ direct
    if equilibrium.friction is not None:
        lever, tensions = equilibrium.tendon_rates, equilibrium.gap_tensions
        states, logs = equilibrium.friction_states, _mu_turns(equilibrium)
        by_mu = -tensions * np.cumsum(states * logs, axis=0) / parameters["mu"]
        torque[:, -1] += (lever * by_mu).sum(axis=1)
        if carried is not None:  # d friction states at the same angles, where tendons stick
            change = np.where(equilibrium.sticking[..., None], carried, 0.0)
            by_states = -tensions[..., None] * np.cumsum(logs[..., None] * change, axis=0)
            torque += (lever[..., None] * by_states).sum(axis=1)
    angles = joint_response(equilibrium, equilibrium.stiffness, -torque)
    return Rates(angles, direct + slope[:, None] * (equilibrium.tendon_rates.T @ angles))


def _carried(equilibrium: Solution, rates: Rates, carried: Array | None) -> Array:
    """Derivatives of z + s / presliding, the memory of friction states and slips in a step, (n - 1, m, P)."""
    friction = equilibrium.mechanism.friction_coefficients
    presliding, compliance = friction[:, 1, None], friction[:, 4]
    gaps = equilibrium.tendon_rates[..., None] * rates.angles[:, None]  # of the lengths of every gap
    stretch = compliance * _shares(equilibrium)
    slips = np.cumsum(gaps[::-1], axis=0)[::-1] - stretch[..., None] * rates.tensions
    before = np.zeros_like(slips) if carried is None else carried
    states = np.where(equilibrium.sticking[..., None], before - slips / presliding, 0.0)
    if equilibrium.friction is None:
        states = np.zeros_like(slips)  # before any slip
    return states + slips / presliding


def _shares(equilibrium: Solution) -> Array:
    """Share of a tendon that lies beyond each link, (n - 1, m)."""
    ends, n_joints = np.array(equilibrium.mechanism.last_links), equilibrium.mechanism.n_joints
    return np.maximum(ends - np.arange(n_joints)[:, None], 0) / ends


def _mu_turns(equilibrium: Solution) -> Array:
    """mu × turn at every link's holes, from the tensions on both sides, (n - 1, m); 0 for a slack tendon."""
    after = equilibrium.gap_tensions
    before = np.vstack([equilibrium.tensions, after[:-1]])
    states, grips = equilibrium.friction_states, equilibrium.friction_state.grips
    taut, moving = (before > 0) & (after > 0), np.abs(states) > _STILL
    ratio = np.log(np.divide(before, after, out=np.ones_like(after), where=taut))
    at_rest = np.divide(grips, before, out=np.zeros_like(after), where=taut)
    return np.where(moving, np.divide(ratio, states, out=np.zeros_like(after), where=moving), at_rest)
