"""STL of chains in space, read back: closed bodies, exact surfaces, open channels, links that never overlap."""

from __future__ import annotations

import csv
import itertools
from dataclasses import replace
from pathlib import Path

import manifold3d
import numpy as np
import pytest
import trimesh

import rollingjoint as rj
from rollingjoint.cad import Fabrication, export, spatial_bodies, spatial_solid
from tests.rollingjoint.cad.test_cad import winding
from tests.rollingjoint.chain.spatial_chains import random_chain
from tests.rollingjoint.chain.test_spatial import hinged
from tests.rollingjoint.command import rj as run_rj


def narrow():
    """Contact lines of a quarter of the width, off the middle."""
    chain = rj.pitch_yaw(3)
    return chain.replace(joints=[replace(joint, half_width=0.8, middle=0.3) for joint in chain.joints])


CHAINS = {
    "pitch_yaw": lambda: rj.pitch_yaw(3),
    "pitch_yaw_two_segment": lambda: rj.pitch_yaw_two_segment(2, 1),
    "narrow": narrow,
    **{f"random {seed}": lambda seed=seed: random_chain(np.random.default_rng(seed), n=3) for seed in range(4)},
    **{f"mixed {seed}": lambda seed=seed: random_chain(np.random.default_rng(seed), n=3, joint=hinged)
       for seed in range(4)},
}  # fmt: skip


def contacts(chain):
    """Every contact surface: link, joint, surface and the side of the link that it is on."""
    for i, joint in enumerate(chain.joints):
        if isinstance(joint, rj.RollingContact):
            yield i, joint, joint.child, 1.0
            yield i + 1, joint, joint.parent, -1.0


def away_from_channels(body, points):
    """Those points (k, 3) that no channel and no flare reaches."""
    kept = np.ones(len(points), bool)
    for channel in body.channels:
        parent, along = channel.holes[0], np.subtract(*channel.holes[::-1])
        length = np.linalg.norm(along)
        at = (points - parent) @ along / length
        across = np.linalg.norm(points - parent - at[:, None] * along / length, axis=1)
        entry, leaving = np.maximum([-at, at - length], 0.0) * np.tan(channel.flares)[:, None]
        kept &= across > 0.5 * channel.diameter + entry + leaving + 0.05
    return points[kept]


@pytest.fixture(scope="module", params=CHAINS)
def made(request):
    """A chain, its bodies and their solids."""
    chain = CHAINS[request.param]()
    bodies = spatial_bodies(chain)
    return chain, bodies, [spatial_solid(body, link) for link, body in enumerate(bodies)]


@pytest.mark.slow
def test_bodies_are_closed_in_one_piece_with_a_tunnel_for_every_tendon(made):
    chain, bodies, meshes = made
    for link, (body, mesh) in enumerate(zip(bodies, meshes, strict=True)):
        assert mesh.is_watertight and mesh.is_winding_consistent and mesh.body_count == 1
        assert len(body.channels) == sum(link < len(points) for points in chain.hole_points)
        assert mesh.euler_number == 2 - 2 * len(body.channels)
        assert 0.0 < mesh.volume < np.pi * body.radius**2 * np.ptp(mesh.bounds[:, 2])


@pytest.mark.slow
def test_contact_surfaces_are_exact_over_the_whole_line(made):
    """A step outside of a point of the exact surface there is no body, a step inside there is one."""
    chain, bodies, meshes = made
    for link, joint, surface, side in contacts(chain):
        s = np.linspace(*surface.limits, 9)[1:-1]
        angles = surface.tangent_angle(s)
        normals = np.stack([-np.sin(angles), np.cos(angles)], axis=-1)
        for along in joint.middle + joint.half_width * np.array([-0.99, -0.4, 0.1, 0.99]):
            for step, inside in ((2e-3, False), (-2e-3, True)):
                drawn = surface.point(s) + side * step * normals
                points = away_from_channels(bodies[link], np.insert(drawn, 2, along, axis=1) @ joint.frame)
                np.testing.assert_allclose(winding(meshes[link], points), float(inside), atol=0.01)


