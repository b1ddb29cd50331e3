"""Colours, lines and text of every drawing, and the window. pygame is imported when first needed."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.chain.outline import link_outline, surface_points
from rollingjoint.chain.rolling import Link

if TYPE_CHECKING:
    import pygame

S = TypeVar("S", contravariant=True)
Array = NDArray[np.float64]
Color = tuple[int, int, int]

SIZE = (720, 600)
"""Width and height of a picture [pixels]."""
SUPERSAMPLING = 3

BACKGROUND: Color = (250, 250, 248)
GRID: Color = (234, 236, 238)
INK: Color = (45, 55, 72)
FAINT: Color = (130, 140, 155)
LINK: Color = (214, 222, 233)
BASE: Color = (168, 180, 196)
EDGE: Color = (86, 101, 122)
TARGET: Color = (22, 140, 90)
LOAD: Color = (214, 108, 20)
TRAIL: Color = (98, 130, 190)
_TENSION_COLORS: tuple[Color, ...] = ((70, 130, 200), (150, 90, 170), (210, 40, 60))


class Drawing(Protocol[S]):
    """Draws scenes of one kind."""

    def draw(self, scene: S) -> pygame.Surface:
        """The scene at the picture's size."""


class Screen(Generic[S]):
    """Pictures of scenes as a drawing gives them, as arrays and in a window."""

    def __init__(self, canvas: Drawing[S]) -> None:
        self._window: pygame.Surface | None = None
        self._clock: pygame.time.Clock | None = None
        self._canvas = canvas

    def picture(self, scene: S) -> NDArray[np.uint8]:
        """The picture, (height, width, 3)."""
        import pygame

        frame = self._canvas.draw(scene)
        return np.ascontiguousarray(pygame.surfarray.array3d(frame).swapaxes(0, 1))

    def show(self, scene: S, fps: float) -> None:
        """Show the picture in a window, at most `fps` of them per second."""
        import pygame

        if self._window is None or self._clock is None:
            pygame.display.init()
            pygame.display.set_caption("rj_gym")
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


