"""Walls in a person's hands, without a browser and in one."""

import math
from dataclasses import replace

import numpy as np
import pytest

from agents.view import main
from agents.viewer.around import FARTHEST, Around, WallScene
from agents.viewer.explorer import LENGTHS, Explorer
from agents.viewer.rooms.explore import PER_NEWTON, PRESSED, STICKS
from rollingjoint import (
    Capsule,
    Disc,
    HalfPlane,
    InvalidInput,
    Lumen,
    Plane,
    Polygon,
    Sleeve,
    Status,
    Surroundings,
    solve_tensions,
)
from rollingjoint.chain import se3
from rollingjoint.chain.presets import small_arm, two_segment
from tests.agents.viewer.conftest import until

TURNED = (3.0, -4.0, -0.5 * math.pi)


def explorer_in(name, scene=None):
    explorer = Explorer(two_segment(), "two_segment", {} if scene is None else {name: scene})
    explorer.change(around=explorer.scenes[name].begun(name))
    return explorer


def set_walls(explorer, **numbers):
    explorer.change(around=replace(explorer.inputs.around, **numbers))


def test_what_is_pushed_in_is_the_equilibrium_that_solvers_reach_on_the_way():
    explorer = explorer_in("a lumen")
    set_walls(explorer, feed=100.0)
    scene, start = explorer.scene, None
    for feed in np.linspace(0.0, 100.0, 51):
        start = solve_tensions(
            two_segment(), (3.0,) * 4, surroundings=scene.surroundings, base=(0, feed, 0), start=start
        )
    np.testing.assert_allclose(explorer.found.tip, start.tip, atol=1e-7)
    assert len(explorer.wall_table) == len(start.wall_contacts) > 0
    assert [start.wall_gaps[touch.candidate] for touch in start.wall_contacts] == pytest.approx(
        [touch.gap for touch in start.wall_contacts], abs=1e-9
    )
    assert f"{start.insertion_force:.2f} N push the base" in explorer.wall_line


def test_the_nearest_wall_is_told_where_none_is_touched():
    explorer = explorer_in("mine", WallScene(Surroundings([HalfPlane((0, -1), -140.0)], Sleeve(5.0))))
    assert explorer.found.wall_gaps.min() == pytest.approx(140.0 - 97.5 - 5.0)
    assert f"the nearest {explorer.found.wall_gaps.min():.1f} mm away" in explorer.wall_line


def test_contacts_stick_where_the_way_turns_back_and_slip_after():
    explorer = explorer_in("a lumen")
    set_walls(explorer, feed=100.0, friction=0.2)
    set_walls(explorer, feed=110.0)
    assert " 0 stick" in explorer.wall_line
    set_walls(explorer, feed=109.99)
    assert {row[-1] for row in explorer.wall_table} == {"sticks"} and all(stick for *_, stick in explorer.wall_arrows)


def test_walls_get_to_their_places_in_steps():
    lumen = Lumen([40, 40], [0.01, 0], 15)
    scene = WallScene(Surroundings([HalfPlane((1, 0), -80), Disc((40, 60), 5), lumen]))
    begin = scene.begun("mine")
    assert scene.steps(begin, replace(begin, moved=((3.0, 4.0),))) == math.ceil(5.0 / FARTHEST)
    assert scene.steps(begin, replace(begin, feed=-7.0)) == 4
    assert scene.steps(begin, replace(begin, stiffness=3.0)) == 1
    half = begin.on_the_way(replace(begin, moved=((3.0, 4.0),), bend=2.0, friction=0.1), 0.5)
    assert half == Around("mine", ((1.5, 2.0),), 1.5, 0.0, None, 0.1)


def test_obstacles_of_every_kind_are_moved_and_laws_changed():
    walls = [Disc((1, 2), 3), Capsule((0, 0), (4, 0), 1), Polygon([(0, 0), (3, 0), (0, 3)]), HalfPlane((1, 0))]
    scene = WallScene(Surroundings(walls))
    around = replace(scene.begun("mine"), moved=((1, 1), (2, 0), (0, 3)), stiffness=5.0, friction=0.3)
    disc, capsule, polygon, plane = scene.walls(around).walls
    assert disc.centre == (2, 3) and (capsule.first, capsule.second) == ((2, 0), (6, 0))
    assert polygon.points == ((0, 3), (3, 3), (0, 6)) and plane.offset == 0.0
    assert {wall.stiffness for wall in (disc, capsule, polygon, plane)} == {5.0}
    assert scene.walls(around).friction.mu == 0.3
    np.testing.assert_allclose(scene.places(around), [(2, 3), (4, 0), (1, 4)])


