"""Eight numbers side by side in compiled kernels: arithmetic on SIMD lanes works like arithmetic on a float.

A kernel written for arrays of floats serves eight lanes when it is given arrays of them (borrowed.py), and one written
for lanes a single one when it is given floats. Comparisons give a mask; `where` chooses by it. No operation lets one
lane see another, and every operation rounds as the one on floats does. LLVM maps eight doubles to the vector registers
of the processor, whatever their width.
"""

from __future__ import annotations

import math
import operator
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, lower_cast, models, register_model

WIDTH = 8  # lanes side by side
COLUMNS = 8  # numbers in a row of a table, equal to WIDTH: `columns` transposes a square

_DOUBLES = ir.VectorType(ir.DoubleType(), WIDTH)
_BITS = ir.VectorType(ir.IntType(1), WIDTH)
_ROW = ir.VectorType(ir.DoubleType(), COLUMNS)


class _SimdType(types.Type):
    """One double per lane."""

    def __init__(self) -> None:
        super().__init__(name="Simd")


class _TableRowType(types.Type):
    """Eight doubles, a row of a joint's table."""

    def __init__(self) -> None:
        super().__init__(name="Row")


class _MaskType(types.Type):
    """One truth value per lane."""

    def __init__(self) -> None:
        super().__init__(name="Mask")


simd_type, mask_type, row_type = _SimdType(), _MaskType(), _TableRowType()


@register_model(_SimdType)
class _SimdModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _DOUBLES)


@register_model(_TableRowType)
class _TableRowModel(models.PrimitiveModel):
    def __init__(self, manager: Any, row: Any) -> None:
        super().__init__(manager, row, _ROW)


@register_model(_MaskType)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, manager: Any, mask: Any) -> None:
        super().__init__(manager, mask, _BITS)


def width_of(kind: Any) -> int:
    """Number of lanes in a number of this type: eight, or one if it is a float."""
    return WIDTH if kind == simd_type else 1


def _spread(builder: Any, value: Any, width: int = WIDTH) -> Any:
    """One number in every lane."""
    kind = ir.VectorType(value.type, width)
    first = builder.insert_element(ir.Constant(kind, ir.Undefined), value, ir.Constant(ir.IntType(32), 0))
    order = ir.Constant(ir.VectorType(ir.IntType(32), width), [0] * width)
    return builder.shuffle_vector(first, ir.Constant(kind, ir.Undefined), order)


def _as_simd(context: Any, builder: Any, value: Any, kind: Any) -> Any:
    if kind == simd_type:
        return value
    return _spread(builder, context.cast(builder, value, kind, types.float64))


def _is_number(kind: Any) -> bool:
    return kind == simd_type or isinstance(kind, types.Float | types.Integer)


def _binary(function: Any, instruction: str, result: Any, *extra: Any) -> None:
    """Type and lower a function of two numbers, at least one of them SIMD."""

    @infer_global(function)
    class _Template(AbstractTemplate):  # type: ignore[misc]
        def generic(self, args: Any, keywords: Any) -> Any:
            if len(args) == 2 and simd_type in args and all(map(_is_number, args)):
                return signature(result, *args)
            return None

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        first, second = (_as_simd(context, builder, value, kind) for value, kind in zip(args, sig.args, strict=True))
        return getattr(builder, instruction)(*extra, first, second)

    for kinds in ((simd_type, simd_type), (simd_type, types.Number), (types.Number, simd_type)):
        lower_builtin(function, *kinds)(lower)


for _plain, _inplace, _instruction in (
    (operator.add, operator.iadd, "fadd"),
    (operator.sub, operator.isub, "fsub"),
    (operator.mul, operator.imul, "fmul"),
    (operator.truediv, operator.itruediv, "fdiv"),
):
    _binary(_plain, _instruction, simd_type)
    _binary(_inplace, _instruction, simd_type)
for _compare, _symbol in (
    (operator.lt, "<"),
    (operator.le, "<="),
    (operator.gt, ">"),
    (operator.ge, ">="),
    (operator.eq, "=="),
):
    _binary(_compare, "fcmp_ordered", mask_type, _symbol)


def _logic(function: Any, instruction: str) -> None:
    @infer_global(function)
    class _Template(AbstractTemplate):  # type: ignore[misc]
        def generic(self, args: Any, keywords: Any) -> Any:
            return signature(mask_type, *args) if args == (mask_type, mask_type) else None

    @lower_builtin(function, mask_type, mask_type)
    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return getattr(builder, instruction)(*args)


for _function, _instruction in ((operator.and_, "and_"), (operator.or_, "or_")):
    _logic(_function, _instruction)


def _unary(function: Any, kind: Any, lower: Any) -> None:
    @infer_global(function)
    class _Template(AbstractTemplate):  # type: ignore[misc]
        def generic(self, args: Any, keywords: Any) -> Any:
            return signature(kind, *args) if args == (kind,) else None

    lower_builtin(function, kind)(lower)


