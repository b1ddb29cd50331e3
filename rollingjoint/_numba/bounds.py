"""The mode in which kernels check every index: ROLLINGJOINT_CHECK_BOUNDS=1 in the environment.

Borrowed arrays, carved memory and NumPy arrays are checked, and the arguments of machine code. The mode has separate
compiled kernels on disk; without it none of this is in the code.
"""

from __future__ import annotations

import ctypes
import os
import re
from typing import Any

import llvmlite.binding
from llvmlite import ir
from numba.core import cgutils

CHECKED = os.environ.get("ROLLINGJOINT_CHECK_BOUNDS", "0") not in ("", "0")

_INT = ir.IntType(64)
_SYMBOL = "rollingjoint_found_and_allowed"
_found_and_allowed = (ctypes.c_int64 * 2)()  # index of the last failed check in a kernel, and its bound


class OutOfRange(IndexError):
    """An index, or a piece of memory, out of range; raised by checked kernels."""

    def __init__(self, what: str) -> None:
        index, allowed = _found_and_allowed
        super().__init__(f"{what}: {index} is not in 0 ... {allowed - 1}")


def check_index(context: Any, builder: Any, number: Any, count: Any, what: str) -> None:
    """Have a checked kernel raise OutOfRange unless 0 <= number < count."""
    if not CHECKED:
        return
    with builder.if_then(builder.icmp_unsigned(">=", number, count), likely=False):
        module = builder.module
        kind = ir.ArrayType(_INT, 2)
        record = module.globals.get(_SYMBOL) or ir.GlobalVariable(module, kind, _SYMBOL)
        for place, value in enumerate((number, count)):
            builder.store(value, cgutils.gep_inbounds(builder, record, 0, place))
        context.call_conv.return_user_exc(builder, OutOfRange, (f"{what}, in {_function(builder)}",))


def check_room(context: Any, builder: Any, end: Any, count: Any, what: str) -> None:
    """Have a checked kernel raise OutOfRange unless 0 <= end <= count."""
    if CHECKED:
        check_index(context, builder, end, builder.add(count, ir.Constant(_INT, 1)), f"the end of {what}")


def _function(builder: Any) -> str:
    """The name of the function that is being compiled, from its symbol."""
    mangled, names = builder.function.name.removeprefix("_ZN"), []
    while size := re.match(r"\d+", mangled):
        end = size.end() + int(size.group())
        names.append(mangled[size.end() : end])
        mangled = mangled[end:]
    return ".".join(names) or builder.function.name


def _check_array(context: Any, builder: Any, ind: Any, dimlen: Any, axis: Any = None) -> None:
    check_index(
        context, builder, ind, dimlen, "an axis of a NumPy array" if axis is None else f"axis {axis} of an array"
    )


if CHECKED:
    llvmlite.binding.add_symbol(_SYMBOL, ctypes.addressof(_found_and_allowed))
    cgutils.do_boundscheck = _check_array  # numba's check does not name the index
