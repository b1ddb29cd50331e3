"""Pictures of friction: colours follow the tensions, rings the holes that stick, loops their branches."""

from __future__ import annotations

import itertools
from pathlib import Path

import matplotlib
import numpy as np
import pytest

matplotlib.use("Agg")

from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Line3DCollection
from PIL import Image

from rollingjoint.chain.presets import five_link, small_arm, two_segment
from rollingjoint.errors import InvalidInput
from rollingjoint.friction import CapstanFriction
from rollingjoint.plotting import (
    plot_arm,
    plot_friction_states,
    plot_loops,
    plot_mechanism,
    plot_tensions,
    save_animation,
)
from rollingjoint.plotting.friction import tension_colors, tension_ends
from rollingjoint.plotting.loops import moved
from rollingjoint.statics.loop import Loop, trace_loop
from rollingjoint.statics.solve import solve_tensions

BACK = 9  # steps after the second end, where some holes stick and others slip


@pytest.fixture
def ax() -> Axes:
    return Figure().subplots()


@pytest.fixture(scope="module")
def loop() -> Loop:
    return trace_loop(five_link().replace(friction=CapstanFriction(0.1)), (-5, 5), steps=100, cycles=1)


@pytest.fixture(scope="module")
def segments() -> Loop:
    chain = two_segment().replace(friction=CapstanFriction(0.1))
    return trace_loop(chain, (-2, 2, -3, 3), steps=40, cycles=1)


def lines_named(ax: Axes, name: str) -> list[np.ndarray]:
    return [np.array(line.get_xydata()) for line in ax.lines if line.get_label() == name]


@pytest.mark.parametrize("which", ["loop", "segments"])
def test_a_gap_has_the_colour_of_its_tension_and_a_channel_that_of_the_mean(
    which: str, ax: Axes, request: pytest.FixtureRequest
) -> None:
    eq = request.getfixturevalue(which).path.row(-5)
    plot_mechanism(eq, ax)
    colors = tension_colors(eq)
    drawn = [each for each in ax.collections if isinstance(each, LineCollection)]
    for j, (pieces, holes) in enumerate(zip(drawn, eq.chain.tendon_polyline(eq.poses), strict=True)):
        np.testing.assert_allclose(pieces.get_segments(), np.stack([holes[:-1], holes[1:]], axis=1))
        end = eq.chain.last_links[j]
        gaps = eq.gap_tensions[:end, j]
        np.testing.assert_allclose(pieces.get_colors()[1::2], colors.to_rgba(gaps))
        sides = np.concatenate([eq.tensions[[j]], gaps, gaps[-1:]])
        np.testing.assert_allclose(pieces.get_colors()[::2], colors.to_rgba(0.5 * (sides[:-1] + sides[1:])))


def test_rings_are_on_both_holes_of_the_links_in_which_a_tendon_sticks(loop: Loop, ax: Axes) -> None:
    eq = loop.path.row(len(loop.shares) - 1 - loop.steps + BACK)
    assert 0 < eq.sticking.sum() < eq.sticking.size
    plot_mechanism(eq, ax)
    rings = np.concatenate(lines_named(ax, "sticks"))
    holes = [
        line.reshape(-1, 2, 2)[:-1][eq.sticking[:, j]] for j, line in enumerate(eq.chain.tendon_polyline(eq.poses))
    ]
    np.testing.assert_allclose(rings, np.concatenate(holes).reshape(-1, 2))


def test_colours_span_the_tensions_of_the_gaps_that_tendons_cross(segments: Loop) -> None:
    eq = segments.path.row(7)
    crossed = np.concatenate([eq.gap_tensions[:end, j] for j, end in enumerate(eq.chain.last_links)])
    assert tension_ends(eq) == (crossed.min(), crossed.max())
    assert crossed.min() > 0.0


def test_given_ends_of_the_colours_are_used(loop: Loop, ax: Axes) -> None:
    eq = loop.path.row(3)
    plot_mechanism(eq, ax, tension_range=(0.0, 20.0), legend=False)
    pieces = next(each for each in ax.collections if isinstance(each, LineCollection))
    expected = tension_colors(eq, (0.0, 20.0)).to_rgba(eq.gap_tensions[0, 0])
    np.testing.assert_allclose(pieces.get_colors()[1], expected)


def test_without_friction_tendons_keep_their_colours(ax: Axes) -> None:
    plot_mechanism(solve_tensions(five_link(), (6, 3)), ax)
    assert not [each for each in ax.collections if isinstance(each, LineCollection)]


def test_tension_along_a_tendon_drops_at_the_links(loop: Loop, segments: Loop) -> None:
    eq = loop.path.row(len(loop.shares) - 1 - loop.steps + BACK)
    ax = plot_tensions([eq], ["released"], tendon=1, ax=Figure().subplots())
    [steps] = ax.patches
    values, edges, _ = steps.get_data()
    np.testing.assert_array_equal(values, [eq.tensions[1], *eq.gap_tensions[:, 1]])
    np.testing.assert_array_equal(edges, range(-1, 5))
    [rings] = lines_named(ax, "sticks")
    np.testing.assert_array_equal(rings[:, 0], np.flatnonzero(eq.sticking[:, 1]))
    short = plot_tensions([segments.path.row(3)], ["short"], tendon=0, ax=Figure().subplots())
    assert len(short.patches[0].get_data().values) == 1 + segments.path.mechanism.last_links[0]


