"""Compiled kernels on disk, under a key that notices every edit in any kernel source.

numba keys a cached function on the file of that function alone, so an edit in a callee in another file would serve
the old answer. Here the key is a hash over all files that hold kernels.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import hashlib
import os
import pickle
import shutil
import stat
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numba
from numba.core import caching
from numba.core.registry import CPUDispatcher
from numba.core.runtime import rtsys  # type: ignore[attr-defined]

from rollingjoint._numba.bounds import CHECKED
from rollingjoint._numba.layout import is_layout
from rollingjoint._numba.shipped import shipped

_PACKAGE = Path(__file__).parents[1]


@functools.cache
def _source_hash() -> str:
    """Hash of every source that kernels are compiled from."""
    digest = hashlib.sha256(numba.__version__.encode())
    for room in ("_numba", "kernels", "transmission"):
        for path in sorted((_PACKAGE / room).rglob("*.py")):
            digest.update(path.relative_to(_PACKAGE).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()[:16]


_UNUSED = 30 * 24 * 3600.0  # s after which kernels that no process has used are deleted


@functools.cache
def cache_directory() -> Path:
    """First safe place for compiled kernels: $ROLLINGJOINT_CACHE, the user's cache, scratch space.

    All checkouts and environments of a user share it: files are named after the sources that they were compiled from.
    They are unpickled and run, so the folder belongs to this user alone. Where no place is safe, it is a fresh folder
    that goes with the process.
    """
    home = Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache").expanduser()
    scratch = Path(tempfile.gettempdir()) / f"rollingjoint-{os.getuid() if hasattr(os, 'getuid') else 'user'}"
    setting = os.environ.get("ROLLINGJOINT_CACHE")
    for place in [Path(setting)] if setting else [home / "rollingjoint", scratch]:
        folder = place / f"kernels-{_source_hash()}{'-checked' if CHECKED else ''}"
        try:
            place.mkdir(mode=0o700, parents=True, exist_ok=True)
            is_new = not folder.exists()
            folder.mkdir(mode=0o700, exist_ok=True)
            tempfile.TemporaryFile(dir=folder).close()
        except OSError:
            continue
        if _is_private(folder) and not _others_may_replace(place):
            os.utime(folder)
            if is_new:
                _delete_unused(place)
            return folder
        if setting:
            allowed = "a folder of your own that nobody else can write to"
            print(f"rollingjoint: ROLLINGJOINT_CACHE = {setting!r}: expected {allowed}; not used", file=sys.stderr)
    return _fresh_folder()


def _delete_unused(place: Path) -> None:
    """Delete the kernels of other sources that were unused for 30 days."""
    for folder in place.glob("kernels-*"):
        with contextlib.suppress(OSError):
            if folder.lstat().st_mtime < time.time() - _UNUSED:
                shutil.rmtree(folder, ignore_errors=True)


def _is_private(folder: Path) -> bool:
    """True for a real folder of this user, closed to all others."""
    info = folder.lstat()
    private = not hasattr(os, "getuid") or (info.st_uid == os.getuid() and not info.st_mode & 0o077)
    return stat.S_ISDIR(info.st_mode) and private


def _others_may_replace(folder: Path) -> bool:
    """True if another user could replace a folder inside by theirs."""
    if not hasattr(os, "getuid"):
        return False
    info = folder.stat()
    return info.st_uid not in (0, os.getuid()) or bool(info.st_mode & 0o022 and not info.st_mode & stat.S_ISVTX)


def _fresh_folder() -> Path:
    """A private folder that is deleted when the process ends."""
    folder = tempfile.mkdtemp(prefix="rollingjoint-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)


def _sources(function: Callable[..., Any]) -> tuple[list[Path], list[str]]:
    """Source files of a kernel outside this package, and the constants in them, imported ones included.

    The files are its own, and those of kernels and layouts that it imports.
    """
    files: list[Path] = []
    constants: list[str] = []
    waiting = [function]
    while waiting:
        kernel = waiting.pop(0)
        file = Path(kernel.__code__.co_filename)
        if file not in files and _PACKAGE not in file.parents:
            files.append(file)
            plain = (item for item in kernel.__globals__.items() if isinstance(item[1], int | float))
            constants += sorted(f"{name} {value!r}" for name, value in plain)
            waiting += [value.py_func for value in kernel.__globals__.values() if isinstance(value, CPUDispatcher)]
            for value in filter(is_layout, list(kernel.__globals__.values())):
                path = Path(getattr(sys.modules[value.__module__], "__file__", None) or file)
                files += [path] if path not in files and _PACKAGE not in path.parents else []
    return files, constants


@functools.cache
def _announce(title: str) -> None:
    """Tell a person at a terminal, once for every title, that this is being compiled."""
    if sys.stderr.isatty():
        print(f"rollingjoint: compiling {title}, some seconds; kept for next time", file=sys.stderr)


class NotCompiled(Exception):
    """A kernel that is not on disk, where none may be compiled."""


_may_compile = True


@contextlib.contextmanager
def without_compiling() -> Iterator[None]:
    """A context in which a kernel that is not on disk raises NotCompiled; not for several threads at a time."""
    global _may_compile
    _may_compile = False
    try:
        yield
    finally:
        _may_compile = True


class _KernelLocator(caching._CacheLocator):
    def __init__(self, py_func: Callable[..., Any], py_file: str) -> None:
        files, constants = _sources(py_func)
        digest = hashlib.sha256(" ".join(constants).encode())
        for path in files:
            digest.update(path.read_bytes())
        self._stamp = _source_hash() + digest.hexdigest()[:16]
        self._name = "-".join(Path(py_file).with_suffix("").parts[-2:])  # folders may have kernels of one name

    def get_cache_path(self) -> str:
        return str(cache_directory())

    def get_source_stamp(self) -> str:
        """Hash of the package's kernels and of a kernel's sources outside it."""
        return self._stamp

    def get_disambiguator(self) -> str:
        """File name of a kernel, different in two checkouts with different kernels."""
        return f"{self._name}-{self._stamp[16:]}"

    @classmethod
    def from_function(cls, py_func: Callable[..., Any], py_file: str) -> _KernelLocator:
        return cls(py_func, py_file)


class _KernelCacheImpl(caching.CompileResultCacheImpl):
    _locator_classes = [_KernelLocator]  # noqa: RUF012 (numba's own form)


_UNREADABLE = (OSError, EOFError, ValueError, AttributeError, ImportError, pickle.UnpicklingError)  # or of classes gone


class _KernelCache(caching.FunctionCache):
    _impl_class = _KernelCacheImpl

    def __init__(self, function: Callable[..., Any], title: str) -> None:
        super().__init__(function)
        self._title = title

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Compiled code from disk, the user's or the package's, or None when there is none that can be read.

        numba would first import everything that compiling may need, which takes longer than the rest of the start.
        """
        rtsys.initialize(target_context)
        for load in (self._load_overload, self._load_shipped):
            with contextlib.suppress(*_UNREADABLE):
                if (compiled := load(sig, target_context)) is not None:
                    return compiled
        if not _may_compile:
            raise NotCompiled(self._title)
        _announce(self._title)
        return None

    def _load_shipped(self, sig: Any, target_context: Any) -> Any:
        """Compiled code that the package brings for processors like this one, or None."""
        stamp = self._impl.locator.get_source_stamp()
        for kernels in shipped():
            file = caching.IndexDataCacheFile(str(kernels.folder), self._impl.filename_base, stamp)
            if (data := file.load(self._index_key(sig, kernels))) is not None:
                return self._impl.rebuild(target_context, data)
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Store compiled code, also over unreadable files; a full or read-only disk means compiling at every start."""
        try:
            try:
                super().save_overload(sig, data)
            except _UNREADABLE:
                self.flush()
                super().save_overload(sig, data)
        except OSError:
            self.disable()


def keep_on_disk(dispatcher: Any, title: str) -> None:
    """Have a dispatcher load and store compiled code on disk; `title`: the solver that it belongs to, for messages."""
    dispatcher._cache = _KernelCache(dispatcher.py_func, title)
