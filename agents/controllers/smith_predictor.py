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
    """What was measured when the last pictures of B episodes were taken; rows change as new ones come.

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

    The load is unknown: the moments that balance the tendons at the time of the picture are taken to stay. Of what the
    model's tip was off in the picture, the prediction keeps the share TRUST.

    Args:
        settings: as of JacobianFeedback; with pictures that are never late it is the same controller.
    """

    TRUST = 0.5  # of a measured tip against that of the measured angles

    def reset(self, mask: Mask) -> None:
        """Begin episodes, (B,): no picture, nothing measured."""
        super().reset(mask)
        if mask.all():
            self.past: list[tuple[Array, Array]] = []  # commands behind the play and tensions, the newest first
            self.picture: Picture | None = None
        self._blind = mask.copy()  # whose first picture is still to come

    def error(self, reading: Reading) -> Array:
        """Target minus predicted tip, (B, 2) [mm]."""
        limits = self.task.config.tension_range
        self.past = [(self.play.tendons, np.clip(reading.tensions, *limits)), *self.past][: self._remembered]
        picture = self._look(reading)
        then = measured_equilibrium(self.task.mechanism, picture)
        commands = unstretched(then) + self.play.tendons - picture.tendons
        self.model: Equilibrium = solve_lengths_batch(self.task.mechanism, commands, then.loads, then, limits)
        predicted = self.model.tip + self.TRUST * (picture.tip - then.tip)
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
        now = Picture(reading.joint_angles, tensions, reading.tip, tendons)
        if self.picture is None:
            self.picture = now
        new, self._blind = (reading.picture_is_new | self._blind)[:, None], np.zeros_like(self._blind)
        for name, values in vars(now).items():
            setattr(self.picture, name, np.where(new, values, getattr(self.picture, name)))
        return self.picture
