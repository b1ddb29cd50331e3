"""The drawing of the planar tracking task."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rj_gym.rendering.canvas import EDGE, INK, LINK, LOAD, tension_color
from rj_gym.rendering.tracking import TrackingCanvas, TrackingScene
from rollingjoint.chain.outline import link_outline, to_world

if TYPE_CHECKING:
    import pygame

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class PlanarScene(TrackingScene):
    """What a picture shows: see TrackingScene, with poses (n, 3), and the external force (2,) [N] on a link."""

    force: Array
    link: int


class PlanarCanvas(TrackingCanvas):
    """The drawing of the planar task; the view is fixed, so pictures of a run line up."""

    def draw(self, scene: PlanarScene) -> pygame.Surface:
        """The scene at the picture's size."""
        self.begin(scene.mechanism.links[0])
        self.path(scene.targets)
        self._links(scene)
        self.trail(scene.trail, LINK)
        self._tendons(scene)
        self.aim(scene.tip, scene.target)
        self._load(scene)
        self.facts(scene, (f"load {np.hypot(*scene.force):.2f} N on link {scene.link}", LOAD))
        return self.finished()

    def _links(self, scene: PlanarScene) -> None:
        for link, pose in zip(scene.mechanism.links[1:], scene.poses[1:], strict=True):
            outline = to_world(pose, link_outline(link))
            self.fill(outline, LINK)
            self.line(outline, 0.7, EDGE)

    def _tendons(self, scene: PlanarScene) -> None:
        for j, holes in enumerate(scene.mechanism.tendon_polyline(scene.poses)):
            for part, tension in scene.tendon_parts(j, holes, from_hole=True):
                self.line(part, 1.3, tension_color(tension, scene.tension_range))
            for hole in holes:
                self.disc(hole, 1.1, INK)

    def _load(self, scene: PlanarScene) -> None:
        size = float(np.hypot(*scene.force))
        if size == 0:
            return
        begin = scene.poses[scene.link, :2]
        self.arrow(begin, begin + scene.force / size * (10 + 20 * size) * self.unit, LOAD)
