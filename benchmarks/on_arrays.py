"""The solver of eight lanes as a kernel on arrays: what pins are compared with (compiled_layer.py)."""

from __future__ import annotations

import numpy as np

from rollingjoint._numba.jit import kernel
from rollingjoint.kernels.lanes import solve_wide, wide_memory
from rollingjoint.kernels.planar_loads import n_rows
from rollingjoint.kernels.rolling import BatchArrays
from rollingjoint.kernels.rolling_lanes import Block, block_sizes


@kernel(nogil=True, title="the planar solver on arrays")
def solve_on_arrays(chain, designs, laws, loads, starts, results, first, last):
    """Solve lanes first to last - 1; returns how many are PENDING."""
    sizes = block_sizes(starts.shape[1], chain.tendon_joints.size, n_rows(chain, loads))
    memory, batch = np.zeros(wide_memory(Block, sizes)), BatchArrays(chain, designs, laws, loads, starts, results)
    return solve_wide(memory, Block, sizes, batch, None, first, last)
