"""What the drawings of the tracking tasks share: the scene, and captions beside the mechanism."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rj_gym.rendering.canvas import BACKGROUND, INK, TARGET, Canvas, Color, blend

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class TrackingScene:
    """What a picture of a tracking task shows; d is the number of coordinates of a position.

    Args:
        mechanism: the mechanism. poses: of its links [mm, rad].
        tensions: (m,) [N]. tension_range: minimum and maximum tendon tension [N].
        targets: of the tip over the episode, (T + 1, d) [mm].
        tip: where it is, (d,) [mm]. trail: where it has been, (K, d) [mm].
        step: steps taken.
    """

    mechanism: Any
    poses: Array
    tensions: Array
    tension_range: tuple[float, float]
    targets: Array
    tip: Array
    trail: Array
    step: int

    @property
    def target(self) -> Array:
        """Where the tip should be now, (d,) [mm]."""
        return self.targets[self.step]


class TrackingCanvas(Canvas):
    """A canvas for the scenes of tracking tasks."""

    def path(self, targets: Array, seen: Callable[[Array], Array] = np.asarray) -> None:
        """Where a moving target comes from and goes to; `seen` gives positions in the plane of the picture."""
        if np.any(targets != targets[0]):
            self.line(seen(targets), 0.6, blend(BACKGROUND, TARGET, 0.45))

    def facts(self, scene: TrackingScene, *loads: tuple[str, Color], pitch: int = 32, width: int = 120) -> None:
        """Step, error and loads in words, and a bar for every tension."""
        error = float(np.linalg.norm(scene.tip - scene.target))
        step = f"step {scene.step} / {len(scene.targets) - 1}"
        self.captions((step, INK), (f"error {error:.1f} mm", TARGET), *loads)
        for j, tension in enumerate(scene.tensions):
            self.tension_bar(j, float(tension), scene.tension_range, pitch, width)
