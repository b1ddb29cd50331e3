"""Camera views of a browser, in which a mechanism fills the picture next to the panel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from agents.viewer.solids import Array
from rj_gym.tracking.render import TrackingScene
from rollingjoint import RollingChain

FIELD = 0.5  # of view [rad]: small, so that lines that are parallel look so


@dataclass(frozen=True)
class View:
    """A camera view: the centre, the vector from there to the camera, (3,) each [mm], and the upward direction."""

    at: Array
    away: Array
    up: tuple[float, float, float]

    @property
    def far(self) -> float:
        """The largest visible distance from the camera [mm]."""
        return 20.0 * float(np.linalg.norm(self.away))


def mechanism_view(mechanism: Any) -> View:
    """A chain that stands in the plane x, y, or an arm that hangs along z, left of the panel."""
    length = float(mechanism.length)
    if isinstance(mechanism, RollingChain):
        return View(np.array([0.3, 0.5, 0.0]) * length, np.array([0.15, 0.35, 3.3]) * length, (0.0, 1.0, 0.0))
    return View(np.array([0.25, 0.0, 0.48]) * length, np.array([0.6, 2.9, -0.9]) * length, (0.0, 0.0, -1.0))


def among_walls_view(mechanism: Any, turn: Array, origin: Array) -> View:
    """A chain and the walls around it and ahead of it, left of the panel; turn, origin: of its base among them."""
    view, d = mechanism_view(mechanism), len(origin)
    place, ahead = (np.pad(vector, (0, 3 - d)) for vector in (origin, turn[:, -1]))
    aside = view.at * (1.2, *(0.0 if axis == d - 1 else 1.0 for axis in (1, 2)))
    return View(aside + place + 1.2 * mechanism.length * ahead, 1.8 * view.away, view.up)


def episode_view(scene: TrackingScene) -> View:
    """The view of the mechanism of an episode."""
    return mechanism_view(scene.mechanism)


def centred_view(mechanism: Any) -> View:
    """The same from farther away and in the middle, for a page without a panel and for narrow screens."""
    view = mechanism_view(mechanism)
    return View(view.at * (0.0, 1.0, 1.0), 1.45 * view.away, view.up)


def look(client: Any, view: View) -> None:
    """Turn a client's camera, unless it looks there; one that has only just come would forget it."""
    current = [*client.camera.position, *client.camera.look_at]
    if np.allclose(current, [*(view.at + view.away), *view.at], atol=1e-3 * view.far):
        return
    with client.atomic():
        client.camera.up_direction = view.up  # the scene's own would bring back the server's first view
        client.camera.position = view.at + view.away
        client.camera.look_at = view.at
        client.camera.fov = FIELD
        client.camera.far = view.far


def begin_with(server: Any, view: View) -> None:
    """The first view of all browsers of a server, and of its recording."""
    server.scene.set_up_direction(view.up)
    server.initial_camera.up = view.up
    server.initial_camera.position = view.at + view.away
    server.initial_camera.look_at = view.at
    server.initial_camera.fov = FIELD
    server.initial_camera.far = view.far
