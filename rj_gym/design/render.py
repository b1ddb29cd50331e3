"""The drawing of the design task: the shape of the present design in every case, over the shape it should have."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rj_gym.rendering import BACKGROUND, EDGE, FAINT, INK, LOAD, TARGET, Canvas, Color, blend
from rollingjoint.chain.outline import link_outline, to_world
from rollingjoint.chain.rolling import RollingChain

if TYPE_CHECKING:
    import pygame

Array = NDArray[np.float64]

_CASE_COLORS: tuple[Color, ...] = ((120, 132, 150), (70, 130, 200), (210, 70, 80), (150, 90, 170), (200, 150, 40))


@dataclass(frozen=True)
class DesignScene:
    """Contents of a picture.

    Args:
        mechanism: the present design; where it is not valid the reference, of which only the base is drawn.
        poses: of its links in every case, (K, n, 3) [mm, rad]. ok: whether they are equilibria, (K,).
        targets: origins of the moving links, (K, n - 1, 2) [mm].
        tensions, forces: (K, 2) [N].
        case_errors: (K,) [mm]. error: in all cases [mm].
        valid: whether the present design is.
        step, steps: taken, and of the whole episode.
    """

    mechanism: RollingChain
    poses: Array
    ok: NDArray[np.bool_]
    targets: Array
    tensions: Array
    forces: Array
    case_errors: Array
    error: float
    valid: bool
    step: int
    steps: int


class DesignCanvas(Canvas):
    """The drawing of the design task; the view is fixed, so pictures of a run line up."""

    def draw(self, scene: DesignScene) -> pygame.Surface:
        """The scene at the picture's size."""
        self.begin(scene.mechanism.links[0])
        for places in scene.targets:
            self._target(places)
        for case in np.flatnonzero(scene.ok):
            self._links(scene.mechanism, scene.poses[case], _color(case))
        for places, force in zip(scene.targets, scene.forces, strict=True):
            self._places(places)
            self._force(places[-1], force)
        self._caption(scene)
        return self.finished()

    def _target(self, places: Array) -> None:
        """The line through the wanted origins, from the base on."""
        self.line(np.concatenate([np.zeros((1, 2)), places]), 1.0, blend(BACKGROUND, TARGET, 0.5))

    def _places(self, places: Array) -> None:
        for place in places:
            self.ring(place, 2.0, 0.7, TARGET)

    def _links(self, mechanism: RollingChain, poses: Array, color: Color) -> None:
        for link, pose in zip(mechanism.links[1:], poses[1:], strict=True):
            outline = to_world(pose, link_outline(link))
            self.fill(outline, blend(BACKGROUND, color, 0.3))
            self.line(outline, 0.6, blend(EDGE, color, 0.6))
        self.line(poses[:, :2], 0.8, color)
        for pose in poses[1:]:
            self.disc(pose[:2], 1.3, color)

    def _force(self, begin: Array, force: Array) -> None:
        """An arrow of 40 mm per N on a mechanism of 100 mm."""
        size = float(np.hypot(*force))
        if size > 0:
            end = begin + force * min(40.0, 40.0 / size) * self.unit
            self.line([begin, end], 1.0, LOAD)
            self.disc(end, 1.4, LOAD)

    def _caption(self, scene: DesignScene) -> None:
        text = f"error {scene.error:.2f} mm" if scene.valid else "design not valid"
        self.captions((f"step {scene.step} / {scene.steps}", INK), (text, TARGET))
        for case, (first, second) in enumerate(scene.tensions):
            self.text(f"{first:.1f} N, {second:.1f} N", (500, 24 + 26 * case), 24, FAINT)
            self.text(f"{scene.case_errors[case]:.2f} mm", (620, 24 + 26 * case), 24, _color(case))


def _color(case: int | np.integer) -> Color:
    return _CASE_COLORS[case % len(_CASE_COLORS)]
