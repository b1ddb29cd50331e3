"""`kernel`: numba's njit with a disk cache that notices every edit in any kernel source.

numba keys a cached function on the file of that function alone, so an edit in a callee in another file would serve
the old answer. Here the key is a hash over all files that hold kernels.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import pickle
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
from numba.core import caching
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import LoweringPass, register_pass
from numba.core.registry import CPUDispatcher
from numba.core.runtime import rtsys  # type: ignore[attr-defined]
from numba.core.typed_passes import AnnotateTypes

_PACKAGE = Path(__file__).parents[1]


@functools.cache
def _source_hash() -> str:
    """Hash of every source that kernels are compiled from."""
    digest = hashlib.sha256(numba.__version__.encode())
    for room in ("_numba", "kernels"):
        for path in sorted((_PACKAGE / room).rglob("*.py")):
            digest.update(path.relative_to(_PACKAGE).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()[:16]


@functools.cache
def cache_directory() -> Path:
    """First writable place for compiled kernels: $ROLLINGJOINT_CACHE, the package, the user's cache, scratch space."""
    home = Path(os.environ.get("XDG_CACHE_HOME", "~/.cache")).expanduser()
    scratch = Path(tempfile.gettempdir()) / f"rollingjoint-{os.getuid() if hasattr(os, 'getuid') else 'user'}"
    chosen = os.environ.get("ROLLINGJOINT_CACHE")
    places = [Path(chosen)] if chosen else [_PACKAGE / "__pycache__", home / "rollingjoint", scratch]
    for place in places:
        folder = place / f"kernels-{_source_hash()}"
        try:
            folder.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=folder).close()
        except OSError:
            continue
        return folder
    return places[-1] / f"kernels-{_source_hash()}"


def _sources(function: Callable[..., Any]) -> list[Path]:
    """Files outside this package that a kernel is made of: its own, and those of kernels that its module imports."""
    files: list[Path] = []
    waiting = [function]
    while waiting:
        one = waiting.pop(0)
        file = Path(one.__code__.co_filename)
        if file not in files and _PACKAGE not in file.parents:
            files.append(file)
            waiting += [seen.py_func for seen in one.__globals__.values() if isinstance(seen, CPUDispatcher)]
    return files


@functools.cache
def _announce() -> None:
    """Tell a person at a terminal, once, what the wait is for."""
    if sys.stderr.isatty():
        print("rollingjoint: compiling kernels, ten seconds or more; they are kept for next time", file=sys.stderr)


class _KernelLocator(caching._CacheLocator):
    def __init__(self, py_func: Callable[..., Any], py_file: str) -> None:
        self._name = "-".join(Path(py_file).with_suffix("").parts[-2:])  # folders may have kernels of one name
        self._sources = _sources(py_func)

    def get_cache_path(self) -> str:
        return str(cache_directory())

    def get_source_stamp(self) -> str:
        """Of the package's kernels, and of what kernels of other packages are made of beside them."""
        digest = hashlib.sha256()
        for path in self._sources:
            digest.update(path.read_bytes())
        return _source_hash() + digest.hexdigest()[:16]

    def get_disambiguator(self) -> str:
        return self._name

    @classmethod
    def from_function(cls, py_func: Callable[..., Any], py_file: str) -> _KernelLocator:
        return cls(py_func, py_file)


class _KernelCacheImpl(caching.CompileResultCacheImpl):
    _locator_classes = [_KernelLocator]  # noqa: RUF012 (numba's own form)


_UNREADABLE = (OSError, EOFError, ValueError, pickle.UnpicklingError)


class _KernelCache(caching.FunctionCache):
    _impl_class = _KernelCacheImpl

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Compiled code from disk, or None when there is none that can be read.

        numba would first import everything that compiling may need, which takes longer than the rest of the start.
        """
        rtsys.initialize(target_context)
        with contextlib.suppress(*_UNREADABLE):
            if (compiled := self._load_overload(sig, target_context)) is not None:
                return compiled
        _announce()
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep compiled code, over what cannot be read; a full or read-only disk costs only the next start its time."""
        try:
            try:
                super().save_overload(sig, data)
            except _UNREADABLE:
                self.flush()
                super().save_overload(sig, data)
        except OSError:
            self.disable()


