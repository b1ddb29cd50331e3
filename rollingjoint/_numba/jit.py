"""Kernels, the parts that they are made of, and their machine code."""

from __future__ import annotations

import contextlib
import functools
import gc
import importlib
from collections.abc import Callable, Iterator
from typing import Any

import numba

from rollingjoint._numba import layout
from rollingjoint._numba.bounds import CHECKED
from rollingjoint._numba.cache import keep_on_disk
from rollingjoint._numba.parts import PartCompiler, PartDispatcher, ShortLoopsCompiler

_OPTIONS: dict[str, Any] = {"error_model": "numpy", "boundscheck": CHECKED}
PART_OPTIONS = _OPTIONS | {"no_cpython_wrapper": True, "no_cfunc_wrapper": True, "pipeline_class": PartCompiler}
"""numba's options for parts."""


def kernel(
    function: Callable[..., Any] | None = None,
    *,
    title: str = "",
    short_loops: bool = False,
    lapack: bool = False,
    **options: Any,
) -> Any:
    """Compile a function of plain arrays: IEEE arithmetic that never raises, cached on disk.

    `title`: the solver that it belongs to, for the message to a person who waits, such as "the planar solver".
    `short_loops`: all its loops are short, or over SIMD lanes, and not worth being unrolled or vectorised.
    `lapack`: it may call LAPACK. numba would import that in the middle of a call, where Ctrl-C is a fatal error; so it
    is imported when the kernel's machine code is bound.
    """
    if function is None:
        return functools.partial(kernel, title=title, short_loops=short_loops, lapack=lapack, **options)
    compiler: dict[str, Any] = {"pipeline_class": ShortLoopsCompiler} if short_loops else {}
    dispatcher = numba.njit(**_OPTIONS, **compiler, **options)(function)
    keep_on_disk(dispatcher, title or f"{function.__module__}.{function.__name__}")
    if lapack:
        _with_lapack.add(dispatcher)
    return dispatcher


def part(function: Callable[..., Any] | None = None, *, inline: bool = False) -> Any:
    """Compile a function that only kernels call: it is kept inside them, not on disk, and Python cannot call it.

    `inline`: where the call itself would cost as much as the work.
    """
    if function is None:
        return functools.partial(part, inline=inline)
    dispatcher: Any = numba.njit(forceinline=inline, **PART_OPTIONS)(function)
    dispatcher.__class__ = PartDispatcher
    return dispatcher


@functools.cache
def standalone(piece: Any) -> Any:
    """A part compiled on its own, for tests and measurements from Python."""
    return kernel(piece.py_func)


_compiled: dict[Any, Any] = {}
_with_lapack: set[Any] = set()


def _compiled_for(dispatcher: Any, kinds: tuple[Any, ...]) -> Any:
    """numba's compiled form of a kernel for arguments of these kinds, compiled or loaded if need be."""
    key = dispatcher, *(kind if layout.is_declaration(kind) else layout.numba_type(kind) for kind in kinds)
    if (compiled := _compiled.get(key)) is None:
        arguments = tuple(map(layout.numba_type, kinds))
        if dispatcher in _with_lapack:
            importlib.import_module("scipy.linalg.cython_lapack")
        with _no_garbage_collection():
            dispatcher.compile(arguments)
        compiled = _compiled[key] = dispatcher.overloads[arguments]
    return compiled


@contextlib.contextmanager
def _no_garbage_collection() -> Iterator[None]:
    """Compiling makes millions of objects that live until it ends: the collector takes a tenth of the time in vain."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


def machine_code(dispatcher: Any, *kinds: Any) -> Callable[..., Any]:
    """A kernel without numba's check of the type of every argument, which costs as much as a short kernel.

    Args:
        dispatcher: the kernel.
        kinds: one per argument, an example, or a declaration: a number's type, an array's (`Annotated[Floats,
            "B"]`), or the class of a NamedTuple (layout.py). Other kinds give other machine code.
    Returns:
        the machine code. Its arguments must be of these kinds, arrays contiguous; unchecked but in the mode of
        bounds.py.
    """
    code: Callable[..., Any] = _compiled_for(dispatcher, kinds).entry_point
    return _checked(code, kinds) if CHECKED else code


def entry_address(dispatcher: Any, *kinds: Any) -> int:
    """Address of the machine code of a kernel for such arguments, for `pins.call_range`."""
    compiled = _compiled_for(dispatcher, kinds)
    return int(compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name))


def _checked(code: Callable[..., Any], kinds: tuple[Any, ...]) -> Callable[..., Any]:
    """Machine code that raises TypeError or InvalidInput for arguments of other kinds."""
    expected = [layout.numba_type(kind) for kind in kinds]

    def checked(*arguments: Any) -> Any:
        for argument, kind in zip(arguments, expected, strict=True):
            layout.check_argument(argument, kind)
        return code(*arguments)

    return checked
