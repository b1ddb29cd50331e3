"""Walls around chains in space: against energies in plain NumPy, planar scenes, balances, and closed cycles."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

import rollingjoint as rj
from benchmarks.walls_in_space import walk
from rollingjoint.chain import se3
from rollingjoint.statics import sensitivity
from rollingjoint.surroundings import walls_through
from tests.attack.around_space import Recomputed, frame_of

ARM = rj.small_arm()
REST = ARM.neutral_lengths - 2.0 / ARM.stiffnesses
LIMITS = (0.5, 30.0)
BASE = (0.4, -0.3, 0.5, 0.03, -0.02, 0.04)
COMMAND = REST + np.array([-4.0, -2.0, 4.0, 2.0])
TUBE = rj.Tube.through([(0, 0, -60), (0, 0, 30), (6, 3, 60), (2, 8, 110)], [17, 17, 16, 17], 40.0, stiffness=2.0)
SCENES = {
    "plane": [rj.Plane((-0.8, -0.6, 0.05), -16.0, stiffness=2.0, toe=0.5)],
    "sphere": [rj.Sphere((19.0, 14.5, 62.0), 8.0, stiffness=2.0)],
    "capsule": [rj.Capsule((24.8, -9.9, 40.0), (12.8, 30.1, 70.0), 4.0, stiffness=2.0)],
    "tube": [TUBE],
}
ALL = [wall for walls in SCENES.values() for wall in walls]


def around(name, mu=0.0, presliding=0.05, outline=None, **settings):
    friction = rj.WallFriction(mu, presliding) if mu else None
    walls = ALL if name == "all" else SCENES[name]
    return rj.Surroundings(walls, outline or rj.Sleeve(15.0), friction, **settings)


def solved(walls, command=COMMAND, base=BASE, chain=ARM, **more):
    return rj.solve_lengths(chain, command, surroundings=walls, base=base, tension_limits=LIMITS, **more).require()


def differences(function, at, step):
    """d function / d at by central differences, (..., at)."""
    ends = [[function(at + sign * step * e) for sign in (1.0, -1.0)] for e in np.eye(len(at))]
    return np.stack([(np.asarray(high) - np.asarray(low)) / (2.0 * step) for high, low in ends], axis=-1)


OUTLINES = {"sleeve": None, "bare": rj.Bare(2.0, 3, 5)}
SLOW = {("tube", "bare"), ("all", "bare")}
CASES = [
    pytest.param(name, OUTLINES[outline], id=f"{name}-{outline}", marks=[pytest.mark.slow] * ((name, outline) in SLOW))
    for name in (*SCENES, "all")
    for outline in OUTLINES
]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "outline"), CASES)
def test_an_equilibrium_is_a_minimum_of_an_energy_in_numpy(name, outline):
    walls = around(name, outline=outline)
    equilibrium = solved(walls)
    assert equilibrium.wall_contacts or (outline is not None and name in ("sphere", "capsule"))  # bare links are slim
    energy = Recomputed(ARM, walls, COMMAND, LIMITS, BASE)
    angles = np.array(equilibrium.joint_angles)
    np.testing.assert_allclose(equilibrium.wall_gaps, energy.gaps(angles), atol=1e-10)
    assert np.abs(energy.residual(angles)).max() < 2e-6
    found = minimize(energy.energy, angles + 0.01 * np.array([1, -1, 1, -1]), method="BFGS", options={"gtol": 1e-6})
    tip = (frame_of(BASE) @ ARM.poses(found.x))[-1, :3, 3]
    np.testing.assert_allclose(tip, (frame_of(BASE) @ equilibrium.poses)[-1, :3, 3], atol=2e-4)
    assert found.fun > energy.energy(angles) - 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("name", [*SCENES, "all"])
def test_stiffness_and_motion_of_the_base_are_derivatives_of_the_moments(name):
    walls = around(name)
    equilibrium = solved(walls)
    again = Recomputed(ARM, walls, COMMAND, LIMITS, BASE)
    angles = np.array(equilibrium.joint_angles)
    H = differences(again.residual, angles, 2e-5)
    np.testing.assert_allclose(equilibrium.stiffness, H, atol=2e-6 * np.abs(H).max())
    base = frame_of(BASE)

    def displaced(twist):  # of the base in its own frame
        pose = base @ frame_of(twist)
        vector = np.concatenate([pose[:3, 3], se3.rotation_vector(pose[:3, :3])])
        return Recomputed(ARM, walls, COMMAND, LIMITS, vector)

    S = differences(lambda twist: displaced(twist).residual(angles), np.zeros(6), 2e-5)
    np.testing.assert_allclose(equilibrium.base_torques, S, atol=5e-6 * np.abs(S).max())

    def force(numbers):  # of all walls, in the frame of the base
        case = displaced(numbers[4:])
        total = sum(wrench[:3] for *_, wrench in case.contacts(numbers[:4]))
        return frame_of(case.base)[:3, :3].T @ total

    F = differences(force, np.concatenate([angles, np.zeros(6)]), 2e-5)
    np.testing.assert_allclose(equilibrium.wall_force_rates, F, atol=1e-5 * np.abs(F).max())


def test_derivatives_of_the_insertion_force():
    walls = around("all")
    at = solved(walls)

    def pushed(twist):  # of the base in its own frame
        pose = frame_of(BASE) @ frame_of(twist)
        vector = np.concatenate([pose[:3, 3], se3.rotation_vector(pose[:3, :3])])
        return solved(walls, base=vector, start=at).insertion_force

    for given, expected in (
        (sensitivity.dinsertion_dbase(at), differences(pushed, np.zeros(6), 2e-5)),
        (
            sensitivity.dinsertion_dlengths(at),
            differences(lambda command: solved(walls, command, start=at).insertion_force, COMMAND, 2e-5),
        ),
    ):
        np.testing.assert_allclose(given, expected, atol=2e-5 * np.abs(expected).max())


def steps_with_friction(name, presliding, count=3, mu=0.3):
    """Walls, and every step of a path: command, base, equilibrium, and the one before it."""
    walls, rng = around(name, mu, presliding), np.random.default_rng(5)
    command, base = COMMAND.copy(), np.array(BASE)
    before, steps = solved(walls), []
    for _ in range(count):
        command = command + rng.uniform(-0.4, 0.4, 4)
        base = base + np.concatenate([rng.uniform(-0.1, 0.1, 3), rng.uniform(-0.01, 0.01, 3)])
        after = solved(walls, command, base, history=before)
        steps.append((command, base, after, before))
        before = after
    return walls, steps


def past_of(before):
    memory = before.walls.memory
    states = np.zeros((*np.shape(before.walls.normals), 3)) if memory is None else memory.states
    return frame_of(before.walls.base) @ before.poses, states


@pytest.mark.slow
@pytest.mark.parametrize("name", [*SCENES, "all"])
def test_a_step_with_friction_is_in_balance_and_its_stiffness_a_derivative(name):
    walls, steps = steps_with_friction(name, 0.4)
    rubbed = 0
    for command, base, after, before in steps:
        again, angles = Recomputed(ARM, walls, command, LIMITS, base, past_of(before)), np.array(after.joint_angles)
        assert np.abs(again.residual(angles)).max() < 2e-6
        for c, _, state, _ in again.contacts(angles):
            np.testing.assert_allclose(after.walls.states[c], state, atol=1e-7)
        rubbed += sum(touch.state > 0.01 for touch in after.wall_contacts)
        if before.walls.memory is None:
            continue
        begun = replace(after, walls=replace(after.walls, memory=before.walls.memory))
        A = differences(again.residual, angles, 5e-6)
        np.testing.assert_allclose(begun.stiffness, A, atol=1e-4 * np.abs(A).max())
        assert np.abs(A - A.T).max() > 1e-4 * np.abs(A).max()
    assert rubbed


def flat_pair():
    """A planar chain, and the same chain in the plane y = 0 of space."""
    flat = rj.two_segment(3, 2, height=10.0, radius=7.0, half_width=5.0)
    pairs = zip(flat.links[:-1], flat.links[1:], strict=True)
    joints = [rj.RollingContact(0.0, parent=above.parent, child=below.child, half_width=2.0) for below, above in pairs]
    tendons = [
        rj.SpaceTendon([((a, 0.0, b), (c, 0.0, d)) for (a, b), (c, d) in holes], tendon.end, tendon.stiffness)
        for tendon, holes in zip(flat.tendons, flat.hole_points, strict=True)
    ]
    space = rj.SpatialChain(joints, tendons)
    top = space.link_axes.copy()
    top[-1, 1, 2] = flat.links[-1].child.start[1]  # not its highest hole
    space.__dict__["link_axes"] = top
    return flat, space


PLANAR = {
    "plane": ([rj.HalfPlane((1, 0.2), -9.0, stiffness=2.0)], [rj.Plane((1, 0, 0.2), -9.0, stiffness=2.0)], 1.0),
    "sphere": ([rj.Disc((12, 40), 5.0, stiffness=2.0)], [rj.Sphere((12, 0, 40), 5.0, stiffness=2.0)], -1.0),
    "tube": (
        [rj.Lumen.through([(0, -40), (0, 20), (-20, 50), (-20, 90)], [6.5, 6.5, 6, 6], 30.0)],
        [rj.Tube.through([(0, 0, -40), (0, 0, 20), (-20, 0, 50), (-20, 0, 90)], [6.5, 6.5, 6, 6], 30.0)],
        1.0,
    ),
    "capsule": (
        [rj.Capsule((12, 36), (20, 52), 4.0, stiffness=2.0)],
        [rj.Capsule((12, 0, 36), (20, 0, 52), 4.0, stiffness=2.0)],
        -1.0,
    ),
    "even tube": (
        [rj.Lumen.through([(0, -40), (0, 20), (-20, 50), (-20, 90)], 6.2, 30.0)],
        [rj.Tube.through([(0, 0, -40), (0, 0, 20), (-20, 0, 50), (-20, 0, 90)], 6.2, 30.0)],
        1.0,
    ),
}


def planar_and_spatial(name, mu, steps=10, **settings):
    """Both equilibria of every step of a path in a planar scene."""
    flat, space = flat_pair()
    in_plane, in_space, side = PLANAR[name]
    friction, rest = rj.WallFriction(mu) if mu else None, flat.neutral_lengths - 2.0 / flat.stiffnesses
    walls = [rj.Surroundings(items, rj.Sleeve(4.5), friction, **settings) for items in (in_plane, in_space)]
    before = [None, None]
    for share in np.linspace(0.0, 1.0, steps + 1):
        command = rest + share * side * np.array([-3.0, 3.0, -3.0, 3.0])
        feed = -15.0 + 20.0 * share if "tube" in name else 0.0
        for which, (chain, base) in enumerate(((flat, (0, feed, 0)), (space, (0, 0, feed)))):
            kept = {"history" if mu and before[which] is not None else "start": before[which]}
            before[which] = rj.solve_lengths(
                chain, command, tension_limits=(0.5, 15.0), surroundings=walls[which], base=base, **kept
            ).require()
        yield tuple(before)


def assert_same(pairs, near):
    """Tips, wall forces and insertion forces in the plane and in space are the same [mm, N]."""
    contacts, sticking = 0, [0, 0]
    for planar, spatial in pairs:
        contacts += len(planar.wall_contacts)
        np.testing.assert_allclose(spatial.tip[[0, 2]], planar.tip, atol=near)
        np.testing.assert_allclose(spatial.wall_forces[:, [0, 2]], planar.wall_forces[:, :2], atol=near)
        assert spatial.insertion_force == pytest.approx(planar.insertion_force, abs=near)
        assert np.abs(spatial.poses[:, 1, 3]).max() < 1e-9
        for which, each in enumerate((planar, spatial)):
            sticking[which] += sum(touch.sticks for touch in each.wall_contacts)
    assert contacts > 5 and sticking[0] == sticking[1]


@pytest.mark.parametrize("name", [name for name in PLANAR if name != "capsule"])
def test_a_planar_scene_has_the_planar_equilibria(name):
    assert_same(planar_and_spatial(name, 0.0), 1e-9)


def test_one_end_on_a_capsule_is_that_of_the_plane_but_for_the_crown():
    touched = 0
    for planar, spatial in planar_and_spatial("capsule", 0.0):
        contacts = [[touch.link for touch in each.wall_contacts if touch.force > 0.05] for each in (planar, spatial)]
        assert contacts[0] == contacts[1]
        assert spatial.tip[[0, 2]] == pytest.approx(planar.tip, abs=0.015)
        touched += len(contacts[0])
    assert touched > 5


@pytest.mark.parametrize("name", ["plane", "sphere", "even tube"])
def test_friction_at_rigid_walls_is_that_of_the_plane(name):
    """At a sphere in the limit of small steps: links roll on it, by an arc in the plane and its chord in space."""
    assert_same(planar_and_spatial(name, 0.2, 40, rigid=True), 1e-5 if name == "sphere" else 1e-9)


@pytest.mark.parametrize("name", ["sphere", "even tube"])
def test_friction_at_walls_that_give_way_is_that_of_the_plane_within_their_depth(name):
    """It acts on the surface of the link in space and on the wall's in the plane, apart by the depth of a contact."""
    for planar, spatial in planar_and_spatial(name, 0.2):
        depth = max([-touch.gap for touch in planar.wall_contacts], default=0.0)
        assert spatial.tip[[0, 2]] == pytest.approx(planar.tip, abs=1e-9 + 0.03 * depth)
        most = 0.2 * sum(touch.force for touch in planar.wall_contacts) * depth / 5.0  # mm: the smallest radius
        np.testing.assert_allclose(spatial.wall_forces[:, [0, 2]], planar.wall_forces[:, :2], atol=1e-9 + most)


