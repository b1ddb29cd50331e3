"""Lanes side by side: Newton's method where it meets no difficulty.

Energy descends with full steps or halved ones, the stiffness of the free joints stays positive definite, loads are dead
forces and moments; a contact that presses against the end of its surface is held there. A lane that leaves this path is
marked PENDING, and the solver for all cases (solve.py) takes it from its start. A lane that arrives makes room for the
next; its numbers do not depend on its neighbours.

`solve_pinned` works on eight lanes of SIMD numbers, `solve_alone` on a single one of floats: the same functions,
compiled for the one type or the other, and results equal to the last bit. A single chain takes two thirds of the time.
"""

from __future__ import annotations

import numpy as np

from rollingjoint._numba.borrowed import borrow
from rollingjoint._numba.jit import kernel, part
from rollingjoint._numba.layout import size
from rollingjoint._numba.pins import carve_tuple, size_of, unpin
from rollingjoint._numba.simd import WIDTH, any_lane, columns, where
from rollingjoint._numba.views import aligned_simd, as_rows, carve, integers, numbers, of_width, table_rows
from rollingjoint.kernels.planar import block_formulas
from rollingjoint.kernels.planar.arrays import (
    BUCKET_ENDS,
    COS,
    CX,
    CY,
    FX,
    FY,
    GX,
    GY,
    N_COEFFICIENTS,
    PX,
    PY,
    SIN,
    BatchArrays,
    PinnedBatch,
    aligned,
)
from rollingjoint.kernels.planar.block import (
    ARRIVED,
    ENERGY,
    HELD,
    IDLE,
    LEFT,
    MAGNITUDE,
    PART,
    PASSES,
    PHASE,
    RUNNING,
    STEPS,
    WORST,
    Block,
    BlockSizes,
    begin_lane,
    block_sizes,
    fill_design,
    fill_forces,
    fill_inputs,
    store_lane,
)
from rollingjoint.kernels.planar.chain import evaluate_poses, evaluate_residual
from rollingjoint.kernels.planar.joint import locate, table_row
from rollingjoint.kernels.planar.loads import evaluate_dead_loads, fill_dead_stiffness, n_rows
from rollingjoint.kernels.shared.formulas import formula
from rollingjoint.kernels.shared.tendons import evaluate_tendons
from rollingjoint.kernels.shared.tolerances import (
    MAX_STEP,
    NEGLIGIBLE,
    RELATIVE_GOAL,
    RESIDUAL_FLOOR,
    RESIDUAL_GOAL,
    ROUNDING,
    SMALLEST_PIVOT,
)

MOST_JOINTS = 15  # beyond it a lone lane is faster by the O(n) step of the solver for all cases
PENDING = -1  # status of a lane that is left to the solver for all cases
MAX_PASSES = 40.0
SHORTEST = 1.0 / 64.0  # of a Newton step


@part(inline=True)
def evaluate_joints(chain, designs, state, rows):
    """Fill state.joint from the tables of each lane's design."""
    angle, joint = numbers(state.angle), state.joint
    cells, joints, buckets = of_width(chain.cells, 4), of_width(chain.joints, 3), of_width(chain.buckets, BUCKET_ENDS)
    coefficients = of_width(table_rows(chain.coefficients), N_COEFFICIENTS)
    n_joints = angle.shape[0]
    for i in range(n_joints):
        for lane in range(rows.size):
            which = designs[lane]
            if which < 0:
                continue
            cell, u = locate(joints[which], buckets[which], cells, i, angle[i, lane])
            rows[lane] = table_row(coefficients, cell, u)
        cos, sin, cx, cy, gx, gy, px, py = columns(rows)
        joint[i, COS], joint[i, SIN], joint[i, CX], joint[i, CY] = cos, sin, cx, cy
        joint[i, GX], joint[i, GY], joint[i, PX], joint[i, PY] = gx, gy, px, py


