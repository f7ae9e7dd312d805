"""Small guidance program for tests and demos, which converts position messages to steering messages.

The program uses no sockets and no clock. The position of the rear axle is computed from the antenna position with a
correction for roll. The heading comes from two antennas, or from successive fixes. An inertial unit, if available,
extrapolates the heading between fixes. The program engages some time after the first heading, and follows one straight
line.

The guidance laws are common in such programs [Snider2009]: pure pursuit steers the rear axle towards a point of the
line, Stanley steers the front axle towards the line. An integral of the lateral offset can be added to both laws.
Angles are in rad. The lateral offset `off` from the line is in m, left positive.
"""

from math import atan, atan2, cos, hypot, isnan, nan, sin
from typing import Literal, NamedTuple

from agrobot_mj.control.pid import clip
from agrobot_mj.core.agopengps.layouts import cross_track_byte
from agrobot_mj.core.agopengps.messages import Hello, SteerData, SteerSettings
from agrobot_mj.core.agopengps.position import Position, decode_position
from agrobot_mj.core.agopengps.wire import encode
from agrobot_mj.core.geodesy import Origin, to_local
from agrobot_mj.core.geometry import to_heading, wrap
from agrobot_mj.extensions.links.agopengps_guidance import AgOpenGps

KMH = 3.6
"""Conversion factor from m/s to km/h [km/h per m/s]."""


class AbLine(NamedTuple):
    """Straight guidance line of infinite length."""

    x: float
    """East coordinate of a point on the line [m]."""
    y: float
    """North coordinate of the same point [m]."""
    yaw: float
    """Direction of travel, from east, counter-clockwise [rad]."""

    def project(self, x: float, y: float) -> tuple[float, float]:
        """Return the distance of a point along the line and its lateral offset, left positive [m]."""
        return to_heading(self.yaw, x - self.x, y - self.y)


class AxlePose(NamedTuple):
    """Estimated pose of the rear axle, with roll angle and speed."""

    x: float
    """East coordinate of the rear axle [m]."""
    y: float
    """North coordinate of the rear axle [m]."""
    yaw: float
    """Heading from east, counter-clockwise [rad]."""
    roll: float = 0.0
    """Roll angle, positive if the left side is up [rad]."""
    speed: float = 0.0
    """Forward speed [m/s]."""


class HostSettings(NamedTuple):
    """Settings of the guidance program, which are also its command-line options."""

    line: AbLine = AbLine(0.0, 0.0, 0.0)
    origin: Origin = Origin(AgOpenGps().origin_lat_deg, AgOpenGps().origin_lon_deg)
    law: Literal["pure_pursuit", "stanley"] = "pure_pursuit"
    wheelbase: float = 1.4
    """Wheelbase of the tractor [m]."""
    antenna_height: float = 2.0
    """Height of the GNSS antenna above the ground [m]."""
    look_ahead: float = 2.0
    """Look-ahead time of pure pursuit [s], used if `hold` is not given. Assumed value."""
    hold: float | None = None
    """Look-ahead distance at standstill, as in AgOpenGPS programs [m]. If set, this distance replaces `look_ahead`."""
    multiplier: float = 1.5
    """Relative increase of `hold` at a speed of 20 km/h [-], proportional to the speed. AgOpenGPS has the same
    default."""
    integral: float = 0.0
    """Integral gain of the lateral offset [rad/(m s)]. Default: 0, as in common programs."""
    side_hill: float = 0.0
    """Uphill steering angle divided by roll angle [-]. Default: 0, as in common programs."""
    engage_after: float = 1.0
    """Delay between the first valid heading and engagement [s]."""
    dialect: str = "agopengps"
    """Protocol of the messages: `agopengps` or `agopenweb`."""
    board: tuple[int, int, int] | None = None
    """Proportional gain, high PWM and minimum PWM, which are sent to the steering board at the start, or None to send
    no settings."""


class LawState(NamedTuple):
    """State of a guidance law between two position messages."""

    integral: float = 0.0
    """Integral part of the steering angle [rad]."""
    off: float | None = None
    """Last lateral offset of the rear axle from the line [m], left positive."""
    rate: float = 0.0
    """Low-pass filtered rate of the lateral offset [m/s]."""
    correction: float = 0.0
    """Low-pass filtered offset term of the Stanley law [rad]."""


