"""Vectors of the plane and of space: tuples of two or three numbers, or of SIMD lanes.

One formula serves both: the length of its vectors selects the version when a kernel is compiled. In the plane every
axis is the normal and is ignored. Formulas written out in coordinates take the same time and give the same bits
(benchmarks/vectors.py).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba.core import types
from numba.extending import overload

from rollingjoint._numba.jit import PART_OPTIONS, part
from rollingjoint._numba.simd import where


def dot(a: Any, b: Any) -> Any:
    """a · b."""
    raise TypeError("dot is compiled into kernels")


def plus_dot(start: Any, a: Any, b: Any) -> Any:
    """start + a · b, one product after the other."""
    raise TypeError("plus_dot is compiled into kernels")


def plus(a: Any, b: Any) -> Any:
    """a + b."""
    raise TypeError("plus is compiled into kernels")


def minus(a: Any, b: Any) -> Any:
    """a - b."""
    raise TypeError("minus is compiled into kernels")


def times(a: Any, factor: Any) -> Any:
    """A vector times a number."""
    raise TypeError("times is compiled into kernels")


def about(axis: Any, arm: Any) -> Any:
    """axis × arm: velocity of the end of an arm that turns about an axis; in space the product of any two vectors."""
    raise TypeError("about is compiled into kernels")


@part(inline=True)
def in_space(values, i, first):
    """Three numbers of a row, as a vector."""
    return values[i, first], values[i, first + 1], values[i, first + 2]


def choose(condition: Any, yes: Any, no: Any) -> Any:
    """`yes` where the condition holds, else `no`."""
    raise TypeError("choose is compiled into kernels")


def _vectors(dimension: int, generic: Callable[..., Any], function: Callable[..., Any]) -> None:
    """Make a function of tuples of `dimension` numbers the implementation of a generic one."""

    @overload(generic, jit_options=PART_OPTIONS | {"forceinline": True}, strict=False)
    def of_dimension(*arguments: Any) -> Callable[..., Any] | None:
        vector = arguments[-1] if isinstance(arguments[-1], types.BaseTuple) else arguments[0]
        return function if len(vector) == dimension else None


_vectors(2, dot, lambda a, b: a[0] * b[0] + a[1] * b[1])
_vectors(3, dot, lambda a, b: a[0] * b[0] + a[1] * b[1] + a[2] * b[2])
_vectors(2, plus_dot, lambda start, a, b: start + a[0] * b[0] + a[1] * b[1])
_vectors(3, plus_dot, lambda start, a, b: start + a[0] * b[0] + a[1] * b[1] + a[2] * b[2])
_vectors(2, plus, lambda a, b: (a[0] + b[0], a[1] + b[1]))
_vectors(3, plus, lambda a, b: (a[0] + b[0], a[1] + b[1], a[2] + b[2]))
_vectors(2, minus, lambda a, b: (a[0] - b[0], a[1] - b[1]))
_vectors(3, minus, lambda a, b: (a[0] - b[0], a[1] - b[1], a[2] - b[2]))
_vectors(2, times, lambda a, factor: (a[0] * factor, a[1] * factor))
_vectors(3, times, lambda a, factor: (a[0] * factor, a[1] * factor, a[2] * factor))
_vectors(2, about, lambda axis, arm: (-arm[1], arm[0]))
_vectors(
    3,
    about,
    lambda axis, arm: (
        axis[1] * arm[2] - axis[2] * arm[1],
        axis[2] * arm[0] - axis[0] * arm[2],
        axis[0] * arm[1] - axis[1] * arm[0],
    ),
)
_vectors(2, choose, lambda condition, yes, no: (where(condition, yes[0], no[0]), where(condition, yes[1], no[1])))
_vectors(
    3,
    choose,
    lambda condition, yes, no: (
        where(condition, yes[0], no[0]),
        where(condition, yes[1], no[1]),
        where(condition, yes[2], no[2]),
    ),
)