def test_friction_along_a_tube_that_tapers_is_along_its_wall_in_space_and_along_its_centre_line_in_the_plane():
    slope, largest = 0.5 / 30.0, 0.0
    for planar, spatial in planar_and_spatial("tube", 0.2, rigid=True):
        most = 0.2 * slope * sum(touch.force for touch in planar.wall_contacts)
        difference = np.abs(spatial.wall_forces[:, [0, 2]] - planar.wall_forces[:, :2]).max()
        assert difference < 1e-9 + most
        largest = max(largest, difference)
    assert largest > 1e-5


@pytest.mark.slow
@pytest.mark.parametrize("steps", [160, 640])
@pytest.mark.parametrize("mu", [0.1, 0.3])
@pytest.mark.parametrize("name", ["tube", "all", "sphere"])
def test_what_a_closed_cycle_loses_is_the_work_of_motors_and_feed(name, mu, steps):
    turn = 2.0 * np.pi * np.arange(2 * steps + 1) / steps
    waves = np.stack([np.sin(turn), np.cos(turn), -np.sin(turn), -np.cos(turn)], axis=1)
    bases = np.zeros((turn.size, 3))
    bases[:, 2] = -7.5 * (1.0 - np.cos(turn))
    path = rj.trace(ARM, REST + waves, tension_limits=LIMITS, surroundings=around(name, mu), base=bases, history=None)
    assert path.ok.all()
    last = slice(steps, 2 * steps + 1)
    lost = path.dissipated_work[steps + 1 :].sum()
    commands, tensions = (REST + waves)[last], path.tensions[last]
    work = -np.sum(0.5 * (tensions[1:] + tensions[:-1]) * np.diff(commands, axis=0))
    force = path.insertion_force[last]
    work += np.sum(0.5 * (force[1:] + force[:-1]) * np.diff(bases[last, 2]))
    assert lost > 0.4
    assert work == pytest.approx(lost, rel=0.16 / steps)


