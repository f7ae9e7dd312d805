"""RTK-GNSS, steering and pedal potentiometers, optional gyro and IMU: truth in, measurement out, once a tick.

GNSS: position error per axis = white part + first-order Gauss-Markov part [Brown2012], white velocity error; a
float solution has both parts of its own. It reports the antenna, which swings with roll and pitch.
Potentiometers: 100 samples a tick, each with noise and rounded to the resolution, then Savitzky-Golay
[Savitzky1964] and mean, as in the paper's section V-B. Every sensor draws from its own random streams, as much
with a fix as without and whatever ails it, so that only its own keys move its noise. SI units and radians
outside, degrees inside the potentiometers; a tick has any number of physics steps.
"""

from functools import lru_cache
from math import nan, pi, radians, sqrt
from typing import NamedTuple

import numpy as np
from numpy.random import Generator
from pydantic import Field, model_validator
from scipy.signal import savgol_filter

from agrobot_mj.core.randomness import gauss_markov, stream
from agrobot_mj.core.signals import NOMINAL, Array, Conditions, Fix, Measurement, Quality, Truth
from agrobot_mj.core.spec import Fraction, Latency, NonNegative, Positive, Spec
from agrobot_mj.sensors.imu import Imu, ImuState

Pair = tuple[float, float]
"""East and north."""


class GnssState(NamedTuple):
    """The receiver between two ticks."""

    generator: Generator
    """Advances in place."""
    correlated: tuple[float, float]
    """Gauss-Markov part of the east and north error, in units of its standard deviation [-]."""
    float_generator: Generator
    """Advances in place."""
    float_correlated: tuple[float, float]
    """The same part of a float solution's error [-]."""
    pending: tuple[tuple[Fix | None, int], ...] = ()
    """Solutions under way with their quality, one a tick, oldest first."""


class Gnss(Spec):
    """RTK receiver at the antenna; `[sensors.gnss]`."""

    sigma_m: NonNegative = 0.02
    """Horizontal position error, per axis, both parts together [m]. Paper, section V-A."""
    float_sigma_m: NonNegative = 0.3
    """The same when the ambiguities float [m]. Estimate (0.2-0.5)."""
    correlated_fraction: Fraction = 0.3
    """Share of the correlated part in the variance (multipath, atmosphere) [-]. Estimate."""
    correlation_time_s: Positive = 30.0
    """Of the correlated part [s]. Estimate (multipath: ten seconds to minutes)."""
    float_correlated_fraction: Fraction = 0.9
    """Share of the correlated part when the ambiguities float [-]. Estimate: they converge together."""
    float_correlation_time_s: Positive = 120.0
    """Of that part [s]. Estimate (minutes, the time in which ambiguities converge)."""
    velocity_sigma_m_s: NonNegative = 0.03
    """White error of the velocity, per axis [m/s]. Estimate (Doppler, 0.01-0.05)."""
    latency_s: Latency = 0.0
    """Of the delivered solution, whole ticks [s]. Estimate: the receiver's own is under a tick."""

    def init(self, seed: int) -> GnssState:
        """The error starts in its stationary distribution; no solution is under way."""
        generator, float_generator = stream(seed, "gnss"), stream(seed, "gnss.float")
        return GnssState(generator, _pair(generator), float_generator, _pair(float_generator))

    def measure(
        self, state: GnssState, truth: Truth, dt: float, conditions: Conditions = NOMINAL
    ) -> tuple[GnssState, Fix | None, int]:
        """The solution delivered at this tick, None without one, and its quality.

        Quality and offset in `conditions` are those of the solution which the antenna gives now, the latency is that of
        the solution which is delivered now. While the latency grows nothing new arrives; when it shrinks, the solutions
        that have been overtaken are lost.
        """
        w = state.generator.standard_normal(6).tolist()
        generator, correlated, float_generator, float_correlated, pending = state
        correlated = _correlated(correlated, (w[0], w[1]), dt, self.correlation_time_s)
        float_correlated = _correlated(float_correlated, _pair(float_generator), dt, self.float_correlation_time_s)
        quality = conditions.gnss_quality
        fix = None if quality == Quality.NONE else self._fix(correlated, float_correlated, truth, conditions, w[2:])
        pending = (*pending, (fix, quality))
        due = len(pending) - 1 - round((self.latency_s + conditions.gnss_latency_s) / dt)
        if due < 0:
            return GnssState(generator, correlated, float_generator, float_correlated, pending), None, Quality.NONE
        delivered, pending = pending[due], pending[due + 1 :]
        return GnssState(generator, correlated, float_generator, float_correlated, pending), *delivered

    def _fix(
        self,
        correlated: tuple[float, float],
        float_correlated: tuple[float, float],
        truth: Truth,
        conditions: Conditions,
        white: list[float],
    ) -> Fix:
        if conditions.gnss_quality == Quality.FIX:
            sigma, share = self.sigma_m, self.correlated_fraction
        else:
            sigma, share, correlated = self.float_sigma_m, self.float_correlated_fraction, float_correlated
        slow, fast = sigma * sqrt(share), sigma * sqrt(1.0 - share)
        x, y, _ = truth.antenna
        vx, vy, _ = truth.antenna_velocity
        dx, dy = conditions.gnss_offset
        return Fix(
            x=x + dx + slow * correlated[0] + fast * white[0],
            y=y + dy + slow * correlated[1] + fast * white[1],
            vx=vx + self.velocity_sigma_m_s * white[2],
            vy=vy + self.velocity_sigma_m_s * white[3],
        )


