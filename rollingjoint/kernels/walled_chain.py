"""A planar chain among walls: the formulas of the chain itself and, on top of them, the energy of contact with walls.

To the chain a contact is a load whose place and direction follow from the pose: its force enters the sums of loads, and
its stiffness is a matrix S (3, 3) in the velocity of a link, taken at the origin of the base frame and summed over the
links beyond a joint. With friction at the walls S is not symmetric. Source: docs/theory.md, section 12.
"""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np

from rollingjoint._numba.jit import part
from rollingjoint._numba.layout import Floats, Integers
from rollingjoint.kernels import formulas
from rollingjoint.kernels.chain import register
from rollingjoint.kernels.formulas import formula
from rollingjoint.kernels.friction import slide, work_per_grip
from rollingjoint.kernels.gaps import (
    arc_length_at,
    in_the_bend,
    lumen_gap,
    lumen_way,
    nearest_on_segment,
    press,
    round_end,
    way_around,
)
from rollingjoint.kernels.planar_loads import fill_generators_of_loads, placed
from rollingjoint.kernels.rolling import FX, FY, THETA, TURN, X_DOT_F, C, S, X, Y
from rollingjoint.kernels.torsion_springs import torsion_columns
from rollingjoint.kernels.walls import MU, N_LAW, PER_LENGTH, PRESLIDING, STIFFNESS, TOE

PENALTY = 200.0  # N/mm: stiffness by which a rigid wall begins
_BLEND = 0.005  # mm on either side of the joint of two pieces of a lumen
LONGEST_MOVE = 8.0  # mm: no link moves farther in a step of Newton's method, or it could pass through a wall

# Columns of Touch.sums, over the walls of all links beyond a joint: gradient of the energy by the velocity of the link
# at the origin, point · gradient, and S row by row
_GX, _GY, _GM, _X_DOT_G, _S = range(5)
N_SUMS = _S + 9
# Columns of Seen.pieces: start and its tangent, end and its tangent, curvature, length, arc length at the start, radius
# there, its slope, mean radius; of the pieces before it in its lumen: turn, and the sum of turn x mean radius
_START, _START_TANGENT, _END, _END_TANGENT = range(0, 8, 2)
_CURVATURE, _LENGTH, _ARC, _RADIUS, _SLOPE, _MEAN, _TURNED, _TURNED_MEAN, N_PIECE = range(8, 17)
# Columns of Touch.how: whether there is a history and so friction; factor of the penalty of rigid walls; factor of the
# presliding; whether places are wanted; steps of Newton's method and evaluations so far
RUBS, STIFFER, SOFTER, PLACES, STEPS, EVALUATIONS, N_HOW = range(7)


class Touched(NamedTuple):
    """What contact with walls remembers from one step to the next, by candidate."""

    states: Annotated[Floats, "C"]  # friction state z, -1 to 1
    slips: Annotated[Floats, "C"]  # way along the wall [mm]
    sides: Annotated[Floats, "C"]  # of a lumen's centre line, 1 or -1; 0 where it does not touch
    normals: Annotated[Floats, "C"]  # normal force [N]


class Touch(NamedTuple):
    """Contact evaluated at one configuration, by candidate."""

    gaps: Annotated[Floats, "C"]
    normals: Annotated[Floats, "C"]
    states: Annotated[Floats, "C"]
    slips: Annotated[Floats, "C"]
    sides: Annotated[Floats, "C"]
    works: Annotated[Floats, "C"]  # of friction in the step, per newton of normal force [mm]
    frozen: Annotated[Floats, "C"]  # normal force where the line search began
    multipliers: Annotated[Floats, "C"]  # normal force of rigid walls so far
    pieces: Annotated[Floats, "C"]  # of a lumen, near the point; -1: not yet known
    clear: Annotated[Floats, "C", 3]  # a point, and the square of the way from there that brings it nowhere near a wall
    places: Annotated[Floats, "C", 4]  # contact point on the wall, and the normal there to the link: if wanted
    sums: Annotated[Floats, "J", N_SUMS]
    tangent: Annotated[Floats, "J"]  # the first step of Newton's method [rad]
    how: Annotated[Floats, N_HOW]


class Seen(NamedTuple):
    """Walls as seen from the base, and the outline."""

    points: Annotated[Floats, "points", 5]
    bars: Annotated[Floats, "bars", 6]
    planes: Annotated[Floats, "planes", 4 + N_LAW]  # as Walls.planes, and the place of the base along it before the law
    discs: Annotated[Floats, "discs", 3 + N_LAW]
    capsules: Annotated[Floats, "capsules", 6 + N_LAW]  # first end, unit along it, length, radius; law
    pieces: Annotated[Floats, "pieces", N_PIECE]
    lumens: Annotated[Floats, "lumens", 2 + N_LAW]  # first piece, and the one after the last; law
    steepness: Annotated[Floats, "lumens"]  # the most by which a gap changes with the way of its point
    angle: Annotated[Floats, 1]  # of the base in the world
    rigid: Annotated[Floats, 1]


class ContactMemory(NamedTuple):
    """Memory of one solve among walls."""

    seen: Seen
    touch: Touch


