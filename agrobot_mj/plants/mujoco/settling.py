"""Start of a run: initial pose of the tractor, settling, and reason why a tractor does not come to rest."""

from math import atan, atan2, ceil, cos, degrees, hypot, isfinite, sin
from typing import NamedTuple

import numpy as np

from agrobot_mj.core.geometry import wrap
from agrobot_mj.core.signals import WHEELS, Array, Reference, Truth
from agrobot_mj.machine import Machine
from agrobot_mj.machine.tractor import GRAVITY, TractorParameters
from agrobot_mj.plants.base import TractorMotion
from agrobot_mj.plants.mujoco.clearance import quat_of
from agrobot_mj.plants.mujoco.stepping import Oil
from agrobot_mj.terrain import Ground, height_and_gradient
from agrobot_mj.tyres.patch import FRICTION_USE, LOAD

PASSES = 3  # Number of fits of the ground plane; each fit uses the wheel positions of the previous fit


def pose_on(ground: Ground, start: Reference, tractor: TractorParameters) -> tuple[Array, float]:
    """Return the chassis pose (7,) on the ground with the CG above `start`, and the roll of the front axle [rad]."""
    _, dx, dy = height_and_gradient(ground, start.x, start.y)
    rotation = _facing(np.array([-dx, -dy, 1.0]) / hypot(dx, dy, 1.0), start.yaw)
    l_r, half = tractor.cg_to_rear_axle, tractor.track_m / 2
    cg = np.array([l_r, 0.0, tractor.cg_height_m])
    feet = np.array([[tractor.wheelbase_m * front, side * half, 0.0] for front in (1, 0) for side in (1, -1)])
    points = np.zeros((4, 3))
    for _ in range(PASSES):
        rear = np.array([start.x, start.y, 0.0]) - rotation @ cg
        points = rear + feet @ rotation.T
        points[:, 2] = [height_and_gradient(ground, x, y)[0] for x, y in points[:, :2]]
        front, left = points[:2].mean(axis=0) - points[2:].mean(axis=0), points[2] - points[3]
        normal = np.cross(front, left)
        rotation = _facing(normal / np.linalg.norm(normal), start.yaw)
    place = np.array([start.x, start.y, 0.0]) - rotation @ cg
    place[2] = points[2:, 2].mean()
    across = (points[0] - points[1]) @ rotation
    limit = np.radians(tractor.axle_pivot_limit_deg)
    return np.concatenate([place, quat_of(rotation)]), float(np.clip(np.arctan2(across[2], across[1]), -limit, limit))


def _facing(normal: Array, yaw: float) -> Array:
    """Return the rotation matrix (3, 3) of a tractor with heading `yaw` [rad] on a plane with the normal `normal`."""
    forward = np.cross([-np.sin(yaw), np.cos(yaw), 0.0], normal)
    forward /= np.linalg.norm(forward)
    return np.stack([forward, np.cross(normal, forward), normal], axis=1)


REST_M_S, REST_S = 0.0005, 1.0
"""Criterion of standstill: maximum speed of the CG and of points 1 m from the CG [m/s], over a minimum duration [s].
Assumed values; the duration exceeds the period of oscillations on the tyres."""
AT_THE_LIMIT = 0.99
"""Drive torque divided by relief torque above which the hydrostat does not hold the tractor without the brake [-]."""
TRAVELLING, ROLLING = 0.5, 0.5
"""Minimum ratio of mean velocity to maximum speed of a tractor that moves away instead of rocking [-], and minimum
ratio of rear rim speed to mean velocity of a tractor that rolls instead of sliding [-]."""
GONE_M = 5.0  # Distance above which settling ends for a tractor that moves away [m]. Assumed value.
SLIDING = 0.02
"""Mean velocity above which a tractor with locked wheels slides instead of creeping [m/s]. Assumed value."""
GRIPPING = 0.95
"""Used fraction of friction below which locked tyres creep numerically instead of sliding [-]. Assumed value."""


TILT_DEG_S = 2.0
"""Mean rotation rate of gravity from the ground normal to the vertical [deg/s]. Assumed value; inertia then reduces the
tip-over angle of the tractor by 0.1 deg."""


class Tilt:
    """Gravity vector that rotates slowly from the ground normal to the vertical, as on a tilting platform.

    Under sudden gravity the tractor would overshoot its equilibrium on the tyres, and could roll over on a slope on
    which it is stable.
    """

    def __init__(self, up: Array, tick_s: float) -> None:
        """Create the rotation from the ground normal `up` (3,) to the vertical; it takes 0 ticks on level ground."""
        horizontal = hypot(up[0], up[1])
        self.lean = atan2(horizontal, up[2])
        self.ticks = ceil(degrees(self.lean) / TILT_DEG_S / tick_s)
        self.away = up[:2] / horizontal if self.ticks else np.zeros(2)
        """Horizontal direction of the ground normal: unit vector, shape (2,)."""

    def up(self, tick: int) -> Array:
        """Return the unit vector (3,) against gravity after `tick` ticks, vertical from tick `self.ticks` on."""
        left = max(1.0 - tick / self.ticks, 0.0) if self.ticks else 0.0
        lean = self.lean * left * left * (3.0 - 2.0 * left)  # starts and ends smoothly
        return np.array([*(sin(lean) * self.away), cos(lean)])


