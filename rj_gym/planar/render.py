"""The drawing of the tracking task."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rj_gym.rendering.canvas import (
    BACKGROUND,
    EDGE,
    INK,
    LINK,
    LOAD,
    SIZE,
    TARGET,
    Canvas,
    Screen,
    blend,
    tension_color,
)
from rollingjoint.planar.chain import RollingChain
from rollingjoint.planar.outline import link_outline, to_world

if TYPE_CHECKING:
    import pygame

Array = NDArray[np.float64]

__all__ = ["SIZE", "Renderer", "Scene", "tension_color"]


@dataclass(frozen=True)
class Scene:
    """What a picture shows.

    Args:
        mechanism: the chain.
        poses: (n, 3) [mm, rad]. tensions: (m,) [N]. tension_range: what motors hold at least and at most [N].
        targets: target over the episode, (T + 1, 2) [mm].
        force, link: the external force (2,) [N] at the origin of that link.
        trail: tip positions so far, (K, 2) [mm].
        step: steps taken.
    """

    mechanism: RollingChain
    poses: Array
    tensions: Array
    tension_range: tuple[float, float]
    targets: Array
    force: Array
    link: int
    trail: Array
    step: int

    @property
    def target(self) -> Array:
        """Where the tip should be now, (2,) [mm]."""
        return self.targets[self.step]

    @property
    def tip(self) -> Array:
        """Where the tip is, (2,) [mm]."""
        return self.poses[-1, :2]

    @property
    def error(self) -> float:
        """Distance between the two [mm]."""
        return float(np.hypot(*(self.tip - self.target)))


class Renderer(Screen[Scene]):
    """Draws scenes of a mechanism of the given length [mm]; the view is fixed, so pictures of a run line up."""

    def __init__(self, length: float) -> None:
        super().__init__(_TrackingCanvas(length))


class _TrackingCanvas(Canvas):
    """The drawing of the tracking task."""

    def draw(self, scene: Scene) -> pygame.Surface:
        """The scene at the picture's size."""
        self.begin(scene.mechanism.links[0])
        self._path(scene.targets)
        self._links(scene)
        self.trail(scene.trail, LINK)
        self._tendons(scene)
        self.aim(scene.tip, scene.target)
        self._load(scene)
        self._caption(scene)
        return self.finished()

    def _path(self, targets: Array) -> None:
        """Where a moving target comes from and goes to."""
        if np.any(targets != targets[0]):
            self.line(targets, 0.6, blend(BACKGROUND, TARGET, 0.45))

    def _links(self, scene: Scene) -> None:
        for link, pose in zip(scene.mechanism.links[1:], scene.poses[1:], strict=True):
            outline = to_world(pose, link_outline(link))
            self.fill(outline, LINK)
            self.line(outline, 0.7, EDGE)

    def _tendons(self, scene: Scene) -> None:
        for tension, holes in zip(scene.tensions, scene.mechanism.tendon_polyline(scene.poses), strict=True):
            self.line(holes, 1.3, tension_color(tension, scene.tension_range))
            for hole in holes:
                self.disc(hole, 1.1, INK)

    def _load(self, scene: Scene) -> None:
        size = float(np.hypot(*scene.force))
        if size == 0:
            return
        begin = scene.poses[scene.link, :2]
        self.arrow(begin, begin + scene.force / size * (10 + 20 * size) * self.unit, LOAD)

    def _caption(self, scene: Scene) -> None:
        steps = len(scene.targets) - 1
        self.text(f"step {scene.step} / {steps}", (24, 22), 30, INK)
        self.text(f"error {scene.error:.1f} mm", (24, 54), 30, TARGET)
        self.text(f"load {np.hypot(*scene.force):.2f} N on link {scene.link}", (24, 86), 30, LOAD)
        for j, tension in enumerate(scene.tensions):
            self.tension_bar(j, float(tension), scene.tension_range)
