"""Extended Kalman filters on the model of a mechanism: forecasts, and updates by tensions and pictures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from agents.controllers.controller import Array
from agents.controllers.filters import kalman, kernels
from agents.controllers.filters.hypotheses import FilterSettings, Hypotheses
from agents.controllers.filters.kernels import Play
from agents.controllers.filters.model import Prediction
from agents.controllers.filters.models import model_of
from agents.controllers.filters.prior import Prior, start_measurement
from rj_gym.tracking.task import TrackingTask

Integers = NDArray[np.int64]


@dataclass
class Beliefs:
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

    def copy(self) -> Beliefs:
        """A copy of all of it."""
        play = Play(*(values.copy() for values in self.play))
        return Beliefs(self.states.copy(), self.covariances.copy(), self.evidence.copy(), self.angles.copy(), play)

    def take(self, rows: Integers) -> Beliefs:
        """A copy of some rows."""
        play = Play(*(values[rows] for values in self.play))
        return Beliefs(self.states[rows], self.covariances[rows], self.evidence[rows], self.angles[rows], play)

    def put(self, rows: Integers, beliefs: Beliefs) -> None:
        """Take over some rows."""
        self.states[rows], self.covariances[rows] = beliefs.states, beliefs.covariances
        self.evidence[rows], self.angles[rows] = beliefs.evidence, beliefs.angles
        for values, others in zip(self.play, beliefs.play, strict=True):
            values[rows] = others


@dataclass
class FilterStep:
    """A step: its measurements, and the beliefs after its tensions.

    Args:
        motors: measured positions, (N, m) [mm].
        tensions: measured, (N, m) [N].
        belief: the filters'.
        pictured: whether a picture of it has been taken in, (N,).
    """

    motors: Array
    tensions: Array
    belief: Beliefs
    pictured: NDArray[np.bool_]


@dataclass(frozen=True)
class Linearised:
    """The model where it was solved; later beliefs are a linear step away.

    Args:
        prediction: the model. states: under which it was solved, (R, states).
    """

    prediction: Prediction
    states: Array


class Filters:
    """The filters of a bank; every method changes the beliefs that it is given.

    Args:
        task: of which they know the settings and the nominal mechanism.
        settings: their assumptions.
        hypotheses: their differences.
    """

    def __init__(self, task: TrackingTask, settings: FilterSettings, hypotheses: Hypotheses) -> None:
        self.task, self.settings, self.hypotheses = task, settings, hypotheses
        self.model = model_of(task, hypotheses.links)
        self.prior = Prior.of(task, self.model, settings, hypotheses)

    def begin(self, motors: Array) -> Beliefs:
        """The belief before anything is measured; where all tendons begin at the start tension, it knows that.

        motors: their positions, (N, m) [mm].
        """
        prior, config, (count, m) = self.prior, self.task.config, motors.shape
        covariances = np.tile(prior.variances[:, :, None] * np.eye(prior.variances.shape[1]), (count, 1, 1))
        states, evidence = np.tile(prior.means, (count, 1)), np.zeros(count * len(self.hypotheses))
        played = (motors[:, None] + self.hypotheses.half_widths * self.hypotheses.places).reshape(-1, m)
        play = Play(played, np.tile(self.hypotheses.places, (count, 1)), np.ones_like(played))
        start, _ = self.model.start(states, config.start_tension)
        angles = start.joint_angles * np.ones((len(states), 1))
        belief = Beliefs(states, covariances, evidence, angles, play)
        if config.start == "equal":
            self._take_start(belief)
        return belief

    def _take_start(self, belief: Beliefs) -> None:
        """Take in that all tendons began at the start tension; linearised anew where the first look leads."""
        prior, played, updated = belief.copy(), belief.play.played.copy(), belief
        for _ in range(self.model.START_PASSES):
            states, tension, sd = updated.states, self.task.config.start_tension, self.settings.start_sd_mm
            expected, columns, *measurement = start_measurement(self.model, states, played, tension, sd)
            change = prior.states - states
            expected = expected + np.einsum("rmi,ri->rm", columns, change)
            updated = prior.copy()
            self._update(updated, expected, columns, *measurement)
        belief.put(np.arange(len(played)), updated)

    def forecast(self, belief: Beliefs, motors: Array) -> None:
        """Move on by a step to motors' positions (N, m) [mm]."""
        kalman.forecast(belief.states, belief.covariances, self.prior.memory, self.prior.walk)
        kernels.move_play(belief.play, belief.states, motors, self.model.places)

    def take_tensions(self, belief: Beliefs, motors: Array, tensions: Array) -> Linearised:
        """Take measured positions and tensions of the motors in, (N, m) [mm, N]; the model as it was before that."""
        linearised = self.solve(belief)
        solved, linear = linearised.prediction.solved, linearised.prediction.linear
        expected, columns = np.empty_like(belief.play.played), np.empty_like(linear.tensions)
        kernels.expect_tensions(
            solved, linear, belief.play, belief.states, motors, self.model.places, expected, columns
        )
        variances = self.settings.tension_sd**2 + (self.settings.tension_share * expected) ** 2
        self._update(belief, expected, columns, np.repeat(tensions, len(self.hypotheses), axis=0), variances)
        return linearised

    def take_picture(self, belief: Beliefs, angles: Array, tip: Array) -> Linearised:
        """Take a picture in: link angles (N, J) [rad] and tip (N, d) [mm]; without angles where J is 0."""
        linearised = self.solve(belief)
        prediction, shown, settings = linearised.prediction, angles.shape[1], self.settings
        expected = np.hstack([prediction.link_angles[:, :shown], prediction.equilibria.tip + self._biases(linearised)])
        expected[np.logical_not(prediction.solved.usable)] = np.nan
        columns = np.concatenate([prediction.linear.angles[:, :shown], prediction.linear.tip], axis=1)
        spread = np.array([settings.angle_sd**2] * shown + [settings.position_sd_mm**2] * tip.shape[1])
        measured = np.repeat(np.hstack([angles, tip]), len(self.hypotheses), axis=0)
        self._update(belief, expected, columns, measured, np.repeat(spread[None], len(measured), axis=0))
        return linearised

    def solve(self, belief: Beliefs) -> Linearised:
        """The model under the beliefs, which take over its joint angles."""
        prediction = self.model.predict(belief.states, belief.play, belief.angles)
        valid = prediction.solved.usable[:, None]
        belief.angles = np.where(valid, prediction.equilibria.joint_angles, belief.angles)
        return Linearised(prediction, belief.states.copy())

    def _biases(self, linearised: Linearised) -> Array:
        at = self.model.places
        return linearised.states[:, at.bias : at.half_widths]

    def _update(self, belief: Beliefs, expected: Array, columns: Array, measured: Array, variances: Array) -> None:
        evidence, before, prior = np.zeros(len(measured)), belief.states.copy(), self.prior
        what = map(np.ascontiguousarray, (expected, columns, measured, variances))  # one order: compiled once
        kalman.update(belief.states, belief.covariances, evidence, *what)
        kalman.keep_physical(belief.states, self.model.radius, prior.low, prior.high)
        kernels.correct_play(belief.play, belief.states - before, self.model.places)
        belief.evidence += self.settings.tempering * evidence
