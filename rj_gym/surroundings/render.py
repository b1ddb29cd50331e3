"""The drawing of the tasks among walls: the instrument in its sleeve, what surrounds it, and where it presses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rj_gym.rendering import (
    BACKGROUND,
    EDGE,
    INK,
    LINK,
    LOAD,
    SIZE,
    SUPERSAMPLING,
    TARGET,
    Canvas,
    Color,
    blend,
    tension_color,
)
from rollingjoint.chain.outline import link_outline, to_world
from rollingjoint.chain.rolling import RollingChain
from rollingjoint.surroundings import Lumen

if TYPE_CHECKING:
    import pygame

Array = NDArray[np.float64]

TISSUE: Color = (226, 178, 172)
TISSUE_EDGE: Color = (176, 104, 98)
_SKIN: Color = (200, 210, 224)
_ARROW = 20.0  # mm per N
_STEM = 6.0  # mm


@dataclass(frozen=True, kw_only=True)
class WallsScene:
    """The contents of a picture, in the frame of the base at the start.

    Args:
        mechanism: the instrument. poses: of its links, (n, 3) [mm, rad].
        tensions: (m,) [N]. tension_range: minimum and maximum tendon tension [N].
        target: of the tip, (2,). tip: where it is, (2,). trail: where it has been, (K, 2) [mm].
        step, steps: taken, and of the whole episode.
        sleeve: radius of the skin [mm].
        planes, discs, pieces: tables of walls (rollingjoint's Walls).
        forces: of the walls on every link, (n, 2) [N]. wall_force: of the contact that presses most [N].
        peak: the largest that it has been [N].
    """

    mechanism: RollingChain
    poses: Array
    tensions: Array
    tension_range: tuple[float, float]
    target: Array
    tip: Array
    trail: Array
    step: int
    steps: int
    sleeve: float
    planes: Array
    discs: Array
    pieces: Array
    forces: Array
    wall_force: float
    peak: float


class WallsCanvas(Canvas):
    """The drawing of a task among walls; the view is fixed, so pictures of a run line up.

    Args:
        length: of the mechanism [mm]. feed: how far its base can move on [mm].
    """

    def __init__(self, length: float, feed: float) -> None:
        super().__init__(length)
        bottom = 0.4 * feed if feed else -15.0  # mm
        tall = length + feed + 12.0 - bottom
        self._scale = min(self._scale, SUPERSAMPLING * SIZE[1] / tall)
        self._origin = np.array([0.5 * SIZE[0] * SUPERSAMPLING, SIZE[1] * SUPERSAMPLING + self._scale * bottom])

    def draw(self, scene: WallsScene) -> pygame.Surface:
        """The scene at the picture's size."""
        self._surface.fill(BACKGROUND)
        self._walls(scene)
        if not scene.pieces.any():
            self._base(scene.mechanism.links[0])
        self._body(scene)
        self.trail(scene.trail, LINK)
        self.aim(scene.tip, scene.target)
        for pose, force in zip(scene.poses, scene.forces, strict=True):
            size = float(np.hypot(*force))
            if size > 0.02:
                self.arrow(pose[:2] - force / size * (_STEM + _ARROW * min(size, 3.0)) * self.unit, pose[:2], LOAD)
        error = float(np.hypot(*(scene.tip - scene.target)))
        forces = (f"wall {scene.wall_force:.2f} N", LOAD), (f"largest {scene.peak:.2f} N", LOAD)
        self.captions((f"step {scene.step} / {scene.steps}", INK), (f"error {error:.1f} mm", TARGET), *forces)
        for j, tension in enumerate(scene.tensions):
            self.tension_bar(j, float(tension), scene.tension_range)
        return self.finished()

    def _walls(self, scene: WallsScene) -> None:
        pieces = scene.pieces[scene.pieces[:, 4] > 0.0]
        if len(pieces):
            radii = [*pieces[:, 6], pieces[-1, 7]]
            lumen = Lumen(pieces[:, 4].tolist(), pieces[:, 3].tolist(), radii, tuple(pieces[0, :3].tolist()))
            self._surface.fill(TISSUE)
            left, right = lumen.sides(np.arange(-40.0, lumen.length + 60.0))
            for k in range(len(left) - 1):
                self.fill([left[k], left[k + 1], right[k + 1], right[k]], BACKGROUND)
            for side in (left, right):
                self.line(side, 0.8, TISSUE_EDGE)
        for plane in scene.planes[scene.planes[:, 3] > 0.0]:
            normal, along = plane[:2], np.array([-plane[1], plane[0]])
            corner = normal * plane[2]
            ends = [corner - 400.0 * along, corner + 400.0 * along]
            self.fill([*ends, ends[1] - 400.0 * normal, ends[0] - 400.0 * normal], TISSUE)
            self.line(ends, 0.8, TISSUE_EDGE)
        for disc in scene.discs[scene.discs[:, 3] > 0.0]:
            self.disc(disc[:2], disc[2] / self.unit, TISSUE_EDGE)
            self.disc(disc[:2], disc[2] / self.unit - 0.8, TISSUE)

    def _body(self, scene: WallsScene) -> None:
        """The sleeve, which touches the walls, and links in it, drawn no wider than it is."""
        links = scene.mechanism.links
        axis = [to_world(pose, np.array([link.child.start]))[0] for pose, link in zip(scene.poses, links, strict=True)]
        self.line(axis, 2.0 * scene.sleeve / self.unit, _SKIN)
        for link, pose in zip(links, scene.poses, strict=True):
            outline = link_outline(link)
            outline[:, 0] = outline[:, 0].clip(-scene.sleeve, scene.sleeve)
            outline = to_world(pose, outline)
            self.fill(outline, blend(BACKGROUND, LINK, 0.8))
            self.line(outline, 0.4, EDGE)
        for j, holes in enumerate(scene.mechanism.tendon_polyline(scene.poses)):
            self.line(holes, 0.8, tension_color(float(scene.tensions[j]), scene.tension_range))
