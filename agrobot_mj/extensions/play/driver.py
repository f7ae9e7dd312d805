"""Conversion of keys, sliders and buttons used by a driver to inputs of a session."""

from math import isnan, nan, radians
from typing import NamedTuple

from agrobot_mj.core.signals import TICK_S
from agrobot_mj.extensions.play.session import PlaySession

STEER_RATE = radians(30.0)
"""Rate at which the wheels turn with a key pressed and return without one [rad/s]. Assumed value (20-60 deg/s)."""
ACCELERATION_M_S2 = 1.0  # Acceleration while a key is pressed [m/s2]. Assumed value (0.5-2).
FASTEST_M_S, REVERSE_M_S = 6.0, -2.0  # Maximum speeds forward and in reverse [m/s]
STALE_S = 0.4
"""Time without a message [s] after which all keys are treated as released, because the page is closed or hidden."""


class Keys(NamedTuple):
    """Pressed keys, and the time `seen` at which their message was received [s]."""

    left: bool = False
    right: bool = False
    faster: bool = False
    slower: bool = False
    seen: float = -1e9

    def at(self, now: float) -> "Keys":
        """Return the keys pressed at time `now` [s], or none if the last message is older than `STALE_S`."""
        return self if now - self.seen < STALE_S else Keys()

    @property
    def steering(self) -> int:
        """Direction in which the keys turn the wheels: 1 left, -1 right, 0 none."""
        return int(self.left) - int(self.right)

    @property
    def driving(self) -> int:
        """Direction in which the keys change the speed: 1 faster, -1 slower, 0 none."""
        return int(self.faster) - int(self.slower)


class PlayDriver:
    """Driver who controls steering angle and speed, and can hand over to a guidance law."""

    def __init__(self, session: PlaySession) -> None:
        self.session = session
        self.angle, self.speed, self.law = 0.0, 0.0, 0
        self.law_speed = nan
        """Speed for guidance laws [m/s], or NaN for the speed of the path."""
        self.chosen = 1
        """Index of the law, from 1, to which the driver hands over next."""
        self.centring = True
        """Whether the wheels return to straight ahead while no key is pressed."""

    def take_over(self) -> None:
        """Return control to the driver, starting from the current angle and speed."""
        if self.law:
            truth = self.session.sim.truth
            self.law, self.angle, self.speed = 0, truth.steer, _within(truth.speed)

    def hand_over(self, law: int) -> None:
        """Hand over to the law with the number `law`."""
        self.law = self.chosen = law

    def stop(self) -> None:
        """Brake to standstill. The driver steers."""
        self.take_over()
        self.speed = 0.0

    def set_angle(self, angle: float) -> None:
        """Hold a steering angle [rad]."""
        self.take_over()
        self.angle, self.centring = angle, False

    def set_speed(self, speed: float) -> None:
        """Set the speed of the driver, or the speed of the law if a law steers [m/s]."""
        if self.law:
            self.law_speed = abs(_within(speed))
        else:
            self.speed = _within(speed)

    @property
    def wanted_speed(self) -> float:
        """Speed setpoint of the driver or of the law that steers [m/s]."""
        if not self.law:
            return self.speed
        return self.session.base.path.speed_m_s if isnan(self.law_speed) else self.law_speed

    def tick(self, keys: Keys) -> None:
        """Advance one tick: apply the keys and pass the input to the session."""
        if keys.steering or keys.driving:
            self.take_over()
        if keys.steering:
            self.centring = True
            self.angle += keys.steering * STEER_RATE * TICK_S
        elif self.centring:
            back = STEER_RATE * TICK_S
            self.angle -= min(max(self.angle, -back), back)
        limit = self.session.base.tractor.steer_limit
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

    def recalled(self) -> None:
        """Continue with the inputs in the restored state of the session."""
        given = self.session.given
        self.law, self.law_speed = given.law, given.speed if given.law else self.law_speed
        if not given.law:
            self.angle, self.speed = given.steer, given.speed


def _within(speed: float) -> float:
    return min(max(speed, REVERSE_M_S), FASTEST_M_S)