def _pair(generator: Generator) -> Pair:
    east, north = generator.standard_normal(2).tolist()
    return east, north


def _correlated(value: Pair, white: Pair, dt: float, correlation: float) -> Pair:
    """The next values of both axes, in units of their standard deviation [-]."""
    return gauss_markov(value[0], white[0], dt, correlation), gauss_markov(value[1], white[1], dt, correlation)


class Potentiometer(Spec):
    """Angle sensor sampled many times a tick; `[sensors.steering_pot]`."""

    resolution_deg: Positive = 1.0
    """Rounding of each sample [deg]. Paper, section V-B."""
    noise_sigma_deg: NonNegative = 0.5
    """White noise of each sample before rounding; it dithers the rounding away [deg]. Estimate."""
    samples: int = Field(100, ge=1, le=1000)
    """Samples a tick, evenly spaced, the last one at the tick [-]. Paper, section V-B."""
    savgol_window: int = Field(21, ge=1)
    """Window of the Savitzky-Golay filter, odd [samples]. Estimate."""
    savgol_polyorder: int = Field(3, ge=0)
    """Order of the polynomial that the Savitzky-Golay filter fits [-]. Estimate."""

    @model_validator(mode="after")
    def _filter_fits(self) -> "Potentiometer":
        if self.savgol_window % 2 == 0:
            raise ValueError(f"savgol_window: must be odd, got {self.savgol_window}; try {self.savgol_window + 1}")
        if self.savgol_window > self.samples:
            raise ValueError(f"savgol_window: must not exceed samples ({self.samples}), got {self.savgol_window}")
        if self.savgol_polyorder >= self.savgol_window:
            raise ValueError(f"savgol_polyorder: must be below savgol_window, got {self.savgol_polyorder}")
        return self

    @property
    def weights(self) -> Array:
        """Savitzky-Golay and mean in one: the reading is `weights @ samples`, shape (samples,), sum 1 [-]."""
        return _mean_of_savgol(self.samples, self.savgol_window, self.savgol_polyorder)

    @property
    def degrees_per_unit(self) -> float:
        """Potentiometer angle for one unit of the measured signal [deg/rad]."""
        return 180.0 / pi

    def read(self, history: Array, generator: Generator) -> float:
        """Reading of one tick, in the unit of `history`, the signal after each physics step, (n >= 1,)."""
        counts = self.degrees_per_unit / self.resolution_deg
        raw = _resampling(len(history), self.samples) @ history
        raw *= counts
        raw += (self.noise_sigma_deg / self.resolution_deg) * generator.standard_normal(self.samples)
        return float(self.weights @ np.rint(raw, out=raw)) / counts


