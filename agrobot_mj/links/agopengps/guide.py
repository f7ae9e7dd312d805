"""A small guidance program: positions in, steering messages out; no sockets, no clock of its own.

A test double of the programs that people use, and a demo. It believes the rear axle from the antenna (corrected for
roll) and a heading from two antennas, or from fix to fix, carried between fixes by the inertial unit where there is
one. It engages by itself some time after it knows its heading, and drives one straight line.
"""

from math import atan2, cos, hypot, isnan, nan, sin
from typing import NamedTuple

from agrobot_mj.core.agopengps.layouts import cross_track_byte
from agrobot_mj.core.agopengps.messages import Hello, SteerData, SteerSettings
from agrobot_mj.core.agopengps.position import Position, read
from agrobot_mj.core.agopengps.wire import encode
from agrobot_mj.core.geodesy import to_local
from agrobot_mj.core.geometry import wrap
from agrobot_mj.links.agopengps.host_laws import AxlePose, HostSettings, LawState, steer

ENGAGED, WORKING, VALID = 0x01, 0x05, 0x18
"""Status bits: AgOpenGPS; AgOpenWeb engaged with its switch; AgOpenWeb's position and guidance are valid."""
HELLO_S = 2.0
"""Period of the hello messages [s]."""
CHORD_M = 1.0
"""A heading from fix to fix takes two fixes this far apart [m]. Estimate."""
TRUST = 0.05
"""Share of a new heading from fix to fix in the inertial unit's offset [-]. Estimate."""
JUMP_S = 1.0
"""A gap between positions that makes the host forget its motion [s]. Estimate."""


class GuideState(NamedTuple):
    """Memory of the host."""

    law: LawState = LawState()
    t: float = nan
    """Time of the last position [s]."""
    ready_since: float = nan
    """When the heading was first known [s]."""
    trail: tuple[tuple[float, float], ...] = ()
    """Antenna at the last fixes, oldest first, as many as the next heading needs: east and north [m]."""
    yaw: float = nan
    """Heading from fix to fix [rad]."""
    offset: float = nan
    """Heading from fix to fix less the inertial unit's [rad]."""
    hello_at: float = nan
    """When the last hello went out [s]."""
    engaged: bool = False
    worst: float = 0.0
    """Largest distance from the line while engaged [m]."""


class Guide(NamedTuple):
    """A host with certain settings."""

    settings: HostSettings

    def receive(self, state: GuideState, datagram: bytes, t: float) -> tuple[GuideState, list[bytes]]:
        """Take a datagram from the boards at time `t` [s]; returns what goes back."""
        position = read(datagram)
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
        """The rear axle, from the antenna above it."""
        s, a = position.solution, position.attitude
        x, y = to_local(self.settings.origin, s.latitude, s.longitude)
        state, yaw = self._heading(state, position, x, y)
        roll = 0.0 if isnan(a.roll) else a.roll
        if not isnan(yaw):
            lean = self.settings.antenna_height * sin(roll)  # left side up: the antenna leans to the right
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
