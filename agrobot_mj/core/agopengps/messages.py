"""Messages of the AgOpenGPS family in SI units and the package's signs; `layouts` has their bytes.

On the wire angles are degrees with right positive, headings degrees clockwise from north, speeds km/h; here they are
rad with left positive, rad counter-clockwise from east, and m/s. Roll keeps its sign: left side up is right side down.
A value that a board does not have is NaN here and a reserved number on the wire.
"""

from math import nan
from typing import NamedTuple

HOST, STEER, IMU = 127, 126, 121
"""Numbers of the modules."""
NO_LINE = 255
"""Cross-track byte of a host without a line."""


class SteerData(NamedTuple):
    """254: what the host asks of the steering."""

    speed: float
    """Speed that the host believes, without sign [m/s]."""
    status: int
    """Bits; which of them says "engaged" depends on the host."""
    steer: float
    """Set point of the steering angle, left positive; alive while not engaged, too [rad]."""
    cross_track: int = NO_LINE
    """Distance from the line, coded as the host's family does."""
    sections: int = 0
    """Bit mask of sections 1-16."""


class SteerSettings(NamedTuple):
    """252: gains and limits of the board's own loop."""

    kp: int
    """PWM counts per degree of error."""
    high_pwm: int
    """Limit for errors of 3 deg and more [PWM counts]."""
    low_pwm: int
    """Limit near zero error; boards compute it from `min_pwm` [PWM counts]."""
    min_pwm: int
    """Least PWM that moves the wheel [PWM counts]."""
    counts_per_degree: int
    """Angle sensor [counts/deg]."""
    offset: int
    """Added to the angle sensor's reading; taken from it in AgOpenWeb [counts]."""
    ackermann: int
    """Scale of angles to the left [%]."""


class SteerConfig(NamedTuple):
    """251: how a board is wired."""

    set0: int
    """Bits: 0 invert angle sensor, 1 relay active high, 2 invert motor, 5 steer switch, 6 steer button."""
    pulse_count_max: int = 0
    """Turns of the steering wheel that mean a hand on it [counts]."""
    min_speed: int = 0
    """Least speed for steering [0.1 km/h]."""
    set1: int = 0
    """Bits: 0 Danfoss valve, 1 pressure sensor, 2 current sensor, 3 use the y axis."""
    angular_velocity: int = 0
    """Unused by boards."""


class Hello(NamedTuple):
    """200: which modules are there? Sent every 2 s, also by a bridge whose guidance program has died."""


class Scan(NamedTuple):
    """202: modules on all subnets, report."""


class SteerState(NamedTuple):
    """253: a steer module's answer."""

    steer: float
    """Measured steering angle, left positive [rad]."""
    yaw: float = nan
    """NaN without an inertial unit [rad]."""
    roll: float = nan
    """Left side up positive, NaN without an inertial unit [rad]."""
    switches: int = 0
    """Bits: 0 work, 1 steer, 2 remote."""
    pwm: int = 0
    """Magnitude of the drive, for display [PWM counts]."""


class HelloReply(NamedTuple):
    """126 or 121: here is a module."""

    module: int
    """Number of the module; also the number of the message."""
    steer: float = 0.0
    """Measured steering angle, left positive [rad]."""
    counts: int = 0
    """Raw reading of the angle sensor [counts]."""
    switches: int = 0
    """As in `SteerState`."""


class ScanReply(NamedTuple):
    """203: a module's address."""

    module: int
    """Number of the module."""
    address: tuple[int, ...]
    """Its own, four numbers."""
    subnet: tuple[int, ...]
    """That of the host which asked, three numbers."""


Message = SteerData | SteerSettings | SteerConfig | Hello | Scan | SteerState | HelloReply | ScanReply
"""What host and boards say to each other, as far as a tractor's boards have a use for it."""