class PedalPotentiometer(Potentiometer):
    """The same sensor on the pedal, read in pedal positions; `[sensors.pedal_pot]`."""

    travel_deg: Positive = 25.0
    """Potentiometer angle at full pedal, either way [deg]. Estimate."""

    @property
    def degrees_per_unit(self) -> float:
        """Potentiometer angle for one unit of the measured signal, full pedal [deg]."""
        return self.travel_deg


class Gyro(Spec):
    """Yaw rate gyro, which the paper's tractor does not have; `[sensors.gyro]`."""

    enabled: bool = False
    """Without it the reading is NaN."""
    sigma_deg_s: NonNegative = 0.1
    """White noise of a reading [deg/s]. Estimate (MEMS, averaged over a tick)."""
    bias_deg_s: float = 0.0
    """Constant error [deg/s]. Estimate."""

    def read(self, yaw_rate: float, generator: Generator) -> float:
        """Measured yaw rate [rad/s], NaN when there is no gyro."""
        if not self.enabled:
            return nan
        return yaw_rate + radians(self.bias_deg_s + self.sigma_deg_s * generator.standard_normal())


class SensorState(NamedTuple):
    """What the sensors remember between two ticks; the generators advance in place."""

    gnss: GnssState
    steering_pot: Generator
    pedal_pot: Generator
    gyro: Generator
    imu: ImuState
    steer: float | None = None
    """Last reading of the steering potentiometer, None before the first [rad]."""


class Sensors(Spec):
    """All sensors of the tractor; `[sensors]`."""

    gnss: Gnss = Gnss()
    """RTK-GNSS receiver."""
    steering_pot: Potentiometer = Potentiometer()
    """On the front axle, at the angle of the bicycle's virtual wheel."""
    pedal_pot: PedalPotentiometer = PedalPotentiometer()
    """On the pedal."""
    gyro: Gyro = Gyro()
    """Yaw rate, off by default."""
    imu: Imu = Imu()
    """Roll and pitch, off by default."""

    def init(self, seed: int) -> SensorState:
        """Sensors at rest, their noise drawn from the named streams of `seed`."""
        return SensorState(
            gnss=self.gnss.init(seed),
            steering_pot=stream(seed, "steering_pot"),
            pedal_pot=stream(seed, "pedal_pot"),
            gyro=stream(seed, "gyro"),
            imu=self.imu.init(seed),
        )

    def measure(
        self, state: SensorState, truth: Truth, dt: float, conditions: Conditions = NOMINAL
    ) -> tuple[SensorState, Measurement]:
        """What arrives at the controller's computer in the tick of length `dt` [s] that ends at `truth.t`.

        `conditions` say what ails the sensors now.
        """
        gnss, fix, delivered = self.gnss.measure(state.gnss, truth, dt, conditions)
        steer = self.steering_pot.read(truth.steer_samples, state.steering_pot) + conditions.steer_pot_bias
        if conditions.steer_pot_stuck and state.steer is not None:
            steer = state.steer
        imu, roll, pitch = self.imu.measure(state.imu, truth.roll, truth.pitch, dt)
        measurement = Measurement(
            t=truth.t,
            fix=fix,
            quality=delivered,
            steer=steer,
            pedal=self.pedal_pot.read(truth.pedal_samples, state.pedal_pot),
            gyro=self.gyro.read(truth.yaw_rate, state.gyro),
            roll=roll,
            pitch=pitch,
        )
        return state._replace(gnss=gnss, imu=imu, steer=steer), measurement


@lru_cache(maxsize=16)
def _resampling(n: int, samples: int) -> Array:
    """Linear interpolation (samples, n) between even samplings of a tick, held before the first value."""
    given, wanted = np.arange(1, n + 1) / n, np.arange(1, samples + 1) / samples
    return _frozen(np.transpose([np.interp(wanted, given, row) for row in np.eye(n)]))


@lru_cache(maxsize=16)
def _mean_of_savgol(samples: int, window: int, polyorder: int) -> Array:
    """Response of the mean of the filtered samples to each sample, shape (samples,): the chain is linear."""
    return _frozen(savgol_filter(np.eye(samples), window, polyorder, axis=0).mean(axis=0))


def _frozen(array: Array) -> Array:
    """A contiguous copy that nobody can change, since caches hand it out more than once."""
    array = np.array(array, dtype=np.float64, order="C")
    array.setflags(write=False)
    return array
