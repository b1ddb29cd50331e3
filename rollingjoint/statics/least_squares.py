"""Desired tendon lengths in the least-squares sense: bounded Levenberg-Marquardt on the tensions.

min over tensions in [low, high] of 1/2 |l(tau) - l_des|², where l(tau) is the length at the equilibrium under tau and
dl/dtau = -Gᵀ H⁻¹ G. Source: rolling-contact paper, eq. 29 (its own algorithm takes fixed gradient steps).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rollingjoint.kernels.shared.arrays import TendonLaw
from rollingjoint.load import acts
from rollingjoint.planar.chain import RollingChain
from rollingjoint.planar.equilibrium import Equilibrium, Status, solve_lane
from rollingjoint.statics.sensitivity import joint_response

Array = NDArray[np.float64]

_LARGEST_TENSION = 1000.0  # N, where none is given
_SMALLEST_TENSION = 0.01  # N; a solution below it is slack and says nothing about the tension ratio
_MAX_ITERATIONS = 300
_GOAL = 1e-11  # mm that the next step would still change the lengths by
_SMALLEST_DAMPING = 1e-12  # of the largest (dl/dtau)²


def solve_least_squares(
    mechanism: RollingChain, desired: Array, low: Array, high: Array, table: Array, start: Array
) -> Equilibrium:
    """The equilibrium whose lengths are nearest the desired ones, tensions between low and high.

    Args:
        mechanism: the chain.
        desired: (m,) [mm].
        low, high: (m,) [N]; above 1000 N a limit is 1000 N.
        table: load table, (rows, columns).
        start: joint angles, (n - 1,) [rad].
    Returns:
        Equilibrium; its iterations are those of all trials. Status.NOT_CONVERGED: 300 trials were not enough.
    """
    high = np.minimum(high, _LARGEST_TENSION)
    elastic = _nearly_inextensible(mechanism, TendonLaw(desired, np.ones_like(desired), low, high), table, start)
    if elastic.status == Status.INVALID_INPUT:
        return elastic
    trial, start = _first_tensions(elastic, low, high), elastic.joint_angles
    best, rates, least = None, None, np.inf
    damping, iterations = 1e-5, 0
    for _ in range(_MAX_ITERATIONS):
        found = solve_lane(mechanism, _prescribed(trial), table, start)
        iterations += int(found.iterations)
        miss = found.lengths - desired
        cost = 0.5 * float(miss @ miss)
        if best is None or (found.status < Status.NOT_CONVERGED and cost < least):
            best, least, start, damping = found, cost, found.joint_angles, max(0.1 * damping, _SMALLEST_DAMPING)
            rates = _length_rates(found)
        else:
            damping *= 10.0
        if rates is None:
            return replace(best, iterations=iterations)
        step = _step(rates, best.lengths - desired, best.tensions, low, high, damping)
        trial = np.clip(best.tensions + step, low, high)
        if np.abs(rates @ (trial - best.tensions)).max() < _GOAL:
            return replace(best, iterations=iterations)
    assert best is not None
    return replace(best, iterations=iterations, status=Status.NOT_CONVERGED)


def _nearly_inextensible(mechanism: RollingChain, law: TendonLaw, table: Array, start: Array) -> Equilibrium:
    """Equilibrium with ever stiffer elastic tendons whose unstretched lengths are the desired ones."""
    for stiffness in (1.0, 30.0, 1000.0):
        stiff = law._replace(stiffness=np.full_like(law.command, stiffness))
        found = solve_lane(mechanism, stiff, table, start)
        if found.status == Status.INVALID_INPUT:
            break
        start = found.joint_angles
    return found


def _first_tensions(elastic: Equilibrium, low: Array, high: Array) -> Array:
    """Its tensions within the limits; without a load, where only their ratio matters, the largest is 1 N."""
    tensions, largest = elastic.tensions, elastic.tensions.max()
    if largest < _SMALLEST_TENSION:
        tensions = np.ones_like(tensions)
    elif not (elastic.chain.springs or acts(elastic.loads)):
        tensions = tensions / largest
    return np.clip(tensions, low, high)


def _prescribed(tensions: Array) -> TendonLaw:
    return TendonLaw(np.zeros_like(tensions), np.ones_like(tensions), tensions, tensions)


def _length_rates(equilibrium: Equilibrium) -> Array | None:
    """dl/dtau under prescribed tensions, (m, m), joints at a surface limit held; None where H is singular."""
    if equilibrium.status == Status.INDETERMINATE:
        return None
    try:
        moves = joint_response(equilibrium, equilibrium.stiffness, -equilibrium.tendon_rates)
    except np.linalg.LinAlgError:
        return None
    return equilibrium.tendon_rates.T @ moves


def _step(rates: Array, miss: Array, tensions: Array, low: Array, high: Array, damping: float) -> Array:
    """Levenberg-Marquardt step on the tensions that are not held at a limit, damping over the largest rate²."""
    gradient = rates.T @ miss
    free = ~((tensions <= low) & (gradient > 0.0)) & ~((tensions >= high) & (gradient < 0.0))
    rows = np.vstack([rates, np.sqrt(damping) * np.abs(rates).max() * np.eye(len(rates))])
    step = np.zeros_like(tensions)
    step[free] = np.linalg.lstsq(rows[:, free], np.concatenate([-miss, np.zeros(len(rates))]))[0]
    return step
