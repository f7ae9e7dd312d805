"""Loads on the chassis from the faults `drawbar` (pull of an implement at the hitch) and `side_force`.

The side force acts horizontally at the tractor's centre of mass, positive to the left of the heading. The soil
resistance of the implement opposes every motion of the hitch in the x-y plane of the chassis: forward, backward and
sideways. The resistance builds up over a short distance. The deflection vector z of the soil follows

  dz/dt = v - (|v| / GIVE + 1 / EASE) z,        force = -pull z / GIVE,

with the hitch velocity v. In motion |z| equals GIVE with a relative error of GIVE / (|v| EASE), and the force is the
pull against the motion. A tractor that is too weak for the pull stops. At rest the force decays to zero.
"""

from math import hypot

import numpy as np

from agrobot_mj.core.kernels import kernel
from agrobot_mj.core.signals import Array
from agrobot_mj.core.vectors import Vector, cross, minus, plus, scale, to_world
from agrobot_mj.plants.mujoco.views import CHASSIS, Views
from agrobot_mj.tyres.patch import relax

GIVE = 0.03  # Distance over which the soil resistance of a tool builds up [m]. Assumed value.
EASE = 10.0
"""Time constant of the resistance's decay at rest [s]. Assumed value: stuck tractors then creep at 3 mm/s or less."""
PULL, SIDE, BEHIND, HEIGHT, AHEAD, LEFT, CENTRE = range(7)
HUNG = CENTRE + 3
"""Index of the last element of the load array, shape (10,), which passes all loads to the compiled loop.

The elements are: pull, and side force to the left [N]; distance of the hitch behind the rear axle and above the ground
[m]; deflection z ahead and to the left in the chassis frame [m]; centre of mass of the chassis in its frame (3
elements) [m]; mass of the implement divided by mass of the tractor [-].
"""


def no_loads(behind: float, height: float) -> Array:
    """Return a load array (10,) without forces, for a hitch `behind` the rear axle and `height` above ground [m]."""
    loads = np.zeros(10)
    loads[BEHIND], loads[HEIGHT] = behind, height
    return loads


@kernel
def apply_loads(v: Views, loads: Array, dt: float) -> None:
    """Write the wrench of the loads on the chassis to `xfrc_applied`, and advance the soil deflection at the hitch."""
    wrench = v.xfrc[CHASSIS]
    wrench[:] = 0.0
    R = v.xmat[CHASSIS]
    # without a pull the deflection is zero: the resistance builds up again with the next pull
    if loads[PULL] > 0.0:
        pull_back(v, loads, dt, wrench)
    else:
        loads[AHEAD], loads[LEFT] = 0.0, 0.0
    if loads[SIDE] != 0.0:
        # horizontal for any roll and pitch: perpendicular to the heading, a unit vector on the ground
        level = loads[SIDE] / hypot(R[0], R[3])
        # at the centre of mass of the whole tractor, so that the force alone causes no rotation
        whole, hung = v.root_com, v.implement_com
        com = (whole[0], whole[1], whole[2])
        place = minus(com, (v.qpos[0], v.qpos[1], v.qpos[2]))
        if loads[HUNG] > 0.0:  # centre of mass of the tractor without its implement
            place = plus(place, scale(loads[HUNG], minus(com, (hung[0], hung[1], hung[2]))))
        push(R, loads, place, (-level * R[3], level * R[0], 0.0), wrench)


@kernel
def pull_back(v: Views, loads: Array, dt: float, wrench: Array) -> None:
    """Add the soil resistance of the implement to the wrench on the chassis (6,), and advance the soil deflection."""
    R, w, x, z = v.xmat[CHASSIS], v.qvel, -loads[BEHIND], loads[HEIGHT]
    # velocity of the hitch in the chassis frame: R^T v + omega x r; qvel already has omega in this frame
    ahead = R[0] * w[0] + R[3] * w[1] + R[6] * w[2] + w[4] * z
    left = R[1] * w[0] + R[4] * w[1] + R[7] * w[2] + w[5] * x - w[3] * z
    wiping = hypot(ahead, left) + GIVE / EASE
    loads[AHEAD] = relax(loads[AHEAD], ahead, wiping, GIVE, dt)
    loads[LEFT] = relax(loads[LEFT], left, wiping, GIVE, dt)
    f_x, f_y = -loads[PULL] * loads[AHEAD] / GIVE, -loads[PULL] * loads[LEFT] / GIVE
    push(R, loads, to_world(R, (x, 0.0, z)), to_world(R, (f_x, f_y, 0.0)), wrench)


@kernel
def push(R: Array, loads: Array, place: Vector, force: Vector, wrench: Array) -> None:
    """Add a force [N] at `place`, relative to the chassis origin [m], to the wrench (6,); vectors are in world axes."""
    # xfrc_applied acts at the chassis' own centre of mass, which a payload moves
    c = loads[CENTRE:]
    torque = cross(
        (
            place[0] - R[0] * c[0] - R[1] * c[1] - R[2] * c[2],
            place[1] - R[3] * c[0] - R[4] * c[1] - R[5] * c[2],
            place[2] - R[6] * c[0] - R[7] * c[1] - R[8] * c[2],
        ),
        force,
    )
    for k in range(3):
        wrench[k] += force[k]
        wrench[3 + k] += torque[k]
