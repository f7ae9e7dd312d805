"""What keeps a tractor from coming to rest before its run starts, in words that name the key to change."""

from math import atan, cos, degrees, hypot, sin
from typing import NamedTuple

from agrobot_mj.core.signals import Array
from agrobot_mj.machine import Machine
from agrobot_mj.machine.tractor import GRAVITY
from agrobot_mj.plants.mujoco.stepping import Oil
from agrobot_mj.terrain import Ground, height_and_gradient

REST_M_S, REST_S = 0.0005, 1.0
"""A tractor whose CG and whose ends, a metre off, stayed slower for this time is at rest [m/s, s]. Estimate: longer
than the period of its modes on the tyres."""
AT_THE_LIMIT = 0.99
"""Share of the hydrostat's relief torque from which it does not hold the tractor by itself [-]."""
AWAY_M = 0.05
"""Way from where it was placed that a tractor on its tyres alone does not move [m]. Estimate: it sags by a third."""
ROLLING = 0.5
"""Speed of the rear wheels' rims over that of the tractor from which it rolls and does not slide [-]."""


class Restless(NamedTuple):
    """A tractor that does not come to rest."""

    x: float
    """CG, east [m]."""
    y: float
    """CG, north [m]."""
    yaw: float
    """Heading [rad]."""
    speed: float
    """Greatest speed of late [m/s]."""
    ahead: float
    """Velocity along the heading [m/s]."""
    rim: float
    """Mean rim speed of the rear wheels [m/s]."""
    away: float
    """Distance from where it was placed [m]."""
    mass: float
    """Mass with all that it carries and draws [kg]."""
    wheels: Array
    """Report of the tyres, shape (4, 6): see `tyres.patch`; the last column is the use of friction."""


def drive_holds(oil: Oil, connected: bool, torque: float) -> bool:
    """Whether the hydrostat, which now bears `torque` [N m], holds the tractor without its brake."""
    return connected and abs(torque) < AT_THE_LIMIT * oil.drive_torque


def steepness(ground: Ground, x: float, y: float) -> tuple[float, float, float]:
    """Angle of the ground at a place [rad], and its gradient to the east and the north [-]."""
    _, east, north = height_and_gradient(ground, x, y)
    return atan(hypot(east, north)), east, north


def unrest(found: Restless, machine: Machine, ground: Ground) -> str:
    """Why it does not rest: its drive gives way, it slides, or it rocks, creeps or sinks; with the keys to change."""
    slope, east, north = steepness(ground, found.x, found.y)
    where = f"on ground of {degrees(slope):.1f} deg"
    if found.away < AWAY_M:
        return f"it creeps, rocks or sinks {where}, where it was placed: plant.tyre and tractor.*_tyre_damping_n_s_m"
    rolls = found.rim * found.ahead > 0.0 and abs(found.rim) > ROLLING * found.speed
    if not rolls:
        used = 100 * float(found.wheels[:, 5].max())
        return (
            f"it slides {where} with its wheels held, at {used:.0f} % of the tyres' grip: "
            "gentler ground (terrain), or more grip (plant.tyre)"
        )
    along = atan(east * cos(found.yaw) + north * sin(found.yaw))
    needed = found.mass * GRAVITY * abs(sin(along)) * machine.tractor.rear_wheel_radius_m
    strength = machine.driveline.strength(machine.tractor)
    drive = f"driveline.torque_limit_n_m ({strength.torque:.0f})" if machine.driveline.connected else "no drive"
    return (
        f"its wheels roll {where}, since drive and brake give way: holding {found.mass:.0f} kg takes {needed:.0f} N m, "
        f"more than {drive} and driveline.brake_torque_n_m ({strength.brake:.0f})"
    )