def _intrinsic_call(name: str) -> Any:
    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        kind = ir.FunctionType(_DOUBLES, [_DOUBLES] * len(args))
        function = cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.v{WIDTH}f64")
        return builder.call(function, args)

    return lower


_unary(operator.neg, simd_type, lambda context, builder, sig, args: builder.fneg(args[0]))
_unary(operator.invert, mask_type, lambda context, builder, sig, args: builder.not_(args[0]))
_unary(math.sqrt, simd_type, _intrinsic_call("sqrt"))
_unary(abs, simd_type, _intrinsic_call("fabs"))


@lower_cast(types.Float, simd_type)
def _float_to_simd(context: Any, builder: Any, source: Any, target: Any, value: Any) -> Any:
    return _spread(builder, context.cast(builder, value, source, types.float64))


@intrinsic
def where(typing_context, condition, yes, no):  # type: ignore[no-untyped-def]
    """`yes` where the condition holds, else `no`; for masks and SIMD lanes, or for a bool and floats."""
    is_mask = condition == mask_type
    result = simd_type if is_mask else types.float64
    if is_mask and mask_type in (yes, no):
        result = mask_type

    def lower(context, builder, sig, args):  # type: ignore[no-untyped-def]
        def cast(value, kind):  # type: ignore[no-untyped-def]
            if result == mask_type:
                return (
                    value if kind == mask_type else _spread(builder, context.cast(builder, value, kind, types.boolean))
                )
            if is_mask:
                return _as_simd(context, builder, value, kind)
            return context.cast(builder, value, kind, types.float64)

        test = args[0] if is_mask else context.cast(builder, args[0], sig.args[0], types.boolean)
        return builder.select(test, cast(args[1], sig.args[1]), cast(args[2], sig.args[2]))

    return result(condition, yes, no), lower


@intrinsic
def fused(typing_context, a, b, c):  # type: ignore[no-untyped-def]
    """a b + c rounded once, for rows a and c and a float b."""

    def lower(context, builder, sig, args):  # type: ignore[no-untyped-def]
        kind = ir.FunctionType(_ROW, [_ROW] * 3)
        function = cgutils.get_or_insert_function(builder.module, kind, f"llvm.fma.v{COLUMNS}f64")
        return builder.call(function, [args[0], _spread(builder, args[1], COLUMNS), args[2]])

    return row_type(a, b, c), lower


@intrinsic
def any_lane(typing_context, mask):  # type: ignore[no-untyped-def]
    """True where a mask holds in any lane; a bool stays unchanged."""

    def lower(context, builder, sig, args):  # type: ignore[no-untyped-def]
        if sig.args[0] == types.boolean:
            return args[0]
        return builder.icmp_unsigned(
            "!=", builder.bitcast(args[0], ir.IntType(WIDTH)), ir.Constant(ir.IntType(WIDTH), 0)
        )

    return types.boolean(mask), lower


@intrinsic
def columns(typing_context, rows):  # type: ignore[no-untyped-def]
    """The eight columns of one row per lane, a tuple of eight SIMD numbers; of the only row, of eight floats."""
    alone = rows.lengths == (1,)
    result = types.UniTuple(types.float64 if alone else simd_type, COLUMNS)

    def lower(context, builder, sig, args):  # type: ignore[no-untyped-def]
        data = builder.extract_value(args[0], 0)
        if not alone:
            return context.make_tuple(builder, result, _transposed(builder, data))
        row = _loaded_row(builder, data, 0)
        numbers = [builder.extract_element(row, ir.Constant(ir.IntType(32), i)) for i in range(COLUMNS)]
        return context.make_tuple(builder, result, numbers)

    return result(rows), lower


def _transposed(builder: Any, data: Any) -> list[Any]:
    """Eight rows in memory, transposed by exchanging halves of pairs of rows, then quarters, then eighths."""
    block = [_loaded_row(builder, data, i) for i in range(COLUMNS)]
    span = 1
    while span < COLUMNS:
        for i in range(COLUMNS):
            if not i & span:
                low = [j if not j & span else COLUMNS + j - span for j in range(COLUMNS)]
                high = [j + span if not j & span else COLUMNS + j for j in range(COLUMNS)]
                a, b = block[i], block[i + span]
                block[i], block[i + span] = (_shuffled(builder, a, b, order) for order in (low, high))
        span *= 2
    return block


def _loaded_row(builder: Any, data: Any, i: int) -> Any:
    row = builder.load(builder.gep(data, [ir.Constant(ir.IntType(64), i)]))
    row.align = 8
    return row


def _shuffled(builder: Any, a: Any, b: Any, order: list[int]) -> Any:
    return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(ir.IntType(32), len(order)), order))
