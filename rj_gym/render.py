"""One drawing of the tracking task, for the window and for pictures; pygame is imported when it is first needed."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.outline import link_outline, surface_points, to_world
from rollingjoint.rolling_chain import Link, RollingChain

if TYPE_CHECKING:
    import pygame

Array = NDArray[np.float64]
Color = tuple[int, int, int]

SIZE = (720, 600)
"""Width and height of a picture [pixels]."""
_SUPERSAMPLING = 3

_BACKGROUND: Color = (250, 250, 248)
_GRID: Color = (234, 236, 238)
_INK: Color = (45, 55, 72)
_FAINT: Color = (130, 140, 155)
_LINK: Color = (214, 222, 233)
_BASE: Color = (168, 180, 196)
_EDGE: Color = (86, 101, 122)
_TARGET: Color = (22, 140, 90)
_LOAD: Color = (214, 108, 20)
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


class Renderer:
    """Draws scenes of a mechanism of the given length [mm]; the view is fixed, so pictures of a run line up."""

    def __init__(self, length: float) -> None:
        self._window: pygame.Surface | None = None
        self._clock: pygame.time.Clock | None = None
        self._canvas = _Canvas(length)

    def picture(self, scene: Scene) -> NDArray[np.uint8]:
        """The picture, (height, width, 3)."""
        import pygame

        frame = self._canvas.draw(scene)
        return np.ascontiguousarray(pygame.surfarray.array3d(frame).swapaxes(0, 1))

    def show(self, scene: Scene, fps: float) -> None:
        """Show the picture in a window, at most `fps` of them per second."""
        import pygame

        if self._window is None or self._clock is None:
            pygame.display.init()
            pygame.display.set_caption("rj_gym: rolling joint")
            self._window = pygame.display.set_mode(SIZE)
            self._clock = pygame.time.Clock()
        self._window.blit(self._canvas.draw(scene), (0, 0))
        pygame.event.pump()
        pygame.display.flip()
        self._clock.tick(fps)

    def close(self) -> None:
        """Close the window."""
        if self._window is not None:
            import pygame

            pygame.display.quit()
            self._window = self._clock = None


class _Canvas:
    """A drawing several times the picture's size, in mm, y up; scaling it down smooths every edge."""

    def __init__(self, length: float) -> None:
        import pygame
        import pygame.font

        pygame.font.init()
        self._pygame = pygame
        self._scale = _SUPERSAMPLING * SIZE[0] / (1.9 * length)
        self._length = length
        self._surface = pygame.Surface((SIZE[0] * _SUPERSAMPLING, SIZE[1] * _SUPERSAMPLING), 0, 32)
        self._origin = np.array([0.5 * SIZE[0], 0.84 * SIZE[1]]) * _SUPERSAMPLING
        self._unit = length / 100  # mm of line width per mm on a mechanism of 100 mm

    def draw(self, scene: Scene) -> pygame.Surface:
        """The scene at the picture's size."""
        self._surface.fill(_BACKGROUND)
        self._grid()
        self._base(scene.mechanism.links[0])
        self._path(scene.targets)
        self._links(scene)
        self._trail(scene.trail)
        self._tendons(scene)
        self._error(scene)
        self._load(scene)
        self._caption(scene)
        return self._pygame.transform.smoothscale(self._surface, SIZE)

    def _grid(self) -> None:
        step = 0.2 * self._length
        for k in range(-8, 9):
            self._line([(k * step, -9 * step), (k * step, 9 * step)], 0.25, _GRID)
            self._line([(-9 * step, k * step), (9 * step, k * step)], 0.25, _GRID)

    def _base(self, link: Link) -> None:
        """The fixed link as a block under its child surface, and the ground that it stands on."""
        floor, half = float(link_outline(link)[:, 1].min()), 0.26 * self._length
        surface = surface_points(link.child)
        block = np.concatenate([surface, [(surface[-1, 0], floor), (surface[0, 0], floor)], surface[:1]])
        self._fill(block, _BASE)
        self._line(block, 0.7, _EDGE)
        for x in np.linspace(-half, half, 14)[:-1]:
            self._line([(x, floor - 4 * self._unit), (x + 4 * self._unit, floor)], 0.4, _FAINT)
        self._line([(-half, floor), (half, floor)], 1.0, _INK)

    def _path(self, targets: Array) -> None:
        """Where a moving target comes from and goes to."""
        if np.any(targets != targets[0]):
            self._line(targets, 0.6, _blend(_BACKGROUND, _TARGET, 0.45))

    def _trail(self, trail: Array) -> None:
        """Where the tip was, fading with age."""
        for k in range(1, len(trail)):
            self._line(trail[k - 1 : k + 1], 0.8, _blend(_LINK, _TRAIL, 0.1 + 0.9 * k / len(trail)))

    def _links(self, scene: Scene) -> None:
        for link, pose in zip(scene.mechanism.links[1:], scene.poses[1:], strict=True):
            outline = to_world(pose, link_outline(link))
            self._fill(outline, _LINK)
            self._line(outline, 0.7, _EDGE)

    def _tendons(self, scene: Scene) -> None:
        for tension, holes in zip(scene.tensions, scene.mechanism.tendon_polyline(scene.poses), strict=True):
            self._line(holes, 1.3, tension_color(tension, scene.tension_range))
            for hole in holes:
                self._disc(hole, 1.1, _INK)

    def _error(self, scene: Scene) -> None:
        self._dashes(scene.tip, scene.target, 0.6, _TARGET)
        x, y = scene.target
        arm = 4.5 * self._unit
        self._ring(scene.target, 3.0, 0.8, _TARGET)
        self._line([(x - arm, y), (x + arm, y)], 0.8, _TARGET)
        self._line([(x, y - arm), (x, y + arm)], 0.8, _TARGET)
        self._disc(scene.tip, 2.2, _INK)
        self._disc(scene.tip, 1.2, _BACKGROUND)

    def _load(self, scene: Scene) -> None:
        size = float(np.hypot(*scene.force))
        if size == 0:
            return
        begin = scene.poses[scene.link, :2]
        direction = scene.force / size
        end = begin + direction * (10 + 20 * size) * self._unit
        side = np.array([-direction[1], direction[0]]) * 2.4 * self._unit
        neck = end - direction * 6 * self._unit
        self._line([begin, neck], 1.4, _LOAD)
        self._fill([end, neck + side, neck - side], _LOAD)
        self._disc(begin, 1.4, _LOAD)

    def _caption(self, scene: Scene) -> None:
        steps = len(scene.targets) - 1
        self._text(f"step {scene.step} / {steps}", (24, 22), 30, _INK)
        self._text(f"error {scene.error:.1f} mm", (24, 54), 30, _TARGET)
        self._text(f"load {np.hypot(*scene.force):.2f} N on link {scene.link}", (24, 86), 30, _LOAD)
        for j, tension in enumerate(scene.tensions):
            self._tension_bar(j, float(tension), scene.tension_range)

    def _tension_bar(self, j: int, tension: float, limits: tuple[float, float]) -> None:
        left, top, width, height = SIZE[0] - 250, 26 + 32 * j, 120, 14
        filled = width * min(max(tension / limits[1], 0.0), 1.0)
        color = tension_color(tension, limits)
        self._text(f"tendon {j}", (left - 78, top - 3), 24, _FAINT)
        self._box((left, top, width, height), _GRID)
        self._box((left, top, filled, height), color)
        self._text(f"{tension:.1f} N", (left + width + 12, top - 3), 24, color)

    def _pixels(self, points: ArrayLike) -> Array:
        return self._origin + np.asarray(points, float) * (self._scale, -self._scale)

    def _fill(self, outline: ArrayLike, color: Color) -> None:
        self._pygame.draw.polygon(self._surface, color, self._pixels(outline).tolist())

    def _width(self, width: float) -> float:
        return width * self._unit * self._scale

    def _line(self, points: ArrayLike, width: float, color: Color) -> None:
        """A line with round joins and ends."""
        corners, half = np.asarray(points, float), 0.5 * width * self._unit
        for begin, end in itertools.pairwise(corners):
            size = np.hypot(*(end - begin))
            if size > 0:
                side = np.array([begin[1] - end[1], end[0] - begin[0]]) * (half / size)
                self._fill([begin + side, end + side, end - side, begin - side], color)
        for corner in corners:
            self._disc(corner, 0.5 * width, color)

    def _dashes(self, begin: Array, end: Array, width: float, color: Color) -> None:
        size = float(np.hypot(*(end - begin)))
        marks = np.arange(0.0, size, 4 * self._unit)
        for mark in marks:
            stop = min(mark + 2 * self._unit, size)
            self._line([begin + (end - begin) * mark / size, begin + (end - begin) * stop / size], width, color)

    def _disc(self, center: Array, radius: float, color: Color) -> None:
        self._pygame.draw.circle(self._surface, color, self._pixels(center).tolist(), self._width(radius))

    def _ring(self, center: Array, radius: float, width: float, color: Color) -> None:
        pixels = round(self._width(width))
        self._pygame.draw.circle(self._surface, color, self._pixels(center).tolist(), self._width(radius), pixels)

    def _box(self, rectangle: tuple[float, float, float, float], color: Color) -> None:
        scaled = [round(_SUPERSAMPLING * value) for value in rectangle]
        self._pygame.draw.rect(self._surface, color, scaled, border_radius=5 * _SUPERSAMPLING)

    def _text(self, text: str, place: tuple[float, float], size: int, color: Color) -> None:
        font = self._pygame.font.Font(None, size * _SUPERSAMPLING)
        self._surface.blit(font.render(text, True, color), (place[0] * _SUPERSAMPLING, place[1] * _SUPERSAMPLING))


def tension_color(tension: float, limits: tuple[float, float]) -> Color:
    """Blue at the lowest tension, through purple, to red at the highest."""
    low, high = limits
    position = min(max((tension - low) / (high - low), 0.0), 1.0) * (len(_TENSION_COLORS) - 1)
    k = min(int(position), len(_TENSION_COLORS) - 2)
    return _blend(_TENSION_COLORS[k], _TENSION_COLORS[k + 1], position - k)


def _blend(first: Color, second: Color, share: float) -> Color:
    r, g, b = (round((1 - share) * a + share * b) for a, b in zip(first, second, strict=True))
    return r, g, b
