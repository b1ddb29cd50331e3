"""Sections 2, 3 and 5 of docs/theory.md, written once for rolling joints and hinges, against the compiled solver."""

import itertools
from typing import NamedTuple

import numpy as np
import pytest

from rollingjoint import (
    Bead,
    BeadTendon,
    BodyWrench,
    HingeChain,
    Spring,
    TorsionSpring,
    WorldForce,
    five_link,
    solve_lengths,
    two_segment,
)

Z = np.array([0.0, 0.0, 1.0])
NONE = np.zeros(3)


class Joint(NamedTuple):
    """A joint in the base frame: axis a, pole c, pole rate c', stiffness, spring moment, (holes, tendon) per gap."""

    a: np.ndarray
    c: np.ndarray
    rate: np.ndarray
    k: float
    spring: float
    gaps: list


class Acting(NamedTuple):
    """A load in the base frame: its link, point, dead and follower force, moments likewise, spring and anchor."""

    link: int
    x: np.ndarray
    dead: np.ndarray
    body: np.ndarray
    moment: np.ndarray
    body_moment: np.ndarray
    k: float
    anchor: np.ndarray

    @property
    def force(self):
        return self.dead + self.body + self.k * (self.anchor - self.x)


def flat(pair):
    return np.array([*pair, 0.0])


def gaps_of(lines, i, first):
    """(hole below, hole above, tendon) of the tendons that cross joint i."""
    at = 2 * i + first
    return [(line[at], line[at + 1], j) for j, line in enumerate(lines) if len(line) > at + 1]


def rolling(result):
    """(joints, loads, torsion springs as rows of joints below, joints up to, stiffness, moment) of a planar chain."""
    chain, s = result.mechanism, result.arc_lengths
    lines = [np.array([flat(point) for point in line]) for line in chain.tendon_polyline(result.poses)]
    joints = []
    for i, (below, above) in enumerate(itertools.pairwise(chain.links)):
        kappa = below.child.curvature(s[i]) - above.parent.curvature(s[i])
        rate = flat(result.contact_tangents[i]) / kappa
        joints.append(Joint(Z, flat(result.contact_points[i]), rate, 0.0, 0.0, gaps_of(lines, i, 1)))
    loads, springs = [], []
    for link, px, py, fx, fy, bx, by, m, k, ax, ay, torsion, rest, other in result.loads:
        x, y, angle = result.poses[int(link)]
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        at, body = flat((x, y) + turn @ (px, py)), flat(turn @ (bx, by))
        loads.append(Acting(int(link), at, flat((fx, fy)), body, m * Z, NONE, k, flat((ax, ay))))
        couple = torsion * (angle - result.poses[int(other), 2] - rest)
        springs += [(int(link), -couple), (int(other), couple)]
    pairs = [(int(row[0]), int(row[-1]), row[-3]) for row in result.loads]
    loads += [Acting(link, NONE, NONE, NONE, couple * Z, NONE, 0.0, NONE) for link, couple in springs]
    return joints, loads, pairs


def hinged(result):
    """The same of a chain of hinges, which has no torsion springs."""
    chain, R, origins = result.mechanism, result.rotations, result.positions
    lines, joints = chain.tendon_polyline(result.poses), []
    for i, bead in enumerate(chain.beads):
        spring = bead.stiffness * (result.joint_angles[i] - bead.rest_angle)
        axis = R[i] @ np.array(bead.axis)
        joints.append(Joint(axis, origins[i], NONE, bead.stiffness, spring, gaps_of(lines, i, 0)))
    loads = []
    for row in result.loads:
        link = int(row[0])
        p, f, m, b, n = (row[first : first + 3] for first in (1, 4, 7, 10, 13))
        placed = origins[link] + R[link] @ p
        loads.append(Acting(link, placed, f, R[link] @ b, m, R[link] @ n, row[16], row[17:20]))
    return joints, loads, []


def gap_rates(joint, below, above):
    """g', g'' of section 2."""
    v = above - below
    g, way = np.linalg.norm(v), np.cross(joint.a, above - joint.c)
    slope = v @ way / g
    return slope, (way @ way - slope**2) / g + v / g @ np.cross(joint.a, way - joint.rate)


def residual(joints, loads, tensions):
    """r of section 3."""
    r = np.zeros(len(joints))
    for i, joint in enumerate(joints):
        pull = sum(tensions[j] * gap_rates(joint, below, above)[0] for below, above, j in joint.gaps)
        acting = [load for load in loads if load.link > i]
        M = sum((q.moment + q.body_moment + np.cross(q.x - joint.c, q.force) for q in acting), NONE)
        r[i] = joint.spring + pull - joint.a @ M
    return r


