"""Hinge chains against MuJoCo, built from the same beads and holes: what balances here balances there."""

from pathlib import Path

import numpy as np
import pytest

from rollingjoint import (
    Bead,
    BeadTendon,
    HingeChain,
    Spring,
    Status,
    WorldForce,
    flexible_arm,
    small_arm,
    solve_lengths,
    solve_tensions,
)

pytest.importorskip("mujoco", reason="MuJoCo is not installed")

HANG, TILTED, UPRIGHT = (0.0, 0.0, 1.0), (0.3, -0.2, 0.8), (0.0, 0.0, -1.0)


@pytest.fixture
def mujoco_arm(monkeypatch):
    monkeypatch.syspath_prepend(str(Path(__file__).resolve().parents[3] / "benchmarks"))
    from speed_rows.mujoco_arm import MujocoArm

    return MujocoArm


def random_arm(seed):
    """Beads of any size, axis and rest angle; tendons of any holes and ends."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 8))
    beads = [
        Bead(rng.uniform(15, 30), rng.normal(size=3), rng.uniform(400, 900), rng.uniform(4, 12), 0.2, rng.normal() / 20)
        for _ in range(n)
    ]
    around = rng.uniform(0, 2 * np.pi, 3)
    tendons = []
    for angle in around:
        end = int(rng.integers(1, n + 1))
        holes = 12 * np.array([np.cos(angle), np.sin(angle)]) + 0.3 * rng.normal(size=(end + 1, 2))
        tendons.append(BeadTendon(holes, end, rng.uniform(3, 12)))
    return HingeChain(beads, tendons)


def shortened(arm, seed):
    """Lengths that some tendons have to be pulled to, and some are slack at."""
    return arm.neutral_lengths + np.random.default_rng(seed).uniform(-4, 2, arm.n_tendons)


SPRINGS = [
    Spring(-1, 0.01, (150.0, -80.0, 600.0), point=(0.0, 0.0, 0.0)),
    Spring(14, 0.05, (-60.0, 20.0, 300.0), point=(5.0, 2.0, -3.0)),
]
CASES = {  # arm, direction of gravity, payload [N], tensions [N] or None
    "hanging": (flexible_arm(), HANG, 0.0, [8, 0, 0, 0, 3, 3, 0, 0]),
    "hanging, by lengths": (flexible_arm(), HANG, 0.0, None),
    "tilted with a payload": (flexible_arm(), TILTED, 0.3, [2, 9, 0, 0, 0, 3, 4, 0]),
    "tilted with a payload, by lengths": (flexible_arm(), TILTED, 0.3, None),
    "co-contracted": (flexible_arm(), TILTED, 0.0, [12, 9, 10, 8, 11, 9, 9, 12]),
    "standing, stiff": (flexible_arm(stiffness=6000.0), UPRIGHT, 0.2, [30, 0, 5, 0, 0, 20, 4, 0]),
    "held by springs": (flexible_arm(), HANG, 0.0, [8, 0, 0, 0, 3, 3, 0, 0]),
    "held by springs, by lengths": (flexible_arm(), HANG, 0.1, None),
    "small": (small_arm(7), TILTED, 0.5, [5, 0, 1, 9]),
    **{f"random {seed}": (random_arm(seed), TILTED, 0.1, [4, 2, 6]) for seed in range(6)},
    **{f"random {seed}, by lengths": (random_arm(seed), TILTED, 0.1, None) for seed in range(6, 12)},
}


def both(case, mujoco_arm):
    """Our equilibrium, and MuJoCo's arm with the same tendons and weights."""
    arm, gravity, payload, tensions = CASES[case]
    loads = [arm.gravity(gravity), WorldForce(-1, payload * np.array(gravity) / np.linalg.norm(gravity))]
    springs = SPRINGS if "springs" in case else []
    loads += springs
    simulated = mujoco_arm(arm, gravity, payload, springs)
    if tensions is None:
        lengths = shortened(arm, len(case))
        simulated.wind(lengths)
        found = solve_lengths(arm, lengths, loads)
        assert np.any(found.tensions > 0)
    else:
        simulated.pull(tensions)
        found = solve_tensions(arm, tensions, loads)
    assert found.status is Status.CONVERGED
    return found, simulated


