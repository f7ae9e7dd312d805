"""Speed sensors: on the driven axle, and by radar. SI units.

A pulse wheel on the differential gives the spin of the rear wheels times a believed radius, forward positive:

    reading = (1 + scale error + slip) * circumferential speed + white noise.

A plant with tyres slips by itself; `slip_sigma` comes on top for the plant that does not, and for ground that is uneven
within a patch. A Doppler radar below the tractor sees no slip and does not tell reverse from forward:

    reading = |u| / cos(pitch) * (1 + scale error + ground) + white noise,

where crops and clods that move or hide the ground, and the tractor's own pitching, change the reading. Slip and ground
are slow errors, first-order Gauss-Markov [Brown2012]. Below a least speed both read zero: pulses are too far apart, and
the Doppler shift drowns in vibration.
"""

from math import cos, nan

from agrobot_mj.core.randomness import GaussMarkov, stream
from agrobot_mj.core.signals import Column, Conditions, Truth
from agrobot_mj.core.spec import NonNegative, Positive
from agrobot_mj.sensors.base import OptionalSensor


class SpeedSensor(OptionalSensor):
    """Base of both sensors; the state is the slow error, whose stream gives the white noise too."""

    def init(self, seed: int) -> GaussMarkov:
        """Return the slow error drawn from its stationary distribution."""
        return GaussMarkov.stationary(stream(seed, self.column.name))


class WheelSpeed(SpeedSensor):
    """Speed sensor on the driven axle; `[sensors.wheel_speed]`."""

    column = Column("wheel_speed", "m/s", "speed of the driven wheels from their sensor")

    sigma_m_s: NonNegative = 0.02
    """White noise of a reading [m/s]. Assumed value (0.01-0.03: pulses within a tick)."""
    scale_error: float = 0.02
    """Constant relative error: assumed radius / true radius, minus one [-]. Assumed value (0-0.05: wear, pressure)."""
    slip_sigma: NonNegative = 0.002
    """Slow slip, relative to the speed [-]. Assumed value: a tenth of the mean slip without draught (0.001-0.01)."""
    slip_time_s: Positive = 10.0
    """Correlation time of the slow slip [s]. Assumed value: ten metres of ground."""
    least_speed_m_s: NonNegative = 0.03
    """Speed below which the reading is zero [m/s]. Assumed value: a few pulses per second."""

    def measure(self, state: GaussMarkov, truth: Truth, conditions: Conditions, dt: float) -> tuple[GaussMarkov, float]:
        """Return the speed of the driven axle [m/s]."""
        if not self.enabled:
            return state, nan
        state, speed = state.after(dt, self.slip_time_s), truth.wheel_speed
        slip, white = state.value[0], state.generator.standard_normal()
        if not abs(speed) >= self.least_speed_m_s:
            return state, 0.0
        return state, (1.0 + self.scale_error + self.slip_sigma * slip) * speed + self.sigma_m_s * white


class RadarSpeed(SpeedSensor):
    """Doppler radar; `[sensors.radar_speed]`."""

    column = Column("radar_speed", "m/s", "ground speed from the radar, never negative")

    sigma_m_s: NonNegative = 0.03
    """White noise [m/s]. Assumed value (0.02-0.05: width of the Doppler spectrum in a tick)."""
    scale_error: float = 0.01
    """Constant relative error [-]. Assumed value (0-0.03: the angle at which it is mounted)."""
    ground_sigma: NonNegative = 0.01
    """Slow relative error by crop and clods [-]. Assumed value (0.005-0.03)."""
    ground_time_s: Positive = 5.0
    """Correlation time of that error [s]. Assumed value: some metres of ground."""
    least_speed_m_s: NonNegative = 0.2
    """Speed below which the reading is zero [m/s]. Assumed value (0.1-0.5)."""

    def measure(self, state: GaussMarkov, truth: Truth, conditions: Conditions, dt: float) -> tuple[GaussMarkov, float]:
        """Return the ground speed, not negative [m/s]."""
        if not self.enabled:
            return state, nan
        state, speed = state.after(dt, self.ground_time_s), abs(truth.speed) / cos(truth.pitch)
        ground, white = state.value[0], state.generator.standard_normal()
        if not speed >= self.least_speed_m_s:
            return state, 0.0
        return state, max((1.0 + self.scale_error + self.ground_sigma * ground) * speed + self.sigma_m_s * white, 0.0)
