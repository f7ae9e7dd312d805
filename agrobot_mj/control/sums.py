"""Dead-reckoning sums of wheel speed, yaw rate and tilt, from which `reckoning` predicts positions. SI units."""

from cmath import exp as turn
from math import atan, copysign, cos, isfinite, isnan, nan, radians, sin, sqrt, tan
from typing import NamedTuple

from agrobot_mj.control.evidence import Sensed
from agrobot_mj.core.geometry import wrap
from agrobot_mj.core.held import Held
from agrobot_mj.core.kernels import fetched, held, jit, kernel_method, shared, stage
from agrobot_mj.core.levelling import SmoothedTilt
from agrobot_mj.core.signals import Fix
from agrobot_mj.machine.implements import TowedImplement
from agrobot_mj.machine.tractor import GRAVITY

COMPLIANCE = radians(0.8)
"""Tyre compliance: sideslip per lateral specific force [rad s2/m]. Assumed value for firm ground (soil: 0.5 deg
s2/m)."""
CLIMB_SLIP = 0.01
"""Modelled wheel slip on a climb divided by the gravity along the slope [s2/m]. Assumed value for firm ground."""
COMPASS_S = 5.0
"""Time constant for comparing the antenna heading with the gyro [s]. Assumed value, short compared with gyro drift."""
BRIDGED_SIGMA = radians(0.15)
"""Standard deviation added to the frame angle theta when the gyro fails [rad]. Assumed value for averaged headings."""
SIDESLIP_WALK, SLIP_WALK = (radians(0.04), radians(0.12)), (0.002, 0.003)
"""Random walks of sideslip [rad] and wheel-scale error [-], each as a pair: per sqrt(s) of time and per sqrt(rad) of
rotation. Assumed values for six machines on level, rough, sloping and soft ground."""
SLIDING, UNKNOWN_FORCE = 2.4, 3.5
"""Specific force at which the random walks of sideslip and wheel scale double [m/s2], and specific force assumed
without an inertial unit [m/s2]. The increase of the random walks is proportional to the fourth power of the force.
Assumed values for slopes of 15 deg, on which tyres begin to slide."""
DRAUGHT = 3.0
"""Pull of a working implement, divided by the mass on the rear axle [m/s2]. Assumed value: the draught is one sixth
(range 0.1-0.3) of the tractor's weight."""
HOPPING = 0.3
"""Value of `Sums.hopping` [-] at which the standard deviations of the sideslip and wheel-scale random walks double.
Assumed value: ridges of 3 cm cause 0.3 at 1.8 m/s and 1 at 3 m/s, other ground at most 0.15."""
ROCKING_S = 2.0  # Time constant for averaging the antenna oscillation and the vertical force [s]. Assumed value.
SPEEDS_S = 1.0  # Time constant for smoothing wheel and fix speeds before comparison [s]. Assumed value.
SLIPPING = 0.97  # Ratio of fix speed to wheel speed below which the wheels spin [-]. Assumed value.
SPINNING = 0.9
"""Ratio of fix speed to wheel speed [-] below which the random walk of the wheel-speed scale error increases. Assumed
value, below `SLIPPING` because the smoothed speeds lag."""
STANDING_M_S = 0.05  # Wheel speed below which the tractor is at rest and its yaw rate is zero [m/s]. Assumed value.
STEERED_WALK = radians(1.5)
"""Random walk of the frame angle theta while the steering angle gives the yaw rate [rad/sqrt(s)]. Assumed value."""


class Compass(NamedTuple):
    """Two-antenna heading minus the integrated yaw rate phi, smoothed while a gyro is available."""

    angle: float = nan
    """Smoothed difference between heading and integrated yaw rate [rad], or NaN before the first heading."""
    rate: float = 0.0  # Rate of change of `angle`, the negative gyro error [rad/s]

    def after(self, shown: float, dt: float) -> "Compass":
        """Return the state after `dt` [s]; `shown` is the measured angle difference [rad], or NaN without a heading."""
        if not isfinite(self.angle):
            return Compass(shown, 0.0)
        angle = self.angle + self.rate * dt
        if not isfinite(shown):
            return Compass(angle, self.rate)
        error, weight = wrap(shown - angle), dt / COMPASS_S
        return Compass(angle + 2.0 * weight * error, self.rate + weight * weight / dt * error)


