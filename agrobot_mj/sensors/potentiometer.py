"""Potentiometers of the steering and the pedal, sampled many times per tick.

Each sample has noise and is rounded to the resolution. A Savitzky-Golay filter [Savitzky1964] smooths the samples,
which are then averaged, as in the paper, section V-B. Filter and mean are linear and are combined in one vector of
weights. Inputs and outputs are in radians or pedal positions, samples in degrees. A tick may have any number of physics
steps.
"""

from functools import lru_cache
from math import pi, radians
from typing import Annotated, ClassVar, Literal, NamedTuple, cast

import numpy as np
from numpy.random import Generator
from pydantic import Field, model_validator

from agrobot_mj.core.kernels import jit
from agrobot_mj.core.randomness import address, normal, stream
from agrobot_mj.core.signals import Array, Conditions, Index, Matrix, Truth, Vector
from agrobot_mj.core.spec import NonNegative, Positive
from agrobot_mj.sensors.base import Sensor

FULL_LOCK = pi / 4  # Steering angle at which the errors of a nonlinear sensor characteristic are specified [rad]


class PotentiometerLaw(NamedTuple):
    """Parameters of a potentiometer, as numbers for compiled kernels."""

    before: Index  # Index of the physics step before each sample, shape (samples,)
    shares: Matrix  # Interpolation weights of the physics steps before and after each sample, shape (samples, 2) [-]
    weights: Vector  # Weight of each sample in the measurement [-], shape (samples,)
    counts: float  # Resolution steps (counts) per unit of the measured signal
    sigma: float  # Standard deviation of the white noise of each sample [counts]


@jit
def rounded_mean(p: PotentiometerLaw, generator: int, history: Vector) -> float:
    """Return the weighted mean of noisy samples of the signal `history` (n,), each rounded to the resolution."""
    total, last = 0.0, history.size - 1
    for i in range(p.weights.size):
        left = p.before[i]
        sample = p.shares[i, 0] * history[left] + p.shares[i, 1] * history[min(left + 1, last)]
        total += p.weights[i] * np.rint(sample * p.counts + p.sigma * normal(generator))
    return total / p.counts


class Potentiometer(Sensor):
    """Base class of the potentiometers. Subclasses define `seen`, the true signal at the position of the sensor."""

    place: ClassVar[str]
    """Name of the sensor's random stream."""

    resolution_deg: Positive = 1.0
    """Resolution to which each sample is rounded [deg]. Paper, section V-B."""
    noise_sigma_deg: NonNegative = 0.5
    """Standard deviation of the white noise of a sample [deg]; noise reduces rounding errors. Assumed value (range
    0.2-1)."""
    samples: int = Field(100, ge=1, le=1000)
    """Number of evenly spaced samples per tick [-], the last at the end of the tick. Paper, section V-B."""
    savgol_window: int = Field(21, ge=1)
    """Window length of the Savitzky-Golay filter, an odd number of samples [-]. Assumed value (range 11-31)."""
    savgol_polyorder: int = Field(3, ge=0)
    """Polynomial order of the Savitzky-Golay filter [-]. Assumed value (range 2-4)."""

    @model_validator(mode="after")
    def _check_filter(self) -> "Potentiometer":
        if self.savgol_window % 2 == 0:
            raise ValueError(f"savgol_window: must be odd, got {self.savgol_window}; try {self.savgol_window + 1}")
        if self.savgol_window > self.samples:
            raise ValueError(f"savgol_window: must not exceed samples ({self.samples}), got {self.savgol_window}")
        if self.savgol_polyorder >= self.savgol_window:
            raise ValueError(f"savgol_polyorder: must be below savgol_window, got {self.savgol_polyorder}")
        return self

    @property
    def weights(self) -> Vector:
        """Weights of the samples in the filtered and averaged measurement [-]; their sum is 1, shape (samples,)."""
        return _mean_of_savgol(self.samples, self.savgol_window, self.savgol_polyorder)

    @property
    def degrees_per_unit(self) -> float:
        """Potentiometer angle per unit of the measured signal [deg/rad]."""
        return 180.0 / pi

    def init(self, seed: int) -> Generator:
        """Return the random stream of the sensor, which `measure` advances in place."""
        return stream(seed, self.place)

    def parameters(self, steps: int) -> PotentiometerLaw:
        """Return the parameters of the kernel `rounded_mean` for ticks with `steps` physics steps."""
        counts, sigma = self.degrees_per_unit / self.resolution_deg, self.noise_sigma_deg / self.resolution_deg
        return PotentiometerLaw(*_resampling(steps, self.samples), self.weights, counts, sigma)

    def seen(self, truth: Truth) -> Array:
        """Return the true signal after each of n physics steps, shape (n,), in the unit of the measurement."""
        raise NotImplementedError

    def read(self, history: Array, generator: Generator) -> float:
        """Return the measurement of a tick from the true signal `history` (n,) after each physics step."""
        return rounded_mean(self.parameters(len(history)), address(generator), cast(Vector, history))

    def measure(self, state: Generator, truth: Truth, conditions: Conditions, dt: float) -> tuple[Generator, float]:
        """Return the random stream, which has advanced in place, and the measurement at the end of a tick."""
        return state, self.read(self.seen(truth), state)