def test_corners_at_both_ends_of_the_line_lie_on_the_exact_curve(made):
    (chain, bodies, meshes), count = made, 0
    for link, joint, surface, side in contacts(chain):
        exact = surface.point(np.linspace(*surface.limits, 20_001))
        lateral, height, along = (away_from_channels(bodies[link], meshes[link].vertices) @ joint.frame.T).T
        for end in (joint.middle - joint.half_width, joint.middle + joint.half_width):
            there = (np.abs(along - end) < 1e-5) & (lateral > exact[0, 0] - 1e-5) & (lateral < exact[-1, 0] + 1e-5)
            outside = side * (height - np.interp(lateral, *exact.T))[there]
            count += np.sum(np.abs(outside) < 1e-3)  # the others lie where the face beside the line is set back
            assert np.all((np.abs(outside) < 1e-3) | (outside < -0.19))
    assert count > 10 * len(meshes)


@pytest.mark.slow
def test_channels_are_open_from_hole_to_hole_and_flare_from_there(made):
    _, bodies, meshes = made
    for body, mesh in zip(bodies, meshes, strict=True):
        for channel in body.channels:
            parent, along = channel.holes[0], np.subtract(*channel.holes[::-1])
            length, radius = np.linalg.norm(along), 0.5 * channel.diameter
            along = along / length
            across = np.cross(along, [0.6, 0.8, 0.0])
            across /= np.linalg.norm(across)
            round_it = [np.cos(t) * across + np.sin(t) * np.cross(along, across) for t in np.linspace(0, 6, 7)]
            places = np.array([-20.0, 0.0, 0.3 * length, length, length + 20.0])
            np.testing.assert_allclose(winding(mesh, parent + places[:, None] * along), 0.0, atol=0.01)
            walls = parent + np.concatenate([0.5 * length * along + 1.05 * radius * np.array(round_it)])
            np.testing.assert_allclose(winding(mesh, walls), 1.0, atol=0.01)
            for end, flare in ((0.0, channel.flares[0]), (length, channel.flares[1])):
                outward = along if end else -along
                rim = [(0.05, 0.97 * (radius + 0.05 * np.tan(flare))), (0.0, 0.97 * radius)]
                opened = [parent + end * along + t * outward + r * way for t, r in rim for way in round_it]
                np.testing.assert_allclose(winding(mesh, np.array(opened)), 0.0, atol=0.01)


def as_manifold(mesh, pose):
    corners = mesh.vertices @ pose[:3, :3].T + pose[:3, 3]
    return manifold3d.Manifold(manifold3d.Mesh64(corners, mesh.faces.astype(np.uint64)))


@pytest.mark.parametrize("share", [0.0, 0.3, 0.5, 1.0])
def test_neighbours_touch_at_rolling_joints_and_never_overlap(made, share):
    chain, _, meshes = made
    low, high = chain.joint_limits.T
    placed = [as_manifold(*pair) for pair in zip(meshes, chain.poses((1 - share) * low + share * high), strict=True)]
    for joint, below, above in zip(chain.joints, placed[:-1], placed[1:], strict=True):
        assert (below ^ above).volume() < 1e-4
        assert not isinstance(joint, rj.RollingContact) or below.min_gap(above, 1.0) < 2.5e-3


def test_files_are_every_link_and_the_assembly_in_its_pose(tmp_path):
    chain = rj.pitch_yaw(4)
    bent = rj.solve_tensions(chain, [5.0, 3.0, 2.0, 3.5])
    files = export(bent, tmp_path / "out")
    assert [path.name for path in files] == [*(f"link_{i}.stl" for i in range(5)), "assembly.stl", "parts.csv"]
    links = [trimesh.load(path) for path in files[:5]]
    assembly = trimesh.load(files[5])
    assert assembly.is_watertight and assembly.body_count == 5
    for pose, link in zip(bent.poses, links, strict=True):
        bounds = link.copy().apply_transform(pose).bounds
        assert any(np.abs(part.bounds - bounds).max() < 1e-4 for part in assembly.split())
    with files[-1].open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["same as"] for row in rows] == ["", "", "", "link_1", ""]
    assert [float(row["volume [mm3]"]) for row in rows] == pytest.approx([link.volume for link in links], abs=1e-3)
    assert {row["channels"] for row in rows} == {"4"}


def test_plates_without_channels_are_closed_too():
    bodies = spatial_bodies(rj.pitch_yaw(2), Fabrication(channel_diameter=0.0))
    assert [spatial_solid(body, link).euler_number for link, body in enumerate(bodies)] == [2, 2, 2]


