"""Arms with exact tendons in lanes (lanes.py, rubbed_block.py): dead forces, and friction.

`solve_hinges_pinned` and `step_hinges_side_by_side` work on eight lanes of SIMD numbers, `solve_hinges_alone` on a
single one of floats.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from rollingjoint._numba.jit import kernel, part
from rollingjoint._numba.layout import Floats
from rollingjoint._numba.pins import unpin
from rollingjoint._numba.views import numbers
from rollingjoint.kernels import formulas
from rollingjoint.kernels.arrays import TendonLaw
from rollingjoint.kernels.formulas import formula
from rollingjoint.kernels.friction import FrictionLaw, History, Rubbing
from rollingjoint.kernels.hinges import (
    EXACT,
    N_DEAD,
    N_TURNS,
    HingeBatchArrays,
    HingeState,
    PinnedHinges,
    evaluate_geometry,
)
from rollingjoint.kernels.lanes import advance, own_search, solve_in, solve_wide, wide_memory
from rollingjoint.kernels.rubbed_block import advance_with_friction, fill_friction, inner_search, store_history
from rollingjoint.kernels.spatial_lanes import (
    evaluate_forces,
    fill_dead_inputs,
    fill_row_of_loads,
    lone_memory,
    sizes_of,
    store_equilibrium,
)
from rollingjoint.kernels.turns import evaluate_hinge_turns

MOST_HINGES = 32  # of a batch; beyond 28 a lone lane is faster by the O(n) step of the general solver


class HingeBlock(NamedTuple):
    """Inputs, state and scratch space of lanes; fields that are not Hinges' are as in rolling_lanes.Block."""

    state: HingeState
    law: TendonLaw
    loads: Annotated[Floats, "rows", N_DEAD]
    limits: Annotated[Floats, "J", 3]  # Hinges.joints
    axes: Annotated[Floats, "J", 3]
    springs: Annotated[Floats, "J"]
    spacings: Annotated[Floats, "J"]
    gaps: Annotated[Floats, "J", "m", 3]  # G, B, C
    channels: Annotated[Floats, "m"]
    L: Annotated[Floats, "J", "J"]
    vectors: Annotated[Floats, 6, "J"]
    search: Annotated[Floats, 8]


@formula(formulas.evaluate_lanes, HingeBlock)
def evaluate_lanes(block, chain, designs):
    """Fill the state at its angles; returns (energy, magnitude of its terms, force scale)."""
    state, tendon_joints = block.state, chain.tendon_joints
    evaluate_geometry(block.axes, block.spacings, block.gaps, block.channels, True, tendon_joints, state)
    return evaluate_forces(block, tendon_joints)


@formula(formulas.own_terms, HingeBlock)
def own_terms(block, i):
    """The hinge's spring."""
    return block.springs[i], 0.0


formula(formulas.fill_row_of_loads, HingeBlock)(fill_row_of_loads)
formula(formulas.advance, HingeBlock)(advance)
formula(formulas.search_of, HingeBlock)(own_search)


@formula(formulas.fill_row, HingeBlock)
def fill_row(block, batch, friction, lane, row, design):
    """Copy the inputs of a row into a lane; False where they need the general solver."""
    if design >= 0:
        fill_design(batch.chain, block, lane, design)
    return fill_inputs(batch, block, lane, row)


@part(inline=True)
def fill_inputs(batch, block, lane, row):
    """Copy one row's inputs into a lane; False where they need the general solver."""
    exact = batch.chain.model[batch.designs[row]] == EXACT
    return exact and fill_dead_inputs(batch, block, lane, row)


@part(inline=True)
def fill_design(chain, block, lane, design):
    """Copy a design into a lane."""
    limits, axes, gaps, channels = (
        numbers(block.limits),
        numbers(block.axes),
        numbers(block.gaps),
        numbers(block.channels),
    )
    springs, spacings = numbers(block.springs), numbers(block.spacings)
    for i in range(limits.shape[0]):
        springs[i, lane], spacings[i, lane] = chain.springs[design, i], chain.spacings[design, i]
        for k in range(3):
            limits[i, k, lane], axes[i, k, lane] = chain.joints[design, i, k], chain.axes[design, i, k]
            for j in range(channels.shape[0]):
                gaps[i, j, k, lane] = chain.gaps[design, i, j, k]
    for j in range(channels.shape[0]):
        channels[j, lane] = chain.channels[design, j]


