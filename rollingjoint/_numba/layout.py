"""NamedTuples of arrays with a layout declared by annotations: their numba types, sizes and checks.

    class State(NamedTuple):
        angle: Annotated[Floats, "J"]
        joint: Annotated[Floats, "J", 8]

An axis is a number or a name; all axes of one name have one length. Fields are such arrays, `float`, `int`, `bool`, or
NamedTuples again; Annotated[State, "B"] is one with a leading axis B on its arrays.
"""

from __future__ import annotations

import functools
import hashlib
import math
from collections.abc import Callable, Mapping
from typing import Annotated, Any, NamedTuple, get_args, get_origin, get_type_hints

import numba
import numpy as np
from numba.core import types
from numba.np import numpy_support
from numpy.typing import NDArray

from rollingjoint._numba.borrowed import BorrowedType
from rollingjoint.errors import InvalidInput

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Integers = NDArray[np.int64]

_ARRAY = get_origin(Floats)  # ndarray; from NumPy 2.5 on NDArray itself
_SCALARS = {float: np.dtype(np.float64), int: np.dtype(np.int64), bool: np.dtype(np.bool_)}


class Leaf(NamedTuple):
    """An array or a number of a layout."""

    path: str
    dtype: np.dtype[Any]
    axes: tuple[str | int, ...] | None  # of an array

    def check(self, value: Any) -> None:
        """Raise InvalidInput unless the value is a contiguous array of this type, or a number where one is declared."""
        if self.axes is None:
            return
        if not isinstance(value, np.ndarray) or value.dtype != self.dtype or value.ndim != len(self.axes):
            actual = f"{value.dtype} {value.shape}" if isinstance(value, np.ndarray) else value
            raise InvalidInput(self.path, actual, f"an array of {self.dtype} ({', '.join(map(str, self.axes))})")
        if not value.flags.c_contiguous:
            raise InvalidInput(self.path, f"strides {value.strides}", "a contiguous array")


def is_layout(kind: Any) -> bool:
    """True for a NamedTuple class."""
    return isinstance(kind, type) and issubclass(kind, tuple) and hasattr(kind, "_fields")


def is_declaration(kind: Any) -> bool:
    """True for a declaration of an argument's kind, False for an example of one."""
    return isinstance(kind, type) or get_origin(kind) is Annotated


@functools.cache
def _hints(cls: Any) -> dict[str, Any]:
    return get_type_hints(cls, include_extras=True)


def fields(cls: type) -> tuple[Any, ...]:
    """The declarations of a NamedTuple's fields."""
    return tuple(_hints(cls).values())


def _tree(hint: Any, outer: tuple[Any, ...], path: str, leaf: Callable[[Leaf], Any], node: Callable[..., Any]) -> Any:
    """Values of `leaf` for all arrays and numbers, put together by node(class, values) level by level."""
    axes: tuple[Any, ...] = ()
    if get_origin(hint) is Annotated:
        hint, *declared = get_args(hint)
        axes = tuple(declared)
    if is_layout(hint):
        fields = _hints(hint).items()
        return node(hint, [_tree(field, (*outer, *axes), f"{path}.{name}", leaf, node) for name, field in fields])
    if hint in _SCALARS:
        return leaf(Leaf(path, _SCALARS[hint], None))
    if get_origin(hint) is not _ARRAY:
        raise TypeError(f"{path} is declared as {hint}: neither an array, a number nor a NamedTuple of those")
    return leaf(Leaf(path, np.dtype(_scalar_type(hint)), (*outer, *axes)))


def _scalar_type(hint: Any) -> Any:
    """float64 of NDArray[np.float64]; NumPy up to 2.4 writes it ndarray[..., dtype[np.float64]]."""
    last = get_args(hint)[-1]
    return get_args(last)[0] if get_args(last) else last


