"""Identification of a robot: rollingjoint.identify of a recording, with beliefs about instruments.

A recording on the simulated bench and one of a rig are identified alike: by the model of rollingjoint/identify/twin.py.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from agents.adaptation.bench import FIRST_STEPS, BenchRecording
from agents.adaptation.robot import Robot
from agents.controllers.controller import Array
from rj_gym.tracking.worlds import InstrumentConfig
from rollingjoint import five_link
from rollingjoint.errors import InvalidInput
from rollingjoint.identify.beliefs import Belief, RigSpace
from rollingjoint.identify.recording import RecordedRun, RigRecording
from rollingjoint.identify.rig import EVALUATIONS, IdentifiedRig, identify_rig

KINDS = {
    "play_mm": "play",
    "sheath_friction": "sheath",
    "mu": "mu",
    "stiffness": "stiffness",
    "motor_offsets": "offsets",
    "surface_errors": "surfaces",
}
"""Fields of Robot, and what rollingjoint.identify calls them."""

BELIEFS = {
    "play_mm": Belief(1.75, 1.5, 0.05, 8.0),
    "sheath_friction": Belief(0.3, 0.3, 0.0, 1.0),
    "mu": Belief(0.05, 0.05, 0.0, 0.25),
    "stiffness": Belief(1.0, 0.2, 0.4, 2.0),
    "motor_offsets": Belief(0.0, 1.0, -3.0, 3.0),
    "surface_errors": Belief(0.0, (0.15, 0.15, 0.015), (-0.5, -0.5, -0.05), (0.5, 0.5, 0.05)),
}
"""About the ranges of rj_gym/Instrument-v0, twice as wide or more; and that tendons may rub in the chain."""


class Space:
    """Robots as vectors (P,): field after field, in the units of Robot.

    Attributes:
        mean, sd, low, high: of the beliefs, (P,).
        surfaces: where the errors of surfaces begin, the last field.
    """

    def __init__(self) -> None:
        self._rigs = RigSpace(five_link(), list(KINDS.values()), {KINDS[name]: each for name, each in BELIEFS.items()})
        self.mean, self.sd, self.low, self.high = (getattr(self._rigs, part) for part in ("mean", "sd", "low", "high"))
        self.surfaces: int = self._rigs.place("surfaces").start

    def vector(self, values: Mapping[str, ArrayLike]) -> Array:
        """The vector of these fields, each spread to the shape that it has in Robot."""
        return self._rigs.vector({KINDS[name]: value for name, value in values.items()})

    def fields(self, values: Array) -> dict[str, Array]:
        """A vector in the fields of a Robot."""
        parts = self._rigs.fields(values)
        return {name: parts[kind] for name, kind in KINDS.items()}

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
    """Beliefs about a robot after a recording of it on the simulated bench.

    Args:
        recording: of the robot with this number. evaluations: their largest number.
        say: called at every evaluation of the model with derivatives.
    """
    beliefs = {KINDS[name]: each for name, each in BELIEFS.items()}
    found = identify_rig(
        rig_recording(recording),
        kinds=list(KINDS.values()),
        beliefs=beliefs,
        limits=InstrumentConfig().tension_range,
        first=FIRST_STEPS,
        evaluations=evaluations,
        say=say,
    )
    return Identified(number, found.values, found.covariance, found.residual, found.before)


def rig_recording(recording: BenchRecording) -> RigRecording:
    """Episodes on the simulated bench as runs of a recording, a step being a second."""
    runs = []
    tips = np.full((*recording.motors.shape[:2], 2), np.nan) if recording.tips is None else recording.tips
    for episode, (motors, tensions) in enumerate(zip(recording.motors, recording.tensions, strict=True)):
        kept = np.flatnonzero(recording.running[episode])
        if len(kept) > 1:
            runs.append(
                RecordedRun(kept.astype(float), motors[kept], tensions[kept], tips[episode, kept], f"{episode}")
            )
    return RigRecording(runs, five_link())


def identify_recording(
    recording: RigRecording, say: Callable[[], object] = lambda: None
) -> tuple[Identified, IdentifiedRig]:
    """Beliefs about a rig after a recording of it, for controllers, and in full.

    Controllers are adapted to a rig whose positions have the offsets added that were found; their errors are left.

    Raises:
        InvalidInput: a recording of another mechanism than five_link, with which instruments are.
    """
    chain = five_link()
    mechanism = recording.mechanism or chain
    if (type(mechanism), mechanism.n_links, mechanism.n_tendons) != (type(chain), chain.n_links, chain.n_tendons):
        raise InvalidInput("mechanism of the recording", mechanism.name, "five_link, or one of its kind")
    found = identify_rig(recording, chain, list(KINDS.values()), say=say)
    values = found.values.copy()
    values[found.space.place("offsets")] = 0.0
    return Identified(0, values, found.covariance, found.residual, found.before), found