kernel_method("after")


class Sums(NamedTuple):
    """Quantities that the dead reckoning accumulates over all ticks up to the time `t`."""

    t: float = 0.0  # Time of the last tick [s]
    phi: float = 0.0  # Integral of the yaw rate [rad]
    path: complex = 0j  # Position of the rear axle in the frame of the dead reckoning, x + j y [m]
    bent: complex = 0j  # Derivative of `path` with respect to the tyre compliance [m2/s2]
    sideslip: float = 0.0  # Accumulated variance of the random walk of the sideslip [rad2]
    slip: float = 0.0  # Accumulated variance of the random walk of the wheel-scale error [-]
    lever: complex = 0j  # Position of the antenna relative to the rear axle, in the frame of `path` [m]
    behind: complex = 0j
    """Position of an antenna on the implement relative to the rear axle [m], or 0 for an antenna on the tractor."""
    rest: complex = 0j  # Mean of `lever`, the antenna position, over `ROCKING_S` [m]
    rocking: float = 0.0  # Mean distance of the antenna from its mean position `rest` [m]
    swing: float = 0.0
    """Angle of a drawn implement to the tractor [rad], computed from the rear-axle path, or 0 without an implement."""
    hopping: float = 0.0
    """Mean absolute deviation of the vertical specific force from g, divided by g [-], or 0 without measurement."""
    wheels: float = 0.0  # Smoothed wheel speed at the times of the fixes [m/s]
    fixes: float = 0.0  # Smoothed speed of the fixes [m/s]
    fix_t: float = 0.0  # Time of the last fix [s]
    tilt: SmoothedTilt = SmoothedTilt(0.0, 0.0)  # Smoothed roll and pitch
    compass: Compass = Compass()  # Antenna heading relative to `phi`, which replaces the gyro after a failure
    gyro_s: float = 0.0
    """Accumulated time with gyro measurements [s], during which the gyro bias rotates the dead-reckoning frame."""
    turning: float = 0.0  # Accumulated variance of the frame angle theta while the gyro was missing [rad2]
    blind: bool = False  # Whether the gyro measurement was missing in the last tick


class Vehicle(NamedTuple):
    """Properties of the tractor and its gyro, as numbers for compiled kernels."""

    wheelbase: float  # Wheelbase [m]
    antenna: float  # Height of the antenna [m]
    body: bool  # Whether the gyro axis is fixed to the tractor; otherwise it is vertical


@stage
def add_tick(last: Held[Sums], m: Sensed, fix: Fix, vehicle: Vehicle, towed: TowedImplement, dt: float) -> Held[Sums]:
    """Return the dead-reckoning sums after one further tick of length `dt` [s]. A missing fix is NaN."""
    s = fetched(last)
    wheels, fixes, fix_t = _speeds(s, m, fix)
    has_tilt = isfinite(m.roll + m.pitch)
    tilt = s.tilt.after(m.roll, m.pitch, dt) if has_tilt else s.tilt
    side, climb = (GRAVITY * sin(m.roll), GRAVITY * sin(m.pitch)) if has_tilt else (0.0, 0.0)
    w = _speed(s, m) * (cos(m.pitch) * (1.0 + CLIMB_SLIP * climb) if has_tilt else 1.0)
    heading, blind = heading_of(m, fix), not isfinite(m.gyro)
    rate, turning = _turn(
        s, m, heading, tilt.heading_rate(m.gyro, vehicle.body) if has_tilt else m.gyro, w, vehicle, dt
    )
    phi = s.phi + rate * dt
    swing = s.swing - (rate + abs(w) * sin(s.swing) / towed.length) * dt if towed.length else 0.0
    force = w * rate + side + (DRAUGHT * sin(swing) if towed.working else 0.0)
    step = w * dt * turn(1j * (s.phi + 0.5 * rate * dt - COMPLIANCE * force))
    lever = vehicle.antenna * complex(sin(m.pitch), -sin(m.roll)) * turn(1j * phi) if has_tilt else s.lever
    rest = s.rest + (lever - s.rest) * dt / ROCKING_S
    rocking = lever - rest
    distance = sqrt(rocking.real * rocking.real + rocking.imag * rocking.imag)
    pull = (force * force + climb * climb if has_tilt else UNKNOWN_FORCE * UNKNOWN_FORCE) / (SLIDING * SLIDING)
    hop = s.hopping * s.hopping / (HOPPING * HOPPING)
    growth = 1.0 + pull * pull + hop * hop
    growth *= growth
    varied, spin = abs(m.specific_force[2] / GRAVITY - 1.0) if isfinite(m.specific_force[2]) else 0.0, _spinning(s)
    return held(
        Sums(
            m.t,
            phi,
            s.path + step,
            s.bent + 1j * force * step,
            s.sideslip + growth * _walk_variance(SIDESLIP_WALK, rate, dt),
            s.slip + growth * _walk_variance(SLIP_WALK, rate, dt) + spin * spin * dt,
            lever,
            -towed.antenna * turn(1j * (phi + swing)),
            rest,
            s.rocking + (distance - s.rocking) * dt / ROCKING_S,
            swing,
            s.hopping + (varied - s.hopping) * dt / ROCKING_S,
            wheels,
            fixes,
            fix_t,
            tilt,
            s.compass if blind else s.compass.after(heading - phi, dt),
            s.gyro_s if blind else s.gyro_s + dt,
            s.turning + turning,
            blind,
        )
    )


