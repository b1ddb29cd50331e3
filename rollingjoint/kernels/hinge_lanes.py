"""Arms with exact tendons in lanes (lanes.py, rubbed_block.py): dead forces, and friction.

`solve_hinges_pinned` and `step_hinges_side_by_side` work on eight lanes of SIMD numbers, `solve_hinges_alone` on a
single one of floats.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from rollingjoint._numba.jit import kernel, part
from rollingjoint._numba.layout import Floats, size
from rollingjoint._numba.pins import unpin
from rollingjoint._numba.simd import where
from rollingjoint._numba.views import numbers
from rollingjoint.kernels import formulas
from rollingjoint.kernels.arrays import AT_LIMIT, CONVERGED, TendonLaw
from rollingjoint.kernels.formulas import formula
from rollingjoint.kernels.friction import FrictionLaw, History, Rubbing
from rollingjoint.kernels.hinges import (
    EXACT,
    N_DEAD,
    N_DEAD_SUMS,
    N_TURNS,
    PX,
    HingeBatchArrays,
    HingeState,
    PinnedHinges,
    evaluate_geometry,
    evaluate_hinges,
)
from rollingjoint.kernels.lanes import (
    HELD,
    STEPS,
    WORST,
    advance,
    fill_law,
    fill_start,
    own_search,
    solve_in,
    solve_wide,
    wide_memory,
)
from rollingjoint.kernels.rubbed_block import advance_with_friction, fill_friction, inner_search, store_history
from rollingjoint.kernels.spatial_loads import any_spring, dead_moment, evaluate_dead_loads, fill_dead_loads, lever
from rollingjoint.kernels.tendons import evaluate_tendons, fill_residual
from rollingjoint.kernels.turns import evaluate_hinge_turns
from rollingjoint.kernels.vectors import dot, in_space

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


class HingeBlockSizes(NamedTuple):
    """Lengths of the axes of a HingeBlock."""

    J: int
    n: int
    m: int
    rows: int
    sums: int
    held: int


@part(inline=True)
def block_sizes(n_joints, n_tendons, n_loads):
    """Sizes of a HingeBlock."""
    return HingeBlockSizes(n_joints, n_joints + 1, n_tendons, n_loads, N_DEAD_SUMS, 0)


@formula(formulas.evaluate_lanes, HingeBlock)
def evaluate_lanes(block, chain, designs):
    """Fill the state at its angles; returns (energy, magnitude of its terms, force scale)."""
    state, tendon_joints = block.state, chain.tendon_joints
    evaluate_geometry(block.axes, block.spacings, block.gaps, block.channels, True, tendon_joints, state)
    energy, magnitude = evaluate_tendons(block.law, state)
    load_energy, load_magnitude = evaluate_dead_loads(block.loads, state)
    spring_energy = evaluate_hinges(block.limits, block.springs, state)
    scale = 0.0 * state.angle[0]
    for i in range(state.angle.size):
        moment = dot(in_space(state.axis, i, 0), dead_moment(state, i))
        spring = block.springs[i] * (state.angle[i] - block.limits[i, 2])
        size = fill_residual(tendon_joints, state, i, spring, moment)
        scale = where(size > scale, size, scale)
    magnitude = magnitude + (load_magnitude + spring_energy)
    return energy + (load_energy + spring_energy), magnitude, scale


@formula(formulas.fill_row_of_loads, HingeBlock)
def fill_row_of_loads(block, i, H):
    """Fill row i of H with the terms of dead forces; returns their term on the diagonal."""
    axis, w = block.state.axis, lever(block.state, i)
    for m in range(i):
        H[i, m] = -dot(in_space(axis, m, 0), w)
    return -dot(in_space(axis, i, 0), w)


@formula(formulas.own_terms, HingeBlock)
def own_terms(block, i):
    """The hinge's spring."""
    return block.springs[i], 0.0


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
    chain, design = batch.chain, batch.designs[row]
    supported = chain.model[design] == EXACT and not any_spring(chain.standing[design])
    supported = supported and fill_law(batch.laws, block, lane, row)
    supported = supported and fill_dead_loads(batch.loads[row], numbers(block.loads), lane)
    return supported and fill_start(batch.starts, block, lane, row)


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
    search, state, torque = numbers(block.search), block.state, numbers(block.state.torque)
    angle, pose, gap = numbers(state.angle), numbers(state.pose), numbers(state.gap)
    tension, length, elastic = numbers(state.tension), numbers(state.length), numbers(state.elastic)
    for i in range(angle.shape[0]):
        results.joint_angles[row, i] = angle[i, lane]
        for j in range(tension.shape[0]):
            results.rates[row, i, j], results.torques[row, i, j] = gap[i, j, 1, lane], torque[i, j, lane]
    for k in range(pose.shape[0]):
        for a in range(3):
            for b in range(3):
                results.poses[row, k, a, b] = pose[k, 3 * a + b, lane]
            results.poses[row, k, a, 3], results.poses[row, k, 3, a] = pose[k, PX + a, lane], 0.0
        results.poses[row, k, 3, 3] = 1.0
    for j in range(tension.shape[0]):
        results.tensions[row, j], results.lengths[row, j] = tension[j, lane], length[j, lane]
        results.elastic[row, j] = elastic[j, lane]
    results.residual[row], results.iterations[row] = search[WORST, lane], int(search[STEPS, lane])
    results.status[row] = AT_LIMIT if search[HELD, lane] > 0.0 else CONVERGED
    results.escapes[row] = 0


@kernel(nogil=True, short_loops=True, title="the arm's solver")
def solve_hinges_pinned(pins, first, last):
    """Solve lanes first to last - 1 of PinnedHinges; returns the number left PENDING."""
    batch = unpin(pins, PinnedHinges).batch
    sizes = block_sizes(batch.starts.shape[1], batch.chain.tendon_joints.size, batch.loads.shape[1])
    return solve_wide(np.zeros(wide_memory(HingeBlock, sizes)), HingeBlock, sizes, batch, None, first, last)


@kernel(short_loops=True, title="the arm's solver of single chains")
def solve_hinges_alone(pins, first, last):
    """As solve_hinges_pinned in a single lane, one row after the other, in the batch's own memory."""
    batch, memory = unpin(pins, PinnedHinges)
    sizes = block_sizes(batch.starts.shape[1], batch.chain.tendon_joints.size, batch.loads.shape[1])
    return solve_in(memory, HingeBlock, sizes, batch, None, first, last)


def memory_alone(batch: HingeBatchArrays) -> np.ndarray:
    """The memory that solve_hinges_alone works in."""
    (_, n_joints), rows, m = batch.starts.shape, batch.loads.shape[1], len(batch.chain.tendon_joints)
    lengths = HingeBlockSizes(n_joints, n_joints + 1, m, rows, N_DEAD_SUMS, 0)._asdict()
    return np.zeros(size(HingeBlock, lengths) + 2)


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
    sizes = block_sizes(starts.shape[1], chain.tendon_joints.size, loads.shape[1])
    batch = HingeBatchArrays(chain, designs, laws, loads, starts, results)
    memory = np.zeros(wide_memory(RubbedHingeBlock, sizes))
    return solve_wide(memory, RubbedHingeBlock, sizes, batch, friction, first, last)
