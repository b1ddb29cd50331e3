"""A workspace lists reachable tips, and its numbers are those of solves."""

import contextlib
import io
from pathlib import Path

import numpy as np
import pytest

import rollingjoint as rj
from rollingjoint.cli import main
from rollingjoint.errors import InvalidInput
from rollingjoint.statics.sensitivity import dtip_dforce
from tests.pages import examples

PAGE = Path(__file__).parents[3] / "docs" / "workspace.md"
LIMITS = (1.0, 10.0)


@pytest.fixture(scope="module")
def space():
    return rj.workspace(rj.two_segment(), (), LIMITS, cells=20)


def test_cells_hold_tips_within_the_limits_and_nearly_all_random_tips_are_in_cells(space):
    at = space.equilibria
    np.testing.assert_array_equal(np.floor(at.tip / space.cell), space.cells)
    assert at.ok.all() and (at.tensions >= LIMITS[0] - 1e-6).all() and (at.tensions <= LIMITS[1] + 1e-6).all()
    tensions = np.random.default_rng(5).uniform(*LIMITS, (2000, 4))
    tips = rj.solve_tensions_batch(rj.two_segment(), tensions).require().tip
    known = {tuple(cell) for cell in space.cells}
    assert np.mean([tuple(cell) in known for cell in np.floor(tips / space.cell).astype(int)]) > 0.98
    assert len(known) == len(space.cells) and space.size == pytest.approx(len(known) * space.cell**2)


def test_motion_and_compliance_are_differences_of_solves(space):
    row = int(np.argmax(space.force))
    at, chain, step = space.equilibria.row(row), rj.two_segment(), 1e-4
    lengths = at.lengths - at.tensions / chain.stiffnesses
    for j in range(4):
        moved = rj.solve_lengths(chain, lengths + step * np.eye(4)[j], start=at).tip - at.tip
        np.testing.assert_allclose(space.motion[row, :, j], moved / step, atol=1e-4)
    for k in range(2):
        pushed = rj.solve_lengths(chain, lengths, [rj.WorldForce(-1, tuple(step * np.eye(2)[k]))], start=at).tip
        np.testing.assert_allclose(space.compliance[row, :, k], (pushed - at.tip) / step, rtol=1e-3, atol=1e-4)
    stiffnesses, axes = space.principal_stiffness
    turned = axes[row].T @ space.compliance[row] @ axes[row]
    np.testing.assert_allclose(turned, np.diag(1.0 / stiffnesses[row]), atol=1e-10)
    gains = np.linalg.svd(space.motion[row])[1]
    assert space.dexterity[row] == pytest.approx(gains[1] / gains[0])


def test_the_force_of_a_held_tip_is_that_of_a_stiff_spring(space):
    row = int(np.argmax(space.force))
    at, chain, step = space.equilibria.row(row), rj.two_segment(), 1e-3
    wall = [rj.Spring(-1, 1e6, tuple(at.tip))]
    for j in range(4):
        tensions = at.tensions + step * np.eye(4)[j]
        held = rj.solve_tensions(chain, tensions, wall, start=at)
        force = 1e6 * (held.tip - at.tip)  # on the spring
        np.testing.assert_allclose(space.force_rates[row, :, j], force / step, rtol=0.02, atol=1e-3)


def test_the_force_in_every_direction_is_the_least_over_directions(space):
    row = int(np.argmax(space.force))
    rates, tensions = space.force_rates[row], space.equilibria.tensions[row]
    ways = np.stack([np.cos(a := np.linspace(0, 2 * np.pi, 20_000)), np.sin(a)], axis=-1) @ rates
    farthest = np.maximum(ways * (LIMITS[0] - tensions), ways * (LIMITS[1] - tensions)).sum(axis=1)
    assert space.force[row] == pytest.approx(farthest.min(), rel=1e-3) and space.force[row] > 0.5
    assert (space.force >= 0.0).all()


@pytest.mark.slow
def test_a_workspace_in_space_and_under_a_load():
    space = rj.workspace(rj.pitch_yaw_two_segment(), [rj.WorldForce(-1, (0.1, 0.0, 0.0))], LIMITS, cells=6)
    rows = np.argsort(space.force)[-3:]
    directions = np.random.default_rng(0).normal(size=(20_000, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    for row in rows:
        ways, tensions = directions @ space.force_rates[row], space.equilibria.tensions[row]
        farthest = np.maximum(ways * (LIMITS[0] - tensions), ways * (LIMITS[1] - tensions)).sum(axis=1)
        assert space.force[row] <= farthest.min() + 1e-9 and space.force[row] > 0.9 * farthest.min() > 0.1
    assert space.cells.shape[1] == 3 and "mm³" in repr(space)


def test_held_at_tensions_the_tip_is_softer():
    chain = rj.two_segment()
    at = rj.solve_lengths(chain, rj.reach(chain, (-30.0, 82.0), (), LIMITS, prefer="margins").lengths)
    values = [np.linalg.eigvalsh(dtip_dforce(at, given)) for given in ("lengths", "tensions")]
    assert (values[0] <= values[1] + 1e-12).all() and values[1].max() > 1.5 * values[0].max()


def test_wrong_inputs_are_one_line():
    chain = rj.two_segment()
    for call in (
        lambda: rj.workspace(chain, (), (1.0, np.inf)),
        lambda: rj.workspace(chain, (), (5.0, 1.0)),
        lambda: rj.workspace(chain, cells=0),
        lambda: rj.workspace(chain, prefer="most"),
        lambda: rj.workspace("two_segment"),
    ):
        with pytest.raises(InvalidInput) as error:
            call()
        assert "\n" not in str(error.value)


def test_the_page_prints_what_it_says():
    ((program, expected),) = examples(PAGE.read_text("utf-8"))
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        exec(program, {})
    assert printed.getvalue() == expected


def test_the_command_draws_and_prints(capsys, tmp_path):
    case = ["workspace", "two_segment", "--tension-limits", "1", "10", "--cells", "12"]
    assert main([*case, "--out", str(tmp_path / "space.png")]) == 0
    assert "mm²" in capsys.readouterr().out and (tmp_path / "space.png").stat().st_size > 10_000
    assert main([*case, "--csv"]) == 0
    head, *lines = capsys.readouterr().out.splitlines()
    assert head.startswith("tip_x_mm,tip_y_mm,dexterity,force_N") and len(lines) > 10
    assert main(["workspace", "two_segment", "--tension-limits", "1", "inf"]) == 2
    assert capsys.readouterr().err.count("\n") == 1