def with_holes(pairs, **contact):
    joint = replace(rj.pitch_yaw(1).joints[0], **contact)
    return rj.SpatialChain([joint], [rj.SpaceTendon([pair]) for pair in pairs])


COIL = {
    side: rj.Surface(rj.Profile.constant(sign / 5.0, (-5.0 * 1.45, 5.0 * 1.45)), (0.0, -sign * 2.5))
    for side, sign in (("parent", 1.0), ("child", -1.0))
}


@pytest.mark.parametrize(
    ("chain", "options", "parts"),
    [
        (with_holes([((2.0, 0, -1), (2.0, 0, 2.4))]), {}, ["child hole of tendon 0 in link 0", "outside", "into the"]),
        (with_holes([((2, 0, -1), (2, 0, 1)), ((2, 1, -1), (2, 1, 1))]), {}, ["tendons 0 and 1", "0.4 mm"]),
        (with_holes([((2, 0, 0), (2, 0, 0.5))]), {}, ["holes of tendon 0 in link 0", "diameter"]),
        (with_holes([((0, 0, -1.0), (0, 0, 1.0))], **COIL), {}, ["slope of the child surface", "Narrow"]),
        (rj.pitch_yaw(2), {"channel_diameter": 4.0, "thickness": 9.0}, ["diameter"]),
    ],
)
def test_links_that_cannot_be_made_are_refused_with_their_place(chain, options, parts, tmp_path):
    with pytest.raises(rj.MechanismError) as caught:
        export(chain, tmp_path / "out", **options)
    assert all(part in str(caught.value) for part in parts), caught.value
    assert list(tmp_path.iterdir()) == []


def test_batches_and_unusable_equilibria_are_refused(tmp_path):
    chain = rj.pitch_yaw(2)
    with pytest.raises(rj.InvalidInput, match="one equilibrium"):
        export(rj.solve_tensions_batch(chain, np.ones((3, 4))), tmp_path / "out")
    with pytest.raises(rj.SolverError):
        export(rj.solve_tensions(chain.replace(joints=[replace(j, stiffness=0.0) for j in chain.joints]), np.zeros(4)),
               tmp_path / "out")  # fmt: skip


