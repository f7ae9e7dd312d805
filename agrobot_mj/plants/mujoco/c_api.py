"""MuJoCo's C functions, callable from compiled kernels.

A whole tick of physics runs inside one compiled loop: `mj_step1`, the tyres, `mj_step2`, without going back to Python
in between. Models and data pass as addresses. Under `NUMBA_DISABLE_JIT=1` the same functions come from ctypes.
"""

import ctypes
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
import mujoco
from numba import config, types


def _library() -> str:
    folder = Path(mujoco.__file__).parent
    for pattern in ("libmujoco.so*", "libmujoco*.dylib", "mujoco.dll"):
        for path in sorted(folder.glob(pattern)):
            return str(path)
    raise ImportError(f"no MuJoCo library beside {mujoco.__file__}; reinstall the mujoco package")


_PATH = _library()
_C = ctypes.CDLL(_PATH)
llvm.load_library_permanently(_PATH)
clock = ctypes.c_void_p.in_dll(_C, "mjcb_time")
"""Clock of MuJoCo's profile `mjData.timer`, which its Python package installs: reading it takes 6 % of a step."""
INSTALLED = clock.value
"""Address of that clock, stopped here for the whole process."""
clock.value = None


def _function(name: str) -> Any:
    """A C function void f(const mjModel*, mjData*)."""
    if config.DISABLE_JIT:
        function = getattr(_C, name)
        function.argtypes, function.restype = [ctypes.c_void_p, ctypes.c_void_p], None
        return function
    return types.ExternalFunction(name, types.void(types.intp, types.intp))


step1 = _function("mj_step1")
step2 = _function("mj_step2")
kinematics = _function("mj_kinematics")
