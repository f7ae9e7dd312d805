"""Messages of the AgOpenGPS family in SI units and the package's signs; `layouts` has their bytes.

On the wire angles are degrees with right positive, headings degrees clockwise from north, speeds km/h; here they are
rad with left positive, rad counter-clockwise from east, and m/s. Roll keeps its sign: left side up is right side down.
A value that a board does not have is NaN here and a reserved number on the wire.
"""

from math import nan
from typing import NamedTuple

HOST, STEER, MACHINE, IMU, GPS = 127, 126, 123, 121, 120
"""Numbers of the modules."""
HELLO, SUBNET, SCAN = 200, 201, 202
"""Numbers of the host's housekeeping messages."""
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


class MachineData(NamedTuple):
    """239: sections and implement."""

    speed: float
    """Speed [m/s]."""
    u_turn: int = 0
    """State of the turn at the headland."""
    lift: int = 0
    """0 off, 1 down, 2 up."""
    sections: int = 0
    """Bit mask of sections 1-16."""


class SectionData(NamedTuple):
    """229: sections of wide implements."""

    sections: int
    """Bit mask of sections 1-64."""
    left_speed: int = 0
    """Tool speed at the left end, as sent."""
    right_speed: int = 0
    """Tool speed at the right end, as sent."""


class Hello(NamedTuple):
    """200: which modules are there? Sent every 2 s, also by a bridge whose guidance program has died."""


class SubnetChange(NamedTuple):
    """201: move to another subnet."""

    subnet: tuple[int, int, int]
    """First three numbers of the address."""


class Scan(NamedTuple):
    """202: modules on all subnets, report."""


class CorrectedPosition(NamedTuple):
    """100: the host's own position after its corrections."""

    longitude: float
    """Longitude [deg]."""
    latitude: float
    """Latitude [deg]."""
    yaw: float = nan
    """NaN where the host sends none [rad]."""


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


class SensorValue(NamedTuple):
    """250: pressure or current of the steering."""

    value: int
    """0-255, as sent."""


class HelloReply(NamedTuple):
    """126, 123, 121 or 120: here is a module."""

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
    address: tuple[int, int, int, int]
    """Its own."""
    subnet: tuple[int, int, int]
    """That of the host which asked."""


class ImuData(NamedTuple):
    """211: an inertial unit with a board of its own."""

    yaw: float
    """Yaw [rad]."""
    roll: float
    """Left side up positive [rad]."""
    yaw_rate: float = 0.0
    """Left positive [rad/s]; half degrees per second on the wire."""


class BridgePosition(NamedTuple):
    """214: position from the bridge to the guidance program on one computer; values as sent."""

    longitude: float
    """Longitude [deg]."""
    latitude: float
    """Latitude [deg]."""
    dual_heading: float
    """Heading of two antennas [deg]."""
    heading: float
    """Heading [deg]."""
    speed: float
    """Speed [km/h]."""
    roll: float
    """Roll [deg]."""
    altitude: float
    """Altitude [m]."""
    satellites: int
    """In use."""
    fix: int
    """Quality as in GGA."""
    hdop: int
    """Hundredths."""
    age: int
    """Age of the corrections [0.01 s]."""
    imu_heading: int
    """Heading of the inertial unit [0.1 deg]."""
    imu_roll: int
    """Roll of the inertial unit [0.1 deg]."""
    imu_pitch: int
    """Pitch of the inertial unit [0.1 deg]."""
    imu_yaw_rate: int
    """As sent."""


HostMessage = (
    SteerData
    | SteerSettings
    | SteerConfig
    | MachineData
    | SectionData
    | Hello
    | SubnetChange
    | Scan
    | CorrectedPosition
)
"""From the host to the boards."""
BoardMessage = SteerState | SensorValue | HelloReply | ScanReply | ImuData | BridgePosition
"""From the boards to the host."""
Message = HostMessage | BoardMessage
