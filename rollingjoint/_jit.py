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

_PACKAGE = Path(__file__).parent


@functools.cache
def _source_hash() -> str:
    """Hash of every source that kernels are compiled from."""
    digest = hashlib.sha256(numba.__version__.encode())
    for path in [_PACKAGE / "_jit.py", *sorted((_PACKAGE / "_kernels").glob("*.py"))]:
        digest.update(path.name.encode() + path.read_bytes())
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


@functools.cache
def _announce() -> None:
    """Tell a person at a terminal, once, what the wait is for."""
    if sys.stderr.isatty():
        print("rollingjoint: compiling kernels, about half a minute; they are kept for next time", file=sys.stderr)


class _KernelLocator(caching._CacheLocator):
    def __init__(self, py_func: Callable[..., Any], py_file: str) -> None:
        self._name = Path(py_file).stem

    def get_cache_path(self) -> str:
        return str(cache_directory())

    def get_source_stamp(self) -> str:
        return _source_hash()

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
        """Compiled code from disk, or None when there is none that can be read."""
        with contextlib.suppress(*_UNREADABLE):
            if (compiled := super().load_overload(sig, target_context)) is not None:
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
