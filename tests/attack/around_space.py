"""Contact with walls in space written down from docs/theory.md, section 12: gaps as functions of a link's pose.

Gradients are taken by differences of gaps, nearest points by search, so that no formula of the project is needed.
"""

import numpy as np

from rollingjoint import Capsule, Plane, Sphere, Tube

_STEP, _TURN = 1e-5, 1e-6  # mm, rad: of central differences
_CROWN = 0.01  # of the square of the way from the middle of a bar, where a capsule is long


def turned_by(vector):
    """The matrix of a rotation vector, by Rodrigues' formula."""
    angle = np.linalg.norm(vector)
    x, y, z = vector
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    if angle < 1e-9:
        return np.eye(3) + K + 0.5 * K @ K
    return np.eye(3) + np.sin(angle) / angle * K + (1.0 - np.cos(angle)) / angle**2 * K @ K


def moved(pose, step):
    """A pose (4, 4) after a small velocity and turn about the origin of the frame it is given in."""
    change = np.eye(4)
    change[:3, :3], change[:3, 3] = turned_by(step[3:]), step[:3]
    return change @ pose


def frame_of(base):
    """The pose (4, 4) of a base at x, y, z, rotation vector."""
    return moved(np.eye(4), np.asarray(base, float))


class SpaceCandidates:
    """Every pair of an outline and a wall in space that may touch, in the order in which equilibria number them."""

    def __init__(self, chain, surroundings):
        points, bars = surroundings.outline.rows_in_space(chain)
        walls, default = surroundings.walls, surroundings.friction
        flat = [wall for wall in walls if isinstance(wall, Plane)]
        tubes = [_Tube(wall) for wall in walls if isinstance(wall, Tube)]
        solid = [wall for wall in walls if isinstance(wall, Sphere | Capsule)]
        self.pairs = []  # (link, its shape, wall, length of outline)
        for link, x, y, z, radius, share in points:
            ball = np.array([x, y, z]), radius
            self.pairs += [(int(link), ball, wall, share) for wall in (*flat, *tubes)]
        for row in bars:
            bar = row[1:4], row[4:7], row[7]
            self.pairs += [(int(row[0]), bar, wall, 1.0) for wall in solid]
        kinds = [wall.wall if isinstance(wall, _Tube) else wall for _, _, wall, _ in self.pairs]
        frictions = [wall.friction or default for wall in kinds]
        self.laws = kinds
        self.mu = np.array([law.mu if law else 0.0 for law in frictions])
        self.presliding = np.array([law.presliding if law else 1.0 for law in frictions])

    def gap(self, c, pose):
        """Gap of a candidate for its link's pose among the walls, and the point of its axis that is nearest."""
        _, shape, wall, _ = self.pairs[c]
        if len(shape) == 2:
            at, radius = pose[:3, :3] @ shape[0] + pose[:3, 3], shape[1]
            if isinstance(wall, Plane):
                return float(np.dot(wall.normal, at)) - wall.offset - radius, at
            return wall.room(at) - radius, at
        first, second = (pose[:3, :3] @ end + pose[:3, 3] for end in shape[:2])
        ends = (wall.centre, wall.centre) if isinstance(wall, Sphere) else (wall.first, wall.second)
        share, distance = _nearest(first, second, *map(np.array, ends))
        return distance - shape[2] - wall.radius, first + share * (second - first)

    def energy(self, c, gap):
        """(energy, normal force) of a candidate."""
        wall, share = self.laws[c], self.pairs[c][3]
        per_length = getattr(wall, "stiffness_per_length", None)
        k, depth = wall.stiffness if per_length is None else per_length * share, max(-gap, 0.0)
        if wall.toe and depth < wall.toe:
            return k * depth**3 / (6.0 * wall.toe), 0.5 * k * depth**2 / wall.toe
        rest = depth - 0.5 * wall.toe
        return (0.5 * k * rest**2 + k * wall.toe**2 / 24.0, k * rest) if depth > 0.0 else (0.0, 0.0)

    def gradient(self, c, pose):
        """Gradient of a gap by velocity and turn of the link about the origin of the walls' frame, (6,)."""
        steps = np.diag([_STEP] * 3 + [_TURN] * 3)
        return np.array(
            [(self.gap(c, moved(pose, s))[0] - self.gap(c, moved(pose, -s))[0]) / (2.0 * s.max()) for s in steps]
        )

    def state(self, c, pose, was, old):
        """(friction state among the walls, contact point) of a contact; was, old: pose and state before the step."""
        normal = self.gradient(c, pose)[:3]
        normal /= np.linalg.norm(normal)
        shape = self.pairs[c][1]
        at = self.gap(c, pose)[1] - shape[-1] * normal
        in_link = pose[:3, :3].T @ (at - pose[:3, 3])
        way = at - (was[:3, :3] @ in_link + was[:3, 3])
        kept = old - normal * (normal @ old)
        size = np.linalg.norm(kept)
        kept = kept * (np.linalg.norm(old) / size) if size > 0.0 else kept
        trial = kept + (way - normal * (normal @ way)) / self.presliding[c]
        return trial / max(1.0, np.linalg.norm(trial)), at

    def wrench(self, c, pose, force, state=None, at=None):
        """Force and moment of the wall on the link about the origin of the walls' frame, (6,)."""
        wrench = force * self.gradient(c, pose)
        if state is not None:
            drag = -self.mu[c] * force * state
            wrench = wrench + np.concatenate([drag, np.cross(at, drag)])
        return wrench