def test_rigid_walls_keep_links_out():
    walls = around("sphere", rigid=True)
    equilibrium = solved(walls)
    assert equilibrium.wall_contacts
    for touch in equilibrium.wall_contacts:
        assert abs(touch.gap) < 1e-9
    stiff = [replace(wall, stiffness=1e4) for wall in SCENES["sphere"]]
    near = solved(rj.Surroundings(stiff, rj.Sleeve(15.0)))
    np.testing.assert_allclose(near.tip, equilibrium.tip, atol=1e-3)
    narrow = rj.Surroundings([rj.Plane((1, 0, 0), -10.0), rj.Plane((-1, 0, 0), -10.0)], rj.Sleeve(15.0), rigid=True)
    full = rj.solve_lengths(ARM, REST, surroundings=narrow, tension_limits=LIMITS)
    assert full.status is rj.Status.NO_ROOM


def test_a_step_through_a_rod_is_taken_in_parts_or_refused():
    """The rod stands on the way of the tip from one side to the other."""
    rod = rj.Capsule((0.0, -60.0, 70.0), (0.0, 60.0, 70.0), 1.0)
    walls = rj.Surroundings([rod], rj.Sleeve(3.0))
    way = np.array([12.0, 0.0, -12.0, 0.0])
    left, right = REST - way, REST + way
    before = solved(walls, left, (0, 0, 0))
    side = np.sign(before.tip[0])
    after = rj.solve_lengths(ARM, right, tension_limits=LIMITS, surroundings=walls, base=(0, 0, 0), start=before)
    free = rj.solve_lengths(ARM, right, tension_limits=LIMITS)
    assert np.sign(free.tip[0]) == -side
    assert after.status is rj.Status.PASSED_THROUGH or after.walls.parts > 1
    assert np.sign(after.tip[0]) == side
    dragged = rj.Surroundings([replace(rod, first=(50.0, -60.0, 70.0), second=(50.0, 60.0, 70.0))])
    assert walls_through(walls, dragged, before.positions) == [0]


