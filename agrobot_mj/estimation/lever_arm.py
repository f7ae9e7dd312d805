"""Lever arms on a tilted tractor: horizontal offset of a body point from the rear axle, and correction of a fix.

R is the point on the ground below the centre of the rear axle. The attitude follows ISO 8855: yaw, then pitch, then
roll; roll is positive with the left side up, pitch is positive nose down [rad]. Arms are vectors from R in vehicle axes
(x forward, y left, z up) [m]; offsets are east and north [m].
"""

from math import exp, isnan, nan
from typing import NamedTuple

from agrobot_mj.core.geometry import from_heading, to_level
from agrobot_mj.core.kernels import kernel_method, shared
from agrobot_mj.core.signals import Fix


@shared
def offset(arm: tuple[float, float, float], roll: float, pitch: float, yaw: float) -> tuple[float, float]:
    """Return the east and north offset [m] from the rear-axle point R of a body point at `arm` in vehicle axes."""
    forward, left, _ = to_level(roll, pitch, arm)
    return from_heading(yaw, forward, left)


class Lever(NamedTuple):
    """Lever arm of the antenna: horizontal offset from the rear-axle point R, and rate of change of the offset."""

    offset: tuple[float, float]
    """East and north offset of the antenna from the rear-axle point R [m], or NaN before the first tick."""
    swing: tuple[float, float] = (0.0, 0.0)  # Filtered rate of the offset [m/s], east and north

    def after(self, offset: tuple[float, float], dt: float, filter_s: float) -> "Lever":
        """Return the lever arm after `dt` [s] at the new `offset` [m], with its rate filtered over `filter_s` [s]."""
        keep = exp(-dt / filter_s) if filter_s > 0.0 else 0.0
        (east, north), (last_east, last_north), (v_e, v_n) = offset, self.offset, self.swing
        if isnan(last_east):
            return Lever(offset, (0.0, 0.0))
        v_e = keep * v_e + (1.0 - keep) * (east - last_east) / dt
        v_n = keep * v_n + (1.0 - keep) * (north - last_north) / dt
        return Lever(offset, (v_e, v_n))


UNKNOWN = Lever((nan, nan))  # Lever arm before the first tick, with an unknown offset
kernel_method("after")


@shared
def at_foot(fix: Fix, lever: Lever) -> Fix:
    """Return the fix converted from the antenna to the rear-axle point R, in position and velocity."""
    (east, north), (v_e, v_n) = lever
    return Fix(fix.x - east, fix.y - north, fix.vx - v_e, fix.vy - v_n, fix.t, fix.z, fix.heading)
