"""From kernels and their parts to machine code.

numba would optimise a function anew in every caller of a caller; parts are typed and lowered, and wait for the kernel
that holds them all. LLVM would copy the loops of a kernel, to unroll and to vectorise them; loops that are short, or
over SIMD lanes already, would be no faster and take longer to compile.
"""

from __future__ import annotations

from typing import Any

import llvmlite.binding as llvm
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import LoweringPass, register_pass
from numba.core.registry import CPUDispatcher
from numba.core.typed_passes import AnnotateTypes


class _ShortLoopsLibrary(JITCodeLibrary):
    """Code of a kernel with its loops neither unrolled nor vectorised."""

    def _optimize_final_module(self) -> None:
        options = llvm.create_pipeline_tuning_options(speed_level=3)
        options.loop_unrolling = options.loop_vectorization = False
        passes = llvm.create_pass_builder(self._codegen._tm, options)
        manager = passes.getModulePassManager()
        manager.add_refprune_pass()
        manager.run(self._final_module, passes)


class _NoEnvironments:
    @staticmethod
    def set_env(name: str, environment: Any) -> None:
        """Parts have no environment: ignored."""


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


class _UseLibrary(LoweringPass):
    """Take a library of this class before code is made."""

    library: type[JITCodeLibrary]

    def __init__(self) -> None:
        LoweringPass.__init__(self)

    def run_pass(self, state: Any) -> bool:
        codegen = state.targetctx.codegen()
        state.library = self.library(codegen, state.func_id.func_qualname)
        state.library.enable_object_caching()
        return True


@register_pass(mutates_CFG=False, analysis_only=False)
class _UseShortLoopsLibrary(_UseLibrary):
    _name, library = "use_short_loops_library", _ShortLoopsLibrary


@register_pass(mutates_CFG=False, analysis_only=False)
class _UsePartLibrary(_UseLibrary):
    _name, library = "use_part_library", _PartLibrary


class _Compiler(CompilerBase):
    """numba's compiler with one of the libraries above."""

    use_library: type[_UseLibrary]

    def define_pipelines(self) -> list[Any]:
        """numba's own passes, and that one."""
        passes = DefaultPassBuilder.define_nopython_pipeline(self.state)
        passes.add_pass_after(self.use_library, AnnotateTypes)
        passes.finalize()
        return [passes]


class ShortLoopsCompiler(_Compiler):
    """The compiler of kernels with short loops."""

    use_library = _UseShortLoopsLibrary


class PartCompiler(_Compiler):
    """The compiler of parts."""

    use_library = _UsePartLibrary


class PartDispatcher(CPUDispatcher):
    """A part as Python sees it."""

    def __call__(self, *args: Any) -> Any:
        """Raise TypeError: there is no machine code that Python could call."""
        name = self.py_func.__name__
        raise TypeError(f"{name} is a part of kernels; standalone({name}) can be called from Python")
