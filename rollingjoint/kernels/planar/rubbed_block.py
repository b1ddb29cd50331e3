"""Steps of planar chains with friction in lanes (shared/rubbed_block.py)."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from rollingjoint._numba.jit import kernel, part
from rollingjoint._numba.layout import Floats
from rollingjoint._numba.views import numbers
from rollingjoint.kernels.planar.arrays import BatchArrays
from rollingjoint.kernels.planar.block import Block, block_sizes, fill_design, fill_force, fill_inputs, store_lane
from rollingjoint.kernels.planar.loads import n_rows
from rollingjoint.kernels.planar.turns import evaluate_turns
from rollingjoint.kernels.shared import block_formulas
from rollingjoint.kernels.shared.formulas import formula
from rollingjoint.kernels.shared.friction import FrictionLaw, History, Rubbing
from rollingjoint.kernels.shared.lanes import solve_wide, wide_memory
from rollingjoint.kernels.shared.rubbed_block import (
    advance_with_friction,
    fill_friction,
    fill_responses_with_friction,
    inner_search,
    store_history,
)


class RubbedBlock(NamedTuple):
    """A Block with friction, borrowed arrays of SIMD lanes."""

    block: Block
    law: FrictionLaw
    before: History
    now: Rubbing
    directions: Annotated[Floats, "J", "m", 4]
    symmetric: Annotated[Floats, "J", "J"]  # factor of the symmetric part of the Jacobian
    work: Annotated[Floats, 1]


formula(block_formulas.advance, RubbedBlock)(advance_with_friction)
formula(block_formulas.search_of, RubbedBlock)(inner_search)


@formula(block_formulas.evaluate_turns, RubbedBlock)
def turns_of(rubbed, tendon_joints):
    """Fill turns and their rates."""
    evaluate_turns(rubbed.block.holes, rubbed.directions, tendon_joints, rubbed.block.state, rubbed.now.turn)


@formula(block_formulas.fill_row, RubbedBlock)
def fill_row(rubbed, batch, friction, lane, row, design):
    """Copy the inputs of a row into a lane; False where they need the solver for all cases."""
    if design >= 0:
        fill_design(batch.chain, rubbed.block, lane, design)
        _fill_directions(batch.chain, rubbed, lane, design)
    standing = batch.chain.standing[batch.designs[row]]
    usual = fill_inputs(batch.laws, standing, batch.loads, batch.starts, rubbed.block, lane, row)
    return usual and fill_friction(friction, rubbed, lane, row)


@part(inline=True)
def _fill_directions(chain, rubbed, lane, design):
    """Copy the directions of the channels of a lane's design."""
    directions = numbers(rubbed.directions)
    for i in range(directions.shape[0]):
        for j in range(directions.shape[1]):
            for k in range(4):
                directions[i, j, k, lane] = chain.directions[design, i, j, k]


@formula(block_formulas.fill_outputs, RubbedBlock)
def fill_outputs(rubbed, batch):
    """Fill what is stored of lanes that have arrived."""
    if batch.results.contacts.shape[0] > 0:
        for i in range(rubbed.block.state.angle.size):
            fill_force(rubbed.block, batch.chain.tendon_joints, rubbed.now.tension[i], i)
    if batch.results.responses.shape[0] > 0:
        fill_responses_with_friction(rubbed, batch.chain.tendon_joints)


@formula(block_formulas.store_row, RubbedBlock)
def store_row(rubbed, batch, friction, lane, row):
    """Copy a lane that has arrived into its row."""
    store_lane(rubbed.block, lane, batch.results, row)
    store_history(rubbed, friction, lane, row)


@kernel(nogil=True, short_loops=True, title="the planar solver with friction")
def step_side_by_side(chain, designs, laws, loads, starts, results, friction, first, last):
    """Solve the steps of rows first to last - 1; returns how many are PENDING."""
    sizes = block_sizes(starts.shape[1], chain.tendon_joints.size, n_rows(chain, loads))
    memory, batch = np.zeros(wide_memory(RubbedBlock, sizes)), BatchArrays(chain, designs, laws, loads, starts, results)
    return solve_wide(memory, RubbedBlock, sizes, batch, friction, first, last)
