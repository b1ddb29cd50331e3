"""Pictures: what is drawn where, and that outlines are true."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import matplotlib
import numpy as np
import pytest

matplotlib.use("Agg")

from matplotlib import pyplot
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Annotation

from rollingjoint.chain.equilibrium import Equilibrium
from rollingjoint.chain.outline import link_outline, surface_points, to_world
from rollingjoint.chain.presets import five_link, preset, presets_of, two_segment
from rollingjoint.chain.rolling import RollingChain
from rollingjoint.chain.status import Status
from rollingjoint.errors import InvalidInput
from rollingjoint.load import BodyWrench, Spring, WorldForce
from rollingjoint.plotting import PALETTE, plot_family, plot_mechanism, save_figure
from rollingjoint.plotting.parts import arrow_scale, contact_forces_world
from rollingjoint.statics.solve import solve_lengths, solve_tensions, solve_tensions_batch


@pytest.fixture
def ax() -> Axes:
    return Figure().subplots()


@pytest.fixture(autouse=True)
def close_figures() -> Iterator[None]:
    yield
    pyplot.close("all")


def loaded() -> Equilibrium:
    return solve_tensions(five_link(), (6, 3), [WorldForce(-1, (0.5, 0))])


def arrows(ax: Axes) -> dict[str, list[tuple[np.ndarray, np.ndarray]]]:
    """Tail and tip of every arrow by colour."""
    found: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {}
    for text in ax.texts:
        if isinstance(text, Annotation) and text.arrowprops is not None:
            found.setdefault(text.arrowprops["color"], []).append((np.array(text.get_position()), np.array(text.xy)))
    return found


def legend_texts(ax: Axes) -> list[str]:
    legend = ax.get_legend()
    assert legend is not None
    return [text.get_text() for text in legend.get_texts()]


@pytest.mark.parametrize("name", presets_of(RollingChain))
def test_outline_is_closed_and_runs_along_both_surfaces(name: str) -> None:
    for link in preset(name).links:
        outline = link_outline(link, count=21)
        np.testing.assert_array_equal(outline[0], outline[-1])
        for surface in (link.parent, link.child):
            for s in (*surface.limits, 0.0, 0.5 * surface.limits[1]):
                distance = np.hypot(*(outline - surface.point(s)).T).min()
                assert distance < 1e-9 or s not in (*surface.limits, 0.0)
                assert distance < 0.5 * (surface.limits[1] - surface.limits[0]) / 20


def test_outline_encloses_the_link_once() -> None:
    x, y = link_outline(five_link().links[2]).T
    area = 0.5 * np.sum(x[:-1] * y[1:] - x[1:] * y[:-1])
    assert 400 < area < 700  # counter-clockwise, about 30 mm by 20 mm less the rounding


def test_surface_points_hold_every_breakpoint() -> None:
    surface = five_link().links[2].child
    for s in surface.profile.breaks:
        assert np.hypot(*(surface_points(surface, count=4) - surface.point(s)).T).min() < 1e-12


def test_outlines_of_neighbours_touch_at_the_contact_point() -> None:
    eq = loaded()
    for i, point in enumerate(eq.contact_points):
        for link in (i, i + 1):
            outline = to_world(eq.poses[link], link_outline(eq.mechanism.links[link], count=2001))
            assert np.hypot(*(outline - point).T).min() < 0.02


def test_contact_forces_balance_the_tip_link() -> None:
    """Contact force, tendon pulls on the last link's parent holes and the external force add up to nothing."""
    eq = loaded()
    pulls = np.zeros(2)
    for line, tension in zip(eq.mechanism.tendon_polyline(eq.poses), eq.tensions, strict=True):
        gap = line[-3] - line[-2]
        pulls += tension * gap / np.hypot(*gap)
    np.testing.assert_allclose(contact_forces_world(eq)[-1] + pulls + (0.5, 0.0), 0.0, atol=1e-9)


def test_mechanism_alone_is_drawn_at_s_zero_without_forces(ax: Axes) -> None:
    chain = five_link()
    plot_mechanism(chain, ax)
    poses = chain.poses(chain.neutral_angles)
    assert len(ax.patches) == chain.n_links
    np.testing.assert_allclose(ax.patches[-1].get_xy(), to_world(poses[-1], link_outline(chain.links[-1])))
    assert legend_texts(ax) == ["tendon 0", "tendon 1"]
    assert arrows(ax) == {}


