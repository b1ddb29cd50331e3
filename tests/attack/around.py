"""Contact with walls written down from docs/theory.md, section 12: gaps and ways as functions of a link's pose.

Derivatives are taken by differences of these functions, so that no derivative of the project is needed.
"""

import numpy as np

from rollingjoint import Capsule, Disc, HalfPlane, Lumen, Polygon
from tests.attack.planar import turned

_STEPS = 1e-5, 1e-5, 1e-6  # mm, mm, rad: of central differences; fields have kinks in their slopes
_BLEND = 0.005  # mm on either side of a joint of a wall, over which the rate of the way goes from one to the other


class Candidates:
    """Every pair of an outline and a wall that may touch, in the order in which equilibria number them."""

    def __init__(self, chain, surroundings):
        points, bars = surroundings.outline.rows(chain.links)
        walls, default = surroundings.walls, surroundings.friction
        planes = [wall for wall in walls if isinstance(wall, HalfPlane)]
        lumens = [wall for wall in walls if isinstance(wall, Lumen)]
        discs = [wall for wall in walls if isinstance(wall, Disc)]
        capsules = [edge for wall in walls if isinstance(wall, Capsule | Polygon) for edge in edges_of(wall)]
        self.pairs = []  # (link, fields of poses, wall, length of outline)
        for link, x, y, radius, share in points:
            at = np.array([x, y])
            self.pairs += [(int(link), _on_plane(at, radius, wall), wall, share) for wall in planes]
            self.pairs += [(int(link), _in_lumen(at, radius, wall), wall, share) for wall in lumens]
        for link, ax, ay, bx, by, radius in bars:
            ends = np.array([[ax, ay], [bx, by]])
            for wall in discs:
                self.pairs.append((int(link), _on_disc(ends, radius, np.array(wall.centre), wall.radius), wall, 1.0))
            for first, second, wall in capsules:
                axis = np.array([first, second])
                for end in axis:
                    self.pairs.append((int(link), _on_disc(ends, radius, end, wall.radius), wall, 1.0))
                for end in ends:
                    self.pairs.append((int(link), _on_capsule(end, radius, axis, wall.radius), wall, 1.0))
        frictions = [wall.friction or default for _, _, wall, _ in self.pairs]
        self.mu = np.array([law.mu if law else 0.0 for law in frictions])
        self.presliding = np.array([law.presliding if law else 1.0 for law in frictions])
        self.rigid = surroundings.rigid

    def fields(self, poses, bases):
        """(gap, way, side) of every candidate at poses in base frames, (C, B) each."""
        found = [fields(_in_world(poses[:, link], bases)) for link, fields, _, _ in self.pairs]
        return tuple(np.stack(part) for part in zip(*found, strict=True))

    def normal_forces(self, gaps):
        """Of compliant walls, (C, B) [N]."""
        forces = np.zeros_like(gaps)
        for c, (_, _, wall, share) in enumerate(self.pairs):
            per_length = getattr(wall, "stiffness_per_length", None)
            k = wall.stiffness if per_length is None else per_length * share
            depth = np.maximum(-gaps[c], 0.0)
            early = 0.5 * k * depth**2 / wall.toe if wall.toe else 0.0
            forces[c] = np.where(depth < wall.toe, early, k * (depth - 0.5 * wall.toe))
        return np.where(gaps < 0.0, forces, 0.0)

    def states(self, fields, before):
        """Friction states, (C, B); before: (gaps pressed, states, ways, sides) of the step before."""
        _, way, side = fields
        pressed, state, start, old_side = before
        slid = np.where(side != old_side, 0.0, (way - start) / self.presliding[:, None])
        return np.clip(np.where(pressed & (side == old_side), state, 0.0) + slid, -1.0, 1.0)

    def wrenches(self, poses, bases, forces, states):
        """(force, moment about the origin of the base frame) on every link, (B, n, 2) and (B, n)."""
        force, moment = np.zeros((*poses.shape[:2], 2)), np.zeros(poses.shape[:2])
        for c, (link, fields, _, _) in enumerate(self.pairs):
            rows = np.flatnonzero(forces[c] > 0.0)
            if not rows.size:
                continue
            pose, base = poses[rows, link], bases[rows]
            push, about = np.zeros((rows.size, 3)), _in_world(pose, base)
            for axis in range(3):
                step = _STEPS[axis] * np.eye(3)[axis]
                high, low = (fields(_in_world(pose + sign * step, base), about) for sign in (1.0, -1.0))
                gap, way = ((high[number] - low[number]) / (2.0 * _STEPS[axis]) for number in (0, 1))
                push[:, axis] = forces[c, rows] * (gap - self.mu[c] * states[c, rows] * way)
            force[rows, link] += push[:, :2]
            moment[rows, link] += push[:, 2] + pose[:, 0] * push[:, 1] - pose[:, 1] * push[:, 0]
        return force, moment


