"""What pulls at the chassis besides the tyres: an implement at the hitch, and a side force.

The side force acts on the tractor's centre of mass, horizontally, to the left of the heading. The implement resists
every motion of the hitch along the ground, that is in the chassis' own x-y plane, ahead, back or sideways. It works the
soil up over a short way and gives way to no pull below its own: its deflection z, a vector, follows

    dz/dt = v - (|v| / GIVE + 1 / EASE) z,        force = -pull z / GIVE,

with v the hitch's velocity. Moving, |z| is GIVE to within GIVE / (|v| EASE), and the force is the pull against the
motion; a tractor that is too weak for it stops; at rest the force eases to nothing.
"""

from math import hypot
from typing import NamedTuple

import numpy as np

from agrobot_mj.compiled import jit
from agrobot_mj.plants.views import CHASSIS, Views
from agrobot_mj.signals import Array
from agrobot_mj.tyres.patch import cross, relax

GIVE = 0.03
"""Way over which the soil before an implement builds up its resistance [m]. Estimate."""
EASE = 10.0
"""At rest the resistance eases off over this time [s]. Estimate; it lets a stuck tractor creep by 3 mm/s at most."""
PULL, SIDE = 0, 1
"""Entries of `Loads.given`."""


class Loads(NamedTuple):
    """Forces on the chassis; arrays are written in place."""

    given: Array
    """Pull of the implement and side force, left positive, shape (2,) [N]."""
    hitch: Array
    """Its place in the chassis frame, shape (3,) [m]."""
    deflection: Array
    """z above, ahead and left in the chassis frame, shape (2,) [m]."""


def no_loads(behind: float, height: float) -> Loads:
    """Nothing, with the hitch `behind` the rear axle and `height` above the ground [m]."""
    return Loads(np.zeros(2), np.array([-behind, 0.0, height]), np.zeros(2))


@jit
def apply_loads(v: Views, loads: Loads, dt: float) -> None:
    """Write the loads' wrench about the chassis' own centre of mass into `xfrc_applied`, and step the implement."""
    wrench = v.xfrc[CHASSIS]
    wrench[:] = 0.0
    if loads.given[PULL] > 0.0:
        pull_back(v, loads, dt, wrench)
    else:
        loads.deflection[:] = 0.0
    side = loads.given[SIDE]
    if side != 0.0:
        R = v.xmat[CHASSIS]
        level = side / hypot(R[0], R[3])
        push(v, (v.root_com[0], v.root_com[1], v.root_com[2]), (-level * R[3], level * R[0], 0.0), wrench)


@jit
def pull_back(v: Views, loads: Loads, dt: float, wrench: Array) -> None:
    """Add the implement's resistance to the wrench (6,)."""
    R, q, w, h, z = v.xmat[CHASSIS], v.qpos, v.qvel, loads.hitch, loads.deflection
    ahead = R[0] * w[0] + R[3] * w[1] + R[6] * w[2] + w[4] * h[2] - w[5] * h[1]
    left = R[1] * w[0] + R[4] * w[1] + R[7] * w[2] + w[5] * h[0] - w[3] * h[2]
    wiping = hypot(ahead, left) + GIVE / EASE
    z[0], z[1] = relax(z[0], ahead, wiping, GIVE, dt), relax(z[1], left, wiping, GIVE, dt)
    x, y = -loads.given[PULL] * z[0] / GIVE, -loads.given[PULL] * z[1] / GIVE
    point = (
        q[0] + R[0] * h[0] + R[1] * h[1] + R[2] * h[2],
        q[1] + R[3] * h[0] + R[4] * h[1] + R[5] * h[2],
        q[2] + R[6] * h[0] + R[7] * h[1] + R[8] * h[2],
    )
    push(v, point, (R[0] * x + R[1] * y, R[3] * x + R[4] * y, R[6] * x + R[7] * y), wrench)


@jit
def push(v: Views, point: tuple[float, float, float], force: tuple[float, float, float], wrench: Array) -> None:
    """Add a force [N] at a point of the chassis [m] to the wrench (6,), all in the world's frame."""
    c = v.xipos[CHASSIS]
    torque = cross((point[0] - c[0], point[1] - c[1], point[2] - c[2]), force)
    for k in range(3):
        wrench[k] += force[k]
        wrench[3 + k] += torque[k]
