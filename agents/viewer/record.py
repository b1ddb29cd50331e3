"""A page that plays a recording, without a server and without network."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from html import escape
from typing import Any

import numpy as np

from agents.viewer.body import SceneMechanism
from agents.viewer.camera import begin_with, centred_view
from agents.viewer.drive import Film
from agents.viewer.scoreboard import legend
from agents.viewer.serving import serving
from agents.viewer.solids import Array, front, in_space, strands
from agents.viewer.stage import Stage, add_grid
from rj_gym.rendering import TARGET
from rollingjoint import trace
from rollingjoint.identify import RigRecording
from rollingjoint.identify.beliefs import RigSpace
from rollingjoint.identify.rig import designed_space
from rollingjoint.identify.twin import RigModel

TITLE = "<title>{}</title>"
REST, PULL = 2.0, 9.0  # smallest and largest tension [N]
MOST_POSES = 600  # of a recording
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


def recording_page(recording: RigRecording, space: RigSpace, values: Array, rate: float = 20.0, title: str = "") -> str:
    """One HTML page on which mechanisms go along the recorded motors: as identified, and beside it as designed.

    The longest run, thinned to MOST_POSES steps; small balls are at the tip that was measured, beside both.

    Args:
        recording: of the rig. space, values: the identified rig, (P,). rate: poses per second. title: of the page.
    """
    run = max(recording.runs, key=lambda run: len(run.t))
    recording = replace(recording, runs=[run]).thinned(MOST_POSES)
    run, designed, zeros = recording.runs[0], *designed_space(space.mechanism)
    rigs = [("as identified", space, values), ("as designed", designed, zeros)]
    paths = [
        trace(rig.chain(vector), RigModel(recording, rig).lengths(vector[None])[0, 0], given="lengths")
        for _, rig, vector in rigs
    ]
    mechanism: Any = space.mechanism
    span = 0.9 * mechanism.length
    with serving() as server:
        begin_with(server, centred_view(mechanism))
        add_grid(server.scene, "/grid", mechanism)
        bodies, tips = [], []
        for place, (name, rig, vector) in enumerate(rigs):
            server.scene.add_frame(f"/{place}", show_axes=False, position=((place - 0.5) * span, 0.0, 0.0))
            bodies.append(SceneMechanism(server.scene, f"/{place}/mechanism", rig.chain(vector)))
            server.scene.add_label(f"/{place}/name", name, position=(0.0, -0.12 * mechanism.length, 0.0))
            tips.append(server.scene.add_icosphere(f"/{place}/tip", 0.02 * mechanism.length, TARGET))
        page_recording = server.get_scene_serializer()
        for step in range(len(run.t)):
            for body, tip, path in zip(bodies, tips, paths, strict=True):
                if path.ok[step]:
                    pose = path.row(step)
                    body.show(pose.poses, strands(body.mechanism, pose.poses, pose.tensions), (0.0, PULL))
                if np.isfinite(run.tips[step]).all():
                    height = front(mechanism) if mechanism.dimension == 2 else 0.0
                    tip.position = in_space(run.tips[step, : mechanism.dimension], height)
            page_recording.insert_sleep(1.0 / rate)
        page = page_recording.as_html()
    lines = [f"<br>run {escape(run.name)}, {len(run.t)} steps; the ball is the measured tip"]
    for (name, *_), path in zip(rigs, paths, strict=True):
        away = np.linalg.norm(path.tip[:, : mechanism.dimension] - run.tips[:, : mechanism.dimension], axis=1)
        away = away[path.ok & np.isfinite(away)]
        count = int((~path.ok).sum())
        lost = f", {count} step{'s' * (count > 1)} without an equilibrium" if count else ""
        if away.size or lost:
            error = f"tip off by {np.sqrt(np.mean(away**2)):.2f} mm rms" if away.size else "no tip"
            lines.append(f"<br>{name}: {error}{lost}")
    return _framed(page, title or "recording of a rig", "".join(lines))


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
