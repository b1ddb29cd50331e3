"""Contact of the outline of a chain with walls: every candidate, its energy, and the sums of its forces and stiffness.

Source: docs/theory.md, section 12.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from rollingjoint._numba.jit import part
from rollingjoint._numba.layout import Floats
from rollingjoint._numba.pins import carve_tuple, size_of
from rollingjoint.kernels import formulas
from rollingjoint.kernels.arrays import all_resolvable
from rollingjoint.kernels.formulas import formula
from rollingjoint.kernels.friction import slide, work_per_grip
from rollingjoint.kernels.gaps import nearest_on_segment, press, round_end, way_around
from rollingjoint.kernels.lumens import lumen_fields, lumen_room, nearest_piece, piece_near, point_in_lumen
from rollingjoint.kernels.planar_loads import placed
from rollingjoint.kernels.rolling import THETA, C, S, X, Y
from rollingjoint.kernels.seen_walls import Seen, see
from rollingjoint.kernels.walls import MU, PER_LENGTH, PRESLIDING, STIFFNESS, TOE, Walls

LONGEST_MOVE = 8.0  # mm: no link moves farther in a step of Newton's method, or it could pass through a wall
PENALTY = 200.0  # N/mm: stiffness by which a rigid wall begins
_LEFT_OF_ROOM = 0.1  # of the gap of a point that has moved as far as it may before its gap is evaluated again

# Columns of Touch.sums, over the walls of all links beyond a joint: gradient of the energy by the velocity of the link
# at the origin, point · gradient, and S row by row
GX, GY, GM, X_DOT_G, SUM_S = range(5)
N_SUMS = SUM_S + 9
N_PLACE = 6  # columns of Touch.places
# Columns of Touch.how: whether there is a history and so friction; factor of the penalty of rigid walls; factor of the
# presliding; whether places are wanted; steps of Newton's method and evaluations so far; energy, magnitude of its
# terms; number of contacts that press
RUBS, STIFFER, SOFTER, PLACES, STEPS, EVALUATIONS, ENERGY, MAGNITUDE, PRESSING, N_HOW = range(10)


class Touched(NamedTuple):
    """What contact with walls remembers from one step to the next, by candidate."""

    states: Annotated[Floats, "C"]  # friction state z, -1 to 1
    slips: Annotated[Floats, "C"]  # way along the wall [mm]
    sides: Annotated[Floats, "C"]  # of a lumen's centre line to which the way belongs, 1 or -1
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
    places: Annotated[Floats, "C", N_PLACE]  # contact point on the wall, gradient of the gap and of the way: if wanted
    sums: Annotated[Floats, "J", N_SUMS]
    tangent: Annotated[Floats, "J"]  # the first step of Newton's method [rad]
    how: Annotated[Floats, N_HOW]


class ContactMemory(NamedTuple):
    """Memory of one solve among walls."""

    seen: Seen
    touch: Touch
    curve: Annotated[Floats, "ends", 3]  # the chain before the step and after it (passing.py)


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
    ends: int


@formula(formulas.contact_sizes, Walls)
def contact_sizes(walls, n_joints):
    """ContactSizes of a stack of Walls."""
    points, bars = walls.points.shape[1], walls.bars.shape[1]
    planes, discs, capsules = walls.planes.shape[1], walls.discs.shape[1], walls.capsules.shape[1]
    pieces, lumens = walls.pieces.shape[1], walls.lumens.shape[1]
    candidates = points * (planes + lumens) + bars * (discs + 4 * capsules)
    return ContactSizes(points, bars, planes, discs, capsules, pieces, lumens, n_joints, candidates, 2 * (n_joints + 1))


@formula(formulas.new_contacts, ContactSizes)
def new_contacts(sizes):
    """Empty memory of a solve among walls."""
    return np.zeros(size_of(ContactMemory, sizes))


@formula(formulas.contacts_in, ContactSizes)
def contacts_in(sizes, space):
    """The arrays in the memory of a solve among walls."""
    return carve_tuple(space, 0, ContactMemory, sizes)


formula(formulas.see, Walls)(see.py_func)


@formula(formulas.touched_of, Touched)
def touched_of(touched, lane):
    """What one lane remembers."""
    return Touched(touched.states[lane], touched.slips[lane], touched.sides[lane], touched.normals[lane])


@formula(formulas.valid_memory, Touched)
def valid_memory(touched):
    """Whether what contacts remember are finite numbers."""
    return all_resolvable(touched.slips)


@part
def begin_touch(touch):
    """Forget the last solve, but for friction in it (`begin_rubbing`)."""
    for c in range(touch.gaps.size):
        touch.normals[c] = touch.multipliers[c] = 0.0
        touch.gaps[c], touch.pieces[c] = np.inf, -1.0
    formulas.forget_ways(touch)
    touch.how[STIFFER] = touch.how[SOFTER] = 1.0
    touch.how[RUBS] = touch.how[PLACES] = touch.how[STEPS] = touch.how[EVALUATIONS] = 0.0
    for i in range(touch.tangent.size):
        touch.tangent[i] = 0.0


@formula(formulas.forget_ways, Touch)
def forget_ways(touch):
    """Forget how far points are from walls."""
    for c in range(touch.gaps.size):
        touch.clear[c, 2] = 0.0


@formula(formulas.begin_rubbing, Touch)
def begin_rubbing(touch, rubs):
    """Forget friction in the last solve; rubs: 1 with friction in this one, else 0. Other solves leave zeros there."""
    for c in range(touch.gaps.size):
        touch.states[c] = touch.slips[c] = touch.sides[c] = touch.works[c] = touch.frozen[c] = 0.0
    touch.how[RUBS] = rubs


@part
def shorten_move(touch, farthest, step, is_newtons):
    """Shorten a step that moves the origin of a link too far; keep the first of Newton's; returns the factor."""
    for i in range(step.size if is_newtons and touch.how[STEPS] == 0.0 else 0):
        touch.tangent[i] = step[i]
    touch.how[STEPS] += 1.0
    if farthest <= LONGEST_MOVE:
        return 1.0
    for i in range(step.size):
        step[i] *= LONGEST_MOVE / farthest
    return LONGEST_MOVE / farthest


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
    """Add one candidate to the energy and to the sums of its link.

    Args:
        x, y: the point of the fields, in the base frame. fixed: True where it does not move with the link.
        gap, way: the fields. rolled: gradient of the way by the turn of the link [mm]. side: of the wall.
        law: of the wall, its stiffness, toe, coefficient of friction and presliding.
    """
    touch, before = chain.touch, chain.before
    multiplier, rigid = touch.multipliers[c], chain.walls.rigid[0] > 0.0
    k = PENALTY * touch.how[STIFFER] if rigid else law[STIFFNESS]
    energy, normal, rate = press(k, 0.0 if rigid else law[TOE], multiplier, gap[0])
    touch.how[ENERGY] += energy
    touch.how[MAGNITUDE] += abs(energy)
    touch.gaps[c], touch.normals[c], touch.slips[c], touch.sides[c] = gap[0], normal, way[0], side
    mu, presliding = law[MU] * touch.how[RUBS], law[PRESLIDING] * touch.how[SOFTER]
    z, sticking = 0.0, 0.0
    if mu > 0.0:
        is_new = before.sides[c] != side  # on the other wall of a lumen, along which it has no way behind it
        state, start = (0.0, way[0]) if is_new else (before.states[c], before.slips[c])
        z = -slide(-state, way[0] - start, presliding)
        sticking = 0.0 if is_new or abs(z) >= 1.0 else 1.0 / presliding
        touch.works[c] = mu * work_per_grip(-state, -z, way[0] - start, presliding)
        touch.how[ENERGY] += touch.frozen[c] * touch.works[c]
        touch.how[MAGNITUDE] += abs(touch.frozen[c] * touch.works[c])
    touch.states[c] = z
    if touch.how[PLACES] > 0.0:
        size = np.sqrt(gap[1] * gap[1] + gap[2] * gap[2])
        nx, ny, away = gap[1] / size, gap[2] / size, rolled if fixed else -(rolled + gap[0])
        touch.places[c, 0], touch.places[c, 1] = x + away * nx, y + away * ny
        for axis in range(2):
            touch.places[c, 2 + axis], touch.places[c, 4 + axis] = gap[1 + axis], way[1 + axis]
    if normal <= 0.0:
        return
    touch.how[PRESSING] += 1.0
    sums, (_, gx, gy, gxx, gxy, gyy) = touch.sums[link - 1], gap
    gm = gy * x - gx * y
    fx, fy, fm = -normal * gx, -normal * gy, -normal * gm
    kxx, kxy, kyy = -normal * gxx, -normal * gxy, -normal * gyy
    ux, uy, um = rate * gx, rate * gy, rate * gm
    if mu > 0.0:
        _, sx, sy, sxx, sxy, syy = way
        friction, across, slip, sm = mu * normal * z, mu * z * rate, mu * normal * sticking, sy * x - sx * y + rolled
        fx, fy, fm = fx + friction * sx, fy + friction * sy, fm + friction * sm
        kxx, kxy, kyy = kxx + friction * sxx, kxy + friction * sxy, kyy + friction * syy
        ux, uy, um = ux - across * sx, uy - across * sy, um - across * sm
        vx, vy, vm = slip * sx, slip * sy, slip * sm
        sums[SUM_S] += vx * sx
        sums[SUM_S + 1] += vx * sy
        sums[SUM_S + 2] += vx * sm
        sums[SUM_S + 3] += vy * sx
        sums[SUM_S + 4] += vy * sy
        sums[SUM_S + 5] += vy * sm
        sums[SUM_S + 6] += vm * sx
        sums[SUM_S + 7] += vm * sy
        sums[SUM_S + 8] += vm * sm
    sums[GX] += fx
    sums[GY] += fy
    sums[GM] += fm
    sums[X_DOT_G] += x * fx + y * fy
    a, b = kxy * x - kxx * y, kyy * x - kxy * y  # K J x
    turning = b * x - a * y
    if fixed:
        a, b, turning = a - fy, b + fx, turning + 2.0 * (fx * x + fy * y)
    sums[SUM_S] += kxx + ux * gx
    sums[SUM_S + 1] += kxy + ux * gy
    sums[SUM_S + 2] += a + ux * gm
    sums[SUM_S + 3] += kxy + uy * gx
    sums[SUM_S + 4] += kyy + uy * gy
    sums[SUM_S + 5] += b + uy * gm
    sums[SUM_S + 6] += a + um * gx
    sums[SUM_S + 7] += b + um * gy
    sums[SUM_S + 8] += turning + um * gm


