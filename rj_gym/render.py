"""The drawing of the tracking task."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rj_gym.canvas import (
    BACKGROUND,
    EDGE,
    FAINT,
    GRID,
    INK,
    LINK,
    LOAD,
    SIZE,
    TARGET,
    Canvas,
    Color,
    Screen,
    blend,
)
from rollingjoint.outline import link_outline, to_world
from rollingjoint.rolling_chain import RollingChain

if TYPE_CHECKING:
    import pygame

Array = NDArray[np.float64]

_TRAIL: Color = (98, 130, 190)
_TENSION_COLORS: tuple[Color, ...] = ((70, 130, 200), (150, 90, 170), (210, 40, 60))


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
        self._trail(scene.trail)
        self._tendons(scene)
        self._error(scene)
        self._load(scene)
        self._caption(scene)
        return self.finished()

    def _path(self, targets: Array) -> None:
        """Where a moving target comes from and goes to."""
        if np.any(targets != targets[0]):
            self.line(targets, 0.6, blend(BACKGROUND, TARGET, 0.45))

    def _trail(self, trail: Array) -> None:
        """Where the tip was, fading with age."""
        for k in range(1, len(trail)):
            self.line(trail[k - 1 : k + 1], 0.8, blend(LINK, _TRAIL, 0.1 + 0.9 * k / len(trail)))

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

    def _error(self, scene: Scene) -> None:
        self.dashes(scene.tip, scene.target, 0.6, TARGET)
        x, y = scene.target
        arm = 4.5 * self.unit
        self.ring(scene.target, 3.0, 0.8, TARGET)
        self.line([(x - arm, y), (x + arm, y)], 0.8, TARGET)
        self.line([(x, y - arm), (x, y + arm)], 0.8, TARGET)
        self.disc(scene.tip, 2.2, INK)
        self.disc(scene.tip, 1.2, BACKGROUND)

    def _load(self, scene: Scene) -> None:
        size = float(np.hypot(*scene.force))
        if size == 0:
            return
        begin = scene.poses[scene.link, :2]
        direction = scene.force / size
        end = begin + direction * (10 + 20 * size) * self.unit
        side = np.array([-direction[1], direction[0]]) * 2.4 * self.unit
        neck = end - direction * 6 * self.unit
        self.line([begin, neck], 1.4, LOAD)
        self.fill([end, neck + side, neck - side], LOAD)
        self.disc(begin, 1.4, LOAD)

    def _caption(self, scene: Scene) -> None:
        steps = len(scene.targets) - 1
        self.text(f"step {scene.step} / {steps}", (24, 22), 30, INK)
        self.text(f"error {scene.error:.1f} mm", (24, 54), 30, TARGET)
        self.text(f"load {np.hypot(*scene.force):.2f} N on link {scene.link}", (24, 86), 30, LOAD)
        for j, tension in enumerate(scene.tensions):
            self._tension_bar(j, float(tension), scene.tension_range)

    def _tension_bar(self, j: int, tension: float, limits: tuple[float, float]) -> None:
        left, top, width, height = SIZE[0] - 250, 26 + 32 * j, 120, 14
        filled = width * min(max(tension / limits[1], 0.0), 1.0)
        color = tension_color(tension, limits)
        self.text(f"tendon {j}", (left - 78, top - 3), 24, FAINT)
        self.box((left, top, width, height), GRID)
        self.box((left, top, filled, height), color)
        self.text(f"{tension:.1f} N", (left + width + 12, top - 3), 24, color)


def tension_color(tension: float, limits: tuple[float, float]) -> Color:
    """Blue at the lowest tension, through purple, to red at the highest."""
    low, high = limits
    position = min(max((tension - low) / (high - low), 0.0), 1.0) * (len(_TENSION_COLORS) - 1)
    k = min(int(position), len(_TENSION_COLORS) - 2)
    return blend(_TENSION_COLORS[k], _TENSION_COLORS[k + 1], position - k)
