"""Chains in space as MuJoCo models: poses, lengths and balance where the solver has its equilibrium."""

import numpy as np
import pytest

from rollingjoint import PointHinge, RollingContact, SpaceTendon, SpatialChain, pitch_yaw, preset, solve_tensions
from rollingjoint.cli.commands import main
from rollingjoint.mujoco import mjcf, positions
from rollingjoint.mujoco.coupling import Slides
from rollingjoint.mujoco.space import couplings
from tests.rollingjoint.chain.spatial_chains import arc, random_chain


@pytest.fixture
def engine():
    return pytest.importorskip("mujoco", reason="MuJoCo is not installed")


def oblique():
    """Unequal circles at any azimuth with turned surfaces, hinges of any axis, springs that rest elsewhere."""
    rng = np.random.default_rng(3)
    joints = []
    for i in range(6):
        if i % 3 == 2:
            joints.append(PointHinge(rng.normal(size=3), (0.2, 0.1, 3.0), (0.1, -0.2, -3.0), 15.0, 0.1, (-0.5, 0.5)))
            continue
        child = arc(-rng.uniform(0.1, 0.3), (0.1, 3.0), angle=0.1 * rng.normal())
        parent = arc(rng.uniform(0.05, 0.3), (-0.1, -3.0), angle=0.1 * rng.normal())
        joints.append(RollingContact(rng.uniform(-3, 3), parent, child, 3.0, 0.2, 10.0, 0.05))
    tendons = []
    for k, end in enumerate((6, 6, 4, 6)):
        x, y = 2.5 * np.cos(1.5 * k), 2.5 * np.sin(1.5 * k)
        tendons.append(SpaceTendon([((x, y, -1.8), (x, y, 1.8))], end))
    return SpatialChain(joints, tendons)


CHAINS = {
    "pitch_yaw": (pitch_yaw(6), 1e-9),
    "two": (preset("pitch_yaw_two_segment"), 1e-9),
    "oblique": (oblique(), 1e-9),
}
CHAINS["any surfaces"] = random_chain(np.random.default_rng(2)), 0.05


@pytest.mark.parametrize("name", CHAINS)
def test_the_engine_has_the_poses_and_lengths_of_the_solver_and_balances_there(name, engine):
    chain, near = CHAINS[name]
    at = solve_tensions(chain, np.linspace(2.0, 3.0, chain.n_tendons))
    assert at.ok
    model = engine.MjModel.from_xml_string(mjcf(chain))
    state = engine.MjData(model)
    state.qpos[:] = positions(chain, at.joint_angles)
    state.ctrl[:] = at.tensions
    engine.mj_forward(model, state)
    assert 1e3 * state.xpos[1:] == pytest.approx(at.positions[1:], abs=near)
    assert state.xmat[1:].reshape(-1, 3, 3) == pytest.approx(at.rotations[1:], abs=1e-9)
    assert 1e3 * state.ten_length == pytest.approx(at.lengths, abs=4 * near)
    rates = (positions(chain, at.joint_angles + 1e-4 * np.eye(chain.n_joints)) - state.qpos) / 1e-4
    moments = 1e3 * (rates @ state.qfrc_smooth)[at.free_joints]
    sizes = np.abs(at.tendon_rates) @ at.tensions
    if near < 1e-6:  # elsewhere the rates of the fit are not those of the surfaces
        assert np.abs(moments).max() < 1e-9 * sizes.max()


def test_the_command_says_how_many_joints_are_exact(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["export", "pitch_yaw", "--mjcf", "a.xml"]) == 0
    assert capsys.readouterr().out == "a.xml: 12 of 12 joints exact\n"
    assert all(isinstance(joint, Slides) for joint in couplings(CHAINS["any surfaces"][0]))