@part(inline=True)
def _is_far(touch, c, room):
    """True where a candidate cannot press, by a lower bound of its gap, which is kept; there it is left out."""
    if room <= 0.0 or touch.multipliers[c] > 0.0 or touch.frozen[c] > 0.0:
        return False
    touch.gaps[c], touch.normals[c], touch.states[c], touch.works[c] = room, 0.0, 0.0, 0.0
    return True


@part(inline=True)
def _is_clear(touch, c, x, y):
    """True for a point still so near to where it was far from the wall that some of its gap there is left."""
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
    touch.how[ENERGY] = touch.how[MAGNITUDE] = touch.how[PRESSING] = 0.0
    _touch_bars(chain, state, all_gaps, _touch_points(chain, state, all_gaps))
    return touch.how[ENERGY], touch.how[MAGNITUDE]


@part
def _touch_points(chain, state, all_gaps):
    """`touch_walls` of the points; returns the number of their candidates."""
    seen, touch, pose = chain.walls, chain.touch, state.pose
    c, lumens = 0, seen.lumens.shape[0]
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
                _add(chain, c, link, x, y, False, gap, way, radius, 1.0, _law_at(plane, 4, point))
            c += 1
        for w in range(lumens):
            lumen = seen.lumens[w]
            if lumen[2 + STIFFNESS] > 0.0 and link > 0 and (all_gaps or not _is_clear(touch, c, x, y)):
                first, last = int(lumen[0]), int(lumen[1])
                i = int(touch.pieces[c])
                if i < 0:
                    i = int(touch.pieces[c - candidates]) if q > 0 else nearest_piece(seen, first, last, x, y)
                i = piece_near(seen, first, last, max(i, first), x, y)
                touch.pieces[c] = i
                at = point_in_lumen(seen, w, i, x, y)
                room = lumen_room(seen.pieces[i], at) - radius
                if not all_gaps and _is_far(touch, c, room):
                    touch.clear[c, 0], touch.clear[c, 1] = x, y
                    touch.gaps[c] = _LEFT_OF_ROOM * room
                    touch.clear[c, 2] = ((1.0 - _LEFT_OF_ROOM) * room / seen.steepness[w]) ** 2
                else:
                    touch.clear[c, 2] = 0.0
                    gap, way, side = lumen_fields(seen, w, i, at, radius, all_gaps or touch.how[RUBS] > 0.0)
                    gap = gap[0] - radius, gap[1], gap[2], gap[3], gap[4], gap[5]
                    way = way[0] + rolled, way[1], way[2], way[3], way[4], way[5]
                    _add(chain, c, link, x, y, False, gap, way, radius, side, _law_at(lumen, 2, point))
            c += 1
    return c


