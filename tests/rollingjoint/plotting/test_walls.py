"""Pictures among walls: what is drawn where."""

import matplotlib
import numpy as np
import pytest

matplotlib.use("Agg")

from matplotlib import pyplot
from matplotlib.figure import Figure

from rollingjoint import (
    Capsule,
    Disc,
    HalfPlane,
    InvalidInput,
    Lumen,
    Polygon,
    Sleeve,
    Surroundings,
    WallFriction,
    WorldForce,
    solve_lengths,
)
from rollingjoint.chain.outline import rotation, to_world
from rollingjoint.plotting import plot_family, plot_mechanism, plot_wall_contacts
from rollingjoint.plotting.walls import in_world, places_and_forces
from rollingjoint.surroundings.shapes import closed, stadium, wall_lumens
from tests.rollingjoint.walls.scenes import CHAIN, LIMITS, REST

LUMEN = Lumen([30, 40, 40, 30], [0, 0.02, -0.02, 0], [8, 8, 8, 7.5, 7.5], stiffness=2)
BASE = (1.0, 40.0, 0.1)


@pytest.fixture(autouse=True)
def close_figures():
    yield
    pyplot.close("all")


def pressed(base=BASE, walls=(LUMEN,), loads=()):
    lengths = REST + np.array([-2.0, 1.8, 2.0, -2.0])
    around = Surroundings(walls, Sleeve(5.0))
    return solve_lengths(CHAIN, lengths, loads, surroundings=around, base=base, tension_limits=LIMITS).require()


def test_everything_is_drawn_in_the_frame_of_the_walls():
    eq = pressed(loads=[WorldForce(-1, (0.1, 0.0))])
    moved = in_world(eq)
    np.testing.assert_allclose(moved.poses[0], BASE)
    np.testing.assert_allclose(moved.poses[-1, :2], to_world(np.array(BASE), eq.poses[-1, :2]))
    np.testing.assert_allclose(moved.loads[0, 3:5], rotation(BASE[2]) @ [0.1, 0.0])
    ax = plot_mechanism(eq, Figure().subplots())
    dots = next(c for c in ax.collections if len(c.get_offsets()) == len(eq.wall_contacts))
    wall = np.concatenate(LUMEN.sides(np.linspace(0, 140, 4001)))
    assert max(np.hypot(*(wall - dot).T).min() for dot in dots.get_offsets()) < 0.03  # pressed points are on the wall
    words = [text.get_text() for text in ax.get_legend().get_texts()]
    assert "wall" in words and "outline" in words and any(word.startswith("wall force (") for word in words)


def test_arrows_are_the_wall_forces_of_the_links():
    eq = pressed(walls=[Lumen([30, 40, 40, 30], [0, 0.02, -0.02, 0], 8, stiffness=2)])
    _, forces = places_and_forces(eq)
    total = np.zeros((CHAIN.n_links, 2))
    np.add.at(total, [touch.link for touch in eq.wall_contacts], forces)
    np.testing.assert_allclose(total, eq.wall_forces[:, :2] @ rotation(BASE[2]).T, atol=1e-9)


def test_lumens_come_back_from_the_arrays_of_kernels():
    step = pressed().walls
    (lumen,) = wall_lumens(step.walls, step.which)
    t = np.linspace(-10, 150, 50)
    np.testing.assert_allclose(lumen.pose(t), LUMEN.pose(t), atol=1e-12)
    np.testing.assert_allclose(lumen.radius(t), LUMEN.radius(t), atol=1e-12)


def test_obstacles_are_drawn_once_for_a_family():
    walls = [
        HalfPlane((1, 0), -22),
        Disc((30, 60), 5),
        Capsule((40, 0), (40, 30), 2),
        Polygon([(50, 0), (60, 0), (55, 9)]),
    ]
    around = Surroundings(walls, Sleeve(5.0))
    family = [
        solve_lengths(CHAIN, CHAIN.neutral_lengths - 0.2, surroundings=around, base=(0, y, 0)) for y in (0.0, 30.0)
    ]
    ax = plot_family(family, ["0", "30"], Figure().subplots())
    drawn = [patch for patch in ax.patches if patch.get_label() == "wall"]
    assert len(drawn) == 1 + 1 + 1 + 3
    assert not [patch for patch in plot_mechanism(family[0], walls=False).patches if patch.get_label() == "wall"]


def test_the_outline_of_a_bar_is_its_radius_away_from_its_axis():
    first, second = np.array([1.0, 2.0]), np.array([4.0, 6.0])
    outline = closed(stadium(first, second, 1.5))
    along = np.clip((outline - first) @ (second - first) / 25.0, 0.0, 1.0)
    np.testing.assert_allclose(np.hypot(*(outline - first - along[:, None] * (second - first)).T), 1.5)


def test_a_path_shows_stick_slip_and_the_force_on_the_base():
    around = Surroundings([LUMEN], Sleeve(5.0), WallFriction(0.2))
    feeds = [30.0, 31.0, 32.0, 31.99]
    path = [solve_lengths(CHAIN, REST, surroundings=around, base=(0, feeds[0], 0))]
    for feed in feeds[1:]:
        path.append(solve_lengths(CHAIN, REST, surroundings=around, base=(0, feed, 0), history=path[-1]))
    figure = plot_wall_contacts(path, feeds)
    top = figure.axes[0]
    states = [touch.state for eq in path for touch in eq.wall_contacts]
    np.testing.assert_allclose(top.collections[0].get_array(), states)
    held = [touch for eq in path for touch in eq.wall_contacts if touch.sticks]
    assert len(top.lines[0].get_xdata()) == len(held) > 0
    forces = next(ax for ax in figure.axes if ax.get_ylabel().startswith("insertion"))
    np.testing.assert_allclose(forces.lines[0].get_ydata(), [eq.insertion_force for eq in path])
    with pytest.raises(InvalidInput, match="3 equilibria among walls, one per input"):
        plot_wall_contacts(path, feeds[:3])
