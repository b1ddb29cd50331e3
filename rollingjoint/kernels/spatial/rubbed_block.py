"""Steps of arms with friction in lanes (shared/rubbed_block.py)."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from rollingjoint._numba.jit import kernel, part
from rollingjoint._numba.layout import Floats
from rollingjoint._numba.views import numbers
from rollingjoint.kernels.shared import block_formulas
from rollingjoint.kernels.shared.formulas import formula
from rollingjoint.kernels.shared.friction import FrictionLaw, History, Rubbing
from rollingjoint.kernels.shared.lanes import solve_wide, wide_memory
from rollingjoint.kernels.shared.rubbed_block import advance_with_friction, fill_friction, inner_search, store_history
from rollingjoint.kernels.spatial.arrays import N_TURNS, BatchArrays
from rollingjoint.kernels.spatial.lanes import HingeBlock, block_sizes, fill_design, fill_inputs, store_lane
from rollingjoint.kernels.spatial.turns import evaluate_turns


class RubbedHingeBlock(NamedTuple):
    """A HingeBlock with friction; fields that are not Hinges' are those of planar.rubbed_block.RubbedBlock."""

    block: HingeBlock
    law: FrictionLaw
    before: History
    now: Rubbing
    turns: Annotated[Floats, "J", "m", N_TURNS]
    symmetric: Annotated[Floats, "J", "J"]
    work: Annotated[Floats, 1]


formula(block_formulas.advance, RubbedHingeBlock)(advance_with_friction)
formula(block_formulas.search_of, RubbedHingeBlock)(inner_search)


@formula(block_formulas.evaluate_turns, RubbedHingeBlock)
def turns_of(rubbed, tendon_joints):
    """Fill turns and their rates."""
    evaluate_turns(rubbed.turns, tendon_joints, rubbed.block.state, rubbed.now.turn)


@formula(block_formulas.fill_row, RubbedHingeBlock)
def fill_row(rubbed, batch, friction, lane, row, design):
    """Copy the inputs of a row into a lane; False where they need the solver for all cases."""
    if design >= 0:
        fill_design(batch.chain, rubbed.block, lane, design)
        _fill_turns(batch.chain, rubbed, lane, design)
    return fill_inputs(batch, rubbed.block, lane, row) and fill_friction(friction, rubbed, lane, row)


@part(inline=True)
def _fill_turns(chain, rubbed, lane, design):
    """Copy the table of turns of a lane's design."""
    turns = numbers(rubbed.turns)
    for i in range(turns.shape[0]):
        for j in range(turns.shape[1]):
            for k in range(N_TURNS):
                turns[i, j, k, lane] = chain.turns[design, i, j, k]


@formula(block_formulas.fill_outputs, RubbedHingeBlock)
def fill_outputs(rubbed, batch):
    """Fill torques at the motors, of which friction lets a part pass."""
    torque, now = rubbed.block.state.torque, rubbed.now
    for j in range(batch.chain.tendon_joints.size):
        for i in range(batch.chain.tendon_joints[j]):
            torque[i, j] = now.lever[i, j] * now.passed[i, j]


@formula(block_formulas.store_row, RubbedHingeBlock)
def store_row(rubbed, batch, friction, lane, row):
    """Copy a lane that has arrived into its row."""
    store_lane(rubbed.block, batch.results, lane, row)
    store_history(rubbed, friction, lane, row)


@kernel(nogil=True, short_loops=True, title="the arm's solver with friction")
def step_hinges_side_by_side(chain, designs, laws, loads, starts, results, friction, first, last):
    """Solve the steps of rows first to last - 1; returns how many are PENDING."""
    sizes = block_sizes(starts.shape[1], chain.tendon_joints.size, loads.shape[1])
    batch = BatchArrays(chain, designs, laws, loads, starts, results)
    memory = np.zeros(wide_memory(RubbedHingeBlock, sizes))
    return solve_wide(memory, RubbedHingeBlock, sizes, batch, friction, first, last)
