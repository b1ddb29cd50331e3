"""A mechanism in the scene of a browser: its links and its tendons."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import viser.transforms
from numpy.typing import ArrayLike

from agents.viewer.solids import Strand, frames, solids
from rj_gym.rendering import BASE, INK, LINK, Color, tension_color


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
        self.thickness = 1.5 if opacity < 1.0 else 3.0
        self.tendons: Any = None

    def show(self, poses: ArrayLike, strands: Sequence[Strand], tension_range: tuple[float, float]) -> None:
        """Move the links to these poses and draw the tendons, blue at the minimum tension, red at the maximum."""
        placed = frames(poses)
        for solid, handle in zip(self.solids, self.handles, strict=True):
            link_frames = placed[list(solid.links)]
            handle.batched_positions = link_frames[:, :3, 3].astype(np.float32)
            handle.batched_wxyzs = viser.transforms.SO3.from_matrix(link_frames[:, :3, :3]).wxyz.astype(np.float32)
        self._draw(strands, tension_range)

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
        strand_colours = [tension_color(tension, tension_range) for _, tension in strands]
        colours = np.repeat(np.array(strand_colours, np.uint8), [len(line) - 1 for line, _ in strands], axis=0)
        colours = np.repeat(colours[:, None], 2, axis=1)
        if self.tendons is not None and self.tendons.points.shape == points.shape:
            self.tendons.points, self.tendons.colors = points.astype(np.float32), colours
            return
        self.tendons = self.scene.add_line_segments(
            f"{self.name}/tendons", points, colours, thickness=self.thickness, thickness_units="screen"
        )
