"""One step of an episode in the scene of a browser, under one controller or under several over each other."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from agents.evaluation.pictures import COLOURS
from agents.viewer.body import SceneMechanism
from agents.viewer.drive import Film
from agents.viewer.solids import Array, front, in_space, strands_of
from rj_gym.rendering import BACKGROUND, GRID, LINK, LOAD, TARGET, Color, blend
from rj_gym.tracking.render import TrackingScene
from rollingjoint import HingeChain, RollingChain, SpatialChain

GRAVITY: Color = (120, 90, 160)
EDGES: Color = (208, 213, 219)
FLOOR = 1.12  # height of the floor below the base of an arm, in lengths
FAINT = 0.35  # opacity of the mechanisms of all controllers but the first


def colour_of(place: int) -> Color:
    """The colour of the controller at a place, the same in the scene, in plots and in legends."""
    text = next(colour for k, colour in enumerate(cycle(COLOURS)) if k == place)
    red, green, blue = (int(text[at : at + 2], 16) for at in (1, 3, 5))
    return red, green, blue


def add_grid(scene: Any, name: str, mechanism: RollingChain | HingeChain | SpatialChain) -> Any:
    """Squares of a tenth of the length: behind a chain, below an arm."""
    length, stands = mechanism.length, isinstance(mechanism, RollingChain)
    return scene.add_grid(
        name,
        2.2 * length,
        (1.6 if stands else 2.2) * length,
        cell_size=0.1 * length,
        section_size=0.5 * length,
        cell_color=GRID,
        section_color=EDGES,
        fade_strength=0.0,
        position=(0.0, 0.4 * length, -1.1 * front(mechanism)) if stands else (0.0, 0.0, FLOOR * length),
    )


class Stage:
    """The scene of one episode under several controllers: the first solid, the others faint.

    Args:
        scene: of a client. films: of the same episode, at least one.
    """

    def __init__(self, scene: Any, films: Sequence[Film]) -> None:
        self.scene, self.films, self.shows_loads = scene, films, True
        first = films[0].scenes[0]
        self.length, self.height = first.mechanism.length, front(first.mechanism) if first.tip.shape == (2,) else 0.0
        self.root = scene.add_frame("/episode", show_axes=False)
        self.bodies = [self._body(place, film) for place, film in enumerate(films)]
        self.target = scene.add_icosphere("/episode/target", 0.022 * self.length, TARGET)
        self.tips = [self._tip(place) for place in range(len(films))]
        self._path(first.targets)
        add_grid(scene, "/episode/grid", first.mechanism)

    def show(self, step: int) -> None:
        """Show all controllers after this many steps; episodes with fewer steps, at their end."""
        first = self.films[0].at(step)
        self.target.position = self._place(first.target)
        for film, body, tip, place in zip(self.films, self.bodies, self.tips, range(len(self.films)), strict=True):
            scene = film.at(step)
            body.show(scene.poses, strands_of(scene), scene.tension_range)
            tip.position = self._place(scene.tip)
            self._line(f"/episode/trail/{place}", film.trail(step), colour_of(place), 2.5)
        self._loads(first)

    def remove(self) -> None:
        """Take everything out of the scene."""
        self.root.remove()

    def _body(self, place: int, film: Film) -> SceneMechanism:
        solid = place == 0
        tint = blend(LINK, colour_of(place), 0.25 if solid else 0.75)
        behind = 0.008 * place * self.length if self.height else 0.0
        return SceneMechanism(
            self.scene, f"/episode/{place}", film.scenes[0].mechanism, tint, 1.0 if solid else FAINT, behind
        )

    def _tip(self, place: int) -> Any:
        return self.scene.add_icosphere(f"/episode/tip/{place}", 0.014 * self.length, colour_of(place))

    def _place(self, point: Array) -> Array:
        """A position in the plane in front of the links, or in space as it is."""
        return in_space(point, self.height)

    def _path(self, targets: Array) -> None:
        if np.any(targets != targets[0]):
            self._line("/episode/path", targets, blend(BACKGROUND, TARGET, 0.5), 1.5)

    def _line(self, name: str, points: ArrayLike, colour: Color, thickness: float) -> None:
        corners = in_space(points, self.height)
        corners = np.concatenate([corners[:1], corners])  # a line of one point, too
        pieces = np.stack([corners[:-1], corners[1:]], axis=1)
        self.scene.add_line_segments(name, pieces, colour, thickness=thickness, thickness_units="screen")

    def _loads(self, scene: TrackingScene) -> None:
        """The hidden loads as arrows, if they are shown: a force on a link, or payload and gravity."""
        arrows = _arrows(scene, self.length) if self.shows_loads else []
        points = np.array([[self._place(begin), self._place(end)] for begin, end, _ in arrows]).reshape(-1, 2, 3)
        colours = np.array([colour for *_, colour in arrows], np.uint8).reshape(-1, 3)
        unit = 0.01 * self.length
        sizes = {"shaft_radius": 0.6 * unit, "head_radius": 1.8 * unit, "head_length": 4.5 * unit}
        self.scene.add_arrows("/episode/loads", points, colours, **sizes)


def _arrows(scene: Any, length: float) -> list[tuple[Array, Array, Color]]:
    if hasattr(scene, "force"):
        begin = scene.poses[scene.link, :2]
        return [(begin, begin + _stretched(scene.force, length), LOAD)] if np.any(scene.force) else []
    begin = np.array([-0.3, 0.0, 0.1]) * length
    arrows = [(begin, begin + 0.16 * length * scene.gravity, GRAVITY)]
    return (
        [*arrows, (scene.tip, scene.tip + _stretched(scene.payload, length), LOAD)] if np.any(scene.payload) else arrows
    )


def _stretched(force: Array, length: float) -> Array:
    """A force [N] as an arrow [mm], long enough to be seen."""
    size = float(np.linalg.norm(force))
    return force / size * (0.1 + 0.2 * size) * length