class RecentMotion:
    """Motion in the last `REST_S` seconds, computed from displacements per tick to exclude vibrations within a tick."""

    def __init__(self, tick_s: float) -> None:
        ticks = max(1, round(REST_S / tick_s))
        self.velocities, self.speeds, self.ticks, self.tick_s = np.zeros((ticks, 3)), np.zeros(ticks), 0, tick_s
        self.begin, self.place, self.yaw = np.zeros(2), np.zeros(3), 0.0

    def add(self, motion: TractorMotion) -> None:
        """Add the displacement during a tick, computed from the `motion` at the end of the tick."""
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
        """Maximum speed of the CG and of points 1 m from the CG [m/s], or NaN if the motion is not finite."""
        return float(self.speeds.max())

    @property
    def gone(self) -> bool:
        """Whether the tractor is `GONE_M` or more from its start along the x or y axis, or its motion is not finite."""
        return not float(np.abs(self.place[:2] - self.begin).max()) < GONE_M

    @property
    def drift(self) -> float:
        """Magnitude of the mean velocity of the CG [m/s]."""
        return float(np.linalg.norm(self.velocities.mean(axis=0)))


class Settled(NamedTuple):
    """State of the tractor at the end of settling."""

    truth: Truth
    recent: RecentMotion  # Motion in the last `REST_S` of settling
    mass: float  # Mass of the tractor with its load and implement [kg]
    wheels: Array  # Tyre report, shape (4, 6): see `tyres.patch`; the last column is the used fraction of friction
    fallen: bool


def drive_holds(oil: Oil, connected: bool, torque: float) -> bool:
    """Return whether the hydrostat holds the tractor without the brake; `torque` is the current drive torque [N m]."""
    return connected and abs(torque) < AT_THE_LIMIT * oil.drive_torque


def start_warning(found: Settled, settled_s: float, machine: Machine, ground: Ground) -> str:
    """Return a warning for a tractor that is not at rest on four wheels after `settled_s` [s].

    The warning contains the reason and the keys to change. An empty text is returned for a tractor at rest on four
    wheels, and for a diverged simulation.
    """
    speed, rests = found.recent.greatest, found.recent.greatest <= REST_M_S
    _, east, north = height_and_gradient(ground, found.truth.x, found.truth.y)
    where = f"on ground of {degrees(atan(hypot(east, north))):.1f} deg"
    lifted = [name for name, load in zip(WHEELS, found.wheels[:, LOAD], strict=True) if load <= 0.0]
    if found.fallen:
        how = f"the tractor rolled over {where}; use gentler ground (terrain) or a lower tractor.cg_height_m"
        return f"plant.settle_s: not at rest: {how}"
    if not isfinite(speed) or (rests and not lifted):
        return ""
    told = "at rest" if rests else f"the tractor still moves at {1e3 * speed:.1f} mm/s after {settled_s:g} s"
    if lifted:
        unloaded = f"there is no load on wheel {' and '.join(lifted)} {where}"
        how = f"{unloaded}; use gentler ground (terrain) or a lower tractor.cg_height_m"
    else:
        rise = east * cos(found.truth.yaw) + north * sin(found.truth.yaw)
        how = _motion(found, machine, where, atan(rise))
    return f"plant.settle_limit_s: {told}: {how}. The run starts in this state"


def _motion(found: Settled, machine: Machine, where: str, along: float) -> str:
    if found.recent.drift < TRAVELLING * found.recent.greatest:
        how = f"the tractor rocks or sinks on its tyres {where}"
        return f"{how}; increase plant.settle_limit_s or tractor.*_tyre_damping_n_s_m"
    turning = abs(found.truth.wheel_speed) > ROLLING * found.recent.drift
    rolls = _rolling(found, machine, where, along) if turning else ""
    return rolls or _reason_of_motion(found.recent.drift, float(found.wheels[:, FRICTION_USE].max()), where)


def _reason_of_motion(drift: float, used: float, where: str) -> str:
    """Return why a tractor with locked rear wheels moves at `drift` [m/s]; `used` is the used fraction of friction
    [-]."""
    how = "slides" if drift > SLIDING else "creeps"
    shorter = "" if used > GRIPPING else "a shorter step (physics or physics_dt_s), "
    return (
        f"the tractor {how} {where} with locked rear wheels, at {100 * used:.0f} % of the tyres' grip; "
        f"use {shorter}gentler ground (terrain) or other tyres (plant.tyre)"
    )


def _rolling(found: Settled, machine: Machine, where: str, along: float) -> str:
    """Return the reason why the wheels roll, or an empty string if the drive torque suffices to hold the tractor.
    `along` is the slope in the heading direction [rad]."""
    tractor, driveline = machine.tractor, machine.driveline
    needed = found.mass * GRAVITY * abs(sin(along)) * tractor.rear_wheel_radius_m
    strength = driveline.strength(tractor)
    if driveline.connected and needed < strength.torque:
        return ""
    drive = f"driveline.torque_limit_n_m ({strength.torque:.0f})" if driveline.connected else "driveline.connected (no)"
    return (
        f"the wheels roll {where} because drive and brake cannot hold them: {found.mass:.0f} kg need {needed:.0f} N "
        f"m, which is above {drive} and driveline.brake_torque_n_m ({strength.brake:.0f}); increase one of them"
    )
