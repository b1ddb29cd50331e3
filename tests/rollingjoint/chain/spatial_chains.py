"""Chains in space for tests, random loads, and the balance of every link from its forces one by one."""

import numpy as np

from rollingjoint import (
    BodyWrench,
    Profile,
    RollingContact,
    SpaceTendon,
    SpatialChain,
    SpatialLink,
    Spring,
    Surface,
    WorldForce,
)


def arc(curvature, start, half=2.0, angle=0.0):
    return Surface(Profile.constant(curvature, (-half, half)), start, angle)


def ring(radius, angles, below, above):
    """Hole pairs at (radius, angle), the parent hole at z = below, the child hole at z = above."""
    return [[(radius * np.cos(t), radius * np.sin(t), z) for z in (below, above)] for t in angles]


def alternating(n=6, count=4, ends=(-1,), radius=5.0, height=6.0, stiffness=5.0, **more):
    """Equal circles about pitch and yaw axes in turn, `count` straight tendons to every end."""
    half, face, joint_stiffness = 2.0, 0.5 * height - 1.0, more.pop("joint_stiffness", 0.0)
    child, parent = arc(-1 / radius, (0.0, height / 2), half), arc(1 / radius, (0.0, -height / 2), half)
    joints = [RollingContact(0.5 * np.pi * (i % 2), parent, child, 2.5, 0.0, joint_stiffness) for i in range(n)]
    tendons = []
    for k, end in enumerate(ends):
        angles = 2 * np.pi * np.arange(count) / count + k * np.pi / count
        tendons += [SpaceTendon([pair], end, stiffness) for pair in ring(2.5, angles, -face, face)]
    links = [SpatialLink(0.02, (0.1, 0.0, 0.3))] * (n + 1)
    return SpatialChain(joints, tendons, links, **more)


def rolling_contact(rng):
    """Cubic on broken surfaces, tilted, at any azimuth."""
    limits = (-2.0, 2.0)
    u = [-rng.uniform(0.14, 0.25), 0.006 * rng.normal(), 0.001 * rng.normal()]
    child = Surface(Profile.polynomial(u, limits), (0.2 * rng.normal(), 3.5 + rng.random()), 0.1 * rng.normal())
    halves = Profile.piecewise_constant([-2.0, 1.0, 2.0], rng.uniform(0.0, 0.2, 2))
    parent = Surface(halves, (0.2 * rng.normal(), -3.5 - rng.random()), 0.1 * rng.normal())
    spring = rng.uniform(5, 30), 0.1 * rng.normal()
    return RollingContact(rng.uniform(-np.pi, np.pi), parent, child, 3.0, 0.2 * rng.normal(), *spring)


def random_chain(rng, n=5, m=4, joint=rolling_contact, **more):
    """Joints that all differ, holes that differ from link to link, tendons of different ends and stiffnesses."""
    tendons = []
    for j in range(m):
        end = int(rng.integers(max(1, n - 2), n + 1))
        angle = 2 * np.pi * j / m + 0.2 * rng.normal(size=end + 1)
        x, y = (2.5 + 0.2 * rng.normal(size=end + 1)) * [np.cos(angle), np.sin(angle)]
        z = 2.0 + 0.2 * rng.normal(size=end + 1)
        holes = np.stack([np.stack([x, y, -z], -1), np.stack([x + 0.1, y - 0.1, z], -1)], axis=1)
        tendons.append(SpaceTendon(holes, end, rng.uniform(2, 8)))
    links = [SpatialLink(0.02 * rng.random(), tuple(rng.normal(size=3))) for _ in range(n + 1)]
    return SpatialChain([joint(rng) for _ in range(n)], tendons, links, **more)


def random_loads(rng, chain, potential=True):
    """Forces at body points, a spring and the weights; without a potential moments and followers, too."""
    n = chain.n_joints
    link = lambda: int(rng.integers(1, n + 1))  # noqa: E731
    loads = [
        WorldForce(link(), tuple(0.3 * rng.normal(size=3)), point=tuple(rng.normal(size=3))),
        Spring(link(), 0.03, tuple(5 * rng.normal(size=3)), tuple(rng.normal(size=3))),
        chain.gravity(tuple(rng.normal(size=3))),
    ]
    if not potential:
        loads += [
            WorldForce(link(), (0.0, 0.0, 0.0), tuple(rng.normal(size=3))),
            BodyWrench(link(), tuple(0.2 * rng.normal(size=3)), tuple(rng.normal(size=3)), (0.5, 0.0, 1.0)),
        ]
    return loads


def contact_frames(chain, equilibrium):
    """Tangent, normal and axis of every joint in the world, (n - 1, 3, 3), from the surfaces."""
    frames = np.zeros((chain.n_joints, 3, 3))
    for i, joint in enumerate(chain.joints):
        lateral, axial, axis = joint.frame @ equilibrium.rotations[i].T
        s = equilibrium.arc_lengths[i]
        angle = 0.0 if np.isnan(s) else float(joint.child.tangent_angle(s))
        tangent = np.cos(angle) * lateral + np.sin(angle) * axial
        frames[i] = tangent, np.cross(axis, tangent), axis
    return frames


def unbalanced(chain, equilibrium, gap_tensions=None):
    """Largest force [N] and moment about the base [N·mm] on a moving link that nothing balances."""
    e, n = equilibrium, chain.n_joints
    force, moment = np.zeros((2, n + 1, 3))

    def act(link, point, vector, couple=(0.0, 0.0, 0.0)):
        force[link] += vector
        moment[link] += np.cross(point, vector) + couple

    tensions = e.gap_tensions if gap_tensions is None else gap_tensions
    lines = chain.tendon_polyline(e.poses)
    for i, frame in enumerate(contact_frames(chain, e)):
        push, couple = e.reactions[i, :3] @ frame, e.reactions[i, 3:] @ frame
        act(i + 1, e.contact_points[i], push, couple)
        act(i, e.contact_points[i], -push, -couple)
        for j, line in enumerate(lines):
            if i < chain.last_links[j]:
                below, above = line[2 * i + 1], line[2 * i + 2]
                pull = tensions[i, j] * (above - below) / np.linalg.norm(above - below)
                act(i, below, pull)
                act(i + 1, above, -pull)
    for row in e.loads:
        link = int(row[0])
        R, point = e.rotations[link], e.positions[link] + e.rotations[link] @ row[1:4]
        act(link, point, row[4:7] + R @ row[10:13] + row[16] * (row[17:20] - point), row[7:10] + R @ row[13:16])
    return np.abs(force[1:]).max(), np.abs(moment[1:]).max()
