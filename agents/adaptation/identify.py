"""Identification: the model of a robot under which what was recorded on the bench is most likely.

Its motors go along the recorded path in the simulator, and its tensions, and tips where a camera saw them, are compared
with the recorded ones. The most likely numbers given the beliefs of twin.py (maximum a posteriori) minimise a sum of
squares, by a trust-region method (scipy) with forward differences. Errors beyond a few standard deviations count less,
since play and friction switch.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
from scipy.optimize import least_squares

from agents.adaptation.bench import CAMERA_MM, FIRST_STEPS, Bench, Recording
from agents.adaptation.twin import Space
from agents.controllers.controller import Array
from agents.robots.driving import MOST_EPISODES
from agents.robots.robot import Robot

GRID = (0.75, 1.5, 3.0, 4.5, 6.0), (0.1, 0.4, 0.8)  # play [mm] and sheath friction of all tendons, where it may begin
EVALUATIONS = 15  # at most, each with its derivatives
TENSION_SD, TIP_SD = 0.2, 2 * CAMERA_MM  # of what the model leaves: twice the noise of the sensors, N and mm
LOST = 10.0  # standard deviations: what counts where the model's episode has ended
REACH = 0.05  # of the differences, in standard deviations of the beliefs
_FAR = 3.0  # standard deviations: errors beyond count less
_ENOUGH = 3e-4  # change of the cost at which the search ends, as a share of it


@dataclass(frozen=True)
class Identified:
    """What is believed of a robot after the bench.

    Args:
        number: of the robot. values: of the twin, (P,) as Space has them. covariance: (P, P).
        residual: root mean square of what is left, in standard deviations; before: the same of the first belief.
    """

    number: int
    values: Array
    covariance: Array
    residual: float
    before: float

    @cached_property
    def twin(self) -> Robot:
        """The most likely robot."""
        return Space().robot(self.values, self.number)

    @property
    def sd(self) -> dict[str, Array]:
        """Standard deviations of its numbers, by the fields of a Robot."""
        return Space().fields(np.sqrt(np.diag(self.covariance)))

    def drawn(self, rng: np.random.Generator) -> Robot:
        """A robot as it may be, too."""
        return Space().robot(rng.multivariate_normal(self.values, self.covariance), self.number)


def identify(
    recording: Recording, number: int, evaluations: int = EVALUATIONS, say: Callable[[], object] = lambda: None
) -> Identified:
    """What is believed of a robot after a recording of it.

    Args:
        recording: of the robot with this number. evaluations: as many at most.
        say: called at every evaluation of the model with derivatives.
    """
    space, misfit = Space(), _Misfit(recording)

    def derivatives(scaled: Array) -> Array:
        say()
        return misfit.derivatives(scaled)

    start = misfit.start()
    bounds = tuple((end - space.mean) / space.sd for end in (space.low, space.high))
    found = least_squares(
        misfit, start, derivatives, bounds, ftol=_ENOUGH, loss="soft_l1", f_scale=_FAR, max_nfev=evaluations
    )
    misfit.bench.close()
    covariance = np.linalg.inv(found.jac.T @ found.jac) * np.outer(space.sd, space.sd)
    count = found.fun.size - start.size
    residual, before = (
        float(np.sqrt(np.mean(each[:count] ** 2))) for each in (found.fun, misfit(np.zeros(start.size)))
    )
    return Identified(number, space.mean + found.x * space.sd, covariance, residual, before)


class _Misfit:
    """What a model leaves of a recording, then what it is off the beliefs, all in standard deviations.

    Robots are vectors of Space minus its means, over its standard deviations.
    """

    def __init__(self, recording: Recording) -> None:
        self.recording, self.space, self.bench = recording, Space(), Bench(len(recording.seeds))
        self.counts = recording.running[:, FIRST_STEPS:]
        self.seeds = [seed + MOST_EPISODES // 2 for seed in recording.seeds]  # begins elsewhere in its play

    def __call__(self, scaled: Array) -> Array:
        recorded, space = self.recording, self.space
        model = self.bench.follow(space.robot(space.mean + scaled * space.sd, 0), self.seeds, recorded.motors[:, 1:])
        lost = ~model.running[:, FIRST_STEPS:, None]
        parts = [(model.tensions - recorded.tensions) / TENSION_SD]
        if recorded.tips is not None and model.tips is not None:
            parts.append((model.tips - recorded.tips) / TIP_SD)
        left = [np.where(lost, LOST, part[:, FIRST_STEPS:])[self.counts].ravel() for part in parts]
        return np.concatenate([*left, scaled])

    def start(self) -> Array:
        """The best point of a grid over play and sheath friction, which have more than one minimum."""
        points = [self.space.with_all(play_mm=play, sheath_friction=sheath) for play, sheath in product(*GRID)]
        scaled = [(point - self.space.mean) / self.space.sd for point in points]
        return min(scaled, key=lambda each: float(np.sum(np.minimum(self(each) ** 2, LOST))))

    def derivatives(self, scaled: Array) -> Array:
        """By forward differences; surfaces, of which tensions say little, stay as they are if no tip is seen."""
        here, units = self(scaled), np.eye(scaled.size)
        found = np.vstack([np.zeros((here.size - scaled.size, scaled.size)), units])
        for place in range(self.space.surfaces if self.recording.tips is None else scaled.size):
            found[:, place] = (self(scaled + REACH * units[place]) - here) / REACH
        return found
