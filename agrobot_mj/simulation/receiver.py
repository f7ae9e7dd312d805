"""A GNSS antenna on the implement: its fix moved to the tractor's rear axle, as a terminal does it.

The terminal knows how far behind the rear axle the antenna is when driving straight, not the angle at the hitch, and
moves the fix ahead along the tractor's heading. Were that heading the estimate itself, the fix would follow its errors
and the filter would take them for motion: with position and heading gains k_R and k_psi that diverges where
k_psi d > k_R. So the heading is the integral of a yaw rate from elsewhere, the gyro or steering angle and speed, and
follows the estimate only slowly.
"""

from math import isfinite, tan
from typing import NamedTuple

from agrobot_mj.core.geometry import from_heading, wrap
from agrobot_mj.core.signals import Estimate, Measurement

SLOWLY_S = 3.0
"""Time constant with which the heading follows the estimate [s]. Assumed value: a gyro's bias against the filter's
own."""


class ImplementReceiver(NamedTuple):
    """An antenna behind the rear axle, and the heading with which its fixes are moved to the axle."""

    behind: float
    """Distance behind the rear axle, 0 for an antenna on the tractor [m]."""
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
        """The measurement with its fix at the rear axle."""
        fix = measured.fix
        if self.behind == 0.0 or fix is None:
            return measured
        dx, dy = from_heading(self.yaw, self.behind, 0.0)
        vx, vy = from_heading(self.yaw, 0.0, self.behind * self.yaw_rate(measured))
        return measured._replace(fix=fix._replace(x=fix.x + dx, y=fix.y + dy, vx=fix.vx + vx, vy=fix.vy + vy))

    def after(self, measured: Measurement, estimate: Estimate, dt: float) -> "ImplementReceiver":
        """The receiver with its heading advanced by `dt` [s]."""
        if self.behind == 0.0:
            return self
        yaw = self.yaw + dt * (self.yaw_rate(measured) + wrap(estimate.yaw - self.yaw) / SLOWLY_S)
        return self._replace(yaw=wrap(yaw), speed=estimate.speed)
