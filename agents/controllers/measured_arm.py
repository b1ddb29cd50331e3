"""A flexible arm under its commands, and the load estimated from the measured tip and tensions.

Of an arm only the tip is measured, not every link as of a chain: the pose is that of the model.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from agents.controllers.responses import choose
from agents.evaluation.controller import HANGING, Array, Seen
from rj_gym.core.tracking_task import TrackingTask
from rollingjoint.chain.equilibrium import HingeEquilibrium
from rollingjoint.chain.hinge import HingeChain
from rollingjoint.load import SPATIAL_LOAD_COLUMNS, WorldForce, spatial_load_table
from rollingjoint.statics.solve import solve_lengths_batch

_FORCE = slice(SPATIAL_LOAD_COLUMNS.index("fx"), SPATIAL_LOAD_COLUMNS.index("fz") + 1)
_STEP = 1e-4  # rad and N, of the differences by the unknowns
_LARGEST = 3.0  # rad of tilt, N of payload: bounds of the estimate


def hanging_loads(arm: HingeChain) -> Array:
    """The load table of an arm's weights and of a payload of 1 N in the last row, both along HANGING."""
    payload = WorldForce(-1, HANGING, point=(0.0, 0.0, 0.0))
    return np.concatenate([spatial_load_table([each], arm.n_links) for each in (arm.gravity(HANGING), payload)])


def loads_along(table: Array, directions: Array, payloads: Array) -> Array:
    """Load tables (B, rows, columns): `hanging_loads` along directions (B, 3), under payloads (B,) [N]."""
    tables = np.repeat(table[None], len(directions), axis=0)
    tables[:, -1, _FORCE] *= payloads[:, None]
    tables[..., _FORCE] = tables[..., _FORCE.stop - 1, None] * directions[:, None]
    return tables


class MeasuredArm:
    """An arm under its commands: under nominal gravity, or under the gravity and payload that explain what is measured.

    Every step refines three numbers: the vector by which the direction of gravity is turned from the nominal one (two
    numbers), and the payload at the tip, which acts along gravity.

    Args:
        task: with the mechanism, and the tension range.
    """

    stiffens = False  # co-contraction softens its hinges

    STEPS = 2  # of Gauss-Newton in every step of control
    TIP = 1.0  # mm: likely error of the model's tip
    TENSION = 0.05  # N: of a tension
    TILT = 1.0  # rad: likely turn of gravity
    PAYLOAD = 1.0  # N: likely payload

    def __init__(self, task: TrackingTask, episodes: int) -> None:
        self.mechanism: HingeChain = task.mechanism
        self.nominal_loads = [self.mechanism.gravity(HANGING)]
        self.estimate = np.zeros((episodes, 3))
        self._rows = hanging_loads(self.mechanism)
        tension = self.TENSION if task.config.observe_tensions else np.inf
        self._spreads = np.array([*[self.TIP] * 3, *[tension] * self.mechanism.n_tendons])
        self._starts: Array | None = None

    def unloaded(self, seen: Seen) -> HingeEquilibrium:
        """The model under the commands and nominal gravity, its tendons elastic and at the measured tensions."""
        found = solve_lengths_batch(self.mechanism, seen.commands, self.nominal_loads, self._starts)
        self._starts = found.joint_angles
        elastic = np.broadcast_to(self.mechanism.stiffnesses, seen.tensions.shape)
        return replace(found, tensions=seen.tensions, tendon_stiffness=elastic)

    def loaded(self, seen: Seen) -> tuple[HingeEquilibrium, Array]:
        """The model under the commands and the estimated loads, and these, (B, rows, columns)."""
        best, loads = self._under(seen, self.estimate)
        least = self._unlikely(seen, best, self.estimate)
        for _ in range(self.STEPS):
            tried = np.clip(self.estimate + self._change(seen, best), -_LARGEST, _LARGEST)
            tried[:, 2] = np.maximum(tried[:, 2], 0.0)
            found, table = self._under(seen, tried, best)
            unlikely = self._unlikely(seen, found, tried)
            better = unlikely < least
            self.estimate, least = np.where(better[:, None], tried, self.estimate), np.minimum(least, unlikely)
            best, loads = choose(better, found, best), np.where(better[:, None, None], table, loads)
        self._starts = best.joint_angles
        return best, loads

    def tables(self, estimate: Array) -> Array:
        """Load tables (B, rows, columns) of the estimates (B, 3): the weights and the payload along gravity."""
        turn = np.linalg.norm(estimate[:, :2], axis=1, keepdims=True)
        direction = np.concatenate([estimate[:, :2] * np.sinc(turn / np.pi), np.cos(turn)], axis=1)
        return loads_along(self._rows, direction, estimate[:, 2])

    def _under(
        self, seen: Seen, estimate: Array, near: HingeEquilibrium | None = None
    ) -> tuple[HingeEquilibrium, Array]:
        """The model under the commands and these loads, and their tables."""
        tables, starts = self.tables(estimate), self._starts if near is None else near.joint_angles
        return solve_lengths_batch(self.mechanism, seen.commands, tables, starts), tables

    def _change(self, seen: Seen, here: HingeEquilibrium) -> Array:
        """The Gauss-Newton step of the estimate, (B, 3)."""
        misses, prior = self._misses(seen, here), 1.0 / np.array([self.TILT, self.TILT, self.PAYLOAD])
        columns = []
        for unknown in range(3):
            there, _ = self._under(seen, self.estimate + _STEP * np.eye(3)[unknown], here)
            columns.append((self._misses(seen, there) - misses) / _STEP)
        rates = np.stack(columns, axis=-1)
        square = np.swapaxes(rates, 1, 2) @ rates + np.diag(prior**2)
        slope = np.einsum("bim,bi->bm", rates, misses) + prior**2 * self.estimate
        return -np.linalg.solve(square, slope[..., None])[..., 0]

    def _misses(self, seen: Seen, model: HingeEquilibrium) -> Array:
        """Model minus measured tip and tensions, in units of their likely errors, (B, 3 + m)."""
        return np.concatenate([model.tip - seen.tip, model.tensions - seen.tensions], axis=1) / self._spreads

    def _unlikely(self, seen: Seen, model: HingeEquilibrium, estimate: Array) -> Array:
        """What is minimised, (B,)."""
        away = estimate / np.array([self.TILT, self.TILT, self.PAYLOAD])
        cost = np.sum(self._misses(seen, model) ** 2, axis=1) + np.sum(away**2, axis=1)
        return np.where(model.ok, cost, np.inf)
