"""Contact with walls: derivatives, balances, batches, the base, and walls that are far away."""

import pickle

import numpy as np
import pytest

import rollingjoint as rj
from tests.rollingjoint.walls.outlines import bare, sleeve, walls
from tests.rollingjoint.walls.scenes import CHAIN, LIMITS, REST

SCENES = {
    "plane": {"planes": [(0.96, -0.28, -22.0, 2.0)]},
    "discs": {"discs": [(-10.0, 45.0, 5.0, 2.0), (9.0, 70.0, 4.0, 2.0)]},
    "capsule": {"capsules": [(-16.0, 40.0, -9.0, 66.0, 2.0, 3.0)]},
    "taper": {"lumens": [((0.0, -5.0, np.pi / 2), [(35, 0.0, 7, 7), (40, 0.02, 7, 6.5), (40, -0.02, 6.5, 6)], 1.5)]},
    "lumen": {"lumens": [((0.0, -5.0, np.pi / 2), [(35, 0.0, 7, 7), (40, 0.02, 7, 7), (40, -0.02, 7, 7)], 1.5)]},
}
ALL = {kind: items for scene in SCENES.values() for kind, items in scene.items()}
COMMANDS = REST + np.array([[-1.0, 0.9, -0.5, 0.4], [0.8, -0.9, 0.4, -0.5], [-0.4, 0.3, 1.0, -1.2]])
BASE = (0.5, -1.0, 0.05)


def scene(name, outline=None, **settings):
    return walls(outline or sleeve(CHAIN, 5.0), **(ALL if name == "all" else SCENES[name]), **settings)


def solved(around, command, base=BASE, **more):
    return rj.solve_lengths(CHAIN, command, surroundings=around, base=base, tension_limits=LIMITS, **more).require()


@pytest.mark.parametrize("outline", [sleeve(CHAIN, 5.0), bare(CHAIN, 1.0)], ids=["sleeve", "bare"])
@pytest.mark.parametrize("name", [*SCENES, "all"])
def test_stiffness_is_the_derivative_of_the_moments(name, outline):
    """Moments out of balance from contact forces: what the links would need is the derivative of the energy."""
    around = scene(name, outline)
    found = 0
    for command in COMMANDS:
        equilibrium = solved(around, command)
        found += len(equilibrium.wall_contacts) > 0
        change = np.linalg.solve(equilibrium.stiffness, (equilibrium.tendon_rates * equilibrium.tendon_stiffness))
        for j in range(CHAIN.n_tendons):
            h = 1e-4
            steps = [
                solved(around, command + sign * h * np.eye(CHAIN.n_tendons)[j], start=equilibrium) for sign in (1, -1)
            ]
            if len({len(step.wall_contacts) for step in (*steps, equilibrium)}) > 1:
                continue  # a contact opens between the points
            difference = (steps[0].joint_angles - steps[1].joint_angles) / (2.0 * h)
            np.testing.assert_allclose(change[:, j], difference, atol=2e-6 * np.abs(change).max())
    assert found


@pytest.mark.parametrize("name", [*SCENES, "all"])
def test_forces_between_links_carry_the_walls(name):
    """Cut free beyond a joint, the chain is in balance under tendons, walls and the contact force."""
    equilibrium = solved(scene(name), COMMANDS[0])
    assert equilibrium.wall_contacts
    ex, ey = equilibrium.contact_tangents.T
    along, across = equilibrium.contact_forces.T
    contact = np.stack([along * ex - across * ey, along * ey + across * ex], axis=-1)
    holes = CHAIN.tendon_polyline(equilibrium.poses)
    for i in range(CHAIN.n_joints):
        points, forces, moment = [], [], 0.0
        for link in range(i + 1, CHAIN.n_links):
            force, point = equilibrium.wall_forces[link, :2], equilibrium.poses[link, :2]
            points, forces, moment = [*points, point], [*forces, force], moment + equilibrium.wall_forces[link, 2]
        for tension, polyline in zip(equilibrium.tensions, holes, strict=True):
            if len(polyline) > 2 * (i + 1):
                below, above = polyline[2 * i + 1], polyline[2 * i + 2]
                points, forces = [*points, above], [*forces, tension * (below - above) / np.linalg.norm(below - above)]
        points, forces = [*points, equilibrium.contact_points[i]], [*forces, contact[i]]
        np.testing.assert_allclose(np.sum(forces, axis=0), 0.0, atol=1e-9)
        arms = np.array(points) - equilibrium.contact_points[i]
        turning = sum(arm[0] * force[1] - arm[1] * force[0] for arm, force in zip(arms, np.array(forces), strict=True))
        assert abs(turning + moment) < 1e-8


