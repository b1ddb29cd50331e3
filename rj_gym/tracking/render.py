"""The drawings of the tracking tasks: chains in the plane, and arms in an orthographic view above a floor."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rj_gym.rendering import (
    BACKGROUND,
    BASE,
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
from rollingjoint.chain.hinge import HingeChain
from rollingjoint.chain.outline import link_outline, to_world
from rollingjoint.chain.spatial import SpatialChain

if TYPE_CHECKING:
    import pygame

Array = NDArray[np.float64]
_Piece = tuple[float, list[tuple[Array, Color]]]  # depth, polygons in pixels

_AZIMUTH, _ELEVATION = -0.55, 0.3  # of the camera [rad]
_SIDES = 20  # of a link
_FLOOR = 1.12  # height of the floor below the base, in lengths
_GRAVITY: Color = (120, 90, 160)
_FLOOR_GRID: Color = (226, 229, 233)
_SHADOW: Color = (222, 225, 230)
_DARK: Color = (128, 141, 160)  # links in the shade, and in full light
_BRIGHT: Color = (238, 242, 248)
_TO_LIGHT = np.array([-0.45, 0.62, 0.64])  # right, up, towards the viewer


@dataclass(frozen=True, kw_only=True)
class TrackingScene:
    """The contents of a picture of a tracking task; d is the number of coordinates of a position.

    Args:
        mechanism: the mechanism. poses: of its links [mm, rad].
        tensions: (m,) at the motors [N]. tension_range: minimum and maximum tendon tension [N].
        targets: of the tip over the episode, (T + 1, d) [mm].
        tip: where it is, (d,) [mm]. trail: where it has been, (K, d) [mm].
        step: steps taken.
        gap_tensions: (n - 1, m) [N], None where there is no friction: there the tensions are the same in every gap.
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

    def path(self, targets: Array, projection: Callable[[Array], Array] = np.asarray) -> None:
        """Where a moving target comes from and goes to; `projection` gives positions in the plane of the picture."""
        if np.any(targets != targets[0]):
            self.line(projection(targets), 0.6, blend(BACKGROUND, TARGET, 0.45))

    def facts(self, scene: TrackingScene, *loads: tuple[str, Color], pitch: int = 32, width: int = 120) -> None:
        """Step, error and loads in words, and a bar for every tension."""
        error = float(np.linalg.norm(scene.tip - scene.target))
        step = f"step {scene.step} / {len(scene.targets) - 1}"
        self.captions((step, INK), (f"error {error:.1f} mm", TARGET), *loads)
        for j, tension in enumerate(scene.tensions):
            self.tension_bar(j, float(tension), scene.tension_range, pitch, width)


@dataclass(frozen=True, kw_only=True)
class PlanarScene(TrackingScene):
    """The contents of a picture: see TrackingScene, with poses (n, 3), and the external force (2,) [N] on a link."""

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


@dataclass(frozen=True, kw_only=True)
class ArmScene(TrackingScene):
    """The contents of a picture: see TrackingScene, with poses (n, 4, 4), and the fields below.

    Args:
        target_frame: where the tip's frame should be now, (3, 3), or None.
        gravity: its direction, (3,). payload: force on the tip, (3,) [N].
    """

    target_frame: Array | None
    gravity: Array
    payload: Array