LOOK_AHEAD_LEAST_M = 2.5
"""Minimum look-ahead distance [m]. Assumed value."""
ACQUIRE, ON_LINE_M, OFF_LINE_M = 0.9, 0.1, 0.4
"""Factor on the look-ahead distance far from the line [-], and the lateral offsets between which the factor decreases
from 1 to this value [m], as in AgOpenGPS programs."""
HEADING_GAIN, DISTANCE_GAIN = 1.0, 0.8
"""Gains of the Stanley law for heading error [-] and lateral offset [1/m]. Assumed values."""
STEER_LIMIT = 0.785
"""Maximum steering angle in both directions [rad]."""
YAW_RATE_LIMIT = 0.64
"""Maximum commanded yaw rate [rad/s]. Default value of common programs."""
INTEGRAL_LIMIT = 0.2
"""Maximum magnitude of the integral part of the steering angle [rad]."""
INTEGRAL_SPEED, INTEGRAL_RATE = 2.5 / KMH, 0.1
"""Minimum speed [m/s] and maximum rate of the lateral offset [m/s] at which the integral part is updated."""


def steer(settings: HostSettings, state: LawState, pose: AxlePose, dt: float) -> tuple[LawState, float, float]:
    """Return the new law state, the steering angle [rad] and the lateral offset [m] after a time step `dt` [s]."""
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


def _look_ahead(settings: HostSettings, speed: float, off: float) -> float:
    """Return the look-ahead distance [m]. With `hold`, the distance decreases by a tenth far from the line."""
    if settings.hold is None:
        return max(LOOK_AHEAD_LEAST_M, settings.look_ahead * speed)
    far = clip((abs(off) - ON_LINE_M) / (OFF_LINE_M - ON_LINE_M), 0.0, 1.0)
    hold = settings.hold * (1.0 - far * (1.0 - ACQUIRE))
    return max(hold * (1.0 + settings.multiplier * speed * KMH / 20), 1.0)


def _pure_pursuit(settings: HostSettings, line: AbLine, pose: AxlePose, off: float) -> float:
    """Return the steering angle for the circle through the rear axle and the goal point on the line [rad]."""
    ahead = _look_ahead(settings, pose.speed, off)
    goal_x, goal_y = ahead * cos(line.yaw) + off * sin(line.yaw), ahead * sin(line.yaw) - off * cos(line.yaw)
    _, left = to_heading(pose.yaw, goal_x, goal_y)
    d = hypot(goal_x, goal_y)
    return atan(2 * settings.wheelbase * left / (d * d))


def _stanley(settings: HostSettings, state: LawState, line: AbLine, pose: AxlePose, off: float) -> tuple[float, float]:
    """Return the steering angle of the Stanley law, halved far from the line, and the filtered offset term [rad]."""
    _, front = line.project(pose.x + settings.wheelbase * cos(pose.yaw), pose.y + settings.wheelbase * sin(pose.yaw))
    slower = 1 + 0.277 * max(pose.speed * KMH - 1, 0.0)
    correction = 0.5 * state.correction + 0.5 * atan(-front * DISTANCE_GAIN / slower)
    angle = correction + HEADING_GAIN * wrap(line.yaw - pose.yaw)
    return angle * max(1 - abs(off), 0.5), correction


ENGAGED, WORKING, VALID = 0x01, 0x05, 0x18
"""Status bits: engaged (AgOpenGPS), engaged with switch (AgOpenWeb), valid position and guidance (AgOpenWeb)."""
HELLO_S = 2.0
"""Period of the hello messages [s]."""
CHORD_M = 1.0
"""Minimum distance between two fixes from which a heading is computed [m]. Assumed value."""
TRUST = 0.05
"""Weight of a new heading from fixes in the estimated heading offset of the inertial unit [-]. Assumed value."""
JUMP_S = 1.0
"""Time between two positions above which the state of the law is reset [s]. Assumed value."""