class SteeringPotentiometer(Potentiometer):
    """Potentiometer at the virtual front wheel of the bicycle model or at one knuckle (`[sensors.steering_pot]`).

    At a knuckle the sensor measures the angle of this wheel, which is larger on the inside of a bend because of the
    Ackermann geometry. The rod between knuckle and axle adds the error second_order (delta / 45 deg)^2 + third_order
    (delta / 45 deg)^3. The straight-ahead angle and the scale of each side can be configured wrongly in the on-board
    computer.
    """

    place = "steering_pot"

    at: Literal["virtual", "left", "right"] = "virtual"
    """Measured wheel: the `virtual` wheel of the bicycle model, or the `left` or `right` knuckle."""
    second_order_deg: Annotated[float, Field(ge=-20, le=20)] = 0.0
    """Second-order error at 45 deg [deg], equal for left and right, due to a rod that is not perpendicular to the lever
    at 0 deg."""
    third_order_deg: Annotated[float, Field(ge=-20, le=20)] = 0.0
    """Third-order error at 45 deg [deg], with opposite signs for left and right angles, due to levers of unequal
    length."""
    centre_deg: Annotated[float, Field(ge=-20, le=20)] = 0.0
    """Angle measured at a steering angle of 0 [deg], due to a wrong centre in the on-board computer."""
    scale_left: Annotated[float, Field(ge=0.2, le=5)] = 1.0
    """Measured angle divided by the true angle when steering left [-], due to a wrong scale in the on-board
    computer."""
    scale_right: Annotated[float, Field(ge=0.2, le=5)] = 1.0
    """Measured angle divided by the true angle when steering right [-], due to a wrong scale in the on-board
    computer."""

    @property
    def linear(self) -> bool:
        """Whether the sensor measures the angle of the virtual wheel without systematic errors."""
        errors = self.second_order_deg, self.third_order_deg, self.centre_deg
        return self.at == "virtual" and not any(errors) and self.scale_left == self.scale_right == 1.0

    def characteristic(self, delta: Array) -> Array:
        """Return the measured angles without noise [rad] for true angles `delta` [rad], both with the shape (n,)."""
        if self.second_order_deg != 0.0 or self.third_order_deg != 0.0:
            share = delta / FULL_LOCK
            delta = delta + np.radians(self.second_order_deg * share**2 + self.third_order_deg * share**3)
        if self.scale_left != 1.0 or self.scale_right != 1.0:
            delta = delta * np.where(delta > 0.0, self.scale_left, self.scale_right)
        return delta + radians(self.centre_deg) if self.centre_deg else delta

    def seen(self, truth: Truth) -> Array:
        """Return the measured angle without noise after each physics step [rad], positive to the left, shape (n,)."""
        if self.at == "virtual" or not truth.knuckle_samples.size:
            return self.characteristic(truth.steer_samples)
        return self.characteristic(truth.knuckle_samples[0 if self.at == "left" else 1])


class PedalPotentiometer(Potentiometer):
    """Potentiometer that measures the pedal position, configured by the keys of `[sensors.pedal_pot]`."""

    place = "pedal_pot"

    travel_deg: Positive = 25.0
    """Potentiometer angle at full pedal [deg], in both directions. Assumed value (range 20-30)."""

    @property
    def degrees_per_unit(self) -> float:
        """Potentiometer angle per unit of the measured signal [deg], which is the angle at full pedal."""
        return self.travel_deg

    def seen(self, truth: Truth) -> Array:
        """Return the true pedal position after each physics step [-], from -1 to 1, shape (n,)."""
        return truth.pedal_samples


@lru_cache(maxsize=16)
def _resampling(n: int, samples: int) -> tuple[Index, Matrix]:
    """Return indices and weights that interpolate `n` values of a tick to `samples` evenly spaced samples.

    An index refers to the value before the sample, shape (samples,). The weights apply to this value and the next
    value, shape (samples, 2). The interpolation is constant before the first value.
    """
    place = np.maximum(n * np.arange(1, samples + 1) / samples - 1, 0.0)
    before = place.astype(np.int64)
    return before, np.stack([1 - (place - before), place - before], axis=1)


@lru_cache(maxsize=16)
def _mean_of_savgol(samples: int, window: int, polyorder: int) -> Vector:
    """Return the weight of each sample in the mean of the filtered samples, as a read-only array, shape (samples,)."""
    found: Vector = savgol_matrix(samples, window, polyorder).mean(axis=0)
    found.setflags(write=False)
    return found


def savgol_matrix(samples: int, window: int, polyorder: int) -> Array:
    """Return the Savitzky-Golay filter as a matrix, shape (samples, samples) [Savitzky1964].

    Samples near an end use the fit to the first or last window. The result equals `scipy.signal.savgol_filter` of the
    unit matrix, without the import time of `scipy.signal`.
    """
    half, at, found = window // 2, np.arange(window), np.zeros((samples, samples))
    powers = np.arange(half, -half - 1, -1.0) ** np.arange(polyorder + 1)[:, None]
    middle = np.linalg.lstsq(powers, np.eye(polyorder + 1)[0])[0][::-1]
    middle[half + 1 :] = middle[:half][::-1]
    for row in range(half, samples - half):
        found[row, row - half : row + half + 1] = middle
    if half:
        fitted = np.transpose([np.polyval(fit, at) for fit in np.polyfit(at, np.eye(window), polyorder).T])
        found[:half, :window], found[-half:, -window:] = fitted[:half], fitted[-half:]
    return found
