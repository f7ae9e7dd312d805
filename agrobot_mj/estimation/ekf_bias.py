"""Disturbance-aware estimator: velocity KF, and an EKF that also estimates a steering bias and the slow GNSS error.

An offset of the potentiometer, and on a side slope the steering that merely holds the course, both show as a steering
angle without a turn. The paper's EKF spreads them over its heading; here they have a state. The yaw is really the
course of R, the direction in which the rear axle moves: with these sensors only the sum of heading and sideslip is
observable, whatever the path, since moving a constant from one to the other changes no measurement. On level ground
the two differ by the slip of the rear tyres, in a bend of 10 m by a few tenths of a degree; on a side slope by the
crab.

Extended Kalman filter of position and course at R, steering bias, and correlated GNSS error.

State x, y [m], course chi [rad, not wrapped], bias b [rad], g_x, g_y [-]: the correlated error of the fix, a
first-order Gauss-Markov process [Brown2012] in units of its standard deviation. Inputs and measurement as in
`ekf`:

    chi' = u tan(delta - b) / L,    x' = u cos(chi),  y' = u sin(chi),    b and g wander,    z = (x, y) + s g

with s the standard deviation of the correlated part. The bias is what the steering angle reads beyond the curvature
of the path: an error of the potentiometer, or the difference of front and rear slip angles that holds a course
across a slope. It shows as soon as the tractor moves. Without walk and initial variance of b, and without a
correlated share, this is the filter of `ekf`.
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
    """Process noise, and the split of the error of a fix into a correlated and a white part."""

    position_walk: float
    """Random walk of the position [m/sqrt(s)]."""
    yaw_walk: float
    """Random walk of the course [rad/sqrt(s)]."""
    bias_walk: float
    """Random walk of the steering bias [rad/sqrt(s)]."""
    correlated_share: float
    """Correlated part in the standard deviation of a fix [-]."""
    correlation_time: float
    """Correlation time of that part [s]."""


def f(state: Array, speed: float, steer: float, wheelbase: float, dt: float, phi: float) -> Array:
    """State (6,) after `dt` [s] at `speed` [m/s] and `steer` [rad]; `phi` is the decay of g [-]."""
    (x, y, chi, b, g_x, g_y), T_s, u, L = state.tolist(), dt, speed, wheelbase
    turned = chi + T_s * u * tan(steer - b) / L
    return np.array((x + T_s * u * cos(chi), y + T_s * u * sin(chi), turned, b, phi * g_x, phi * g_y))


def jacobian(state: Array, speed: float, steer: float, wheelbase: float, dt: float, phi: float) -> Array:
    """Derivative of `f` by the state, shape (6, 6)."""
    chi, b, T_s, u, L = state[2], state[BIAS], dt, speed, wheelbase
    F = np.diag((1.0, 1.0, 1.0, 1.0, phi, phi))
    F[0, 2], F[1, 2] = -T_s * u * sin(chi), T_s * u * cos(chi)
    F[2, BIAS] = -T_s * u / (L * cos(steer - b) ** 2)
    return F


class BiasEkf(FixEkf):
    """The filter for one wheelbase [m] and one set of noise levels."""

    def __init__(self, wheelbase: float, levels: Levels) -> None:
        super().__init__(wheelbase)
        self.levels = levels

    def step(
        self, mean: Array, covariance: Array, inputs: tuple[float, float, float], fix: Fix | None, sigma: float
    ) -> tuple[Array, Array, float]:
        """As `FixEkf.step`, with n = 6."""
        speed, steer, dt = inputs
        phi, Q = _noise(self.levels, dt)
        F, x = (part(mean, speed, steer, self.wheelbase, dt, phi) for part in (jacobian, f))
        H, R = _measuring(self.levels.correlated_share, sigma)
        return self.corrected(x, covariance, F, Q, fix, H @ x, H, R)


@lru_cache(maxsize=8)
def _noise(levels: Levels, dt: float) -> tuple[float, Array]:
    """Decay of g over `dt` [s], and the covariance (6, 6) of the process noise in it."""
    phi = exp(-dt / levels.correlation_time)
    p, yaw, b, g = levels.position_walk, levels.yaw_walk, levels.bias_walk, sqrt((1.0 - phi * phi) / dt)
    return phi, dt * np.diag(np.square((p, p, yaw, b, g, g)))


@lru_cache(maxsize=8)
def _measuring(share: float, sigma: float) -> tuple[Array, Array]:
    """Jacobian (2, 6) of a fix and the covariance (2, 2) of its white part."""
    H = np.hstack([np.eye(2, 4), share * sigma * np.eye(2)])
    return H, sigma**2 * (1.0 - share**2) * np.eye(2)


class EkfBias(PoseEstimator):
    """x, y, course, steering bias and correlated GNSS error; `[estimator] kind = "ekf_bias"`."""

    kind: Literal["ekf_bias"] = "ekf_bias"
    turning_velocity: bool = True
    """Whether the velocity belief turns with the yaw from tick to tick: without a fix the speed holds in a bend."""
    steer_bias_walk_deg_rt_s: NonNegative = 0.1
    """Random walk of the steering bias [deg/sqrt(s)]. Assumed value (0.05-0.4): a degree in half a turn on a slope."""
    initial_steer_bias_sigma_deg: NonNegative = 1.0
    """Standard deviation of the bias at the start [deg]. Assumed value: the potentiometer's resolution."""
    gnss_correlated_fraction: Fraction = 0.3
    """Believed share of the correlated part in the variance of a fix [-]. Assumed value, the receiver's."""
    gnss_correlation_time_s: Positive = 30.0
    """Believed correlation time of that part [s]. Assumed value, the receiver's."""

    def pose_filter(self, tractor: TractorParameters) -> BiasEkf:
        """The EKF with the further states."""
        levels = Levels(
            position_walk=self.position_walk_m_rt_s,
            yaw_walk=radians(self.yaw_walk_deg_rt_s),
            bias_walk=radians(self.steer_bias_walk_deg_rt_s),
            correlated_share=sqrt(self.gnss_correlated_fraction),
            correlation_time=self.gnss_correlation_time_s,
        )
        return BiasEkf(tractor.wheelbase_m, levels)

    def beliefs(self) -> tuple[Array, Array]:
        """No bias, with its initial sigma; the slow error in its stationary distribution."""
        return np.zeros(3), np.array((radians(self.initial_steer_bias_sigma_deg), 1.0, 1.0))

    def steer_bias(self, pose: Array) -> float:
        """What the steering angle reads beyond what the motion shows, left positive [rad]."""
        return float(pose[BIAS])