def test_a_snap_over_the_end_of_a_rod_is_found_in_small_parts():
    """From its last equilibrium against the rod the chain snaps off; seen from farther back it would pass through."""
    chain, at = rj.pitch_yaw(), None
    rod = rj.Capsule((-0.61, 3.02, 34.13), (-2.93, 4.52, 32.89), 0.98, stiffness=10.0)
    walls = rj.Surroundings([rod], rj.Sleeve(3.0))
    pulls = [
        [-2, -2, -2, -2],
        [-1, 6, -10, 5],
        [7, 11, -9, 4],
        [3, 6, -6, 10],
        [2, 2, -2, 11],
        [7, -5, 5, 13],
        [-2, -10, -4, 6],
        [-5, -11, -11, 12],
        [-3, -10, -8, 21],
        [6, -8, -1, 26],
        [3, -13, -3, 32],
        [2, -18, -12, 40],
        [0, -12, -16, 46],
        [9, -9, -24, 42],
        [3, -2, -18, 36],
        [10, 8, -24, 28],
    ]  # of tendons, tenths of a millimetre
    for pull in pulls:
        lengths = chain.neutral_lengths + np.array(pull) / 10.0
        at = rj.solve_lengths(chain, lengths, tension_limits=(0.5, 30.0), surroundings=walls, start=at)
        assert at.ok
    assert at.walls.parts > 16 and at.walls.jumped and not at.wall_contacts


