"""Lanes side by side: Newton's method where it meets no difficulty.

Energy descends with full steps or halved ones, the stiffness of the free joints stays positive definite, loads are dead
forces; a joint that is pressed against its limit is held there. A lane that leaves this path is marked PENDING, and the
general solver takes it from its start. A lane that arrives makes room for the next; its numbers do not depend on
the other lanes.

A class of chains brings its block of lanes, with the fields `state`, `law`, `limits`, `L`, `vectors` and `search` of
rolling_lanes.Block, and registers formulas for it. The lanes are eight of SIMD numbers or a single one of
floats: the same functions, compiled for the one type or the other, and results equal to the last bit. A single chain
takes two thirds of the time.
"""

from __future__ import annotations

import numpy as np

from rollingjoint._numba.borrowed import borrow
from rollingjoint._numba.jit import part
from rollingjoint._numba.pins import carve_tuple, size_of
from rollingjoint._numba.simd import WIDTH, any_lane, where
from rollingjoint._numba.views import aligned_simd, carve, integers, numbers
from rollingjoint.kernels import formulas
from rollingjoint.kernels.arrays import (
    LARGEST_INPUT,
    MAX_STEP,
    NEGLIGIBLE,
    RELATIVE_GOAL,
    RESIDUAL_FLOOR,
    RESIDUAL_GOAL,
    ROUNDING,
    SMALLEST_PIVOT,
    resolvable,
)

MOST_JOINTS = 15  # beyond it a lone lane is faster by the O(n) step of the general solver
PENDING = -1  # status of a lane that is left to the general solver
MAX_PASSES = 40.0
SHORTEST = 1.0 / 64.0  # of a Newton step

# Columns of a block's search: energy, its magnitude and |r| where the line search began, part of the step that is
# tried, steps taken, passes, whether a joint is held, phase
ENERGY, MAGNITUDE, WORST, PART, STEPS, PASSES, HELD, PHASE = range(8)
# Phases of a lane
IDLE, RUNNING, ARRIVED, LEFT = 0.0, 1.0, 2.0, 3.0


@part(inline=True)
def fill_law(laws, block, lane, source):
    """Copy one lane's tendon law into the block; False where it needs the general solver."""
    law = block.law
    commands, stiffnesses, lows, highs = (
        numbers(law.command),
        numbers(law.stiffness),
        numbers(law.low),
        numbers(law.high),
    )
    supported = True
    for j in range(commands.shape[0]):
        command, k, low, high = (
            laws.command[source, j],
            laws.stiffness[source, j],
            laws.low[source, j],
            laws.high[source, j],
        )
        supported = supported and resolvable(command) and k > 0.0 and 0.0 <= low <= min(high, LARGEST_INPUT)
        commands[j, lane], stiffnesses[j, lane], lows[j, lane], highs[j, lane] = command, k, low, high
    return supported


@part(inline=True)
def fill_start(starts, block, lane, source):
    """Copy one lane's start into the block, clipped to the limits; False where it needs the general solver."""
    limits, angle = numbers(block.limits), numbers(block.state.angle)
    supported = True
    for i in range(limits.shape[0]):
        phi = starts[source, i]
        supported = supported and resolvable(phi)
        angle[i, lane] = min(max(phi, limits[i, 0, lane]), limits[i, 1, lane])
    return supported


@part(inline=True)
def begin_lane(search, lane):
    """Let a lane run: its first evaluation counts as a step that is accepted. search: the numbers of Block.search."""
    search[ENERGY, lane], search[MAGNITUDE, lane], search[WORST, lane] = np.inf, 0.0, 0.0
    search[PART, lane], search[STEPS, lane], search[PASSES, lane] = 1.0, -1.0, 0.0
    search[PHASE, lane] = RUNNING


@part(inline=True)
def hold_ends(block):
    """Mark joints that a load presses against the end of a surface; returns (largest |r| of the others, any marked)."""
    angle, residual, limits, free = block.state.angle, block.state.residual, block.limits, block.vectors[5]
    zero = 0.0 * angle[0]
    worst, held = zero, zero
    for i in range(angle.size):
        r = residual[i]
        at_end = ((angle[i] <= limits[i, 0] + 1e-13) & (r > 0.0)) | ((angle[i] >= limits[i, 1] - 1e-13) & (r < 0.0))
        free[i] = where(at_end, 0.0, zero + 1.0)
        held = where(at_end, 1.0, held)
        worst = where(~at_end & (abs(r) > worst), abs(r), worst)
    return worst, held


