"""Planar chains in lanes (lanes.py, rubbed_block.py): dead forces, moments, torsion springs, and friction.

`solve_pinned` and `step_side_by_side` work on eight lanes of SIMD numbers, `solve_alone` on a single one of floats.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from rollingjoint._numba.jit import kernel, part
from rollingjoint._numba.layout import Floats, size
from rollingjoint._numba.pins import unpin
from rollingjoint._numba.views import as_rows, numbers
from rollingjoint.kernels import formulas
from rollingjoint.kernels.arrays import AT_LIMIT, CONVERGED, TendonLaw
from rollingjoint.kernels.formulas import formula
from rollingjoint.kernels.friction import FrictionLaw, History, Rubbing
from rollingjoint.kernels.joints import aligned, evaluate_rows_of_lanes
from rollingjoint.kernels.lanes import (
    HELD,
    STEPS,
    WORST,
    advance,
    fill_law,
    fill_responses,
    fill_start,
    own_search,
    solve_in,
    solve_wide,
    wide_memory,
)
from rollingjoint.kernels.planar_loads import N_DEAD, evaluate_dead_loads, fill_dead_loads, fill_dead_stiffness, n_rows
from rollingjoint.kernels.rolling import (
    FX,
    FY,
    BatchArrays,
    PinnedBatch,
    State,
    contact_forces,
    evaluate_poses,
    evaluate_residual,
)
from rollingjoint.kernels.rubbed_block import (
    advance_with_friction,
    fill_friction,
    fill_responses_with_friction,
    inner_search,
    store_history,
)
from rollingjoint.kernels.tendons import evaluate_tendons
from rollingjoint.kernels.turns import evaluate_rolling_turns


class Block(NamedTuple):
    """Inputs, state and scratch space of eight lanes, borrowed arrays of SIMD lanes."""

    state: State
    law: TendonLaw
    loads: Annotated[Floats, "rows", N_DEAD]  # columns in loads.py
    limits: Annotated[Floats, "J", 2]  # smallest and largest angle
    holes: Annotated[Floats, "J", "m", 4]
    channels: Annotated[Floats, "m"]
    L: Annotated[Floats, "J", "J"]  # factor of the stiffness L D Lᵀ
    vectors: Annotated[Floats, 6, "J"]  # solution, step, 1 / D, start of the line search: angles, residual; 1 if free
    search: Annotated[Floats, 8]  # columns in lanes.py
    forces: Annotated[Floats, "J", 4]  # contact forces and tangents
    responses: Annotated[Floats, "m", "J"]  # d angle / d command
    rows: Annotated[Floats, 8]  # memory of one row of a joint table per lane


class BlockSizes(NamedTuple):
    """Lengths of the axes of a Block."""

    J: int
    n: int
    m: int
    rows: int
    sums: int


@part(inline=True)
def block_sizes(n_joints, n_tendons, n_loads):
    """Sizes of a Block for chains under dead forces and moments."""
    return BlockSizes(n_joints, n_joints + 1, n_tendons, n_loads, 4)


@part(inline=True)
def fill_design(chain, block, lane, design):
    """Copy a design into a lane."""
    limits, holes, channels = numbers(block.limits), numbers(block.holes), numbers(block.channels)
    for i in range(limits.shape[0]):
        limits[i, 0, lane], limits[i, 1, lane] = chain.joints[design, i, 0], chain.joints[design, i, 1]
        for j in range(channels.shape[0]):
            for k in range(4):
                holes[i, j, k, lane] = chain.holes[design, i, j, k]
    for j in range(channels.shape[0]):
        channels[j, lane] = chain.channels[design, j]


@part(inline=True)
def fill_inputs(laws, standing, loads, starts, block, lane, source):
    """Copy one lane's inputs into the block; False where they need the general solver."""
    supported = fill_law(laws, block, lane, source)
    supported = supported and fill_dead_loads(standing, loads[source], numbers(block.loads), lane)
    return supported and fill_start(starts, block, lane, source)