class Canvas:
    """A drawing several times the picture's size, in mm, y up; scaling it down smooths every edge."""

    def __init__(self, length: float) -> None:
        import pygame
        import pygame.font

        pygame.font.init()
        self._pygame = pygame
        self._scale = SUPERSAMPLING * SIZE[0] / (1.9 * length)
        self._length = length
        self._surface = pygame.Surface((SIZE[0] * SUPERSAMPLING, SIZE[1] * SUPERSAMPLING), 0, 32)
        self._origin = np.array([0.5 * SIZE[0], 0.84 * SIZE[1]]) * SUPERSAMPLING
        self.unit = length / 100  # mm of line width per mm on a mechanism of 100 mm

    def begin(self, base: Link | None = None) -> None:
        """An empty picture: the grid, and the fixed link on its ground where it is one in the plane."""
        self._surface.fill(BACKGROUND)
        self._grid()
        if base is not None:
            self._base(base)

    def finished(self) -> pygame.Surface:
        """The drawing, at the picture's size."""
        return self._pygame.transform.smoothscale(self._surface, SIZE)

    def _pixels(self, points: ArrayLike) -> Array:
        return self._origin + np.asarray(points, float) * (self._scale, -self._scale)

    def fill(self, outline: ArrayLike, color: Color) -> None:
        """A polygon."""
        self._pygame.draw.polygon(self._surface, color, self._pixels(outline).tolist())

    def fill_pixels(self, outline: Array, color: Color) -> None:
        """A polygon, its corners from `_pixels`: for drawings of very many."""
        self._pygame.draw.polygon(self._surface, color, outline.tolist())

    def _width(self, width: float) -> float:
        return width * self.unit * self._scale

    def line(self, points: ArrayLike, width: float, color: Color) -> None:
        """A line with round joins and ends."""
        corners, half = np.asarray(points, float), 0.5 * width * self.unit
        for begin, end in itertools.pairwise(corners):
            size = np.hypot(*(end - begin))
            if size > 0:
                side = np.array([begin[1] - end[1], end[0] - begin[0]]) * (half / size)
                self.fill([begin + side, end + side, end - side, begin - side], color)
        for corner in corners:
            self.disc(corner, 0.5 * width, color)

    def dashes(self, begin: Array, end: Array, width: float, color: Color) -> None:
        """A dashed line."""
        size = float(np.hypot(*(end - begin)))
        marks = np.arange(0.0, size, 4 * self.unit)
        for mark in marks:
            stop = min(mark + 2 * self.unit, size)
            self.line([begin + (end - begin) * mark / size, begin + (end - begin) * stop / size], width, color)

    def disc(self, center: Array, radius: float, color: Color) -> None:
        """A filled circle."""
        self._pygame.draw.circle(self._surface, color, self._pixels(center).tolist(), self._width(radius))

    def ring(self, center: Array, radius: float, width: float, color: Color) -> None:
        """A circle."""
        pixels = round(self._width(width))
        self._pygame.draw.circle(self._surface, color, self._pixels(center).tolist(), self._width(radius), pixels)

    def box(self, rectangle: tuple[float, float, float, float], color: Color) -> None:
        """A rectangle with round corners, in pixels of the picture."""
        scaled = [round(SUPERSAMPLING * value) for value in rectangle]
        self._pygame.draw.rect(self._surface, color, scaled, border_radius=5 * SUPERSAMPLING)

    def text(self, text: str, place: tuple[float, float], size: int, color: Color) -> None:
        """Words at a place, both in pixels of the picture."""
        font = self._pygame.font.Font(None, size * SUPERSAMPLING)
        self._surface.blit(font.render(text, True, color), (place[0] * SUPERSAMPLING, place[1] * SUPERSAMPLING))

    def captions(self, *lines: tuple[str, Color]) -> None:
        """Lines of words in the upper left corner."""
        for k, (text, color) in enumerate(lines):
            self.text(text, (24, 22 + 32 * k), 30, color)

    def trail(self, points: Array, background: Color) -> None:
        """Where something was, fading with age into the background."""
        for k in range(1, len(points)):
            self.line(points[k - 1 : k + 1], 0.8, blend(background, TRAIL, 0.1 + 0.9 * k / len(points)))

    def aim(self, tip: Array, target: Array) -> None:
        """A tip, its target, and the error between them."""
        self.dashes(tip, target, 0.6, TARGET)
        x, y = target
        arm = 4.5 * self.unit
        self.ring(target, 3.0, 0.8, TARGET)
        self.line([(x - arm, y), (x + arm, y)], 0.8, TARGET)
        self.line([(x, y - arm), (x, y + arm)], 0.8, TARGET)
        self.disc(tip, 2.2, INK)
        self.disc(tip, 1.2, BACKGROUND)

    def arrow(self, begin: Array, end: Array, color: Color) -> None:
        """An arrow, longer than its head of 6 units."""
        direction = (end - begin) / np.hypot(*(end - begin))
        side = np.array([-direction[1], direction[0]]) * 2.4 * self.unit
        neck = end - direction * 6 * self.unit
        self.line([begin, neck], 1.4, color)
        self.fill([end, neck + side, neck - side], color)
        self.disc(begin, 1.4, color)

    def tension_bar(
        self, j: int, tension: float, limits: tuple[float, float], pitch: int = 32, width: int = 120
    ) -> None:
        """The tension of tendon j as a bar of that width next to its number; bars are `pitch` pixels apart."""
        start, top, height = SIZE[0] - 130 - width, 26 + pitch * j, 14
        filled = width * min(max(tension / limits[1], 0.0), 1.0)
        color = tension_color(tension, limits)
        self.text(f"tendon {j}", (start - 78, top - 3), 24, FAINT)
        self.box((start, top, width, height), GRID)
        self.box((start, top, filled, height), color)
        self.text(f"{tension:.1f} N", (start + width + 12, top - 3), 24, color)

    def _grid(self) -> None:
        step = 0.2 * self._length
        for k in range(-8, 9):
            self.line([(k * step, -9 * step), (k * step, 9 * step)], 0.25, GRID)
            self.line([(-9 * step, k * step), (9 * step, k * step)], 0.25, GRID)

    def _base(self, link: Link) -> None:
        """The fixed link as a block under its child surface, and the ground that it stands on."""
        floor, half = float(link_outline(link)[:, 1].min()), 0.26 * self._length
        surface = surface_points(link.child)
        block = np.concatenate([surface, [(surface[-1, 0], floor), (surface[0, 0], floor)], surface[:1]])
        self.fill(block, BASE)
        self.line(block, 0.7, EDGE)
        for x in np.linspace(-half, half, 14)[:-1]:
            self.line([(x, floor - 4 * self.unit), (x + 4 * self.unit, floor)], 0.4, FAINT)
        self.line([(-half, floor), (half, floor)], 1.0, INK)


def blend(first: Color, second: Color, share: float) -> Color:
    """A colour between two: the first at share 0, the second at 1."""
    r, g, b = (round((1 - share) * a + share * b) for a, b in zip(first, second, strict=True))
    return r, g, b


def tension_color(tension: float, limits: tuple[float, float]) -> Color:
    """Blue at the lowest tension, through purple, to red at the highest."""
    low, high = limits
    position = min(max((tension - low) / (high - low), 0.0), 1.0) * (len(_TENSION_COLORS) - 1)
    k = min(int(position), len(_TENSION_COLORS) - 2)
    return blend(_TENSION_COLORS[k], _TENSION_COLORS[k + 1], position - k)
