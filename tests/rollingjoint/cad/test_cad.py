"""Files for the workshop, read back: curves are those of the exact surfaces, bodies closed, channels open."""

from __future__ import annotations

import csv
import re
from pathlib import Path
from xml.etree import ElementTree

import ezdxf
import numpy as np
import pytest
import shapely
import trimesh
from ezdxf import recover

import rollingjoint as rj
from rollingjoint.cad import Fabrication, bodies, export
from rollingjoint.chain.outline import to_world
from rollingjoint.chain.presets import presets_of
from rollingjoint.chain.random_chain import random_chain

SVG = "{http://www.w3.org/2000/svg}"
DRILLABLE = [1, 3, 5, 8, 13, 15, 18]  # of the seeds 0 to 19: the others have coincident holes or channels too close


def exact_ring(link, count=1501):
    """The closed outline from the exact surfaces; its chords of 0.02 mm are within 1e-5 mm of them."""
    parent, child = (
        surface.point(np.union1d(np.linspace(*surface.limits, count), surface.profile.breaks))
        for surface in (link.parent, link.child)
    )
    return np.concatenate([parent, child[::-1], parent[:1]])


def same_curve(drawn, exact, tolerance=1e-3):
    """Whether no curve is farther than the tolerance from the other, vertices and what lies between them [mm]."""
    drawn = shapely.MultiLineString([drawn]) if isinstance(drawn, np.ndarray) else drawn
    exact = shapely.LineString(exact)
    shapely.prepare([drawn, exact])
    there = shapely.points(shapely.get_coordinates(shapely.segmentize(drawn, 0.2)))
    back = shapely.points(np.asarray(exact.coords)[::7])
    return shapely.dwithin(exact, there, tolerance).all() and shapely.dwithin(drawn, back, tolerance).all()


def read_dxf(path):
    """Layer to polylines (k, 2); a closed one returns to its first point."""
    document = ezdxf.readfile(path)
    assert document.header["$INSUNITS"] == 4
    found = {"OUTLINE": [], "CHANNELS": [], "AXES": []}
    for entity in document.modelspace():
        if entity.dxftype() == "LINE":
            points = np.array([entity.dxf.start, entity.dxf.end])[:, :2]
        else:
            points = np.array(entity.get_points("xy"))
            assert entity.closed
            points = np.concatenate([points, points[:1]])
        found[entity.dxf.layer].append(points)
    return found


def read_svg(path):
    """The same from an SVG file, y turned up again."""
    root = ElementTree.parse(path).getroot()
    left, top, width, height = map(float, root.get("viewBox").split())
    assert (root.get("width"), root.get("height")) == (f"{width:.6f}mm", f"{height:.6f}mm")
    found = {}
    for group in root.iter(f"{SVG}g"):
        found[group.get("id")] = []
        for element in group.iter(f"{SVG}path"):
            d = element.get("d")
            points = np.array(re.findall(r"-?\d+\.\d+", d), float).reshape(-1, 2)
            assert np.all((points >= [left, top]) & (points <= [left + width, top + height]))
            points = np.concatenate([points, points[:1]]) if d.endswith("Z") else points
            found[group.get("id")].append(points * [1.0, -1.0])
    return found


def floor_curve(mesh):
    """The edges of a body's walls on the plane z = 0."""
    walls = mesh.triangles[np.abs(mesh.face_normals[:, 2]) < 0.5]
    edges = np.concatenate([walls[:, [0, 1]], walls[:, [1, 2]], walls[:, [2, 0]]])
    return shapely.MultiLineString(list(edges[(edges[..., 2] == 0.0).all(axis=1)][..., :2]))


def lens():
    """A body of two arcs: parent and child surface convex, 30 mm wide, one tendon on each side."""
    return rj.uniform(2)


MIDDLE = (rj.OnSurface(0.0), rj.OnSurface(0.0))


def one_link(parent, child, holes=MIDDLE):
    """Two links of which the first has these surfaces; what rolls on it is nearly flat."""
    other = rj.Surface(rj.Profile.constant(0.5, (-1.0, 1.0)), (0.0, -5.0))
    flat = rj.Surface(rj.Profile.constant(0.0, (-5.0, 5.0)), (0.0, 5.0))
    links = [rj.Link(parent, child), rj.Link(other, flat)]
    return rj.RollingChain(links, [rj.Tendon([holes, MIDDLE])])