def test_contacts_are_places_and_forces_of_the_walls():
    equilibrium = solved(scene("all"), COMMANDS[0])
    forces = np.zeros((CHAIN.n_links, 3))
    for contact in equilibrium.wall_contacts:
        force = contact.force * contact.normal
        x, y = contact.place - equilibrium.poses[contact.link, :2]
        forces[contact.link] += [*force, x * force[1] - y * force[0]]
        assert contact.gap < 0.0 and np.linalg.norm(contact.normal) == pytest.approx(1.0)
        if contact.kind == "disc":  # the place is on its circle, the base frame is turned and moved
            place = np.array(SCENES["discs"]["discs"])[contact.wall]
            cos, sin = np.cos(BASE[2]), np.sin(BASE[2])
            x, y = contact.place
            at = np.array([BASE[0] + cos * x - sin * y, BASE[1] + sin * x + cos * y])
            assert np.linalg.norm(at - place[:2]) == pytest.approx(place[2])
    np.testing.assert_allclose(forces, equilibrium.wall_forces, atol=1e-9)


@pytest.mark.parametrize("name", ["taper", "lumen"])
def test_forces_at_contacts_add_up_to_those_on_the_links(name):
    """In tapers and under friction, too."""
    around, step = scene(name, mu=0.3), None
    for feed in (-1.0, 0.0, 0.02, 1.0):
        step = solved(around, COMMANDS[0], base=(0.5, feed, 0.05), history=step)
    forces = np.zeros((CHAIN.n_links, 2))
    np.add.at(forces, [contact.link for contact in step.wall_contacts], [c.force_on_link for c in step.wall_contacts])
    assert max(abs(contact.friction) for contact in step.wall_contacts) > 0.05
    np.testing.assert_allclose(forces, step.wall_forces[:, :2], atol=1e-12)


def test_moving_chain_and_walls_together_changes_nothing():
    turn, shift = 0.7, np.array([3.0, -20.0])
    cos, sin = np.cos(turn), np.sin(turn)
    R = np.array([[cos, -sin], [sin, cos]])
    moved_discs = [(*(R @ disc[:2] + shift), *disc[2:]) for disc in SCENES["discs"]["discs"]]
    normal = R @ SCENES["plane"]["planes"][0][:2]
    moved_plane = (*normal, SCENES["plane"]["planes"][0][2] + normal @ shift, 2.0)
    start, pieces, k = SCENES["lumen"]["lumens"][0]
    moved_lumen = ((*(R @ start[:2] + shift), start[2] + turn), pieces, k)
    a, b = (R @ SCENES["capsule"]["capsules"][0][at : at + 2] + shift for at in (0, 2))
    moved_capsule = (*a, *b, *SCENES["capsule"]["capsules"][0][4:])
    outline = sleeve(CHAIN, 5.0)
    moved = walls(outline, [moved_plane], moved_discs, [moved_capsule], [moved_lumen])
    first, second = solved(scene("all"), COMMANDS[0], base=(0, 0, 0)), solved(moved, COMMANDS[0], base=(*shift, turn))
    np.testing.assert_allclose(second.poses, first.poses, atol=1e-8)
    np.testing.assert_allclose(second.wall_forces, first.wall_forces, atol=1e-8)


