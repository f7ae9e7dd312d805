"""Lever arms of a leaning tractor: where a point of the body lies horizontally from R, and a fix moved by it.

Attitude after ISO 8855 (yaw, then pitch, then roll; roll left side up, pitch nose down positive) [rad]; arms in
vehicle axes x forward, y left, z up from R [m]; offsets east and north [m].
"""

from math import cos, sin

from agrobot_mj.signals import Fix


def offset(arm: tuple[float, float, float], roll: float, pitch: float, yaw: float) -> tuple[float, float]:
    """East and north of a point of the body, seen from R [m]."""
    x, y, z = arm
    forward = cos(pitch) * x + sin(pitch) * (sin(roll) * y + cos(roll) * z)
    left = cos(roll) * y - sin(roll) * z
    return cos(yaw) * forward - sin(yaw) * left, sin(yaw) * forward + cos(yaw) * left


def moved(fix: Fix, by: tuple[float, float], swing: tuple[float, float]) -> Fix:
    """The fix of the point that lies `by` [m] short of the antenna, which moves by `swing` [m/s] against it."""
    return Fix(x=fix.x - by[0], y=fix.y - by[1], vx=fix.vx - swing[0], vy=fix.vy - swing[1])
