"""STEP: solids read back, volumes as those of the STL; depths of channels; a sheet for every unlike link."""

import math
import sys

import numpy as np
import pytest

import rollingjoint as rj
from rollingjoint.cad import Fabrication, bodies, export
from rollingjoint.cad.solid import solid
from rollingjoint.errors import InvalidInput, MechanismError

trimesh = pytest.importorskip("trimesh")
pytest.importorskip("manifold3d")


def read_back(path):
    """Volumes of the solids in a STEP file, and their lowest and highest corners."""
    from OCP.Bnd import Bnd_Box
    from OCP.BRepBndLib import BRepBndLib
    from OCP.STEPControl import STEPControl_Reader

    from rollingjoint.cad.kits import Exact, solids_of

    reader = STEPControl_Reader()
    reader.ReadFile(str(path))
    reader.TransferRoots()
    shape = reader.OneShape()
    box = Bnd_Box()
    BRepBndLib.AddOptimal_s(shape, box, False, False)
    corners = np.array([[*map(float, (p.X(), p.Y(), p.Z()))] for p in (box.CornerMin(), box.CornerMax())])
    return [Exact().volume(one) for one in solids_of(shape)], corners


@pytest.mark.parametrize("name", ["five_link", "two_segment", "pitch_yaw", "small_arm"])
def test_solids_of_step_are_those_of_stl(name, tmp_path):
    pytest.importorskip("OCP")
    mechanism = rj.preset(name)
    export(mechanism, tmp_path, ("stl", "step"))
    total = 0.0
    for i in range(mechanism.n_links):
        (volume,), corners = read_back(tmp_path / f"link_{i}.step")
        mesh = trimesh.load_mesh(tmp_path / f"link_{i}.stl")
        assert volume == pytest.approx(mesh.volume, rel=5e-4)
        assert corners == pytest.approx(mesh.bounds, abs=5e-3)
        total += volume
    volumes, _ = read_back(tmp_path / "assembly.step")
    assert len(volumes) == mechanism.n_links and sum(volumes) == pytest.approx(total, rel=1e-9)
    export(mechanism, tmp_path / "again", "step")
    assert (tmp_path / "again" / "link_1.step").read_bytes() == (tmp_path / "link_1.step").read_bytes()


def test_an_equilibrium_is_assembled_in_its_pose(tmp_path):
    pytest.importorskip("OCP")
    equilibrium = rj.solve_tensions(rj.five_link(), (6.0, 3.0))
    export(equilibrium, tmp_path, "step")
    _, corners = read_back(tmp_path / "assembly.step")
    turns = [np.array([[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]]) for a in equilibrium.poses[:, 2]]
    outlines = [body.outline for body in bodies(rj.five_link())]
    places = zip(outlines, turns, equilibrium.poses[:, :2], strict=True)
    points = np.concatenate([outline @ turn + place for outline, turn, place in places])
    assert corners[:, :2] == pytest.approx(np.array([points.min(0), points.max(0)]), abs=5e-3)


def test_without_the_package_one_line_says_what_to_install(tmp_path, monkeypatch):
    for name in [name for name in sys.modules if name.partition(".")[0] == "OCP"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "OCP", None)
    with pytest.raises(InvalidInput, match=r"rollingjoint\[step\]"):
        export(rj.uniform(2), tmp_path / "out", "step")
    assert not (tmp_path / "out").exists()


def test_channels_lie_at_their_depths():
    for body in bodies(rj.five_link(), Fabrication(thickness=8.0, depths=(2.0, 5.5))):
        assert [channel.depth for channel in body.channels] == [2.0, 5.5]
        corners = solid(body).vertices
        bored = corners[(corners[:, 2] > 0.1) & (corners[:, 2] < 7.9)]
        for side, depth in ((-1.0, 2.0), (1.0, 5.5)):
            z = bored[bored[:, 0] * side > 0.0, 2]
            assert (z.min(), z.max()) == pytest.approx((depth - 0.4, depth + 0.4), abs=2e-3)
    assert bodies(rj.five_link())[0].channels[0].depth == 3.0


def test_channels_that_cross_need_depths():
    left, right = rj.OnSurface(-8.0), rj.OnSurface(8.0)
    ends = (left, right), (right, left)
    tendons = [rj.Tendon([(one, one), (one, other), (other, other)], 2) for one, other in ends]
    mechanism = rj.RollingChain(rj.uniform(3).links, tendons)
    with pytest.raises(MechanismError, match="give the channels depths"):
        bodies(mechanism)
    assert len(bodies(mechanism, Fabrication(depths=(2.0, 4.0)))) == 3


@pytest.mark.parametrize("depths", [(0.3,), (5.9, 1.0), (math.nan,), (1.0, 2.0, 3.0)])
def test_depths_outside_the_body_are_refused(depths, tmp_path):
    with pytest.raises(InvalidInput, match="depths"):
        export(rj.five_link(), tmp_path / "out", "dxf", depths=depths)
    with pytest.raises(InvalidInput, match="depths"):
        export(rj.pitch_yaw(), tmp_path / "out", depths=(1.0,))


@pytest.mark.slow
def test_every_unlike_link_has_a_sheet(tmp_path):
    for mechanism, sheets in ((rj.five_link(), 5), (rj.uniform(4), 1)):
        files = {path.name for path in export(mechanism, tmp_path, "pdf", overwrite=True)}
        assert files == {"assembly.pdf", "parts.csv", *(f"link_{i}.pdf" for i in range(sheets))}
