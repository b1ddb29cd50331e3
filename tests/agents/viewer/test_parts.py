"""Parts of the viewer that need no browser: shapes, keys, axes, time, pages' text, the command."""

import re
import shlex
import threading
import time
from html import escape, unescape
from pathlib import Path

import numpy as np
import pytest

from agents.controllers import JacobianFeedback
from agents.runs.environment import EnvConfig
from agents.viewer.clock import Clock
from agents.viewer.drive import filmed
from agents.viewer.html import code_block, coloured, html_table, markdown
from agents.viewer.solids import frames, in_space, solids, strands, strands_of
from agents.viewer.steering import KEYS, nudge, pulls
from rj_gym.registry import task_of
from rollingjoint import CapstanFriction, preset, solve_tensions
from rollingjoint.chain.outline import link_outline, to_world

CHAIN, ARM = EnvConfig(), EnvConfig("rj_gym/FlexibleArm-v0")


def task(env):
    return task_of(env.arguments()["config"])


@pytest.mark.parametrize("name", ["five_link", "two_segment", "small_arm", "pitch_yaw", "pitch_yaw_two_segment"])
def test_shapes_are_closed_and_point_outwards(name):
    for solid in solids(preset(name)):
        a, b, c = (solid.vertices[solid.faces[:, k]] for k in range(3))
        normals = np.cross(b - a, c - a)
        assert np.allclose(normals.sum(axis=0), 0.0, atol=1e-9 * np.abs(normals).sum())
        assert np.einsum("fi,fi->", normals, a) > 0.0  # six times the volume


def test_a_link_lies_where_its_outline_lies():
    chain = preset("five_link")
    found = solve_tensions(chain, [6.0, 3.0])
    by_link = {link: solid for solid in solids(chain) for link in solid.links}
    assert sorted(by_link) == [0, 1, 2, 3, 4]
    for k, frame in enumerate(frames(found.poses)):
        placed = by_link[k].vertices @ frame[:3, :3].T + frame[:3, 3]
        outline = to_world(found.poses[k], link_outline(chain.links[k], 400))
        np.testing.assert_allclose(placed.min(axis=0)[:2], outline.min(axis=0), atol=0.02)
        np.testing.assert_allclose(placed.max(axis=0)[:2], outline.max(axis=0), atol=0.02)


def test_equal_beads_are_one_shape():
    arm = preset("flexible_arm")
    shapes = solids(arm)
    assert sum(len(solid.links) for solid in shapes) == arm.n_links and len(shapes) <= 4  # with the plate of the base


def test_links_in_space_have_their_contact_surfaces_over_the_width_of_the_line_and_marks_at_their_holes():
    chain = preset("pitch_yaw")
    shapes = solids(chain)
    bodies, marks = [s for s in shapes if not s.marked], [s for s in shapes if s.marked]
    assert len(bodies) == 4 and len(marks) <= 4  # base, pitch below yaw and the other way round, tip
    for drawn in (bodies, marks):
        assert sorted(link for solid in drawn for link in solid.links) == list(range(13))
    yaw_above = next(solid for solid in bodies if 1 in solid.links).vertices
    low, high = yaw_above.min(axis=0), yaw_above.max(axis=0)
    assert [low[2], high[2]] == pytest.approx([-2.5, 2.5], abs=0.02)
    top = yaw_above[yaw_above[:, 2] > 2.3]  # turns about x: the line lies along x
    assert [np.ptp(top[:, 0]), np.ptp(top[:, 1])] == pytest.approx([8.0, 2.5], abs=0.1)


def test_tendons_of_a_scene_have_the_tension_of_every_part_where_they_rub():
    plain = filmed("", EnvConfig(settings={"episode_steps": 2}), JacobianFeedback(), 1).scenes[-1]
    assert len(strands_of(plain)) == 2
    rubbing = preset("five_link").replace(friction=CapstanFriction(0.2))
    settings = {"episode_steps": 2, "mechanism": rubbing}
    scene = filmed("", EnvConfig(settings=settings), JacobianFeedback(), 1).scenes[-1]
    lines = strands_of(scene)
    assert len(lines) > 2 and len({tension for _, tension in lines}) > 4
    assert len(strands(scene.mechanism, scene.poses, scene.tensions)) == 2
    assert in_space([1.0, 2.0, 3.0]).tolist() == [1.0, 2.0, 3.0]


def test_keys_move_a_point_as_the_camera_sees_it():
    assert nudge(task(CHAIN), "L") == pytest.approx([2.0, 0.0]) and nudge(task(CHAIN), "I") == pytest.approx([0.0, 2.0])
    assert not nudge(task(CHAIN), "O").any()
    up, away = nudge(task(ARM), "I"), nudge(task(ARM), "O")
    assert up[2] < 0.0 and away[1] < 0.0  # an arm hangs along z and is looked at from +y


@pytest.mark.parametrize(("env", "key", "axis"), [(CHAIN, "L", 0), (ARM, "L", 0), (ARM, "O", 1)])
def test_keys_pull_the_tendons_that_bend_the_tip_to_their_side(env, key, axis):
    mechanism, change = task(env).mechanism, pulls(task(env), key)
    kept = {"loads": [mechanism.gravity((0.0, 0.0, 1.0))]} if env is ARM else {}
    to_it, away = (solve_tensions(mechanism, 3.0 + way * change, **kept).tip[axis] for way in (4.0, -4.0))
    assert (to_it - away) * (-1.0 if key == "O" else 1.0) > 1.0
    np.testing.assert_allclose(change, -pulls(task(env), {"L": "J", "O": "U"}[key]))


