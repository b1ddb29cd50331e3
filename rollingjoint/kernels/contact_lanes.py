"""Chains in space with contacts in lanes (lanes.py): dead forces.

`solve_contacts_pinned` works on eight lanes of SIMD numbers, `solve_contacts_alone` on a single one of floats.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from rollingjoint._numba.jit import kernel, part
from rollingjoint._numba.layout import Floats
from rollingjoint._numba.pins import unpin
from rollingjoint._numba.views import as_rows, numbers
from rollingjoint.kernels import formulas
from rollingjoint.kernels.arrays import TendonLaw
from rollingjoint.kernels.contacts import (
    ContactBatchArrays,
    ContactState,
    PinnedContacts,
    evaluate_geometry,
    fill_reaction,
)
from rollingjoint.kernels.formulas import formula
from rollingjoint.kernels.hinges import N_DEAD, F
from rollingjoint.kernels.joints import evaluate_rows_of_lanes
from rollingjoint.kernels.lanes import advance, own_search, solve_in, solve_wide, wide_memory
from rollingjoint.kernels.spatial_lanes import (
    evaluate_forces,
    fill_dead_inputs,
    fill_row_of_loads,
    lone_memory,
    sizes_of,
    store_equilibrium,
)
from rollingjoint.kernels.spatial_loads import dead_moment
from rollingjoint.kernels.vectors import dot, in_space


class ContactBlock(NamedTuple):
    """Inputs, state and scratch space of lanes; fields that are not ContactJoints' are as in rolling_lanes.Block."""

    state: ContactState
    law: TendonLaw
    loads: Annotated[Floats, "rows", N_DEAD]
    limits: Annotated[Floats, "J", 3]  # ContactJoints.joints
    springs: Annotated[Floats, "J"]
    frames: Annotated[Floats, "J", 9]
    offsets: Annotated[Floats, "J", 2]
    holes: Annotated[Floats, "J", "m", 6]
    channels: Annotated[Floats, "m"]
    L: Annotated[Floats, "J", "J"]
    vectors: Annotated[Floats, 6, "J"]
    search: Annotated[Floats, 8]
    reactions: Annotated[Floats, "J", 6]
    rows: Annotated[Floats, 8]


@formula(formulas.evaluate_lanes, ContactBlock)
def evaluate_lanes(block, chain, designs):
    """Fill the state at its angles; returns (energy, magnitude of its terms, force scale)."""
    evaluate_rows_of_lanes(chain.lookup, chain, designs, block.state, as_rows(block.rows))
    evaluate_geometry(block.frames, block.offsets, block.holes, block.channels, chain.tendon_joints, block.state)
    return evaluate_forces(block, chain.tendon_joints)


@formula(formulas.own_terms, ContactBlock)
def own_terms(block, i):
    """The joint's spring, and its moving contact under the dead forces beyond it."""
    state = block.state
    return block.springs[i] + dot(in_space(state.normal, i, 0), in_space(state.sums, i, F)), 0.0


formula(formulas.fill_row_of_loads, ContactBlock)(fill_row_of_loads)
formula(formulas.advance, ContactBlock)(advance)
formula(formulas.search_of, ContactBlock)(own_search)


@formula(formulas.fill_row, ContactBlock)
def fill_row(block, batch, friction, lane, row, design):
    """Copy the inputs of a row into a lane; False where they need the general solver."""
    if design >= 0:
        _fill_design(batch.chain, block, lane, design)
    return fill_dead_inputs(batch, block, lane, row)


@part(inline=True)
def _fill_design(chain, block, lane, design):
    """Copy a design into a lane."""
    limits, frames, offsets = numbers(block.limits), numbers(block.frames), numbers(block.offsets)
    springs, holes, channels = numbers(block.springs), numbers(block.holes), numbers(block.channels)
    for i in range(limits.shape[0]):
        springs[i, lane] = chain.springs[design, i]
        for k in range(3):
            limits[i, k, lane] = chain.joints[design, i, k]
        for k in range(9):
            frames[i, k, lane] = chain.frames[design, i, k]
        for k in range(2):
            offsets[i, k, lane] = chain.offsets[design, i, k]
        for j in range(channels.shape[0]):
            for k in range(6):
                holes[i, j, k, lane] = chain.holes[design, i, j, k]
    for j in range(channels.shape[0]):
        channels[j, lane] = chain.channels[design, j]


@formula(formulas.fill_outputs, ContactBlock)
def fill_outputs(block, batch):
    """Fill the reactions of lanes that have arrived."""
    state = block.state
    constants = block.frames, block.offsets, block.holes, batch.chain.tendon_joints
    for i in range(state.angle.size):
        beyond = in_space(state.sums, i, F), dead_moment(state, i)
        fill_reaction(*constants, state, state.tension, *beyond, i, block.reactions[i])


@formula(formulas.store_row, ContactBlock)
def store_row(block, batch, friction, lane, row):
    """Copy a lane that has arrived into its row."""
    results, gap = batch.results, numbers(block.state.gap)
    store_equilibrium(block, results, lane, row)
    contacts, reactions = numbers(block.state.contact), numbers(block.reactions)
    for i in range(gap.shape[0]):
        for j in range(gap.shape[1]):
            results.torques[row, i, j] = gap[i, j, 1, lane]
        for a in range(3):
            results.contacts[row, i, a] = contacts[i, a, lane]
        for a in range(6):
            results.reactions[row, i, a] = reactions[i, a, lane]


@kernel(nogil=True, short_loops=True, title="the solver of chains in space")
def solve_contacts_pinned(pins, first, last):
    """Solve lanes first to last - 1 of PinnedContacts; returns the number left PENDING."""
    batch = unpin(pins, PinnedContacts).batch
    sizes = sizes_of(batch)
    return solve_wide(np.zeros(wide_memory(ContactBlock, sizes)), ContactBlock, sizes, batch, None, first, last)


@kernel(short_loops=True, title="the solver of single chains in space")
def solve_contacts_alone(pins, first, last):
    """As solve_contacts_pinned in a single lane, one row after the other, in the batch's own memory."""
    batch, memory = unpin(pins, PinnedContacts)
    return solve_in(memory, ContactBlock, sizes_of(batch), batch, None, first, last)


def memory_alone(batch: ContactBatchArrays) -> np.ndarray:
    """The memory that solve_contacts_alone works in."""
    return lone_memory(ContactBlock, batch)
