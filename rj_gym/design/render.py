"""The drawing of the design task: the shape of the present design in every case, over the shape it should have."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rj_gym.rendering import BACKGROUND, EDGE, FAINT, INK, LOAD, TARGET, Canvas, Color, blend
from rollingjoint.chain.chain import AnyChain
from rollingjoint.chain.outline import link_outline, to_world
from rollingjoint.chain.rolling import RollingChain

if TYPE_CHECKING:
    import pygame

Array = NDArray[np.float64]

CASE_COLORS: tuple[Color, ...] = ((120, 132, 150), (70, 130, 200), (210, 70, 80), (150, 90, 170), (200, 150, 40))

_VIEW = np.array([[0.83, -0.14], [-0.56, -0.21], [0.0, 0.97]])  # of x, y and z: to the right, and up


@dataclass(frozen=True)
class DesignScene:
    """Contents of a picture.

    Args:
        mechanism: the present design; where it is not valid the reference, of which only the base is drawn.
        poses: of its links in every case, (K, n, 3), in space (K, n, 4, 4) [mm, rad].
        ok: whether they are equilibria, (K,).
        targets: origins of the moving links, (K, n - 1, 2), in space 3 [mm].
        tensions: (K, m) [N]. forces: (K, 2), in space (K, 3) [N].
        case_errors: (K,) [mm]. error: in all cases [mm].
        valid: whether the present design is.
        step, steps: taken, and of the whole episode.
    """

    mechanism: AnyChain
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
        """The scene at the picture's size; chains in space from the side, with z upwards."""
        plane = scene.mechanism if isinstance(scene.mechanism, RollingChain) else None
        self.begin(plane.links[0] if plane else None)
        targets, forces = self.seen(scene.targets), self.seen(scene.forces)
        for places in targets:
            self._target(places)
        for case in np.flatnonzero(scene.ok):
            if plane is not None:
                self._links(plane, scene.poses[case], _color(case))
            self._axis(self._origins(scene.poses[case]), _color(case))
        for places, force in zip(targets, forces, strict=True):
            self._places(places)
            self._force(places[-1], force)
        self._caption(scene)
        return self.finished()

    def seen(self, points: Array) -> Array:
        """Points or vectors (..., 2 or 3) in the plane of the picture, (..., 2)."""
        return points if points.shape[-1] == 2 else points @ _VIEW

    def _origins(self, poses: Array) -> Array:
        """Origins of links in poses (n, 3), in space (n, 4, 4), in the plane of the picture, (n, 2)."""
        return self.seen(poses[:, :2] if poses.ndim == 2 else poses[:, :3, 3])

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

    def _axis(self, origins: Array, color: Color) -> None:
        """The line through the origins of the links."""
        self.line(origins, 0.8, color)
        for origin in origins[1:]:
            self.disc(origin, 1.3, color)

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
        begin = 620 - 60 * scene.tensions.shape[1]
        for case, tensions in enumerate(scene.tensions):
            self.text(", ".join(f"{tension:.1f} N" for tension in tensions), (begin, 24 + 26 * case), 24, FAINT)
            self.text(f"{scene.case_errors[case]:.2f} mm", (620, 24 + 26 * case), 24, _color(case))


def _color(case: int | np.integer) -> Color:
    return CASE_COLORS[case % len(CASE_COLORS)]