def test_states_are_drawn_by_tendon_and_link_over_the_steps(segments: Loop) -> None:
    path, ends = segments.path, segments.path.mechanism.last_links
    ax = plot_friction_states(path, Figure().subplots())
    rows = ax.images[0].get_array()
    assert rows.shape == (sum(ends), len(segments.shares))
    np.testing.assert_array_equal(rows[ends[0] + 1], path.friction_states[:, 1, 1])
    np.testing.assert_array_equal(rows[-1], path.friction_states[:, ends[-1] - 1, -1])


def test_loops_show_both_branches_and_the_start(loop: Loop) -> None:
    left, right = plot_loops([loop], ["one"]).axes
    start, around = left.lines
    np.testing.assert_array_equal(np.array(around.get_xydata()), loop.path.tip[loop.cycle])
    np.testing.assert_array_equal(np.array(start.get_xydata()), loop.path.tip[: loop.steps // 2 + 1])
    inputs, outputs = np.array(right.lines[1].get_xydata()).T
    np.testing.assert_allclose(inputs, loop.inputs[loop.cycle, 0] - loop.middle[0])
    assert np.ptp(outputs) == pytest.approx(loop.travel)
    assert moved(loop, loop)[0] == 0.0
    assert right.get_legend().get_texts()[0].get_text() == "one"


def test_a_loop_that_goes_nowhere_is_drawn() -> None:
    loop = trace_loop(five_link().replace(friction=CapstanFriction(0.1)), (0, 0), steps=2, cycles=1)
    np.testing.assert_allclose(moved(loop, loop), 0.0, atol=1e-9)
    assert len(plot_loops([loop], ["still"]).axes) == 2


def test_an_arm_shows_the_tension_of_every_gap_and_rings_on_holes_that_stick() -> None:
    loop = trace_loop(small_arm().replace(friction=CapstanFriction(0.1)), (-2, 0, 2, 0), steps=6, cycles=1)
    eq = loop.path.row(-2)
    assert 0 < eq.sticking.sum() < eq.sticking.size
    ax = plot_arm(eq, Figure().add_subplot(projection="3d"))
    drawn = [each for each in ax.collections if isinstance(each, Line3DCollection)]
    colors = tension_colors(eq)
    for j, pieces in enumerate(drawn):
        np.testing.assert_allclose(np.array(pieces.get_colors())[::2], colors.to_rgba(eq.gap_tensions[:, j]))
    rings = sum(len(line.get_data_3d()[0]) for line in ax.lines if line.get_label() == "sticks")
    assert rings == 2 * eq.sticking.sum() - eq.sticking[0].sum()  # the base has one hole per tendon


def test_the_loop_of_an_arm_is_drawn_in_its_plane() -> None:
    loop = trace_loop(small_arm(), (-2, 0, 2, 0), steps=6, cycles=1)
    left, right = plot_loops([loop], ["arm"]).axes
    assert all(np.isfinite(line.get_xydata()).all() for line in (*left.lines, *right.lines))
    with pytest.raises(InvalidInput, match="that of a planar chain"):
        save_animation(loop, "arm.gif")


@pytest.mark.slow
def test_an_animation_goes_once_around(loop: Loop, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rollingjoint.plotting.loops._FRAMES", 5)
    path = save_animation(loop, tmp_path / "loop.gif")
    with Image.open(path) as picture:
        assert (picture.n_frames, picture.info["loop"]) == (5, 0)
        frames = []
        for index in range(5):
            picture.seek(index)
            frames.append(np.asarray(picture.convert("RGB")).astype(int))
    assert all(np.abs(a - b).sum() > 0 for a, b in itertools.pairwise(frames))
    orange = np.array(to_rgba("#D55E00")[:3]) * 255
    for frame in frames:  # the point on the loop
        assert (np.abs(frame - orange).max(axis=2) < 12).sum() > 20


def test_wrong_input_is_refused(loop: Loop, tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match=r"labels.*1, one per loop"):
        plot_loops([loop], [])
    with pytest.raises(InvalidInput, match=r"labels.*1, one per equilibrium"):
        plot_tensions([loop.path.row(0)], ["a", "b"])
    with pytest.raises(InvalidInput, match="tendon = 2: expected an integer from 0 to 1"):
        plot_tensions([loop.path.row(0)], ["a"], tendon=2)
    with pytest.raises(InvalidInput, match="a path, as trace returns it"):
        plot_friction_states(loop.path.row(0))
    with pytest.raises(InvalidInput, match=r"ends in \.gif"):
        save_animation(loop, tmp_path / "loop.png")
    with pytest.raises(InvalidInput, match="existing folder"):
        save_animation(loop, tmp_path / "no" / "loop.gif")
