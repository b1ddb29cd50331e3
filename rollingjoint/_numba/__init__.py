"""Everything that touches numba's inside; this folder's README.md lists its gains and the interfaces it relies on.

Modules:
    borrowed: arrays without reference counts.
    bounds: the mode in which every index is checked.
    cache: compiled kernels on disk.
    jit: kernels, their parts, their machine code.
    layout: NamedTuples of arrays, as their annotations declare them.
    parts: functions that are optimised inside the kernels that call them.
    pins: NamedTuples of arrays by one address; memory carved into them.
    shipped: compiled kernels that the package brings.
    simd: eight numbers side by side.
    views: other views of borrowed memory.
"""

import numba as _numba

_LOWEST, _BEYOND = (0, 68), (0, 69)  # as in pyproject.toml: private parts of numba, which change


def _check(version: str, disabled: bool) -> None:
    """Raise ImportError, in one line, for a numba that kernels cannot be compiled with."""
    if not _LOWEST <= tuple(map(int, version.split(".")[:2])) < _BEYOND:
        allowed = f">={'.'.join(map(str, _LOWEST))},<{'.'.join(map(str, _BEYOND))}"
        raise ImportError(f"rollingjoint needs numba{allowed}, found {version}: run pip install 'numba{allowed}'")
    if disabled:
        raise ImportError("rollingjoint's kernels have to be compiled: unset NUMBA_DISABLE_JIT")


_check(_numba.__version__, bool(_numba.config.DISABLE_JIT))  # type: ignore[attr-defined]
