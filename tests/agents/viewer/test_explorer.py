"""The mechanism in a person's hands, without a browser."""

import ast
import io
import zipfile

import numpy as np
import pytest

from agents.viewer.explorer import LENGTHS, TENSIONS, Explorer
from rollingjoint import Status, WorldForce, five_link, solve_lengths, solve_tensions
from rollingjoint.chain.presets import PRESETS
from rollingjoint.errors import MechanismError
from rollingjoint.io.mechanism_file import load_mechanism, mechanism_to_dict


@pytest.mark.parametrize("name", PRESETS)
def test_it_solves_what_a_person_sets(name):
    explorer = Explorer.preset(name)
    m, size = explorer.mechanism.n_tendons, len(explorer.inputs.force)
    tensions, force = (5.0, *(3.0,) * (m - 1)), (0.1, *(0.0,) * (size - 1))
    explorer.change(tensions=tensions, force=force, link=1)
    expected = solve_tensions(PRESETS[name](), tensions, [WorldForce(1, force)])
    assert explorer.found.tip == pytest.approx(expected.tip, abs=1e-7)
    assert explorer.headline.startswith("**CONVERGED**")


def test_another_input_holds_the_mechanism_where_it_is():
    explorer = Explorer.preset("five_link")
    explorer.change(tensions=(6.0, 3.0), force=(0.2, 0.1))
    tip = explorer.found.tip
    explorer.change(drive=LENGTHS)
    assert explorer.found.tip == pytest.approx(tip, abs=1e-6)
    explorer.change(pulls=(1.0, 0.5))
    chain = five_link()
    expected = solve_lengths(chain, chain.neutral_lengths - (1.0, 0.5), [WorldForce(4, (0.2, 0.1))])
    assert explorer.found.tip == pytest.approx(expected.tip, abs=1e-6)
    tip = explorer.found.tip
    explorer.change(drive=TENSIONS)
    assert explorer.found.tip == pytest.approx(tip, abs=1e-6)


def test_what_cannot_be_solved_says_so_and_the_last_pose_stays():
    explorer = Explorer.preset("five_link")
    tip = explorer.found.tip
    explorer.change(tensions=(0.0, 0.0))
    assert explorer.found.status is Status.INDETERMINATE and explorer.headline.startswith("⚠ **INDETERMINATE**")
    assert explorer.usable.tip == pytest.approx(tip) and not explorer.ellipses()[1] and not len(explorer.contact_arrows)
    explorer.change(tensions=(3.0, 3.0))
    assert explorer.found.ok


def test_curvatures_that_make_no_chain_change_nothing():
    explorer = Explorer.preset("five_link")
    before, factors = explorer.inputs, list(explorer.inputs.curvatures)
    factors[0] = 0.5
    with pytest.raises(MechanismError, match="curvature"):
        explorer.change(curvatures=tuple(factors))
    assert explorer.inputs == before and explorer.mechanism is explorer.nominal


def test_factors_of_curvature_are_those_of_the_surfaces():
    explorer = Explorer.preset("five_link")
    factors = [1.0] * len(explorer.inputs.curvatures)
    factors[explorer.surface_names.index("Link 2, bottom")] = 1.2
    explorer.change(curvatures=tuple(factors))
    s = np.linspace(-5.0, 5.0, 7)
    changed, nominal = explorer.mechanism.links[2], five_link().links[2]
    assert changed.parent.curvature(s) == pytest.approx(1.2 * nominal.parent.curvature(s))
    assert changed.child.profile == nominal.child.profile


def test_friction_remembers_the_way():
    tips = []
    for last in (2.0, 6.0):
        explorer = Explorer.preset("five_link")
        explorer.change(friction=0.1)
        explorer.change(tensions=(last, 3.0))
        explorer.change(tensions=(4.0, 3.0))
        tips.append(explorer.found.tip)
    assert np.linalg.norm(tips[0] - tips[1]) > 0.5


