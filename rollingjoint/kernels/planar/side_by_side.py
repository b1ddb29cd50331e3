"""Planar chains in lanes (shared/lanes.py): dead forces, moments and torsion springs.

`solve_pinned` works on eight lanes of SIMD numbers, `solve_alone` on a single one of floats.
"""

from __future__ import annotations

import numpy as np

from rollingjoint._numba.jit import kernel, part
from rollingjoint._numba.layout import size
from rollingjoint._numba.pins import unpin
from rollingjoint._numba.simd import columns
from rollingjoint._numba.views import as_rows, numbers, of_width, table_rows
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
    Block,
    BlockSizes,
    block_sizes,
    fill_design,
    fill_force,
    fill_inputs,
    store_lane,
)
from rollingjoint.kernels.planar.chain import evaluate_poses, evaluate_residual
from rollingjoint.kernels.planar.joint import locate, table_row
from rollingjoint.kernels.planar.loads import evaluate_dead_loads, fill_dead_stiffness, n_rows
from rollingjoint.kernels.shared import block_formulas
from rollingjoint.kernels.shared.formulas import formula
from rollingjoint.kernels.shared.lanes import advance, fill_responses, own_search, solve_in, solve_wide, wide_memory
from rollingjoint.kernels.shared.tendons import evaluate_tendons


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


@formula(block_formulas.evaluate_lanes, Block)
def evaluate_lanes(block, chain, designs):
    """Fill the state at its angles; returns (energy, magnitude of its terms, force scale)."""
    state = block.state
    evaluate_joints(chain, designs, state, as_rows(block.rows))
    evaluate_poses(block.holes, block.channels, chain.tendon_joints, state)
    energy, magnitude = evaluate_tendons(block.law, state)
    load_energy, load_magnitude = evaluate_dead_loads(block.loads, state)
    return energy + load_energy, magnitude + load_magnitude, evaluate_residual(chain.tendon_joints, state)


@formula(block_formulas.fill_row_of_loads, Block)
def fill_row_of_loads(block, i, H):
    """Fill row i of H with what dead loads add; returns what they add to the diagonal."""
    return fill_dead_stiffness(block.loads, block.state, i, H)


@formula(block_formulas.own_terms, Block)
def own_terms(block, i):
    """`moving_contact`, its two terms."""
    sums, contact = block.state.sums, block.state.contact
    return contact[i, 2] * sums[i, FY], contact[i, 3] * sums[i, FX]


formula(block_formulas.advance, Block)(advance)
formula(block_formulas.search_of, Block)(own_search)


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
        for i in range(block.state.angle.size):
            fill_force(block, batch.chain.tendon_joints, block.state.tension, i)
    if batch.results.responses.shape[0] > 0:
        fill_responses(block)


@formula(block_formulas.store_row, Block)
def store_row(block, batch, friction, lane, row):
    """Copy a lane that has arrived into its row."""
    store_lane(block, lane, batch.results, row)


@kernel(nogil=True, short_loops=True, title="the planar solver")
def solve_pinned(pins, first, last):
    """Solve lanes first to last - 1 of a PinnedBatch; returns how many are PENDING."""
    batch = unpin(pins, PinnedBatch).batch
    sizes = block_sizes(batch.starts.shape[1], batch.chain.tendon_joints.size, n_rows(batch.chain, batch.loads))
    return solve_wide(np.zeros(wide_memory(Block, sizes)), Block, sizes, batch, None, first, last)


@kernel(short_loops=True, title="the planar solver of single chains")
def solve_alone(pins, first, last):
    """As solve_pinned in a single lane, one row after the other, in the batch's own memory.

    It keeps Python's lock: releasing it takes 50 ns.
    """
    batch, memory = unpin(pins, PinnedBatch)
    sizes = block_sizes(batch.starts.shape[1], batch.chain.tendon_joints.size, n_rows(batch.chain, batch.loads))
    return solve_in(memory, Block, sizes, batch, None, first, last)


def memory_alone(batch: BatchArrays) -> np.ndarray:
    """The memory that solve_alone works in: made anew in every call it would take a tenth of the solve's time."""
    chain, (_, n_joints) = batch.chain, batch.starts.shape
    rows = chain.standing.shape[1] + batch.loads.shape[1] + 1
    lengths = BlockSizes(n_joints, n_joints + 1, len(chain.tendon_joints), rows, 4)._asdict()
    return aligned(np.zeros(size(Block, lengths) + 2))