class ContactSizes(NamedTuple):
    """Lengths of the axes of ContactMemory."""

    points: int
    bars: int
    planes: int
    discs: int
    capsules: int
    pieces: int
    lumens: int
    J: int
    C: int


class Walled(NamedTuple):
    """A chain among walls."""

    chain: Any
    joints: Floats  # of the chain
    tendon_joints: Integers
    standing: Floats
    walls: Seen
    before: Touched
    touch: Touch


@part
def contact_sizes(walls, n_joints):
    """ContactSizes of a stack of Walls."""
    points, bars = walls.points.shape[1], walls.bars.shape[1]
    planes, discs, capsules = walls.planes.shape[1], walls.discs.shape[1], walls.capsules.shape[1]
    pieces, lumens = walls.pieces.shape[1], walls.lumens.shape[1]
    candidates = points * (planes + lumens) + bars * (discs + 4 * capsules)
    return ContactSizes(points, bars, planes, discs, capsules, pieces, lumens, n_joints, candidates)


@part(inline=True)
def _unturned(x, y, cos, sin):
    """A vector of the world in the base frame."""
    return cos * x + sin * y, cos * y - sin * x


@part
def see(walls, which, base, seen):
    """Fill the walls as seen from a base at (x, y, angle)."""
    cos, sin = np.cos(base[2]), np.sin(base[2])
    seen.angle[0], seen.rigid[0] = base[2], walls.rigid[which]
    for q in range(seen.points.shape[0]):
        for column in range(seen.points.shape[1]):
            seen.points[q, column] = walls.points[which, q, column]
    for q in range(seen.bars.shape[0]):
        for column in range(6):
            seen.bars[q, column] = walls.bars[which, q, column]
    for w in range(seen.planes.shape[0]):
        nx, ny = walls.planes[which, w, 0], walls.planes[which, w, 1]
        seen.planes[w, 0], seen.planes[w, 1] = _unturned(nx, ny, cos, sin)
        seen.planes[w, 2] = walls.planes[which, w, 2] - (nx * base[0] + ny * base[1])
        seen.planes[w, 3] = ny * base[0] - nx * base[1]
        for column in range(N_LAW):
            seen.planes[w, 4 + column] = walls.planes[which, w, 3 + column]
    for w in range(seen.discs.shape[0]):
        x, y = walls.discs[which, w, 0] - base[0], walls.discs[which, w, 1] - base[1]
        seen.discs[w, 0], seen.discs[w, 1] = _unturned(x, y, cos, sin)
        for column in range(2, 3 + N_LAW):
            seen.discs[w, column] = walls.discs[which, w, column]
    for w in range(seen.capsules.shape[0]):
        x, y = walls.capsules[which, w, 0] - base[0], walls.capsules[which, w, 1] - base[1]
        seen.capsules[w, 0], seen.capsules[w, 1] = _unturned(x, y, cos, sin)
        x, y = (
            walls.capsules[which, w, 2] - walls.capsules[which, w, 0],
            walls.capsules[which, w, 3] - walls.capsules[which, w, 1],
        )
        x, y = _unturned(x, y, cos, sin)
        length = np.sqrt(x * x + y * y)
        per_length = 1.0 / length if length > 0.0 else 0.0
        seen.capsules[w, 2], seen.capsules[w, 3], seen.capsules[w, 4] = x * per_length, y * per_length, length
        for column in range(4, 5 + N_LAW):
            seen.capsules[w, 1 + column] = walls.capsules[which, w, column]
    for w in range(seen.lumens.shape[0]):
        seen.lumens[w, 0] = seen.lumens[w, 1] = 0.0
        seen.steepness[w] = 1.0
        for column in range(N_LAW):
            seen.lumens[w, 2 + column] = walls.lumens[which, w, column]
    for i in range(seen.pieces.shape[0]):
        _see_piece(walls.pieces[which], i, base, cos, sin, seen)