def test_a_key_tightens_all_tendons_and_every_key_means_something():
    assert (pulls(task(ARM), "I") == 0.25).all() and (pulls(task(ARM), "K") == -0.25).all()
    assert all(pulls(task(ARM), key).any() for key in KEYS)


def test_a_clock_ticks_until_it_is_told_to_end():
    ticks = []
    clock = Clock(lambda: ticks.append(1) or len(ticks) < 5, rate=1000.0)
    clock.start()
    while clock.running:
        time.sleep(0.001)
    assert len(ticks) == 5


def test_a_stopped_clock_does_not_tick_and_can_start_again():
    ticked = threading.Event()
    clock = Clock(lambda: ticked.set() or True, rate=1000.0)
    for _ in range(2):
        clock.start()
        assert ticked.wait(5.0)
        clock.stop()
        time.sleep(0.02)
        ticked.clear()
        assert not clock.running and not ticked.wait(0.02)


def test_plots_have_round_ticks_inside_their_axes():
    chart = pytest.importorskip("agents.viewer.chart")
    for values in ([0.013, 0.087], [-3.0, 12.0], [5.0, 5.0], [1e-7, 9e-7]):
        axis = chart.Axis(np.array(values), 10.0, 50.0)
        assert 2 <= len(axis.ticks) <= 11
        assert ((axis.place(axis.ticks) >= 10.0 - 1e-9) & (axis.place(axis.ticks) <= 60.0 + 1e-9)).all()
        assert axis.place(np.array(values)).min() > 10.0 and axis.has(10.0) and not axis.has(60.1)
        assert axis.value(axis.place(values[0])) == pytest.approx(values[0])


def commands():
    """The commands of the documentation that end by themselves."""
    page = Path("docs/view.md").read_text("utf-8")
    return re.findall(r"^rj view (.* --record .*)$", page, re.MULTILINE)


@pytest.mark.slow
@pytest.mark.parametrize("line", commands())
def test_a_command_of_the_documentation_writes_a_page(line, tmp_path, monkeypatch, capsys):
    pytest.importorskip("viser", reason="the extra view is not installed")
    from agents.view import main

    monkeypatch.chdir(tmp_path)
    assert main(shlex.split(line)) == 0
    (page,) = tmp_path.iterdir()
    assert f"{page.stat().st_size / 1e6:.1f} MB" in capsys.readouterr().out and page.stat().st_size < 1_500_000


def test_a_legend_names_every_controller_and_its_errors():
    from agents.viewer.scoreboard import legend

    film = filmed("<mine>", EnvConfig(settings={"episode_steps": 3}), JacobianFeedback(), 1)
    during, after = legend([film], 1), legend([film], 3)
    assert "&lt;mine&gt;" in during and "–" in during and "–" not in after
    assert f"{film.errors[1]:.1f} mm" in during or f"{film.errors[1]:.3f} mm" in during


NAMES = [
    "<img src=x onerror=alert(1)>.json",
    "&lt;b&gt; & <b>",
    "# 1. *a* _b_ ~~c~~ `d` [e](javascript:f) ![g](h) | i |",
    "`````\n<script>alert(1)</script>\n```",
    "\\<b>",
]


IN_SPACE = Path(__file__).resolve().parents[3] / "configs/surroundings/in_space.yaml"


@pytest.mark.parametrize("name", NAMES)
def test_names_from_files_are_shown_as_they_are(name):
    reader = pytest.importorskip("markdown_it", reason="markdown-it-py is not installed")
    read = reader.MarkdownIt().enable(["table", "strikethrough"]).render
    line = " ".join(name.split())
    shown, code = read(markdown(line)), read(code_block(name))
    assert shown.count("<") == 2 and unescape(shown) == f"<p>{line}</p>\n"
    assert code.count("<") == 4 and unescape(code) == f'<pre><code class="language-text">{name}\n</code></pre>\n'
    assert f">{escape(name)}</td>" in html_table([""], [[name]])
    assert f"&nbsp;{escape(name)}</th>" in html_table([coloured("red", name)], [])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--host", "0.0.0.0"], "expected 127.0.0.1"),
        (["--host", "192.168.1.4"], "--exposed"),
        (["--host", "example.org"], "expected 127.0.0.1"),
        (["--port", "70000"], "--port"),
        (["two_segment", "--surroundings", str(IN_SPACE)], "expected walls around a planar chain"),
        (["--surroundings", str(IN_SPACE), "--base", "1", "2"], "three numbers, in space three or six"),
        (["--episodes", "nobody"], "one of arm_instrument"),
        (["--search", "."], "finished run"),
        (["--run", "."], "config.yaml"),
        (["--record", "page.html"], "which say what to record"),
        (["--record", "page.html", "--episodes", "noisy", "--which", "good"], "best, median, worst"),
        (["--record", "page.html", "--episodes", "noisy", "--which", "3"], "seed = 3"),
        (["--record", "page.html", "--episodes", "noisy", "--which", "10000", "--beside", "me"], "beside = 'me'"),
    ],
)
def test_what_cannot_be_shown_is_refused_in_one_line(arguments, message, capsys, tmp_path, monkeypatch):
    pytest.importorskip("viser", reason="the extra view is not installed")
    from agents.view import main

    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert line.startswith("error: ") and message in line
    assert list(tmp_path.iterdir()) == []
