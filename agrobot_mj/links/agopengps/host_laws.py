"""Steering laws of the small host: a straight line, pure pursuit and Stanley in the form that such hosts use.

Pure pursuit aims the rear axle at a point of the line, Stanley turns the front axle towards it [Snider2009]; both may
add an integral of the distance. Angles in rad and the distance `off` in m, left positive.
"""

from math import atan, cos, hypot, sin
from typing import Literal, NamedTuple

from agrobot_mj.control.agopengps import AgOpenGps
from agrobot_mj.control.pid import clip
from agrobot_mj.core.geodesy import Origin
from agrobot_mj.core.geometry import to_heading, wrap

KMH = 3.6
"""One metre per second in kilometres per hour [km/h per m/s]."""


class AbLine(NamedTuple):
    """A straight line without ends."""

    x: float
    """A point on it, east [m]."""
    y: float
    """North [m]."""
    yaw: float
    """Direction of travel, from east, counter-clockwise [rad]."""

    def project(self, x: float, y: float) -> tuple[float, float]:
        """Distance along the line and to its left [m] of a point."""
        return to_heading(self.yaw, x - self.x, y - self.y)


class AxlePose(NamedTuple):
    """What the host believes of the rear axle."""

    x: float
    """East [m]."""
    y: float
    """North [m]."""
    yaw: float
    """Yaw, from east, counter-clockwise [rad]."""
    roll: float = 0.0
    """Left side up positive [rad]."""
    speed: float = 0.0
    """Speed [m/s]."""


class HostSettings(NamedTuple):
    """What a user enters in such a host; each is an option of the command line."""

    line: AbLine = AbLine(0.0, 0.0, 0.0)
    origin: Origin = Origin(AgOpenGps().origin_lat_deg, AgOpenGps().origin_lon_deg)
    law: Literal["pure_pursuit", "stanley"] = "pure_pursuit"
    wheelbase: float = 1.4
    """Wheelbase [m]."""
    antenna_height: float = 2.0
    """Height of the antenna above the ground [m]."""
    look_ahead: float = 2.0
    """Goal point of pure pursuit ahead by this time of travel [s]. Estimate."""
    integral: float = 0.0
    """Angle per distance and time [rad/(m s)]; 0 as such hosts come."""
    side_hill: float = 0.0
    """Angle into the hill per roll [-]; 0 as such hosts come."""
    engage_after: float = 1.0
    """Time from the first known heading to engaging [s]."""
    dialect: str = "agopengps"
    """`agopengps` or `agopenweb`."""
    board: tuple[int, int, int] | None = None
    """Gain, high and least PWM sent to the board at the start."""


class LawState(NamedTuple):
    """Memory of a law."""

    integral: float = 0.0
    """Integral of the steering angle [rad]."""
    off: float | None = None
    """Last distance of the rear axle [m]."""
    rate: float = 0.0
    """Filtered change of that distance [m/s]."""
    correction: float = 0.0
    """Stanley's filtered angle for the distance [rad]."""


LOOK_AHEAD_LEAST_M = 2.5
"""The goal point is at least this far ahead [m]. Estimate."""
HEADING_GAIN, DISTANCE_GAIN = 1.0, 0.8
"""Gains of Stanley [-, 1/m]. Estimates."""
STEER_LIMIT = 0.785
"""Largest steering angle, either way [rad]."""
YAW_RATE_LIMIT = 0.64
"""Fastest turn that is asked for [rad/s]. As such hosts come."""
INTEGRAL_LIMIT = 0.2
"""Largest integral of the steering angle [rad]."""
INTEGRAL_SPEED, INTEGRAL_RATE = 2.5 / KMH, 0.1
"""The integral moves above this speed and below this rate of the distance [m/s]."""


def steer(settings: HostSettings, state: LawState, pose: AxlePose, dt: float) -> tuple[LawState, float, float]:
    """Next state, steering angle [rad] and distance from the line [m] after `dt` [s]."""
    line = settings.line
    _, off = line.project(pose.x, pose.y)
    raw = 0.0 if state.off is None else (off - state.off) / dt
    rate = state.rate + 0.3 * (raw - state.rate)
    integral = state.integral
    if pose.speed > INTEGRAL_SPEED and abs(rate) < INTEGRAL_RATE:
        integral = clip(integral - settings.integral * off * dt, -INTEGRAL_LIMIT, INTEGRAL_LIMIT)
    if settings.law == "pure_pursuit":
        angle, correction = _pure_pursuit(settings, line, pose, off), 0.0
    else:
        angle, correction = _stanley(settings, state, line, pose, off)
    angle += integral + settings.side_hill * pose.roll
    turn = atan(YAW_RATE_LIMIT * settings.wheelbase / max(pose.speed, 0.1))
    limit = min(STEER_LIMIT, turn)
    return LawState(integral, off, rate, correction), clip(angle, -limit, limit), off


def _pure_pursuit(settings: HostSettings, line: AbLine, pose: AxlePose, off: float) -> float:
    """Angle of the circle through the rear axle and the goal point."""
    ahead = max(LOOK_AHEAD_LEAST_M, settings.look_ahead * pose.speed)
    goal_x, goal_y = ahead * cos(line.yaw) + off * sin(line.yaw), ahead * sin(line.yaw) - off * cos(line.yaw)
    _, left = to_heading(pose.yaw, goal_x, goal_y)
    d = hypot(goal_x, goal_y)
    return atan(2 * settings.wheelbase * left / (d * d))


def _stanley(settings: HostSettings, state: LawState, line: AbLine, pose: AxlePose, off: float) -> tuple[float, float]:
    """Heading error and distance of the front axle; gentler far from the line, half at 0.5 m."""
    _, front = line.project(pose.x + settings.wheelbase * cos(pose.yaw), pose.y + settings.wheelbase * sin(pose.yaw))
    slower = 1 + 0.277 * max(pose.speed * KMH - 1, 0.0)
    correction = 0.5 * state.correction + 0.5 * atan(-front * DISTANCE_GAIN / slower)
    angle = correction + HEADING_GAIN * wrap(line.yaw - pose.yaw)
    return angle * max(1 - abs(off), 0.5), correction