@part(inline=True)
def factor_stiffness(block, tendon_joints):
    """Fill L and 1 / D of dr/dphi = L D Lᵀ on the free joints; returns (smallest, largest diagonal entry)."""
    state, H, per_pivot, free = block.state, block.L, block.vectors[2], block.vectors[5]
    gap, elastic, tension = state.gap, state.elastic, state.tension
    n_joints = per_pivot.size
    smallest, largest = 0.0 * state.angle[0] + np.inf, 0.0 * state.angle[0]
    for i in range(n_joints):
        pivot = formulas.fill_row_of_loads(block, i, H)
        term, less = formulas.own_terms(block, i)
        pivot = pivot + term - less
        for j in range(tension.size):
            if i < tendon_joints[j]:
                rate = gap[i, j, 1]
                pull = elastic[j] * rate
                pivot = pivot + pull * rate + tension[j] * gap[i, j, 2]
                for m in range(i):
                    H[i, m] += pull * gap[m, j, 1]
        present = free[i] > 0.0
        pivot = where(present, pivot, 1.0)
        largest = where(present & (abs(pivot) > largest), abs(pivot), largest)
        for m in range(i):
            value = where(present & (free[m] > 0.0), H[i, m], 0.0)
            for k in range(m):
                value = value - H[i, k] * H[m, k]
            H[i, m] = value
        for m in range(i):
            scaled = H[i, m] * per_pivot[m]
            pivot = pivot - H[i, m] * scaled
            H[i, m] = scaled
        smallest = where(present & (pivot < smallest), pivot, smallest)
        per_pivot[i] = 1.0 / pivot
    return smallest, largest


@part(inline=True)
def newton_step(L, per_pivot, residual, free, step):
    """Solve L D Lᵀ step = -residual on the free joints; zero elsewhere. May be done in place."""
    n_joints = step.size
    for i in range(n_joints):
        value = -residual[i] * free[i]
        for m in range(i):
            value = value - L[i, m] * step[m]
        step[i] = value
    for i in range(n_joints - 1, -1, -1):
        value = step[i] * per_pivot[i]
        for m in range(i + 1, n_joints):
            value = value - L[m, i] * step[m]
        step[i] = value


@part(inline=True)
def keep(search, accepted, energy, magnitude, worst, held):
    """Begin another line search where a trial is accepted, else halve the step; returns (next share of it, passes)."""
    share, passes = where(accepted, 1.0, 0.5 * search[PART]), search[PASSES] + 1.0
    search[STEPS] = where(accepted, search[STEPS] + 1.0, search[STEPS])
    search[ENERGY] = where(accepted, energy, search[ENERGY])
    search[MAGNITUDE] = where(accepted, magnitude, search[MAGNITUDE])
    search[WORST] = where(accepted, worst, search[WORST])
    search[HELD] = where(accepted, held, search[HELD])
    search[PART], search[PASSES] = share, passes
    return share, passes


@part(inline=True)
def move(block, accepted, share, moving):
    """Go a part of the Newton step from where the line search began, between the limits, in the lanes that move."""
    limits, angle, residual, solution = block.limits, block.state.angle, block.state.residual, block.vectors[0]
    step, base_angle, base_residual = block.vectors[1], block.vectors[3], block.vectors[4]
    longest = 0.0 * angle[0]
    for i in range(angle.size):
        longest = where(abs(solution[i]) > longest, abs(solution[i]), longest)
    shortened = where(longest > MAX_STEP, MAX_STEP / longest, 1.0)
    for i in range(angle.size):
        direction = where(accepted, solution[i] * shortened, step[i])
        origin = where(accepted, angle[i], base_angle[i])
        step[i], base_angle[i], base_residual[i] = direction, origin, where(accepted, residual[i], base_residual[i])
        trial = origin + share * direction
        trial = where(trial > limits[i, 0], trial, limits[i, 0])
        trial = where(trial < limits[i, 1], trial, limits[i, 1])
        angle[i] = where(moving, trial, angle[i])


@part(inline=True)
def fill_responses(block):
    """Fill d angle / d command, where the stiffness has just been factored."""
    gap, elastic, responses = block.state.gap, block.state.elastic, block.responses
    for j in range(elastic.size):
        for i in range(block.state.angle.size):
            responses[j, i] = -(elastic[j] * gap[i, j, 1])
        newton_step(block.L, block.vectors[2], responses[j], block.vectors[5], responses[j])


