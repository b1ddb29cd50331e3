"""Planar chains among walls in a lane of its own (lanes.py): dead forces, compliant walls, no friction.

Walls have too many branches for SIMD lanes. A single lane of floats spares the general solver's detours all the same.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from rollingjoint._numba.borrowed import borrow, pointed
from rollingjoint._numba.jit import kernel, part
from rollingjoint._numba.layout import Floats, size
from rollingjoint._numba.pins import carve_tuple, size_of, unpin
from rollingjoint._numba.views import as_rows, carve, integers
from rollingjoint.kernels import formulas, lanes
from rollingjoint.kernels.arrays import PASSED_THROUGH, TendonLaw, all_resolvable
from rollingjoint.kernels.formulas import formula
from rollingjoint.kernels.joints import aligned, evaluate_rows_of_lanes
from rollingjoint.kernels.lanes import PART, PHASE, RUNNING, STEPS, solve_rows
from rollingjoint.kernels.planar_loads import evaluate_dead_loads, fill_dead_stiffness, n_rows
from rollingjoint.kernels.rolling import BatchArrays, State, evaluate_poses, evaluate_residual
from rollingjoint.kernels.rolling_lanes import (
    Block,
    block_sizes,
    fill_design,
    fill_inputs,
    fill_outputs,
    memory_alone,
    own_terms,
    store_lane,
)
from rollingjoint.kernels.seen_walls import Seen
from rollingjoint.kernels.tendons import evaluate_tendons
from rollingjoint.kernels.wall_contacts import LONGEST_MOVE, PRESSING, ContactMemory, Touch, Touched, contact_sizes
from rollingjoint.kernels.walled_chain import add_walls, farthest_move, from_the_left, passes
from rollingjoint.kernels.walled_solve import WallArrays, begin_place, has_jumped, store_walls


class WalledBlock(NamedTuple):
    """A Block of a single lane, field by field, and the walls around it."""

    state: State
    law: TendonLaw
    loads: Floats
    limits: Floats
    holes: Floats
    channels: Floats
    L: Floats
    vectors: Floats
    search: Floats
    forces: Floats
    responses: Floats
    rows: Floats
    place: ContactMemory  # pointed: the block goes from function to function word by word


class _AtWalls(NamedTuple):
    """What the contact with walls is evaluated from."""

    walls: Seen
    before: Touched  # of no effect without friction
    touch: Touch


class PinnedAmong(NamedTuple):
    """A batch among walls as kernels take it that are called again and again."""

    batch: BatchArrays
    walls: WallArrays
    memory: Annotated[Floats, "words"]  # scratch space of a batch of one row; else empty


formula(formulas.own_terms, WalledBlock)(own_terms.py_func)
formula(formulas.fill_outputs, WalledBlock)(fill_outputs.py_func)

_advance = part(lanes.advance)


@formula(formulas.evaluate_lanes, WalledBlock)
def evaluate_among(block, chain, designs):
    """Fill the state at its angles; returns (energy, magnitude of its terms, force scale)."""
    state = block.state
    evaluate_rows_of_lanes(chain.joints, chain, designs, state, as_rows(block.rows))
    evaluate_poses(block.holes, block.channels, chain.tendon_joints, state)
    energy, magnitude = evaluate_tendons(block.law, state)
    load_energy, load_magnitude = evaluate_dead_loads(block.loads, state)
    touch = block.place.touch
    among = _AtWalls(block.place.seen, Touched(touch.states, touch.slips, touch.sides, touch.normals), touch)
    wall_energy, wall_magnitude = add_walls(among, pointed(state))
    energy, magnitude = energy + load_energy + wall_energy, magnitude + load_magnitude + wall_magnitude
    return energy, magnitude, evaluate_residual(chain.tendon_joints, state)


@formula(formulas.fill_row_of_loads, WalledBlock)
def fill_row_of_loads(block, i, H):
    """Fill row i of H with the terms of loads and walls; returns their term on the diagonal."""
    contact = block.state.contact
    lever = fill_dead_stiffness(block.loads, block.state, i, H)
    if block.place.touch.how[PRESSING] == 0.0:
        return lever
    lx, ly, lm = from_the_left(block.place.touch.sums, i, contact[i, 0], contact[i, 1])
    for m in range(i):
        H[i, m] += lx * contact[m, 1] - ly * contact[m, 0] + lm
    return lever + (lx * contact[i, 1] - ly * contact[i, 0] + lm)


@formula(formulas.advance, WalledBlock)
def advance(block, chain, designs):
    """As lanes.advance; a step that would move a link too far is shortened."""
    ended = _advance(block, chain, designs)
    search, step, limits, angle, origin = (
        block.search,
        block.vectors[1],
        block.limits,
        block.state.angle,
        block.vectors[3],
    )
    if search[PHASE] == RUNNING and search[PART] == 1.0:
        if search[STEPS] == 0.0:
            for i in range(step.size):
                block.place.touch.tangent[i] = step[i]
        farthest = farthest_move(block.state, step)
        if farthest > LONGEST_MOVE:
            for i in range(step.size):
                step[i] *= LONGEST_MOVE / farthest
                angle[i] = min(max(origin[i] + step[i], limits[i, 0]), limits[i, 1])
    return ended


@formula(formulas.fill_row, WalledBlock)
def fill_row(block, batch, walls, lane, row, design):
    """Copy the inputs of a row into the lane; False where they need the general solver."""
    if walls.walls.rigid[walls.which[row]] > 0.0 or not all_resolvable(walls.bases[row]):
        return False
    if design >= 0:
        fill_design(batch.chain, block, lane, design)
    begin_place(walls, row, True, block.place)
    standing = batch.chain.standing[batch.designs[row]]
    return fill_inputs(batch.laws, standing, batch.loads, batch.starts, block, lane, row)


@formula(formulas.store_row, WalledBlock)
def store_row(block, batch, walls, lane, row):
    """Copy a lane that has arrived into its row."""
    place, state = block.place, pointed(block.state)
    passed = passes(place, state, walls, row)
    store_lane(block, lane, batch.results, row)
    if passed:
        batch.results.status[row] = PASSED_THROUGH
    store_walls(place.touch, state, walls, row)
    walls.jumped[row] = has_jumped(place.touch, batch.starts[row], state)


@kernel(nogil=True, short_loops=True, title="the solver among walls in a lane")
def solve_among_in_lane(pins, first, last):
    """Solve lanes first to last - 1 of a PinnedAmong, one after the other; returns the number left PENDING."""
    batch, walls, memory = unpin(pins, PinnedAmong)
    sizes = block_sizes(batch.starts.shape[1], batch.chain.tendon_joints.size, n_rows(batch.chain, batch.loads))
    of_walls = contact_sizes(walls.walls, batch.starts.shape[1])
    words = size_of(Block, sizes) + size_of(ContactMemory, of_walls) + 2
    more = np.zeros(words if memory.size == 0 else 0)
    return _solve_range(more, memory, sizes, of_walls, batch, pointed(walls), first, last)


@part
def _solve_range(more, memory, sizes, of_walls, batch, walls, first, last):
    space, end = borrow(more) if memory.size == 0 else memory, size_of(Block, sizes)
    place = pointed(carve_tuple(space, end, ContactMemory, of_walls))
    own = carve_tuple(space, 0, Block, sizes)
    of_chain = own.state, own.law, own.loads, own.limits, own.holes, own.channels
    block = WalledBlock(*of_chain, own.L, own.vectors, own.search, own.forces, own.responses, own.rows, place)
    end += size_of(ContactMemory, of_walls)
    rows, loaded = integers(carve(space, end, (1,))), integers(carve(space, end + 1, (1,)))
    return solve_rows(block, block.search, batch, walls, rows, loaded, first, last)


def memory_among_walls(batch: BatchArrays, walls: WallArrays) -> np.ndarray:
    """The memory that solve_among_in_lane works in, for a batch of one row."""
    of_walls = contact_sizes.py_func(walls.walls, batch.starts.shape[1])._asdict()
    return aligned(np.zeros(memory_alone(batch).size + size(ContactMemory, of_walls)))