@part
def _see_piece(pieces, i, base, cos, sin, seen):
    """Fill one piece of a lumen, and its place in the lumen."""
    piece, lumen = seen.pieces[i], int(pieces[i, 8])
    length, curvature = pieces[i, 4], pieces[i, 3]
    if length <= 0.0:  # a row without effect
        return
    if seen.lumens[lumen, 1] == 0.0:
        seen.lumens[lumen, 0] = i
        turned = turned_mean = 0.0
    else:
        before = seen.pieces[i - 1]
        turn = before[_CURVATURE] * before[_LENGTH]
        turned, turned_mean = before[_TURNED] + turn, before[_TURNED_MEAN] + turn * before[_MEAN]
        if pieces[i, 6] != pieces[i - 1, 7]:
            seen.steepness[lumen] = np.inf
    seen.lumens[lumen, 1] = i + 1
    x, y = _unturned(pieces[i, 0] - base[0], pieces[i, 1] - base[1], cos, sin)
    angle = pieces[i, 2] - base[2]
    tx, ty = np.cos(angle), np.sin(angle)
    half = 0.5 * curvature * length
    c, s = np.cos(half), np.sin(half)
    chord, mx, my = length * (s / half if half != 0.0 else 1.0), tx * c - ty * s, ty * c + tx * s
    piece[_START], piece[_START + 1], piece[_START_TANGENT], piece[_START_TANGENT + 1] = x, y, tx, ty
    piece[_END], piece[_END + 1] = x + chord * mx, y + chord * my
    piece[_END_TANGENT], piece[_END_TANGENT + 1] = mx * c - my * s, my * c + mx * s
    piece[_CURVATURE], piece[_LENGTH], piece[_ARC] = curvature, length, pieces[i, 5]
    piece[_RADIUS], piece[_SLOPE] = pieces[i, 6], (pieces[i, 7] - pieces[i, 6]) / length
    piece[_MEAN] = 0.5 * (pieces[i, 6] + pieces[i, 7])
    piece[_TURNED], piece[_TURNED_MEAN] = turned, turned_mean
    narrowing = abs(piece[_SLOPE]) / max(1.0 - abs(curvature) * max(pieces[i, 6], pieces[i, 7]), 0.0)
    seen.steepness[lumen] = max(seen.steepness[lumen], 1.0 + (narrowing if piece[_SLOPE] != 0.0 else 0.0))


@part
def begin_touch(touch):
    """Forget the last solve."""
    for c in range(touch.gaps.size):
        touch.normals[c] = touch.frozen[c] = touch.multipliers[c] = 0.0
        touch.states[c] = touch.slips[c] = touch.sides[c] = touch.works[c] = 0.0
        touch.gaps[c], touch.pieces[c], touch.clear[c, 2] = np.inf, -1.0, 0.0
    touch.how[STIFFER] = touch.how[SOFTER] = 1.0
    touch.how[RUBS] = touch.how[PLACES] = touch.how[STEPS] = touch.how[EVALUATIONS] = 0.0
    for i in range(touch.tangent.size):
        touch.tangent[i] = 0.0


@part
def _nearest_piece(seen, first, last, x, y):
    """The piece of a lumen with the nearest centre line."""
    nearest, best = np.inf, first
    for i in range(first, last):
        piece = seen.pieces[i]
        if (i > first and _beyond_start(piece, x, y) < 0.0) or (i < last - 1 and _beyond_end(piece, x, y) > 0.0):
            continue
        dx, dy = x - piece[_START], y - piece[_START + 1]
        tx, ty = piece[_START_TANGENT], piece[_START_TANGENT + 1]
        offset, _, _, _ = in_the_bend(dx * tx + dy * ty, dy * tx - dx * ty, piece[_CURVATURE])
        if abs(offset) < nearest:
            nearest, best = abs(offset), i
    return best


@part(inline=True)
def _beyond_start(piece, x, y):
    """How far a point is beyond the start of a piece, along the tangent there."""
    dx, dy = x - piece[_START], y - piece[_START + 1]
    return dx * piece[_START_TANGENT] + dy * piece[_START_TANGENT + 1]


@part(inline=True)
def _beyond_end(piece, x, y):
    """How far a point is beyond the end of a piece, along the tangent there."""
    dx, dy = x - piece[_END], y - piece[_END + 1]
    return dx * piece[_END_TANGENT] + dy * piece[_END_TANGENT + 1]


@part
def _piece_near(seen, first, last, i, x, y):
    """The piece at the nearest point of the centre line, from a piece near it: of a loop, never the other limb."""
    if i < last - 1 and _beyond_end(seen.pieces[i], x, y) > 0.0:
        while i < last - 1 and _beyond_end(seen.pieces[i], x, y) > 0.0:
            i += 1
    else:
        while i > first and _beyond_start(seen.pieces[i], x, y) < 0.0:
            i -= 1
    return i


