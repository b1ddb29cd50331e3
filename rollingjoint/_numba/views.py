"""Other views of borrowed memory: as SIMD lanes, as numbers, as rows of a table; arrays carved out of it."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from rollingjoint._numba import bounds
from rollingjoint._numba.borrowed import INT, BorrowedType, make, pointer_and_shape
from rollingjoint._numba.simd import COLUMNS, WIDTH, row_type, simd_type, width_of


def _number(count: int) -> Any:
    return ir.Constant(INT, count)


def _viewed(typing_context: Any, array: Any, dtype: Any, lengths: tuple[int | None, ...], change: Any) -> Any:
    """The signature and code of an intrinsic: the same memory, of another type; `change` gives shape from shape."""
    result = BorrowedType(dtype, lengths)

    def lower(context, builder, sig, args):  # type: ignore[no-untyped-def]
        data, shape = pointer_and_shape(builder, sig.args[0], args[0])
        return make(context, builder, result, data, change(context, builder, shape))

    return result, lower


def _eight_as_one(dtype: Any) -> Any:
    @intrinsic
    def view(typing_context, array):  # type: ignore[no-untyped-def]
        def change(context, builder, shape):  # type: ignore[no-untyped-def]
            bounds.check_room(context, builder, _number(WIDTH), shape[-1], f"eight numbers in {array}")
            return shape[:-1]

        result, lower = _viewed(typing_context, array, dtype, array.lengths[:-1], change)
        return result(array), lower

    return view


def _one_per_lane(dtype: Any, size: int) -> Any:
    @intrinsic
    def view(typing_context, array):  # type: ignore[no-untyped-def]
        def change(context, builder, shape):  # type: ignore[no-untyped-def]
            bounds.check_room(context, builder, _number(size), shape[0], f"{size} in {array}")
            return [_number(width)]

        width = width_of(array.dtype)
        result, lower = _viewed(typing_context, array, dtype, (width,), change)
        return result(array), lower

    return view


as_simd, table_rows = map(_eight_as_one, (simd_type, row_type))  # of borrowed floats (..., 8): (...) of SIMD, of rows
as_rows = _one_per_lane(row_type, COLUMNS)  # a row per lane, in memory of eight numbers of all lanes
integers = _one_per_lane(types.int64, 1)  # an integer per lane, in memory of one number of all lanes


@intrinsic
def numbers(typing_context, array):  # type: ignore[no-untyped-def]
    """A borrowed array of SIMD numbers (...) as one of floats (..., 8), or one of floats (...) as (..., 1)."""
    width = width_of(array.dtype)
    lengths = (*array.lengths, width)
    change = lambda context, builder, shape: [*shape, _number(width)]  # noqa: E731
    result, lower = _viewed(typing_context, array, types.float64, lengths, change)
    return result(array), lower


@intrinsic(prefer_literal=True)
def of_width(typing_context, array, width):  # type: ignore[no-untyped-def]
    """A borrowed array with a last axis of this length, known to the compiler: its index is a shift, no product."""
    if not isinstance(width, types.IntegerLiteral):
        return None

    def change(context, builder, shape):  # type: ignore[no-untyped-def]
        bounds.check_room(context, builder, _number(width.literal_value), shape[-1], f"the last axis of {array}")
        return shape

    lengths = (*array.lengths[:-1], width.literal_value)
    result, lower = _viewed(typing_context, array, array.dtype, lengths, change)
    return result(array, width), lower


@intrinsic
def aligned_simd(typing_context, memory):  # type: ignore[no-untyped-def]
    """One-dimensional memory of floats as SIMD numbers from its first address that is a multiple of their size.

    Those that straddle two cache lines cost twice the time.
    """
    result = BorrowedType(simd_type, (None,))

    def lower(context, builder, sig, args):  # type: ignore[no-untyped-def]
        data, (count,) = pointer_and_shape(builder, sig.args[0], args[0])
        size = _number(8 * WIDTH)
        address = builder.ptrtoint(data, INT)
        offset = builder.urem(builder.neg(address), size)
        start = builder.inttoptr(builder.add(address, offset), data.type)
        n_bytes = builder.sub(builder.mul(count, _number(8)), offset)
        return make(context, builder, result, start, [builder.udiv(n_bytes, size)])

    return result(memory), lower


def carved(context: Any, builder: Any, result: Any, memory: Any, value: Any, at: Any, shape: Any) -> tuple[Any, Any]:
    """An array in memory from `at` on, in the code of a kernel, and the index after its last element."""
    data, (count,) = pointer_and_shape(builder, memory, value)
    size = _number(1)
    for length in shape:
        size = builder.mul(size, length)
    end = builder.add(at, size)
    bounds.check_room(context, builder, end, count, f"what is carved from {memory}")
    return make(context, builder, result, builder.gep(data, [at]), shape), end


@intrinsic
def singles_at(typing_context, address, shape):  # type: ignore[no-untyped-def]
    """Numbers of 32 bits at an address, an array of a shape (a tuple); whoever passes the address keeps them alive."""
    result = BorrowedType(types.float32, (None,) * len(shape))

    def lower(context, builder, sig, args):  # type: ignore[no-untyped-def]
        data = builder.inttoptr(args[0], context.get_value_type(types.CPointer(types.float32)))
        return make(context, builder, result, data, cgutils.unpack_tuple(builder, args[1]))

    return result(address, shape), lower


@intrinsic(prefer_literal=True)
def carve(typing_context, memory, at, shape):  # type: ignore[no-untyped-def]
    """An array of a shape (a tuple) from the elements of one-dimensional memory that begin at `at`."""
    lengths = tuple(n.literal_value if isinstance(n, types.IntegerLiteral) else None for n in shape)
    result = BorrowedType(memory.dtype, lengths)

    def lower(context, builder, sig, args):  # type: ignore[no-untyped-def]
        start = context.cast(builder, args[1], sig.args[1], types.intp)
        counts = zip(cgutils.unpack_tuple(builder, args[2]), sig.args[2], strict=True)
        shape = [context.cast(builder, n, kind, types.intp) for n, kind in counts]
        return carved(context, builder, result, sig.args[0], args[0], start, shape)[0]

    return result(memory, at, shape), lower
