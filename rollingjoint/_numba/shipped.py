"""Compiled kernels that a platform wheel brings, for families of processors; docs/install.md tells who gets them.

`.ci/platform_wheel.py` compiles them into `rollingjoint/machine_code/FAMILY/`, beside a `target.json` that says what
numba compiled for. They are found under the same hash of all sources as kernels in the user's cache, which go first.
"""

from __future__ import annotations

import functools
import json
from pathlib import Path
from typing import NamedTuple

import llvmlite.binding
import numba

from rollingjoint._numba.bounds import CHECKED

FOLDER = Path(__file__).parents[1] / "machine_code"
TARGET = "target.json"

_V2 = ("cx16", "sahf", "popcnt", "sse3", "sse4.1", "sse4.2", "ssse3")
_V3 = (*_V2, "avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe", "xsave")
_V4 = (*_V3, "avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl")
FAMILIES = {"x86-64-v4": ("x86_64", _V4), "x86-64-v3": ("x86_64", _V3), "generic": ("aarch64", ("neon",))}
"""By LLVM's names, the fastest first: the architecture, and what LLVM calls the features that such a processor has."""


class Shipped(NamedTuple):
    """Kernels of one family of processors: their folder, and what numba compiled them for."""

    folder: Path
    target: tuple[str, str, str]

    def magic_tuple(self) -> tuple[str, str, str]:
        """What numba's key on disk says of the processor."""
        return self.target


def runnable(family: str) -> bool:
    """True if this processor runs the code of a family, one of FAMILIES."""
    architecture, needs = FAMILIES[family]
    features = llvmlite.binding.get_host_cpu_features()
    return llvmlite.binding.get_process_triple().startswith(architecture) and all(map(features.get, needs))


@functools.cache
def shipped() -> tuple[Shipped, ...]:
    """What the package brings and this processor runs, the fastest first; nothing where numba was told a processor."""
    if CHECKED or numba.config.CPU_NAME is not None:  # type: ignore[attr-defined]
        return ()
    folders = [FOLDER / family for family in FAMILIES if (FOLDER / family / TARGET).is_file() and runnable(family)]
    targets = [json.loads((folder / TARGET).read_text("utf-8")) for folder in folders]
    here = llvmlite.binding.get_process_triple()
    return tuple(
        Shipped(folder, tuple(target)) for folder, target in zip(folders, targets, strict=True) if target[0] == here
    )
