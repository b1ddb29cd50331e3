"""Contiguous arrays that kernels borrow: a pointer and a shape, without the reference counts of NumPy arrays.

Counting references costs more than the arithmetic of a short kernel. The entry kernel borrows from its arguments, which
outlive the call; everything below works on borrowed arrays of floats, of integers or of Lanes (simd.py). Indexing with
fewer numbers than axes gives the rest; there are no bounds checks and no slices.
"""

from __future__ import annotations

import operator
from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.core.typing.templates import AbstractTemplate, AttributeTemplate, infer_getattr, infer_global, signature
from numba.extending import intrinsic, lower_builtin, lower_getattr, models, register_model
from numpy.typing import NDArray

from rollingjoint._numba.simd import WIDTH, lanes_type, row_type

_INT = ir.IntType(64)


class _BorrowedType(types.Type):
    """A borrowed array of floats, integers or Lanes; lengths of axes that are known when it is compiled, else None."""

    def __init__(self, dtype: Any, lengths: tuple[int | None, ...]) -> None:
        self.dtype, self.lengths, self.ndim = dtype, lengths, len(lengths)
        super().__init__(name=f"Borrowed({dtype}, {lengths})")


@register_model(_BorrowedType)
class _BorrowedModel(models.StructModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        shape = [(f"n{axis}", types.intp) for axis in range(kind.ndim)]
        super().__init__(manager, kind, [("data", types.CPointer(kind.dtype)), *shape])


def _make(context: Any, builder: Any, kind: Any, data: Any, shape: Any) -> Any:
    value = cgutils.create_struct_proxy(kind)(context, builder)
    value.data = builder.bitcast(data, value.data.type)
    for axis, count in enumerate(shape):
        setattr(value, f"n{axis}", count)
    return value._getvalue()


def _parts(builder: Any, kind: Any, value: Any) -> tuple[Any, list[Any]]:
    """Pointer and shape."""
    shape = [
        builder.extract_value(value, 1 + axis) if length is None else ir.Constant(_INT, length)
        for axis, length in enumerate(kind.lengths)
    ]
    return builder.extract_value(value, 0), shape


def _is_index(kind: Any) -> bool:
    return isinstance(kind, types.Integer | types.IntegerLiteral)


def _index_kinds(index: Any) -> list[Any] | None:
    """Types of the numbers of an index; None for anything else."""
    kinds = list(index) if isinstance(index, types.BaseTuple) else [index]
    return kinds if all(map(_is_index, kinds)) else None


@infer_global(operator.getitem)
class _GetItem(AbstractTemplate):  # type: ignore[misc]
    def generic(self, args: Any, keywords: Any) -> Any:
        array, index = args
        kinds = _index_kinds(index) if isinstance(array, _BorrowedType) else None
        if kinds is None or len(kinds) > array.ndim:
            return None
        rest = array.lengths[len(kinds) :]
        return signature(_BorrowedType(array.dtype, rest) if rest else array.dtype, array, index)


@infer_global(operator.setitem)
class _SetItem(AbstractTemplate):  # type: ignore[misc]
    def generic(self, args: Any, keywords: Any) -> Any:
        array, index, _ = args
        kinds = _index_kinds(index) if isinstance(array, _BorrowedType) else None
        if kinds is None or len(kinds) != array.ndim:
            return None
        return signature(types.none, array, index, array.dtype)


def _element(context: Any, builder: Any, sig: Any, args: Any) -> tuple[Any, list[Any]]:
    """Pointer to what an index names, and the shape of it."""
    array, index = sig.args[:2]
    data, shape = _parts(builder, array, args[0])
    if isinstance(index, types.BaseTuple):
        numbers = list(zip(cgutils.unpack_tuple(builder, args[1]), index, strict=True))
    else:
        numbers = [(args[1], index)]
    at = None
    for axis, (number, kind) in enumerate(numbers):
        number = context.cast(builder, number, kind, types.intp)
        at = number if at is None else builder.add(builder.mul(at, shape[axis]), number)
    for count in shape[len(numbers) :]:
        at = builder.mul(at, count)
    return builder.gep(data, [at]), shape[len(numbers) :]


def _get(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    pointer, rest = _element(context, builder, sig, args)
    if rest:
        return _make(context, builder, sig.return_type, pointer, rest)
    value = builder.load(pointer)
    if sig.return_type == types.boolean:
        return builder.trunc(value, ir.IntType(1))
    value.align = 8
    return value


def _set(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    pointer, _ = _element(context, builder, sig, args)
    value = context.cast(builder, args[2], sig.args[2], sig.args[0].dtype)
    if sig.args[0].dtype == types.boolean:
        builder.store(context.get_value_as_data(builder, types.boolean, value), pointer)
    else:
        builder.store(value, pointer).align = 8
    return context.get_dummy_value()


for _index in (types.Integer, types.BaseTuple):
    lower_builtin(operator.getitem, _BorrowedType, _index)(_get)
    lower_builtin(operator.setitem, _BorrowedType, _index, types.Any)(_set)


@infer_getattr
class _Attributes(AttributeTemplate):  # type: ignore[misc]
    key = _BorrowedType

    def resolve_shape(self, array: Any) -> Any:
        return types.UniTuple(types.intp, array.ndim)

    def resolve_size(self, array: Any) -> Any:
        return types.intp if array.ndim == 1 else None


@lower_getattr(_BorrowedType, "shape")
def _shape(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    return context.make_tuple(builder, types.UniTuple(types.intp, kind.ndim), _parts(builder, kind, value)[1])


@lower_getattr(_BorrowedType, "size")
def _size(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    return builder.extract_value(value, 1)


@intrinsic
def borrow(typing_context, array):  # type: ignore[no-untyped-def]
    """A contiguous NumPy array as a borrowed one; a borrowed one as it is."""
    result = array if isinstance(array, _BorrowedType) else _BorrowedType(array.dtype, (None,) * array.ndim)

    def lower(context, builder, sig, args):  # type: ignore[no-untyped-def]
        if sig.args[0] == result:
            return args[0]
        source = context.make_array(sig.args[0])(context, builder, args[0])
        return _make(context, builder, result, source.data, cgutils.unpack_tuple(builder, source.shape))

    return result(array), lower


_PIN = 5  # numbers per pinned array: address, four axes


def pin(*arrays: NDArray[Any]) -> NDArray[np.int64]:
    """Addresses and shapes of contiguous arrays, for kernels that are called again and again on the same ones.

    Passing an array costs a call 40 ns, passing the address of a list of addresses a fifth. Who pins arrays keeps them
    and the list.
    """
    addresses = np.zeros((len(arrays), _PIN), np.int64)
    for row, array in zip(addresses, arrays, strict=True):
        if not array.flags.c_contiguous:
            raise ValueError("only contiguous arrays can be pinned")
        row[0], row[1 : 1 + array.ndim] = array.ctypes.data, array.shape
    return addresses


@intrinsic
def pins_at(typing_context, address):  # type: ignore[no-untyped-def]
    """The borrowed list of addresses that `pin` made, from where it lies (its `ctypes.data`)."""
    result = _BorrowedType(types.int64, (None,))

    def lower(context, builder, sig, args):  # type: ignore[no-untyped-def]
        data = builder.inttoptr(args[0], context.get_value_type(types.CPointer(types.int64)))
        return _make(context, builder, result, data, [ir.Constant(_INT, 0)])

    return result(address), lower


@intrinsic
def call_range(typing_context, entry, pins, first, last):  # type: ignore[no-untyped-def]
    """Call the kernel whose machine code is at `entry` (`jit.entry_address`), kernel(pins, first, last) -> integer.

    So a kernel calls one of another package without compiling it a second time. -1 where that one raised (no memory).
    """

    def lower(context, builder, sig, args):  # type: ignore[no-untyped-def]
        byte = ir.IntType(8).as_pointer()
        signature = ir.FunctionType(ir.IntType(32), [_INT.as_pointer(), byte.as_pointer(), _INT, _INT, _INT])
        code = builder.inttoptr(args[0], signature.as_pointer())
        result = cgutils.alloca_once_value(builder, ir.Constant(_INT, -1))
        trouble = cgutils.alloca_once(builder, byte)
        status = builder.call(code, [result, trouble, *args[1:]])
        fine = builder.icmp_signed("==", status, ir.Constant(ir.IntType(32), 0))
        return builder.select(fine, builder.load(result), ir.Constant(_INT, -1))

    return types.int64(types.int64, types.int64, types.int64, types.int64), lower


@intrinsic
def next_uniform(typing_context, entry, source):  # type: ignore[no-untyped-def]
    """The next number in [0, 1) of a NumPy bit generator: its next_double at `entry`, its state at `source`."""

    def lower(context, builder, sig, args):  # type: ignore[no-untyped-def]
        byte = ir.IntType(8).as_pointer()
        code = builder.inttoptr(args[0], ir.FunctionType(ir.DoubleType(), [byte]).as_pointer())
        return builder.call(code, [builder.inttoptr(args[1], byte)])

    return types.float64(types.int64, types.int64), lower


def _pinned(dtype: Any) -> Any:
    @intrinsic(prefer_literal=True)
    def pinned(typing_context, addresses, row, ndim):  # type: ignore[no-untyped-def]
        if not isinstance(ndim, types.IntegerLiteral):
            return None
        result = _BorrowedType(dtype, (None,) * ndim.literal_value)

        def lower(context, builder, sig, args):  # type: ignore[no-untyped-def]
            data, _ = _parts(builder, sig.args[0], args[0])
            row = context.cast(builder, args[1], sig.args[1], types.intp)
            first = builder.mul(row, ir.Constant(_INT, _PIN))
            numbers = [
                builder.load(builder.gep(data, [builder.add(first, ir.Constant(_INT, k))]))
                for k in range(1 + result.ndim)
            ]
            data = builder.inttoptr(numbers[0], context.get_value_type(types.CPointer(dtype)))
            return _make(context, builder, result, data, numbers[1:])

        return result(addresses, row, ndim), lower

    return pinned


pinned_floats, pinned_singles, pinned_integers = (
    _pinned(dtype) for dtype in (types.float64, types.float32, types.int64)
)  # pinned_floats(addresses, row, ndim): a borrowed array from its row of borrowed addresses


def _without_last_axis(dtype: Any) -> Any:
    @intrinsic
    def seen(typing_context, array):  # type: ignore[no-untyped-def]
        result = _BorrowedType(dtype, array.lengths[:-1])

        def lower(context, builder, sig, args):  # type: ignore[no-untyped-def]
            data, shape = _parts(builder, sig.args[0], args[0])
            return _make(context, builder, result, data, shape[:-1])

        return result(array), lower

    return seen


def _one_per_lane(dtype: Any) -> Any:
    @intrinsic
    def seen(typing_context, array):  # type: ignore[no-untyped-def]
        result = _BorrowedType(dtype, (WIDTH,))

        def lower(context, builder, sig, args):  # type: ignore[no-untyped-def]
            data, _ = _parts(builder, sig.args[0], args[0])
            return _make(context, builder, result, data, [ir.Constant(_INT, WIDTH)])

        return result(array), lower

    return seen


lanes, table_rows = map(
    _without_last_axis, (lanes_type, row_type)
)  # of borrowed floats (..., 8): (...) of Lanes, of rows
as_rows, integers = map(_one_per_lane, (row_type, types.int64))  # of memory of eight Lanes, of one Lanes


@intrinsic
def aligned_lanes(typing_context, memory):  # type: ignore[no-untyped-def]
    """One-dimensional memory of floats as Lanes from its first address that is a multiple of their size.

    Lanes that straddle two cache lines cost twice the time.
    """
    result = _BorrowedType(lanes_type, (None,))

    def lower(context, builder, sig, args):  # type: ignore[no-untyped-def]
        data, (count,) = _parts(builder, sig.args[0], args[0])
        size = ir.Constant(_INT, 8 * WIDTH)
        address = builder.ptrtoint(data, _INT)
        beyond = builder.urem(builder.neg(address), size)
        start = builder.inttoptr(builder.add(address, beyond), data.type)
        left = builder.sub(builder.mul(count, ir.Constant(_INT, 8)), beyond)
        return _make(context, builder, result, start, [builder.udiv(left, size)])

    return result(memory), lower


@intrinsic(prefer_literal=True)
def of_width(typing_context, array, width):  # type: ignore[no-untyped-def]
    """A borrowed array whose last axis is known to have this length: its index is then a shift, not a product."""
    if not isinstance(width, types.IntegerLiteral):
        return None
    result = _BorrowedType(array.dtype, (*array.lengths[:-1], width.literal_value))

    def lower(context, builder, sig, args):  # type: ignore[no-untyped-def]
        data, shape = _parts(builder, sig.args[0], args[0])
        return _make(context, builder, result, data, shape)

    return result(array, width), lower


@intrinsic
def numbers(typing_context, array):  # type: ignore[no-untyped-def]
    """A borrowed array of Lanes (...) as one of floats (..., 8)."""
    result = _BorrowedType(types.float64, (*array.lengths, WIDTH))

    def lower(context, builder, sig, args):  # type: ignore[no-untyped-def]
        data, shape = _parts(builder, sig.args[0], args[0])
        return _make(context, builder, result, data, [*shape, ir.Constant(_INT, WIDTH)])

    return result(array), lower


@intrinsic(prefer_literal=True)
def carve(typing_context, memory, at, shape):  # type: ignore[no-untyped-def]
    """An array of a shape (a tuple) from the elements of one-dimensional memory that begin at `at`."""
    lengths = tuple(n.literal_value if isinstance(n, types.IntegerLiteral) else None for n in shape)
    result = _BorrowedType(memory.dtype, lengths)

    def lower(context, builder, sig, args):  # type: ignore[no-untyped-def]
        data, _ = _parts(builder, sig.args[0], args[0])
        start = builder.gep(data, [context.cast(builder, args[1], sig.args[1], types.intp)])
        counts = zip(cgutils.unpack_tuple(builder, args[2]), sig.args[2], strict=True)
        return _make(
            context, builder, result, start, [context.cast(builder, n, kind, types.intp) for n, kind in counts]
        )

    return result(memory, at, shape), lower
