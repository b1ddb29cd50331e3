"""Desired tendon lengths met in the least-squares sense: bounded Levenberg-Marquardt on the tensions.

min over tensions in [low, high] of 1/2 |l(tau) - l_des|², where l(tau) is the length at the equilibrium under tau and
dl/dtau = -Gᵀ H⁻¹ G. Where lengths leave some tensions open, as in arms, whose tendons may pull against each other, they
stay near those of the start. Source: rolling-contact paper, eq. 29 (the paper's algorithm takes fixed gradient steps).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rollingjoint.chain.batch import solve_one
from rollingjoint.chain.solution import Solution
from rollingjoint.chain.status import Status
from rollingjoint.kernels.arrays import TendonLaw
from rollingjoint.load import acts
from rollingjoint.statics.batch import prescribed
from rollingjoint.statics.sensitivity import joint_response

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
_Solve = Callable[[TendonLaw, Array], Any]  # of a tendon law and the joint angles to start from

LARGEST_TENSION = 1000.0  # N; higher limits count as this
_SMALLEST_TENSION = 0.01  # N; a solution below it is slack and determines no tension ratio
_MAX_ITERATIONS = 300
_GOAL = 1e-11  # mm; a step that changes no length by more ends the search
_SMALLEST_DAMPING = 1e-12  # of the largest (dl/dtau)²
_ROUNDING = 1e-15  # of the lengths


def solve_least_squares(mechanism: Any, desired: Array, low: Array, high: Array, table: Array, start: Array) -> Any:
    """The equilibrium with lengths nearest the desired ones, tensions between low and high.

    Args:
        mechanism: a chain.
        desired: (m,) [mm].
        low, high: (m,) [N]; higher limits than 1000 N count as 1000 N.
        table: load table, (rows, columns).
        start: joint angles, (n - 1,) [rad].
    Returns:
        Equilibrium; its iterations are summed over all trials. Status.NOT_CONVERGED: 300 trials were not enough.
    """
    high = np.minimum(high, LARGEST_TENSION)

    def solve(law: TendonLaw, start: Array) -> Any:
        return solve_one(mechanism, law, table, start)

    elastic = _nearly_inextensible(solve, TendonLaw(desired, np.ones_like(desired), low, high), start)
    if elastic.status == Status.INVALID_INPUT:
        return elastic
    tensions = _first_tensions(elastic, bool(mechanism.springs) or acts(table), low, high)
    best = _TensionTrial.at(solve, tensions, desired, low, high, elastic.joint_angles)
    damping, iterations = 1e-6, int(best.equilibrium.iterations)
    for _ in range(_MAX_ITERATIONS):
        if best.rates is None:
            return replace(best.equilibrium, iterations=iterations)
        step = _step(best.rates, best.miss, tensions, low, high, damping)
        stepped = np.clip(tensions + step, low, high)
        if np.abs(best.rates @ (stepped - tensions)).max() < _GOAL:
            return replace(best.equilibrium, iterations=iterations)
        trial = _TensionTrial.at(solve, stepped, desired, low, high, best.equilibrium.joint_angles)
        iterations += int(trial.equilibrium.iterations)
        if trial.equilibrium.status < Status.NOT_CONVERGED and trial.beats(best):
            best, tensions, damping = trial, stepped, max(0.1 * damping, _SMALLEST_DAMPING)
        else:
            damping *= 10.0
    return replace(best.equilibrium, iterations=iterations, status=Status.NOT_CONVERGED)


class _TensionTrial(NamedTuple):
    """The equilibrium under trial tensions, and how near its lengths are to the desired ones."""

    equilibrium: Any
    miss: Array  # (m,) lengths minus desired ones [mm]
    noise: float  # rounding error of the cost [mm²]
    rates: Array | None  # (m, m) d lengths / d tensions
    slope: float  # largest entry of the gradient of the cost [mm²/N]

    @classmethod
    def at(cls, solve: _Solve, tensions: Array, desired: Array, low: Array, high: Array, start: Array) -> _TensionTrial:
        """The trial, from joint angles to start from."""
        equilibrium = solve(prescribed(tensions), start)
        miss, rates = equilibrium.lengths - desired, _length_rates(equilibrium)
        noise = _ROUNDING * float(np.linalg.norm(desired) * np.linalg.norm(miss))
        if rates is None:
            return cls(equilibrium, miss, noise, None, np.inf)
        gradient, free = _free_gradient(rates, miss, tensions, low, high)
        return cls(equilibrium, miss, noise, rates, float(np.abs(gradient[free]).max(initial=0.0)))

    @property
    def cost(self) -> float:
        """1/2 |miss|² [mm²]."""
        return 0.5 * float(self.miss @ self.miss)

    def beats(self, rival: _TensionTrial) -> bool:
        """Whether the cost is lower; where rounding hides that, near the minimum, whether the slope is smaller."""
        if abs(self.cost - rival.cost) > rival.noise:
            return self.cost < rival.cost
        return self.slope < rival.slope


def _nearly_inextensible(solve: _Solve, law: TendonLaw, start: Array) -> Any:
    """Equilibrium with increasingly stiff elastic tendons, the desired lengths as their unstretched lengths."""
    for stiffness in (1.0, 30.0, 1000.0):
        equilibrium = solve(law._replace(stiffness=np.full_like(law.command, stiffness)), start)
        if equilibrium.status == Status.INVALID_INPUT:
            break
        start = equilibrium.joint_angles
    return equilibrium


def _first_tensions(elastic: Solution, loaded: bool, low: Array, high: Array) -> Array:
    """Tensions to start from, within the limits; without a load only their ratio matters, and the largest is 1 N."""
    tensions, largest = elastic.tensions, elastic.tensions.max()
    if largest < _SMALLEST_TENSION:
        tensions = np.ones_like(tensions)
    elif not loaded:
        tensions = tensions / largest
    return np.clip(tensions, low, high)


def _length_rates(equilibrium: Solution) -> Array | None:
    """dl/dtau under prescribed tensions, (m, m), joints at a surface limit held; None where H is singular."""
    if equilibrium.status == Status.INDETERMINATE:
        return None
    try:
        moves = joint_response(equilibrium, equilibrium.stiffness, -equilibrium.torques_per_tension)
    except np.linalg.LinAlgError:
        return None
    return equilibrium.tendon_rates.T @ moves


def _free_gradient(rates: Array, miss: Array, tensions: Array, low: Array, high: Array) -> tuple[Array, Mask]:
    """Gradient of the cost by the tensions, (m,) [mm²/N], and True for tensions that are not held at a limit, (m,)."""
    gradient = rates.T @ miss
    return gradient, ~((tensions <= low) & (gradient > 0.0)) & ~((tensions >= high) & (gradient < 0.0))


def _step(rates: Array, miss: Array, tensions: Array, low: Array, high: Array, damping: float) -> Array:
    """Levenberg-Marquardt step on the tensions that are not held at a limit, damping over the largest rate²."""
    _, free = _free_gradient(rates, miss, tensions, low, high)
    rows = np.vstack([rates, np.sqrt(damping) * np.abs(rates).max() * np.eye(len(rates))])
    step = np.zeros_like(tensions)
    step[free] = np.linalg.lstsq(rows[:, free], np.concatenate([-miss, np.zeros(len(rates))]))[0]
    return step