class _Tube:
    """A tube by its centre line alone."""

    def __init__(self, wall):
        self.wall = wall
        self._grid = np.linspace(-0.5, 1.5, 401) * wall.length
        self._line = wall.points(self._grid)

    def room(self, at):
        """Radius at the nearest place of the centre line, less the distance from it."""
        nearest = int(np.argmin(np.linalg.norm(self._line - at, axis=1)))
        low, high = self._grid[max(nearest - 1, 0)], self._grid[min(nearest + 1, len(self._grid) - 1)]

        def ahead(t):  # of the point, beyond the plane across the centre line; falls along it
            frame = self.wall.frames_at(t)
            return float((at - frame.points[0]) @ frame.tangents[0])

        a, b = ahead(low), ahead(high)
        for _ in range(60):  # regula falsi of the Illinois kind
            t = (low * b - high * a) / (b - a) if b != a else low
            value = ahead(t)
            if abs(value) < 1e-13:
                break
            if value * b < 0.0:
                low, a = high, b
            else:
                a *= 0.5
            high, b = t, value
        return float(self.wall.radius(t)) - float(np.linalg.norm(at - self.wall.points(t)))


def _nearest(first, second, one, two):
    """(share of the way along the bar, distance with the crown of the bar): the nearest place of a bar to a capsule."""
    bar, axis = second - first, two - one
    length, square = np.linalg.norm(bar), axis @ axis
    crown = _CROWN if square > 0.0 else 0.0

    def squared(share):
        at = first + share * bar
        along = min(max((at - one) @ axis / square, 0.0), 1.0) if square > 0.0 else 0.0
        away = at - one - along * axis
        return away @ away + crown * (share - 0.5) ** 2 * length**2

    def slope(share):
        at = first + share * bar
        along = min(max((at - one) @ axis / square, 0.0), 1.0) if square > 0.0 else 0.0
        return (at - one - along * axis) @ bar + crown * (share - 0.5) * length**2

    low, high = 0.0, 1.0
    if slope(0.0) >= 0.0:
        return 0.0, np.sqrt(squared(0.0))
    if slope(1.0) <= 0.0:
        return 1.0, np.sqrt(squared(1.0))
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if slope(middle) < 0.0 else (low, middle)
    return 0.5 * (low + high), np.sqrt(squared(0.5 * (low + high)))


