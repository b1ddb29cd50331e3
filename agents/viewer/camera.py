"""Where a client looks from, so that a mechanism fills its picture beside the panel."""

from __future__ import annotations

from typing import Any

import numpy as np

from agents.viewer.solids import Array
from rj_gym.rendering.tracking import TrackingScene

FIELD = 0.5  # of view [rad]: small, so that lines that are parallel look so


def look_at_episode(client: Any, scene: TrackingScene) -> None:
    """Face a chain that stands in the plane x, y, or an arm that hangs along z."""
    length = float(scene.mechanism.length)
    if scene.tip.shape == (2,):
        face(client, np.array([0.3, 0.5, 0.0]) * length, np.array([0.15, 0.35, 3.3]) * length, (0.0, 1.0, 0.0))
    else:
        face(client, np.array([0.25, 0.0, 0.48]) * length, np.array([0.6, 2.9, -0.9]) * length, (0.0, 0.0, -1.0))


def face(client: Any, at: Array, away: Array, up: tuple[float, float, float]) -> None:
    """Look at a place from another one, `away` from it, both [mm]."""
    client.scene.set_up_direction(up)
    camera = client.camera
    with client.atomic():
        camera.up_direction = up
        camera.position = at + away
        camera.look_at = at
        camera.fov = FIELD
        camera.far = 100.0 * float(np.linalg.norm(away))