@functools.cache
def leaves(cls: type) -> tuple[Leaf, ...]:
    """All arrays and numbers of a layout, in order, inner NamedTuples flattened."""
    collected: list[Leaf] = []
    _tree(cls, (), cls.__name__, collected.append, lambda *_: None)
    return tuple(collected)


@functools.cache
def layout_hash(cls: type) -> int:
    """A number that two layouts share only if names, dtypes and axes of all their fields are equal."""
    return int.from_bytes(hashlib.sha256(repr(leaves(cls)).encode()).digest()[:7], "little")


def size(cls: type, lengths: Mapping[str, int]) -> int:
    """Count of numbers in the arrays of a layout, from the lengths of its named axes: pins.size_of, in Python."""
    axes = (leaf.axes or () for leaf in leaves(cls))
    return sum(math.prod(axis if isinstance(axis, int) else lengths[axis] for axis in shape) for shape in axes)


def flat(value: Any) -> list[Any]:
    """The values of a (nested) NamedTuple in the order of `leaves`."""
    values: list[Any] = []
    for item in value:
        if isinstance(item, tuple):
            values += flat(item)
        else:
            values.append(item)
    return values


def check(value: Any) -> None:
    """Raise InvalidInput, naming the field, unless the arrays of a NamedTuple are as its class declares."""
    cls: Any = type(value)
    lengths: dict[str, int] = {}
    for leaf, array in zip(leaves(cls), flat(value), strict=True):
        leaf.check(array)
        if leaf.axes is None:
            continue
        for axis, length in zip(leaf.axes, array.shape, strict=True):
            expected = axis if isinstance(axis, int) else lengths.setdefault(axis, length)
            if length != expected:
                raise InvalidInput(f"{leaf.path}, axis {axis}", length, f"{expected}, as in the layout's other arrays")


def check_argument(value: Any, kind: Any) -> None:
    """Raise InvalidInput unless machine code for this numba type can be called with the value."""
    if isinstance(kind, types.BaseTuple):
        for argument, its in zip(value, kind.types, strict=True):  # type: ignore[attr-defined]
            check_argument(argument, its)
    elif isinstance(kind, types.Array):
        Leaf("argument of machine code", numpy_support.as_dtype(kind.dtype), ("...",) * kind.ndim).check(value)


def numba_type(kind: Any) -> Any:
    """The numba type of arguments of a kind, which is a declaration or an example."""
    if isinstance(kind, types.Type):
        return kind
    return _argument_type(kind) if is_declaration(kind) else numba.typeof(kind)


def _declared(leaf: Leaf, array: Callable[[Any, tuple[Any, ...]], Any]) -> Any:
    kind = numpy_support.from_dtype(leaf.dtype)
    return kind if leaf.axes is None else array(kind, leaf.axes)


def _tuple_type(cls: type, kinds: list[Any]) -> Any:
    return types.BaseTuple.from_types(kinds, cls)


@functools.cache
def _argument_type(hint: Any) -> Any:
    return _tree(hint, (), "argument", lambda leaf: _declared(leaf, _array), _tuple_type)


def _array(kind: Any, axes: tuple[Any, ...]) -> Any:
    return types.Array(kind, len(axes), "C")


@functools.cache
def borrowed_type(cls: type) -> Any:
    """The type of a NamedTuple with all its arrays borrowed."""
    borrowed = lambda kind, axes: BorrowedType(kind, (None,) * len(axes))  # noqa: E731
    return _tree(cls, (), cls.__name__, lambda leaf: _declared(leaf, borrowed), _tuple_type)


def carved_type(cls: type, dtype: Any) -> Any:
    """The type of a NamedTuple with its arrays borrowed from memory of a type."""
    lengths = lambda axes: tuple(axis if isinstance(axis, int) else None for axis in axes)  # noqa: E731
    carved = lambda kind, axes: BorrowedType(dtype, lengths(axes))  # noqa: E731
    return _tree(cls, (), cls.__name__, lambda leaf: _declared(leaf, carved), _tuple_type)