def test_a_row_of_a_batch_is_the_single_solve_to_the_last_bit():
    around = [scene(name) for name in ("plane", "all", "taper")]
    bases = np.array([BASE, (0, 0, 0), (0, 2, 0)])
    batch = rj.solve_lengths_batch(CHAIN, COMMANDS, surroundings=around, base=bases, tension_limits=LIMITS)
    assert batch.ok.all()
    for row, (walls_of_row, command, base) in enumerate(zip(around, COMMANDS, bases, strict=True)):
        single, taken = solved(walls_of_row, command, base=base), batch.row(row)
        assert np.array_equal(single.joint_angles, taken.joint_angles)
        assert np.array_equal(single.wall_forces, taken.wall_forces)
        assert len(single.wall_contacts) == len(taken.wall_contacts) == len(batch.wall_contacts[row]) > 0
        assert np.array_equal(single.stiffness, taken.stiffness)
        assert np.allclose(batch.stiffness[row], single.stiffness, atol=1e-9)


def test_far_walls_change_nothing():
    far = walls(sleeve(CHAIN, 5.0), planes=[(1.0, 0.0, -500.0, 1.0)], discs=[(300.0, 0.0, 5.0, 1.0)])
    free = rj.solve_lengths(CHAIN, COMMANDS[0], tension_limits=LIMITS)
    among = solved(far, COMMANDS[0])
    np.testing.assert_allclose(among.poses, free.poses, atol=1e-9)
    assert among.wall_contacts == [] and not among.wall_forces.any() and among.insertion_force == 0.0
    assert free.wall_contacts == [] and free.wall_forces.shape == (CHAIN.n_links, 3) and free.jumped is False


def test_long_chains_take_steps_in_order_n():
    chain = rj.uniform(31, height=5.0, radius=7.0, half_width=5.0, tendon_offset=3.5)
    around = walls(
        sleeve(chain, 5.0), lumens=[((0, -5, np.pi / 2), [(40, 0, 7, 7), (60, 0.015, 7, 7), (80, 0, 7, 7)], 1.0)]
    )
    rest = chain.neutral_lengths - 2.0 / chain.stiffnesses
    equilibrium = rj.solve_lengths(
        chain, rest + np.array([-4.0, 3.0]), surroundings=around, tension_limits=LIMITS
    ).require()
    assert len(equilibrium.wall_contacts) >= 4
    assert equilibrium.residual < 1e-8 and equilibrium.smallest_eigenvalue > 0.0


def test_insertion_force_is_the_rate_of_the_energy():
    """Of taut tendons and walls that give way, along the feed of the base, whose equilibria have the least energy."""
    around, stiffness, h = scene("lumen"), SCENES["lumen"]["lumens"][0][-1], 1e-3
    at = solved(around, COMMANDS[0], base=(0.0, 3.0, 0.0))
    energies = []
    for way in (h, -h):
        step = solved(around, COMMANDS[0], base=(0.0, 3.0 + way, 0.0), start=at)
        assert (step.tensions > LIMITS[0]).all() and (step.tensions < LIMITS[1]).all()
        pressed = sum(contact.force**2 for contact in step.wall_contacts) / (2.0 * stiffness)
        energies.append(pressed + np.sum(step.tensions**2 / (2.0 * CHAIN.stiffnesses)))
    assert at.insertion_force == pytest.approx((energies[0] - energies[1]) / (2.0 * h), rel=1e-6)
    assert at.insertion_force == pytest.approx(-at.wall_forces[:, 1].sum())


def test_rigid_walls_are_the_limit_of_stiff_ones():
    rigid = solved(scene("lumen", rigid=True), COMMANDS[0])
    distances = []
    for k in (1e2, 1e3, 1e4):
        start, pieces, _ = SCENES["lumen"]["lumens"][0]
        stiff = solved(walls(sleeve(CHAIN, 5.0), lumens=[(start, pieces, k)]), COMMANDS[0])
        distances.append(np.abs(stiff.poses - rigid.poses).max())
    assert all(contact.gap == pytest.approx(0.0, abs=1e-10) for contact in rigid.wall_contacts)
    assert distances[0] / distances[1] == pytest.approx(10.0, rel=0.1)
    assert distances[1] / distances[2] == pytest.approx(10.0, rel=0.1)


