"""Pictures of chains in space: what is drawn where."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import matplotlib
import numpy as np
import pytest

matplotlib.use("Agg")

from matplotlib import pyplot

from rollingjoint import (
    InvalidInput,
    Spring,
    WorldForce,
    five_link,
    pitch_yaw,
    small_arm,
    solve_tensions,
    solve_tensions_batch,
)
from rollingjoint.plotting import plot_arm


@pytest.fixture(autouse=True)
def close_figures() -> Iterator[None]:
    yield
    pyplot.close("all")


def test_tendons_run_through_their_holes_and_slack_ones_are_dashed():
    arm = small_arm()
    found = solve_tensions(arm, [5.0, 0.0, 0.0, 1.0], [arm.gravity((0, 0, 1))])
    ax = plot_arm(found, label="bent")
    axis, *tendons = ax.lines
    assert np.array(axis.get_data_3d()) == pytest.approx(found.positions.T)
    for line, expected in zip(tendons, arm.tendon_polyline(found.poses), strict=True):
        assert np.array(line.get_data_3d()) == pytest.approx(expected.T)
    assert [line.get_linestyle() for line in tendons] == ["-", "--", "--", "-"]
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["bent", "tendon 0: 5 N", "tendon 3: 1 N"]


def test_forces_are_arrows_and_weights_are_not():
    arm = small_arm()
    found = solve_tensions(arm, np.zeros(4), [arm.gravity((1, 0, 0)), WorldForce(-1, (0.3, 0.4, 0.0))])
    bare = plot_arm(found, tendons=False, loads=False)
    ax = plot_arm(found, tendons=False)
    assert len(ax.collections) == len(bare.collections) + 1
    assert "0.5 N" in [text.get_text() for text in ax.get_legend().get_texts()]


def test_springs_are_dotted_lines_to_their_anchors():
    arm, anchor = small_arm(), (30.0, 5.0, 70.0)
    found = solve_tensions(arm, np.zeros(4), [Spring(-1, 0.05, anchor, point=(0.0, 2.0, 0.0))])
    ax = plot_arm(found, tendons=False)
    begin, end = np.array(ax.lines[-1].get_data_3d()).T
    assert begin == pytest.approx(found.poses[-1, :3, :3] @ (0.0, 2.0, 0.0) + found.tip) and end == pytest.approx(
        anchor
    )
    assert "spring 0.05 N/mm" in [text.get_text() for text in ax.get_legend().get_texts()]


@pytest.mark.parametrize(
    ("half_width", "color", "text"),
    [
        (4.0, "#2ca02c", "contact line, both ends pressed"),
        (1.5, "#ff9f1c", "contact line, one end pressed little"),
        (0.5, "#d62728", "contact line, one end lifts"),
    ],
)
def test_contact_lines_have_the_colour_of_their_margin_and_a_dot_at_the_centre_of_pressure(half_width, color, text):
    chain = pitch_yaw(3)
    chain = chain.replace(joints=[replace(joint, half_width=half_width) for joint in chain.joints])
    at = solve_tensions(chain, [3.0, 2.0, 2.0, 6.0])
    lines = plot_arm(at, tendons=False).lines[1:]
    drawn = [line for line in lines if line.get_label() == text]
    assert drawn and {line.get_color() for line in drawn} == {color}
    assert {"contact line, one end lifts"} & {line.get_label() for line in lines} == (
        {text} if np.any(at.tilting_margins < 0.0) else set()
    )
    dots = [line for line in lines if line.get_marker() == "o"]
    assert len(lines) - len(dots) == 3 and len(dots) == np.sum(at.tilting_margins >= 0.0)
    ends = np.array(next(line for line in lines if line.get_marker() != "o").get_data_3d()).T
    assert ends.mean(axis=0) == pytest.approx(at.contact_points[0])
    assert np.abs(ends[1] - ends[0]) == pytest.approx([0.0, 2.0 * half_width, 0.0], abs=1e-9)
    assert len(plot_arm(at, tendons=False, contacts=False).lines) == 1


def test_contact_surfaces_are_drawn_over_the_width_of_their_lines():
    chain = pitch_yaw(2)
    at = solve_tensions(chain, [3.0, 2.0, 2.0, 4.0])
    bare = len(plot_arm(small_arm(2), tendons=False).collections)
    assert len(plot_arm(at, tendons=False).collections) == bare + 2
    for link, outline in enumerate(chain.outlines()):
        sides = [(i, side) for i, side in ((link, "child"), (link - 1, "parent")) if 0 <= i < chain.n_joints]
        assert len(outline.strips) == len(sides) and (outline.low, outline.high) == (-1.7, 1.7)
        for strip in outline.strips:
            fits = []
            for i, side in sides:
                joint, surface = chain.joints[i], getattr(chain.joints[i], side)
                lateral, height, along = np.moveaxis(strip @ joint.frame.T, -1, 0)
                curve = surface.point(np.linspace(*surface.limits, len(strip)))[:, None]
                fits.append(
                    np.allclose(np.stack([lateral, height], axis=-1), curve) and np.allclose(np.abs(along), 4.0)
                )
            assert any(fits)


def test_rails_are_closed_and_seen_from_outside():
    trimesh = pytest.importorskip("trimesh")
    for outline in pitch_yaw(2).outlines():
        for rail in outline.rails:
            triangles = np.concatenate([face[[[0, 1, 2], [0, 2, 3]]] for face in rail])
            mesh = trimesh.Trimesh(**trimesh.triangles.to_kwargs(triangles))
            assert mesh.is_watertight and 5.0 < mesh.volume < 20.0


def test_forces_on_teeth_and_straps_are_arrows_with_the_largest_in_the_legend():
    chain = pitch_yaw(4)
    chain = chain.replace(joints=[replace(joint, half_width=0.5) for joint in chain.joints])
    at = solve_tensions(chain, [2.0, 1.0, 2.0, 4.0], [WorldForce(-1, (0.3, 0.0, 0.0), (0.0, 0.0, 3.0))])
    texts = [text.get_text() for text in plot_arm(at).get_legend().get_texts()]
    assert f"straps: up to {at.strap_forces.max():.2g} N" in texts
    assert f"teeth beside friction of 0.3: up to {at.tooth_forces().max():.2g} N" in texts
    with_friction = [text.get_text() for text in plot_arm(at, friction=0.1).get_legend().get_texts()]
    assert f"teeth beside friction of 0.1: up to {at.tooth_forces(0.1).max():.2g} N" in with_friction
    wide = solve_tensions(pitch_yaw(4), [3.0, 3.0, 3.0, 3.0])
    assert not any(word in str(plot_arm(wide).get_legend().get_texts()) for word in ("teeth", "straps"))


@pytest.mark.parametrize("tensions", [[5.0, 5.0, 5.0, 5.0], [2.0, 3.0, 2.0, 2.0]])
def test_axes_of_slim_chains_are_wide_enough_for_their_labels(tensions):
    ax = plot_arm(solve_tensions(pitch_yaw(12), tensions))
    spans = np.diff([ax.get_xlim(), ax.get_ylim(), ax.get_zlim()]).ravel()
    assert spans[:2].min() > 0.4 * spans[2]
    assert not ax.patch.get_visible() and ax.get_zlabel() == "z [mm]"


def test_a_mechanism_is_drawn_at_rest_and_beads_reach_around_their_holes():
    arm = small_arm(2)
    ax = plot_arm(arm)
    assert (ax.zz_dataLim.x0, ax.zz_dataLim.x1) == pytest.approx((-4.0, 40.0))  # the base's holes; the distal face
    assert ax.xy_dataLim.x1 == pytest.approx(1.15 * 15.0)
    assert ax.get_legend() is None


def test_only_one_hinge_chain_can_be_drawn():
    arm = small_arm()
    for wrong in (solve_tensions_batch(arm, np.ones((2, 4))), five_link(), None):
        with pytest.raises(InvalidInput, match="one HingeEquilibrium"):
            plot_arm(wrong)
