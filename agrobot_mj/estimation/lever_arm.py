"""Lever arms of a leaning tractor: where a point of the body lies horizontally from R, and a fix moved by it.

Attitude after ISO 8855 (yaw, then pitch, then roll; roll left side up, pitch nose down positive) [rad]; arms in
vehicle axes x forward, y left, z up from R [m]; offsets east and north [m].
"""

from math import exp
from typing import NamedTuple

from agrobot_mj.core.geometry import from_heading, to_level
from agrobot_mj.core.signals import Fix


def offset(arm: tuple[float, float, float], roll: float, pitch: float, yaw: float) -> tuple[float, float]:
    """East and north offset of a point of the body from R [m]."""
    forward, left, _ = to_level(roll, pitch, arm)
    return from_heading(yaw, forward, left)


class Lever(NamedTuple):
    """Lever arm of the antenna about R."""

    offset: tuple[float, float]
    """Offset from R, east and north [m]."""
    swing: tuple[float, float] = (0.0, 0.0)
    """Rate of the offset [m/s]."""

    def after(self, offset: tuple[float, float], dt: float, filter_s: float) -> "Lever":
        """Lever after the next offset [m], `dt` [s] later, its rate low-passed with time constant `filter_s` [s]."""
        keep = exp(-dt / filter_s) if filter_s > 0.0 else 0.0
        (east, north), (was_east, was_north), (v_e, v_n) = offset, self.offset, self.swing
        swing = keep * v_e + (1.0 - keep) * (east - was_east) / dt, keep * v_n + (1.0 - keep) * (north - was_north) / dt
        return Lever(offset, swing)


def at_foot(fix: Fix, lever: Lever) -> Fix:
    """The fix of R that belongs to a fix of the antenna."""
    (east, north), (v_e, v_n) = lever
    return fix._replace(x=fix.x - east, y=fix.y - north, vx=fix.vx - v_e, vy=fix.vy - v_n)