def test_tendons_run_through_their_holes_and_slack_ones_are_dashed(ax: Axes) -> None:
    eq = solve_tensions(two_segment(), (3, 0, 0.5, 3))
    plot_mechanism(eq, ax)
    lines = [line for line in ax.lines if str(line.get_label()).startswith("tendon")]
    assert [line.get_linestyle() for line in lines] == ["-", "--", "-", "-"]
    assert [line.get_label() for line in lines] == [
        "tendon 0, 3 N",
        "tendon 1, slack",
        "tendon 2, 0.5 N",
        "tendon 3, 3 N",
    ]
    assert [line.get_color() for line in lines] == list(PALETTE[:4])
    for line, path in zip(lines, eq.mechanism.tendon_polyline(eq.poses), strict=True):
        np.testing.assert_array_equal(line.get_xydata(), path)


def test_force_arrow_starts_at_the_body_point_and_has_the_length_of_its_scale(ax: Axes) -> None:
    point = (4.0, 6.0)
    eq = solve_tensions(five_link(), (6, 3), [WorldForce(-1, (0.3, -0.4), point=point)])
    plot_mechanism(eq, ax, contacts=False, load_scale=30.0)
    [[(tail, tip)]] = arrows(ax).values()
    np.testing.assert_allclose(tail, to_world(eq.poses[-1], np.array(point)))
    np.testing.assert_allclose(tip - tail, [9.0, -12.0])
    assert "external force (30 mm per N)" in legend_texts(ax)


def test_body_force_arrow_turns_with_its_link(ax: Axes) -> None:
    eq = solve_tensions(five_link(), (6, 3), [BodyWrench(3, (0.2, 0.0))])
    plot_mechanism(eq, ax, contacts=False, load_scale=10.0)
    [[(tail, tip)]] = arrows(ax).values()
    angle = eq.poses[3, 2]
    np.testing.assert_allclose(tip - tail, [2 * np.cos(angle), 2 * np.sin(angle)], atol=1e-12)


def test_contact_arrows_start_at_the_contact_points(ax: Axes) -> None:
    eq = loaded()
    plot_mechanism(eq, ax, loads=False, contact_scale=2.0)
    [drawn] = arrows(ax).values()
    np.testing.assert_allclose([tail for tail, _ in drawn], eq.contact_points)
    np.testing.assert_allclose([tip - tail for tail, tip in drawn], 2.0 * contact_forces_world(eq))


def test_moment_arc_turns_the_way_of_the_moment() -> None:
    for moment in (15.0, -15.0):
        ax = Figure().subplots()
        eq = solve_tensions(five_link(), (6, 3), [WorldForce(2, (0, 0), moment=moment)])
        plot_mechanism(eq, ax, tendons=False, contacts=False)
        [arc] = [line.get_xydata() - eq.poses[2, :2] for line in ax.lines if "moment" in str(line.get_label())]
        turns = np.cross(np.c_[arc[:-1], 0 * arc[:-1, 0]], np.c_[arc[1:], 0 * arc[1:, 0]])[:, 2]
        assert np.all(np.sign(turns) == np.sign(moment))


def test_spring_runs_from_the_body_point_to_its_anchor(ax: Axes) -> None:
    eq = solve_tensions(five_link(), (6, 3), [Spring(-1, 0.02, (-60, 10), point=(0, 5))])
    plot_mechanism(eq, ax, tendons=False, contacts=False)
    [zigzag] = [line.get_xydata() for line in ax.lines if line.get_label() == "spring 0.02 N/mm"]
    np.testing.assert_allclose(zigzag[0], to_world(eq.poses[-1], np.array([0.0, 5.0])))
    np.testing.assert_allclose(zigzag[-1], (-60, 10))


def test_contact_at_the_end_of_a_surface_is_marked(ax: Axes) -> None:
    eq = solve_tensions(five_link(), (1, 1), [WorldForce(-1, (-3, 0))])
    assert eq.status == Status.AT_LIMIT
    plot_mechanism(eq, ax)
    [rings] = [line for line in ax.lines if line.get_label() == "contact at surface end"]
    np.testing.assert_array_equal(rings.get_xydata(), eq.contact_points[~eq.free_joints])
    other = plot_mechanism(loaded(), Figure().subplots())
    assert "contact at surface end" not in legend_texts(other)


