"""Rigid walls without friction: MuJoCo's contacts bring a chain to rest where the solver finds its equilibrium."""

import numpy as np
import pytest

import rollingjoint as rj
from rollingjoint.mujoco import mjcf, positions
from tests.rollingjoint.walls.scenes import CHAIN

TENSIONS = (6, 2, 2, 2)
SCENES = {  # walls, base, largest distance of the tip [mm]
    "plane": ([rj.HalfPlane((1, 0.2), -12)], (0, 0, 0), 1e-3),  # two links touch it at nearly the same place
    "disc": ([rj.Disc((-14, 45), 6)], (1, 2, 0.05), 2e-6),
    "capsule": ([rj.Capsule((-22, 45), (-14, 64), 2)], (0, 0, 0), 2e-6),
    "polygon": ([rj.Polygon([(-24, 40), (-14, 50), (-26, 60)], 1)], (0, 0, 0), 2e-6),
}


@pytest.mark.parametrize("name", SCENES)
def test_engine_rests_where_the_rigid_solver_does(name):
    engine = pytest.importorskip("mujoco", reason="MuJoCo is not installed")
    walls, base, near = SCENES[name]
    around = rj.Surroundings(walls, rj.Sleeve(5.0), rigid=True)
    eq = rj.solve_tensions(CHAIN, TENSIONS, surroundings=around, base=base).require()
    assert eq.wall_contacts
    free = rj.solve_tensions(CHAIN, TENSIONS)
    assert np.hypot(*(free.tip - eq.tip)[:2]) > 2.0  # the wall matters
    model = engine.MjModel.from_xml_string(mjcf(CHAIN, around, base))
    state = engine.MjData(model)
    state.qpos[:] = positions(CHAIN, CHAIN.neutral_angles)
    state.ctrl[:] = TENSIONS
    engine.mj_step(model, state, 14000)
    assert np.hypot(*(1e3 * state.site("tip").xpos[:2] - eq.tip[:2])) < near
    force = sum(touch.force for touch in eq.wall_contacts)
    pressed = state.efc_force[state.efc_type == engine.mjtConstraint.mjCNSTR_CONTACT_FRICTIONLESS]
    assert pressed.sum() == pytest.approx(force, rel=0.03 if name == "plane" else 1e-3)


@pytest.mark.parametrize(
    ("around", "message"),
    [
        (rj.Surroundings([rj.Disc((0, 90), 5)]), "rigid walls without friction"),
        (rj.Surroundings([rj.Disc((0, 90), 5)], friction=rj.WallFriction(0.1), rigid=True), "rigid walls without"),
        (rj.Surroundings([rj.Lumen([40], [0], 8)], rigid=True), "no Lumen"),
    ],
)
def test_walls_that_the_model_would_leave_out_are_refused(around, message):
    with pytest.raises(rj.InvalidInput, match=message):
        mjcf(CHAIN, around)
    with pytest.raises(rj.InvalidInput, match="planar chain"):
        mjcf(rj.small_arm(), around)
