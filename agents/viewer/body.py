"""A mechanism in the scene of a browser: its links and its tendons."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import viser.transforms
from numpy.typing import ArrayLike

from agents.viewer.solids import Strand, frames, front, solids
from rj_gym.rendering import BASE, INK, LINK, Color, tension_color
from rollingjoint import RollingChain

MOST_NUMBERS = 16  # links that all have their numbers


class SceneMechanism:
    """The links and tendons of one mechanism, which take poses; made once, moved often.

    Args:
        scene: of a client. name: of its node, such as "/you". mechanism: of either class.
        colour: of its links. opacity: below 1 for one that lies under others. behind: how far [mm].
    """

    def __init__(
        self, scene: Any, name: str, mechanism: Any, colour: Color = LINK, opacity: float = 1.0, behind: float = 0.0
    ) -> None:
        self.scene, self.name, self.mechanism = scene, name, mechanism
        self.root = scene.add_frame(name, show_axes=False, position=(0.0, 0.0, -behind))
        self.solids = solids(mechanism)
        self.handles = [self._added(k, colour, opacity) for k in range(len(self.solids))]
        self.thickness = 1.5 if opacity < 1.0 else 4.0
        self.tendons: Any = None
        self.numbers: list[Any] = []

    def show(self, poses: ArrayLike, strands: Sequence[Strand], tension_range: tuple[float, float]) -> None:
        """Move the links to these poses and draw the tendons, blue at the minimum tension, red at the maximum."""
        placed = frames(poses)
        for solid, handle in zip(self.solids, self.handles, strict=True):
            link_frames = placed[list(solid.links)]
            handle.batched_positions = link_frames[:, :3, 3].astype(np.float32)
            handle.batched_wxyzs = viser.transforms.SO3.from_matrix(link_frames[:, :3, :3]).wxyz.astype(np.float32)
        self._draw(strands, tension_range)

    def number(self, poses: ArrayLike | None) -> None:
        """Write the numbers of links at their origins in these poses, of many links every fifth; None: nowhere."""
        if poses is None or not self.numbers:
            for label in self.numbers:
                label.remove()
            count = 0 if poses is None else len(np.asarray(poses))
            every = 1 if count <= MOST_NUMBERS else 5
            self.links = range(0, count, every)
            self.numbers = [
                self.scene.add_label(
                    f"{self.name}/number/{link}", str(link), font_screen_scale=0.8, anchor="center-center"
                )
                for link in self.links
            ]
        if poses is not None:
            height = front(self.mechanism) if isinstance(self.mechanism, RollingChain) else 0.0
            for link, label in zip(self.links, self.numbers, strict=True):
                label.position = frames(poses)[link, :3, 3] + [0.0, 0.0, height]

    @property
    def visible(self) -> bool:
        """Whether it is shown."""
        return bool(self.root.visible)

    @visible.setter
    def visible(self, shown: bool) -> None:
        self.root.visible = shown

    def remove(self) -> None:
        """Take it out of the scene."""
        self.root.remove()

    def _added(self, k: int, colour: Color, opacity: float) -> Any:
        solid = self.solids[k]
        count = len(solid.links)
        colours = np.array([INK if solid.marked else BASE if link == 0 else colour for link in solid.links], np.uint8)
        return self.scene.add_batched_meshes_simple(
            f"{self.name}/links/{k}",
            solid.vertices,
            solid.faces,
            np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)),
            np.zeros((count, 3)),
            batched_colors=colours,
            opacity=None if opacity == 1.0 else opacity,
            flat_shading=True,
            lod="off",
        )

    def _draw(self, strands: Sequence[Strand], tension_range: tuple[float, float]) -> None:
        points = np.concatenate([np.stack([line[:-1], line[1:]], axis=1) for line, _ in strands])
        shown = np.array([tension_color(tension, tension_range) for _, tension in strands]) / 255.0
        linear = 255.0 * shown**2.2  # viser takes the colours of corners as they are, without the curve of a screen
        colours = np.repeat(linear.astype(np.uint8), [len(line) - 1 for line, _ in strands], axis=0)
        colours = np.repeat(colours[:, None], 2, axis=1)
        if self.tendons is not None and self.tendons.points.shape == points.shape:
            self.tendons.points, self.tendons.colors = points.astype(np.float32), colours
            return
        self.tendons = self.scene.add_line_segments(
            f"{self.name}/tendons", points, colours, thickness=self.thickness, thickness_units="screen"
        )