def test_a_lumen_that_cannot_be_bent_so_far_changes_nothing():
    scene = WallScene(Surroundings([Lumen([60, 40], [0.03, 0], 18)]))
    explorer = explorer_in("mine", scene)
    before = explorer.inputs
    with pytest.raises(InvalidInput, match="the bend radius of piece 0"):
        set_walls(explorer, bend=2.0)
    assert explorer.inputs == before


def test_a_turned_base_turns_poses_forces_and_reach():
    scene = WallScene(Surroundings([HalfPlane((0, 1), -16.0, stiffness=5.0)]), TURNED)
    explorer = explorer_in("mine", scene)
    explorer.change(tensions=(3.0, 6.0, 3.0, 6.0), force=(0.1, 0.2))
    poses = explorer.poses(explorer.found)
    np.testing.assert_allclose(poses[0], TURNED)
    x, y = explorer.found.tip
    np.testing.assert_allclose(poses[-1, :2], (3.0 + y, -4.0 - x), atol=1e-12)
    np.testing.assert_allclose(explorer.in_base(explorer.in_world(np.array([0.1, 0.2]), turned_only=True)), (0.1, 0.2))
    places = np.array([place for place, *_ in explorer.wall_arrows])
    assert len(places) and np.abs(places[:, 1] + 16.0).max() < 0.5  # at the wall
    assert all(force[1] > 0.0 for _, force, _ in explorer.wall_arrows)
    assert explorer.reached()[:, 1].min() > -16.0 - 15.0


def test_a_step_that_ends_in_another_pose_is_told():
    explorer = explorer_in("an obstacle")
    explorer.change(tensions=(0.5, 14.0, 0.5, 14.0))
    assert "jumped" not in explorer.wall_line
    set_walls(explorer, moved=((-80.0, 0.0),))
    assert explorer.jumped == ("jumped" in explorer.wall_line)
    explorer.jumped = True
    assert explorer.wall_line.startswith("⚠ **jumped**")


def test_rigid_walls_without_room_are_told():
    walls = [HalfPlane((1, 0), -9.0), HalfPlane((-1, 0), -9.0)]  # 18 mm for links of 22.6
    explorer = explorer_in("mine", WallScene(Surroundings(walls, rigid=True)))
    assert explorer.found.status is Status.NO_ROOM and explorer.headline.startswith("⚠ **NO_ROOM**: no room")
    assert explorer.wall_line == "" and explorer.wall_table == []


@pytest.mark.parametrize("drive", [{}, {"drive": LENGTHS}])
def test_the_program_solves_the_same_among_walls(drive, capsys):
    explorer = explorer_in("a lumen")
    set_walls(explorer, feed=105.0)
    explorer.change(force=(0.05, 0.0), **drive)
    names = {}
    exec(explorer.python, names)
    assert names["found"].tip == pytest.approx(explorer.found.tip, abs=1e-6)
    assert capsys.readouterr().out.startswith("stable equilibrium [")


def test_a_wall_that_is_dragged_through_the_chain_is_refused():
    rigid = Surroundings([Capsule((-60.0, 55.0), (-30.0, 55.0), 1.0, stiffness=1e-3)], Sleeve(0.1))
    explorer = explorer_in("mine", WallScene(rigid))
    before = explorer.inputs, explorer.found
    with pytest.raises(InvalidInput, match=r"a way around the chain\. Capsule 0 would pass through it"):
        set_walls(explorer, moved=((90.0, 0.0),))
    assert (explorer.inputs, explorer.found) == before
    set_walls(explorer, moved=((20.0, 0.0),))
    assert explorer.inputs.around.moved == ((20.0, 0.0),) and explorer.found.ok


ARM_BASE = (1.0, -2.0, 3.0, 0.1, -0.2, 0.3)


def arm_in(name, scene=None):
    explorer = Explorer(small_arm(), "small_arm", {} if scene is None else {name: scene})
    explorer.change(around=explorer.scenes[name].begun(name))
    return explorer


