"""How numba compiles a function inside a kernel: for those that take it in, and for nobody else.

numba makes machine code of every function that it compiles.  The functions inside a kernel are
inlined, so that theirs would never run: it is left out, a quarter of the time of the first flight.
"""

# numba has no types for what is derived from here.
# mypy: disable-error-code="no-untyped-call"

from __future__ import annotations

from typing import Any

from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import AnalysisPass, register_pass
from numba.core.typed_passes import AnnotateTypes


class _Unaddressed:
    """What stands for the code generator of a library without addresses."""

    def set_env(self, _name: str, _environment: object) -> None:
        """Whoever takes the code in has an environment of its own."""


class InnerLibrary(JITCodeLibrary):
    """LLVM's code of a function, optimized, for other libraries to link."""

    @property
    def codegen(self) -> _Unaddressed:
        """Of `get_executable`, which gives the machine code its environment."""
        return _Unaddressed()

    def get_pointer_to_function(self, name: str) -> int:  # noqa: ARG002
        """No symbol has an address."""
        return 0

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        self._finalized = True


@register_pass(mutates_CFG=False, analysis_only=True)
class _TakenIn(AnalysisPass):
    _name = "taken_in"

    def __init__(self) -> None:
        AnalysisPass.__init__(self)

    def run_pass(self, state: Any) -> bool:
        """Lowering fills this library in the place of one that it would make."""
        state.library = InnerLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        return False


class InnerCompiler(CompilerBase):
    """`pipeline_class` of functions inside a kernel."""

    def define_pipelines(self) -> list[Any]:
        """numba's own, with another library."""
        passes = DefaultPassBuilder.define_nopython_pipeline(self.state)
        passes.add_pass_after(_TakenIn, AnnotateTypes)
        passes.finalize()
        return [passes]
