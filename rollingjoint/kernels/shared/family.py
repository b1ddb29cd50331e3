"""Parts of one mechanism family, compiled against the functions of another.

numba cannot take functions as arguments without losing its disk cache, and a layer between Newton's method and the
formulas of a family would cost the planar chains time. So the source is shared, and each family has machine code of
its own from it.
"""

from __future__ import annotations

from types import FunctionType
from typing import Any

from rollingjoint._numba.jit import part


def rebound(piece: Any, **names: Any) -> Any:
    """The same part with other values for some of the global names that it uses."""
    function = piece.py_func
    code = FunctionType(function.__code__, {**function.__globals__, **names}, function.__name__)
    return part(code)