@part
def _touch_bars(chain, state, all_gaps, c):
    """`touch_walls` of the bars, the first of which has candidate number c."""
    seen, pose = chain.walls, state.pose
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
                law = _law(disc, 3)
                _touch_round(chain, c, link, axis, radius, disc[0], disc[1], disc[2], angle, True, law, all_gaps)
            c += 1
        for w in range(seen.capsules.shape[0]):
            capsule = seen.capsules[w]
            if capsule[6 + STIFFNESS] > 0.0 and link > 0:
                wall = capsule[0], capsule[1], capsule[2], capsule[3], capsule[4]
                other, law = capsule[5], _law(capsule, 6)
                for end in range(2):
                    x, y = capsule[0] + end * capsule[4] * capsule[2], capsule[1] + end * capsule[4] * capsule[3]
                    _touch_round(chain, c + end, link, axis, radius, x, y, other, angle, True, law, all_gaps)
                    x, y = (ax, ay) if end == 0 else (bx, by)
                    _touch_round(chain, c + 2 + end, link, wall, other, x, y, radius, angle, False, law, all_gaps)
            c += 4


@part
def _touch_round(chain, c, link, axis, on_axis, x, y, radius, angle, fixed, law, all_gaps):
    """A disc around (x, y) against an axis that is swept by a disc of radius on_axis.

    fixed: whether the axis is the link's and the disc the wall's, a fixed point as seen from the link; else the other
    way round. angle: of the link in the world.
    """
    ax, ay, ux, uy, length = axis
    half = 0.5 * length
    dx, dy, reach = ax + half * ux - x, ay + half * uy - y, half + on_axis + radius
    if not all_gaps and dx * dx + dy * dy > reach * reach and _is_far(chain.touch, c, 1.0):
        chain.touch.gaps[c] = np.sqrt(dx * dx + dy * dy) - reach
        return
    nearest = nearest_on_segment(x, y, ax, ay, ux, uy, length)
    distance, nx, ny, _, end = nearest
    value = distance - on_axis - radius
    if not all_gaps and _is_far(chain.touch, c, value):
        return
    xx, xy, yy = round_end(distance, nx, ny, end)
    along, sx, sy, sxx, sxy, syy = way_around(nearest, ux, uy, length, on_axis, radius)
    sense = -1.0 if fixed else 1.0
    gap = value, sense * nx, sense * ny, xx, xy, yy
    way = radius * angle - sense * along, -sx, -sy, -sense * sxx, -sense * sxy, -sense * syy
    _add(chain, c, link, x, y, fixed, gap, way, radius, 1.0, law)
