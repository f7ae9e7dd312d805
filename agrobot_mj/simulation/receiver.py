"""GNSS antenna on the implement: its fix is moved to the tractor's rear axle, as in a guidance terminal.

The terminal is configured with the distance of the antenna behind the rear axle when driving straight, without the
hitch angle, and moves the fix ahead along the tractor's heading. If that heading were the estimate itself, the fix
would follow its errors, which the filter would interpret as motion: with position and heading gains k_R and k_psi the
loop diverges for k_psi d > k_R. Therefore the heading is the integral of another yaw rate, from the gyro or from
steering angle and speed, and follows the estimate slowly.
"""

from math import isfinite, tan
from typing import NamedTuple

from agrobot_mj.core.geometry import from_heading, wrap
from agrobot_mj.core.signals import Estimate, Measurement

SLOWLY_S = 3.0
"""Time constant with which the heading follows the estimate [s]. Assumed value: gyro bias versus the filter's time
constant."""


class ImplementReceiver(NamedTuple):
    """Antenna behind the rear axle, and the heading with which its fixes are moved to the axle."""

    behind: float
    """Distance behind the rear axle; 0 for an antenna on the tractor [m]."""
    wheelbase: float
    """Wheelbase of the tractor [m]."""
    yaw: float
    """Heading [rad]."""
    speed: float = 0.0
    """Estimated speed of the last tick [m/s]."""

    def yaw_rate(self, measured: Measurement) -> float:
        """Yaw rate from the gyro, or from steering angle and speed without one [rad/s]."""
        return measured.gyro if isfinite(measured.gyro) else self.speed * tan(measured.steer) / self.wheelbase

    def reduced(self, measured: Measurement) -> Measurement:
        """Return the measurement with its fix at the rear axle."""
        fix = measured.fix
        if self.behind == 0.0 or fix is None:
            return measured
        dx, dy = from_heading(self.yaw, self.behind, 0.0)
        vx, vy = from_heading(self.yaw, 0.0, self.behind * self.yaw_rate(measured))
        return measured._replace(fix=fix._replace(x=fix.x + dx, y=fix.y + dy, vx=fix.vx + vx, vy=fix.vy + vy))

    def after(self, measured: Measurement, estimate: Estimate, dt: float) -> "ImplementReceiver":
        """Return the receiver with its heading advanced by `dt` [s]."""
        if self.behind == 0.0:
            return self
        yaw = self.yaw + dt * (self.yaw_rate(measured) + wrap(estimate.yaw - self.yaw) / SLOWLY_S)
        return self._replace(yaw=wrap(yaw), speed=estimate.speed)