@formula(formulas.fill_outputs, HingeBlock)
def fill_outputs(block, batch):
    """No outputs but those evaluated already."""


@formula(formulas.store_row, HingeBlock)
def store_row(block, batch, friction, lane, row):
    """Copy a lane that has arrived into its row."""
    store_lane(block, batch.results, lane, row)


@part(inline=True)
def store_lane(block, results, lane, row):
    """Copy an equilibrium into its row of the results."""
    store_equilibrium(block, results, lane, row)
    torque = numbers(block.state.torque)
    for i in range(torque.shape[0]):
        for j in range(torque.shape[1]):
            results.torques[row, i, j] = torque[i, j, lane]


@kernel(nogil=True, short_loops=True, title="the arm's solver")
def solve_hinges_pinned(pins, first, last):
    """Solve lanes first to last - 1 of PinnedHinges; returns the number left PENDING."""
    batch = unpin(pins, PinnedHinges).batch
    sizes = sizes_of(batch)
    return solve_wide(np.zeros(wide_memory(HingeBlock, sizes)), HingeBlock, sizes, batch, None, first, last)


@kernel(short_loops=True, title="the arm's solver of single chains")
def solve_hinges_alone(pins, first, last):
    """As solve_hinges_pinned in a single lane, one row after the other, in the batch's own memory."""
    batch, memory = unpin(pins, PinnedHinges)
    return solve_in(memory, HingeBlock, sizes_of(batch), batch, None, first, last)


def memory_alone(batch: HingeBatchArrays) -> np.ndarray:
    """The memory that solve_hinges_alone works in."""
    return lone_memory(HingeBlock, batch)


class RubbedHingeBlock(NamedTuple):
    """A HingeBlock with friction; fields that are not Hinges' are as in rolling_lanes.RubbedBlock."""

    block: HingeBlock
    law: FrictionLaw
    before: History
    now: Rubbing
    turns: Annotated[Floats, "J", "m", N_TURNS]
    symmetric: Annotated[Floats, "J", "J"]
    work: Annotated[Floats, 1]


formula(formulas.advance, RubbedHingeBlock)(advance_with_friction)
formula(formulas.search_of, RubbedHingeBlock)(inner_search)


@formula(formulas.evaluate_turns, RubbedHingeBlock)
def turns_of(rubbed, tendon_joints):
    """Fill turns and their rates."""
    evaluate_hinge_turns(rubbed.turns, tendon_joints, rubbed.block.state, rubbed.now.turn)


@formula(formulas.fill_row, RubbedHingeBlock)
def fill_row_with_friction(rubbed, batch, friction, lane, row, design):
    """Copy the inputs of a row into a lane; False where they need the general solver."""
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


@formula(formulas.fill_outputs, RubbedHingeBlock)
def fill_outputs_with_friction(rubbed, batch):
    """Fill the torques per tension at the motors, which friction reduces."""
    torque, now = rubbed.block.state.torque, rubbed.now
    for j in range(batch.chain.tendon_joints.size):
        for i in range(batch.chain.tendon_joints[j]):
            torque[i, j] = now.lever[i, j] * now.passed[i, j]


@formula(formulas.store_row, RubbedHingeBlock)
def store_row_with_friction(rubbed, batch, friction, lane, row):
    """Copy a lane that has arrived into its row."""
    store_lane(rubbed.block, batch.results, lane, row)
    store_history(rubbed, friction, lane, row)


@kernel(nogil=True, short_loops=True, title="the arm's solver with friction")
def step_hinges_side_by_side(chain, designs, laws, loads, starts, results, friction, first, last):
    """Solve the steps of rows first to last - 1; returns the number left PENDING."""
    batch = HingeBatchArrays(chain, designs, laws, loads, starts, results)
    sizes = sizes_of(batch)
    memory = np.zeros(wide_memory(RubbedHingeBlock, sizes))
    return solve_wide(memory, RubbedHingeBlock, sizes, batch, friction, first, last)