@part(inline=True)
def fill_force(block, tendon_joints, tension, i):
    """Fill contact force and tangent of joint i; tension: of every tendon in its gap, (m,)."""
    forces = block.forces
    forces[i, 0], forces[i, 1], forces[i, 2], forces[i, 3] = contact_forces(tendon_joints, block.state, tension, i)


@part(inline=True)
def store_lane(block, lane, results, row):
    """Copy an equilibrium into its row of the results."""
    search, state, forces, responses = (
        numbers(block.search),
        block.state,
        numbers(block.forces),
        numbers(block.responses),
    )
    angle, contact, gap, pose = numbers(state.angle), numbers(state.contact), numbers(state.gap), numbers(state.pose)
    tension, length, elastic = numbers(state.tension), numbers(state.length), numbers(state.elastic)
    for i in range(angle.shape[0]):
        results.joint_angles[row, i] = angle[i, lane]
        if results.contacts.shape[0] > 0:
            results.contacts[row, i, 0], results.contacts[row, i, 1] = contact[i, 0, lane], contact[i, 1, lane]
            results.contacts[row, i, 2], results.contacts[row, i, 3] = forces[i, 2, lane], forces[i, 3, lane]
            results.contact_forces[row, i, 0] = forces[i, 0, lane]
            results.contact_forces[row, i, 1] = forces[i, 1, lane]
            for j in range(tension.shape[0]):
                results.rates[row, i, j] = gap[i, j, 1, lane]
        if results.responses.shape[0] > 0:
            for j in range(tension.shape[0]):
                results.responses[row, i, j] = responses[j, i, lane]
    for i in range(pose.shape[0]):
        for k in range(3):
            results.poses[row, i, k] = pose[i, k, lane]
    for j in range(tension.shape[0]):
        results.tensions[row, j], results.lengths[row, j] = tension[j, lane], length[j, lane]
        results.elastic[row, j] = elastic[j, lane]
    results.residual[row], results.iterations[row] = search[WORST, lane], int(search[STEPS, lane])
    results.status[row] = AT_LIMIT if search[HELD, lane] > 0.0 else CONVERGED


@formula(formulas.evaluate_lanes, Block)
def evaluate_lanes(block, chain, designs):
    """Fill the state at its angles; returns (energy, magnitude of its terms, force scale)."""
    state = block.state
    evaluate_rows_of_lanes(chain.joints, chain, designs, state, as_rows(block.rows))
    evaluate_poses(block.holes, block.channels, chain.tendon_joints, state)
    energy, magnitude = evaluate_tendons(block.law, state)
    load_energy, load_magnitude = evaluate_dead_loads(block.loads, state)
    return energy + load_energy, magnitude + load_magnitude, evaluate_residual(chain.tendon_joints, state)


@formula(formulas.fill_row_of_loads, Block)
def fill_row_of_loads(block, i, H):
    """Fill row i of H with the terms of dead loads; returns their term on the diagonal."""
    return fill_dead_stiffness(block.loads, block.state, i, H)


@formula(formulas.own_terms, Block)
def own_terms(block, i):
    """`moving_contact`, its two terms."""
    sums, contact = block.state.sums, block.state.contact
    return contact[i, 2] * sums[i, FY], contact[i, 3] * sums[i, FX]


formula(formulas.advance, Block)(advance)
formula(formulas.search_of, Block)(own_search)


@formula(formulas.fill_row, Block)
def fill_row(block, batch, friction, lane, row, design):
    """Copy the inputs of a row into a lane; False where they need the general solver."""
    if design >= 0:
        fill_design(batch.chain, block, lane, design)
    return fill_inputs(
        batch.laws, batch.chain.standing[batch.designs[row]], batch.loads, batch.starts, block, lane, row
    )


