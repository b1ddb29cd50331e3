"""A page that plays what was recorded, without a server and without network."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from agents.viewer.camera import begin_with, centred_view
from agents.viewer.drive import Film
from agents.viewer.scoreboard import legend
from agents.viewer.serving import serving
from agents.viewer.stage import Stage

TITLE = "<title>{}</title>"
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
        begin_with(server, centred_view(films[0].scenes[0]))
        stage = Stage(server.scene, films)
        recording = server.get_scene_serializer()
        for step in range(max(film.steps for film in films) + 1):
            stage.show(step)
            recording.insert_sleep(1.0 / rate)
        page = recording.as_html()
    return _framed(page, films, title or f"{films[0].env.id}, seed {films[0].seed}")


def _framed(page: str, films: Sequence[Film], title: str) -> str:
    """The page with its title, and a legend in a corner."""
    errors = legend(films, max(film.steps for film in films), "at the end")
    corner = CORNER.format(f"<b>{escape(title)}</b>{errors}")
    before, end, after = page.rpartition("</body>")
    return before.replace("<head>", f"<head>{TITLE.format(escape(title))}", 1) + corner + end + after
