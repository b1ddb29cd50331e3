"""A bank of extended Kalman filters: what tensions and pictures say of load, play and friction."""

from __future__ import annotations

import numpy as np

from agents.controllers.controller import Mask, Reading
from agents.controllers.filters.estimate import Estimate, average
from agents.controllers.filters.filters import Filters, Integers, Linearised, Moment
from agents.controllers.filters.hypotheses import FilterSettings, Hypotheses
from rj_gym.tracking.task import TrackingTask


class Bank:
    """Filters side by side, one per hypothesis, weighed by how likely they make what is measured.

    Every filter carries on the commands behind its play by the play's own law, and estimates the load, the offsets of
    the commands, the stiffnesses of the tendons, and, where pictures show it, how far the model's tip is off. A late
    picture is taken in where it belongs: the filters go back to its step, and on again.

    Args:
        task: of which it knows the settings and the nominal mechanism.
        settings: what it assumes.

    Attributes:
        weights: of the hypotheses, (N, H), of sum 1. tips: under each of them, (N, H, d) [mm].
        belief: of this step. linear: derivatives of the model. model: that of its filters.
    """

    def __init__(self, task: TrackingTask, settings: FilterSettings) -> None:
        mechanism, sensing = task.mechanism, task.config.sensing
        self.hypotheses = Hypotheses.of(task.config, settings, mechanism.n_links, mechanism.n_tendons)
        self._filters, self._dimension = Filters(task, settings, self.hypotheses), task.dimension
        self.model = self._filters.model
        self._sees, self._moments = sensing.pose, sensing.delay + 1
        self._past: list[Moment] = []  # the newest first

    def reset(self, mask: Mask) -> None:
        """Begin episodes, (N,): nothing is measured in them."""
        self._episodes, self._fresh, H = len(mask), mask.copy(), len(self.hypotheses)
        if mask.all():
            self._past = []
            self.weights, self.tips = np.full((len(mask), H), 1.0 / H), np.zeros((len(mask), H, self._dimension))

    def take_in(self, reading: Reading) -> Estimate:
        """The estimate after what is seen of the episodes in this step."""
        now = self._next_moment(reading)
        self._past = [now, *self._past[: self._moments - 1]]
        found = self._filters.take_tensions(now.belief, now.motors, now.tensions)
        if self._sees != "none":
            found = self._take_pictures(reading, found)
        evidence = now.belief.evidence.reshape(self._episodes, -1)
        evidence -= evidence.max(axis=1, keepdims=True)
        self.weights = np.exp(evidence)
        self.weights /= self.weights.sum(axis=1, keepdims=True)
        return self._estimate(now, found)

    def _next_moment(self, reading: Reading) -> Moment:
        """The forecast of this step."""
        motors = reading.commands
        if self._past:
            belief = self._past[0].belief.copy()
            self._filters.forecast(belief, motors)
            if self._fresh.any():
                belief.put(self._rows(np.flatnonzero(self._fresh)), self._filters.begin(motors[self._fresh]))
        else:
            belief = self._filters.begin(motors)
        self._fresh = np.zeros_like(self._fresh)
        return Moment(motors, reading.tensions, belief, np.zeros(self._episodes, bool))

    def _take_pictures(self, reading: Reading, found: Linearised) -> Linearised:
        """Take new pictures in, each at its step; the model as it was last solved."""
        pictured = np.zeros(self._episodes, bool)
        for age in range(len(self._past)):
            new = reading.picture_is_new & (np.rint(reading.picture_age) == age) & ~self._past[age].pictured
            if new.any():
                last = self._go_back(reading, age, np.flatnonzero(new))
                pictured |= new
        if pictured.all():
            return last
        return self._filters.solve(self._past[0].belief) if pictured.any() else found

    def _go_back(self, reading: Reading, age: int, episodes: Integers) -> Linearised:
        """Take the pictures of these episodes in at their step, and the tensions of the steps since then again."""
        filters, then, rows = self._filters, self._past[age], self._rows(episodes)
        then.pictured[episodes] = True
        shows_links = self._sees == "all" and self.model.n_angles > 0
        angles = reading.poses[episodes, 1:, 2] if shows_links else np.empty((len(episodes), 0))
        belief = then.belief.take(rows)
        found = filters.take_picture(belief, angles, reading.tip[episodes])
        then.belief.put(rows, belief)
        for moment in self._past[:age][::-1]:
            belief.angles = moment.belief.angles[rows]
            motors, tensions = moment.motors[episodes], moment.tensions[episodes]
            filters.forecast(belief, motors)
            found = filters.take_tensions(belief, motors, tensions)
            moment.belief.put(rows, belief)
        return found

    def _rows(self, episodes: Integers) -> Integers:
        """The rows of the filters of these episodes, (len(episodes) * H,)."""
        H = len(self.hypotheses)
        rows: Integers = (episodes[:, None] * H + np.arange(H)).ravel()
        return rows

    def _estimate(self, now: Moment, found: Linearised) -> Estimate:
        (N, m), d = now.motors.shape, self.tips.shape[2]
        estimate = Estimate(*map(np.empty, ((N, d), (N, m), (N, d, m), (N, m, m), (N, m), (N, m))))
        self.belief = belief = now.belief
        model, at = found.prediction, self.model.places
        self.linear = model.linear
        changes = belief.states - found.states
        average(self.weights, model.solved, model.linear, belief.play, belief.states, changes, at, self.tips, estimate)
        return estimate