@part
def _lumen_fields(seen, w, i, x, y, radius, rubs):
    """(gap, way, side): the fields of a point in a lumen, at a piece of it, and the wall that it is nearer to.

    rubs: whether the way is wanted.
    """
    piece, first, last = seen.pieces[i], int(seen.lumens[w, 0]), int(seen.lumens[w, 1])
    beyond = _beyond_end(piece, x, y)
    after = i == last - 1 and beyond > 0.0
    at = _END if after else _START
    dx, dy, tx, ty = x - piece[at], y - piece[at + 1], piece[at + 2], piece[at + 3]
    u, v = dx * tx + dy * ty, dy * tx - dx * ty
    curvature, slope, wall_radius = piece[_CURVATURE], piece[_SLOPE], piece[_RADIUS]
    if after or (i == first and u < 0.0):  # both ends go on straight
        wall_radius = piece[_RADIUS] + piece[_SLOPE] * piece[_LENGTH] if after else piece[_RADIUS]
        curvature = slope = 0.0
    offset, q, cos, sin = in_the_bend(u, v, curvature)
    arc = arc_length_at(u, cos, sin, curvature) if rubs or slope != 0.0 else 0.0
    tx, ty = tx * cos - ty * sin, ty * cos + tx * sin
    side = 1.0 if offset > 0.0 else -1.0
    turn = piece[_TURNED] + (piece[_CURVATURE] * piece[_LENGTH] if after else 0.0)
    turn_mean = piece[_TURNED_MEAN] + (piece[_CURVATURE] * piece[_LENGTH] * piece[_MEAN] if after else 0.0)
    start = piece[_ARC] - seen.pieces[first, _ARC] + (piece[_LENGTH] if after else 0.0)
    scale = 1.0 - curvature * side * (piece[_MEAN] - radius)
    way = start - side * (turn_mean - radius * turn) + scale * arc
    gap = lumen_gap(side, wall_radius + slope * arc, slope, curvature, offset, q, tx, ty)
    field = lumen_way(side, way, scale, curvature, q, tx, ty)
    if not rubs:
        return gap, field, side
    other, along = _joint_near(i, first, last, u if after else arc, piece[_LENGTH], after)
    if abs(along) >= _BLEND:
        return gap, field, side
    turn = seen.pieces[max(other, 0), _CURVATURE] if other >= 0 else 0.0
    mean = seen.pieces[max(other, 0), _MEAN]
    more = (1.0 - turn * side * (mean - radius)) / (1.0 - turn * offset) - scale / q
    share, rate = 0.5 * (1.0 - abs(along) / _BLEND), -0.5 / (_BLEND * q) * (1.0 if along >= 0.0 else -1.0)
    per, k = -side * more * share, -side * more * rate
    _, fx, fy, xx, xy, yy = field
    return gap, (field[0], fx + per * tx, fy + per * ty, xx + k * tx * tx, xy + k * tx * ty, yy + k * ty * ty), side


@part(inline=True)
def _joint_near(i, first, last, arc, length, after):
    """(piece on the other side of the nearer end of piece i, or -1 for a straight end, arc length from there).

    The rate of the way along a wall that gives way jumps with the curvature of its pieces, and friction with it: near
    the joint of two pieces it goes from one to the other, or a pose at the joint could have no balance.
    """
    if after or (i == first and arc < 0.0):
        return i, arc
    if arc > 0.5 * length:
        return (i + 1 if i < last - 1 else -1), arc - length
    return (i - 1 if i > first else -1), arc


@part(inline=True)
def _lumen_room(seen, w, i, x, y):
    """A lower bound of the distance of a point from the walls of a lumen, at a piece of it, without its arc length."""
    piece, first, last = seen.pieces[i], int(seen.lumens[w, 0]), int(seen.lumens[w, 1])
    after = i == last - 1 and _beyond_end(piece, x, y) > 0.0
    at = _END if after else _START
    dx, dy, tx, ty = x - piece[at], y - piece[at + 1], piece[at + 2], piece[at + 3]
    u, v = dx * tx + dy * ty, dy * tx - dx * ty
    straight = after or (i == first and u < 0.0)
    offset, _, _, _ = in_the_bend(u, v, 0.0 if straight else piece[_CURVATURE])
    narrowest = min(piece[_RADIUS], piece[_RADIUS] + piece[_SLOPE] * piece[_LENGTH])
    return narrowest - abs(offset)


@part(inline=True)
def _law(row, first):
    """The law of a wall in its row."""
    return row[first + STIFFNESS], row[first + TOE], row[first + MU], row[first + PRESLIDING]


@part(inline=True)
def _law_at(row, first, point):
    """The law of a wall for a point of an outline, which stands for a length of it."""
    stiffness, toe, mu, presliding = _law(row, first)
    return stiffness * (point[4] if row[first + PER_LENGTH] > 0.0 else 1.0), toe, mu, presliding


