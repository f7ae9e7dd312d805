"""Settling of a tractor before its run starts, and messages on why it does not come to rest, with the key to change."""

from math import atan, cos, degrees, hypot, isfinite, sin
from typing import NamedTuple

import numpy as np

from agrobot_mj.core.geometry import wrap
from agrobot_mj.core.signals import Array, Truth
from agrobot_mj.machine import Machine
from agrobot_mj.machine.tractor import GRAVITY
from agrobot_mj.plants.mujoco.stepping import Oil, TractorMotion
from agrobot_mj.terrain import Ground, height_and_gradient

REST_M_S, REST_S = 0.0005, 1.0
"""A tractor whose CG and whose ends, a metre off, stayed slower for this time is at rest [m/s, s]. Estimate: longer
than the period of its modes on the tyres."""
AT_THE_LIMIT = 0.99
"""Share of the hydrostat's relief torque from which it does not hold the tractor by itself [-]."""
TRAVELLING, ROLLING = 0.5, 0.5
"""Mean over greatest velocity above which a tractor moves off rather than rocks, and rim speed of the rear wheels over
that velocity above which it rolls rather than slides [-]."""
GONE_M = 5.0
"""Distance from which a tractor that moves off is no longer watched [m]. Estimate."""
SLIDING = 0.02
"""Mean velocity above which a tractor with held wheels slides rather than creeps [m/s]. Estimate."""
GRIPPING = 0.95
"""Use of friction up to which held tyres do not slide: what then creeps is the physics step [-]. Estimate."""


class RecentMotion:
    """Motion of the last `REST_S`, by the way of each tick: what trembles from step to step goes nowhere."""

    def __init__(self, tick_s: float) -> None:
        ticks = max(1, round(REST_S / tick_s))
        self.velocities, self.speeds, self.ticks, self.tick_s = np.zeros((ticks, 3)), np.zeros(ticks), 0, tick_s
        self.begin, self.place, self.yaw = np.zeros(2), np.zeros(3), 0.0

    def add(self, motion: TractorMotion) -> None:
        """Take in the motion after a tick."""
        at, place, yaw = self.ticks % len(self.speeds), np.array(motion.cg.place), motion.attitude[0]
        if not self.ticks:
            self.begin, self.place, self.yaw = place[:2], place - self.tick_s * np.array(motion.cg.velocity), yaw
        self.velocities[at] = (place - self.place) / self.tick_s
        turned = abs(wrap(yaw - self.yaw)) / self.tick_s
        self.speeds[at] = max(float(np.linalg.norm(self.velocities[at])), turned)
        self.place, self.yaw = place, yaw
        self.ticks += 1

    @property
    def greatest(self) -> float:
        """Largest speed, of the CG or of a point a metre off; NaN where the motion is not finite [m/s]."""
        return float(self.speeds.max())

    @property
    def gone(self) -> bool:
        """Whether the tractor is too far from its placement to come to rest, or its motion is not finite."""
        return not float(np.abs(self.place[:2] - self.begin).max()) < GONE_M

    @property
    def drift(self) -> float:
        """Magnitude of the mean velocity [m/s]."""
        return float(np.linalg.norm(self.velocities.mean(axis=0)))


class Unsettled(NamedTuple):
    """A tractor that did not come to rest."""

    truth: Truth
    """State at the end."""
    recent: RecentMotion
    """Motion until then."""
    mass: float
    """Mass with all that it carries and draws [kg]."""
    wheels: Array
    """Report of the tyres, shape (4, 6): see `tyres.patch`; the last column is the use of friction."""
    fallen: bool
    """Whether it lies on its side."""


def drive_holds(oil: Oil, connected: bool, torque: float) -> bool:
    """Whether the hydrostat, which now bears `torque` [N m], holds the tractor without its brake."""
    return connected and abs(torque) < AT_THE_LIMIT * oil.drive_torque


def rest_warning(found: Unsettled, settled_s: float, machine: Machine, ground: Ground) -> str:
    """Line that says why the tractor did not rest in `settled_s` [s], and which keys to change; empty if it
    diverged."""
    speed = found.recent.greatest
    _, east, north = height_and_gradient(ground, found.truth.x, found.truth.y)
    where = f"on ground of {degrees(atan(hypot(east, north))):.1f} deg"
    if found.fallen:
        how = f"it fell over {where}; gentler ground (terrain) or a lower tractor.cg_height_m"
        return f"plant.settle_s: not at rest: {how}"
    if not isfinite(speed):
        return ""
    if found.recent.drift < TRAVELLING * speed:
        how = f"it rocks or sinks on its tyres {where}; raise plant.settle_limit_s or tractor.*_tyre_damping_n_s_m"
    else:
        along = atan(east * cos(found.truth.yaw) + north * sin(found.truth.yaw))
        turning = abs(found.truth.wheel_speed) > ROLLING * found.recent.drift
        rolls = _rolling(found, machine, where, along) if turning else ""
        how = rolls or _held(found.recent.drift, float(found.wheels[:, 5].max()), where)
    told = f"not at rest after {settled_s:g} s, still {1e3 * speed:.1f} mm/s"
    return f"plant.settle_limit_s: {told}: {how}; the run starts like that"


def _held(drift: float, used: float, where: str) -> str:
    """How it moves at `drift` [m/s] although its rear wheels are held, at this use of friction [-]."""
    how = "slides" if drift > SLIDING else "creeps"
    shorter = "" if used > GRIPPING else "a shorter step (physics or physics_dt_s), "
    return (
        f"it {how} {where} with its rear wheels held, at {100 * used:.0f} % of the tyres' grip; "
        f"{shorter}gentler ground (terrain) or other tyres (plant.tyre)"
    )


def _rolling(found: Unsettled, machine: Machine, where: str, along: float) -> str:
    """Why its wheels turn on ground that rises by `along` in its heading [rad]; empty if the drive holds them, so that
    they only tremble from step to step."""
    tractor, driveline = machine.tractor, machine.driveline
    needed = found.mass * GRAVITY * abs(sin(along)) * tractor.rear_wheel_radius_m
    strength = driveline.strength(tractor)
    if driveline.connected and needed < strength.torque:
        return ""
    drive = f"driveline.torque_limit_n_m ({strength.torque:.0f})" if driveline.connected else "driveline.connected (no)"
    return (
        f"its wheels roll {where}, since drive and brake give way: {found.mass:.0f} kg need {needed:.0f} N m, which is "
        f"beyond {drive} and driveline.brake_torque_n_m ({strength.brake:.0f}); raise one of them"
    )