def edges_of(wall):
    """(first end, second end, wall) of a capsule, or of every edge of a polygon."""
    if isinstance(wall, Capsule):
        return [(wall.first, wall.second, wall)]
    corners = list(wall.points)
    return [(first, second, wall) for first, second in zip(corners, [*corners[1:], corners[0]], strict=True)]


def _in_world(pose, base):
    place = base[:, :2] + turned(base[:, 2], pose[:, :2])
    return np.concatenate([place, (base[:, 2] + pose[:, 2])[:, None]], axis=1)


def _placed(point, pose):
    return pose[:, :2] + turned(pose[:, 2], point)


def _on_plane(point, radius, wall):
    nx, ny = wall.normal

    def fields(pose, about=None):
        x, y = _placed(point, pose).T
        return nx * x + ny * y - wall.offset - radius, ny * x - nx * y + radius * pose[:, 2], np.ones(len(pose))

    return fields


def _in_lumen(point, radius, wall):
    """The nearest point of every piece of the centre line; the nearest of them is the lumen's.

    about: poses about which the way is differentiated.
    """
    lengths, curvatures, borders = np.array(wall.lengths), np.array(wall.curvatures), np.array(wall.borders)
    radii = np.broadcast_to(np.array(wall.radii, float), lengths.size + 1)
    starts = wall.pose(borders[:-1])

    def rate(k, side, offset):
        """Of the way by the arc length of a line at this offset from piece k; straight before and beyond all pieces."""
        inside = (k >= 0) & (k < lengths.size)
        k = np.clip(k, 0, lengths.size - 1)
        curvature = np.where(inside, curvatures[k], 0.0)
        return (1.0 - curvature * side * (0.5 * (radii[k] + radii[k + 1]) - radius)) / (1.0 - curvature * offset)

    def blended(t, side, offset):
        """What the blend at joints adds to the rate of the way by t."""
        joint = np.abs(t[:, None] - borders).argmin(axis=1)
        along = np.clip((t - borders[joint]) / _BLEND, -1.0, 1.0)
        before, beyond = rate(joint - 1, side, offset), rate(joint, side, offset)
        mean = 0.5 * ((1.0 - along) * before + (1.0 + along) * beyond)
        piece = np.searchsorted(borders, t, side="right") - 1
        inside = (piece >= 0) & (piece < lengths.size)
        curvature = np.where(inside, curvatures[np.clip(piece, 0, lengths.size - 1)], 0.0)
        return (mean - np.where(along < 0.0, before, beyond)) * (1.0 - curvature * offset)

    def fields(pose, about=None):
        t, side, _, gap, way = places(pose)
        if about is not None:
            there, its_side, its_offset, _, _ = places(about)
            way = way - its_side * blended(there, its_side, its_offset) * (t - there)
        return gap, way, side

    def places(pose):
        at = _placed(point, pose)
        every = []
        for k, (length, curvature) in enumerate(zip(lengths, curvatures, strict=True)):
            apart = turned(-starts[k, 2], at - starts[k, :2])
            if curvature:
                arm = apart - [0.0, 1.0 / curvature]
                along = np.arctan2(arm[:, 0], -arm[:, 1] * np.sign(curvature)) / abs(curvature)
            else:
                along = apart[:, 0]
            inner = np.clip(along, 0.0, length)
            line = wall.pose(inner + borders[k])
            t = borders[k] + inner
            if k in (0, lengths.size - 1):  # straight beyond the ends
                end = wall.pose(np.full(len(at), 0.0 if k == 0 else wall.length))
                ahead = ((at - end[:, :2]) * np.stack([np.cos(end[:, 2]), np.sin(end[:, 2])], -1)).sum(axis=1)
                beyond = np.where(k == 0, ahead < 0.0, ahead > 0.0)
                if k == 0 and lengths.size == 1:
                    last = wall.pose(np.full(len(at), wall.length))
                    far = ((at - last[:, :2]) * np.stack([np.cos(last[:, 2]), np.sin(last[:, 2])], -1)).sum(axis=1)
                    t = np.where(far > 0.0, wall.length + far, np.where(beyond, ahead, t))
                else:
                    t = np.where(beyond, ahead + (0.0 if k == 0 else wall.length), t)
                line = wall.pose(t)
            across = turned(-line[:, 2], at - line[:, :2])[:, 1]
            every.append((((at - line[:, :2]) ** 2).sum(axis=1), t, across))
        best = np.argmin([apart for apart, _, _ in every], axis=0)
        t, offset = (np.choose(best, [part[number] for part in every]) for number in (1, 2))
        side = np.where(offset > 0.0, 1.0, -1.0)
        gap = wall.radius(np.clip(t, 0.0, wall.length)) - side * offset - radius
        way = t.copy()  # along the wall: the integral of 1 - curvature x offset of the wall
        for k, curvature in enumerate(curvatures):
            inside = np.clip(t - borders[k], 0.0, lengths[k])
            way -= curvature * side * (0.5 * (radii[k] + radii[k + 1]) - radius) * inside
        return t, side, offset, gap, -side * way + radius * pose[:, 2]

    return fields