@part
def _add(chain, c, link, x, y, fixed, gap, way, rolled, side, law):
    """Add one candidate to the sums of its link; returns (energy, magnitude).

    Args:
        x, y: the point of the fields, in the base frame. fixed: True where it does not move with the link.
        gap, way: the fields. rolled: gradient of the way by the turn of the link [mm]. side: of the wall.
        law: of the wall, its stiffness, toe, coefficient of friction and presliding.
    """
    touch, before = chain.touch, chain.before
    multiplier, rigid = touch.multipliers[c], chain.walls.rigid[0] > 0.0
    k = PENALTY * touch.how[STIFFER] if rigid else law[STIFFNESS]
    energy, normal, rate = press(k, 0.0 if rigid else law[TOE], multiplier, gap[0])
    magnitude, frozen = abs(energy), touch.frozen[c]
    touch.gaps[c], touch.normals[c], touch.slips[c], touch.sides[c] = gap[0], normal, way[0], side
    mu, presliding = law[MU] * touch.how[RUBS], law[PRESLIDING] * touch.how[SOFTER]
    z, sticking = 0.0, 0.0
    if mu > 0.0:
        state, start = 0.0, before.slips[c]
        if before.sides[c] == side:
            state = before.states[c]
        elif before.sides[c] != 0.0:
            start = way[0]
        z = -slide(-state, way[0] - start, presliding)
        sticking = 1.0 / presliding if abs(z) < 1.0 else 0.0
        touch.works[c] = mu * work_per_grip(-state, -z, way[0] - start, presliding)
        energy, magnitude = energy + frozen * touch.works[c], magnitude + abs(frozen * touch.works[c])
    touch.states[c] = z
    if touch.how[PLACES] > 0.0:
        size = np.sqrt(gap[1] * gap[1] + gap[2] * gap[2])
        nx, ny, away = gap[1] / size, gap[2] / size, rolled if fixed else -(rolled + gap[0])
        touch.places[c, 0], touch.places[c, 1] = x + away * nx, y + away * ny
        touch.places[c, 2], touch.places[c, 3] = nx, ny
    if normal <= 0.0:
        return energy, magnitude
    sums, friction = touch.sums[link - 1], mu * normal * z
    _, gx, gy, gxx, gxy, gyy = gap
    _, sx, sy, sxx, sxy, syy = way
    fx, fy = friction * sx - normal * gx, friction * sy - normal * gy
    kxx, kxy, kyy = friction * sxx - normal * gxx, friction * sxy - normal * gxy, friction * syy - normal * gyy
    gm, sm = gy * x - gx * y, sy * x - sx * y + rolled
    sums[_GX] += fx
    sums[_GY] += fy
    sums[_GM] += friction * sm - normal * gm
    sums[_X_DOT_G] += x * fx + y * fy
    a, b = kxy * x - kxx * y, kyy * x - kxy * y  # K J x
    turning = b * x - a * y
    if fixed:
        a, b, turning = a - fy, b + fx, turning + 2.0 * (fx * x + fy * y)
    slip, across = mu * normal * sticking, mu * z * rate
    ux, uy, um = rate * gx - across * sx, rate * gy - across * sy, rate * gm - across * sm
    vx, vy, vm = slip * sx, slip * sy, slip * sm
    sums[_S] += kxx + ux * gx + vx * sx
    sums[_S + 1] += kxy + ux * gy + vx * sy
    sums[_S + 2] += a + ux * gm + vx * sm
    sums[_S + 3] += kxy + uy * gx + vy * sx
    sums[_S + 4] += kyy + uy * gy + vy * sy
    sums[_S + 5] += b + uy * gm + vy * sm
    sums[_S + 6] += a + um * gx + vm * sx
    sums[_S + 7] += b + um * gy + vm * sy
    sums[_S + 8] += turning + um * gm + vm * sm
    return energy, magnitude


@part(inline=True)
def _is_far(touch, c, room):
    """True where a candidate cannot press, by a lower bound of its gap, which is kept; there it is left out."""
    if room <= 0.0 or touch.multipliers[c] > 0.0 or touch.frozen[c] > 0.0:
        return False
    touch.gaps[c], touch.normals[c], touch.states[c], touch.works[c] = room, 0.0, 0.0, 0.0
    return True


@part(inline=True)
def _is_clear(touch, c, x, y):
    """True for a point still so near to where it was far from the wall that half of its gap there is a lower bound."""
    dx, dy = x - touch.clear[c, 0], y - touch.clear[c, 1]
    return dx * dx + dy * dy < touch.clear[c, 2]


@part
def touch_walls(chain, state, all_gaps):
    """Fill the contact of every candidate, and the sums of each link; returns (energy, magnitude of its terms).

    all_gaps: whether candidates that do not press are evaluated as well; else their gaps are lower bounds, which are
    positive, and their slips remain.
    """
    touch = chain.touch
    for i in range(touch.sums.shape[0]):
        for column in range(N_SUMS):
            touch.sums[i, column] = 0.0
    energy, magnitude, c = _touch_points(chain, state, all_gaps)
    more, size = _touch_bars(chain, state, all_gaps, c)
    return energy + more, magnitude + size


@part
def _touch_points(chain, state, all_gaps):
    """`touch_walls` of the points; returns the number of their candidates, too."""
    seen, touch, pose = chain.walls, chain.touch, state.pose
    energy, magnitude, c, lumens = 0.0, 0.0, 0, seen.lumens.shape[0]
    candidates = seen.planes.shape[0] + lumens
    for q in range(seen.points.shape[0]):
        point = seen.points[q]
        link, radius = int(point[0]), point[3]
        x, y = placed(pose[link, X], pose[link, Y], pose[link, C], pose[link, S], point[1], point[2])
        rolled = radius * (pose[link, THETA] + seen.angle[0])
        for w in range(seen.planes.shape[0]):
            plane = seen.planes[w]
            nx, ny = plane[0], plane[1]
            value = nx * x + ny * y - plane[2] - radius
            if plane[4 + STIFFNESS] > 0.0 and link > 0 and (all_gaps or not _is_far(touch, c, value)):
                gap = value, nx, ny, 0.0, 0.0, 0.0
                way = ny * x - nx * y + plane[3] + rolled, ny, -nx, 0.0, 0.0, 0.0
                term, size = _add(chain, c, link, x, y, False, gap, way, radius, 1.0, _law_at(plane, 4, point))
                energy, magnitude = energy + term, magnitude + size
            c += 1
        for w in range(lumens):
            lumen = seen.lumens[w]
            if lumen[2 + STIFFNESS] > 0.0 and link > 0 and (all_gaps or not _is_clear(touch, c, x, y)):
                first, last = int(lumen[0]), int(lumen[1])
                i = int(touch.pieces[c])
                if i < 0:
                    i = int(touch.pieces[c - candidates]) if q > 0 else _nearest_piece(seen, first, last, x, y)
                i = _piece_near(seen, first, last, max(i, first), x, y)
                touch.pieces[c] = i
                room = _lumen_room(seen, w, i, x, y) - radius
                if not all_gaps and _is_far(touch, c, room):
                    touch.clear[c, 0], touch.clear[c, 1] = x, y
                    touch.gaps[c], touch.clear[c, 2] = 0.5 * room, (0.5 * room / seen.steepness[w]) ** 2
                else:
                    touch.clear[c, 2] = 0.0
                    gap, way, side = _lumen_fields(seen, w, i, x, y, radius, all_gaps or touch.how[RUBS] > 0.0)
                    gap = gap[0] - radius, gap[1], gap[2], gap[3], gap[4], gap[5]
                    way = way[0] + rolled, way[1], way[2], way[3], way[4], way[5]
                    term, size = _add(chain, c, link, x, y, False, gap, way, radius, side, _law_at(lumen, 2, point))
                    energy, magnitude = energy + term, magnitude + size
            c += 1
    return energy, magnitude, c


