"""GNSS antenna on the implement: the fix is moved to the rear axle of the tractor, as in a guidance terminal.

The terminal is configured with the distance of the antenna behind the rear axle in straight driving, without hitch
angle. It moves the fix forward along the heading of the tractor. With the estimated heading, errors of the estimate
would move the fix, and the filter would interpret this as motion: with position and heading gains k_R and k_psi the
loop diverges for k_psi d > k_R. The heading is therefore the integral of a separate yaw rate, from the gyro or from
steering angle and speed, and follows the estimate slowly.
"""

from math import isfinite, tan
from typing import NamedTuple

from agrobot_mj.core.geometry import from_heading, wrap
from agrobot_mj.core.signals import Estimate, Measurement

SLOWLY_S = 3.0
"""Time constant with which the heading follows the estimate [s]. Assumed value: from gyro bias and filter."""


class ImplementReceiver(NamedTuple):
    """Antenna behind the rear axle, and the heading used to move its fixes to the axle."""

    behind: float
    """Distance behind the rear axle [m]; 0 for an antenna on the tractor."""
    wheelbase: float
    """Wheelbase of the tractor [m]."""
    yaw: float
    """Heading of the tractor [rad]."""
    speed: float = 0.0
    """Estimated speed of the last tick [m/s]."""

    def yaw_rate(self, measured: Measurement) -> float:
        """Return the yaw rate of the gyro or, without gyro, from steering angle and speed [rad/s]."""
        return measured.gyro if isfinite(measured.gyro) else self.speed * tan(measured.steer) / self.wheelbase

    def reduced(self, measured: Measurement) -> Measurement:
        """Return the measurement with the fix moved to the rear axle."""
        fix = measured.fix
        if self.behind == 0.0 or fix is None:
            return measured
        dx, dy = from_heading(self.yaw, self.behind, 0.0)
        vx, vy = from_heading(self.yaw, 0.0, self.behind * self.yaw_rate(measured))
        return measured._replace(fix=fix._replace(x=fix.x + dx, y=fix.y + dy, vx=fix.vx + vx, vy=fix.vy + vy))

    def after(self, measured: Measurement, estimate: Estimate, dt: float) -> "ImplementReceiver":
        """Return the receiver after `dt` [s], with the heading integrated."""
        if self.behind == 0.0:
            return self
        yaw = self.yaw + dt * (self.yaw_rate(measured) + wrap(estimate.yaw - self.yaw) / SLOWLY_S)
        return self._replace(yaw=wrap(yaw), speed=estimate.speed)