@part(inline=True)
def evaluate_lanes(chain, designs, block):
    """Fill the state at its angles; returns (energy, magnitude of its terms, force scale)."""
    state = block.state
    evaluate_joints(chain, designs, state, as_rows(block.rows))
    evaluate_poses(block.holes, block.channels, chain.tendon_joints, state)
    energy, magnitude = evaluate_tendons(block.law, state)
    load_energy, load_magnitude = evaluate_dead_loads(block.loads, state)
    return energy + load_energy, magnitude + load_magnitude, evaluate_residual(chain.tendon_joints, state)


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
def factor_stiffness(tendon_joints, loads, state, free, H, per_pivot):
    """Fill H with the factor L of dr/dphi = L D Lᵀ on the free joints; returns (smallest, largest diagonal entry)."""
    sums, contact, gap, elastic, tension = state.sums, state.contact, state.gap, state.elastic, state.tension
    n_joints = per_pivot.size
    smallest, largest = 0.0 * state.angle[0] + np.inf, 0.0 * state.angle[0]
    for i in range(n_joints):
        pivot = fill_dead_stiffness(loads, state, i, H)
        pivot = pivot + contact[i, 2] * sums[i, FY] - contact[i, 3] * sums[i, FX]
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
    """Begin another line search where a trial is accepted, else halve the part; returns (part to be tried, passes)."""
    tried, passes = where(accepted, 1.0, 0.5 * search[PART]), search[PASSES] + 1.0
    search[STEPS] = where(accepted, search[STEPS] + 1.0, search[STEPS])
    search[ENERGY] = where(accepted, energy, search[ENERGY])
    search[MAGNITUDE] = where(accepted, magnitude, search[MAGNITUDE])
    search[WORST] = where(accepted, worst, search[WORST])
    search[HELD] = where(accepted, held, search[HELD])
    search[PART], search[PASSES] = tried, passes
    return tried, passes


@part(inline=True)
def move(block, accepted, tried, moving):
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
        trial = origin + tried * direction
        trial = where(trial > limits[i, 0], trial, limits[i, 0])
        trial = where(trial < limits[i, 1], trial, limits[i, 1])
        angle[i] = where(moving, trial, angle[i])


@part(inline=True)
def _fill_responses(block):
    """Fill d angle / d command, where the stiffness has just been factored."""
    gap, elastic, responses = block.state.gap, block.state.elastic, block.responses
    for j in range(elastic.size):
        for i in range(block.state.angle.size):
            responses[j, i] = -(elastic[j] * gap[i, j, 1])
        newton_step(block.L, block.vectors[2], responses[j], block.vectors[5], responses[j])


@formula(block_formulas.advance, Block)
def advance(block, chain, designs):
    """One evaluation of all lanes and what follows from it: another Newton step, a shorter one, or the end."""
    search, angle, residual = block.search, block.state.angle, block.state.residual
    solution, per_pivot = block.vectors[0], block.vectors[2]
    base_angle, base_residual, free = block.vectors[3], block.vectors[4], block.vectors[5]
    energy, magnitude, scale = evaluate_lanes(chain, designs, block)
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
    smallest, largest = factor_stiffness(chain.tendon_joints, block.loads, block.state, free, block.L, per_pivot)
    stable = (smallest > SMALLEST_PIVOT * largest) & (largest >= NEGLIGIBLE)
    tried, passes = keep(search, accepted, energy, magnitude, worst, held)
    goes_on = running & (stable | ~accepted) & (tried >= SHORTEST) & (passes < MAX_PASSES)
    newton_step(block.L, per_pivot, residual, free, solution)
    move(block, accepted, tried, running & ~at_rest)
    left = where(goes_on, RUNNING, LEFT)
    search[PHASE] = where(running, where(at_rest, where(stable, ARRIVED, LEFT), left), search[PHASE])
    return any_lane(running & (at_rest | ~goes_on))


@formula(block_formulas.fill_row, Block)
def fill_row(block, batch, friction, lane, row, design):
    """Copy the inputs of a row into a lane; False where they need the solver for all cases."""
    if design >= 0:
        fill_design(batch.chain, block, lane, design)
    return fill_inputs(
        batch.laws, batch.chain.standing[batch.designs[row]], batch.loads, batch.starts, block, lane, row
    )


