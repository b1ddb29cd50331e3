"""How kernels are optimised."""

import numpy as np
import pytest

from rollingjoint._numba.bounds import CHECKED
from rollingjoint._numba.jit import kernel


def triple(values):
    for i in range(values.size):
        values[i] = 3.0 * values[i]


@pytest.mark.skipif(CHECKED, reason="a check of every index keeps LLVM from vectorising any loop")
def test_only_short_loops_stay_as_they_are_written():
    code = {}
    for short in (False, True):
        values = np.arange(100.0)
        compiled = kernel(triple, short_loops=short)
        compiled(values)
        np.testing.assert_array_equal(values, 3.0 * np.arange(100.0))
        (code[short],) = compiled.inspect_llvm().values()
        compiled._cache.flush()  # code from disk cannot be inspected
    assert "x double>" in code[False] and "x double>" not in code[True]