def test_no_room_is_a_status():
    around = walls(sleeve(CHAIN, 5.0), planes=[(1.0, 0.0, -3.0, 1.0), (-1.0, 0.0, -3.0, 1.0)], rigid=True)
    equilibrium = rj.solve_lengths(CHAIN, REST, surroundings=around)
    assert equilibrium.status is rj.Status.NO_ROOM and not equilibrium.ok
    assert np.isfinite(equilibrium.poses).all()


def test_a_snap_through_is_a_jump():
    """The base moves sideways past a disc, which holds the tip back until it slips over."""
    around = walls(sleeve(CHAIN, 5.0), discs=[(12.0, 80.0, 4.0, 1.0)])
    steps = [solved(around, REST, base=(0, 0, 0))]
    for x in range(1, 60):
        steps.append(solved(around, REST, base=(x, 0, 0), start=steps[-1].joint_angles))
    touching = np.array([len(step.wall_contacts) > 0 for step in steps])
    (slipped,) = np.flatnonzero(touching[:-1] & ~touching[1:]) + 1
    assert np.flatnonzero([step.jumped for step in steps]).tolist() == [slipped]
    assert np.abs(steps[slipped].joint_angles - steps[slipped - 1].joint_angles).max() > 0.3
    assert not solved(around, REST, base=(slipped, 0, 0)).jumped  # no start promises a pose


def test_wrong_inputs_are_named():
    around = scene("plane")
    with pytest.raises(rj.InvalidInput, match="base"):
        rj.solve_lengths(CHAIN, REST, surroundings=around, base=(0.0, 1.0))
    with pytest.raises(rj.InvalidInput, match="surroundings"):
        rj.solve_lengths(CHAIN, REST, surroundings=3)
    with pytest.raises(rj.InvalidInput, match="number of surroundings"):
        rj.solve_lengths_batch(CHAIN, COMMANDS, surroundings=[around])
    arm = rj.small_arm()
    with pytest.raises(rj.InvalidInput, match="Plane, Sphere, Capsule, Tube"):
        rj.solve_lengths(arm, arm.neutral_lengths, surroundings=around)
    assert rj.solve_lengths(CHAIN, REST, surroundings=around, base=(np.nan, 0, 0)).status is rj.Status.INVALID_INPUT


def test_single_prepared_and_batched_solves_agree_to_the_last_bit_on_any_way():
    """Single solves keep their memory: other walls, bases, starts and refused steps in between leave no trace."""
    scenes = [rj.Surroundings([rj.Disc((12.0, 45.0), 4.0, stiffness=k)], rj.Sleeve(5.0)) for k in (5.0, 1e-3)]
    prepared = [rj.prepare(CHAIN, tension_limits=LIMITS, surroundings=scene) for scene in scenes]
    rng, poses, seen = np.random.default_rng(3), [None, None], set()
    for _ in range(40):
        number = int(rng.integers(2))
        scene, base, command = scenes[number], rng.normal(0.0, [8.0, 2.0, 0.02]), REST + rng.normal(0.0, 1.0, 4)
        start = poses[number] if rng.random() < 0.8 else None
        settings = {"tension_limits": LIMITS, "surroundings": scene, "base": base}
        single = rj.solve_lengths(CHAIN, command, start=start, **settings)
        rows = rj.solve_lengths_batch(CHAIN, command[None], starts=start, **settings)
        for other in (prepared[number].solve(command, start=start, base=base), rows.row(0)):
            assert other.status == single.status and other.jumped == single.jumped
            for name in ("joint_angles", "poses", "tensions", "wall_forces"):
                assert np.array_equal(getattr(other, name), getattr(single, name)), name
            for name in ("base", "gaps", "normals"):
                assert np.array_equal(getattr(other.walls, name), getattr(single.walls, name)), name
        copy = pickle.loads(pickle.dumps(single))
        assert np.array_equal(copy.wall_forces, single.wall_forces) and copy.walls.parts == single.walls.parts
        seen.add(single.status)
        poses[number] = single if rng.random() < 0.8 else poses[number]
    assert seen >= {rj.Status.CONVERGED, rj.Status.PASSED_THROUGH}
