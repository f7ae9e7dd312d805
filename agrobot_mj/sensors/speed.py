"""Speed sensors: wheel speed of the driven axle, and Doppler radar. SI units.

A pulse wheel on the differential gives the angular velocity of the rear wheels times an assumed radius:

    reading = (1 + scale error + slip) * circumferential speed + white noise.

Plants with tyres have slip; `slip_sigma` adds slip for the plant without tyres and for ground that is uneven within a
contact patch. A Doppler radar below the tractor measures without slip and without a sign:

    reading = |u| / cos(pitch) * (1 + scale error + ground) + white noise,

where moving crops and clods, and pitching of the tractor, change the reading. Slip and ground are slow errors,
first-order Gauss-Markov [Brown2012]. Below a minimum speed both readings are zero: pulses are too far apart, and
vibration masks the Doppler shift.
"""

from math import cos, nan

from agrobot_mj.core.randomness import GaussMarkov, stream
from agrobot_mj.core.signals import Column, Conditions, Truth
from agrobot_mj.core.spec import NonNegative, Positive
from agrobot_mj.sensors.base import OptionalSensor


class SpeedSensor(OptionalSensor):
    """Base class of speed sensors; the state is the slow error, whose random stream also provides the white noise."""

    def init(self, seed: int) -> GaussMarkov:
        """Return the slow error sampled from its stationary distribution."""
        return GaussMarkov.stationary(stream(seed, self.column.name))


class WheelSpeed(SpeedSensor):
    """Wheel-speed sensor of the driven axle; `[sensors.wheel_speed]`."""

    column = Column("wheel_speed", "m/s", "speed of the driven wheels from their sensor")

    sigma_m_s: NonNegative = 0.02
    """White noise [m/s]. Assumed value (0.01-0.03: pulses within a tick)."""
    scale_error: float = 0.02
    """Constant relative error: assumed divided by true radius, minus 1 [-]. Assumed value (0-0.05: wear, pressure)."""
    slip_sigma: NonNegative = 0.002
    """Standard deviation of the slow slip [-]. Assumed value (0.001-0.01): a tenth of the mean slip without draught."""
    slip_time_s: Positive = 10.0
    """Correlation time of the slow slip [s]. Assumed value: ten metres of ground."""
    least_speed_m_s: NonNegative = 0.03
    """Minimum speed, below which the reading is zero [m/s]. Assumed value: several pulses per second."""

    def measure(self, state: GaussMarkov, truth: Truth, conditions: Conditions, dt: float) -> tuple[GaussMarkov, float]:
        """Return the measured speed of the driven axle [m/s]."""
        if not self.enabled:
            return state, nan
        state, speed = state.after(dt, self.slip_time_s), truth.wheel_speed
        slip, white = state.value[0], state.generator.standard_normal()
        if not abs(speed) >= self.least_speed_m_s:
            return state, 0.0
        return state, (1.0 + self.scale_error + self.slip_sigma * slip) * speed + self.sigma_m_s * white


class RadarSpeed(SpeedSensor):
    """Doppler radar for the speed over ground; `[sensors.radar_speed]`."""

    column = Column("radar_speed", "m/s", "ground speed from the radar, never negative")

    sigma_m_s: NonNegative = 0.03
    """White noise [m/s]. Assumed value (0.02-0.05: width of the Doppler spectrum in a tick)."""
    scale_error: float = 0.01
    """Constant relative error [-]. Assumed value (0-0.03: mounting angle)."""
    ground_sigma: NonNegative = 0.01
    """Standard deviation of the slow relative error from crops and clods [-]. Assumed value (0.005-0.03)."""
    ground_time_s: Positive = 5.0
    """Correlation time of the slow error [s]. Assumed value: several metres of ground."""
    least_speed_m_s: NonNegative = 0.2
    """Minimum speed, below which the reading is zero [m/s]. Assumed value (0.1-0.5)."""

    def measure(self, state: GaussMarkov, truth: Truth, conditions: Conditions, dt: float) -> tuple[GaussMarkov, float]:
        """Return the measured speed over ground, not negative [m/s]."""
        if not self.enabled:
            return state, nan
        state, speed = state.after(dt, self.ground_time_s), abs(truth.speed) / cos(truth.pitch)
        ground, white = state.value[0], state.generator.standard_normal()
        if not speed >= self.least_speed_m_s:
            return state, 0.0
        return state, max((1.0 + self.scale_error + self.ground_sigma * ground) * speed + self.sigma_m_s * white, 0.0)
