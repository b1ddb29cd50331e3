"""Where the time of a Newton iteration goes, eight lanes side by side."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

from rollingjoint._numba.borrowed import borrow
from rollingjoint._numba.jit import kernel, machine_code, part
from rollingjoint._numba.pins import Pinned, carve_tuple, size_of, unpin
from rollingjoint._numba.simd import WIDTH
from rollingjoint._numba.views import aligned_simd, as_rows, carve, integers, numbers, of_width
from rollingjoint.kernels import formulas as block_formulas
from rollingjoint.kernels.joints import BUCKET_ENDS, evaluate_rows_of_lanes, locate
from rollingjoint.kernels.lanes import PHASE, RUNNING, begin_lane, factor_stiffness, hold_ends, move, newton_step
from rollingjoint.kernels.planar_loads import evaluate_dead_loads, n_rows
from rollingjoint.kernels.rolling import PinnedBatch, evaluate_poses, evaluate_residual
from rollingjoint.kernels.rolling_lanes import Block, block_sizes
from rollingjoint.kernels.tendons import evaluate_tendons
from speed_rows.row import Row
from speed_rows.sizes import Sizes
from speed_rows.timing import fastest
from speed_rows.walk import batch_arrays, random_walk

TITLE = "Where an iteration goes"
TEXT = """The pieces that a solve of the five-link prototype is made of, each repeated on the same eight lanes side by
side; time per lane. A Newton iteration is one evaluation and what follows from it; a solve has one evaluation more than
it has iterations, and is filled in and stored once; contact forces of all eight lanes are found whenever one has
arrived. Everything lies in the nearest cache here, and no branch is mispredicted.

Nearly half of it goes into the tables of the joints: ten rows of eight numbers for every joint and lane, accurate to
2e-12, and their transposition into lanes. Cosine and sine by a polynomial of the angle would leave two of the eight
columns out, and save nothing, since a row of eight is one register. A lower degree needs more cells: eight
coefficients in place of ten, twice as many, 86 kB in place of 43, where the nearest cache holds 32 or 48. The
derivatives of fewer columns take as many operations as those columns. The lengths of the gaps cost a square root and a
division each. The bare kernel reads two rows for a joint, gaps included: cubics, accurate to 5e-9, of this mechanism's
own holes.

Tried without gain: Horner's scheme in two halves, and cells looked up without a branch. Lengths of axes that
are known when the kernel is compiled bring 8 %, for a compilation of every shape."""

ROUNDS = 4096
EMPTY, CELLS, JOINTS, POSES, FORCES, STIFFNESS, STEP, ITERATION, INPUTS, OUTPUTS, STORE = range(11)
NAMES = {
    CELLS: "look up the cells of all joints",
    JOINTS: "evaluate their tables, cells included",
    POSES: "gaps, poses and contacts",
    FORCES: "tensions, loads and residual",
    STIFFNESS: "stiffness and its factor",
    STEP: "Newton step, limits and the move",
    ITERATION: "whole iteration",
    INPUTS: "fill in a row, once a solve",
    OUTPUTS: "contact forces, when a lane arrives",
    STORE: "store a row, once a solve",
}


def measure(sizes: Sizes, images: Path) -> Iterator[Row]:
    """Rows of the section."""
    walk = random_walk(sizes.walk)
    pinned = Pinned(PinnedBatch(batch_arrays(walk), np.zeros(0)))
    repeat = partial(machine_code(repeat_piece, int, int, int), pinned.address_for(PinnedBatch))
    empty = fastest(lambda: repeat(EMPTY, ROUNDS), ROUNDS * WIDTH, sizes.repeats).seconds
    for piece, name in NAMES.items():
        timing = fastest(partial(repeat, piece, ROUNDS), ROUNDS * WIDTH, sizes.repeats)
        yield Row(name, 1e9 * (timing.seconds - empty), "ns", timing.sample)


@kernel(nogil=True, short_loops=True, title="a benchmark")
def repeat_piece(pins, piece, rounds):
    """Do a piece of the work of a solve so many times, in eight lanes that hold the first eight rows."""
    batch = unpin(pins, PinnedBatch).batch
    sizes = block_sizes(batch.starts.shape[1], batch.chain.tendon_joints.size, n_rows(batch.chain, batch.loads))
    memory = np.zeros((size_of(Block, sizes) + 3) * WIDTH)
    _repeat_in(aligned_simd(borrow(memory)), sizes, borrow(batch), piece, rounds)
    return memory.size


@part(inline=True)
def _repeat_in(space, sizes, batch, piece, rounds):
    block, size = carve_tuple(space, 0, Block, sizes), size_of(Block, sizes)
    designs, search = integers(carve(space, size, (1,))), numbers(block.search)
    for lane in range(WIDTH):
        designs[lane] = 0
        block_formulas.fill_row(block, batch, None, lane, lane, 0)
        begin_lane(search, lane)
    block_formulas.advance(block, batch.chain, designs)
    for _ in range(rounds):
        block.state.angle[0] = block.state.angle[0] + 1e-12  # nothing may be moved out of the loop
        _do_piece(block, search, batch, designs, piece)


@part(inline=True)
def _do_piece(block, search, batch, designs, piece):
    chain, state, free, per_pivot = batch.chain, block.state, block.vectors[5], block.vectors[2]
    if piece == CELLS:
        _look_up(chain, designs, state, numbers(block.forces))
    elif piece == JOINTS:
        evaluate_rows_of_lanes(chain.joints, chain, designs, state, as_rows(block.rows))
    elif piece == POSES:
        evaluate_poses(block.holes, block.channels, chain.tendon_joints, state)
    elif piece == FORCES:
        evaluate_tendons(block.law, state)
        evaluate_dead_loads(block.loads, state)
        evaluate_residual(chain.tendon_joints, state)
    elif piece == STIFFNESS:
        factor_stiffness(block, chain.tendon_joints)
    elif piece == STEP:
        hold_ends(block)
        newton_step(block.L, per_pivot, state.residual, free, block.vectors[0])
        everywhere = block.search[PHASE] == block.search[PHASE]
        move(block, everywhere, 0.0 * state.angle[0], everywhere)
    elif piece == ITERATION:
        for lane in range(WIDTH):
            search[PHASE, lane] = RUNNING
        block_formulas.advance(block, chain, designs)
    elif piece == INPUTS:
        for lane in range(WIDTH):
            block_formulas.fill_row(block, batch, None, lane, lane, -1)
    elif piece == OUTPUTS:
        block_formulas.fill_outputs(block, batch)
    elif piece == STORE:
        for lane in range(WIDTH):
            block_formulas.store_row(block, batch, None, lane, lane)


@part(inline=True)
def _look_up(chain, designs, state, places):
    """What evaluate_rows_of_lanes does before it reads the table."""
    angle, cells = numbers(state.angle), of_width(chain.cells, 4)
    joints, buckets = of_width(chain.joints, 3), of_width(chain.buckets, BUCKET_ENDS)
    for i in range(angle.shape[0]):
        for lane in range(WIDTH):
            which = designs[lane]
            cell, u = locate(joints[which], buckets[which], cells, i, angle[i, lane])
            places[i, 0, lane] = cell + u
