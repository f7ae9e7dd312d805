"""C functions of MuJoCo that compiled kernels can call.

All physics steps of a tick run in one compiled loop (`mj_step1`, tyres, `mj_step2`) without returning to Python. Models
and data are passed as addresses. Each function returns 1 if MuJoCo has reported an error, else 0. With
`NUMBA_DISABLE_JIT=1` the functions are called through ctypes.
"""

import ctypes
import sys
from functools import cache
from pathlib import Path
from typing import Any, NoReturn

import llvmlite.binding as llvm
import mujoco
import numpy as np
from numba import config, types

from agrobot_mj.plants.mujoco.protection import Protected


def _library() -> str:
    folder = Path(mujoco.__file__).parent
    for pattern in ("libmujoco.so*", "libmujoco*.dylib", "mujoco.dll"):
        for path in sorted(folder.glob(pattern)):
            return str(path)
    raise ImportError(f"there is no MuJoCo library next to {mujoco.__file__}; reinstall the mujoco package")


_PATH = _library()
_C = ctypes.CDLL(_PATH)
llvm.load_library_permanently(_PATH)
clock = ctypes.c_void_p.in_dll(_C, "mjcb_time")
"""Clock callback of MuJoCo's profiler (`mjData.timer`), disabled here to save 6 % of the time of a physics step."""
INSTALLED = clock.value  # Address of the profiler clock, which is disabled here for the whole process
clock.value = None


def flags_of(model: mujoco.MjModel) -> Any:
    """Return the field `opt.disableflags` of a model as an array of shape (1,), for compiled kernels."""
    return np.ctypeslib.as_array((ctypes.c_int32 * 1).from_address(model._address + _offset_of_flags()))


@cache
def _offset_of_flags() -> int:
    """Return the position of `opt.disableflags` in `mjModel` [bytes], found by a number that occurs nowhere else."""
    model, number = mujoco.MjModel.from_xml_string("<mujoco/>"), 0x2A5A3C5A
    model.opt.disableflags = number
    return ctypes.string_at(model._address, 1 << 12).index(number.to_bytes(4, sys.byteorder))


_CALLS: dict[str, tuple[str, ...]] = {
    "step1": ("mj_step1",),
    "step1_again": (
        *("mj_checkPos", "mj_checkVel", "mj_kinematics", "mj_comPos", "mj_tendon"),
        *("mj_makeM", "mj_factorM", "mj_transmission", "mj_fwdVelocity"),
    ),
    "step2": ("mj_step2",),
    "kinematics": ("mj_kinematics",),
    "joint_forces": ("mj_rnePostConstraint",),
    "motions": ("mj_comPos", "mj_comVel"),
    "actuate": ("mj_fwdActuation",),
    "integrate": ("mj_checkAcc", "mj_implicit"),
}
PROTECTED = Protected(_C, _CALLS)


def _function(name: str) -> Any:
    if config.DISABLE_JIT:
        return ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)(PROTECTED.addresses[name])
    return types.ExternalFunction(f"agrobot_{name}", types.int32(types.intp, types.intp))


step1, step1_again, step2, kinematics, joint_forces, motions, actuate, integrate = map(_function, _CALLS)


def fail() -> NoReturn:
    """Raise `mujoco.FatalError` with the message of the last error, as MuJoCo's Python package does."""
    raise mujoco.FatalError(f"{PROTECTED.message()}; the state of this tractor is lost")