@pytest.mark.parametrize("case", CASES)
def test_our_equilibrium_is_one_of_mujocos(case, mujoco_arm):
    found, simulated = both(case, mujoco_arm)
    simulated.place(found.joint_angles)
    present = max(np.abs(simulated.spring_moments).max(), np.abs(found.tendon_rates * found.tensions).max())
    assert np.abs(simulated.unbalanced).max() < 1e-10 * present
    assert simulated.lengths == pytest.approx(found.lengths, rel=1e-12)
    assert simulated.tip == pytest.approx(found.tip, abs=1e-9)
    assert simulated.tip_rotation == pytest.approx(found.rotations[-1], abs=1e-12)


@pytest.mark.parametrize(
    "case",
    ["hanging", "held by springs, by lengths", "tilted with a payload, by lengths", "random 3", "random 8, by lengths"],
)
def test_our_stiffness_is_how_mujocos_moments_change(case, mujoco_arm):
    found, simulated = both(case, mujoco_arm)
    step, columns = 1e-5, []
    for turn in step * np.eye(len(found.joint_angles)):
        moments = []
        for angles in (found.joint_angles + turn, found.joint_angles - turn):
            simulated.place(angles)
            moments.append(simulated.unbalanced.copy())
        columns.append((moments[1] - moments[0]) / (2 * step))
    wrong = found.stiffness - np.transpose(columns)
    assert np.abs(wrong).max() < 1e-7 * np.abs(found.stiffness).max()


def test_forces_at_points_of_links_balance_in_mujoco(mujoco_arm):
    arm = random_arm(20).replace(beads=random_arm(3).beads[:1] * 5, tendons=[BeadTendon([(12, 3)], 4)])
    point, force = (3.0, -2.0, 1.0), (1.0, -0.5, 2.0)
    found = solve_tensions(arm, [5.0], [WorldForce(3, force, point=point), WorldForce(-1, (0.3, 0.2, 0.1))])
    simulated = mujoco_arm(arm)
    simulated.pull([5.0])
    simulated.place(found.joint_angles)
    assert np.abs(simulated.unbalanced).max() > 1.0
    T = found.poses[3]
    simulated.push(3, T[:3, :3] @ np.array(point) + T[:3, 3], force)
    simulated.push(-1, found.tip, (0.3, 0.2, 0.1))
    assert np.abs(simulated.unbalanced).max() < 1e-9


@pytest.mark.parametrize("case", ["small", "hanging, by lengths", "held by springs"])
def test_mujoco_comes_back_to_a_stable_equilibrium(case, mujoco_arm):
    found, simulated = both(case, mujoco_arm)
    assert found.smallest_eigenvalue > 0
    simulated.place(found.joint_angles + 0.02 * np.random.default_rng(0).normal(size=len(found.joint_angles)))
    assert np.abs(simulated.tip - found.tip).max() > 1.0
    simulated.settle(1e-4)
    assert simulated.tip == pytest.approx(found.tip, abs=0.02)


def test_mujoco_falls_from_an_unstable_equilibrium_to_where_our_solver_does(mujoco_arm):
    arm = small_arm(3, "linear", weight=9.0)
    standing = solve_tensions(arm, np.zeros(4), [arm.gravity(UPRIGHT)])
    assert standing.escapes > 0 and standing.status is Status.CONVERGED
    simulated = mujoco_arm(arm, UPRIGHT)
    simulated.place(np.zeros(3))
    assert np.abs(simulated.unbalanced).max() < 1e-9  # it could stand
    simulated.place(1e-3 * standing.joint_angles)
    simulated.settle(1e-4)
    assert simulated.tip == pytest.approx(standing.tip, abs=0.02)
    assert np.abs(standing.joint_angles).max() > 0.1
