"""Forces of walls on every link at equilibria, and their rates: contact as a linear law of the motion of links."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rollingjoint._numba.borrowed import borrow, pointed
from rollingjoint._numba.jit import kernel, machine_code, part
from rollingjoint._numba.layout import Floats, Integers
from rollingjoint._numba.pins import carve_tuple, size_of
from rollingjoint.chain.solution import Solution
from rollingjoint.errors import InvalidInput
from rollingjoint.kernels import formulas
from rollingjoint.kernels.wall_contacts import (
    N_SUMS,
    SUM_S,
    ContactMemory,
    begin_rubbing,
    contact_sizes,
    touch_walls,
)
from rollingjoint.kernels.walled_solve import WallArrays, begin_place

Array = NDArray[np.float64]


class LinkContact(NamedTuple):
    """Forces of walls on the links of B chains, in the frame of the base.

    Fields: forces, (B, n, 4), x, y, moment about the origin, and point · force [N, N·mm]; rates, (B, n, 3, 3), minus
    the derivative of force and moment by the link's motion, the velocity of its body point at the origin, and its turn,
    at the same points of the base frame: that the points move with the link is not in it.
    """

    forces: Array
    rates: Array


def link_contact(solution: Solution) -> LinkContact:
    """Contact at the equilibria of a batch, (B,); zero for one without walls.

    After a step with friction, contacts that stick go on sticking, and the others sliding.

    Raises:
        InvalidInput: rigid walls.
    """
    angles = np.ascontiguousarray(solution.joint_angles, float)
    count, joints = angles.shape
    sums = np.zeros((count, joints, N_SUMS))
    step = solution.walls
    if step is not None:
        if np.any(step.walls.rigid > 0.0):
            raise InvalidInput("walls", "rigid", "compliant walls", "Give them a stiffness.")
        chain, rows = solution._designs
        arrays, rubs = step.arrays(joints), float(step.memory is not None)
        kinds = type(chain), Annotated[Integers, "B"], Annotated[Floats, "B", "i"], float, WallArrays
        fill = machine_code(wall_sums_of, *kinds, Annotated[Floats, "B", "i", "k"])
        fill(chain, rows, angles, rubs, arrays, sums)
    every = np.pad(sums, ((0, 0), (1, 0), (0, 0)))
    return LinkContact(-every[..., :SUM_S], every[..., SUM_S:].reshape(count, joints + 1, 3, 3))


@kernel(short_loops=True, title="the contact of links")
def wall_sums_of(chain, designs, angles, rubs, walls, sums):
    """Fill the sums of contact of every link, (B, J, N_SUMS), at joint angles (B, J) after steps that left a memory.

    rubs: 1 after steps with friction at the walls, else 0.
    """
    sizes = contact_sizes(walls.walls, angles.shape[1])
    memory = np.zeros(size_of(ContactMemory, sizes))
    state = formulas.new_state(chain, sizes.J, chain.tendon_joints.size)
    _sums_each(chain, designs, angles, rubs, walls, sums, state, memory, sizes)


@part
def _sums_each(chain, designs, angles, rubs, walls, sums, state, space, sizes):
    chain, state, walls, angles = borrow(chain), pointed(borrow(state)), borrow(walls), borrow(angles)
    designs, sums = borrow(designs), borrow(sums)
    place = pointed(carve_tuple(borrow(space), 0, ContactMemory, sizes))
    touch = place.touch
    for lane in range(angles.shape[0]):
        mechanism = pointed(formulas.design(chain, designs[lane]))
        for i in range(state.angle.size):
            state.angle[i] = angles[lane, i]
        begin_place(walls, lane, True, place)
        begin_rubbing(touch, rubs)
        formulas.evaluate_geometry(mechanism, state)
        among = formulas.walled(place, mechanism, pointed(formulas.touched_of(walls.before, lane)))
        touch_walls(among, state, False)
        for i in range(sums.shape[1]):
            for column in range(sums.shape[2]):
                sums[lane, i, column] = touch.sums[i, column]