@formula(formulas.fill_outputs, Block)
def fill_outputs(block, batch):
    """Fill the stored outputs of lanes that have arrived."""
    if batch.results.contacts.shape[0] > 0:
        for i in range(block.state.angle.size):
            fill_force(block, batch.chain.tendon_joints, block.state.tension, i)
    if batch.results.responses.shape[0] > 0:
        fill_responses(block)


@formula(formulas.store_row, Block)
def store_row(block, batch, friction, lane, row):
    """Copy a lane that has arrived into its row."""
    store_lane(block, lane, batch.results, row)


@kernel(nogil=True, short_loops=True, title="the planar solver")
def solve_pinned(pins, first, last):
    """Solve lanes first to last - 1 of a PinnedBatch; returns the number left PENDING."""
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


class RubbedBlock(NamedTuple):
    """A Block with friction, borrowed arrays of SIMD lanes."""

    block: Block
    law: FrictionLaw
    before: History
    now: Rubbing
    directions: Annotated[Floats, "J", "m", 4]
    symmetric: Annotated[Floats, "J", "J"]  # factor of the symmetric part of the Jacobian
    work: Annotated[Floats, 1]


formula(formulas.advance, RubbedBlock)(advance_with_friction)
formula(formulas.search_of, RubbedBlock)(inner_search)


@formula(formulas.evaluate_turns, RubbedBlock)
def turns_of(rubbed, tendon_joints):
    """Fill turns and their rates."""
    evaluate_rolling_turns(rubbed.block.holes, rubbed.directions, tendon_joints, rubbed.block.state, rubbed.now.turn)


@formula(formulas.fill_row, RubbedBlock)
def fill_row_with_friction(rubbed, batch, friction, lane, row, design):
    """Copy the inputs of a row into a lane; False where they need the general solver."""
    if design >= 0:
        fill_design(batch.chain, rubbed.block, lane, design)
        _fill_directions(batch.chain, rubbed, lane, design)
    standing = batch.chain.standing[batch.designs[row]]
    supported = fill_inputs(batch.laws, standing, batch.loads, batch.starts, rubbed.block, lane, row)
    return supported and fill_friction(friction, rubbed, lane, row)


@part(inline=True)
def _fill_directions(chain, rubbed, lane, design):
    """Copy the directions of the channels of a lane's design."""
    directions = numbers(rubbed.directions)
    for i in range(directions.shape[0]):
        for j in range(directions.shape[1]):
            for k in range(4):
                directions[i, j, k, lane] = chain.directions[design, i, j, k]


@formula(formulas.fill_outputs, RubbedBlock)
def fill_outputs_with_friction(rubbed, batch):
    """Fill the stored outputs of lanes that have arrived."""
    if batch.results.contacts.shape[0] > 0:
        for i in range(rubbed.block.state.angle.size):
            fill_force(rubbed.block, batch.chain.tendon_joints, rubbed.now.tension[i], i)
    if batch.results.responses.shape[0] > 0:
        fill_responses_with_friction(rubbed, batch.chain.tendon_joints)


@formula(formulas.store_row, RubbedBlock)
def store_row_with_friction(rubbed, batch, friction, lane, row):
    """Copy a lane that has arrived into its row."""
    store_lane(rubbed.block, lane, batch.results, row)
    store_history(rubbed, friction, lane, row)


@kernel(nogil=True, short_loops=True, title="the planar solver with friction")
def step_side_by_side(chain, designs, laws, loads, starts, results, friction, first, last):
    """Solve the steps of rows first to last - 1; returns the number left PENDING."""
    sizes = block_sizes(starts.shape[1], chain.tendon_joints.size, n_rows(chain, loads))
    memory, batch = np.zeros(wide_memory(RubbedBlock, sizes)), BatchArrays(chain, designs, laws, loads, starts, results)
    return solve_wide(memory, RubbedBlock, sizes, batch, friction, first, last)