def test_compliance_is_how_far_a_force_moves_the_tip():
    explorer = Explorer.preset("five_link")
    small = 1e-4
    moved = [solve_tensions(five_link(), (3.0, 3.0), [WorldForce(-1, force)]).tip for force in small * np.eye(2)]
    numeric = (np.array(moved) - explorer.found.tip).T / small
    assert explorer.compliance == pytest.approx(numeric, rel=1e-3)
    force, (ellipse,) = explorer.ellipses()
    most = np.linalg.norm(ellipse - explorer.found.tip, axis=1).max()
    assert most == pytest.approx(force * np.linalg.norm(numeric, 2), rel=0.01) and most < 0.2 * five_link().length


def test_contact_forces_balance_the_links():
    explorer = Explorer.preset("five_link")
    arrows = explorer.contact_arrows
    assert arrows.shape == (4, 2, 2)
    assert np.linalg.norm(arrows[0, 1]) == pytest.approx(6.0, abs=0.2)  # two tendons of 3 N press the first joint


def test_what_the_tip_reaches_is_reached():
    explorer = Explorer.preset("small_arm")
    points = explorer.reached()
    assert points.shape[1] == 3 and len(points) > 1000
    assert np.linalg.norm(points, axis=1).max() <= explorer.mechanism.length + 1e-6


@pytest.mark.parametrize("change", [{}, {"friction": 0.1}, {"drive": LENGTHS, "pulls": (1.234567891, 2.0)}])
def test_the_program_solves_the_same(change, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    explorer = Explorer.preset("five_link")
    explorer.change(tensions=(4.0, 3.0), **change)
    explorer.change(force=(0.1, 0.2))
    (tmp_path / explorer.file_name).write_text(explorer.yaml)
    names = {}
    exec(explorer.python, names)
    assert names["found"].tip == pytest.approx(explorer.found.tip, abs=1e-6)
    assert capsys.readouterr().out.startswith("stable equilibrium [")


def test_the_program_of_a_file_runs_no_part_of_its_name():
    name = 'x"); raise SystemExit("\\'
    program = ast.parse(Explorer(five_link(), name).python)
    texts = [node.value for node in ast.walk(program) if isinstance(node, ast.Constant) and isinstance(node.value, str)]
    assert texts == [f"{name}.yaml"]


def test_the_file_is_the_mechanism(tmp_path):
    explorer = Explorer.preset("two_segment")
    explorer.change(friction=0.05)
    (tmp_path / "mine.yaml").write_text(explorer.yaml)
    read = load_mechanism(tmp_path / "mine.yaml")
    assert mechanism_to_dict(read) == mechanism_to_dict(explorer.mechanism) and read.has_friction


def test_contact_forces_and_margins_in_space_are_those_of_the_reactions():
    explorer = Explorer.preset("pitch_yaw")
    explorer.change(tensions=(3.0, 2.0, 2.0, 4.0), force=(0.1, 0.0, 0.0))
    arrows, found = explorer.contact_arrows, explorer.found
    begins, forces = np.moveaxis(arrows.reshape(12, 2, 2, 3), 2, 0)
    assert begins.mean(axis=1) == pytest.approx(found.contact_points)
    assert np.linalg.norm(begins[:, 0] - begins[:, 1], axis=-1) == pytest.approx(8.0)
    total = forces.sum(axis=1)
    assert np.linalg.norm(total, axis=1) == pytest.approx(np.linalg.norm(found.reactions[:, :3], axis=1))
    pulls = np.array([line[-2] - line[-3] for line in explorer.mechanism.tendon_polyline(found.poses)])
    pull = found.tensions @ (pulls / np.linalg.norm(pulls, axis=1)[:, None])
    assert total[-1] == pytest.approx(pull - [0.1, 0.0, 0.0])  # what the last link needs to stay
    assert f"tilting margin {found.tilting_margins.min():.2f} N" in explorer.headline
    assert f"friction required {found.friction_required.max():.2f}" in explorer.headline


def test_workshop_files_are_an_archive():
    pytest.importorskip("ezdxf")
    packed = zipfile.ZipFile(io.BytesIO(Explorer.preset("five_link").workshop_files("dxf")))
    assert "link_0.dxf" in packed.namelist() and "assembly.dxf" in packed.namelist()
