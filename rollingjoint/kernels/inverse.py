"""Inverse statics: the tensions, and the equilibrium under them, that bring links nearest to where they should be.

Gauss-Newton on angles and tensions together. At (phi, tau) with residual r and stiffness H at constant tensions, a
change of tensions dtau moves the equilibrium by dphi = -H^-1 (r + T dtau), T = d residual / d tension. The step
minimises

    |e + E dtau|² + weight |tau + dtau - preferred|²,   low <= tau + dtau <= high,

with e the miss of the links where r is balanced, E its rates. A trust region bounds it, a share of each tension; it is
taken if it lowers that sum plus (lever |H^-1 r|²)², or while the miss stays within a funnel that narrows from step to
step, along which curved valleys are followed. weight is so small that the second term only chooses among tensions with
the same miss; at the end it is left out. Joints that their limits hold are left out of H; where a trial finds other
joints held than its base, the step from the base is tried with those, too.
Source: docs/inverse.md; bounds as in Nocedal and Wright, Numerical Optimization, 2006, ch. 16 (active sets).
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from rollingjoint._numba.borrowed import borrow
from rollingjoint._numba.jit import kernel, part
from rollingjoint._numba.layout import Floats, Integers
from rollingjoint.kernels import formulas
from rollingjoint.kernels.arrays import LARGEST_INPUT, TendonLaw, all_resolvable, resolvable
from rollingjoint.kernels.bounds import mark_free
from rollingjoint.kernels.formulas import evaluate, stiffness
from rollingjoint.kernels.linear import cholesky, cholesky_solve, eliminate
from rollingjoint.kernels.vectors import about, minus

# How a search ended
REACHED, NEAREST, STOPPED, LOST, INVALID = range(5)

MAX_ITERATIONS = 120
_POLISHING = 10  # more of them after the tensions are chosen
_LONGEST = 0.5  # rad, of a step in any joint
_FIRST_TRUST, _LARGEST_TRUST, _SMALLEST_TRUST = 1.0, 8.0, 1e-7
_REACHED = 1e-10  # of the lever: a smaller miss is none
_FUNNEL, _NARROWING = 0.02, 0.25  # a miss that is allowed to grow, of the lever; of its square from step to step
_SETTLED = 1e-8  # rad: angles as near to equilibrium are at it
_NO_GAIN = 1e-7  # of the squared miss: a smaller gain ends the search
_NO_CHANGE = 1e-3  # of the tensions: a smaller change is not worth a step
_WEIGHT = 1e-5  # of the rates at the start, its root: of the second term
_SINGULAR = 1e-13  # of the largest entry: a smaller pivot is none
_DAMPING = 1e-12  # of the mean square of the rates: keeps the step where tensions change nothing


class InverseRows(NamedTuple):
    """B searches, and where their results go."""

    designs: Annotated[Integers, "B"]
    loads: Annotated[Floats, "B", "rows", "columns"]
    low: Annotated[Floats, "B", "m"]  # limits of the tensions, N
    high: Annotated[Floats, "B", "m"]
    preferred: Annotated[Floats, "B", "m"]  # N
    links: Annotated[Integers, "K"]  # that are to be placed
    points: Annotated[Floats, "B", "K", 3]  # their origins; in the plane z is not read, mm
    frames: Annotated[Floats, "B", "K or 0", 9]  # their rotation matrices, row by row; none: free to turn
    weights: Annotated[Floats, 2]  # mm of miss per mm and per rad
    lever: Annotated[Floats, 1]  # length of the mechanism, mm
    angles: Annotated[Floats, "B", "J"]  # start, then result, rad
    tensions: Annotated[Floats, "B", "m"]  # start, then result, N
    lengths: Annotated[Floats, "B", "m"]  # of the tendons at the result, mm
    distance: Annotated[Floats, "B"]  # root of the mean square miss of the links, mm
    iterations: Annotated[Integers, "B"]
    outcome: Annotated[Integers, "B"]


class _TwoPoints(NamedTuple):
    """Two points of a search, the best one and a trial, with what is linear about them."""

    angle: Annotated[Floats, 2, "J"]
    tension: Annotated[Floats, 2, "m"]
    length: Annotated[Floats, 2, "m"]
    free: Annotated[Floats, 2, "J"]  # 0 for a joint that its limit holds
    balance: Annotated[Floats, 2, "J"]  # -H^-1 r
    rates: Annotated[Floats, 2, "J", "m"]  # d angle / d tension
    square: Annotated[Floats, 2, "m", "m"]  # E^T E
    slope: Annotated[Floats, 2, "m"]  # E^T e
    value: Annotated[Floats, 2, 3]  # |e|², |lever H^-1 r|², largest |H^-1 r|


@part
def _new_points(n_joints, n_tendons):
    return _TwoPoints(
        np.zeros((2, n_joints)),
        np.zeros((2, n_tendons)),
        np.zeros((2, n_tendons)),
        np.zeros((2, n_joints)),
        np.zeros((2, n_joints)),
        np.zeros((2, n_joints, n_tendons)),
        np.zeros((2, n_tendons, n_tendons)),
        np.zeros((2, n_tendons)),
        np.zeros((2, 3)),
    )


@kernel(nogil=True, title="the inverse")
def reach_rows(chain, rows, first, last):
    """Search from the starts of rows first to last - 1; overwrites angles and tensions."""
    chain, rows = borrow(chain), borrow(rows)
    n, m = rows.angles.shape[1], rows.tensions.shape[1]
    state = formulas.new_state(chain, n, m)
    model = _new_points(n, m)
    space = np.zeros((n, n)), np.zeros((n, n + 1 + m)), np.ones(n, np.bool_), np.zeros((4, m, m)), np.zeros((8, m))
    for row in range(first, last):
        outcome, iterations, distance = _search(chain, rows, row, state, model, space)
        rows.outcome[row], rows.iterations[row], rows.distance[row] = outcome, iterations, distance


class Starts(NamedTuple):
    """N equilibria to start from."""

    points: Annotated[Floats, "N", "coordinates"]  # of the links that are to be placed, weighted, mm
    angles: Annotated[Floats, "N", "J"]
    tensions: Annotated[Floats, "N", "m"]


@kernel(nogil=True, title="the inverse")
def take_nearest(starts, targets, tried, angles, tensions, first, last):
    """Fill angles (B, J) and tensions (B, m) with the start nearest to each target that is farther off than `tried`.

    targets: (B, coordinates), as Starts.points. tried: squared distance of the last start, -1 of none, (B,);
    overwritten, by infinity where there is no further one.
    """
    for row in range(first, last):
        best, least = -1, np.inf
        for place in range(starts.points.shape[0]):
            square = 0.0
            for c in range(starts.points.shape[1]):
                square += (starts.points[place, c] - targets[row, c]) ** 2
            if tried[row] < square < least:
                best, least = place, square
        tried[row] = least
        if best >= 0:
            for i in range(angles.shape[1]):
                angles[row, i] = starts.angles[best, i]
            for j in range(tensions.shape[1]):
                tensions[row, j] = starts.tensions[best, j]


@part
def _is_valid(rows, row):
    """True for finite numbers, and limits in order that do not push."""
    valid = all_resolvable(rows.angles[row]) and all_resolvable(rows.tensions[row]) and rows.lever[0] > 0.0
    for line in range(rows.loads.shape[1]):
        valid = valid and all_resolvable(rows.loads[row, line])
    for j in range(rows.low.shape[1]):
        low, high = rows.low[row, j], rows.high[row, j]
        valid = valid and 0.0 <= low <= min(high, LARGEST_INPUT) and resolvable(rows.preferred[row, j])
    for k in range(rows.links.size):
        valid = valid and all_resolvable(rows.points[row, k])
    for k in range(rows.frames.shape[1]):
        valid = valid and all_resolvable(rows.frames[row, k])
    return valid


@part
def _search(chains, rows, row, state, model, space):
    """The search of one row; returns (outcome, iterations, distance)."""
    model, state = borrow(model), borrow(state)
    n, m = rows.angles.shape[1], rows.tensions.shape[1]
    if not _is_valid(rows, row):
        return INVALID, 0, 0.0
    chain, low, high = formulas.design(chains, rows.designs[row]), rows.low[row], rows.high[row]
    preferred, move = space[4][1], space[4][2]
    most = 0.0
    for i in range(n):
        model.angle[0, i] = min(max(rows.angles[row, i], chain.joints[i, 0]), chain.joints[i, 1])
    for j in range(m):
        model.tension[0, j] = min(max(rows.tensions[row, j], low[j]), high[j])
        most, preferred[j] = max(most, model.tension[0, j], low[j]), rows.preferred[row, j]
    if most == 0.0:
        most = 1.0
        for j in range(m):
            model.tension[0, j] = min(1.0, high[j])
    lever, base, trust, ended = rows.lever[0], 0, _FIRST_TRUST, -1
    if not _fill(chain, rows, row, 0, False, state, model, space):
        return LOST, 0, 0.0
    weight = 0.0
    for j in range(m):
        weight += _WEIGHT**2 / m * model.square[0, j, j]
    iterations, polishing, funnel, forced = 1, 0, (_FUNNEL * lever) ** 2, False
    value = _value(model, base, preferred, weight)
    miss, at_rest = model.value[base, 0], model.value[base, 2] <= _SETTLED
    while iterations < MAX_ITERATIONS + polishing:
        gain = value - _step(model, base, low, high, preferred, weight, trust, most, move, space)
        enough = _NO_GAIN * miss + (weight * (_NO_CHANGE * most) ** 2 if polishing == 0 else 0.0)
        at_goal = miss <= (_REACHED * lever) ** 2
        over = at_rest and (gain <= enough or (at_goal and polishing > 0))
        if not forced and (over or trust < _SMALLEST_TRUST):
            if polishing > 0 or at_goal:
                ended = REACHED if at_goal else NEAREST
                break
            polishing, trust, weight = _POLISHING, max(trust, 0.01), 0.0
            for j in range(m):
                preferred[j] = model.tension[base, j]
            value = _value(model, base, preferred, weight)
            continue
        trial = 1 - base
        share = _advance(chain, model, base, trial, move)
        iterations += 1
        fits = gain > 0.0 and _fill(chain, rows, row, trial, False, state, model, space)
        new_value = _value(model, trial, preferred, weight)
        lower = new_value <= value - 1e-4 * share * gain
        if fits and (lower or (not forced and _miss(model, trial) <= funnel)):
            if not lower:
                trust *= 0.5
            elif new_value <= value - 0.5 * share * gain:
                trust = min((4.0 if forced else 2.0) * trust, _LARGEST_TRUST)
            base, forced = trial, False
            if polishing > 0:
                for j in range(m):
                    preferred[j] = model.tension[base, j]
            value = _value(model, base, preferred, weight)
            miss, at_rest = model.value[base, 0], model.value[base, 2] <= _SETTLED
        else:
            trust *= 0.25 if forced or not fits else 0.5
            other = fits and not forced and _takes_limits(model, base, trial)
            if other or forced:
                forced = other and _fill(chain, rows, row, base, True, state, model, space)
                if not forced:
                    _fill(chain, rows, row, base, False, state, model, space)
        funnel *= _NARROWING
    for i in range(n):
        rows.angles[row, i] = model.angle[base, i]
    for j in range(m):
        rows.tensions[row, j], rows.lengths[row, j] = model.tension[base, j], model.length[base, j]
    distance = math.sqrt(miss / rows.links.size)
    return (STOPPED if ended < 0 else ended), iterations, distance


@part
def _takes_limits(model, base, trial):
    """Have the joints of the base held at their limits that are held at the trial; whether that changes any."""
    changes = False
    for i in range(model.free.shape[1]):
        changes = changes or model.free[base, i] != model.free[trial, i]
        model.free[base, i] = model.free[trial, i]
    return changes


@part
def _miss(model, which):
    """The first terms of the sum at a point."""
    return model.value[which, 0] + model.value[which, 1]


@part
def _value(model, which, preferred, weight):
    """The sum that is minimised, at a point."""
    value = _miss(model, which)
    for j in range(preferred.size):
        value += weight * (model.tension[which, j] - preferred[j]) ** 2
    return value


@part
def _advance(chain, model, base, trial, move):
    """Fill the trial point, a change of the tensions from the base or a part of it; returns its share."""
    n, m = model.angle.shape[1], move.size
    longest = 0.0
    for i in range(n):
        turn = model.balance[base, i]
        for j in range(m):
            turn += model.rates[base, i, j] * move[j]
        model.angle[trial, i] = turn
        longest = max(longest, abs(turn))
    share = min(1.0, _LONGEST / longest) if longest > 0.0 else 1.0
    for i in range(n):
        angle = model.angle[base, i] + share * model.angle[trial, i]
        model.angle[trial, i] = min(max(angle, chain.joints[i, 0]), chain.joints[i, 1])
    for j in range(m):
        model.tension[trial, j] = model.tension[base, j] + share * move[j]
    return share


@part
def _fill(chain, rows, row, which, forced, state, model, space):
    """Fill what is linear about a point; False where H is singular. forced: joints are held as it says already."""
    H, system, free = space[0], space[1], space[2]
    angle, tension, loads = state.angle, model.tension[which], rows.loads[row]
    n, m = angle.size, tension.size
    for i in range(n):
        angle[i] = model.angle[which, i]
    evaluate(chain, TendonLaw(state.length, space[4][7], tension, tension), loads, state)
    for j in range(m):
        state.elastic[j], model.length[which, j] = 0.0, state.length[j]
    stiffness(chain, loads, state, H)
    mark_free(chain, state, 0.0, angle, free)
    for i in range(n):
        free[i] = model.free[which, i] > 0.0 if forced else free[i]
        model.free[which, i] = 1.0 if free[i] else 0.0
    for i in range(n):
        for k in range(n):
            system[i, k] = H[i, k] if free[i] and free[k] else (1.0 if i == k else 0.0)
        system[i, n] = -state.residual[i] if free[i] else 0.0
        for j in range(m):
            crosses = free[i] and i < chain.tendon_joints[j]
            system[i, n + 1 + j] = -formulas.torque(state, i, j) if crosses else 0.0
    largest = 0.0
    for i in range(n):
        for k in range(n):
            largest = max(largest, abs(system[i, k]))
    if not eliminate(system, _SINGULAR * largest):
        return False
    lever, off, worst = rows.lever[0], 0.0, 0.0
    for i in range(n):
        model.balance[which, i] = system[i, n]
        off += system[i, n] ** 2
        worst = max(worst, abs(system[i, n]))
        for j in range(m):
            model.rates[which, i, j] = system[i, n + 1 + j]
    model.value[which, 1], model.value[which, 2] = (lever * off) ** 2, worst
    _fill_miss(rows, row, which, state, model, space[4][3], space[4][4], space[4][5])
    return resolvable(model.value[which, 0]) and resolvable(off)


@part
def _fill_miss(rows, row, which, state, model, first, second, third):
    """Fill E^T E, E^T e and |e|² of a point. The last three arguments are scratch space, (m,) each."""
    m = first.size
    square, slope = model.square[which], model.slope[which]
    for j in range(m):
        slope[j] = 0.0
        for k in range(m):
            square[j, k] = 0.0
    total = 0.0
    scale = rows.weights[0]
    for place in range(rows.links.size):
        link = rows.links[place]
        at = formulas.origin(state, link)
        miss_x = at[0] - rows.points[row, place, 0]
        miss_y = at[1] - rows.points[row, place, 1]
        miss_z = at[2] - rows.points[row, place, 2]
        for j in range(m):
            first[j], second[j], third[j] = 0.0, 0.0, 0.0
        for i in range(link):
            x, y, z = about(formulas.axis(state, i), minus(at, formulas.pivot(state, i)))
            turn = model.balance[which, i]
            miss_x, miss_y, miss_z = miss_x + x * turn, miss_y + y * turn, miss_z + z * turn
            for j in range(m):
                rate = model.rates[which, i, j]
                first[j] += x * rate
                second[j] += y * rate
                third[j] += z * rate
        total += _add(square, slope, first, miss_x, scale) + _add(square, slope, second, miss_y, scale)
        total += _add(square, slope, third, miss_z, scale)
        if rows.frames.shape[1] > 0:
            total += _add_turn(rows, row, which, state, model, place, first, second, third)
    model.value[which, 0] = total


@part
def _add(square, slope, rates, miss, scale):
    """Add one coordinate to E^T E and E^T e; returns its square."""
    if scale == 0.0:
        return 0.0
    for j in range(rates.size):
        slope[j] += scale * scale * rates[j] * miss
        for k in range(j + 1):
            square[j, k] += scale * scale * rates[j] * rates[k]
    return (scale * miss) ** 2


@part
def _add_turn(rows, row, which, state, model, place, first, second, third):
    """Add the turn by which a link misses its frame; returns its weighted square."""
    link, m, scale = rows.links[place], first.size, rows.weights[1]
    off = _turn_from(formulas.frame(state, link), rows.frames[row, place])
    miss_x, miss_y, miss_z = off
    for j in range(m):
        first[j], second[j], third[j] = 0.0, 0.0, 0.0
    for i in range(link):
        x, y, z = formulas.axis(state, i)
        turn = model.balance[which, i]
        miss_x, miss_y, miss_z = miss_x + x * turn, miss_y + y * turn, miss_z + z * turn
        for j in range(m):
            rate = model.rates[which, i, j]
            first[j] += x * rate
            second[j] += y * rate
            third[j] += z * rate
    square, slope = model.square[which], model.slope[which]
    total = _add(square, slope, first, miss_x, scale) + _add(square, slope, second, miss_y, scale)
    return total + _add(square, slope, third, miss_z, scale)


@part
def _turn_from(frame, goal):
    """The vector [rad] that turns the goal into a frame, both rotation matrices row by row."""
    a, b, c, d, e, f, g, h, i = frame
    x = 0.5 * (g * goal[3] + h * goal[4] + i * goal[5] - d * goal[6] - e * goal[7] - f * goal[8])
    y = 0.5 * (a * goal[6] + b * goal[7] + c * goal[8] - g * goal[0] - h * goal[1] - i * goal[2])
    z = 0.5 * (d * goal[0] + e * goal[1] + f * goal[2] - a * goal[3] - b * goal[4] - c * goal[5])
    trace = a * goal[0] + b * goal[1] + c * goal[2] + d * goal[3] + e * goal[4] + f * goal[5]
    trace += g * goal[6] + h * goal[7] + i * goal[8]
    sine = math.sqrt(x * x + y * y + z * z)
    scale = math.atan2(sine, 0.5 * (trace - 1.0)) / sine if sine > 1e-9 else 1.0
    return scale * x, scale * y, scale * z


@part
def _step(model, base, low, high, preferred, weight, trust, most, move, space):
    """Fill the change of the tensions; returns the sum that it would leave."""
    m = move.size
    square, slope, hessian = model.square[base], model.slope[base], space[3][0]
    lowest, highest, gradient = space[4][3], space[4][4], space[4][5]
    trace = 0.0
    for j in range(m):
        trace += square[j, j]
    for j in range(m):
        tension = model.tension[base, j]
        reach = trust * max(tension, 0.1 * most)
        lowest[j] = max(low[j] - tension, -reach)
        highest[j] = min(high[j] - tension, reach)
        gradient[j] = slope[j] + weight * (tension - preferred[j])
        for k in range(j + 1):
            hessian[j, k] = hessian[k, j] = square[j, k]
        hessian[j, j] += weight + _DAMPING * trace / m
    minimise_in_box(hessian, gradient, lowest, highest, move, space[3][1], space[3][2], space[4][6], space[2])
    change = 0.0
    for j in range(m):
        change += 2.0 * gradient[j] * move[j]
        for k in range(m):
            change += move[j] * hessian[j, k] * move[k]
    return model.value[base, 0] + change + _offset(model, base, preferred, weight)


@part
def _offset(model, base, preferred, weight):
    """The second term at a point."""
    offset = 0.0
    for j in range(preferred.size):
        offset += weight * (model.tension[base, j] - preferred[j]) ** 2
    return offset


@part
def minimise_in_box(hessian, gradient, low, high, x, L, flags, way, unused):
    """Fill x with the minimum of x·hessian·x / 2 + gradient·x between low <= 0 and high >= 0, entry by entry.

    From 0 straight to the minimum over the free entries, as far as the first bound; that entry is held there, until the
    minimum over the others would let it go. hessian: positive definite up to rounding. L, flags, way: scratch space.
    """
    m = x.size
    free, r = np.ones(m, np.bool_), flags[0]
    for j in range(m):
        x[j] = 0.0
    released = True
    for _ in range(4 * m + 4):
        for j in range(m):
            r[j] = gradient[j]
            for k in range(m):
                r[j] += hessian[j, k] * x[k]
        if released:
            for j in range(m):
                free[j] = not ((x[j] <= low[j] and r[j] > 0.0) or (x[j] >= high[j] and r[j] < 0.0))
        if cholesky(hessian, free, 0.0, L) < 0.0:
            break
        cholesky_solve(L, free, r, way)
        share, stop = 1.0, -1
        for j in range(m):
            if free[j] and way[j] != 0.0:
                room = (high[j] - x[j]) / way[j] if way[j] > 0.0 else (low[j] - x[j]) / way[j]
                if room < share:
                    share, stop = max(room, 0.0), j
        for j in range(m):
            if free[j]:
                x[j] = min(max(x[j] + share * way[j], low[j]), high[j])
        released = stop < 0
        if stop >= 0:
            x[stop] = high[stop] if way[stop] > 0.0 else low[stop]
            free[stop] = False
        else:
            done = True
            for j in range(m):
                slope = gradient[j]
                for k in range(m):
                    slope += hessian[j, k] * x[k]
                outward = (x[j] <= low[j] and slope > 0.0) or (x[j] >= high[j] and slope < 0.0)
                done = done and (free[j] or outward or low[j] == high[j])
            if done:
                break
