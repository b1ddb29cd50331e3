"""The hidden numbers of a chain in space in an episode: where each lies in a vector, and their distribution before."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from rollingjoint.chain.hinge import HingeChain
from rollingjoint.chain.spatial import SpatialChain
from rollingjoint.checks import as_range
from rollingjoint.errors import InvalidInput

Array = NDArray[np.float64]
Range = tuple[float, float]

LARGEST_TILT = 1.2
"""The largest tilt of gravity [rad]: z of its direction follows from x and y, as long as it is not near 0."""
_SMALLEST_MU = 1e-5  # of the holes: how far a tendon has turned in them follows from their grip


class ArmLayout(NamedTuple):
    """Where in a vector of K hidden numbers its parts begin; x and y of the direction of gravity (2) are at 0.

    Offsets to places have a number per tendon (m); gains and zeros of load cells too, or none where cells are exact;
    holes too, or one for all. Stiffnesses are factors of the nominal ones, like hinges and weights, which have a number
    per joint (J).
    """

    payload: int
    offsets: int
    stiffnesses: int
    half_widths: int
    frictions: int
    places: int
    gains: int
    zeros: int
    holes: int
    hinges: int
    weights: int
    total: int

    @classmethod
    def of(cls, n_tendons: int, n_joints: int, shared: bool = False, cells: bool = False) -> Self:
        """The layout for m tendons and J joints.

        shared: whether holes of all tendons have the same friction. cells: whether load cells err.
        """
        tendons = [3 + n_tendons * (part if cells else min(part, 5)) for part in range(8)]
        hinges = tendons[-1] + (1 if shared else n_tendons)
        return cls._make([2, *tendons, hinges, hinges + n_joints, hinges + 2 * n_joints])


@dataclass(frozen=True)
class ArmRanges:
    """Ranges of the hidden numbers of an arm, as the settings of a task give them; each is uniform.

    Args:
        tilt: angles between gravity and the straight arm, uniform over that part of the sphere [rad].
        payload: weight at the tip [N]. offset_mm: errors of the commanded lengths [mm].
        stiffness, hinge, weight: factors of the nominal stiffnesses of tendons and joints and of the links' weights.
        play_mm: widths of the play [mm]. sheath_friction, hole_friction: coefficients. shared: whether the holes of all
            tendons have the same.
        gain: of the load cells. zero: what they show at no tension [N].
    Raises:
        InvalidInput: a range that is none, or a tilt beyond LARGEST_TILT.
    """

    tilt: Range = (0.0, 0.5)
    payload: Range = (0.0, 0.5)
    offset_mm: Range = (0.0, 0.0)
    stiffness: Range = (1.0, 1.0)
    hinge: Range = (1.0, 1.0)
    weight: Range = (1.0, 1.0)
    play_mm: Range = (0.0, 0.0)
    sheath_friction: Range = (0.0, 0.0)
    hole_friction: Range = (0.0, 0.0)
    gain: Range = (1.0, 1.0)
    zero: Range = (0.0, 0.0)
    shared: bool = False

    def __post_init__(self) -> None:
        for name in ("tilt", "payload", "play_mm", "sheath_friction", "hole_friction"):
            as_range(name, getattr(self, name), low=0.0)
        for name in ("stiffness", "hinge", "weight", "gain"):
            as_range(name, getattr(self, name), low=1e-3)
        if self.tilt[1] > LARGEST_TILT:
            raise InvalidInput("tilt", self.tilt, f"angles up to {LARGEST_TILT:g} rad")

    @property
    def cells_err(self) -> bool:
        """Whether load cells err."""
        return self.gain != (1.0, 1.0) or self.zero != (0.0, 0.0)


@dataclass(frozen=True)
class ArmPrior:
    """Hidden numbers before any measurement: normal distributions with the moments of their ranges, and bounds.

    Args:
        layout: where they lie. means, sds: (K,). low, high: bounds, (K,). radius: the largest size of x and y of the
            direction of gravity.
    """

    layout: ArmLayout
    means: Array
    sds: Array
    low: Array
    high: Array
    radius: float

    @classmethod
    def of(cls, arm: HingeChain | SpatialChain, ranges: ArmRanges) -> Self:
        """The prior of an arm with numbers in these ranges."""
        m, n_joints = arm.n_tendons, arm.n_joints
        half_widths = 0.5 * ranges.play_mm[0], 0.5 * ranges.play_mm[1]
        places = (-0.5, 0.5) if ranges.play_mm[1] > 0.0 else (0.0, 0.0)
        holes = max(ranges.hole_friction[0], _SMALLEST_MU), max(ranges.hole_friction[1], _SMALLEST_MU)
        per_tendon = [ranges.offset_mm, ranges.stiffness, half_widths, ranges.sheath_friction, places]
        per_tendon += [ranges.gain, ranges.zero] if ranges.cells_err else []
        radius = math.sin(ranges.tilt[1])
        pairs = np.vstack([
            [(-radius, radius)] * 2, [ranges.payload],
            np.repeat(np.array(per_tendon), m, axis=0), [holes] * (1 if ranges.shared else m),
            [ranges.hinge] * n_joints, [ranges.weight] * n_joints,
        ])  # fmt: skip
        low, high = np.ascontiguousarray(pairs.T)
        sds = (high - low) / math.sqrt(12.0)
        sds[:2] = _across_sd(ranges.tilt)
        layout = ArmLayout.of(m, n_joints, ranges.shared, ranges.cells_err)
        return cls(layout, 0.5 * (low + high), sds, low, high, radius)

    def within(self, numbers: Array) -> Array:
        """Hidden numbers (..., K) moved into their bounds."""
        inside = np.clip(numbers, self.low, self.high)
        size = np.hypot(inside[..., 0], inside[..., 1])[..., None]
        inside[..., :2] *= np.minimum(1.0, self.radius / np.maximum(size, 1e-12))
        return inside

    def cells(self, numbers: Array) -> tuple[Array | float, Array | float]:
        """Gains and zeros [N] of the load cells in hidden numbers (R, K), (R, m) each; 1 and 0 where they are exact."""
        at = self.layout
        if at.gains == at.zeros:
            return 1.0, 0.0
        return numbers[:, at.gains : at.zeros], numbers[:, at.zeros : at.holes]


def _across_sd(tilt: Range) -> float:
    """Standard deviation of x of a direction that is uniform over the part of the sphere with these tilts."""
    angles = np.linspace(*tilt, 101)
    return math.sqrt(np.average(np.sin(angles) ** 2, weights=np.sin(angles) + 1e-12) / 2.0)
