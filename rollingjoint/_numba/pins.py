"""Pinned NamedTuples: addresses, shapes and numbers in one block, for kernels that are called on the same arrays again.

Passing an array costs a call 40 ns, passing the address of the block a fifth. The block begins with the hash of its
layout (layout.py), and a kernel that expects another layout raises WrongLayout before it reads anything else.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from rollingjoint._numba import bounds
from rollingjoint._numba.borrowed import INT, BorrowedType, make
from rollingjoint._numba.layout import borrowed_type, carved_type, check, flat, layout_hash, leaves
from rollingjoint._numba.views import carved
from rollingjoint.errors import InvalidInput


class WrongLayout(RuntimeError):
    """A kernel was given pins of another layout than the one that it expects."""


class Pinned:
    """The pins of a NamedTuple, and its arrays, kept alive: their numbers may change, their addresses do not.

    Raises:
        InvalidInput: an array that is not as the NamedTuple's class declares.
    """

    def __init__(self, value: Any) -> None:
        check(value)
        words = [layout_hash(type(value))]
        for leaf, item in zip(leaves(type(value)), flat(value), strict=True):
            if leaf.axes is None:
                words.append(int(np.float64(item).view(np.int64) if leaf.dtype.kind == "f" else item))
            else:
                words += item.ctypes.data, *item.shape
        self._kept, self._block = value, np.array(words, np.int64)
        self.address: int = self._block.ctypes.data

    def address_for(self, layout: type) -> int:
        """The address, for a kernel that expects this layout; raises InvalidInput if it is another one."""
        if layout_hash(layout) != self._block[0]:
            raise InvalidInput("pins of", type(self._kept).__name__, f"those of {layout.__name__}")
        return self.address


def _check_layout(context: Any, builder: Any, address: Any, cls: type) -> Any:
    """Have the kernel raise WrongLayout unless the block at the address begins with this layout's hash; the words."""
    zero, expected = ir.Constant(INT, 0), ir.Constant(INT, layout_hash(cls))
    words = builder.inttoptr(address, INT.as_pointer())
    message = (f"pins of another layout than {cls.__name__}",)
    with builder.if_then(builder.icmp_unsigned("==", address, zero), likely=False):
        context.call_conv.return_user_exc(builder, WrongLayout, message)
    with builder.if_then(builder.icmp_unsigned("!=", builder.load(words), expected), likely=False):
        context.call_conv.return_user_exc(builder, WrongLayout, message)
    return words


@intrinsic
def unpin(typing_context, address, layout):  # type: ignore[no-untyped-def]
    """In a kernel: the NamedTuple of this class, its arrays borrowed, from the address of its pins."""
    cls = layout.instance_class
    result = borrowed_type(cls)

    def lower(context, builder, sig, args):  # type: ignore[no-untyped-def]
        words = _check_layout(context, builder, args[0], cls)
        places = iter(range(1, 1 + sum(1 + len(leaf.axes or ()) for leaf in leaves(cls))))

        def word():  # type: ignore[no-untyped-def]
            return builder.load(builder.gep(words, [ir.Constant(INT, next(places))]))

        def read(kind):  # type: ignore[no-untyped-def]
            if isinstance(kind, types.BaseTuple):
                return context.make_tuple(builder, kind, [read(item) for item in kind.types])
            if isinstance(kind, BorrowedType):
                data = builder.inttoptr(word(), context.get_value_type(types.CPointer(kind.dtype)))
                return make(context, builder, kind, data, [word() for _ in range(kind.ndim)])
            if kind == types.float64:
                return builder.bitcast(word(), ir.DoubleType())
            return context.cast(builder, word(), types.int64, kind)

        return read(result)

    return result(address, layout), lower


