"""Estimator with disturbance states: velocity KF, and EKF with states for steering bias and slow GNSS error.

A potentiometer offset, or the steering angle needed for a straight course on a side slope, is a measured steering angle
without rotation. The EKF of the paper converts both into a heading error; this filter estimates their sum as a state.
The yaw is the course of R, the direction of motion of the rear axle. With these sensors only the sum of heading and
sideslip is observable, on any path. Heading and course differ by the slip of the rear tyres: a few tenths of a degree
in a bend of 10 m on level ground, and the crab angle on a side slope.

States: x, y [m] of R, course chi [rad, not wrapped], steering bias b [rad], and g_x, g_y [-], the correlated error of
the fix, a first-order Gauss-Markov process [Brown2012] in units of its standard deviation s. Inputs and measurement as
in `ekf`:

  chi' = u tan(delta - b) / L,    x' = u cos(chi),  y' = u sin(chi),    random walk of b and g,    z = (x, y) + s g

The bias is the measured steering angle minus the angle for the path curvature: an error of the potentiometer, or the
difference of front and rear slip angles on a side slope. The bias is observable while the tractor moves. With b = 0 and
without a correlated part, the filter equals the filter of `ekf`.
"""

from functools import lru_cache
from math import cos, exp, radians, sin, sqrt, tan
from typing import Literal, NamedTuple

import numpy as np

from agrobot_mj.core.signals import Array, Fix
from agrobot_mj.core.spec import Fraction, NonNegative, Positive
from agrobot_mj.estimation.pose_estimator import PoseEstimator
from agrobot_mj.estimation.position_ekf import FixEkf
from agrobot_mj.machine.tractor import TractorParameters

BIAS = 3
"""Index of the steering bias in the state."""


class Levels(NamedTuple):
    """Noise levels of the filter: process noise, and correlated part of the fix error."""

    position_walk: float
    """Random walk of the position [m/sqrt(s)]."""
    yaw_walk: float
    """Random walk of the course [rad/sqrt(s)]."""
    bias_walk: float
    """Random walk of the steering bias [rad/sqrt(s)]."""
    correlated_share: float
    """Standard deviation of the time-correlated fix error, divided by that of the total fix error [-]."""
    correlation_time: float
    """Correlation time of the time-correlated fix error [s]."""


def f(state: Array, speed: float, steer: float, wheelbase: float, dt: float, phi: float) -> Array:
    """Return the state (6,) after `dt` [s] at `speed` [m/s] and `steer` [rad]; `phi` is the decay factor of g."""
    (x, y, chi, b, g_x, g_y), T_s, u, L = state.tolist(), dt, speed, wheelbase
    turned = chi + T_s * u * tan(steer - b) / L
    return np.array((x + T_s * u * cos(chi), y + T_s * u * sin(chi), turned, b, phi * g_x, phi * g_y))


def jacobian(state: Array, speed: float, steer: float, wheelbase: float, dt: float, phi: float) -> Array:
    """Return the derivative of `f` with respect to the state, shape (6, 6)."""
    chi, b, T_s, u, L = state[2], state[BIAS], dt, speed, wheelbase
    F = np.diag((1.0, 1.0, 1.0, 1.0, phi, phi))
    F[0, 2], F[1, 2] = -T_s * u * sin(chi), T_s * u * cos(chi)
    F[2, BIAS] = -T_s * u / (L * cos(steer - b) ** 2)
    return F


class BiasEkf(FixEkf):
    """Pose EKF for a given wheelbase [m] and given noise levels, with states for steering bias and GNSS error."""

    def __init__(self, wheelbase: float, levels: Levels) -> None:
        super().__init__(wheelbase)
        self.levels = levels

    def step(
        self, mean: Array, covariance: Array, inputs: tuple[float, float, float], fix: Fix | None, sigma: float
    ) -> tuple[Array, Array, float]:
        """Return mean (6,), covariance (6, 6) and NIS; see `FixEkf.step`."""
        speed, steer, dt = inputs
        phi, Q = _noise(self.levels, dt)
        F, x = (part(mean, speed, steer, self.wheelbase, dt, phi) for part in (jacobian, f))
        H, R = _measuring(self.levels.correlated_share, sigma)
        return self.corrected(x, covariance, F, Q, fix, H @ x, H, R)


@lru_cache(maxsize=8)
def _noise(levels: Levels, dt: float) -> tuple[float, Array]:
    """Return the decay factor of the GNSS error states in `dt` [s], and the process-noise covariance (6, 6)."""
    phi = exp(-dt / levels.correlation_time)
    p, yaw, b, g = levels.position_walk, levels.yaw_walk, levels.bias_walk, sqrt((1.0 - phi * phi) / dt)
    return phi, dt * np.diag(np.square((p, p, yaw, b, g, g)))


@lru_cache(maxsize=8)
def _measuring(fraction: float, sigma: float) -> tuple[Array, Array]:
    """Return the measurement Jacobian (2, 6) of a fix and the covariance (2, 2) of its white error."""
    H = np.hstack([np.eye(2, 4), fraction * sigma * np.eye(2)])
    return H, sigma**2 * (1.0 - fraction**2) * np.eye(2)


class EkfBias(PoseEstimator):
    """Estimator of x, y, course, steering bias and correlated GNSS error; `[estimator] kind = "ekf_bias"`."""

    kind: Literal["ekf_bias"] = "ekf_bias"
    turning_velocity: bool = True
    """Whether the velocity estimate rotates with the yaw, so that the speed remains valid in a bend without fixes."""
    steer_bias_walk_deg_rt_s: NonNegative = 0.1
    """Random walk of the steering bias [deg/sqrt(s)]. Assumed value (0.05-0.4) for 1 deg in half a turn on a slope."""
    initial_steer_bias_sigma_deg: NonNegative = 1.0
    """Initial standard deviation of the steering bias [deg]. Assumed value, the resolution of the potentiometer."""
    gnss_correlated_fraction: Fraction = 0.3
    """Correlated fraction of the fix variance, as used by the filter [-]. Assumed value, as for the receiver."""
    gnss_correlation_time_s: Positive = 30.0
    """Correlation time of the fix error, as used by the filter [s]. Assumed value, as for the receiver."""

    def pose_filter(self, tractor: TractorParameters) -> BiasEkf:
        """Return the EKF with states for steering bias and correlated error."""
        levels = Levels(
            position_walk=self.position_walk_m_rt_s,
            yaw_walk=radians(self.yaw_walk_deg_rt_s),
            bias_walk=radians(self.steer_bias_walk_deg_rt_s),
            correlated_share=sqrt(self.gnss_correlated_fraction),
            correlation_time=self.gnss_correlation_time_s,
        )
        return BiasEkf(tractor.wheelbase_m, levels)

    def beliefs(self) -> tuple[Array, Array]:
        """Return the initial means (all zero) and standard deviations of the bias and the correlated GNSS error."""
        return np.zeros(3), np.array((radians(self.initial_steer_bias_sigma_deg), 1.0, 1.0))

    def steer_bias(self, pose: Array) -> float:
        """Return the estimated steering bias: measured steering angle minus angle for the path curvature [rad]."""
        return float(pose[BIAS])
