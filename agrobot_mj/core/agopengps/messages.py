"""Messages of the AgOpenGPS family in SI units with the signs of this package; the module `layouts` defines their
bytes.

In transmitted frames, angles are in degrees and positive to the right, headings in degrees clockwise from north, speeds
in km/h. In these classes, angles are in rad and positive to the left, headings in rad counter-clockwise from east,
speeds in m/s. In both, roll is positive with the left side up. A quantity that a module on the tractor cannot measure
is NaN in these classes and a reserved number in the frame.
"""

from math import nan
from typing import NamedTuple

HOST, STEER, IMU = 127, 126, 121  # Module numbers of the host, the steer module and the inertial unit
NO_LINE = 255  # Cross-track byte of a host without a guidance line


class SteerData(NamedTuple):
    """Message 254: steering command from the guidance program (host)."""

    speed: float  # Speed estimated by the host [m/s], without sign
    status: int  # Status bits; the bit for "engaged" depends on the host program
    steer: float  # Setpoint of the steering angle [rad], left positive, also valid while steering is not engaged
    cross_track: int = NO_LINE  # Cross-track error, encoded by the host program in one byte
    sections: int = 0  # Bit mask of the implement sections 1-16


class SteerSettings(NamedTuple):
    """Message 252: gains and limits of the steering loop on the steering module."""

    kp: int  # Proportional gain [PWM counts/deg]
    high_pwm: int  # PWM limit at steering errors of 3 deg or more [PWM counts]
    low_pwm: int  # PWM limit near zero error; boards compute it from `min_pwm` [PWM counts]
    min_pwm: int  # Minimum PWM that moves the wheels [PWM counts]
    counts_per_degree: int  # Scale of the angle sensor [counts/deg]
    offset: int  # Offset added to the output of the angle sensor [counts]; the host AgOpenWeb subtracts this offset
    ackermann: int  # Scale of left steering angles [%]


class SteerConfig(NamedTuple):
    """Message 251: hardware configuration of the steering module."""

    set0: int
    """Bit flags: 0 inverted angle sensor, 1 active-high relay, 2 inverted motor, 5 steer switch installed, 6 steer
    button."""
    pulse_count_max: int = 0  # Encoder counts of the steering wheel that indicate a manual override [counts]
    min_speed: int = 0  # Minimum speed for steering [0.1 km/h]
    set1: int = 0
    """Bit flags: bit 0 Danfoss valve, 1 pressure sensor, 2 current sensor, 3 roll from the inertial unit's y axis."""
    angular_velocity: int = 0  # Field that steering boards ignore


class Hello(NamedTuple):
    """Message 200: query for modules, sent every 2 s. Bridge programs send the query even after their guidance program
    stops."""


class Scan(NamedTuple):
    """Message 202: query for modules on all subnets."""


class SteerState(NamedTuple):
    """Message 253: measured steering state, sent by the steering module."""

    steer: float  # Measured steering angle [rad], left positive
    yaw: float = nan  # Yaw [rad], or NaN if there is no inertial unit
    roll: float = nan  # Roll [rad], left side up positive, or NaN if there is no inertial unit
    switches: int = 0  # Bits of the switches: 0 work, 1 steer, 2 remote
    pwm: int = 0  # Magnitude of the motor output [PWM counts], for display only


class HelloReply(NamedTuple):
    """Message 126 or 121: reply of a module to a hello message."""

    module: int  # Number of the replying module, which is also the message number
    steer: float = 0.0  # Measured steering angle [rad], left positive
    counts: int = 0  # Raw value of the angle sensor [counts]
    switches: int = 0  # Bits of the switches: 0 work, 1 steer, 2 remote


class ScanReply(NamedTuple):
    """Message 203: reply of a module to a scan, with its network address."""

    module: int
    address: tuple[int, ...]
    subnet: tuple[int, ...]  # First three numbers of the subnet of the querying host


Message = SteerData | SteerSettings | SteerConfig | Hello | Scan | SteerState | HelloReply | ScanReply
"""Any message between a guidance program and the modules of a tractor."""