def test_a_batch_and_a_prepared_problem_are_the_single_solves():
    walls = [around("sphere", 0.2), around("tube", 0.2)]
    alone = [solved(each) for each in walls]
    batch = rj.solve_lengths_batch(
        ARM, np.tile(COMMAND, (2, 1)), tension_limits=LIMITS, surroundings=walls, base=np.tile(BASE, (2, 1))
    )
    following = rj.solve_lengths_batch(
        ARM, np.tile(COMMAND + 0.1, (2, 1)), tension_limits=LIMITS, surroundings=walls, base=BASE, history=batch
    )
    for row, each in enumerate(alone):
        next_one = solved(walls[row], COMMAND + 0.1, history=each)
        for one, many in ((each, batch.row(row)), (next_one, following.row(row))):
            for name in ("joint_angles", "poses", "wall_forces", "dissipated_work"):
                assert np.array_equal(getattr(one, name), getattr(many, name)), name
            places = [[(touch.link, touch.kind, touch.wall) for touch in e.wall_contacts] for e in (one, many)]
            assert places[0] == places[1] != []  # candidates are numbered among the walls of all rows
    problem = rj.prepare(ARM, tension_limits=LIMITS, surroundings=walls[0])
    first = problem.solve(COMMAND, base=BASE)
    assert np.array_equal(first.poses, alone[0].poses)
    assert np.array_equal(problem.solve(COMMAND + 0.1, history=first, base=BASE).poses, following.row(0).poses)