def stiffness(joints, loads, pairs, tensions, elastic):
    """H of section 3."""
    n = len(joints)
    H, rates = np.zeros((n, n)), np.zeros((n, len(tensions)))
    for i, joint in enumerate(joints):
        beyond = [load for load in loads if load.link > i]
        arms = [np.cross(joint.a, q.x - joint.c) for q in beyond]
        w = sum((np.cross(arm, q.force - q.body) for q, arm in zip(beyond, arms, strict=True)), NONE)
        for m in range(i + 1):
            other = joints[m]
            held = sum(
                q.k * (arm @ np.cross(other.a, q.x - other.c)) for q, arm in zip(beyond, arms, strict=True)
            ) + sum(k for low, high, k in map(sorted_pair, pairs) if low <= m and i < high)
            H[i, m] = H[m, i] = held - other.a @ w
        for m in range(i):
            other = joints[m]
            H[i, m] -= np.cross(other.a, joint.a) @ sum((q.moment for q in beyond), NONE)
            for q in beyond:
                turned = np.cross(joint.a, np.cross(q.x - joint.c, q.body) + q.body_moment)
                H[m, i] -= other.a @ (turned + np.cross(joint.c - other.c, np.cross(joint.a, q.body)))
        H[i, i] += joint.k + np.cross(joint.a, joint.rate) @ sum((q.force for q in beyond), NONE)
        for below, above, j in joint.gaps:
            rates[i, j], bend = gap_rates(joint, below, above)
            H[i, i] += tensions[j] * bend
    return H + rates * elastic @ rates.T, rates


def sorted_pair(pair):
    link, other, k = pair
    return min(link, other), max(link, other), k


def planar_case(chain, rng, follower):
    loads = [
        WorldForce(-1, rng.uniform(-0.4, 0.4, 2), moment=2.0, point=(1.0, 2.0)),
        Spring(2, 0.02, (10.0, 60.0), point=(2.0, -1.0)),
        TorsionSpring(-1, 20.0, 0.1),
        TorsionSpring(3, 15.0, -0.2, 1),
    ]
    return chain, [*loads, BodyWrench(2, (0.1, -0.2), point=(1.0, 1.0))] if follower else loads


def arm_case(rng, follower):
    beads = [Bead(20.0, rng.normal(size=3), rng.uniform(400, 900), 7.0, 0.2, rng.uniform(-0.1, 0.1)) for _ in range(5)]
    around = np.array([0.3, 2.2, 4.4])
    tendons = [BeadTendon([(12 * np.cos(a), 12 * np.sin(a))], end) for a, end in zip(around, (5, 3, -1), strict=True)]
    chain = HingeChain(beads, tendons)
    loads = [chain.gravity(rng.normal(size=3)), WorldForce(4, rng.normal(size=3), point=rng.normal(size=3))]
    loads.append(Spring(3, 0.4, (9.0, -8.0, 70.0), point=(1.0, 2.0, 3.0)))
    if follower:
        loads.append(WorldForce(5, (0.0, 0.0, 0.0), moment=20 * rng.normal(size=3)))
        loads.append(BodyWrench(3, rng.normal(size=3), moment=20 * rng.normal(size=3), point=(1.0, 2.0, 3.0)))
    return chain, loads


CASES = ["five_link", "two_segment", "arm"]


@pytest.mark.parametrize("follower", [False, True])
@pytest.mark.parametrize("kind", CASES)
def test_residual_and_stiffness_of_both_kinds_of_joints_are_the_formulas_of_the_page(kind, follower):
    rng = np.random.default_rng(3)
    presets = {"five_link": five_link, "two_segment": two_segment}
    chain, loads = planar_case(presets[kind](), rng, follower) if kind in presets else arm_case(rng, follower)
    command = chain.neutral_lengths - rng.uniform(0.3, 1.0, chain.n_tendons)
    result = solve_lengths(chain, command, loads).require()
    joints, acting, pairs = (hinged if kind == "arm" else rolling)(result)
    H, rates = stiffness(joints, acting, pairs, result.tensions, result.tendon_stiffness)
    assert residual(joints, acting, result.tensions) == pytest.approx(0.0, abs=1e-7)
    assert rates == pytest.approx(result.tendon_rates, abs=1e-9)
    assert result.stiffness == pytest.approx(H, rel=1e-8, abs=1e-9 * np.abs(H).max())
    if kind != "arm":
        for i, joint in enumerate(joints):
            pull = sum((result.tensions[j] * (a - b) / np.linalg.norm(a - b) for b, a, j in joint.gaps), NONE)
            force = pull - sum((q.force for q in acting if q.link > i), NONE)
            tangent = flat(result.contact_tangents[i])
            assert result.contact_forces[i] == pytest.approx([force @ tangent, force @ np.cross(Z, tangent)], abs=1e-8)