def test_everything_drawn_lies_inside_the_axes(ax: Axes) -> None:
    eq = solve_tensions(five_link(), (6, 3), [WorldForce(-1, (0, 1), point=(0, 10)), Spring(2, 0.01, (90, 20))])
    plot_mechanism(eq, ax)
    points = [patch.get_xy() for patch in ax.patches] + [end for pair in arrows(ax).values() for end in np.array(pair)]
    corners = np.concatenate([*points, [[90, 20]]])
    (x0, x1), (y0, y1) = ax.get_xlim(), ax.get_ylim()
    assert np.all((corners >= [x0, y0]) & (corners <= [x1, y1]))
    assert ax.get_aspect() == 1.0
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("x [mm]", "y [mm]")


def test_legend_names_each_thing_once_and_covers_no_axes(tmp_path: Path) -> None:
    ax = Figure().subplots()
    plot_mechanism(loaded(), ax)
    texts = legend_texts(ax)
    assert len(texts) == len(set(texts)) == 4
    figure = ax.figure
    assert isinstance(figure, Figure)
    save_figure(figure, tmp_path / "a.png")
    legend = ax.get_legend()
    assert legend is not None
    assert legend.get_window_extent().x0 > ax.get_window_extent().x1


def test_family_shares_one_scale_and_draws_a_shared_base_once(ax: Axes) -> None:
    chain, forces = five_link(), (0.0, 0.5, 1.0, 1.5)
    equilibria = [solve_tensions(chain, (6, 3), [WorldForce(-1, (f, 0))]) for f in forces]
    plot_family(equilibria, [f"{f} N" for f in forces], ax)
    [drawn] = arrows(ax).values()
    np.testing.assert_allclose([tip - tail for tail, tip in drawn], [[10 * f, 0] for f in forces[1:]])
    assert legend_texts(ax) == ["0.0 N", "0.5 N", "1.0 N", "1.5 N", "external force (10 mm per N)"]
    assert len(ax.patches) == 4 * (chain.n_links - 1) + 1


def test_family_refuses_wrong_counts() -> None:
    with pytest.raises(InvalidInput, match=r"labels = .*1 entries"):
        plot_family([loaded()], [])
    with pytest.raises(InvalidInput, match=r"colors = .*1 entries"):
        plot_family([loaded()], ["a"], colors=["red", "blue"])
    with pytest.raises(InvalidInput, match="one or more"):
        plot_family([], [])


def test_batch_is_refused() -> None:
    with pytest.raises(InvalidInput, match="one equilibrium"):
        plot_mechanism(solve_tensions_batch(five_link(), [[1, 1], [2, 1]]))


@pytest.mark.parametrize("force", [1e-9, 0.013, 0.5, 7.0, 2e6])
def test_scale_is_round_and_keeps_the_longest_arrow_moderate(force: float) -> None:
    eq = loaded()
    table = eq.loads.copy()
    table[0, 3:5] = (0.0, force)
    scale = arrow_scale([replace(eq, loads=table)])
    assert f"{scale:.0e}"[0] in "125"
    assert scale == pytest.approx(float(f"{scale:.0e}"))
    assert 0.08 * eq.mechanism.length < scale * force <= 0.22 * eq.mechanism.length * (1 + 1e-9)


def test_new_axes_are_made_when_none_are_given() -> None:
    before = pyplot.get_fignums()
    assert plot_mechanism(solve_lengths(five_link(), (86, 108))).figure.number not in before


@pytest.mark.parametrize("suffix", ["png", "pdf", "svg", "PNG"])
def test_figure_is_saved_in_the_format_of_its_suffix(suffix: str, tmp_path: Path, ax: Axes) -> None:
    plot_mechanism(loaded(), ax)
    figure = ax.figure
    assert isinstance(figure, Figure)
    head = save_figure(figure, tmp_path / f"a.{suffix}").read_bytes()[:200]
    assert {"png": b"PNG", "pdf": b"%PDF", "svg": b"<?xml"}[suffix.lower()] in head


def test_unknown_suffix_and_missing_folder_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match=r"a\.doc.*\.png"):
        save_figure(Figure(), tmp_path / "a.doc")
    with pytest.raises(InvalidInput, match="existing folder"):
        save_figure(Figure(), tmp_path / "none" / "a.png")


@pytest.mark.slow
def test_import_of_plot_and_cli_leaves_matplotlib_alone() -> None:
    script = "import sys, rollingjoint.plotting.planar, rollingjoint.cli; sys.exit('matplotlib' in sys.modules)"
    root = Path(__file__).resolve().parents[3]
    assert subprocess.run([sys.executable, "-c", script], cwd=root, check=False).returncode == 0
