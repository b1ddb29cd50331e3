"""A page that plays a recording, without a server and without network."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Any

import numpy as np

from agents.viewer.body import SceneMechanism
from agents.viewer.camera import begin_with, centred_view
from agents.viewer.drive import Film
from agents.viewer.scoreboard import legend
from agents.viewer.serving import serving
from agents.viewer.solids import Array, strands
from agents.viewer.stage import Stage, add_grid
from rollingjoint import trace

TITLE = "<title>{}</title>"
REST, PULL = 2.0, 9.0  # smallest and largest tension [N]
POSES = 40  # while one tendon pulls and lets go
CORNER = (
    '<div style="position:fixed;left:12px;bottom:56px;max-width:calc(100vw - 48px);padding:8px 12px;'
    'z-index:10;background:#fffd;border-radius:6px;font:14px system-ui,sans-serif">{}</div>'
)


def episode_page(films: Sequence[Film], rate: float = 10.0, title: str = "") -> str:
    """One HTML page that plays an episode under one controller, or under several over each other.

    Args:
        films: of the same episode, at least one. rate: steps per second. title: of the page.
    """
    with serving() as server:
        begin_with(server, centred_view(films[0].scenes[0].mechanism))
        stage = Stage(server.scene, films)
        recording = server.get_scene_serializer()
        for step in range(max(film.steps for film in films) + 1):
            stage.show(step)
            recording.insert_sleep(1.0 / rate)
        page = recording.as_html()
    errors = legend(films, max(film.steps for film in films), "at the end")
    return _framed(page, title or f"{films[0].env.id}, seed {films[0].seed}", errors)


def sweep_page(mechanism: Any, name: str, rate: float = 20.0) -> str:
    """One HTML page on which every tendon pulls in turn; poses without an equilibrium are left out.

    Args:
        mechanism: of either class. name: that the page shows. rate: poses per second.
    """
    tensions = _in_turn(mechanism.n_tendons)
    path = trace(mechanism, tensions, given="tensions")
    with serving() as server:
        begin_with(server, centred_view(mechanism))
        add_grid(server.scene, "/grid", mechanism)
        body = SceneMechanism(server.scene, "/mechanism", mechanism)
        recording = server.get_scene_serializer()
        for pose in (path.row(k) for k in range(len(tensions)) if path.ok[k]):
            body.show(pose.poses, strands(mechanism, pose.poses, pose.tensions), (0.0, PULL))
            recording.insert_sleep(1.0 / rate)
        page = recording.as_html()
    return _framed(page, name, f"<br>{mechanism.n_links} links, every tendon in turn up to {PULL:g} N")


def _in_turn(n_tendons: int) -> Array:
    """Tensions (K, m) [N]: one tendon after the other pulls and lets go."""
    rise = np.sin(np.linspace(0.0, np.pi, POSES))[:, None, None]
    pulled = REST + (PULL - REST) * rise * np.eye(n_tendons)
    return np.asarray(pulled.transpose(1, 0, 2).reshape(-1, n_tendons))


def _framed(page: str, title: str, below: str) -> str:
    """The page with its title, which stands in a corner, too, above more HTML."""
    corner = CORNER.format(f"<b>{escape(title)}</b>{below}")
    before, end, after = page.rpartition("</body>")
    return before.replace("<head>", f"<head>{TITLE.format(escape(title))}", 1) + corner + end + after
