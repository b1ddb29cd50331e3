"""A Smith predictor: Jacobian feedback on the pose that the model predicts from the last picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from agents.controllers.controller import Array, Mask, Reading
from agents.controllers.jacobian_feedback import JacobianFeedback
from agents.controllers.measured import measured_equilibrium, unstretched
from rollingjoint import Equilibrium, solve_lengths_batch
from rollingjoint.chain.solution import Solution


@dataclass
class Picture:
    """Measurements at the last pictures of B episodes; rows change as new ones come.

    Args:
        joint_angles: (B, n - 1) [rad]. tensions: (B, m) [N]. tip: (B, 2) [mm].
        tendons: commands behind the play, (B, m) [mm].
    """

    joint_angles: Array
    tensions: Array
    tip: Array
    tendons: Array


class SmithPredictor(JacobianFeedback):
    """Jacobian feedback on the pose now, which the model predicts from the last picture and the commands since then.

    The load is unknown: the moments that balance the tendons at the time of the picture are taken to stay. Of the error
    of the model's tip in the picture, the prediction keeps the share TRUST.

    Args:
        settings: as of JacobianFeedback; with pictures that are never late it is the same controller.
    """

    TRUST = 0.5  # of a measured tip against the tip of the measured angles

    def reset(self, mask: Mask) -> None:
        """Begin episodes, (B,): their first observation has a picture."""
        super().reset(mask)
        if mask.all():
            self.past: list[tuple[Array, Array]] = []  # commands behind the play and tensions, the newest first
            self.picture: Picture | None = None

    def error(self, reading: Reading) -> Array:
        """Target minus predicted tip, (B, 2) [mm]."""
        limits = self.task.config.possible_tensions
        self.past = [(self.play.tendons, np.clip(reading.tensions, *limits)), *self.past][: self._remembered]
        picture = self._look(reading)
        past_model = measured_equilibrium(self.task.mechanism, picture)
        commands = unstretched(past_model) + self.play.tendons - picture.tendons
        loads, mechanism = past_model.loads, self.task.mechanism
        self.model: Equilibrium = solve_lengths_batch(mechanism, commands, loads, past_model, limits)
        predicted = self.model.tip + self.TRUST * (picture.tip - past_model.tip)
        return reading.target - np.where(np.asarray(self.model.ok)[:, None], predicted, picture.tip)

    def increments(self, reading: Reading, way: Array) -> Array:
        """Changes of the commanded lengths that move the tip by `way` (B, 2), (B, m) both [mm]."""
        model: Solution = self.model
        return self.step(model, way, self.wanted(model), np.zeros_like(model.tensions))

    @property
    def _remembered(self) -> int:
        return self.task.config.sensing.delay + 1

    def _look(self, reading: Reading) -> Picture:
        """The last pictures, with those that are new in this step."""
        ages = np.minimum(np.rint(reading.picture_age).astype(int), len(self.past) - 1)
        tendons, tensions = (np.stack(series)[ages, np.arange(len(ages))] for series in zip(*self.past, strict=True))
        current = Picture(reading.joint_angles, tensions, reading.tip, tendons)
        if self.picture is None:
            self.picture = current
        for name, values in vars(current).items():
            setattr(self.picture, name, np.where(reading.picture_is_new[:, None], values, getattr(self.picture, name)))
        return self.picture