class ArmCanvas(TrackingCanvas):
    """The drawing of the arm's task; the view is fixed, so pictures of a run line up.

    Points in space are seen from above the horizon, with z downwards.
    """

    def __init__(self, arm: HingeChain | SpatialChain) -> None:
        super().__init__(arm.length)
        self._scale = SUPERSAMPLING * SIZE[1] / (1.5 * arm.length)
        self._origin = np.array([0.45 * SIZE[0], 0.1 * SIZE[1]]) * SUPERSAMPLING
        self.unit = 0.0045 * arm.length
        right = np.array([np.cos(_AZIMUTH), np.sin(_AZIMUTH), 0.0])
        near, up = np.array([-right[1], right[0], 0.0]), np.array([0.0, 0.0, -1.0])
        c, s = np.cos(_ELEVATION), np.sin(_ELEVATION)
        self._view = np.array([right, c * up - s * near, s * up + c * near])  # right, up, towards the viewer

    def draw(self, scene: ArmScene) -> pygame.Surface:
        """The scene at the picture's size."""
        self._surface.fill(BACKGROUND)
        self._floor(scene)
        self.path(scene.targets, self._seen)
        self._arm(scene)
        self._plate(scene.mechanism)
        if len(scene.trail) > 1:
            self.trail(self._seen(scene.trail), BACKGROUND)
        self._frames(scene)
        self._forces(scene)
        self.aim(self._seen(scene.tip), self._seen(scene.target))
        self._facts(scene)
        return self.finished()

    def _seen(self, points: ArrayLike) -> Array:
        """Points in space (..., 3) in the plane of the picture, (..., 2) [mm]."""
        return np.asarray(points, float) @ self._view[:2].T

    def _floor(self, scene: ArmScene) -> None:
        """A floor with a grid, the shadow of the arm from straight above it, and the target's."""
        z, half = _FLOOR * self._length, 0.54 * self._length
        lines = np.linspace(-half, half, 7)
        for k in lines.tolist():
            self.line(self._seen([(k, -half, z), (k, half, z)]), 0.4, _FLOOR_GRID)
            self.line(self._seen([(-half, k, z), (half, k, z)]), 0.4, _FLOOR_GRID)

        def below(points: Array) -> Array:
            return self._seen(np.append(points[..., :2], np.full((*points.shape[:-1], 1), z), axis=-1))

        self.line(below(scene.poses[:, :3, 3]), 1.6 * scene.mechanism.hole_radius / self.unit, _SHADOW)
        faint = blend(BACKGROUND, TARGET, 0.45)
        self.dashes(below(scene.target), self._seen(scene.target), 0.35, faint)
        around = np.linspace(0, 2 * np.pi, 25)[:, None] * [1.0, 1.0, 0.0]
        ring = np.stack([np.cos(around[:, 0]), np.sin(around[:, 1]), around[:, 2]], axis=-1) * 4 * self.unit
        self.line(below(scene.target + ring), 0.7, faint)
        self.disc(below(scene.tip), 1.6, blend(BACKGROUND, INK, 0.5))

    def _plate(self, arm: HingeChain | SpatialChain) -> None:
        """The plate from which the arm hangs; seen from above, it hides where the arm begins."""
        half, low_side = max(1.2 * arm.hole_radius, min(2.6 * arm.hole_radius, 0.1 * self._length)), arm.base_height
        corners = np.array([(-half, -half), (half, -half), (half, half), (-half, half)])
        heights = low_side, low_side - 0.02 * self._length
        low, high = (np.append(corners, np.full((4, 1), z), axis=1) for z in heights)
        for k in range(4):
            side = self._seen([low[k - 1], low[k], high[k], high[k - 1]])
            outward = np.append(corners[k - 1] + corners[k], 0.0) @ self._view[2]
            if outward > 0:
                self.fill(side, blend(BASE, EDGE, 0.35))
                self.line([*side, side[0]], 0.4, EDGE)
        top = self._seen(high)
        self.fill(top, BASE)
        self.line([*top, top[0]], 0.4, EDGE)

    def _arm(self, scene: ArmScene) -> None:
        """Backbone, links and tendons, the farthest first."""
        pieces = list(self._bodies(scene))
        for j, line in enumerate(scene.mechanism.tendon_polyline(scene.poses)):
            for part, tension in scene.tendon_parts(j, line, from_hole=False):
                pieces += self._strips(part, 0.8, tension_color(tension, scene.tension_range))
        for _, polygons in sorted(pieces, key=lambda piece: piece[0]):
            for outline, color in polygons:
                self.fill_pixels(outline, color)

    def _bodies(self, scene: ArmScene) -> Iterator[_Piece]:
        """Tubes in the light, from hole to hole, and the visible backbone between them."""
        radius, ends = scene.mechanism.hole_radius, scene.mechanism.body_ends
        R, origins = scene.poses[1:, :3, :3], scene.poses[1:, :3, 3]
        turns = np.linspace(0.0, 2 * np.pi, _SIDES + 1)
        out = np.stack([np.cos(turns), np.sin(turns), 0 * turns], axis=-1) @ np.swapaxes(R, 1, 2)
        centres = [origins + end[:, None] * R[..., 2] for end in ends.T]
        upper, lower = (self._pixels(self._seen(radius * out + centre[:, None])) for centre in centres)
        normals, axes = 0.5 * (out[:, 1:] + out[:, :-1]) @ self._view.T, R[..., 2] @ self._view.T
        depths = 0.5 * (centres[0] + centres[1]) @ self._view[2]
        for k, depth in enumerate(depths.tolist()):
            faces = np.flatnonzero(normals[k, :, 2] > 0)
            sides = np.stack([upper[k, faces], upper[k, faces + 1], lower[k, faces + 1], lower[k, faces]], axis=1)
            colors = [_lit(cosine) for cosine in (normals[k, faces] @ _TO_LIGHT).tolist()]
            cap = lower[k] if axes[k, 2] > 0 else upper[k]
            yield depth, [*zip(sides, colors, strict=True), (cap, _lit(abs(float(axes[k] @ _TO_LIGHT))))]
            above = centres[1][k - 1] if k else scene.poses[0, :3, 3]
            yield from self._strips(np.array([above, centres[0][k]]), 2.0, EDGE)

    def _strips(self, line: Array, width: float, color: Color) -> Iterator[_Piece]:
        """The straight pieces of a line in space, (K, 3)."""
        half, corners = 0.5 * self._width(width), self._pixels(self._seen(line))
        along = np.diff(corners, axis=0)
        along *= half / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
        begin, end, side = corners[:-1] - along, corners[1:] + along, along[:, ::-1] * (-1.0, 1.0)
        outlines = np.stack([begin + side, end + side, end - side, begin - side], axis=1)
        for depth, outline in zip((0.5 * (line[1:] + line[:-1]) @ self._view[2]).tolist(), outlines, strict=True):
            yield depth, [(outline, color)]

    def _frames(self, scene: ArmScene) -> None:
        """The axes of the target frame and of the tip."""
        if scene.target_frame is None:
            return
        size = 0.09 * self._length
        for place, frame, color in (
            (scene.target, scene.target_frame, blend(BACKGROUND, TARGET, 0.75)),
            (scene.tip, scene.poses[-1, :3, :3], INK),
        ):
            for axis, width in zip(frame.T, (1.0, 0.6, 0.6), strict=True):
                self.line(self._seen([place, place + size * axis]), width, color)

    def _forces(self, scene: ArmScene) -> None:
        """Gravity below the words in the corner, whichever way it points, and the payload at the tip."""
        middle = np.array([0.0, 0.0, 0.33 * self._length]) - 0.42 * self._length * self._view[0]  # below the words
        half = 0.08 * self._length * scene.gravity
        self.arrow(self._seen(middle - half), self._seen(middle + half), _GRAVITY)
        if size := float(np.linalg.norm(scene.payload)):
            end = scene.tip + scene.payload / size * (0.07 + 0.2 * size) * self._length
            self.arrow(self._seen(scene.tip), self._seen(end), LOAD)

    def _facts(self, scene: ArmScene) -> None:
        tilt = np.degrees(np.arccos(np.clip(scene.gravity[2], -1.0, 1.0)))
        payload = f"payload {np.linalg.norm(scene.payload):.2f} N", LOAD
        self.facts(scene, payload, (f"gravity {tilt:.0f}° off", _GRAVITY), pitch=24, width=70)


def _lit(cosine: float) -> Color:
    """The colour of a surface, from the cosine between its normal and the light."""
    return blend(_DARK, _BRIGHT, max(cosine, 0.0))