def flat(y, width=10.0, **place):
    return rj.Surface(rj.Profile.constant(0.0, (-0.5 * width, 0.5 * width)), (0.0, y), **place)


ROLLING_CHAINS = presets_of(rj.RollingChain)
MECHANISMS = {
    **{name: rj.PRESETS[name] for name in ROLLING_CHAINS},
    **{
        f"random {seed}": lambda seed=seed: random_chain(np.random.default_rng(seed), max_links=4) for seed in range(20)
    },
}


@pytest.mark.parametrize("name", MECHANISMS)
def test_plane_files_hold_the_exact_surfaces_to_a_micrometre(name, tmp_path):
    mechanism = MECHANISMS[name]()
    export(mechanism, tmp_path / "out", ("dxf", "svg"), channel_diameter=0.0)
    poses = mechanism.poses(mechanism.neutral_angles)
    together = read_dxf(tmp_path / "out" / "assembly.dxf")["OUTLINE"]
    assert len(together) == mechanism.n_links
    for i, link in enumerate(mechanism.links):
        exact = exact_ring(link)
        for read, suffix in ((read_dxf, "dxf"), (read_svg, "svg")):
            layers = read(tmp_path / "out" / f"link_{i}.{suffix}")
            assert len(layers["OUTLINE"]) == 1 and layers["CHANNELS"] == []
            assert same_curve(layers["OUTLINE"][0], exact)
        assert same_curve(together[i], to_world(poses[i], exact))


@pytest.mark.parametrize("name", [*ROLLING_CHAINS, *(f"random {seed}" for seed in DRILLABLE)])
def test_bodies_are_closed_and_have_the_exact_surfaces_and_volume(name, tmp_path):
    mechanism = MECHANISMS[name]()
    files = export(mechanism, tmp_path / "out", ["stl"], thickness=5.0)
    for i, (link, body) in enumerate(zip(mechanism.links, bodies(mechanism), strict=True)):
        mesh = trimesh.load(files[i])
        exact = exact_ring(link)
        assert mesh.is_watertight and mesh.is_winding_consistent and mesh.body_count == 1
        np.testing.assert_allclose(mesh.bounds[:, 2], [0.0, 5.0])
        assert same_curve(floor_curve(mesh), exact)
        drilled = sum(0.16 * np.pi * np.hypot(*np.subtract(*channel.mouths)) for channel in body.channels)
        solid = 5.0 * shapely.Polygon(exact).area
        assert mesh.volume == pytest.approx(solid - drilled, abs=0.006 * drilled + 1e-4 * solid)
        assert mesh.euler_number == 2 - 2 * len(body.channels)  # as many open tunnels as channels


@pytest.mark.parametrize("seed", range(20))
def test_random_mechanism_is_made_or_refused_by_place_and_nothing_is_left(seed, tmp_path):
    mechanism = MECHANISMS[f"random {seed}"]()
    if seed in DRILLABLE:
        assert len(bodies(mechanism)) == mechanism.n_links
        return
    with pytest.raises(rj.MechanismError, match=r"tendon.* in link \d+\)? = .*expected at least"):
        export(mechanism, tmp_path / "out")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["five_link", "two_segment"])