def test_a_long_arm_takes_its_steps_in_order_n():
    beads = [rj.Bead(10.0, "x" if i % 2 else "y", 400.0, gap=4.0) for i in range(20)]
    arm = rj.HingeChain(beads, [rj.BeadTendon([hole]) for hole in ((6.0, 0.0), (0.0, 6.0), (-6.0, 0.0), (0.0, -6.0))])
    plane, ball = rj.Plane((-0.8, -0.6, 0.0), -9.0, stiffness=0.5), rj.Sphere((-6.0, -16.0, 100.0), 9.0)
    walls, base = rj.Surroundings([plane, ball], rj.Sleeve(7.0)), (3.2, 2.4, 0.0)
    command = arm.neutral_lengths - 2.0 / arm.stiffnesses + np.array([-5.0, -3.0, 5.0, 3.0])
    equilibrium = solved(walls, command, base, chain=arm)
    assert {touch.link for touch in equilibrium.wall_contacts} >= {1, 2, 10, 20}
    again = Recomputed(arm, walls, command, LIMITS, base)
    assert np.abs(again.residual(np.array(equilibrium.joint_angles))).max() < 1e-5


def test_forces_of_contacts_add_up_to_those_on_links():
    equilibrium = steps_with_friction("all", 0.05)[1][-1][2]
    total = np.zeros((ARM.n_links, 6))
    for touch in equilibrium.wall_contacts:
        arm = touch.place - equilibrium.poses[touch.link][:3, 3]
        total[touch.link] += [*touch.force_on_link, *np.cross(arm, touch.force_on_link)]
        along = touch.force_on_link - touch.normal * (touch.normal @ touch.force_on_link)
        assert np.linalg.norm(along) == pytest.approx(touch.friction, abs=0.02 * touch.force)
    np.testing.assert_allclose(total, equilibrium.wall_forces, atol=1e-9)
    assert equilibrium.insertion_force == pytest.approx(-total[:, 2].sum())


@pytest.mark.slow
@pytest.mark.parametrize(("scene", "seed"), [("capsule", 5), ("capsule", 12), ("sphere", 17)])
def test_links_that_graze_a_round_end_with_friction_arrive(scene, seed):
    statuses, touching = walk("pitch_yaw", scene, 10.0, 0.3, seed)
    assert set(statuses) == {"CONVERGED"} and touching


def test_walls_of_the_wrong_dimension_are_refused():
    with pytest.raises(rj.InvalidInput, match="Plane, Sphere, Capsule, Tube"):
        rj.solve_lengths(ARM, REST, surroundings=rj.Surroundings([rj.Disc((0, 50), 5.0)]))
    with pytest.raises(rj.InvalidInput, match="HalfPlane, Disc"):
        rj.solve_lengths(rj.five_link(), rj.five_link().neutral_lengths, surroundings=around("sphere"))
    with pytest.raises(rj.InvalidInput, match="a wall in space"):
        rj.Surroundings([rj.Sphere((0, 0, 50), 5.0), rj.Disc((0, 50), 5.0)])
    with pytest.raises(rj.InvalidInput, match=r"walls\[0\] radii = \(17.0, 17.0, .*wider than the outline, 17 mm"):
        rj.solve_lengths(ARM, REST, surroundings=around("tube", outline=rj.Sleeve(17.0)))
    with pytest.raises(rj.InvalidInput, match="x, y, z"):
        rj.solve_lengths(ARM, REST, surroundings=around("sphere"), base=(0, 0))
    with pytest.raises(rj.InvalidInput, match="twice the rounding"):
        rj.solve_lengths(ARM, REST, surroundings=around("sphere", outline=rj.Bare(14.0)))
