"""Contact of the outline of a chain in space with walls: every candidate, its energy, and the sums of its forces.

To the chain a contact is a force at a point, which enters the sums of loads, and a stiffness S (6, 6) in the velocity
of a link: that of its point at the origin of the base frame, then its turn. S is what a dead force at that point has
not: a normal force turns and grows with the link, its point slides along it, and friction follows both. With friction S
is not symmetric. Source: docs/theory.md, section 12.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from rollingjoint._numba.jit import part
from rollingjoint._numba.layout import Floats, Integers
from rollingjoint._numba.pins import carve_tuple, size_of
from rollingjoint.kernels import formulas
from rollingjoint.kernels.formulas import formula
from rollingjoint.kernels.gaps import press
from rollingjoint.kernels.hinges import PX, placed, turned
from rollingjoint.kernels.spatial_walls import (
    AXIS,
    AXIS_LENGTH,
    CAPSULE_LAW,
    CAPSULE_RADIUS,
    LENGTH,
    PLANE_LAW,
    TUBE_LAW,
    SpatialSeen,
    SpatialWalls,
    from_centre_line,
    from_world,
    nearest_piece_of,
    piece_from,
    put,
    see_in_space,
    unit,
)
from rollingjoint.kernels.vectors import about, dot, in_space, minus, plus, times
from rollingjoint.kernels.wall_contacts import (
    ENERGY,
    EVALUATIONS,
    MAGNITUDE,
    N_HOW,
    PENALTY,
    PLACES,
    PRESSING,
    RUBS,
    SOFTER,
    STIFFER,
)
from rollingjoint.kernels.walls import MU, PER_LENGTH, PRESLIDING, STIFFNESS, TOE

CROWN = 0.01  # of the square of the way from the middle of a bar: where bar and capsule are parallel, that decides
_SLIPS = 1e-12
_NO_DISTANCE = 1e-9  # mm: nearer to an axis the direction to it is arbitrary

# Columns of SpatialTouch.sums, over the walls of all links beyond a joint: force on the link, point outer force row by
# row, and S row by row
FORCE, POINT_FORCE, SUM_S, N_SUMS = 0, 3, 12, 48
# Columns of SpatialTouch.places: contact point on the link, gradient of the gap by that point
PLACE, GRADIENT, N_PLACE = 0, 3, 6
# Columns of SpatialTouch.columns: change of the gradient of the gap, and way of the nearest point along the link, per
# velocity of the link
TURNING, SLIDING, N_CHANGES = 0, 3, 6
N_TWIST = 6  # numbers of a velocity of a link: columns of S


class SpatialTouched(NamedTuple):
    """What contact with walls remembers from one step to the next."""

    states: Annotated[Floats, "C", 3]  # friction state z of every candidate, tangential, |z| <= 1; in the world
    normals: Annotated[Floats, "C"]  # normal force [N]
    poses: Annotated[Floats, "n", 12]  # of the links in the world: rotation matrix row by row, origin


class SpatialTouch(NamedTuple):
    """Contact evaluated at one configuration, by candidate."""

    gaps: Annotated[Floats, "C"]
    normals: Annotated[Floats, "C"]
    states: Annotated[Floats, "C", 3]  # in the world
    works: Annotated[Floats, "C"]  # of friction in the step, per newton of normal force [mm]
    frozen: Annotated[Floats, "C"]  # normal force where the line search began
    multipliers: Annotated[Floats, "C"]  # normal force of rigid walls so far
    pieces: Annotated[Floats, "C"]  # of a tube, near the point; -1: not yet known
    places: Annotated[Floats, "C", N_PLACE]  # if wanted
    sums: Annotated[Floats, "J", N_SUMS]
    tangent: Annotated[Floats, "J"]  # the first step of Newton's method [rad]
    columns: Annotated[Floats, N_TWIST, N_CHANGES]  # of the candidate at hand
    how: Annotated[Floats, N_HOW]


class SpatialContactMemory(NamedTuple):
    """Memory of one solve among walls in space."""

    seen: SpatialSeen
    touch: SpatialTouch
    curve: Annotated[Floats, "ends", 3]  # the chain before the step and after it (passing_in_space.py)


class SpatialContactSizes(NamedTuple):
    """Lengths of the axes of SpatialContactMemory."""

    points: int
    bars: int
    planes: int
    capsules: int
    pieces: int
    tubes: int
    J: int
    C: int
    ends: int


class SpatialWallArrays(NamedTuple):
    """Walls of B lanes in space, what they remember, and outputs; as walled_solve.WallArrays."""

    walls: SpatialWalls
    which: Annotated[Integers, "B"]
    bases: Annotated[Floats, "B", 6]  # pose of the base in the world: x, y, z, rotation vector [mm, rad]
    poses_before: Annotated[Floats, "known", "n", 4, 4]
    bases_before: Annotated[Floats, "known", 6]
    before: Annotated[SpatialTouched, "B"]
    after: Annotated[SpatialTouched, "B"]
    gaps: Annotated[Floats, "B", "C"]
    forces: Annotated[Floats, "B", "n", 6]  # on every link: force, moment about its origin, base frame [N, N·mm]
    work: Annotated[Floats, "B"]
    evaluations: Annotated[Integers, "B"]
    jumped: Annotated[Integers, "B"]


def spatial_sizes(walls, n_joints):
    """SpatialContactSizes of a stack of SpatialWalls."""
    points, bars = walls.points.shape[1], walls.bars.shape[1]
    planes, capsules = walls.planes.shape[1], walls.capsules.shape[1]
    pieces, tubes = walls.pieces.shape[1], walls.tubes.shape[1]
    candidates = points * (planes + tubes) + bars * capsules
    return SpatialContactSizes(points, bars, planes, capsules, pieces, tubes, n_joints, candidates, 2 * (n_joints + 1))


formula(formulas.contact_sizes, SpatialWalls)(spatial_sizes)
formula(formulas.see, SpatialWalls)(see_in_space.py_func)


@formula(formulas.new_contacts, SpatialContactSizes)
def new_contacts(sizes):
    """Empty memory of a solve among walls in space."""
    return np.zeros(size_of(SpatialContactMemory, sizes))


@formula(formulas.contacts_in, SpatialContactSizes)
def contacts_in(sizes, space):
    """The arrays in the memory of a solve among walls in space."""
    return carve_tuple(space, 0, SpatialContactMemory, sizes)


@formula(formulas.touched_of, SpatialTouched)
def touched_of(touched, lane):
    """What the contacts of one lane remember."""
    return SpatialTouched(touched.states[lane], touched.normals[lane], touched.poses[lane])


@formula(formulas.forget_ways, SpatialTouch)
def forget_ways(touch):
    """Nothing of that is kept in space."""


@formula(formulas.begin_rubbing, SpatialTouch)
def begin_rubbing(touch, rubs):
    """Forget friction in the last solve; rubs: 1 with friction in this one, else 0."""
    for c in range(touch.gaps.size):
        put(touch.states[c], 0, (0.0, 0.0, 0.0))
        touch.works[c] = touch.frozen[c] = 0.0
    touch.how[RUBS] = rubs


@part(inline=True)
def velocity(column, point):
    """Velocity of a point of a link per unit of one column of S: three velocities at the origin, three turns."""
    x, y, z = point
    if column < 3:
        return unit(column)
    if column == 3:
        return 0.0, -z, y
    if column == 4:
        return z, 0.0, -x
    return -y, x, 0.0


@part(inline=True)
def _presses(chain, c, gap, law):
    """(normal force, its rate by -gap) of a candidate; adds its energy."""
    touch = chain.touch
    multiplier, rigid = touch.multipliers[c], chain.walls.rigid[0] > 0.0
    k = PENALTY * touch.how[STIFFER] if rigid else law[STIFFNESS]
    energy, normal, rate = press(k, 0.0 if rigid else law[TOE], multiplier, gap)
    touch.how[ENERGY] += energy
    touch.how[MAGNITUDE] += abs(energy)
    touch.gaps[c], touch.normals[c] = gap, normal
    return normal, rate


@part(inline=True)
def _law_of(row, first, length):
    """The law of a wall in its row, for a part of the outline that stands for a length of it."""
    stiffness = row[first + STIFFNESS] * (length if row[first + PER_LENGTH] > 0.0 else 1.0)
    return stiffness, row[first + TOE], row[first + MU], row[first + PRESLIDING]


@part(inline=True)
def _tangential(normal, vector):
    """The part of a vector across a unit normal."""
    return minus(vector, times(normal, dot(normal, vector)))


@part
def _add(chain, state, c, link, point, radius, gradient, normal_force, rate, law):
    """Add one candidate to the sums of its link; touch.columns has how gradient and point change.

    Args:
        point: nearest point of the axis or the middle of a ball. radius: around it. gradient: of the gap by the point.
        normal_force, rate: of `_presses`. law: of the wall: stiffness, toe, coefficient of friction and presliding.
    """
    touch, pose = chain.touch, state.pose
    size = math.sqrt(dot(gradient, gradient))
    n = times(gradient, 1.0 / size)
    at = minus(point, times(n, radius))
    if touch.how[PLACES] > 0.0:
        put(touch.places[c], PLACE, at)
        put(touch.places[c], GRADIENT, gradient)
    mu, presliding = law[MU] * touch.how[RUBS], law[PRESLIDING] * touch.how[SOFTER]
    before, frame = chain.before, chain.walls.base
    z = way = old = bristle = (0.0, 0.0, 0.0)
    share, stretched, slips = 0.0, 1.0, False
    if mu > 0.0:
        arm = from_world(pose, link, minus(at, in_space(pose, link, PX)))  # of the link's material in contact
        was = plus(in_space(before.poses, link, PX), turned(before.poses, link, arm))
        way = minus(at, from_world(frame, 0, minus(was, in_space(frame, 0, PX))))
        old = from_world(frame, 0, in_space(before.states, c, 0))
        if before.normals[c] <= 0.0:
            old = (0.0, 0.0, 0.0)
        bristle = _tangential(n, old)
        length, kept = math.sqrt(dot(old, old)), math.sqrt(dot(bristle, bristle))
        share = length / kept if kept > 0.0 else 0.0
        trial = plus(times(bristle, share), times(_tangential(n, way), 1.0 / presliding))
        stretched = math.sqrt(dot(trial, trial))
        slips = stretched > 1.0 - _SLIPS  # a state that was scaled to length 1 goes on slipping
        z = times(trial, 1.0 / stretched) if slips else trial
        reached = stretched - 0.5 if slips else 0.5 * stretched * stretched
        touch.works[c] = mu * presliding * (reached - 0.5 * length * length)
        touch.how[ENERGY] += touch.frozen[c] * touch.works[c]
        touch.how[MAGNITUDE] += abs(touch.frozen[c] * touch.works[c])
        put(touch.states[c], 0, turned(frame, 0, z))
    else:
        put(touch.states[c], 0, (0.0, 0.0, 0.0))
    if normal_force <= 0.0:
        return
    touch.how[PRESSING] += 1.0
    sums = touch.sums[link - 1]
    drag = times(z, mu * normal_force)  # of the link on the wall
    for a in range(3):
        sums[FORCE + a] += normal_force * gradient[a] - drag[a]
        for b in range(3):
            sums[POINT_FORCE + 3 * a + b] += normal_force * point[a] * gradient[b] - at[a] * drag[b]
    for column in range(N_TWIST):
        turning, sliding = in_space(touch.columns, column, TURNING), in_space(touch.columns, column, SLIDING)
        moved = velocity(column, point)
        closing = dot(gradient, moved)
        force = minus(times(gradient, rate * closing), times(turning, normal_force))
        moment = minus(about(point, force), times(about(sliding, gradient), normal_force))
        if mu > 0.0:
            swing = times(_tangential(n, turning), 1.0 / size)  # of the normal
            going, material = minus(plus(moved, sliding), times(swing, radius)), velocity(column, at)
            rolled = minus(going, material)
            spun = from_world(pose, link, rolled)
            slipping = minus(going, from_world(frame, 0, turned(before.poses, link, spun)))
            change = _tangential(n, slipping)
            change = minus(minus(change, times(swing, dot(n, way))), times(n, dot(swing, way)))
            change = times(change, 1.0 / presliding)
            if share > 0.0:
                bending = plus(times(swing, dot(n, old)), times(n, dot(swing, old)))
                along = dot(bristle, bending) / dot(bristle, bristle)
                change = plus(change, times(minus(times(bristle, along), bending), share))
            if slips:
                change = times(minus(change, times(z, dot(z, change))), 1.0 / stretched)
            pull = minus(times(change, mu * normal_force), times(z, mu * rate * closing))
            force = plus(force, pull)
            moment = plus(moment, plus(about(at, pull), about(rolled, drag)))
        for a in range(3):
            sums[SUM_S + 6 * a + column] += force[a]
            sums[SUM_S + 18 + 6 * a + column] += moment[a]


@part(inline=True)
def _leave_out(touch, c, room):
    """True where a candidate cannot press, by a lower bound of its gap, which is kept."""
    if room <= 0.0 or touch.multipliers[c] > 0.0 or touch.frozen[c] > 0.0:
        return False
    touch.gaps[c], touch.normals[c], touch.works[c] = room, 0.0, 0.0
    put(touch.states[c], 0, (0.0, 0.0, 0.0))
    return True


@part
def touch_in_space(chain, state, all_gaps):
    """As formulas.touch_walls; all_gaps: whether candidates that do not press are evaluated as well."""
    touch = chain.touch
    for i in range(touch.sums.shape[0]):
        for column in range(N_SUMS):
            touch.sums[i, column] = 0.0
    touch.how[ENERGY] = touch.how[MAGNITUDE] = touch.how[PRESSING] = 0.0
    _touch_bars(chain, state, all_gaps, _touch_points(chain, state, all_gaps))
    return touch.how[ENERGY], touch.how[MAGNITUDE]


@part
def _touch_points(chain, state, all_gaps):
    """`touch_in_space` of the points; returns the number of their candidates."""
    seen, touch, pose = chain.walls, chain.touch, state.pose
    c, tubes = 0, seen.tubes.shape[0]
    candidates = seen.planes.shape[0] + tubes
    for q in range(seen.points.shape[0]):
        link, radius = int(seen.points[q, 0]), seen.points[q, 4]
        x = placed(pose, link, in_space(seen.points, q, 1))
        for w in range(seen.planes.shape[0]):
            normal, law = in_space(seen.planes, w, 0), _law_of(seen.planes[w], PLANE_LAW, seen.points[q, 5])
            gap = dot(normal, x) - seen.planes[w, 3] - radius
            if law[STIFFNESS] > 0.0 and link > 0 and (all_gaps or not _leave_out(touch, c, gap)):
                force, rate = _presses(chain, c, gap, law)
                for column in range(N_TWIST):
                    put(touch.columns[column], TURNING, (0.0, 0.0, 0.0))
                    put(touch.columns[column], SLIDING, (0.0, 0.0, 0.0))
                _add(chain, state, c, link, x, radius, normal, force, rate, law)
            c += 1
        for w in range(tubes):
            law = _law_of(seen.tubes[w], TUBE_LAW, seen.points[q, 5])
            if law[STIFFNESS] > 0.0 and link > 0:
                first, last = int(seen.tubes[w, 0]), int(seen.tubes[w, 1])
                i = int(touch.pieces[c])
                if i < 0:
                    i = int(touch.pieces[c - candidates]) if q > 0 else nearest_piece_of(seen, first, last, x)
                i = piece_from(seen, first, last, max(i, first), x)
                touch.pieces[c] = i
                _touch_tube(chain, state, c, link, x, radius, (i, first, last), law, all_gaps)
            c += 1
    return c


@part
def _touch_tube(chain, state, c, link, x, radius, piece, law, all_gaps):
    """A ball of a link in a tube, at a piece of it: number, first and last piece of the tube."""
    touch, (i, first, last) = chain.touch, piece
    offset, aside, q, arc, curvature, slope, wall, t, inwards, across = from_centre_line(chain.walls, i, first, last, x)
    distance = math.sqrt(offset * offset + aside * aside)
    if distance < _NO_DISTANCE:  # any direction across the centre line
        distance, offset, aside = _NO_DISTANCE, _NO_DISTANCE, 0.0
    room = min(wall, wall + slope * chain.walls.pieces[i, LENGTH]) - distance - radius
    if not all_gaps and _leave_out(touch, c, room):
        return
    e = times(plus(times(inwards, offset), times(across, aside)), 1.0 / distance)
    w, per = about(t, e), slope / q
    gradient = minus(times(t, per), e)
    force, rate = _presses(chain, c, wall + slope * arc - distance - radius, law)
    bend, taper = curvature * offset / (q * distance), slope * curvature / (q * q)
    for column in range(N_TWIST):
        dx = velocity(column, x)
        along, up = dot(t, dx), dot(inwards, dx)
        change = minus(times(t, bend * along + taper * up), times(w, dot(w, dx) / distance))
        put(touch.columns[column], TURNING, plus(change, times(inwards, taper * along)))
        put(touch.columns[column], SLIDING, (0.0, 0.0, 0.0))
    _add(chain, state, c, link, x, radius, gradient, force, rate, law)


@part
def _touch_bars(chain, state, all_gaps, c):
    """`touch_in_space` of the bars, the first of which has candidate number c."""
    seen, pose = chain.walls, state.pose
    for q in range(seen.bars.shape[0] if seen.capsules.shape[0] > 0 else 0):
        link, radius = int(seen.bars[q, 0]), seen.bars[q, 7]
        a = placed(pose, link, in_space(seen.bars, q, 1))
        way = minus(placed(pose, link, in_space(seen.bars, q, 4)), a)
        length = math.sqrt(dot(way, way))
        u = times(way, 1.0 / length)
        for w in range(seen.capsules.shape[0]):
            law = _law_of(seen.capsules[w], CAPSULE_LAW, 1.0)
            if law[STIFFNESS] > 0.0 and link > 0:
                _touch_capsule(chain, state, c, link, (a, u, length, radius), w, law, all_gaps)
            c += 1


@part
def _touch_capsule(chain, state, c, link, bar, w, law, all_gaps):
    """A bar of a link, its first end, unit along it, length and radius, against a capsule."""
    touch, seen, (a, u, length, radius) = chain.touch, chain.walls, bar
    b, v, other = in_space(seen.capsules, w, 0), in_space(seen.capsules, w, AXIS), seen.capsules[w, AXIS_LENGTH]
    both = radius + seen.capsules[w, CAPSULE_RADIUS]
    middle = minus(plus(a, times(u, 0.5 * length)), plus(b, times(v, 0.5 * other)))
    room = math.sqrt(dot(middle, middle)) - 0.5 * (length + other) - both
    if not all_gaps and _leave_out(touch, c, room):
        return
    crown = CROWN if other > 0.0 else 0.0
    s, t = nearest_pair(minus(a, b), u, length, v, other, crown)
    r = plus(minus(minus(a, b), times(v, t)), times(u, s))
    aside = s - 0.5 * length
    square = dot(r, r)
    if square < _NO_DISTANCE * _NO_DISTANCE:  # any direction across the bar
        r = times(about(u, (0.0, 0.0, 1.0) if abs(u[2]) < 0.9 else (1.0, 0.0, 0.0)), _NO_DISTANCE)
    distance = max(math.sqrt(square + crown * aside * aside), _NO_DISTANCE)
    if not all_gaps and _leave_out(touch, c, distance - both):
        return
    force, rate = _presses(chain, c, distance - both, law)
    gradient, point = times(r, 1.0 / distance), plus(a, times(u, s))
    slides, follows, uv = 0.0 < s < length, 0.0 < t < other, dot(u, v)
    for column in range(N_TWIST):
        dx = velocity(column, point)
        turn = minus(velocity(column, u), velocity(column, (0.0, 0.0, 0.0)))  # of the bar
        behind, pulled = dot(dx, v), dot(dx, u) + dot(r, turn)
        ds = dt = 0.0
        if slides and follows:
            ds = (uv * behind - pulled) / (1.0 + crown - uv * uv)
            dt = behind + uv * ds
        elif slides:
            ds = -pulled / (1.0 + crown)
        elif follows:
            dt = behind
        sliding = times(u, ds)
        change = minus(plus(dx, sliding), times(v, dt))
        turning = times(minus(change, times(gradient, dot(gradient, dx))), 1.0 / distance)
        put(touch.columns[column], TURNING, turning)
        put(touch.columns[column], SLIDING, sliding)
    _add(chain, state, c, link, point, radius, gradient, force, rate, law)


@part
def nearest_pair(way, u, length, v, other, crown):
    """Places (s, t) on a bar and on the axis of a capsule that minimise |way + s u - t v|² + crown (s - length/2)².

    way: from the first end of the capsule to that of the bar; u, v: unit vectors; both axes have ends.
    """
    half, along, behind, uv = 0.5 * length, dot(way, u), dot(way, v), dot(u, v)
    if other > 0.0:
        s = (uv * behind - along + crown * half) / (1.0 + crown - uv * uv)
        t = behind + uv * s
        if 0.0 <= s <= length and 0.0 <= t <= other:
            return s, t
    best, at_s, at_t = math.inf, 0.0, 0.0
    for edge in range(4 if other > 0.0 else 1):
        if edge < 2:
            t = edge * other
            s = min(max((crown * half - along + t * uv) / (1.0 + crown), 0.0), length)
        else:
            s = (edge - 2) * length
            t = min(max(behind + s * uv, 0.0), other)
        r = minus(plus(way, times(u, s)), times(v, t))
        square = dot(r, r) + crown * (s - half) ** 2
        if square < best:
            best, at_s, at_t = square, s, t
    return at_s, at_t


@part
def add_in_space(chain, state):
    """Add the forces of the walls to the sums of loads beyond each joint; returns (energy, magnitude of its terms)."""
    energy, magnitude = touch_in_space(chain, state, False)
    chain.touch.how[EVALUATIONS] += 1.0
    return energy, magnitude


@part
def rubs_any(walls):
    """Whether any wall has friction; walls: seen."""
    for w in range(walls.planes.shape[0]):
        if walls.planes[w, PLANE_LAW + MU] > 0.0:
            return True
    for w in range(walls.tubes.shape[0]):
        if walls.tubes[w, TUBE_LAW + MU] > 0.0:
            return True
    for w in range(walls.capsules.shape[0]):
        if walls.capsules[w, CAPSULE_LAW + MU] > 0.0:
            return True
    return False