@part
def _touch_bars(chain, state, all_gaps, c):
    """`touch_walls` of the bars, the first of which has candidate number c."""
    seen, pose = chain.walls, state.pose
    energy, magnitude = 0.0, 0.0
    for q in range(seen.bars.shape[0] if seen.discs.shape[0] + seen.capsules.shape[0] > 0 else 0):
        bar = seen.bars[q]
        link, radius = int(bar[0]), bar[5]
        at = pose[link, X], pose[link, Y], pose[link, C], pose[link, S]
        ax, ay = placed(at[0], at[1], at[2], at[3], bar[1], bar[2])
        bx, by = placed(at[0], at[1], at[2], at[3], bar[3], bar[4])
        ux, uy = bx - ax, by - ay
        length = np.sqrt(ux * ux + uy * uy)
        ux, uy, angle = ux / length, uy / length, pose[link, THETA] + seen.angle[0]
        axis = ax, ay, ux, uy, length
        for w in range(seen.discs.shape[0]):
            disc = seen.discs[w]
            if disc[3 + STIFFNESS] > 0.0 and link > 0:
                how = chain, c, link, axis, radius, angle, disc[0], disc[1], disc[2], _law(disc, 3), all_gaps
                term, size = _touch_disc(*how)
                energy, magnitude = energy + term, magnitude + size
            c += 1
        for w in range(seen.capsules.shape[0]):
            capsule = seen.capsules[w]
            if capsule[6 + STIFFNESS] > 0.0 and link > 0:
                for end in range(2):
                    ox, oy = capsule[0] + end * capsule[4] * capsule[2], capsule[1] + end * capsule[4] * capsule[3]
                    how = chain, c + end, link, axis, radius, angle, ox, oy, capsule[5], _law(capsule, 6), all_gaps
                    term, size = _touch_disc(*how)
                    energy, magnitude = energy + term, magnitude + size
                    x, y = (ax, ay) if end == 0 else (bx, by)
                    term, size = _touch_capsule(chain, c + 2 + end, link, x, y, radius, angle, capsule, all_gaps)
                    energy, magnitude = energy + term, magnitude + size
            c += 4
    return energy, magnitude


@part
def _touch_disc(chain, c, link, axis, radius, angle, x, y, other, law, all_gaps):
    """A bar against a disc around (x, y), which is a fixed point as seen from the link."""
    ax, ay, ux, uy, length = axis
    half = 0.5 * length
    dx, dy, reach = ax + half * ux - x, ay + half * uy - y, half + radius + other
    if not all_gaps and dx * dx + dy * dy > reach * reach and _is_far(chain.touch, c, 1.0):
        chain.touch.gaps[c] = np.sqrt(dx * dx + dy * dy) - reach
        return 0.0, 0.0
    nearest = nearest_on_segment(x, y, ax, ay, ux, uy, length)
    distance, nx, ny, _, end = nearest
    value = distance - radius - other
    if not all_gaps and _is_far(chain.touch, c, value):
        return 0.0, 0.0
    xx, xy, yy = round_end(distance, nx, ny, end)
    along, sx, sy, sxx, sxy, syy = way_around(nearest, ux, uy, length, radius, other)
    gap, way = (value, -nx, -ny, xx, xy, yy), (along + other * angle, -sx, -sy, sxx, sxy, syy)
    return _add(chain, c, link, x, y, True, gap, way, other, 1.0, law)


@part
def _touch_capsule(chain, c, link, x, y, radius, angle, capsule, all_gaps):
    """The end (x, y) of a bar against a fixed capsule."""
    ax, ay, ux, uy, length, other = capsule[0], capsule[1], capsule[2], capsule[3], capsule[4], capsule[5]
    nearest = nearest_on_segment(x, y, ax, ay, ux, uy, length)
    distance, nx, ny, _, end = nearest
    value = distance - radius - other
    if not all_gaps and _is_far(chain.touch, c, value):
        return 0.0, 0.0
    xx, xy, yy = round_end(distance, nx, ny, end)
    along, sx, sy, sxx, sxy, syy = way_around(nearest, ux, uy, length, other, radius)
    gap, way = (value, nx, ny, xx, xy, yy), (radius * angle - along, -sx, -sy, -sxx, -sxy, -syy)
    return _add(chain, c, link, x, y, False, gap, way, radius, 1.0, _law(capsule, 6))


