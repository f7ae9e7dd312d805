"""Tyre rig with one wheel on level ground, computed by the tyre kernel of the tractor.

The wheel centre moves at a constant velocity and height. The wheel's heading is along x, and its spin is imposed. The
forces are reported by the kernel. The moment is the vertical component of the kernel's wrench.
"""

from typing import NamedTuple

import numpy as np

from agrobot_mj.core.kernels import jit
from agrobot_mj.core.signals import Array
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.terrain import Flat
from agrobot_mj.terrain.grid import Ground
from agrobot_mj.tyres import TyreBase
from agrobot_mj.tyres.base import Footing
from agrobot_mj.tyres.laws import slip_stiffness, tyre_set, wheel_step
from agrobot_mj.tyres.patch import FORCE_X, FORCE_Y, LOAD, TyreSet, WheelMotion

DT_S = 0.002  # Time step of the rig [s], equal to the default physics step
SETTLE_LENGTHS = 25.0  # Distance before a measurement [relaxation lengths]; a transient decays by exp(-25) = 1e-11
MOST_RADII = 10.0
"""Maximum relaxation length divided by free radius [-], as for scenario files. A longer relaxation length makes tests
too long."""
FRONT, REAR = 0, 2  # Indices of the front and rear wheel whose tyres are tested
AXLES = {"front": FRONT, "rear": REAR}


class Setting(NamedTuple):
    """Motion and load that the rig imposes on a wheel."""

    speed: float  # Speed of the wheel centre along its heading [m/s]
    slip_angle: float  # Angle from heading to velocity [rad], positive if the wheel slides to the left
    slip_ratio: float  # Slip ratio (rim speed - v) / v [-], positive when driving
    load: float  # Vertical load [N]


class Reading(NamedTuple):
    """Forces and moment measured by the rig."""

    fx: float  # Longitudinal force [N], positive forward
    fy: float  # Lateral force [N], positive to the left
    mz: float  # Moment about the vertical axis through the wheel centre [N m], positive counter-clockwise from above
    load: float  # Vertical load [N]
    grounded: float  # Fraction of time in contact with the ground [-]


def static_load(tractor: TractorParameters, wheel: int) -> float:
    """Return the static load of one wheel on level ground [N]."""
    return (tractor.front_wheel if wheel == FRONT else tractor.rear_wheel).load


@jit
def drive_wheel(tyres: TyreSet, i: int, ground: Ground, setting: Setting, dt: float, out: Array) -> None:
    """Simulate the rig wheel with initially undeflected bristles. Write one `Reading` per step to `out` (steps, 5)."""
    deflection = setting.load / tyres.stiffness[i]
    r_e = tyres.radius[i] - deflection / 3.0
    centre = (0.0, 0.0, tyres.radius[i] - deflection)
    axle = (0.0, 1.0, 0.0)
    velocity = (setting.speed, setting.speed * np.tan(setting.slip_angle), 0.0)
    rotation = (0.0, (1.0 + setting.slip_ratio) * setting.speed / r_e, 0.0)
    motion = WheelMotion(centre, axle, velocity, rotation)
    bristle, wrench, report = np.zeros(4), np.zeros(6), np.zeros(6)
    for k in range(out.shape[0]):
        wheel_step(tyres, i, ground, motion, dt, bristle, wrench, report)
        out[k, 0], out[k, 1], out[k, 2] = report[FORCE_X], report[FORCE_Y], wrench[5]
        out[k, 3], out[k, 4] = report[LOAD], 1.0 if report[LOAD] > 0.0 else 0.0


class Rig:
    """Tyre rig for one wheel of a tractor, computed by the tyre kernel."""

    def __init__(self, tyre: TyreBase, tractor: TractorParameters, wheel: int = FRONT, dt: float = DT_S) -> None:
        self.tyres, self.wheel, self.dt = tyre_set(tyre, tractor), wheel, dt
        self.ground = Flat().ground()
        self.relaxation = float(self.tyres.relaxation[wheel].max())
        if not self.relaxation <= MOST_RADII * self.tyres.radius[wheel]:
            radii = self.relaxation / self.tyres.radius[wheel]
            raise ValueError(f"the relaxation length must be at most {MOST_RADII:g} wheel radii, got {radii:g}")

    def history(self, setting: Setting, distance_m: float) -> Array:
        """Impose the motion of a setting over `distance_m` [m], starting with undeflected bristles. Return one
        `Reading` per time step, shape (steps, 5)."""
        out = np.zeros((max(2, round(distance_m / (setting.speed * self.dt))), 5))
        drive_wheel(self.tyres, self.wheel, self.ground, setting, self.dt, out)
        return out

    def steady(self, setting: Setting) -> Reading:
        """Return forces, moment and fraction of time in contact with the ground in steady state."""
        return Reading(*self.history(setting, SETTLE_LENGTHS * self.relaxation_at(setting.load))[-1].tolist())

    def relaxation_at(self, load: float) -> float:
        """Return the maximum of the longitudinal and the lateral relaxation length [m] at a load [N]."""
        t, i = self.tyres, self.wheel
        law = t.front if i < 2 else t.rear
        K = slip_stiffness(law, load, load / t.stiffness[i], Footing(1.0, t.cone_index), 0.0, 0.0)
        return float(max(K / t.springs[i]))