@pytest.mark.parametrize(
    ("command", "parts"),
    [
        ("pitch_yaw --out parts --format dxf", ["formats = ['dxf']", "stl"]),
        ("small_arm --out parts --format dxf", ["formats = ['dxf']", "stl"]),
        ("five_link --out parts --bore 2", ["bore = 2.0", "planar"]),
        ("pitch_yaw --mjcf no/such/a.xml", ["--mjcf = 'no/such/a.xml'", "Create no/such first"]),
        ("pitch_yaw --mjcf .", ["--mjcf", "It is a folder"]),
        ("small_arm --mjcf a.xml --out parts --bore 40", ["bore and the channel"]),
        ("pitch_yaw --mjcf a.xml --out no/such", ["folder = 'no/such'", "Create no first"]),
        ("pitch_yaw --mjcf no/such/a.xml --out parts", ["--mjcf = 'no/such/a.xml'"]),
    ],
)
def test_wrong_commands_are_one_line_and_write_nothing(command, parts, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert run_rj(f"export {command}") == 2
    output = capsys.readouterr()
    assert output.out == "" and output.err.count("\n") == 1 and output.err.startswith("rj export: error: ")
    assert all(part in output.err for part in parts), output.err
    assert list(tmp_path.iterdir()) == []


def test_both_outputs_are_written_together(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert run_rj("export five_link --mjcf a.xml --out parts --format svg") == 0
    printed = capsys.readouterr().out.splitlines()
    assert printed[0].startswith("a.xml: ") and printed[1] == "parts/link_0.svg"
    assert all(Path(line.partition(":")[0]).exists() for line in printed)


def with_beads(**changes):
    """Three beads with other values."""
    arm = rj.small_arm(3)
    return arm.replace(beads=[replace(bead, **changes) for bead in arm.beads])


ARMS = {
    "small_arm": (rj.small_arm(), {}),
    "with a backbone": (rj.small_arm(3), {"bore": 4.0, "thickness": 10.0}),
    "tilted axes": (with_beads(axis=(1.0, 0.5, 0.0)), {}),
    "narrow": (with_beads(limits=(-0.1, 0.2)), {}),
}


@pytest.fixture(scope="module", params=ARMS)
def beads(request):
    """An arm, its sizes, its bodies and their solids."""
    arm, sizes = ARMS[request.param]
    bodies = spatial_bodies(arm, Fabrication(**sizes))
    return arm, Fabrication(**sizes), bodies, [spatial_solid(body, link) for link, body in enumerate(bodies)]


def test_beads_are_closed_as_high_as_the_mechanism_says_with_a_tunnel_for_every_tendon(beads):
    arm, sizes, bodies, meshes = beads
    bottom, top = -0.5 * arm.beads[0].gap - sizes.thickness, -0.5 * arm.beads[0].gap
    for (low, high), body, mesh in zip([(bottom, top), *arm.body_ends], bodies, meshes, strict=True):
        assert mesh.is_watertight and mesh.body_count == 1
        assert mesh.bounds[:, 2] == pytest.approx([low, high], abs=1e-4)
        assert mesh.euler_number == 2 - 2 * (len(body.channels) + bool(sizes.bore))
        assert len(body.channels) == arm.n_tendons


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_beads_never_overlap_in_the_range_of_their_hinges(beads, share):
    arm, _, bodies, meshes = beads
    low, high = arm.joint_limits.T
    placed = [as_manifold(*pair) for pair in zip(meshes, arm.poses((1 - share) * low + share * high), strict=True)]
    for below, above in itertools.pairwise(placed):
        assert (below ^ above).volume() < 1e-4
    assert max(body.radius for body in bodies) > arm.hole_radius  # so that flat faces would


def test_holes_of_beads_are_open_at_the_holes_of_the_model_and_the_bore_is_open(beads):
    arm, sizes, _, meshes = beads
    for link, mesh in enumerate(meshes[1:], start=1):
        for tendon in arm.tendons:
            x, y = tendon.link_holes(arm.n_links)[link]
            ends = np.array([[x, y, z] for z in arm.body_ends[link - 1]])
            np.testing.assert_allclose(winding(mesh, np.array([*ends, ends.mean(axis=0)])), 0.0, atol=0.01)
            inside = 0.5 * sizes.channel_diameter + 0.05
            beside = ends + np.array([[0.0, 0.0, 1e-3], [0.0, 0.0, -1e-3]])
            beside -= inside * np.array([x, y, 0.0]) / np.hypot(x, y)
            np.testing.assert_allclose(winding(mesh, beside), 1.0, atol=0.01)  # no bevel reaches the holes
        middle = winding(mesh, np.array([[0.0, 0.0, arm.body_ends[link - 1].mean()]]))
        np.testing.assert_allclose(middle, 0.0 if sizes.bore else 1.0, atol=0.01)


def test_files_of_an_arm_are_its_links_and_the_assembly_in_its_pose(tmp_path):
    arm = rj.small_arm(3)
    bent = rj.solve_tensions(arm, [3.0, 1.0, 1.0, 2.0])
    files = export(bent, tmp_path / "out", bore=2.0)
    assert [path.name for path in files] == [*(f"link_{i}.stl" for i in range(4)), "assembly.stl", "parts.csv"]
    assert trimesh.load(files[4]).body_count == 4


@pytest.mark.parametrize(
    ("mechanism", "sizes", "match"),
    [
        (rj.small_arm(2), {"bore": 2.0 * rj.small_arm().hole_radius - 1.0}, "bore and the channel"),
        (rj.small_arm(2, "linear"), {}, "exact"),
        (rj.five_link(), {"bore": 1.0}, "bore"),
        (rj.small_arm(2), {"bore": -1.0}, "bore"),
        (rj.small_arm(2), {"formats": "dxf"}, "stl"),
    ],
)
def test_arms_and_bores_that_cannot_be_made_are_refused_in_one_line(mechanism, sizes, match, tmp_path):
    with pytest.raises((rj.MechanismError, rj.InvalidInput), match=match) as caught:
        export(mechanism, tmp_path / "out", **sizes)
    assert "\n" not in str(caught.value) and list(tmp_path.iterdir()) == []


def test_tubes_have_a_bore_too():
    bodies = spatial_bodies(rj.pitch_yaw(2), Fabrication(bore=2.0))
    meshes = [spatial_solid(body, link) for link, body in enumerate(bodies)]
    assert [mesh.euler_number for mesh in meshes] == [2 - 2 * 5] * 3
