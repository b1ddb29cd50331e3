"""What the drawings of the tracking tasks share: the scene, and captions beside the mechanism."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from rj_gym.rendering.canvas import BACKGROUND, INK, TARGET, Canvas, Color, blend

Array = NDArray[np.float64]
Scene = TypeVar("Scene")


def with_own_arrays(scene: Scene) -> Scene:
    """The scene, a dataclass of any task, with copies of its arrays."""
    any_task: Any = scene
    values = {field.name: getattr(scene, field.name) for field in fields(any_task)}
    copied: Scene = replace(any_task, **{name: v.copy() for name, v in values.items() if isinstance(v, np.ndarray)})
    return copied


@dataclass(frozen=True, kw_only=True)
class TrackingScene:
    """What a picture of a tracking task shows; d is the number of coordinates of a position.

    Args:
        mechanism: the mechanism. poses: of its links [mm, rad].
        tensions: (m,) at the motors [N]. tension_range: minimum and maximum tendon tension [N].
        targets: of the tip over the episode, (T + 1, d) [mm].
        tip: where it is, (d,) [mm]. trail: where it has been, (K, d) [mm].
        step: steps taken.
        gap_tensions: (n - 1, m) [N], None where there is no friction: there the tensions are those of every gap.
    """

    mechanism: Any
    poses: Array
    tensions: Array
    tension_range: tuple[float, float]
    targets: Array
    tip: Array
    trail: Array
    step: int
    gap_tensions: Array | None = None

    def tendon_parts(self, j: int, points: Array, from_hole: bool) -> Iterator[tuple[Array, float]]:
        """Parts of a tendon's line and the tension of each [N]: the whole line; with friction every gap and every link.

        Friction acts at the holes: inside a link the tension is shown as the mean of those around it.

        Args:
            j: the tendon.
            points: its line from the base to its end, (K, d) [mm].
            from_hole: whether the line begins inside the base, and not with the first gap.
        """
        if self.gap_tensions is None:
            yield points, float(self.tensions[j])
            return
        gaps = self.gap_tensions[: (len(points) - 1) // 2, j]
        along = np.append(self.tensions[j], np.repeat(gaps, 2))
        along[::2] = 0.5 * (along[::2] + np.append(gaps, gaps[-1]))
        for k, tension in enumerate(along[0 if from_hole else 1 :]):
            yield points[k : k + 2], float(tension)

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
