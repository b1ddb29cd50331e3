"""Inverse statics: the tensions, and the equilibrium under them, that bring links nearest to where they should be.

Gauss-Newton on angles and tensions together. At (phi, tau) with residual r and stiffness H at constant tensions, a
change of tensions dtau moves the equilibrium by dphi = -H^-1 (r + T dtau), T = d residual / d tension. The step
minimises

    |e + E dtau|² + weight |tau + dtau - preferred|²,   low <= tau + dtau <= high,

with e the miss of the links where r is balanced, E its rates. A trust region bounds it, a share of each tension. weight
is so small that the second term only chooses among tensions with the same miss; at the end it is left out. A step is
taken if it lowers that sum plus (size |H^-1 r|²)². Tensions with the same miss lie on curved surfaces, so that long
steps along them miss by what the next step corrects (the Maratos effect): within a corridor a step is also taken if it
lowers |tau + dtau_0 - preferred|², where dtau_0 is the least change that leaves no miss in the linear model. The last
step is so short that what is linear says where it ends, without another evaluation. Joints that their limits hold are
left out of H; where a trial finds other joints held than its base, the step from the base is tried with those, too.
At a kink of the surfaces the linear model may promise a miss that no equilibrium has: a search whose steps become
short off equilibrium goes to the equilibrium first.
Source: docs/inverse.md; Nocedal and Wright, Numerical Optimization, 2006, ch. 16 (active sets), 15.6 (Maratos effect).
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
_REACHED = 2e-11  # of the size: a smaller miss is none
_FUNNEL, _NARROWING = 0.02, 0.25  # a miss at which tensions may improve, of the size; of its square from step to step
_CORRIDOR = 0.01  # of the size: the funnel does not become narrower
_CLOSE = 1e-4  # of the size: so near the target the tensions may be settled
_LAST = 1e-11  # rad: product of a step's turns and its shares of the tensions that is below rounding of the solver
_CROSSINGS = 8  # steps that are taken for the tensions alone though other joints are held after them
_DETOURS = 8  # all steps that are taken for the tensions alone
_REJECTED = 48  # trials after which a search gives up
_RESTORED = 0.01  # trust below which a search that is off equilibrium goes there
_SETTLED = 1e-8  # rad: angles as near to equilibrium are at it
_NO_GAIN = 1e-7  # of the squared miss: a smaller gain ends the search
_NO_CHANGE = 2e-3  # of the tensions: a smaller change is not worth a step
_SMALL_TRUST = 5e-3  # steps that short are not worth their while for the tensions alone
_WEIGHT = 3e-6  # of the rates at the start, its root: of the second term
_SINGULAR = 1e-13  # of the largest entry: a smaller pivot is none
_DAMPING = 1e-12  # of the largest entry, where tensions change nothing: keeps the step


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
    lengthening: Annotated[Floats, 2, "J", "m"]  # d length / d angle, 0 for a joint that is held
    value: Annotated[Floats, 2, 4]  # |e|², (size |H^-1 r|²)², largest |H^-1 r|, |tau + dtau_0 - preferred|²


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
        np.zeros((2, n_joints, n_tendons)),
        np.zeros((2, 4)),
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
    """N equilibria to start from, in the order of one coordinate."""

    order: Annotated[Integers, 1]  # which coordinate
    points: Annotated[Floats, "N", "coordinates"]  # of the links that are to be placed, weighted, mm
    angles: Annotated[Floats, "N", "J"]
    tensions: Annotated[Floats, "N", "m"]


@kernel(nogil=True, title="the inverse")
def take_nearest(starts, targets, tried, angles, tensions, first, last):
    """Fill angles (B, J) and tensions (B, m) with the start nearest to each target that is farther off than `tried`.

    targets: (B, coordinates), as Starts.points. tried: squared distance of the last start, -1 of none, (B,);
    overwritten, by infinity where there is no further one.
    """
    count, along = starts.points.shape[0], starts.order[0]
    for row in range(first, last):
        best, least, low, high = -1, np.inf, 0, count
        while low < high:  # the first start beyond the target along the coordinate
            middle = (low + high) // 2
            if starts.points[middle, along] < targets[row, along]:
                low = middle + 1
            else:
                high = middle
        below, above = low - 1, low
        while below >= 0 or above < count:  # from there to both sides, until the coordinate alone is too far off
            down = targets[row, along] - starts.points[below, along] if below >= 0 else np.inf
            up = starts.points[above, along] - targets[row, along] if above < count else np.inf
            if not min(down, up) ** 2 < least:
                break
            place = below if down < up else above
            if down < up:
                below -= 1
            else:
                above += 1
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
    iterations, polishing, rejected, crossings, detours, forced = 1, 0, 0, 0, 0, False
    running, restores = 0, False  # trials rejected one after the other; whether the next one only goes to equilibrium
    funnel, corridor, worthwhile = (_FUNNEL * size) ** 2, (_CORRIDOR * size) ** 2, (_NO_CHANGE * most) ** 2
    value = _value(model, base, preferred, weight)
    _fill_offset(model, base, low, high, preferred, scratch)
    miss = model.value[base, 0]
    while iterations < MAX_ITERATIONS + polishing and rejected < _REJECTED:
        gain = value - _step(model, base, low, high, preferred, weight, trust, most, scratch)
        saving = model.value[base, 3] - _offset_after(model, base, preferred, scratch.change)
        at_goal, close = miss <= (_REACHED * size) ** 2, _miss(model, base) <= (_CLOSE * size) ** 2
        if restores:
            for j in range(m):
                scratch.change[j] = 0.0
        elif not forced:
            reaches = polishing > 0 and close and value - gain <= (_REACHED * size) ** 2
            if reaches and _finishes(chain, model, base, scratch.change, most):
                ended, miss, base = REACHED, 0.0, 1 - base
                break
            enough = _NO_GAIN * miss + weight * worthwhile
            over = model.value[base, 2] <= _SETTLED and (gain <= enough or (at_goal and polishing > 0))
            if (over or trust < _SMALLEST_TRUST) and (polishing > 0 or at_goal):
                ended = REACHED if at_goal else NEAREST
                break
            settled = close and (saving <= worthwhile or trust < _SMALL_TRUST)
            if polishing == 0 and (settled or over or trust < _SMALLEST_TRUST):
                polishing, weight, trust, rejected = _POLISHING, 0.0, max(trust, 1.0 if settled else 0.01), 0
                value = _value(model, base, preferred, weight)
                continue
        trial = 1 - base
        share = _advance(chain, model, base, trial, scratch.change)
        iterations += 1
        fits = (gain > 0.0 or restores) and _fill(chain, rows, row, trial, False, state, model, scratch)
        new_value, new_miss, room = _value(model, trial, preferred, weight), _miss(model, trial), max(funnel, corridor)
        lower, inside, saved = new_value <= value - 1e-4 * share * gain, new_miss <= room, 0.0
        model.value[trial, 3] = np.inf
        if fits and inside and polishing == 0:
            _fill_offset(model, trial, low, high, preferred, scratch)
            saved = model.value[base, 3] - model.value[trial, 3]
        saves = not forced and saving > worthwhile and saved >= 0.1 * share * saving
        if saves and not lower:
            detours += 1
            crossings += 1 if _hold_others(model) else 0
            saves = detours <= _DETOURS and crossings <= _CROSSINGS
        if fits and (lower or saves or restores):
            if saves and saved >= 0.5 * share * saving:
                trust = min(min(2.0, _factor(room, new_miss)) * trust, _LARGEST_TRUST)
            elif not saves and new_value <= value - 0.5 * share * gain:
                trust = min((4.0 if forced else 2.0) * trust, _LARGEST_TRUST)
            base, forced, value, miss = trial, False, new_value, model.value[trial, 0]
            running, restores = 0, False
        else:
            rejected, running = rejected + 1, running + 1
            trust = min(trust, _least_trust(model, base, scratch.change, most))
            trust *= 0.25 if forced or not fits or running > 2 else max(0.1, min(0.5, _factor(room, new_miss)))
            restores = not restores and trust < _RESTORED and model.value[base, 2] > _SETTLED
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
def _factor(room, miss):
    """By which steps may be longer: what they miss by grows with their square. Both are squares of lengths."""
    return 0.8 * (room / miss) ** 0.25 if miss > 0.0 else np.inf


@part
def _least_trust(model, base, change, most):
    """The least trust that allows a change of the tensions."""
    least = 0.0
    for j in range(change.size):
        least = max(least, abs(change[j]) / max(model.tension[base, j], 0.1 * most))
    return least


@part
def _fill_offset(model, which, low, high, preferred, scratch):
    """Fill |tau + dtau_0 - preferred|² of a point."""
    m, trace = preferred.size, 0.0
    for j in range(m):
        trace += model.square[which, j, j]
    for j in range(m):
        scratch.lowest[j], scratch.highest[j] = low[j] - model.tension[which, j], high[j] - model.tension[which, j]
        scratch.gradient[j] = model.slope[which, j]
        for k in range(j + 1):
            scratch.hessian[j, k] = scratch.hessian[k, j] = model.square[which, j, k]
        scratch.hessian[j, j] += _WEIGHT**2 * trace / m
    _minimise_in_box(scratch)
    model.value[which, 3] = _offset_after(model, which, preferred, scratch.change)


@part
def _offset_after(model, which, preferred, change):
    """|tau + dtau - preferred|² after a change of the tensions."""
    offset = 0.0
    for j in range(preferred.size):
        offset += (model.tension[which, j] + change[j] - preferred[j]) ** 2
    return offset


@part
def _finishes(chain, model, base, change, most):
    """Whether a step is so short that the linear model says where it ends: fills the other point with that."""
    last, turned, changed = 1 - base, 0.0, 0.0
    for i in range(model.angle.shape[1]):
        turn = model.balance[base, i]
        for j in range(change.size):
            turn += model.rates[base, i, j] * change[j]
        angle = model.angle[base, i] + turn
        if not model.free[base, i] or not chain.joints[i, 0] <= angle <= chain.joints[i, 1]:
            return False
        model.angle[last, i], turned = angle, max(turned, abs(turn))
    for j in range(change.size):
        model.tension[last, j], length = model.tension[base, j] + change[j], model.length[base, j]
        for i in range(model.angle.shape[1]):
            length += model.lengthening[base, i, j] * (model.angle[last, i] - model.angle[base, i])
        model.length[last, j], changed = length, max(changed, abs(change[j]) / most)
    return turned * max(turned, changed) <= _LAST


@part
def _hold_others(model):
    """Whether the limits hold other joints at the one point than at the other."""
    for i in range(model.free.shape[1]):
        if model.free[0, i] != model.free[1, i]:
            return True
    return False


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
    offset = 0.0
    for j in range(preferred.size):
        offset += (model.tension[which, j] - preferred[j]) ** 2
    return _miss(model, which) + weight * offset


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
            model.lengthening[which, i, j] = state.gap[i, j, 1] if crosses else 0.0
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
    m = change.size
    for j in range(m):
        tension = model.tension[base, j]
        farthest = trust * max(tension, 0.1 * most)
        scratch.lowest[j] = max(low[j] - tension, -farthest)
        scratch.highest[j] = min(high[j] - tension, farthest)
        gradient[j] = model.slope[base, j] + weight * (tension - preferred[j])
        for k in range(j + 1):
            hessian[j, k] = hessian[k, j] = square[j, k]
        hessian[j, j] += weight
    _minimise_in_box(scratch)
    total = 0.0
    for j in range(m):
        total += 2.0 * gradient[j] * change[j]
        for k in range(m):
            total += change[j] * hessian[j, k] * change[k]
        offset = model.tension[base, j] - preferred[j]
        total += weight * offset * offset
    return model.value[base, 0] + total


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
            damping = _DAMPING * largest(scratch.hessian, free)
            if cholesky(scratch.hessian, free, damping, scratch.L) < 0.0:
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