@formula(block_formulas.fill_outputs, Block)
def fill_outputs(block, batch):
    """Fill what is stored of lanes that have arrived."""
    if batch.results.contacts.shape[0] > 0:
        fill_forces(block, batch.chain.tendon_joints)
    if batch.results.responses.shape[0] > 0:
        _fill_responses(block)


@formula(block_formulas.store_row, Block)
def store_row(block, batch, friction, lane, row):
    """Copy a lane that has arrived into its row."""
    store_lane(block, lane, batch.results, row)


@kernel(nogil=True, short_loops=True, title="the planar solver")
def solve_pinned(pins, first, last):
    """Solve lanes first to last - 1 of a PinnedBatch; returns how many are PENDING."""
    batch = unpin(pins, PinnedBatch).batch
    sizes = block_sizes(batch.starts.shape[1], batch.chain.tendon_joints.size, n_rows(batch.chain, batch.loads))
    memory = np.zeros((size_of(Block, sizes) + 3) * WIDTH)
    return _solve_in(aligned_simd(borrow(memory)), sizes, batch, first, last)


@kernel(short_loops=True, title="the planar solver of single chains")
def solve_alone(pins, first, last):
    """As solve_pinned in a single lane, one row after the other, in the batch's own memory.

    It keeps Python's lock: releasing it takes 50 ns.
    """
    batch, memory = unpin(pins, PinnedBatch)
    sizes = block_sizes(batch.starts.shape[1], batch.chain.tendon_joints.size, n_rows(batch.chain, batch.loads))
    return _solve_in(memory, sizes, batch, first, last)


def memory_alone(batch: BatchArrays) -> np.ndarray:
    """The memory that solve_alone works in: made anew in every call it would take a tenth of the solve's time."""
    chain, (_, n_joints) = batch.chain, batch.starts.shape
    rows = chain.standing.shape[1] + batch.loads.shape[1] + 1
    lengths = BlockSizes(n_joints, n_joints + 1, len(chain.tendon_joints), rows, 4)._asdict()
    return aligned(np.zeros(size(Block, lengths) + 2))


@part(inline=True)
def _solve_in(space, sizes, batch, first, last):
    block, size = carve_tuple(space, 0, Block, sizes), size_of(Block, sizes)
    rows, chosen = integers(carve(space, size, (1,))), integers(carve(space, size + 1, (1,)))
    return solve_rows(block, block.search, borrow(batch), None, rows, chosen, first, last)


@part(inline=True)
def solve_rows(block, search, batch, friction, rows, chosen, first, last):
    """Solve rows first to last - 1 in the lanes of a block, by the formulas of its class; returns how many are PENDING.

    rows, chosen: memory of an integer per lane, the row that it solves and the design that it holds.
    """
    search, status = numbers(search), batch.results.status
    following, running, pending = first, 0, 0
    for lane in range(chosen.size):
        chosen[lane], search[PHASE, lane] = -1, IDLE
    while True:  # every lane takes a row, and another one when it is done with it
        for lane in range(chosen.size):
            phase = search[PHASE, lane]
            if phase == RUNNING:
                continue
            if phase == ARRIVED:
                block_formulas.store_row(block, batch, friction, lane, rows[lane])
            elif phase == LEFT:
                status[rows[lane]] = PENDING
                pending += 1
            if phase != IDLE:
                running -= 1
                search[PHASE, lane] = IDLE
            while following < last and search[PHASE, lane] == IDLE:
                row = following
                following += 1
                other = batch.designs[row] if chosen[lane] != batch.designs[row] else -1
                chosen[lane] = batch.designs[row]
                if block_formulas.fill_row(block, batch, friction, lane, row, other):
                    rows[lane] = row
                    running += 1
                    begin_lane(search, lane)
                else:
                    status[row] = PENDING
                    pending += 1
        if running == 0:
            return pending
        while not block_formulas.advance(block, batch.chain, chosen):
            pass
        block_formulas.fill_outputs(block, batch)
