"""The hidden numbers of an episode: where each lies in a vector, and what is known of them before any measurement."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from rollingjoint.chain.rolling import RollingChain
from rollingjoint.checks import as_range

Array = NDArray[np.float64]
Range = tuple[float, float]

PER_SURFACE = 3  # x, y, angle
PER_JOINT = 2 * PER_SURFACE


class HiddenLayout(NamedTuple):
    """Where in a vector of K hidden numbers its parts begin; the force (2) is at 0, the surfaces are last."""

    offsets: int
    stiffnesses: int
    half_widths: int
    frictions: int
    places: int
    gains: int
    zeros: int
    surfaces: int
    total: int

    @classmethod
    def of(cls, n_tendons: int, n_joints: int) -> Self:
        """The layout for m tendons and J joints with displaced surfaces; 0 joints where surfaces are exact."""
        starts = [2 + n_tendons * part for part in range(8)]
        return cls._make([*starts, starts[-1] + PER_JOINT * n_joints])


@dataclass(frozen=True)
class HiddenRanges:
    """Ranges of hidden numbers, as the settings of a task give them; each is uniform but for the force.

    Args:
        force: magnitudes of the force on the loaded link, of any direction [N]. wanders: whether it is a process about
            0 with half the largest one as standard deviation of a component.
        offset_mm: what every commanded length is off [mm]. stiffness: factors of the nominal stiffnesses.
        play_mm: widths of the play [mm]. sheath_friction: coefficients.
        gain: of the load cells. zero: what they show at no tension [N].
        surface_mm, surface_rad: how far contact surfaces are displaced in x and in y, and turned, either way.
    Raises:
        InvalidInput: a range that is none.
    """

    force: Range = (0.0, 1.0)
    wanders: bool = False
    offset_mm: Range = (0.0, 0.0)
    stiffness: Range = (1.0, 1.0)
    play_mm: Range = (0.0, 0.0)
    sheath_friction: Range = (0.0, 0.0)
    gain: Range = (1.0, 1.0)
    zero: Range = (0.0, 0.0)
    surface_mm: float = 0.0
    surface_rad: float = 0.0

    def __post_init__(self) -> None:
        for name in ("force", "play_mm", "sheath_friction"):
            as_range(name, getattr(self, name), low=0.0)
        for name in ("stiffness", "gain"):
            as_range(name, getattr(self, name), low=1e-3)

    def worn(self) -> HiddenRanges:
        """The ranges of a mechanism that has worn beyond them: play and sheath friction reach up twice as far."""
        (tight, loose), (smooth, rough) = self.play_mm, self.sheath_friction
        return replace(self, play_mm=(tight, 2.0 * loose - tight), sheath_friction=(smooth, 2.0 * rough - smooth))


@dataclass(frozen=True)
class HiddenPrior:
    """Hidden numbers before any measurement: normal distributions with the moments of their ranges, and bounds.

    Args:
        layout: where they lie. means, sds: (K,). low, high: bounds, (K,). radius: of the largest force [N].
    """

    layout: HiddenLayout
    means: Array
    sds: Array
    low: Array
    high: Array
    radius: float

    @classmethod
    def of(cls, chain: RollingChain, ranges: HiddenRanges) -> Self:
        """The prior of a chain with numbers in these ranges."""
        m, displaced = chain.n_tendons, ranges.surface_mm > 0.0 or ranges.surface_rad > 0.0
        layout = HiddenLayout.of(m, chain.n_joints if displaced else 0)
        weakest, strongest = ranges.force
        any_direction = math.sqrt((weakest**2 + weakest * strongest + strongest**2) / 6.0)
        half_widths = 0.5 * ranges.play_mm[0], 0.5 * ranges.play_mm[1]
        per_tendon = [
            *(ranges.offset_mm, ranges.stiffness, half_widths, ranges.sheath_friction),
            *((-0.5, 0.5) if ranges.play_mm[1] > 0.0 else (0.0, 0.0), ranges.gain, ranges.zero),
        ]
        pairs = np.repeat(np.array(per_tendon), m, axis=0)
        tolerances = np.tile([ranges.surface_mm, ranges.surface_mm, ranges.surface_rad], 2 * chain.n_joints)
        tolerances = tolerances[: layout.total - layout.surfaces]
        low, high = (
            np.concatenate([np.full(2, way * strongest), pairs[:, side], way * tolerances])
            for side, way in ((0, -1.0), (1, 1.0))
        )
        sds = (high - low) / math.sqrt(12.0)
        sds[:2] = 0.5 * strongest if ranges.wanders else any_direction
        return cls(layout, 0.5 * (low + high), sds, low, high, strongest)

    def cells(self, numbers: Array) -> tuple[Array, Array]:
        """Gains and zeros [N] of the load cells in hidden numbers (R, K), (R, m) each."""
        at = self.layout
        return numbers[:, at.gains : at.zeros], numbers[:, at.zeros : at.surfaces]

    def without_surfaces(self) -> HiddenPrior:
        """The same with exact contact surfaces."""
        count = self.layout.surfaces
        layout = self.layout._replace(total=count)
        means, sds, low, high = (values[:count].copy() for values in (self.means, self.sds, self.low, self.high))
        return HiddenPrior(layout, means, sds, low, high, self.radius)

    def within(self, numbers: Array) -> Array:
        """Hidden numbers (..., K) moved into their bounds."""
        inside = np.clip(numbers, self.low, self.high)
        size = np.hypot(inside[..., 0], inside[..., 1])[..., None]
        inside[..., :2] *= np.minimum(1.0, self.radius / np.maximum(size, 1e-12))
        return inside
