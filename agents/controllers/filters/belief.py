"""What a bank of filters believes of many episodes; N episodes with H hypotheses each are R = N x H rows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from agents.controllers.filters.kernels import Play
from agents.evaluation.controller import Array

Integers = NDArray[np.int64]


@dataclass
class Belief:
    """States of filters, arrays that change in place.

    Args:
        states, covariances: (R, states), (R, states, states).
        evidence: logarithm of how likely the measurements were under a hypothesis, tempered, (R,).
        angles: joint angles of the model, from which the next solve starts, (R, J) [rad].
        play: where tendons are in their play.
    """

    states: Array
    covariances: Array
    evidence: Array
    angles: Array
    play: Play

    def copy(self) -> Belief:
        """A copy of all of it."""
        play = Play(*(values.copy() for values in self.play))
        return Belief(self.states.copy(), self.covariances.copy(), self.evidence.copy(), self.angles.copy(), play)

    def take(self, rows: Integers) -> Belief:
        """A copy of some rows."""
        play = Play(*(values[rows] for values in self.play))
        return Belief(self.states[rows], self.covariances[rows], self.evidence[rows], self.angles[rows], play)

    def put(self, rows: Integers, other: Belief) -> None:
        """Take over some rows."""
        self.states[rows], self.covariances[rows] = other.states, other.covariances
        self.evidence[rows], self.angles[rows] = other.evidence, other.angles
        for values, others in zip(self.play, other.play, strict=True):
            values[rows] = others


@dataclass
class Moment:
    """A step: what was measured in it, and what is believed after its tensions.

    Args:
        motors: measured positions, (N, m) [mm].
        tensions: measured, (N, m) [N].
        belief: the filters'.
        pictured: whether a picture of it has been taken in, (N,).
    """

    motors: Array
    tensions: Array
    belief: Belief
    pictured: NDArray[np.bool_]