def _around(u, v, length, inner, outer):
    """Way of the contact around a capsule from (0, 0) to (length, 0) of radius inner with a disc of radius outer."""
    both = inner + outer
    near, far = u <= 0.0, u >= length
    turn = np.arctan2(v, u - np.where(far, length, 0.0)) + 0.5 * np.pi
    turn = np.where(turn < -0.5 * np.pi, turn + 2.0 * np.pi, turn)
    turn = np.where(near & (turn <= -0.5 * np.pi), turn + 2.0 * np.pi, turn)
    beside = np.where(v < 0.0, u, 2.0 * length - u + np.pi * both)
    ends = both * turn + np.where(far, length, np.where(turn > 0.5 * np.pi, 2.0 * length, 0.0))
    return np.where(near | far, ends, beside)


def _blended(u, v, there, length, both):
    """What the blend where sides meet ends takes off the way, from the place `there` at which it is differentiated."""
    at_u, at_v = there
    joint = np.where(at_u < 0.5 * length, 0.0, length)
    share = 0.5 * np.maximum(1.0 - np.abs(at_u - joint) / _BLEND, 0.0)
    x = at_u - joint
    distance = np.where((at_u <= 0.0) | (at_u >= length), np.hypot(x, at_v), np.abs(at_v))
    more = both / distance - 1.0
    along = np.where(at_v < 0.0, 1.0, -1.0) * (u - at_u)
    around = (x * (v - at_v) - at_v * (u - at_u)) / distance
    return share * more * np.where((at_u <= 0.0) | (at_u >= length), around, -along)


def _distance(u, v, length):
    return np.hypot(u - np.clip(u, 0.0, length), v)


def _on_disc(ends, radius, centre, other):
    axis = ends[1] - ends[0]
    length, angle = np.hypot(*axis), np.arctan2(axis[1], axis[0])

    def seen(pose):
        return turned(-(pose[:, 2] + angle), centre - _placed(ends[0], pose)).T

    def fields(pose, about=None):
        u, v = seen(pose)
        way = _around(u, v, length, radius, other) + other * pose[:, 2]
        if about is not None:
            way = way - _blended(u, v, seen(about), length, radius + other)
        return _distance(u, v, length) - radius - other, way, np.ones(len(pose))

    return fields


def _on_capsule(end, radius, axis, other):
    along = axis[1] - axis[0]
    length, angle = np.hypot(*along), np.arctan2(along[1], along[0])

    def seen(pose):
        return turned(np.full(len(pose), -angle), _placed(end, pose) - axis[0]).T

    def fields(pose, about=None):
        u, v = seen(pose)
        way = radius * pose[:, 2] - _around(u, v, length, other, radius)
        if about is not None:
            way = way + _blended(u, v, seen(about), length, radius + other)
        return _distance(u, v, length) - radius - other, way, np.ones(len(pose))

    return fields