@jit
def _turn(
    s: Sums, m: Sensed, heading: float, gyro: float, w: float, vehicle: Vehicle, dt: float
) -> tuple[float, float]:
    """Return the yaw rate [rad/s] from gyro, antennas or steering angle, and the added frame-angle variance [rad2]. `w`
    is the speed of the rear axle [m/s]."""
    standing = abs(w) < STANDING_M_S
    if isfinite(m.gyro):
        return (0.0 if standing else gyro), 0.0
    lost = 0.0 if s.blind else BRIDGED_SIGMA * BRIDGED_SIGMA
    if isfinite(heading + s.compass.angle):
        return wrap(heading - s.compass.angle - s.phi) / dt, lost
    rate = 0.0 if standing else w * tan(m.steer) / vehicle.wheelbase
    return rate, STEERED_WALK * STEERED_WALK * dt + lost


@jit
def _speed(s: Sums, m: Sensed) -> float:
    """Return the rear-axle speed [m/s]: the wheel speed (reduced during wheel spin) or, if missing, the fix speed."""
    if not isfinite(m.wheel_speed):
        return copysign(s.fixes, m.pedal)
    return m.wheel_speed * s.fixes / (SLIPPING * s.wheels) if s.fixes < SLIPPING * s.wheels else m.wheel_speed


@jit
def _spinning(s: Sums) -> float:
    return max(1.0 - s.fixes / (SPINNING * s.wheels), 0.0) if s.wheels > STANDING_M_S else 0.0


@jit
def _speeds(s: Sums, m: Sensed, fix: Fix) -> tuple[float, float, float]:
    """Return the low-pass filtered speeds of wheels and fixes [m/s], and the time of the last fix [s]."""
    speed = sqrt(fix.vx * fix.vx + fix.vy * fix.vy)
    if isnan(speed):
        return s.wheels, s.fixes, s.fix_t
    weight = min((m.t - s.fix_t) / SPEEDS_S, 1.0)
    fixes = s.fixes + weight * (speed - s.fixes)
    return s.wheels + weight * (abs(m.wheel_speed) - s.wheels) if isfinite(m.wheel_speed) else fixes, fixes, m.t


@shared
def heading_of(m: Sensed, fix: Fix) -> float:
    """Return the two-antenna heading corrected for the tilt of the tractor [rad], or NaN without two antennas."""
    return fix.heading + (atan(sin(m.pitch) * tan(m.roll)) if isfinite(m.roll + m.pitch) else 0.0)


@jit
def _walk_variance(walk: tuple[float, float], rate: float, dt: float) -> float:
    return (walk[0] * walk[0] + walk[1] * walk[1] * abs(rate)) * dt