@intrinsic
def call_range(typing_context, entry, pins, layout, first, last):  # type: ignore[no-untyped-def]
    """Call the kernel with its machine code at `entry` (`jit.entry_address`), kernel(pins, first, last) -> integer.

    So a kernel calls one of another package without compiling it a second time. `layout` is the class of the pins;
    another one raises WrongLayout. -1 where the kernel raised (no memory).
    """
    cls = layout.instance_class

    def lower(context, builder, sig, args):  # type: ignore[no-untyped-def]
        entry, pins, _, first, last = args
        _check_layout(context, builder, pins, cls)
        kind = context.call_conv.get_function_type(types.int64, (types.int64,) * 3)
        code = builder.inttoptr(entry, kind.as_pointer())
        status, result = context.call_conv.call_function(
            builder, code, types.int64, (types.int64,) * 3, (pins, first, last)
        )
        if bounds.CHECKED:
            with cgutils.if_unlikely(builder, status.is_error):
                context.call_conv.return_status_propagate(builder, status)
        return builder.select(status.is_ok, result, ir.Constant(INT, -1))

    return types.int64(types.int64, types.int64, layout, types.int64, types.int64), lower


@intrinsic
def next_uniform(typing_context, entry, source):  # type: ignore[no-untyped-def]
    """The next number in [0, 1) of a NumPy bit generator: its next_double at `entry`, its state at `source`."""

    def lower(context, builder, sig, args):  # type: ignore[no-untyped-def]
        byte = ir.IntType(8).as_pointer()
        code = builder.inttoptr(args[0], ir.FunctionType(ir.DoubleType(), [byte]).as_pointer())
        return builder.call(code, [builder.inttoptr(args[1], byte)])

    return types.float64(types.int64, types.int64), lower


def _sizes(context: Any, builder: Any, kind: Any, value: Any) -> dict[str, Any]:
    """Lengths of named axes, from a NamedTuple of them."""
    values = cgutils.unpack_tuple(builder, value)
    return {
        name: context.cast(builder, length, of, types.intp)
        for name, of, length in zip(kind.fields, kind.types, values, strict=True)
    }


def _shape(leaf: Any, sizes: dict[str, Any]) -> list[Any]:
    return [ir.Constant(INT, axis) if isinstance(axis, int) else sizes[axis] for axis in leaf.axes]


@intrinsic
def size_of(typing_context, layout, sizes):  # type: ignore[no-untyped-def]
    """Count of numbers in the arrays of a NamedTuple; sizes: a NamedTuple of the lengths of named axes."""
    cls = layout.instance_class

    def lower(context, builder, sig, args):  # type: ignore[no-untyped-def]
        lengths = _sizes(context, builder, sig.args[1], args[1])
        total = ir.Constant(INT, 0)
        for leaf in leaves(cls):
            size = ir.Constant(INT, math.prod(axis for axis in leaf.axes if isinstance(axis, int)))
            for axis in leaf.axes:
                size = size if isinstance(axis, int) else builder.mul(size, lengths[axis])
            total = builder.add(total, size)
        return total

    return types.intp(layout, sizes), lower


@intrinsic
def carve_tuple(typing_context, memory, at, layout, sizes):  # type: ignore[no-untyped-def]
    """A NamedTuple of arrays that lie one after another in one-dimensional memory, from its element `at` on.

    They have the memory's element type. sizes: as for `size_of`.
    """
    cls = layout.instance_class
    result = carved_type(cls, memory.dtype)

    def lower(context, builder, sig, args):  # type: ignore[no-untyped-def]
        lengths = _sizes(context, builder, sig.args[3], args[3])
        following = iter(leaves(cls))
        end = context.cast(builder, args[1], sig.args[1], types.intp)

        def take(kind):  # type: ignore[no-untyped-def]
            nonlocal end
            if isinstance(kind, types.BaseTuple):
                return context.make_tuple(builder, kind, [take(item) for item in kind.types])
            shape = _shape(next(following), lengths)
            array, end = carved(context, builder, kind, sig.args[0], args[0], end, shape)
            return array

        return take(result)

    return result(memory, at, layout, sizes), lower
