"""Contiguous arrays that kernels borrow: a pointer and a shape, without the reference counts of NumPy arrays.

Counting references costs more than the arithmetic of a short kernel. The entry kernel borrows from its arguments, which
outlive the call; everything below works on borrowed arrays of floats, of integers or of SIMD lanes (simd.py). Indexing
with fewer numbers than axes gives an array of the remaining axes. There are no slices, and no checks of indices but in
the mode of bounds.py.

A NamedTuple of many arrays goes from function to function word by word; `pointed`, it goes as one pointer.
"""

from __future__ import annotations

import operator
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.typing.templates import AbstractTemplate, AttributeTemplate, infer_getattr, infer_global, signature
from numba.extending import intrinsic, lower_builtin, lower_getattr, lower_getattr_generic, models, register_model

from rollingjoint._numba import bounds

INT = ir.IntType(64)


class BorrowedType(types.Type):
    """A borrowed array of floats, integers or SIMD lanes; lengths of axes known when it is compiled, else None."""

    def __init__(self, dtype: Any, lengths: tuple[int | None, ...]) -> None:
        self.dtype, self.lengths, self.ndim = dtype, lengths, len(lengths)
        super().__init__(name=f"Borrowed({dtype}, {lengths})")


@register_model(BorrowedType)
class _BorrowedModel(models.StructModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        shape = [(f"n{axis}", types.intp) for axis in range(kind.ndim)]
        super().__init__(manager, kind, [("data", types.CPointer(kind.dtype)), *shape])


def make(context: Any, builder: Any, kind: Any, data: Any, shape: Any) -> Any:
    """A borrowed array from a pointer and lengths, in the code of a kernel."""
    value = cgutils.create_struct_proxy(kind)(context, builder)
    value.data = builder.bitcast(data, value.data.type)
    for axis, count in enumerate(shape):
        setattr(value, f"n{axis}", count)
    return value._getvalue()


def pointer_and_shape(builder: Any, kind: Any, value: Any) -> tuple[Any, list[Any]]:
    """Pointer to the first element of a borrowed array, and its lengths."""
    shape = [
        builder.extract_value(value, 1 + axis) if length is None else ir.Constant(INT, length)
        for axis, length in enumerate(kind.lengths)
    ]
    return builder.extract_value(value, 0), shape


def map_tuple(context: Any, builder: Any, kind: Any, result: Any, value: Any, change: Any) -> Any:
    """A (nested) tuple with change(kind, result, value) in place of each of its values."""
    if not isinstance(kind, types.BaseTuple):
        return change(kind, result, value)
    values = cgutils.unpack_tuple(builder, value)
    changed = [
        map_tuple(context, builder, *item, change) for item in zip(kind.types, result.types, values, strict=True)
    ]
    return context.make_tuple(builder, result, changed)


def _borrowed(kind: Any) -> Any:
    """The type of a borrowed array, or of a tuple with its arrays borrowed; other types stay as they are."""
    if isinstance(kind, types.BaseTuple):
        return types.BaseTuple.from_types(
            [_borrowed(item) for item in kind.types], getattr(kind, "instance_class", None)
        )
    return BorrowedType(kind.dtype, (None,) * kind.ndim) if isinstance(kind, types.Array) else kind


@intrinsic
def borrow(typing_context, value):  # type: ignore[no-untyped-def]
    """A contiguous NumPy array as a borrowed one, a (nested) NamedTuple with all its arrays borrowed."""
    result = _borrowed(value)

    def lower(context, builder, sig, args):  # type: ignore[no-untyped-def]
        def change(kind, changed, item):  # type: ignore[no-untyped-def]
            if kind == changed:
                return item
            source = context.make_array(kind)(context, builder, item)
            return make(context, builder, changed, source.data, cgutils.unpack_tuple(builder, source.shape))

        return map_tuple(context, builder, sig.args[0], result, args[0], change)

    return result(value), lower


def _index_kinds(index: Any) -> list[Any] | None:
    """Types of the numbers of an index; None for anything else."""
    kinds = list(index) if isinstance(index, types.BaseTuple) else [index]
    return kinds if all(isinstance(kind, types.Integer | types.IntegerLiteral) for kind in kinds) else None


@infer_global(operator.getitem)
class _GetItem(AbstractTemplate):  # type: ignore[misc]
    def generic(self, args: Any, keywords: Any) -> Any:
        array, index = args
        kinds = _index_kinds(index) if isinstance(array, BorrowedType) else None
        if kinds is None or len(kinds) > array.ndim:
            return None
        remaining = array.lengths[len(kinds) :]
        return signature(BorrowedType(array.dtype, remaining) if remaining else array.dtype, array, index)


@infer_global(operator.setitem)
class _SetItem(AbstractTemplate):  # type: ignore[misc]
    def generic(self, args: Any, keywords: Any) -> Any:
        array, index, _ = args
        kinds = _index_kinds(index) if isinstance(array, BorrowedType) else None
        if kinds is None or len(kinds) != array.ndim:
            return None
        return signature(types.none, array, index, array.dtype)


def _element(context: Any, builder: Any, sig: Any, args: Any) -> tuple[Any, list[Any]]:
    """Pointer to the element or array at an index, and its shape."""
    array, index = sig.args[:2]
    data, shape = pointer_and_shape(builder, array, args[0])
    if isinstance(index, types.BaseTuple):
        numbers = list(zip(cgutils.unpack_tuple(builder, args[1]), index, strict=True))
    else:
        numbers = [(args[1], index)]
    at = None
    for axis, (number, kind) in enumerate(numbers):
        number = context.cast(builder, number, kind, types.intp)
        bounds.check_index(context, builder, number, shape[axis], f"axis {axis} of {array}")
        at = number if at is None else builder.add(builder.mul(at, shape[axis]), number)
    for count in shape[len(numbers) :]:
        at = builder.mul(at, count)
    return builder.gep(data, [at]), shape[len(numbers) :]


def _get(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    pointer, remaining = _element(context, builder, sig, args)
    if remaining:
        return make(context, builder, sig.return_type, pointer, remaining)
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
    lower_builtin(operator.getitem, BorrowedType, _index)(_get)
    lower_builtin(operator.setitem, BorrowedType, _index, types.Any)(_set)


@infer_getattr
class _Attributes(AttributeTemplate):  # type: ignore[misc]
    key = BorrowedType

    def resolve_shape(self, array: Any) -> Any:
        return types.UniTuple(types.intp, array.ndim)

    def resolve_size(self, array: Any) -> Any:
        return types.intp if array.ndim == 1 else None


@lower_getattr(BorrowedType, "shape")
def _shape(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    _, shape = pointer_and_shape(builder, kind, value)
    return context.make_tuple(builder, types.UniTuple(types.intp, kind.ndim), shape)


@lower_getattr(BorrowedType, "size")
def _size(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    return builder.extract_value(value, 1)


class PointedType(types.Type):
    """A NamedTuple where it lies: a pointer in place of all its words."""

    def __init__(self, of: Any) -> None:
        self.of, self.instance_class = of, of.instance_class
        super().__init__(name=f"Pointed({of})")

    def field(self, name: str) -> tuple[int, Any] | None:
        """Index and type of a field: of a NamedTuple in it the pointer."""
        if name not in self.of.fields:
            return None
        index = self.of.fields.index(name)
        kind = self.of.types[index]
        return index, PointedType(kind) if hasattr(kind, "instance_class") and isinstance(
            kind, types.BaseTuple
        ) else kind


@register_model(PointedType)
class _PointedModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, manager[kind.of].get_value_type().as_pointer())


@intrinsic
def pointed(typing_context, value):  # type: ignore[no-untyped-def]
    """The pointer to a NamedTuple of borrowed arrays, which is copied to the caller's stack: no longer than it runs."""

    def lower(context, builder, sig, args):  # type: ignore[no-untyped-def]
        place = cgutils.alloca_once(builder, args[0].type)
        builder.store(args[0], place)
        return place

    return PointedType(value)(value), lower


@infer_getattr
class _Fields(AttributeTemplate):  # type: ignore[misc]
    key = PointedType

    def generic_resolve(self, kind: Any, name: str) -> Any:
        found = kind.field(name)
        return None if found is None else found[1]


@lower_getattr_generic(PointedType)
def _field(context: Any, builder: Any, kind: Any, value: Any, name: str) -> Any:
    index, found = kind.field(name)
    place = builder.gep(value, [ir.Constant(ir.IntType(32), 0), ir.Constant(ir.IntType(32), index)])
    return place if isinstance(found, PointedType) else builder.load(place)