@formula(formulas.evaluate_loads, Walled)
def evaluate_loads(chain, loads, state):
    """Fill the sums of loads and walls beyond each joint; returns (energy, magnitude of its terms)."""
    energy, magnitude = formulas.evaluate_loads(chain.chain, loads, state)
    more, size = touch_walls(chain, state, False)
    wall_sums, sums = chain.touch.sums, state.sums
    chain.touch.how[EVALUATIONS] += 1.0
    n = sums.shape[0]
    for i in range(n - 1, -1, -1):
        if i < n - 1:
            for column in range(N_SUMS):
                wall_sums[i, column] += wall_sums[i + 1, column]
        sums[i, FX] -= wall_sums[i, _GX]
        sums[i, FY] -= wall_sums[i, _GY]
        sums[i, TURN] -= wall_sums[i, _GM]
        sums[i, X_DOT_F] -= wall_sums[i, _X_DOT_G]
    return energy + more, magnitude + size


@part(inline=True)
def _from_the_left(sums, i, x, y):
    """tᵀ S, S of the walls beyond joint i, t = (y, -x, 1): velocity at the origin per turn about (x, y)."""
    return (
        y * sums[i, _S] - x * sums[i, _S + 3] + sums[i, _S + 6],
        y * sums[i, _S + 1] - x * sums[i, _S + 4] + sums[i, _S + 7],
        y * sums[i, _S + 2] - x * sums[i, _S + 5] + sums[i, _S + 8],
    )


@part(inline=True)
def _from_the_right(sums, i, x, y):
    """S t, likewise."""
    return (
        y * sums[i, _S] - x * sums[i, _S + 1] + sums[i, _S + 2],
        y * sums[i, _S + 3] - x * sums[i, _S + 4] + sums[i, _S + 5],
        y * sums[i, _S + 6] - x * sums[i, _S + 7] + sums[i, _S + 8],
    )


@formula(formulas.fill_load_stiffness, Walled)
def fill_load_stiffness(chain, state, i, H):
    """Fill H_im and H_mi, m <= i, with the terms of loads and walls beyond joint i."""
    formulas.fill_load_stiffness(chain.chain, state, i, H)
    contact, sums = state.contact, chain.touch.sums
    lx, ly, lm = _from_the_left(sums, i, contact[i, 0], contact[i, 1])
    rx, ry, rm = _from_the_right(sums, i, contact[i, 0], contact[i, 1])
    for m in range(i + 1):
        x, y = contact[m, 0], contact[m, 1]
        H[i, m] += lx * y - ly * x + lm
        if m < i:
            H[m, i] += rx * y - ry * x + rm


@part
def base_stiffness(chain, state, S):
    """Fill d residual / d velocity of the base in its own frame, (J, 3): x, y, turn about its origin."""
    contact, sums = state.contact, chain.touch.sums
    for i in range(contact.shape[0]):
        x, y = contact[i, 0], contact[i, 1]
        S[i, 0], S[i, 1], S[i, 2] = _from_the_left(sums, i, x, y)
        S[i, 2] -= sums[i, _X_DOT_G] - (x * sums[i, _GX] + y * sums[i, _GY])


@part
def force_rates(chain, state, rates):
    """Fill d force of all walls, x and y / d joint angle and d velocity of the base in its own frame, (2, J + 3)."""
    contact, sums = state.contact, chain.touch.sums
    n = contact.shape[0]
    for i in range(n):
        fx, fy, _ = _from_the_right(sums, i, contact[i, 0], contact[i, 1])
        rates[0, i], rates[1, i] = -fx, -fy
    for column in range(3):
        rates[0, n + column], rates[1, n + column] = -sums[0, _S + column], -sums[0, _S + 3 + column]
    rates[0, n + 2] -= sums[0, _GY]  # the frame of the base turns, too
    rates[1, n + 2] += sums[0, _GX]


@formula(formulas.generator_columns, Walled)
def generator_columns(chain, loads):
    """Number of columns of a Sweep for loads and walls: three, and one for each torsion spring over two joints."""
    return 3 + torsion_columns(chain.standing, loads, True)


@formula(formulas.fill_load_generators, Walled)
def fill_load_generators(chain, loads, state, prox, sweep):
    """Fill diagonal, U and V of a Sweep with the terms of loads, walls and moving contacts."""
    fill_generators_of_loads(chain.chain, loads, state, prox, True, sweep)
    contact, sums = state.contact, chain.touch.sums
    for i in range(contact.shape[0]):
        cx, cy = contact[i, 0], contact[i, 1]
        lx, ly, lm = _from_the_left(sums, i, cx, cy)
        sweep.U[i, 0] += lm
        sweep.U[i, 1] -= ly
        sweep.U[i, 2] += lx
        sweep.diagonal[i] += lx * cy - ly * cx + lm