def test_channels_run_from_hole_to_hole_and_are_open(name, tmp_path):
    mechanism = rj.preset(name)
    export(mechanism, tmp_path / "out", ("dxf", "stl"), channel_diameter=1.2, thickness=5.0)
    for i in (0, mechanism.n_links - 1):
        mesh = trimesh.load(tmp_path / "out" / f"link_{i}.stl")
        layers = read_dxf(tmp_path / "out" / f"link_{i}.dxf")
        passing = [holes[i] for holes in mechanism.hole_points if i < len(holes)]
        assert len(layers["CHANNELS"]) == 2 * len(passing)
        for k, (parent, child) in enumerate(passing):
            along = (child - parent) / np.hypot(*(child - parent))
            across = np.array([-along[1], along[0]])
            steps = parent + np.linspace(0.01, 0.99, 5)[:, None] * (child - parent)
            around = [(0.55 * c, 0.55 * s) for c, s in ((1, 0), (-1, 0), (0, 1), (0, -1), (0, 0))]
            within = np.array([[*(p + y * across), 2.5 + z] for p in steps for y, z in around])
            beside = np.array(
                [[*(p + y * across), 2.5 + z] for p in steps[1:-1] for y, z in 1.2 * np.array(around[:4])]
            )
            assert np.all(winding(mesh, within) < 0.01)
            assert np.all(winding(mesh, beside) > 0.99)
            for edge, side in zip(layers["CHANNELS"][2 * k : 2 * k + 2], (-0.6, 0.6), strict=True):
                np.testing.assert_allclose((edge - parent) @ across, side, atol=1e-9)
                assert np.all(
                    shapely.distance(shapely.LineString(exact_ring(mechanism.links[i])), shapely.points(edge)) < 1e-3
                )


def winding(mesh, points):
    """How often the mesh goes around each point: 1 inside the body, 0 outside (solid angles over 4 pi)."""
    a, b, c = np.moveaxis(mesh.triangles[None] - points[:, None, None], 2, 0)
    la, lb, lc = (np.linalg.norm(side, axis=-1) for side in (a, b, c))
    volume = (a * np.cross(b, c)).sum(-1)
    denominator = la * lb * lc + (a * b).sum(-1) * lc + (b * c).sum(-1) * la + (c * a).sum(-1) * lb
    return 2.0 * np.arctan2(volume, denominator).sum(-1) / (4.0 * np.pi)


def test_tendon_that_ends_early_has_no_channel_beyond_its_end():
    drilled = [[channel.tendon for channel in body.channels] for body in bodies(rj.two_segment())]
    assert drilled == [[0, 1, 2, 3]] * 4 + [[2, 3]] * 3


def test_finer_tolerance_is_kept_too():
    for tolerance in (1e-5, 1e-2):
        for link, body in zip(
            rj.five_link().links, bodies(rj.five_link(), Fabrication(tolerance=tolerance)), strict=True
        ):
            ring = np.concatenate([body.outline, body.outline[:1]])
            assert same_curve(ring, exact_ring(link, 6001), tolerance)


def test_curvature_breaks_are_corners_of_the_polyline():
    profile = rj.Profile.piecewise_constant([-7.0, -1.3, 2.9, 8.0], [-0.08, 0.06, -0.02])
    surface = rj.Surface(profile, (0.3, 5.0), 0.1)
    body = bodies(one_link(flat(-5.0), surface))[0]
    for s in profile.breaks:
        assert np.abs(body.child - surface.point(s)).max(axis=1).min() < 1e-12


def test_hard_surfaces_are_bodies_to_the_tolerance(tmp_path):
    """Concave on both sides, a jump of curvature, angles, and limits that are not alike."""
    parent = rj.Surface(rj.Profile.piecewise_constant([-9.0, 1.0, 6.0], [-0.08, 0.12]), (0.5, -8.0), -0.2)
    child = rj.Surface(rj.Profile.polynomial([0.03, 0.01, -0.002], (-5.0, 11.0)), (-0.5, 6.0), 0.25)
    mechanism = one_link(parent, child)
    files = export(mechanism, tmp_path / "out")
    assert same_curve(read_dxf(files[0])["OUTLINE"][0], exact_ring(mechanism.links[0]))
    assert trimesh.load(files[2]).is_watertight


def test_assembly_of_an_equilibrium_is_in_its_poses(tmp_path):
    equilibrium = rj.solve_tensions(rj.five_link(), (6, 3))
    export(equilibrium, tmp_path / "out", "svg")
    outlines = read_svg(tmp_path / "out" / "assembly.svg")["OUTLINE"]
    for drawn, link, pose in zip(outlines, rj.five_link().links, equilibrium.poses, strict=True):
        assert same_curve(drawn, to_world(pose, exact_ring(link)))


