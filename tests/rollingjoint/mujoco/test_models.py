"""MuJoCo models: an engine puts links where they are here, and they come to rest where they balance here."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rollingjoint import CapstanFriction, RollingChain, flexible_arm, small_arm, solve_tensions
from rollingjoint.chain.presets import preset
from rollingjoint.chain.rolling import Link
from rollingjoint.chain.tendon import Tendon
from rollingjoint.cli import main
from rollingjoint.errors import InvalidInput
from rollingjoint.io.mechanism_file import load_mechanism
from rollingjoint.load import TorsionSpring
from rollingjoint.mujoco import accuracy, mjcf, positions
from rollingjoint.mujoco.coupling import Circles, coupling, relative_poses
from rollingjoint.profile import Profile, Surface


def circles():
    """Links that are not level, whose round ends roll in larger hollow ones."""
    below = Surface(Profile.constant(-0.05, (-9.0, 9.0)), (1.0, 9.0), 0.2)
    above = Surface(Profile.constant(-0.02, (-9.0, 9.0)), (-2.0, -10.0), -0.3)
    return RollingChain([Link(above, below)] * 4, [Tendon.on_surfaces(-6.0), Tendon.on_surfaces(6.0)])


def spline():
    """The example file without its friction."""
    chain = load_mechanism("configs/mechanism/spline_example.yaml")
    return replace(chain, friction=None, tendons=[replace(tendon, friction=None) for tendon in chain.tendons])


CHAINS = {
    "uniform": preset("uniform"),
    "two_segment": preset("two_segment"),
    "five_link": preset("five_link"),
    "circles": circles(),
    "spline": spline(),
}
LARGEST = {"uniform": 1e-9, "two_segment": 1e-9, "circles": 1e-9, "five_link": 0.3, "spline": 0.5}  # mm


@pytest.fixture
def engine():
    return pytest.importorskip("mujoco", reason="MuJoCo is not installed")


def random_angles(chain, count=20):
    low, high = chain.joint_limits.T
    return chain.joint_angles(np.random.default_rng(3).uniform(low, high, (count, chain.n_joints)))


@pytest.mark.parametrize("name", CHAINS)
def test_engine_puts_links_and_tendons_as_near_to_their_poses_as_stated(name, engine):
    chain = CHAINS[name]
    model = engine.MjModel.from_xml_string(mjcf(chain))
    state, wrong, lengths = engine.MjData(model), [], []
    for phi in random_angles(chain):
        state.qpos[:] = positions(chain, phi)
        engine.mj_forward(model, state)
        wrong.append(np.linalg.norm(1e3 * state.xpos[1:, :2] - chain.poses(phi)[1:, :2], axis=-1).max())
        angles = np.arctan2(state.xmat[1:, 3], state.xmat[1:, 0])
        assert np.exp(1j * angles) == pytest.approx(np.exp(1j * np.cumsum(phi)), abs=1e-9)
        lengths.append(np.abs(1e3 * state.ten_length - chain.tendon_lengths(phi)).max())
    stated = accuracy(chain)
    assert max(wrong) <= 1.05 * stated.largest + 1e-9
    assert stated.largest < LARGEST[name] and stated.tip <= stated.largest
    assert max(lengths) < 4 * LARGEST[name]


def test_circles_are_exact_and_other_surfaces_are_not():
    exact = {name: (accuracy(chain).exact, chain.n_joints) for name, chain in CHAINS.items()}
    assert exact["uniform"] == (4, 4) and exact["two_segment"] == (6, 6) and exact["circles"] == (3, 3)
    assert exact["five_link"] == (0, 4)


def test_slides_are_as_near_as_polynomials_of_degree_four_can_be():
    chain = CHAINS["five_link"]
    child, parent = chain.links[3].child, chain.links[4].parent
    joint = coupling(child, parent)
    exact = relative_poses(child, parent, np.linspace(*chain.joint_limits[3], 501))
    assert not isinstance(joint, Circles)
    assert np.abs(joint.poses(exact[:, 2]) - exact).max() < 0.004


@pytest.mark.parametrize(
    ("name", "tensions", "near"),
    [
        ("uniform", [6, 3], 1e-6),
        ("two_segment", [6, 3, 2, 1], 1e-6),
        ("circles", [9, 3], 1e-6),
        ("five_link", [6, 3], 3.0),
    ],
)
def test_engine_rests_where_our_solver_does(name, tensions, near, engine):
    chain = CHAINS[name]
    found = solve_tensions(chain, tensions)
    model = engine.MjModel.from_xml_string(mjcf(chain))
    state = engine.MjData(model)
    state.qpos[:] = positions(chain, found.joint_angles)
    state.ctrl[:] = tensions
    engine.mj_step(model, state, 1500)
    assert np.abs(state.qvel).max() < 1e-4
    assert np.linalg.norm(1e3 * state.site("tip").xpos[:2] - found.tip[:2]) < near
    lengths = 1e3 * state.ten_length
    assert lengths == pytest.approx(found.lengths, abs=max(near, 1e-9))


def test_arm_in_the_engine_balances_where_it_does_here(engine):
    arm, tensions = small_arm(5), [5, 0, 1, 4]
    found = solve_tensions(arm, tensions)
    model = engine.MjModel.from_xml_string(mjcf(arm))
    state = engine.MjData(model)
    state.qpos[:] = positions(arm, found.joint_angles)
    state.ctrl[:] = tensions
    engine.mj_forward(model, state)
    assert 1e3 * state.site("tip").xpos == pytest.approx(found.tip, abs=1e-9)
    assert np.abs(1e3 * state.qfrc_smooth).max() < 1e-9 * np.abs(found.tendon_rates * found.tensions).max()


@pytest.mark.parametrize(
    ("mechanism", "message"),
    [
        (replace(preset("uniform"), springs=[TorsionSpring(1, 5.0)]), "a mechanism without springs"),
        (replace(preset("uniform"), friction=CapstanFriction(0.1)), "a mechanism without friction"),
        (flexible_arm().replace(model="linear"), "'exact'"),
    ],
)
def test_what_the_model_would_leave_out_is_refused(mechanism, message):
    with pytest.raises(InvalidInput, match=message):
        mjcf(mechanism)


def test_command_writes_chains_and_arms_and_says_how_exact_they_are(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["export", "two_segment", "--mjcf", "a.xml"]) == 0
    assert "a.xml: 6 of 6 rolling contacts exact" in capsys.readouterr().out
    assert main(["export", "small_arm", "--mjcf", "b.xml"]) == 0
    assert capsys.readouterr().out == "b.xml: an arm, exactly\n"
    assert Path("a.xml").read_text() == mjcf(preset("two_segment")) + "\n"
    assert main(["export", "uniform", "--mjcf", "a.xml"]) == 2
    assert "expected a new file. --overwrite replaces it." in capsys.readouterr().err
    assert main(["export", "uniform", "--mjcf", "a.xml", "--overwrite"]) == 0
    assert main(["export", "uniform"]) == 2
    assert "--out" in capsys.readouterr().err