def test_an_arm_is_pushed_into_a_tube_that_is_bent():
    explorer = arm_in("a lumen")
    set_walls(explorer, feed=100.0)
    assert len(explorer.wall_table) > 0 and explorer.wall_table[0][1] == "tube 0"
    assert explorer.places[0] == pytest.approx((0.0, 0.0, 100.0))
    ((vertices, faces),) = explorer.wall_solids
    assert vertices.shape[1] == 3 and faces.max() == len(vertices) - 1
    assert np.hypot(*vertices[:5, :2].T) == pytest.approx(1.35 * 15.0)  # around the straight end of the tube
    set_walls(explorer, bend=0.5)
    assert explorer.found.ok and f"{explorer.found.insertion_force:.2f} N push the base" in explorer.wall_line


def test_a_turned_base_in_space_turns_poses_and_forces():
    scene = WallScene(Surroundings([Plane((0, 0, -1), -80.0, stiffness=5.0)], Sleeve(15.0)), ARM_BASE)
    explorer = arm_in("mine", scene)
    set_walls(explorer, feed=8.0)
    explorer.change(force=(0.1, 0.2, 0.0))
    found, turn = explorer.found, se3.rotation(ARM_BASE[3:])
    np.testing.assert_allclose(found.base_among_walls, [*(np.array(ARM_BASE[:3]) + 8.0 * turn[:, 2]), *ARM_BASE[3:]])
    np.testing.assert_allclose(explorer.places[-1], turn @ found.tip + found.base_among_walls[:3], atol=1e-12)
    place, force, _ = explorer.wall_arrows[0]
    assert abs(place[2] - 80.0) < 1.0 and force == pytest.approx((0.0, 0.0, -np.linalg.norm(force)))
    np.testing.assert_allclose(
        explorer.in_base(explorer.in_world(np.eye(3)[0], turned_only=True)), np.eye(3)[0], atol=1e-12
    )


def test_a_sphere_is_moved_and_the_program_solves_the_same():
    explorer = arm_in("an obstacle")
    start = explorer.scene.places(explorer.inputs.around)[0]
    set_walls(explorer, moved=((-5.0, 0.0, 0.0),))
    assert explorer.scene.places(explorer.inputs.around)[0] == pytest.approx(start - [5.0, 0.0, 0.0])
    names = {}
    exec(explorer.python, names)
    assert names["found"].tip == pytest.approx(explorer.found.tip, abs=1e-6)


def test_scenes_of_files_are_around_chains_of_their_kind():
    flat = WallScene(Surroundings([HalfPlane((1, 0), -80)]))
    assert "mine" in Explorer(two_segment(), files={"mine": flat}).scenes
    assert "mine" not in Explorer(small_arm(), files={"mine": flat}).scenes


def test_a_base_without_surroundings_is_refused(capsys):
    assert main(["--base", "1", "2", "3"]) == 2
    assert "--surroundings beside it" in capsys.readouterr().err


@pytest.mark.slow
def test_walls_are_chosen_pushed_into_bent_and_dragged(guests):
    guest = guests(room="Explore")
    room, page, before = guest.room, guest.page, guest.pixels()
    page.get_by_label("Around the chain").click()
    page.get_by_role("option", name="a lumen", exact=True).click()
    until(lambda: room.explorer.inputs.around.walls == "a lumen")
    page.get_by_text("N push the base").wait_for()
    guest.settle()
    assert len(room._shapes) == 2 and guest.pixels() != before
    page.get_by_role("slider").nth(2).press("End")  # the third, after those of two tendons: push in
    until(lambda: room.explorer.inputs.around.feed == 150.0)
    feeding = guest.pixels()
    page.get_by_role("slider").nth(3).press("End")
    until(lambda: room.explorer.inputs.around.bend == 2.0)
    assert guest.pixels() != feeding and page.get_by_role("cell", name="lumen 0").count() >= 1
    page.get_by_label("Around the chain").click()
    page.get_by_role("option", name="an obstacle", exact=True).click()
    until(lambda: room.explorer.inputs.around.walls == "an obstacle")
    guest.settle()
    room.drag_obstacle(0, np.array([-5.0, 55.0, 0.0]))  # as the cross does
    until(lambda: "contact" in page.inner_text("body"))
    assert page.get_by_text("Push in [mm]").count() == 1 and page.get_by_text("Bend").count() == 0
    (place, force, _), arrows = room.explorer.wall_arrows[0], room.explorer.wall_arrows
    assert np.hypot(*force) * PER_NEWTON > 0.0 and len(arrows) == len(room.explorer.found.wall_contacts)
    assert PRESSED != STICKS and np.hypot(*(place - (-5.0, 55.0))) < 12.0