@formula(formulas.shorten, Walled)
def shorten(chain, state, step, is_newtons):
    """Shorten a step that would move the origin of a link too far; keep the first of Newton's; returns the factor."""
    n, contact, pose, touch = step.size, state.contact, state.pose, chain.touch
    for i in range(n if is_newtons and touch.how[STEPS] == 0.0 else 0):
        touch.tangent[i] = step[i]
    touch.how[STEPS] += 1.0
    turn, x, y, farthest = 0.0, 0.0, 0.0, 0.0
    for i in range(n):
        turn += step[i]
        x += step[i] * contact[i, 0]
        y += step[i] * contact[i, 1]
        dx, dy = y - turn * pose[i + 1, Y], turn * pose[i + 1, X] - x
        farthest = max(farthest, dx * dx + dy * dy)
    if farthest <= LONGEST_MOVE * LONGEST_MOVE:
        return 1.0
    part_of_it = LONGEST_MOVE / np.sqrt(farthest)
    for i in range(n):
        step[i] *= part_of_it
    return part_of_it


@formula(formulas.evaluate_geometry, Walled)
def evaluate_geometry(chain, state):
    """Fill poses, gaps and tendon lengths."""
    formulas.evaluate_geometry(chain.chain, state)


@formula(formulas.evaluate_residual, Walled)
def evaluate_residual(chain, state):
    """Fill r; returns the largest sum of its terms' magnitudes."""
    return formulas.evaluate_residual(chain.chain, state)


@formula(formulas.own_stiffness, Walled)
def own_stiffness(chain, state, i):
    """Term of joint i alone."""
    return formulas.own_stiffness(chain.chain, state, i)


@formula(formulas.add_between_links, Walled)
def add_between_links(chain, loads, H):
    """Add the terms of loads between two links."""
    formulas.add_between_links(chain.chain, loads, H)


@formula(formulas.fill_turns, Walled)
def fill_turns(chain, state, turn):
    """Fill the turns of the tendons."""
    formulas.fill_turns(chain.chain, state, turn)


@formula(formulas.fill_normals, Walled)
def fill_normals(chain, state, rolling):
    """Fill the normal force between links, with the share of the walls."""
    formulas.fill_normals(chain.chain, state, rolling)


@formula(formulas.fill_upper_generators, Walled)
def fill_upper_generators(chain, state, U, Q):
    """Fill the generators above the diagonal: friction at walls acts on every link, and its force is not symmetric."""
    contact, sums = state.contact, chain.touch.sums
    for i in range(U.shape[0]):
        for a in range(U.shape[1]):
            Q[i, a] = U[i, a]
        lx, ly, lm = _from_the_left(sums, i, contact[i, 0], contact[i, 1])
        rx, ry, rm = _from_the_right(sums, i, contact[i, 0], contact[i, 1])
        Q[i, 0] += rm - lm
        Q[i, 1] += ly - ry
        Q[i, 2] += rx - lx


@formula(formulas.soften, Walled)
def soften(chain, softness):
    """Multiply the presliding at the walls."""
    chain.touch.how[SOFTER] = softness


@formula(formulas.is_among_walls, Walled)
def is_among_walls(chain):
    """True."""
    return True


@formula(formulas.renew, Walled)
def renew(chain, state, energy, magnitude):
    """(incremental potential, magnitude) with the normal forces of friction frozen at the present state."""
    touch, change = chain.touch, 0.0
    if touch.how[RUBS] > 0.0:
        for c in range(touch.gaps.size):
            if touch.normals[c] != touch.frozen[c]:
                change += (touch.normals[c] - touch.frozen[c]) * touch.works[c]
                touch.frozen[c] = touch.normals[c]
    return energy + change, magnitude + abs(change)


register(
    Walled,
    (
        formulas.shorten,
        formulas.renew,
        formulas.soften,
        formulas.is_among_walls,
        formulas.fill_upper_generators,
    ),
)


@part
def walled(chain, place, before):
    """The chain among the walls of a ContactMemory."""
    return Walled(chain, chain.joints, chain.tendon_joints, chain.standing, place.seen, before, place.touch)


@part
def link_forces(touch, state, forces):
    """Fill the wall force on every link: x, y, moment about its origin, in the base frame [N, N·mm]."""
    n = touch.sums.shape[0]
    forces[0, 0] = forces[0, 1] = forces[0, 2] = 0.0
    for i in range(n):
        fx, fy, moment = -touch.sums[i, _GX], -touch.sums[i, _GY], -touch.sums[i, _GM]
        if i < n - 1:
            fx, fy, moment = fx + touch.sums[i + 1, _GX], fy + touch.sums[i + 1, _GY], moment + touch.sums[i + 1, _GM]
        x, y = state.pose[i + 1, X], state.pose[i + 1, Y]
        forces[i + 1, 0], forces[i + 1, 1], forces[i + 1, 2] = fx, fy, moment - (x * fy - y * fx)
