"""The equilibria of one run at given parameters, and how joint angles and tensions change with them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rollingjoint.identify.measurements import Input, Measurements, Run, Step
from rollingjoint.mechanism import AnyMechanism
from rollingjoint.solution import Solution
from rollingjoint.statics.sensitivity import joint_response
from rollingjoint.statics.solve import solve_lengths, solve_tensions

Array = NDArray[np.float64]


class Rates(NamedTuple):
    """Derivatives of an equilibrium: a column per tendon by its offset, then one by the stiffness factor."""

    angles: Array  # (n - 1, P)
    tensions: Array  # (m, P)


def follow(measurements: Measurements, run: Run, mechanism: AnyMechanism, offsets: Array) -> list[Any]:
    """The equilibrium at every step of a run."""
    return [_solve(measurements, mechanism, step.input(measurements.given), step, offsets) for step in run.steps]


def _solve(measurements: Measurements, mechanism: AnyMechanism, given: Input, step: Step, offsets: Array) -> Any:
    if given.given == "tensions":
        return solve_tensions(mechanism, given.values, step.forces)
    lengths = np.array(given.values) + offsets
    limits = measurements.tension_limits
    return solve_lengths(mechanism, lengths, step.forces, method=measurements.method, tension_limits=limits)


def rates_along(path: Sequence[Solution], here: Mapping[str, Any]) -> list[Rates]:
    """Derivatives of the equilibria of a run, of elastic tendons or under given tensions.

    By the implicit function theorem: dphi/dx = -A⁻¹ dr/dx with the residual r of docs/theory.md, section 3.
    """
    return [_rates(equilibrium, here) for equilibrium in path]


def _rates(equilibrium: Solution, here: Mapping[str, Any]) -> Rates:
    slope, torques = equilibrium.tendon_stiffness, equilibrium.torques_per_tension
    by_factor = np.where(slope > 0, equilibrium.tensions, 0.0) / here["stiffness"]
    direct = np.column_stack([-np.diag(slope), by_factor])  # d tensions at the same angles
    angles = joint_response(equilibrium, equilibrium.stiffness, -torques @ direct)
    return Rates(angles, direct + slope[:, None] * (equilibrium.tendon_rates.T @ angles))