class GuideState(NamedTuple):
    """State of the guidance program between two position messages."""

    law: LawState = LawState()
    t: float = nan
    """Time of the last position message [s]."""
    ready_since: float = nan
    """Time of the first valid heading [s]."""
    trail: tuple[tuple[float, float], ...] = ()
    """Antenna positions (east, north) for the next heading from fixes, oldest first [m]."""
    yaw: float = nan
    """Last heading from fixes [rad]."""
    offset: float = nan
    """Heading from fixes minus heading of the inertial unit [rad]."""
    hello_at: float = nan
    """Time of the last hello message [s]."""
    engaged: bool = False
    worst: float = 0.0
    """Maximum absolute lateral offset while engaged [m]."""


class Guide(NamedTuple):
    """Small guidance program, which uses no sockets and no clock."""

    settings: HostSettings

    def receive(self, state: GuideState, datagram: bytes, t: float) -> tuple[GuideState, list[bytes]]:
        """Process a datagram from the boards at time `t` [s]. Return the new state and the reply messages."""
        position = decode_position(datagram)
        if position is None:
            return state, []
        answers = []
        if self.settings.board is not None and isnan(state.hello_at):
            kp, high_pwm, min_pwm = self.settings.board
            answers.append(encode(SteerSettings(kp, high_pwm, min_pwm, min_pwm, 30, 0, 100)))
        if not t - state.hello_at < HELLO_S:
            answers.append(encode(Hello()))
            state = state._replace(hello_at=t)
        state, message = self._drive(state, position, position.solution.t)
        return state, [*answers, encode(message)]

    def _drive(self, state: GuideState, position: Position, t: float) -> tuple[GuideState, SteerData]:
        dt = t - state.t
        if not 0 < dt < JUMP_S:
            state, dt = state._replace(law=LawState(), trail=()), 0.1
        state, pose = self._pose(state._replace(t=t), position)
        if isnan(pose.yaw):
            return state, SteerData(pose.speed, 0, 0.0)
        if isnan(state.ready_since):
            state = state._replace(ready_since=t)
        law, angle, off = steer(self.settings, state.law, pose, dt)
        engaged = t - state.ready_since >= self.settings.engage_after - 1e-6
        worst = max(state.worst, abs(off)) if engaged else state.worst
        state = state._replace(law=law, engaged=engaged, worst=worst)
        return state, SteerData(pose.speed, self._status(engaged), angle, cross_track_byte(off, self.settings.dialect))

    def _pose(self, state: GuideState, position: Position) -> tuple[GuideState, AxlePose]:
        """Return the new state, and the rear-axle pose computed from an antenna position."""
        s, a = position.solution, position.attitude
        x, y = to_local(self.settings.origin, s.latitude, s.longitude)
        state, yaw = self._heading(state, position, x, y)
        roll = 0.0 if isnan(a.roll) else a.roll
        if not isnan(yaw):
            lean = self.settings.antenna_height * sin(roll)  # left side up: the antenna tilts to the right
            x, y = x - lean * sin(yaw), y + lean * cos(yaw)
        return state, AxlePose(x, y, yaw, roll, s.speed)

    def _heading(self, state: GuideState, position: Position, x: float, y: float) -> tuple[GuideState, float]:
        measured = position.attitude.yaw
        if position.dual:
            return state, measured
        trail = (*state.trail, (x, y))
        while len(trail) > 2 and hypot(x - trail[1][0], y - trail[1][1]) >= CHORD_M:
            trail = trail[1:]
        state, dx, dy = state._replace(trail=trail), x - trail[0][0], y - trail[0][1]
        if hypot(dx, dy) >= CHORD_M:
            yaw = atan2(dy, dx)
            fresh = wrap(yaw - measured)
            offset = fresh if isnan(state.offset) else state.offset + TRUST * wrap(fresh - state.offset)
            state = state._replace(yaw=yaw, offset=offset)
        return state, state.yaw if isnan(measured) else wrap(measured + state.offset)

    def _status(self, engaged: bool) -> int:
        if self.settings.dialect == "agopenweb":
            return VALID | (WORKING if engaged else 0)
        return ENGAGED if engaged else 0
