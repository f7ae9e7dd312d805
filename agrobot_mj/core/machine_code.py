"""Generation of machine code only for functions that Python calls.

Numba optimizes each function and generates its machine code, and then optimizes the function again as a part of each
caller. With this module, a function that only kernels call remains LLVM code, which its callers include. This
halves the compilation time and does not change results.
"""

from typing import Any

from llvmlite.binding import parse_assembly
from numba.core.codegen import JITCodeLibrary, JITCPUCodegen
from numba.core.compiler import CompileResult
from numba.core.environment import lookup_environment

from agrobot_mj.core.interrupts import deliver, until_the_end

ENVIRONMENT = "_ZN08NumbaEnv"  # Name prefix of the global variables that contain the Python constants of a function


class _Library(JITCodeLibrary):  # type: ignore[misc]
    """Library with the code of one function. Machine code is generated on the first request of its address."""

    _generated = False

    def _optimize_final_module(self) -> None:
        """Postpone the optimization until `_generate` is called."""

    def _finalize_final_module(self) -> None:
        """Check the LLVM code, or load the machine code if the function comes from the cache.

        Signals delayed by `deferring` take effect between two functions, because a kernel compiles for many seconds.
        """
        deliver()
        if self._disable_inspection:
            self._generated = True
            super()._finalize_final_module()
            return
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        self._finalized = True

    def _finalize_specific(self) -> None:
        """Generate machine code while signals are delayed, because LLVM discards exceptions of signal handlers."""
        with until_the_end():
            super()._finalize_specific()

    def get_pointer_to_function(self, name: str) -> int:
        """Return the address of a function, or 0 if this library does not define the function."""
        self._ensure_finalized()
        if not self._generated and any(f.name == name for f in self.get_defined_functions()):
            self._generate()
        return int(super().get_pointer_to_function(name))

    def _generate(self) -> None:
        self._generated = True
        super()._optimize_final_module()
        super()._finalize_final_module()
        for variable in self._final_module.global_variables:
            if variable.name.startswith(ENVIRONMENT) and (environment := lookup_environment(variable.name)):
                self._codegen.set_env(variable.name, environment)

    def serialize_using_object_code(self) -> tuple[Any, ...]:
        """Return the content of a cache file: machine code or, if none was generated, LLVM code."""
        kind = "object_code" if self._generated else "bitcode"
        return tuple(getattr(super(), f"serialize_using_{kind}")())

    def discard_llvm_code(self) -> None:
        """Replace the LLVM code, which no other function includes, by empty definitions of the names that numba looks
        up.

        Loading all LLVM code would take longer than loading the machine code.
        """
        variables = [v.name for v in self._final_module.global_variables if v.name.startswith(ENVIRONMENT)]
        text = [f'@"{name}" = global i64 0' for name in variables]
        text += [f'define void @"{function.name}"() {{ ret void }}' for function in self.get_defined_functions()]
        self._shared_module = parse_assembly("\n".join(text))


def _set_environment(codegen: Any, name: str, environment: Any) -> None:
    """Set the Python constants of a function if its machine code has been generated."""
    if codegen._engine.is_symbol_defined(name):
        _set(codegen, name, environment)


_set = JITCPUCodegen.set_env


def _environments_with_constants(found: CompileResult) -> list[Any]:
    """Return the numba environments of a compiled function that contain Python constants. Loading other environments
    would import their modules, which takes 0.1 s for numba's array functions."""
    return [environment for environment in _environments(found) if environment.consts]


_environments = CompileResult._find_referenced_environments


def generate_on_request() -> None:
    """Make numba generate the machine code of each function on the first request, for all functions of this process."""
    JITCPUCodegen._library_class, JITCPUCodegen.set_env = _Library, _set_environment
    CompileResult._find_referenced_environments = _environments_with_constants
