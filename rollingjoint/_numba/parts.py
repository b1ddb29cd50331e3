"""Functions that numba types and lowers, and leaves to the kernel that calls them to optimise.

numba would optimise a function anew in every caller of a caller; parts wait for the kernel that holds them all.
"""

from __future__ import annotations

from typing import Any

from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import LoweringPass, register_pass
from numba.core.registry import CPUDispatcher
from numba.core.typed_passes import AnnotateTypes


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


class PartCompiler(CompilerBase):
    """numba's compiler with the library above."""

    def define_pipelines(self) -> list[Any]:
        """numba's own passes, and the library in place of its own before code is made."""
        passes = DefaultPassBuilder.define_nopython_pipeline(self.state)
        passes.add_pass_after(_UsePartLibrary, AnnotateTypes)
        passes.finalize()
        return [passes]


class PartDispatcher(CPUDispatcher):
    """What stands for a part in Python."""

    def __call__(self, *args: Any) -> Any:
        """Raise TypeError: there is no machine code that Python could call."""
        name = self.py_func.__name__
        raise TypeError(f"{name} is a part of kernels; standalone({name}) can be called from Python")
