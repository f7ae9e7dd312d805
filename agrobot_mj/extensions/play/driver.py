"""Conversion of the driver's keys, sliders and buttons to steering angle, speed setpoint and guidance law."""

from math import isnan, nan, radians
from typing import NamedTuple

from agrobot_mj.core.signals import TICK_S
from agrobot_mj.extensions.play.session import PlaySession

STEER_RATE = radians(30.0)
"""Steering rate while a key is pressed and during the return to straight ahead [rad/s]. Assumed value (range 20-60
deg/s)."""
ACCELERATION_M_S2 = 1.0  # Acceleration while a key is pressed [m/s2]. Assumed value (range 0.5-2).
FASTEST_M_S, REVERSE_M_S = 6.0, -2.0  # Maximum speeds forward and in reverse [m/s]
STALE_S = 0.4
"""Time without a key message after which all keys count as released [s]. Closed or hidden pages send no messages."""


class Keys(NamedTuple):
    """Pressed driving keys and deflections of a gamepad, with the time `seen` at which they were received [s]."""

    left: bool = False
    right: bool = False
    faster: bool = False
    slower: bool = False
    seen: float = -1e9
    stick: float = 0.0  # Deflection of the steering stick from -1 (right) to 1 (left), or 0 for a released stick [-]
    pedal: float = 0.0  # Deflection of the accelerating minus the decelerating trigger, from -1 to 1 [-]

    def at(self, now: float) -> "Keys":
        """Return the pressed keys at time `now` [s]. No key is pressed if the last message is older than `STALE_S`."""
        return self if now - self.seen < STALE_S else Keys()

    @property
    def steering(self) -> int:
        """Steering direction of the pressed keys: 1 for left, -1 for right, 0 for none."""
        return int(self.left) - int(self.right)

    @property
    def driving(self) -> float:
        """Speed change commanded by keys and triggers, from -1 (slower) to 1 (faster) [-]."""
        return min(max(int(self.faster) - int(self.slower) + self.pedal, -1.0), 1.0)


class PlayDriver:
    """Control of steering angle and speed by the driver, who can hand over to guidance laws."""

    def __init__(self, session: PlaySession) -> None:
        self.session = session
        self.angle, self.speed, self.law = 0.0, 0.0, 0
        self.law_speed = nan
        """Speed setpoint for guidance laws [m/s], or NaN for the speed of the path."""
        self.chosen = 1
        """Number of the guidance law for the next handover. Laws are numbered from 1."""
        self.centring = True
        """Whether the wheels return to straight ahead while no steering key is pressed."""

    def take_over(self) -> None:
        """Return control from a guidance law to the driver, with the current angle and speed as setpoints."""
        if self.law:
            truth = self.session.sim.truth
            self.law, self.angle, self.speed = 0, truth.steer, _within(truth.speed)

    def hand_over(self, law: int) -> None:
        """Hand control over to the guidance law with the number `law`, counted from 1."""
        self.law = self.chosen = law

    def stop(self) -> None:
        """Return control to the driver, with a speed setpoint of zero."""
        self.take_over()
        self.speed = 0.0

    def set_angle(self, angle: float) -> None:
        """Return control from a guidance law to the driver, and hold the steering angle `angle` [rad]."""
        self.take_over()
        self.angle, self.centring = angle, False

    def set_speed(self, speed: float) -> None:
        """Set the speed setpoint of the driver or of the active guidance law [m/s]. Laws ignore the sign."""
        if self.law:
            self.law_speed = abs(_within(speed))
        else:
            self.speed = _within(speed)

    @property
    def wanted_speed(self) -> float:
        """Speed setpoint of the driver or, if active, of the guidance law [m/s]."""
        if not self.law:
            return self.speed
        return self.session.base.path.speed_m_s if isnan(self.law_speed) else self.law_speed

    def tick(self, keys: Keys) -> None:
        """Apply the pressed keys, which return control to the driver, and advance the drive by one tick."""
        limit = self.session.base.tractor.steer_limit
        if keys.steering or keys.driving or keys.stick:
            self.take_over()
        if keys.stick:
            self.angle, self.centring = keys.stick * limit, True
        elif keys.steering:
            self.centring = True
            self.angle += keys.steering * STEER_RATE * TICK_S
        elif self.centring:
            back = STEER_RATE * TICK_S
            self.angle -= min(max(self.angle, -back), back)
        self.angle = min(max(self.angle, -limit), limit)
        self.speed = _within(self.speed + keys.driving * ACCELERATION_M_S2 * TICK_S)
        session, law = self.session, self.law
        if law:
            session.hand_over(law, self.law_speed)
        else:
            session.steer(self.angle, self.speed)
        session.tick()
        if law and not session.given.law:  # the law failed
            self.law, self.angle, self.speed = 0, 0.0, 0.0

    def recall(self) -> None:
        """Set steering angle, speed and guidance law to the inputs of a restored state of the drive."""
        given = self.session.given
        self.law, self.law_speed = given.law, given.speed if given.law else self.law_speed
        if not given.law:
            self.angle, self.speed = given.steer, given.speed


def _within(speed: float) -> float:
    return min(max(speed, REVERSE_M_S), FASTEST_M_S)
