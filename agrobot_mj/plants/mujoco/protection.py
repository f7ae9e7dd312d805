"""Error handling of MuJoCo functions in compiled kernels: an error sets a return value and does not end the process.

MuJoCo reports an error through `mju_error`, which does not return. MuJoCo's Python package converts errors of its own
calls to `mujoco.FatalError`, but an error in a kernel would end the process. Each C function is wrapped in a few lines
of LLVM code that store a jump target with `setjmp`; the error handler jumps to this target. Each thread has a separate
target.
"""

import ctypes
import os
import sys
from collections.abc import Mapping

import llvmlite.binding as llvm

Calls = Mapping[str, tuple[str, ...]]  # Names of the C functions that each wrapper calls, by name of the wrapper
NOTED = 1000  # Maximum length of a stored error message [bytes]
PROTECTED = sys.platform in ("linux", "darwin")
"""Whether MuJoCo errors are caught on this platform. On other platforms an error ends the process."""
_HEAD = """
@message = global [{size} x i8] zeroinitializer
declare i32 @_setjmp(ptr) returns_twice
declare void @longjmp(ptr, i32) noreturn
declare ptr @pthread_getspecific({key_type})
declare i32 @pthread_setspecific({key_type}, ptr)
declare ptr @strncpy(ptr, ptr, i64)

define void @agrobot_on_error(ptr %text) {{
  %place = call ptr @pthread_getspecific({key_type} {key})
  %outside = icmp eq ptr %place, null
  br i1 %outside, label %return, label %jump
jump:
  %to = getelementptr [{size} x i8], ptr @message, i64 0, i64 0
  %copied = call ptr @strncpy(ptr %to, ptr %text, i64 {last})
  call void @longjmp(ptr %place, i32 1)
  unreachable
return:
  ret void
}}
"""
_AROUND = """
define i32 @agrobot_{name}(i64 %model, i64 %data) {{
  %buffer = alloca [1024 x i8], align 16
  %place = getelementptr [1024 x i8], ptr %buffer, i64 0, i64 0
  %noted = call i32 @pthread_setspecific({key_type} {key}, ptr %place)
  %failed = call i32 @_setjmp(ptr %place) returns_twice
  %whole = icmp eq i32 %failed, 0
  br i1 %whole, label %work, label %end
work:
  {called}
  br label %end
end:
  %left = call i32 @pthread_setspecific({key_type} {key}, ptr null)
  ret i32 %failed
}}
"""
_PLAIN = """
define i32 @agrobot_{name}(i64 %model, i64 %data) {{
  {called}
  ret i32 0
}}
"""


class Protected:
    """Compiled wrappers of MuJoCo calls, which return 1 after an error of MuJoCo, else 0.

    Each wrapper executes several C functions of the type `void f(const mjModel*, mjData*)`.
    """

    def __init__(self, library: ctypes.CDLL, calls: Calls) -> None:
        self._engine = _compile_ir(_text(calls))
        self.addresses = {name: self._engine.get_function_address(f"agrobot_{name}") for name in calls}
        for name, address in self.addresses.items():
            llvm.add_symbol(f"agrobot_{name}", address)
        if PROTECTED:
            handler = ctypes.c_void_p.in_dll(library, "mju_user_error")
            handler.value = self._engine.get_function_address("agrobot_on_error")

    def message(self) -> str:
        """Return the message of the last MuJoCo error, or an empty string on platforms without error handling."""
        if not PROTECTED:
            return ""
        return ctypes.string_at(self._engine.get_global_value_address("message")).decode(errors="replace")


def _text(calls: Calls) -> str:
    functions = dict.fromkeys(function for sequence in calls.values() for function in sequence)
    declared = "".join(f"declare void @{function}(i64, i64)\n" for function in functions)
    bodies = {
        name: "\n  ".join(f"call void @{function}(i64 %model, i64 %data)" for function in sequence)
        for name, sequence in calls.items()
    }
    if not PROTECTED:
        return declared + "".join(_PLAIN.format(name=name, called=called) for name, called in bodies.items())
    kind = "i32" if sys.platform == "linux" else "i64"
    at = {"key_type": kind, "key": _thread_key(), "size": NOTED + 1, "last": NOTED}
    wrapped = "".join(_AROUND.format(name=name, called=called, **at) for name, called in bodies.items())
    return _HEAD.format(**at) + declared + wrapped


def _thread_key() -> int:
    key = ctypes.c_uint32() if sys.platform == "linux" else ctypes.c_ulong()
    if error := ctypes.CDLL(None).pthread_key_create(ctypes.byref(key), None):
        raise OSError(error, os.strerror(error))
    return key.value


def _compile_ir(text: str) -> llvm.ExecutionEngine:
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    module = llvm.parse_assembly(text)
    module.verify()
    engine = llvm.create_mcjit_compiler(module, llvm.Target.from_default_triple().create_target_machine())
    engine.finalize_object()
    return engine
