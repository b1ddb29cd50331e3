"""Inverse statics: the tensions, and the equilibrium under them, that bring links nearest to where they should be.

Gauss-Newton on angles and tensions together. At (phi, tau) with residual r and stiffness H at constant tensions, a
change of tensions dtau moves the equilibrium by dphi = -H^-1 (r + T dtau), T = d residual / d tension. The step
minimises

    |e + E dtau|² + weight |tau + dtau - preferred|²,   low <= tau + dtau <= high,

with e the miss of the links where r is balanced, E its rates. A trust region bounds it, a share of each tension; it is
taken if it lowers that sum plus (size |H^-1 r|²)², or while the miss stays within a funnel that narrows from step to
step, along which curved valleys are followed. weight is so small that the second term only chooses among tensions with
the same miss; at the end it is left out. Joints that their limits hold are left out of H; where a trial finds other
joints held than its base, the step from the base is tried with those, too.
Source: docs/inverse.md; bounds as in Nocedal and Wright, Numerical Optimization, 2006, ch. 16 (active sets).
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rollingjoint._numba.borrowed import borrow
from rollingjoint._numba.jit import kernel, part
from rollingjoint._numba.layout import Floats, Integers
from rollingjoint.kernels import bounds, formulas
from rollingjoint.kernels.arrays import LARGEST_INPUT, MAX_STEP, TendonLaw, all_resolvable, resolvable
from rollingjoint.kernels.formulas import evaluate, stiffness
from rollingjoint.kernels.linear import cholesky, cholesky_solve, eliminate, largest
from rollingjoint.kernels.vectors import about, in_space, minus, plus, times

# How a search ended
REACHED, NEAREST, STOPPED, LOST, INVALID = range(5)

MAX_ITERATIONS = 120
_POLISHING = 10  # more of them after the tensions are chosen
_FIRST_TRUST, _LARGEST_TRUST, _SMALLEST_TRUST = 1.0, 8.0, 1e-7
_REACHED = 1e-10  # of the size: a smaller miss is none
_FUNNEL, _NARROWING = 0.02, 0.25  # a miss that is allowed to grow, of the size; of its square from step to step
_SETTLED = 1e-8  # rad: angles as near to equilibrium are at it
_NO_GAIN = 1e-7  # of the squared miss: a smaller gain ends the search
_NO_CHANGE = 1e-3  # of the tensions: a smaller change is not worth a step
_WEIGHT = 1e-4  # of the rates at the start, its root: of the second term
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
    lever: Annotated[Floats, 1]  # mm of miss per rad
    size: Annotated[Floats, 1]  # length of the mechanism, mm
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
    free: Annotated[NDArray[np.bool_], 2, "J"]  # False for a joint that its limit holds
    balance: Annotated[Floats, 2, "J"]  # -H^-1 r
    rates: Annotated[Floats, 2, "J", "m"]  # d angle / d tension
    square: Annotated[Floats, 2, "m", "m"]  # E^T E
    slope: Annotated[Floats, 2, "m"]  # E^T e
    value: Annotated[Floats, 2, 3]  # |e|², (size |H^-1 r|²)², largest |H^-1 r|


@part
def _new_points(n_joints, n_tendons):
    return _TwoPoints(
        np.zeros((2, n_joints)),
        np.zeros((2, n_tendons)),
        np.zeros((2, n_tendons)),
        np.zeros((2, n_joints), np.bool_),
        np.zeros((2, n_joints)),
        np.zeros((2, n_joints, n_tendons)),
        np.zeros((2, n_tendons, n_tendons)),
        np.zeros((2, n_tendons)),
        np.zeros((2, 3)),
    )


class _SearchScratch(NamedTuple):
    """Scratch space of a search."""

    H: Annotated[Floats, "J", "J"]
    system: Annotated[Floats, "J", "J + 1 + m"]  # H and its right sides, -r and -T
    slack: Annotated[Floats, "m"]  # 0: stiffnesses of tendons under given tensions
    rates: Annotated[Floats, 3, "m"]  # of three coordinates of a miss
    change: Annotated[Floats, "m"]  # of the tensions in a step
    lowest: Annotated[Floats, "m"]  # and its limits
    highest: Annotated[Floats, "m"]
    hessian: Annotated[Floats, "m", "m"]
    gradient: Annotated[Floats, "m"]
    L: Annotated[Floats, "m", "m"]
    slope: Annotated[Floats, "m"]
    way: Annotated[Floats, "m"]
    unbound: Annotated[NDArray[np.bool_], "m"]


@part
def _new_scratch(n_joints, n_tendons):
    return _SearchScratch(
        np.zeros((n_joints, n_joints)),
        np.zeros((n_joints, n_joints + 1 + n_tendons)),
        np.zeros(n_tendons),
        np.zeros((3, n_tendons)),
        np.zeros(n_tendons),
        np.zeros(n_tendons),
        np.zeros(n_tendons),
        np.zeros((n_tendons, n_tendons)),
        np.zeros(n_tendons),
        np.zeros((n_tendons, n_tendons)),
        np.zeros(n_tendons),
        np.zeros(n_tendons),
        np.zeros(n_tendons, np.bool_),
    )


@kernel(nogil=True, title="the inverse")
def reach_rows(chain, rows, first, last):
    """Search from the starts of rows first to last - 1; overwrites angles and tensions."""
    chain, rows = borrow(chain), borrow(rows)
    n, m = rows.angles.shape[1], rows.tensions.shape[1]
    state = formulas.new_state(chain, n, m)
    model, scratch = _new_points(n, m), _new_scratch(n, m)
    for row in range(first, last):
        outcome, iterations, distance = _search(chain, rows, row, state, model, scratch)
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
    valid = all_resolvable(rows.angles[row]) and all_resolvable(rows.tensions[row]) and rows.size[0] > 0.0
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
def _search(chains, rows, row, state, model, scratch):
    """The search of one row; returns (outcome, iterations, distance)."""
    model, state, scratch = borrow(model), borrow(state), borrow(scratch)
    n, m = rows.angles.shape[1], rows.tensions.shape[1]
    if not _is_valid(rows, row):
        return INVALID, 0, 0.0
    chain, low, high = formulas.design(chains, rows.designs[row]), rows.low[row], rows.high[row]
    preferred, most = rows.preferred[row], 0.0
    bounds.begin(chain, rows.angles[row], model.angle[0])
    for j in range(m):
        model.tension[0, j] = min(max(rows.tensions[row, j], low[j]), high[j])
        most = max(most, model.tension[0, j])
    if most == 0.0:
        most = 1.0
        for j in range(m):
            model.tension[0, j] = min(1.0, high[j])
    size, base, trust, ended = rows.size[0], 0, _FIRST_TRUST, STOPPED
    if not _fill(chain, rows, row, 0, False, state, model, scratch):
        return LOST, 0, 0.0
    weight = 0.0
    for j in range(m):
        weight += _WEIGHT**2 / m * model.square[0, j, j]
    iterations, polishing, funnel, forced = 1, 0, (_FUNNEL * size) ** 2, False
    value = _value(model, base, preferred, weight)
    miss, at_rest = model.value[base, 0], model.value[base, 2] <= _SETTLED
    while iterations < MAX_ITERATIONS + polishing:
        gain = value - _step(model, base, low, high, preferred, weight, trust, most, scratch)
        enough = _NO_GAIN * miss + weight * (_NO_CHANGE * most) ** 2
        at_goal = miss <= (_REACHED * size) ** 2
        over = at_rest and (gain <= enough or (at_goal and polishing > 0))
        if not forced and (over or trust < _SMALLEST_TRUST):
            if polishing > 0 or at_goal:
                ended = REACHED if at_goal else NEAREST
                break
            polishing, trust, weight = _POLISHING, max(trust, 0.01), 0.0
            value = _value(model, base, preferred, weight)
            continue
        trial = 1 - base
        share = _advance(chain, model, base, trial, scratch.change)
        iterations += 1
        fits = gain > 0.0 and _fill(chain, rows, row, trial, False, state, model, scratch)
        new_value = _value(model, trial, preferred, weight)
        lower = new_value <= value - 1e-4 * share * gain
        if fits and (lower or (not forced and _miss(model, trial) <= funnel)):
            if not lower:
                trust *= 0.5
            elif new_value <= value - 0.5 * share * gain:
                trust = min((4.0 if forced else 2.0) * trust, _LARGEST_TRUST)
            base, forced, value = trial, False, new_value
            miss, at_rest = model.value[base, 0], model.value[base, 2] <= _SETTLED
        else:
            trust *= 0.25 if forced or not fits else 0.5
            other = fits and not forced and _takes_limits(model, base, trial)
            if other or forced:
                forced = other and _fill(chain, rows, row, base, True, state, model, scratch)
                if not forced:
                    _fill(chain, rows, row, base, False, state, model, scratch)
        funnel *= _NARROWING
    for i in range(n):
        rows.angles[row, i] = model.angle[base, i]
    for j in range(m):
        rows.tensions[row, j], rows.lengths[row, j] = model.tension[base, j], model.length[base, j]
    return ended, iterations, math.sqrt(miss / rows.links.size)


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
def _offset(model, which, preferred, weight):
    """The second term at a point."""
    offset = 0.0
    for j in range(preferred.size):
        offset += weight * (model.tension[which, j] - preferred[j]) ** 2
    return offset


@part
def _value(model, which, preferred, weight):
    """The sum that is minimised, at a point."""
    return _miss(model, which) + _offset(model, which, preferred, weight)


@part
def _advance(chain, model, base, trial, change):
    """Fill the trial point, a change of the tensions from the base or a part of it; returns its share."""
    angle, tension = model.angle[trial], model.tension[trial]
    longest = 0.0
    for i in range(angle.size):
        angle[i] = model.balance[base, i]
        for j in range(change.size):
            angle[i] += model.rates[base, i, j] * change[j]
        longest = max(longest, abs(angle[i]))
    share = min(1.0, MAX_STEP / longest) if longest > 0.0 else 1.0
    bounds.move(chain, model.angle[base], angle, share, angle)
    for j in range(change.size):
        tension[j] = model.tension[base, j] + share * change[j]
    return share


@part
def _fill(chain, rows, row, which, forced, state, model, scratch):
    """Fill what is linear about a point; False where H is singular. forced: joints are held as it says already."""
    H, system, free = scratch.H, scratch.system, model.free[which]
    angle, tension, loads = state.angle, model.tension[which], rows.loads[row]
    n, m = angle.size, tension.size
    for i in range(n):
        angle[i] = model.angle[which, i]
    evaluate(chain, TendonLaw(state.length, scratch.slack, tension, tension), loads, state)
    for j in range(m):
        state.elastic[j], model.length[which, j] = 0.0, state.length[j]
    stiffness(chain, loads, state, H)
    if not forced:
        bounds.mark_free(chain, state, 0.0, angle, free)
    for i in range(n):
        for k in range(n):
            system[i, k] = H[i, k] if free[i] and free[k] else (1.0 if i == k else 0.0)
        system[i, n] = -state.residual[i] if free[i] else 0.0
        for j in range(m):
            crosses = free[i] and i < chain.tendon_joints[j]
            system[i, n + 1 + j] = -formulas.torque(state, i, j) if crosses else 0.0
    if not eliminate(system, _SINGULAR * largest(H, free)):
        return False
    off, worst = 0.0, 0.0
    for i in range(n):
        model.balance[which, i] = system[i, n]
        off += system[i, n] ** 2
        worst = max(worst, abs(system[i, n]))
        for j in range(m):
            model.rates[which, i, j] = system[i, n + 1 + j]
    model.value[which, 1], model.value[which, 2] = (rows.size[0] * off) ** 2, worst
    _fill_miss(rows, row, which, state, model, scratch.rates)
    return resolvable(model.value[which, 0]) and resolvable(off)


@part
def _fill_miss(rows, row, which, state, model, rates):
    """Fill E^T E, E^T e and |e|² of a point. rates: scratch space."""
    square, slope, total = model.square[which], model.slope[which], 0.0
    for j in range(slope.size):
        slope[j] = 0.0
        for k in range(slope.size):
            square[j, k] = 0.0
    for place in range(rows.links.size):
        link = rows.links[place]
        at = formulas.origin(state, link)
        miss = minus(at, in_space(rows.points[row], place, 0))
        _clear(rates)
        for i in range(link):
            way = about(formulas.axis(state, i), minus(at, formulas.pivot(state, i)))
            miss = _take_turn(model, which, i, way, miss, rates)
        total += _add(square, slope, rates, miss, 1.0)
        if rows.frames.shape[1] > 0:
            _clear(rates)
            miss = _turn_from(formulas.frame(state, link), rows.frames[row, place])
            for i in range(link):
                miss = _take_turn(model, which, i, formulas.axis(state, i), miss, rates)
            total += _add(square, slope, rates, miss, rows.lever[0])
    model.value[which, 0] = total


@part
def _clear(rates):
    for c in range(3):
        for j in range(rates.shape[1]):
            rates[c, j] = 0.0


@part
def _take_turn(model, which, i, way, miss, rates):
    """A miss, and its rates, with what joint i adds, which moves it along `way` per rad."""
    x, y, z = way
    for j in range(rates.shape[1]):
        rate = model.rates[which, i, j]
        rates[0, j] += x * rate
        rates[1, j] += y * rate
        rates[2, j] += z * rate
    return plus(miss, times(way, model.balance[which, i]))


@part
def _add(square, slope, rates, miss, scale):
    """Add three coordinates to E^T E and E^T e; returns their square."""
    total = 0.0
    for c in range(3):
        for j in range(slope.size):
            slope[j] += scale * scale * rates[c, j] * miss[c]
            for k in range(j + 1):
                square[j, k] += scale * scale * rates[c, j] * rates[c, k]
        total += (scale * miss[c]) ** 2
    return total


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
def _step(model, base, low, high, preferred, weight, trust, most, scratch):
    """Fill the change of the tensions; returns the sum that it would leave."""
    square, hessian, gradient, change = model.square[base], scratch.hessian, scratch.gradient, scratch.change
    m, trace = change.size, 0.0
    for j in range(m):
        trace += square[j, j]
    for j in range(m):
        tension = model.tension[base, j]
        farthest = trust * max(tension, 0.1 * most)
        scratch.lowest[j] = max(low[j] - tension, -farthest)
        scratch.highest[j] = min(high[j] - tension, farthest)
        gradient[j] = model.slope[base, j] + weight * (tension - preferred[j])
        for k in range(j + 1):
            hessian[j, k] = hessian[k, j] = square[j, k]
        hessian[j, j] += weight + _DAMPING * trace / m
    _minimise_in_box(scratch)
    total = 0.0
    for j in range(m):
        total += 2.0 * gradient[j] * change[j]
        for k in range(m):
            total += change[j] * hessian[j, k] * change[k]
    return model.value[base, 0] + total + _offset(model, base, preferred, weight)


@part
def _minimise_in_box(scratch):
    """Fill the change x with the minimum of x·hessian·x / 2 + gradient·x between lowest <= 0 and highest >= 0.

    From 0 straight to the minimum over the entries without bound, as far as the first bound; that entry is held there,
    until the minimum over the others would let it go. hessian: positive definite up to rounding.
    """
    x, low, high, free, slope, way = (
        scratch.change, scratch.lowest, scratch.highest, scratch.unbound, scratch.slope, scratch.way,
    )  # fmt: skip
    m = x.size
    for j in range(m):
        x[j], free[j] = 0.0, False
    at_minimum = True  # over the free entries
    for _ in range(4 * m + 4):
        for j in range(m):
            slope[j] = scratch.gradient[j]
            for k in range(m):
                slope[j] += scratch.hessian[j, k] * x[k]
        if at_minimum:
            settled = True
            for j in range(m):
                held = (x[j] <= low[j] and slope[j] > 0.0) or (x[j] >= high[j] and slope[j] < 0.0)
                settled = settled and (free[j] or held)
                free[j] = not held
            if settled:
                break
        if cholesky(scratch.hessian, free, 0.0, scratch.L) < 0.0:
            break
        cholesky_solve(scratch.L, free, slope, way)
        share, stop = 1.0, -1
        for j in range(m):
            if free[j] and way[j] != 0.0:
                room = (high[j] - x[j]) / way[j] if way[j] > 0.0 else (low[j] - x[j]) / way[j]
                if room < share:
                    share, stop = max(room, 0.0), j
        for j in range(m):
            if free[j]:
                x[j] = min(max(x[j] + share * way[j], low[j]), high[j])
        at_minimum = stop < 0
        if stop >= 0:
            x[stop] = high[stop] if way[stop] > 0.0 else low[stop]
            free[stop] = False
