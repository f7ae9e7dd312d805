"""Physics steps of a single wheel, for tests of tyre laws."""

import numpy as np

from agrobot_mj.core.kernels import bound
from agrobot_mj.tyres.laws import wheel_step
from agrobot_mj.tyres.patch import WheelMotion


def step_of(tyres, ground):
    """Return `wheel_step`, compiled for the types of a tyre set and a ground. Calls of `wheel_step` itself take ten
    times as long, because numba determines the types of all arguments."""
    at_rest = WheelMotion((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    step = bound(wheel_step, tyres, 0, ground, at_rest, 0.002, np.zeros(4), np.zeros(6), np.zeros(6), True)
    return lambda *arguments: step(*arguments, True)