def test_dxf_has_coloured_layers_and_no_fault(tmp_path):
    export(rj.five_link(), tmp_path / "out", "dxf")
    document, auditor = recover.readfile(tmp_path / "out" / "assembly.dxf")
    assert not auditor.has_errors and not auditor.has_fixes
    colors = [document.layers.get(name).color for name in ("OUTLINE", "CHANNELS", "AXES")]
    assert len(set(colors)) == 3


def test_parts_list_says_which_links_are_alike(tmp_path):
    with export(rj.two_segment(), tmp_path / "out", "svg")[-1].open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["part"] for row in rows] == [f"link_{i}" for i in range(7)]
    assert [row["same as"] for row in rows] == ["", "link_0", "link_0", "link_0", "", "link_4", "link_4"]
    width = 2 * 20.0 * np.sin(12.0 / 20.0)
    assert [(float(row["width [mm]"]), float(row["height [mm]"])) for row in rows] == [(round(width, 3), 15.0)] * 7
    assert {row["channels"] for row in rows[4:]} == {"2"}


@pytest.mark.parametrize(
    ("mechanism", "options", "parts"),
    [
        (one_link(flat(1.0, 4.0, angle=0.9), flat(0.0)), {}, ["outline of link 0", "does not cross itself", "limits"]),
        (one_link(flat(9.0), flat(5.0)), {}, ["area of link 0", "above the parent"]),
        (one_link(flat(-5.0), flat(5.0), ((0.0, 0.0), (0.0, 0.0))), {}, ["tendon 0 in link 0", "diameter"]),
        (one_link(flat(-5.0), flat(5.0), ((0.0, -9.0), (0.0, 5.0))), {}, ["length outside", "3.99", "tendon 0"]),
        (one_link(flat(-5.0), flat(5.0), ((-4.0, 0.0), (4.0, 0.1))), {}, ["channel", "surface to surface"]),
        (one_link(flat(-5.0), flat(5.0), ((4.5, -5.0), (4.5, 5.0))), {}, ["wall of 0.4 mm", "tendon 0 in link 0"]),
        (rj.uniform(2, tendon_offset=0.5), {}, ["tendons 0 and 1 in link 0", "at least 0.4 mm"]),
        (lens(), {"channel_diameter": 9.0, "thickness": 12.0}, ["channel", "tendon 0 in link 0"]),
    ],
)  # fmt: skip
def test_what_cannot_be_made_is_refused_with_its_place(mechanism, options, parts, tmp_path):
    with pytest.raises(rj.MechanismError) as caught:
        export(mechanism, tmp_path / "out", **options)
    assert all(part in str(caught.value) for part in parts), caught.value
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("value", [np.nan, np.inf, -1.0, 1e300, "six", [1.0, 2.0], None])
@pytest.mark.parametrize("name", ["thickness", "channel_diameter", "tolerance", "wall"])
def test_numbers_beyond_their_range_are_refused_by_name(name, value, tmp_path):
    with pytest.raises(rj.InvalidInput, match=name.replace("_", " ")):
        export(lens(), tmp_path / "out", **{name: value})
    assert list(tmp_path.iterdir()) == []


def test_channel_wider_than_the_body_is_thick_is_refused():
    assert Fabrication(thickness=1.6).thickness == 1.6  # 0.8 of channel and twice 0.4 of wall
    for sizes in ({"thickness": 1.59}, {"channel_diameter": 6.0}, {"thickness": 0.0}, {"channel_diameter": 0.01}):
        with pytest.raises(rj.InvalidInput, match=r"thickness|channel diameter"):
            Fabrication(**sizes)


def test_surface_of_absurd_curvature_is_refused_and_not_sampled():
    coil = rj.Surface(rj.Profile.constant(-2.0, (-499.0, 499.0)), (0.0, 5.0))
    with pytest.raises(rj.MechanismError, match="number of points"):
        bodies(one_link(flat(-5.0), coil), Fabrication(tolerance=1e-5))


def test_hole_inside_the_body_has_a_channel_through_to_both_surfaces():
    channel = bodies(one_link(flat(-5.0), flat(5.0), ((1.0, -2.0), (1.0, 3.0))))[0].channels[0]
    np.testing.assert_allclose(channel.mouths, [[1.0, -5.0], [1.0, 5.0]], atol=1e-12)


