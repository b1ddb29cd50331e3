"""Rigid walls without friction: MuJoCo's contacts bring a chain to rest where the solver has its equilibrium."""

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


BASE = (0.4, -0.3, 0.5, 0.03, -0.02, 0.04)
CAPSULE = rj.Capsule((24.8, -9.9, 40.0), (12.8, 30.1, 70.0), 4.0)  # touched by a crowned link, off its middle
SPHERE, PLANE = rj.Sphere((19.0, 14.5, 62.0), 8.0), rj.Plane((-0.8, -0.6, 0.05), -16.0)
IN_SPACE = {  # chain, wall, base, radius of the sleeve, tensions, largest distance of the tip [mm]
    "arm at a plane": (rj.small_arm(), PLANE, BASE, 15.0, (8, 4, 2, 2), 2e-5),
    "arm at a sphere": (rj.small_arm(), SPHERE, BASE, 15.0, (8, 4, 2, 2), 3e-5),
    "arm at a capsule": (rj.small_arm(), CAPSULE, BASE, 15.0, (8, 4, 2, 2), 0.02),
    "its joints at a sphere": (rj.SpatialChain.from_arm(rj.small_arm()), SPHERE, BASE, 15.0, (8, 4, 2, 2), 3e-5),
    "pitch_yaw at a plane": (rj.pitch_yaw(), rj.Plane((-0.8, -0.6, 0.05), -7.0), (0, 0, 0), 3.0, (4, 3, 1, 1.5), 2e-6),
    "pitch_yaw at a capsule": (
        rj.pitch_yaw(), rj.Capsule((11, -8, 40), (1, 14, 50), 2.0), (0, 0, 0), 3.0, (4, 3, 1, 1.5), 0.01
    ),
}  # fmt: skip


def at_rest(chain, around, base, tensions, size):
    """(distance of the engine's tip from the solver's, forces of all contacts in the engine, in the solver)."""
    engine = pytest.importorskip("mujoco", reason="MuJoCo is not installed")
    eq = rj.solve_tensions(chain, tensions, surroundings=around, base=base).require()
    free = rj.solve_tensions(chain, tensions)
    assert eq.wall_contacts and np.linalg.norm((free.tip - eq.tip)[:size]) > 2.0  # the wall matters
    model = engine.MjModel.from_xml_string(mjcf(chain, around, base))
    state = engine.MjData(model)
    state.qpos[:] = positions(chain, chain.neutral_angles)
    state.ctrl[:] = tensions
    engine.mj_step(model, state, 14000)
    pressed = state.efc_force[state.efc_type == engine.mjtConstraint.mjCNSTR_CONTACT_FRICTIONLESS].sum()
    off = np.linalg.norm(1e3 * state.site("tip").xpos[:size] - eq.tip[:size])
    return off, pressed, sum(touch.force for touch in eq.wall_contacts)


@pytest.mark.parametrize("name", SCENES)
def test_engine_rests_where_the_rigid_solver_does(name):
    walls, base, near = SCENES[name]
    off, pressed, force = at_rest(CHAIN, rj.Surroundings(walls, rj.Sleeve(5.0), rigid=True), base, TENSIONS, 2)
    assert off < near
    assert pressed == pytest.approx(force, rel=0.03 if name == "plane" else 1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("name", IN_SPACE)
def test_engine_rests_where_the_rigid_solver_does_in_space(name):
    chain, wall, base, radius, tensions, near = IN_SPACE[name]
    around = rj.Surroundings([wall], rj.Sleeve(radius), rigid=True)
    off, pressed, force = at_rest(chain, around, base, tensions, 3)
    print(f"{name}: tip {off:.1e} mm apart, forces {pressed:.4f} and {force:.4f} N")  # docs/surroundings.md
    assert off < near
    assert pressed == pytest.approx(force, rel=2e-3)


@pytest.mark.parametrize(
    ("around", "message"),
    [
        (rj.Surroundings([rj.Disc((0, 90), 5)]), "rigid walls without friction"),
        (rj.Surroundings([rj.Disc((0, 90), 5)], friction=rj.WallFriction(0.1), rigid=True), "rigid walls without"),
        (rj.Surroundings([rj.Lumen([40], [0], 8)], rigid=True), "no Lumen"),
        (rj.Surroundings([rj.Sphere((0, 0, 90), 5)]), "rigid walls without friction"),
        (rj.Surroundings([rj.Tube([40], [0], [0], 25)], rigid=True), "no Tube"),
    ],
)
def test_walls_that_the_model_would_leave_out_are_refused(around, message):
    chains = [CHAIN, rj.small_arm()]
    with pytest.raises(rj.InvalidInput, match=message):
        mjcf(chains[around.dimension - 2], around)
    with pytest.raises(rj.InvalidInput, match="walls around a"):
        mjcf(chains[3 - around.dimension], around)
