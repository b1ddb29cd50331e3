"""Identification: the model of a robot under which the recording on the bench is most likely.

Its motors go along the recorded path in the simulator, and its tensions, and tips where a camera saw them, are compared
with the recorded ones. The most likely numbers given the beliefs BELIEFS (maximum a posteriori) minimise a sum of
squares, by a trust-region method (scipy) with forward differences. Errors beyond a few standard deviations count less,
since play and friction switch.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares

from agents.adaptation.bench import CAMERA_MM, FIRST_STEPS, Bench, BenchRecording
from agents.adaptation.driving import MOST_EPISODES
from agents.adaptation.robot import Robot
from agents.controllers.controller import Array
from rollingjoint import five_link

GRID = (0.75, 1.5, 3.0, 4.5, 6.0), (0.1, 0.4, 0.8)  # play [mm] and sheath friction of all tendons, where it may begin
EVALUATIONS = 15  # at most, each with its derivatives
TENSION_SD, TIP_SD = 0.2, 2 * CAMERA_MM  # of the residuals: twice the noise of the sensors, N and mm
LOST = 10.0  # standard deviations: the residual after the end of the model's episode
REACH = 0.05  # of the differences, in standard deviations of the beliefs
_FAR = 3.0  # standard deviations: errors beyond count less
_ENOUGH = 3e-4  # change of the cost at which the search ends, as a share of it


@dataclass(frozen=True)
class Belief:
    """A field of Robot: a normal distribution, and bounds beyond which it cannot be; each a number or an array."""

    mean: float
    sd: ArrayLike
    low: ArrayLike
    high: ArrayLike


BELIEFS = {
    "play_mm": Belief(1.75, 1.5, 0.05, 8.0),
    "sheath_friction": Belief(0.3, 0.3, 0.0, 1.0),
    "mu": Belief(0.05, 0.05, 0.0, 0.25),
    "stiffness": Belief(1.0, 0.2, 0.4, 2.0),
    "motor_offsets": Belief(0.0, 0.5, -3.0, 3.0),
    "surface_errors": Belief(0.0, (0.1, 0.1, 0.01), (-0.5, -0.5, -0.05), (0.5, 0.5, 0.05)),
}
"""About the ranges of rj_gym/Instrument-v0, twice as wide or more; and that tendons may rub in the chain."""


class Space:
    """Robots as vectors (P,): field after field, in the units of Robot.

    Attributes:
        mean, sd, low, high: of the beliefs, (P,).
        surfaces: where the errors of surfaces begin, the last field.
    """

    def __init__(self) -> None:
        n, m = five_link().n_links, five_link().n_tendons
        self._shapes = {name: (n, 2, 3) if name == "surface_errors" else (m,) for name in BELIEFS}
        self.surfaces = (len(BELIEFS) - 1) * m
        self.mean, self.sd, self.low, self.high = (
            self.vector({name: getattr(belief, what) for name, belief in BELIEFS.items()})
            for what in ("mean", "sd", "low", "high")
        )

    def vector(self, values: Mapping[str, ArrayLike]) -> Array:
        """The vector of these fields, each spread to the shape that it has in Robot."""
        parts = [np.broadcast_to(np.asarray(values[name], float), shape) for name, shape in self._shapes.items()]
        return np.concatenate([part.ravel() for part in parts])

    def with_all(self, **values: float) -> Array:
        """The means, with these fields the same of all tendons."""
        return self.vector({name: belief.mean for name, belief in BELIEFS.items()} | values)

    def fields(self, values: Array) -> dict[str, Array]:
        """A vector in the fields of a Robot."""
        parts = {}
        for name, shape in self._shapes.items():
            parts[name], values = values[: np.prod(shape)].reshape(shape), values[np.prod(shape) :]
        return parts

    def robot(self, values: Array, number: int) -> Robot:
        """The robot of a vector, cut to the bounds."""
        return Robot(number=number, **self.fields(np.clip(values, self.low, self.high)))


@dataclass(frozen=True)
class Identified:
    """Beliefs about a robot after the bench.

    Args:
        number: of the robot. values: of the twin, (P,) as Space has them. covariance: (P, P).
        residual: root mean square of the residuals, in standard deviations. before: the same of the first belief.
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
    recording: BenchRecording, number: int, evaluations: int = EVALUATIONS, say: Callable[[], object] = lambda: None
) -> Identified:
    """Beliefs about a robot after a recording of it.

    Args:
        recording: of the robot with this number. evaluations: their largest number.
        say: called at every evaluation of the model with derivatives.
    """
    space, misfit = Space(), _Misfit(recording)

    def derivatives(scaled: Array) -> Array:
        say()
        return misfit.derivatives(scaled)

    start = misfit.start()
    bounds = tuple((end - space.mean) / space.sd for end in (space.low, space.high))
    solution = least_squares(
        misfit, start, derivatives, bounds, ftol=_ENOUGH, loss="soft_l1", f_scale=_FAR, max_nfev=evaluations
    )
    misfit.bench.close()
    covariance = np.linalg.inv(solution.jac.T @ solution.jac) * np.outer(space.sd, space.sd)
    count = solution.fun.size - start.size
    residual, before = (
        float(np.sqrt(np.mean(residuals[:count] ** 2))) for residuals in (solution.fun, misfit(np.zeros(start.size)))
    )
    return Identified(number, space.mean + solution.x * space.sd, covariance, residual, before)


class _Misfit:
    """Residuals of a model against a recording, then its distances from the beliefs, all in standard deviations.

    Robots are vectors of Space minus its means, over its standard deviations.
    """

    def __init__(self, recording: BenchRecording) -> None:
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
        residuals = [np.where(lost, LOST, part[:, FIRST_STEPS:])[self.counts].ravel() for part in parts]
        return np.concatenate([*residuals, scaled])

    def start(self) -> Array:
        """The best point of a grid over play and sheath friction, which have more than one minimum."""
        points = [self.space.with_all(play_mm=play, sheath_friction=sheath) for play, sheath in product(*GRID)]
        scaled = [(point - self.space.mean) / self.space.sd for point in points]
        return min(scaled, key=lambda point: float(np.sum(np.minimum(self(point) ** 2, LOST))))

    def derivatives(self, scaled: Array) -> Array:
        """By forward differences; surfaces, of which tensions say little, stay as they are if no tip is seen."""
        residuals, units = self(scaled), np.eye(scaled.size)
        jacobian = np.vstack([np.zeros((residuals.size - scaled.size, scaled.size)), units])
        for place in range(self.space.surfaces if self.recording.tips is None else scaled.size):
            jacobian[:, place] = (self(scaled + REACH * units[place]) - residuals) / REACH
        return jacobian