def test_mouth_that_opens_into_another_part_of_the_body_is_refused():
    """Above the channel's mouth, at some distance, the child surface comes back as a hook 2 mm thick."""

    def hooked(gap):
        lengths = [8.0, 0.5 * np.pi * gap, 7.0, np.pi, 14.0]
        profile = rj.Profile.piecewise_constant(np.cumsum([-5.0, *lengths]), [0.0, 2.0 / gap, 0.0, -1.0, 0.0])
        return one_link(flat(-5.0, 20.0), rj.Surface(profile, (0.0, 5.0)))

    np.testing.assert_allclose(bodies(hooked(0.1))[0].channels[0].mouths, [[0.0, -5.0], [0.0, 5.0]], atol=1e-9)
    with pytest.raises(rj.MechanismError, match="free space"):
        bodies(hooked(0.04))


@pytest.mark.parametrize("formats", [(), "iges", ("dxf", "iges"), [3]])
def test_unknown_format_is_refused(formats, tmp_path):
    with pytest.raises(rj.InvalidInput, match="one or more of dxf, svg, stl, step, pdf, png"):
        export(lens(), tmp_path / "out", formats)


def test_file_that_is_there_is_kept_unless_overwritten(tmp_path):
    mine = tmp_path / "link_1.svg"
    mine.write_text("mine", encoding="utf-8")
    with pytest.raises(rj.InvalidInput, match=r"link_1\.svg"):
        export(lens(), tmp_path, "svg")
    assert [path.name for path in tmp_path.iterdir()] == ["link_1.svg"] and mine.read_text() == "mine"
    assert mine in export(lens(), tmp_path, "svg", overwrite=True)
    assert "<svg" in mine.read_text() and not list(tmp_path.glob(".*"))


def test_failure_half_way_leaves_no_folder_and_no_file(tmp_path, monkeypatch):
    def broken(path, drawn):
        path.write_text("half", encoding="utf-8")
        raise OSError("disk full")

    monkeypatch.setattr("rollingjoint.cad.files.write_dxf", broken)
    (tmp_path / "old").mkdir()
    for folder in ("new", "old"):
        with pytest.raises(OSError, match="disk full"):
            export(lens(), tmp_path / folder)
    assert list(tmp_path.rglob("*")) == [tmp_path / "old"]


def test_folder_that_is_a_file_or_has_no_parent_is_refused(tmp_path):
    (tmp_path / "file").write_text("", encoding="utf-8")
    for folder in ("file", "file/below", "no/such"):
        with pytest.raises(rj.InvalidInput, match="folder"):
            export(lens(), tmp_path / folder)


@pytest.mark.parametrize(
    ("module", "suffix"), [("shapely", "svg"), ("ezdxf", "dxf"), ("manifold3d", "stl"), ("trimesh", "stl")]
)
def test_missing_package_is_named_with_the_command_that_installs_it(module, suffix, tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, module, None)
    with pytest.raises(rj.InvalidInput, match=rf"'{module}'.*pip install .rollingjoint\[cad\]"):
        export(lens(), tmp_path / "out", suffix)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_package_loads_no_cad_library_until_a_file_is_written(run_python):
    program = "import sys, rollingjoint.cad, rollingjoint.cli; print(*sys.modules)"
    loaded = set(run_python("-c", program).split())
    assert not loaded & {"ezdxf", "shapely", "trimesh", "manifold3d", "matplotlib"}


def test_batch_of_equilibria_is_refused(tmp_path):
    lanes = rj.solve_tensions_batch(rj.five_link(), np.ones((3, 2)))
    with pytest.raises(rj.InvalidInput, match="one equilibrium"):
        export(lanes, tmp_path / "out")


def test_equilibrium_that_is_not_usable_is_refused(tmp_path):
    with pytest.raises(rj.SolverError, match="INDETERMINATE"):
        export(rj.solve_tensions(rj.five_link(), (0, 0)), tmp_path / "out")
    assert not Path(tmp_path / "out").exists()
