"""Full-information smoother of arms: the most likely hidden numbers of episodes, given all that was measured so far."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rollingjoint.chain.hinge import HingeChain
from rollingjoint.compiled import Floats
from rollingjoint.errors import InvalidInput
from rollingjoint.estimate.arm_hidden import ArmPrior
from rollingjoint.estimate.arm_rows import Arm, ArmLaw, ArmRows, FollowedArm
from rollingjoint.estimate.arrays import MotorHistory
from rollingjoint.estimate.equations import propose
from rollingjoint.estimate.smoother import LEAST_DAMPING, MOST_DAMPING, Smoothed, adapted_damping

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class ArmEffort:
    """How hard a smoother of arms searches.

    Args:
        every: steps after which the history is followed anew, along the present estimate.
        moved: change of a hidden number, in standard deviations of its prior, after which it is at once.
        passes: how often in one step at most. first: how often in the first step.
        farthest: largest change of a hidden number in one Gauss-Newton step, in standard deviations.
        trusted_from: measured steps from which on a misfit tells that the fit has failed.
    """

    every: int = 6
    moved: float = 1.0
    passes: int = 1
    first: int = 5
    farthest: float = 2.0
    trusted_from: int = 0


class NormalEquations(NamedTuple):
    """Normal equations about vectors of hidden numbers."""

    numbers: Annotated[Floats, "R", "K"]
    information: Annotated[Floats, "R", "K", "K"]  # lower triangle
    slope: Annotated[Floats, "R", "K"]
    priors: Annotated[Integers, "R"]  # index of the prior


def is_served(arm: Arm) -> bool:
    """Whether the smoother knows a mechanism: exact tendons, no springs between links, no rolling resistance."""
    exact = not isinstance(arm, HingeChain) or arm.model == "exact"
    return exact and not arm.springs and arm.rolling_coefficients[0] == 0.0


class ArmSmoother:
    """Maximum a posteriori estimate of the hidden numbers of N episodes of an arm side by side, step by step.

    The normal equations of the whole history are solved in every step. Now and then the history is followed anew along
    the present estimate (Gauss-Newton), where that lowers the cost (Levenberg-Marquardt).

    Args:
        arm: the nominal mechanism, see `is_served`.
        prior: of its hidden numbers.
        law: of its measurements.
        effort: of the search.
        steps: number of measured steps that an episode can have.
    Raises:
        InvalidInput: another mechanism.
    """

    def __init__(
        self, arm: Arm, prior: ArmPrior, law: ArmLaw, effort: ArmEffort | None = None, steps: int = 51
    ) -> None:
        if not is_served(arm):
            allowed = "an arm with exact tendons or a chain in space, without springs and rolling resistance"
            raise InvalidInput("mechanism", arm, allowed, "No other is served.")
        self.prior, self.effort, self._steps = prior, effort or ArmEffort(), steps
        self._arm, self._followed, self._count = arm, FollowedArm(arm, prior, law), -1
        self.reset(np.ones(0, bool))

    @property
    def measured_steps(self) -> Integers:
        """How many steps of the episodes have been measured, (N,)."""
        return self.history.counts

    @property
    def joint_angles(self) -> Array:
        """Where the history was last followed, (N, J) [rad]."""
        return self._rows.angles

    def load_tables(self, numbers: Array) -> Array:
        """The loads of hidden numbers (N, K): weights and payload along gravity, (N, J + 1, columns)."""
        return self._followed.load_tables(numbers)

    @property
    def trusted_from(self) -> int:
        """Measured steps from which on a misfit tells that the fit has failed."""
        return self.effort.trusted_from

    def reset(self, mask: Mask) -> None:
        """Begin the episodes of the mask, (N,), without measurements; all where N has changed."""
        count, m = len(mask), self._arm.n_tendons
        if count != self._count:
            self._count, mask = count, np.ones(count, bool)
            motors, shifts, tensions = (np.zeros((count, self._steps, m)) for _ in range(3))
            pictures = np.zeros((count, self._steps, 0, 3))
            self.history = MotorHistory(np.zeros(count, np.int64), motors, shifts, tensions, pictures)
            self._rows, self._damping = self._begun(np.arange(count)), np.full(count, LEAST_DAMPING)
            self._since = np.zeros(count, np.int64)
        rows = np.flatnonzero(mask)
        self.history.counts[rows], self._damping[rows], self._since[rows] = 0, LEAST_DAMPING, 0
        self._rows.put(rows, self._begun(rows))

    def _begun(self, episodes: Integers) -> ArmRows:
        return self._followed.begun(episodes, np.tile(self.prior.means, (len(episodes), 1)))

    def take_in(self, motors: Array, shifts: Array, tensions: Array) -> Smoothed:
        """The estimate after another step of all episodes; those with all their steps measured stay as they are.

        Args:
            motors: measured positions, (N, m) [mm].
            shifts: how far motors have given way in this step at a limit of tension, taking tendons along, (N, m) [mm].
            tensions: measured, (N, m) [N]; NaN where there is none.
        """
        history = self.history
        rows = np.flatnonzero(history.counts < self._steps)
        for values, measured in zip(history[1:4], (motors, shifts, tensions), strict=True):
            values[rows, history.counts[rows]] = measured[rows]
        history.counts[rows] += 1
        self._since[rows] += 1
        self._followed.follow(self._rows, history)
        self._renew()
        return self._smoothed()

    def _renew(self) -> None:
        """Follow histories anew, where that is due, along estimates that lower their costs."""
        effort, rows = self.effort, self._rows
        begins = self.history.counts == 1
        for number in range(max(effort.passes, effort.first if begins.any() else 0)):
            proposals = self._proposals(self._damping)
            change = np.abs(proposals - rows.numbers) / np.maximum(self.prior.sds, 1e-12)
            due = (change.max(axis=1) > effort.moved) & (self._damping < MOST_DAMPING)
            due &= begins | (number < effort.passes)
            if number == 0:
                due |= (self._since >= effort.every) | begins
            places = np.flatnonzero(due)
            if not places.size:
                break
            trial = self._followed.followed(self.history, rows.episodes[places], proposals[places])
            better = trial.cost < rows.cost[places]
            self._damping[places] = adapted_damping(self._damping[places], better)
            self._since[places] = 0
            rows.put(places[better], trial, np.flatnonzero(better))

    def _proposals(self, damping: Array) -> Array:
        """The minima of the normal equations, (N, K), within bounds."""
        rows = self._rows
        numbers, priors = np.empty_like(rows.numbers), np.zeros(len(rows.numbers), np.int64)
        equations = NormalEquations(rows.numbers, rows.information, rows.slope, priors)
        propose(equations, self.prior.sds[None], damping, self.effort.farthest, numbers, np.empty(len(numbers)))
        return self.prior.within(numbers)

    def _smoothed(self) -> Smoothed:
        rows, at = self._rows, self.prior.layout
        numbers = self._proposals(self._damping)
        change = numbers - rows.numbers
        widths, places = slice(at.half_widths, at.frictions), slice(at.places, at.gains)
        commands = slice(at.offsets, at.stiffnesses)
        return Smoothed(
            numbers,
            rows.tip + np.einsum("nik,nk->ni", rows.tip_by, change),
            rows.tensions + np.einsum("nik,nk->ni", rows.tensions_by, change),
            np.ascontiguousarray(rows.tip_by[:, :, commands]),
            np.ascontiguousarray(rows.tensions_by[:, :, commands]),
            rows.played + rows.by_width * change[:, widths] + rows.by_place * change[:, places],
            np.ascontiguousarray(numbers[:, widths]),
            rows.misfit / np.maximum(self.history.counts * self._arm.n_tendons, 1),
        )