def kernel(function: Callable[..., Any] | None = None, **options: Any) -> Any:
    """Compile a function of plain arrays: IEEE arithmetic that never raises, cached on disk."""
    if function is None:
        return functools.partial(kernel, **options)
    dispatcher = numba.njit(error_model="numpy", **options)(function)
    dispatcher._cache = _KernelCache(function)
    return dispatcher


_machine_code: dict[Any, Callable[..., Any]] = {}


def machine_code(dispatcher: Any, *examples: Any) -> Callable[..., Any]:
    """A kernel without numba's look at the type of every argument, which costs as much as a short kernel.

    Arguments must be contiguous and have the types of the examples in every call; nothing checks that.
    """
    code = _machine_code.get(dispatcher)
    if code is None:
        kinds = tuple(numba.typeof(example) for example in examples)
        dispatcher.compile(kinds)
        code = _machine_code[dispatcher] = dispatcher.overloads[kinds].entry_point
    return code


def entry_address(dispatcher: Any, *examples: Any) -> int:
    """Where the machine code of a kernel for such arguments lies, for `borrowed.call_range`."""
    machine_code(dispatcher, *examples)
    compiled = dispatcher.overloads[tuple(numba.typeof(example) for example in examples)]
    return int(compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name))


def direct(dispatcher: Any, *arguments: Any) -> Any:
    """A call of `machine_code`."""
    return machine_code(dispatcher, *arguments)(*arguments)


class _NoEnvironments:
    @staticmethod
    def set_env(name: str, environment: Any) -> None:
        """Leave nothing."""


class _PartLibrary(JITCodeLibrary):
    """Code of a part: it is optimised and turned into machine code once, inside the kernel that calls it."""

    @property
    def codegen(self) -> Any:
        """Where numba leaves the Python environment of machine code; a part has none."""
        return _NoEnvironments

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True


@register_pass(mutates_CFG=False, analysis_only=False)
class _UsePartLibrary(LoweringPass):
    _name = "use_part_library"

    def __init__(self) -> None:
        LoweringPass.__init__(self)

    def run_pass(self, state: Any) -> bool:
        codegen = state.targetctx.codegen()
        state.library = _PartLibrary(codegen, state.func_id.func_qualname)
        return True


class _PartCompiler(CompilerBase):
    def define_pipelines(self) -> list[Any]:
        passes = DefaultPassBuilder.define_nopython_pipeline(self.state)
        passes.add_pass_after(_UsePartLibrary, AnnotateTypes)
        passes.finalize()
        return [passes]


PART_OPTIONS: dict[str, Any] = {
    "error_model": "numpy",
    "no_cpython_wrapper": True,
    "no_cfunc_wrapper": True,
    "pipeline_class": _PartCompiler,
}
"""What numba compiles a part with."""


class _Part(CPUDispatcher):
    def __call__(self, *args: Any) -> Any:
        name = self.py_func.__name__
        raise TypeError(f"{name} is a part of kernels; standalone({name}) can be called from Python")


def part(function: Callable[..., Any] | None = None, *, inline: bool = False) -> Any:
    """Compile a function that only kernels call: it is kept inside them, not on disk, and Python cannot call it.

    numba would optimise a function anew in every caller of a caller; parts wait for the kernel that holds them all.
    `inline`: where the call itself would cost as much as the work.
    """
    if function is None:
        return functools.partial(part, inline=inline)
    dispatcher: Any = numba.njit(forceinline=inline, **PART_OPTIONS)(function)
    dispatcher.__class__ = _Part
    return dispatcher


@functools.cache
def standalone(piece: Any) -> Any:
    """A part compiled on its own, for tests and measurements from Python; not kept on disk."""
    return numba.njit(error_model="numpy")(piece.py_func)
