"""Transfer of fixes from the GNSS antenna to the rear axle, as in a guidance terminal.

The terminal is configured with the distances of the antenna ahead and to the left of the rear axle. For an antenna on
an implement, the distance is valid for straight driving, without hitch angle. The terminal moves the fix along the
heading of the tractor. With an inertial unit it also corrects the lever arm for roll and pitch. Estimators compensate
for the height of the antenna.

If the terminal used the estimated heading, errors of the estimate would move the fix, and the filter would interpret
this displacement as motion. For position and heading gains k_R and k_psi and an antenna d ahead of the axle, the filter
diverges if k_psi d > k_R. The heading is therefore the integral of a separate yaw rate, from the gyro or from steering
angle and speed. This heading follows the estimate slowly.
"""

from math import isfinite, tan
from typing import NamedTuple

from agrobot_mj.core.geometry import from_heading, to_level, wrap
from agrobot_mj.core.held import Held
from agrobot_mj.core.kernels import fetched, shared
from agrobot_mj.core.signals import Estimate, Fix, Measurement
from agrobot_mj.estimation.base import Readings

SLOWLY_S = 3.0
"""Time constant of the heading correction [s]. Assumed value: low enough for gyro bias, high enough for stability."""


class MountedReceiver(NamedTuple):
    """Configured antenna position, and the heading that is used to move fixes to the rear axle."""

    arm: tuple[float, float]  # Distances of the antenna ahead and to the left of the rear axle [m]
    wheelbase: float  # Wheelbase of the tractor [m]
    yaw: float  # Heading of the tractor [rad]
    speed: float = 0.0  # Estimated speed of the last tick [m/s]
    t: float = 0.0  # Time at which the heading is valid [s]

    def at_rear_axle(self, measured: Measurement) -> Measurement:
        """Return the measurement with the fix moved to the rear axle, using the heading at the time of the fix."""
        fix = measured.fix
        if self.arm == (0.0, 0.0) or fix is None:
            return measured
        return measured._replace(fix=at_axle(self, Readings.of(measured), fix))

    def after(self, measured: Measurement, estimate: Held[Estimate], dt: float) -> "MountedReceiver":
        """Return the state of the receiver after a tick of `dt` [s], with the integrated heading."""
        if self.arm == (0.0, 0.0):
            return self
        estimate = fetched(estimate)
        return advance_receiver(self, Readings.of(measured), estimate.yaw, estimate.speed, dt)


@shared
def at_axle(s: MountedReceiver, m: Readings, fix: Fix) -> Fix:
    """Return the fix moved to the rear axle, using the heading at the time of the fix."""
    rate = _yaw_rate(s, m)
    yaw, ahead, left = s.yaw + rate * (fix.t - s.t), s.arm[0], s.arm[1]
    if isfinite(m.roll):
        ahead, left, _ = to_level(m.roll, m.pitch, (ahead, left, 0.0))
    dx, dy = from_heading(yaw, ahead, left)
    return Fix(fix.x - dx, fix.y - dy, fix.vx + rate * dy, fix.vy - rate * dx, fix.t, fix.z, fix.heading)


@shared
def advance_receiver(s: MountedReceiver, m: Readings, yaw: float, speed: float, dt: float) -> MountedReceiver:
    """Return the state of the receiver after a tick of `dt` [s], for the estimated `yaw` [rad] and `speed` [m/s]."""
    heading = s.yaw + dt * (_yaw_rate(s, m) + wrap(yaw - s.yaw) / SLOWLY_S)
    return MountedReceiver(s.arm, s.wheelbase, wrap(heading), speed, m.t)


@shared
def _yaw_rate(s: MountedReceiver, m: Readings) -> float:
    """Return the yaw rate [rad/s] from the gyro or, without a gyro, from steering angle and speed."""
    return m.gyro if isfinite(m.gyro) else s.speed * tan(m.steer) / s.wheelbase