class Recomputed:
    """A chain in space among walls: its joint moments, recomputed from poses and lengths of tendons alone.

    Args:
        chain: with elastic tendons, without loads. surroundings: around it.
        command, limits: of its tendons. base: pose of its base, (6,).
        past: poses of the links among the walls, (n, 4, 4), and friction states, (C, 3), before the step; None: without
            friction.
    """

    def __init__(self, chain, surroundings, command, limits, base, past=None):
        self.chain, self.candidates = chain, SpaceCandidates(chain, surroundings)
        self.command, self.limits, self.past = np.asarray(command), limits, past
        self.base = np.zeros(6)
        self.base[: len(base)] = base

    def energy(self, angles):
        """Of tendons, springs and walls, without friction [N mm]."""
        stretch = self.chain.tendon_lengths(angles) - self.command
        k, (low, high) = np.asarray(self.chain.stiffnesses), self.limits
        rise = k * stretch
        taut = np.clip(rise, low, high)
        of_tendons = np.sum(0.5 * taut**2 / k + taut * (rise - taut) / k)
        turns = angles - self._rest
        total = of_tendons + 0.5 * np.sum(self.chain.joint_stiffnesses * turns**2)
        for c, gap in enumerate(self.gaps(angles)):
            total += self.candidates.energy(c, gap)[0]
        return float(total)

    def gaps(self, angles):
        """Of all candidates [mm]."""
        world = frame_of(self.base) @ self.chain.poses(angles)
        return np.array([self.candidates.gap(c, world[pair[0]])[0] for c, pair in enumerate(self.candidates.pairs)])

    def contacts(self, angles):
        """(candidate, normal force, friction state, wrench among the walls) of every contact that presses."""
        world, touching = frame_of(self.base) @ self.chain.poses(angles), []
        for c, pair in enumerate(self.candidates.pairs):
            pose = world[pair[0]]
            force = self.candidates.energy(c, self.candidates.gap(c, pose)[0])[1]
            if force > 0.0:
                state = at = None
                if self.past is not None and self.candidates.mu[c] > 0.0:
                    poses, states = self.past
                    state, at = self.candidates.state(c, pose, poses[pair[0]], states[c])
                touching.append((c, force, state, self.candidates.wrench(c, pose, force, state, at)))
        return touching

    def residual(self, angles, step=1e-6):
        """Moments about the joints that are not balanced, (n - 1,) [N mm]."""
        lengths = self.chain.tendon_lengths(angles)
        tensions = np.clip(self.chain.stiffnesses * (lengths - self.command), *self.limits)
        moments = self.chain.joint_stiffnesses * (angles - self._rest)
        ends = [[self.chain.tendon_lengths(angles + s * step * e) for s in (1.0, -1.0)] for e in np.eye(angles.size)]
        moments = moments + np.array([(high - low) @ tensions / (2.0 * step) for high, low in ends])
        wrenches = np.zeros((self.chain.n_links, 6))
        for c, _, _, wrench in self.contacts(angles):
            wrenches[self.candidates.pairs[c][0]] += wrench
        base, pushed = frame_of(self.base), np.flatnonzero(np.abs(wrenches).any(axis=1))
        if not pushed.size:
            return moments
        for i, e in enumerate(np.eye(angles.size)):
            high, low = (base @ self.chain.poses(angles + s * step * e) for s in (1.0, -1.0))
            for k in pushed:
                change = (high[k] - low[k]) / (2.0 * step)
                spin = change[:3, :3] @ (0.5 * (high[k] + low[k]))[:3, :3].T
                turn = 0.5 * np.array([spin[2, 1] - spin[1, 2], spin[0, 2] - spin[2, 0], spin[1, 0] - spin[0, 1]])
                place = 0.5 * (high[k] + low[k])[:3, 3]
                moments[i] -= wrenches[k, :3] @ (change[:3, 3] - np.cross(turn, place)) + wrenches[k, 3:] @ turn
        return moments

    @property
    def _rest(self):
        return np.asarray(self.chain.arrays.joints[0, :, 2])