def advance(block, chain, designs):
    """One evaluation of all lanes, then another Newton step, a shorter one, or the end; True where a lane has ended."""
    search, angle, residual = block.search, block.state.angle, block.state.residual
    solution, per_pivot = block.vectors[0], block.vectors[2]
    base_angle, base_residual, free = block.vectors[3], block.vectors[4], block.vectors[5]
    energy, magnitude, scale = formulas.evaluate_lanes(block, chain, designs)
    worst, held = hold_ends(block)
    zero = 0.0 * worst
    slope = zero
    for i in range(angle.size):
        slope = slope + base_residual[i] * (angle[i] - base_angle[i])

    running = search[PHASE] == RUNNING
    noise, fall = ROUNDING * (search[MAGNITUDE] + magnitude), search[ENERGY] - energy
    descent = (fall > noise) & (fall >= -1e-4 * slope)
    accepted = running & (descent | ((fall >= -noise) & (worst < search[WORST])))
    goal = RELATIVE_GOAL * scale
    goal = where(goal < RESIDUAL_GOAL, goal, RESIDUAL_GOAL)
    at_rest = accepted & (worst <= where(goal > RESIDUAL_FLOOR, goal, RESIDUAL_FLOOR))
    smallest, largest = factor_stiffness(block, chain.tendon_joints)
    stable = (smallest > SMALLEST_PIVOT * largest) & (largest >= NEGLIGIBLE)
    share, passes = keep(search, accepted, energy, magnitude, worst, held)
    goes_on = running & (stable | ~accepted) & (share >= SHORTEST) & (passes < MAX_PASSES)
    newton_step(block.L, per_pivot, residual, free, solution)
    move(block, accepted, share, running & ~at_rest)
    ongoing = where(goes_on, RUNNING, LEFT)
    search[PHASE] = where(running, where(at_rest, where(stable, ARRIVED, LEFT), ongoing), search[PHASE])
    return any_lane(running & (at_rest | ~goes_on))


@part(inline=True)
def solve_rows(block, search, batch, friction, rows, loaded, first, last):
    """Solve rows first to last - 1 in the lanes of a block, by its formulas; returns the number left PENDING.

    rows, loaded: memory of an integer per lane, the row that it solves and the design that it holds.
    """
    search, status = numbers(search), batch.results.status
    following, running, pending = first, 0, 0
    for lane in range(loaded.size):
        loaded[lane], search[PHASE, lane] = -1, IDLE
    while True:  # every lane takes a row, and another one when it is done with it
        for lane in range(loaded.size):
            phase = search[PHASE, lane]
            if phase == RUNNING:
                continue
            if phase == ARRIVED:
                formulas.store_row(block, batch, friction, lane, rows[lane])
            elif phase == LEFT:
                status[rows[lane]] = PENDING
                pending += 1
            if phase != IDLE:
                running -= 1
                search[PHASE, lane] = IDLE
            while following < last and search[PHASE, lane] == IDLE:
                row = following
                following += 1
                design = batch.designs[row] if loaded[lane] != batch.designs[row] else -1
                loaded[lane] = batch.designs[row]
                if formulas.fill_row(block, batch, friction, lane, row, design):
                    rows[lane] = row
                    running += 1
                    begin_lane(search, lane)
                else:
                    status[row] = PENDING
                    pending += 1
        if running == 0:
            return pending
        while not formulas.advance(block, batch.chain, loaded):
            pass
        formulas.fill_outputs(block, batch)


def own_search(block):
    """`search_of` a block without friction."""
    return block.search


@part(inline=True)
def solve_wide(memory, layout, sizes, batch, friction, first, last):
    """`solve_rows` in eight lanes of a block of this class and these sizes, in memory of `wide_memory` numbers."""
    return solve_in(aligned_simd(borrow(memory)), layout, sizes, batch, friction, first, last)


@part(inline=True)
def wide_memory(layout, sizes):
    """Size of the memory of eight lanes, in numbers."""
    return (size_of(layout, sizes) + 3) * WIDTH


@part(inline=True)
def solve_in(space, layout, sizes, batch, friction, first, last):
    """`solve_rows` in the lanes of borrowed memory, eight of SIMD numbers or a single one of floats."""
    block, size = carve_tuple(space, 0, layout, sizes), size_of(layout, sizes)
    rows, loaded = integers(carve(space, size, (1,))), integers(carve(space, size + 1, (1,)))
    search = formulas.search_of(block)
    return solve_rows(block, search, borrow(batch), borrow(friction), rows, loaded, first, last)
