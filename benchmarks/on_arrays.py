"""The solver of eight lanes as a kernel on arrays: what pins are compared with (compiled_layer.py)."""

from __future__ import annotations

import numpy as np

from rollingjoint._numba.jit import kernel
from rollingjoint._numba.pins import size_of
from rollingjoint._numba.simd import WIDTH
from rollingjoint.kernels.planar.arrays import BatchArrays
from rollingjoint.kernels.planar.block import Block, block_sizes
from rollingjoint.kernels.planar.loads import n_rows
from rollingjoint.kernels.planar.side_by_side import _solve_in


@kernel(nogil=True, title="the planar solver on arrays")
def solve_on_arrays(chain, designs, laws, loads, starts, results, first, last):
    """Solve lanes first to last - 1; returns how many are PENDING."""
    sizes = block_sizes(starts.shape[1], chain.tendon_joints.size, n_rows(chain, loads))
    memory = np.zeros((size_of(Block, sizes) + 3) * WIDTH)
    return _solve_in(memory, sizes, BatchArrays(chain, designs, laws, loads, starts, results), first, last)
