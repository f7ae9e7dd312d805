"""Speed sensors: wheel-speed sensor of the driven axle, and Doppler radar.

A pulse wheel on the differential measures the angular velocity of the rear wheels times an assumed radius:

    reading = (1 + scale error + slip) * circumferential speed + white noise.

Plants with tyres have slip. `slip_sigma` adds slip for the plant without tyres, and for ground that is uneven within a
contact patch. A Doppler radar below the tractor is independent of slip and measures only the magnitude of the speed:

    reading = |u| / cos(pitch) * (1 + scale error + ground) + white noise,

where moving crops and clods (ground) and the pitch of the tractor change the measurement. Slip and ground are slow
first-order Gauss-Markov errors [Brown2012]. Below a minimum speed both measurements are zero, because pulses are too
rare and vibration masks the Doppler shift.
"""

from math import cos
from typing import NamedTuple

from agrobot_mj.core.kernels import jit
from agrobot_mj.core.randomness import GaussMarkov, Shares, gauss_markov_step, normal, shares, stream
from agrobot_mj.core.signals import Column
from agrobot_mj.core.spec import NonNegative, Positive
from agrobot_mj.sensors.base import CompiledSensor, Noise, OptionalSensor, SensedMotion


class SpeedLaw(NamedTuple):
    """Parameters of a speed sensor, as numbers for compiled kernels."""

    sigma: float  # Standard deviation of the white noise [m/s]
    scale: float  # One plus the constant relative error of the speed [-]
    slow: float  # Standard deviation of the slow relative error [-]
    kept: Shares  # Weights of the last value and of white noise in the slow error [-]
    least: float  # Minimum speed, below which the measurement is zero [m/s]


class SpeedValues(NamedTuple):
    """State of a speed sensor between two ticks."""

    slow: float  # Slow error, divided by its standard deviation [-]


@jit
def _measured_speed(p: SpeedLaw, s: SpeedValues, streams: tuple[int], speed: float) -> tuple[SpeedValues, float]:
    slow = gauss_markov_step(s.slow, p.kept, streams[0])
    white = normal(streams[0])
    found = (p.scale + p.slow * slow) * speed + p.sigma * white
    return SpeedValues(slow), found if abs(speed) >= p.least else 0.0


@jit
def wheel_speed(p: SpeedLaw, s: SpeedValues, streams: tuple[int], motion: SensedMotion) -> tuple[SpeedValues, float]:
    """Return the new state and the measured circumferential speed of the driven wheels [m/s]."""
    return _measured_speed(p, s, streams, motion.wheel_speed)


@jit
def radar_speed(p: SpeedLaw, s: SpeedValues, streams: tuple[int], motion: SensedMotion) -> tuple[SpeedValues, float]:
    """Return the new state and the measured absolute speed over ground [m/s]."""
    s, found = _measured_speed(p, s, streams, abs(motion.speed) / cos(motion.pitch))
    return s, max(found, 0.0)


class SpeedSensor(CompiledSensor, OptionalSensor):
    """Base class of the speed sensors with white noise and a slow relative error."""

    def init(self, seed: int) -> Noise:
        """Return the initial state, with a slow error sampled from its stationary distribution."""
        error = GaussMarkov.stationary(stream(seed, self.column.name))
        return Noise((error.generator,), SpeedValues(*error.value))


class WheelSpeed(SpeedSensor):
    """Wheel-speed sensor of the driven axle, configured by the keys of `[sensors.wheel_speed]`."""

    column = Column("wheel_speed", "m/s", "speed of the driven wheels from their sensor")
    law = wheel_speed

    sigma_m_s: NonNegative = 0.02
    """Standard deviation of the white noise [m/s]. Assumed value (range 0.01-0.03) for counting pulses within a
    tick."""
    scale_error: float = 0.02
    """Constant relative error: assumed wheel radius divided by true radius, minus 1 [-]. Assumed value (range 0-0.05,
    due to wear and pressure)."""
    slip_sigma: NonNegative = 0.002
    """Standard deviation of the slip variation [-]. Assumed value (range 0.001-0.01): a tenth of the mean slip without
    draught."""
    slip_time_s: Positive = 10.0
    """Correlation time of the slip variation [s]. Assumed value: the time of travel over 10 m at 1 m/s."""
    least_speed_m_s: NonNegative = 0.03
    """Speed below which the measurement is zero [m/s]. Assumed value: several pulses per second at this speed."""

    def parameters(self, dt: float) -> SpeedLaw:
        """Return the parameters of the kernel `wheel_speed` for ticks of length `dt` [s]."""
        kept = shares(dt, self.slip_time_s)
        return SpeedLaw(self.sigma_m_s, 1.0 + self.scale_error, self.slip_sigma, kept, self.least_speed_m_s)


class RadarSpeed(SpeedSensor):
    """Doppler radar for the speed over ground, configured by the keys of `[sensors.radar_speed]`."""

    column = Column("radar_speed", "m/s", "ground speed from the radar, never negative")
    law = radar_speed

    sigma_m_s: NonNegative = 0.03
    """Standard deviation of the white noise [m/s]. Assumed value (range 0.02-0.05) due to the width of the Doppler
    spectrum."""
    scale_error: float = 0.01
    """Constant relative error [-]. Assumed value (range 0-0.03) due to a wrong mounting angle."""
    ground_sigma: NonNegative = 0.01
    """Standard deviation of the slow relative error due to crops and clods [-]. Assumed value (range 0.005-0.03)."""
    ground_time_s: Positive = 5.0
    """Correlation time of the slow relative error [s]. Assumed value: the time of travel over several metres."""
    least_speed_m_s: NonNegative = 0.2
    """Speed below which the measurement is zero [m/s]. Assumed value (range 0.1-0.5)."""

    def parameters(self, dt: float) -> SpeedLaw:
        """Return the parameters of the kernel `radar_speed` for ticks of length `dt` [s]."""
        kept = shares(dt, self.ground_time_s)
        return SpeedLaw(self.sigma_m_s, 1.0 + self.scale_error, self.ground_sigma, kept, self.least_speed_m_s)
