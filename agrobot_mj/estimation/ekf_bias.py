"""Estimator with disturbance states: velocity KF, and EKF with states for steering bias and slow GNSS error.

A steering angle is measured without rotation of the tractor for two reasons: an offset of the potentiometer, and a
straight course on a side slope. The EKF of the paper converts both into a heading error; this filter estimates their
sum as a state. The yaw is the course of R, the direction of motion of the rear axle. With these sensors only the sum of
heading and sideslip is observable, on any path. Heading and course differ by the slip of the rear tyres: a few tenths
of a degree in a bend of 10 m on level ground, and the crab angle on a side slope.

The states are x, y [m] of R, the course chi [rad, not wrapped], the steering bias b [rad], and the errors g_x, g_y [-].
g is the correlated error of the fix divided by its standard deviation s, a first-order Gauss-Markov process
[Brown2012]. The inputs are the speed u and the steering angle delta, and the measurement is the position z of the fix:

  chi' = u tan(delta - b) / L,    x' = u cos(chi),  y' = u sin(chi),    random walk of b and g,    z = (x, y) + s g

The bias is the measured steering angle minus the angle for the path curvature: an error of the potentiometer, or the
difference of the front and rear slip angles on a side slope. The bias is observable while the tractor moves. With b = 0
and without a correlated part, the filter equals the filter of `ekf`.
"""

from math import cos, exp, radians, sin, sqrt, tan
from typing import Literal, NamedTuple

import numpy as np

from agrobot_mj.core.held import Held
from agrobot_mj.core.kernels import fetched, held, jit, stage
from agrobot_mj.core.signals import Array, Estimate, Fix, Matrix, Vector
from agrobot_mj.core.spec import Fraction, NonNegative, Positive
from agrobot_mj.estimation.base import Readings
from agrobot_mj.estimation.pose_estimator import (
    PoseEstimator,
    PoseSettings,
    PoseState,
    state_and_estimate,
    update_velocity_filter,
)
from agrobot_mj.estimation.position_ekf import FixEkf, Inputs, Linearised, correct
from agrobot_mj.machine.tractor import TractorParameters

BIAS = 3  # Index of the steering bias in the state


class Levels(NamedTuple):
    """Noise parameters of the filter: random walks of the states, and the correlated part of the fix error."""

    position_walk: float  # Random-walk coefficient of the position [m/sqrt(s)]
    yaw_walk: float  # Random-walk coefficient of the course [rad/sqrt(s)]
    bias_walk: float  # Random-walk coefficient of the steering bias [rad/sqrt(s)]
    correlated_share: float
    """Standard deviation of the time-correlated fix error, divided by the standard deviation of the total error [-]."""
    correlation_time: float  # Correlation time of the time-correlated fix error [s]


@jit
def f(state: Vector, speed: float, steer: float, wheelbase: float, dt: float, phi: float) -> Vector:
    """Return the states (6,) after `dt` [s]; `phi` is the decay factor of the correlated GNSS error during `dt` [-]."""
    x, y, chi, b, g_x, g_y = state[0], state[1], state[2], state[BIAS], state[4], state[5]
    T_s, u, L = dt, speed, wheelbase
    turned = chi + T_s * u * tan(steer - b) / L
    return np.array((x + T_s * u * cos(chi), y + T_s * u * sin(chi), turned, b, phi * g_x, phi * g_y))


@jit
def jacobian(state: Vector, speed: float, steer: float, wheelbase: float, dt: float, phi: float) -> Matrix:
    """Return the derivative of the new states `f` with respect to the old states, shape (6, 6)."""
    chi, b, T_s, u, L = state[2], state[BIAS], dt, speed, wheelbase
    F, angle = np.eye(6), steer - b
    F[4, 4] = F[5, 5] = phi
    F[0, 2], F[1, 2] = -T_s * u * sin(chi), T_s * u * cos(chi)
    F[2, BIAS] = -T_s * u / (L * (cos(angle) * cos(angle)))
    return F


class BiasEkfLaw(NamedTuple):
    """Parameters of `BiasEkf` as numbers for compiled kernels."""

    wheelbase: float  # Wheelbase L [m]
    levels: Levels


@jit
def linearise(p: BiasEkfLaw, mean: Vector, inputs: Inputs, sigma: float) -> Linearised:
    """Return the motion and measurement model linearised at the state `mean` (6,); see `FixEkf.model`."""
    (speed, steer, dt), s = inputs, p.levels
    phi = exp(-dt / s.correlation_time)
    wander, scale = sqrt((1.0 - phi * phi) / dt), s.correlated_share * sigma
    Q, H, R = np.zeros((6, 6)), np.eye(2, 6), np.zeros((2, 2))
    for k, walk in enumerate((s.position_walk, s.position_walk, s.yaw_walk, s.bias_walk, wander, wander)):
        Q[k, k] = dt * (walk * walk)
    H[0, 4] = H[1, 5] = scale
    R[0, 0] = R[1, 1] = sigma * sigma * (1.0 - s.correlated_share * s.correlated_share)
    x = f(mean, speed, steer, p.wheelbase, dt, phi)
    return Linearised(x, jacobian(mean, speed, steer, p.wheelbase, dt, phi), Q, H, R)


@stage
def _tick(
    s: Held[PoseSettings], p: Held[BiasEkfLaw], state: Held[PoseState], m: Readings, fix: Fix, quality: int, dt: float
) -> tuple[Held[PoseState], Held[Estimate], Vector]:
    """Return the new state and the estimate, by reference, after a tick of `dt` [s], and an empty array of log
    values."""
    s, p, state = fetched(s), fetched(p), fetched(state)
    now = update_velocity_filter(s, state, m, fix, quality, state.pose[BIAS], dt)
    model = linearise(p, state.pose, (now.speed, m.steer, dt), now.sigma)
    found = correct(model, state.pose_covariance, now.fix)
    after, estimate = state_and_estimate(s, state, now, found, m, float(found[0][BIAS]), dt)
    return held(after), held(estimate), np.empty(0)


class BiasEkf(FixEkf):
    """Pose EKF with states for steering bias and GNSS error, for a given wheelbase [m] and given noise parameters."""

    model = staticmethod(linearise)

    def __init__(self, wheelbase: float, levels: Levels) -> None:
        self.law = BiasEkfLaw(wheelbase, levels)


class EkfBias(PoseEstimator):
    """Estimator of x, y, course, steering bias and GNSS error, selected by `[estimator] kind = "ekf_bias"`."""

    kind: Literal["ekf_bias"] = "ekf_bias"
    compiled = staticmethod(_tick)
    turning_velocity: bool = True
    """Whether the velocity estimate rotates with the yaw, so that the speed remains valid in a bend without fixes."""
    steer_bias_walk_deg_rt_s: NonNegative = 0.1
    """Random-walk coefficient of the steering bias [deg/sqrt(s)]. Assumed value (range 0.05-0.4) for changes of 1 deg
    in a half turn on a slope."""
    initial_steer_bias_sigma_deg: NonNegative = 1.0
    """Initial standard deviation of the steering bias [deg]. Assumed value: the resolution of the potentiometer."""
    gnss_correlated_fraction: Fraction = 0.3
    """Time-correlated fraction of the fix variance in the filter [-]. Assumed value, equal to the value of the receiver
    model."""
    gnss_correlation_time_s: Positive = 30.0
    """Correlation time of the fix error in the filter [s]. Assumed value, equal to the value of the receiver model."""

    def pose_filter(self, tractor: TractorParameters) -> BiasEkf:
        """Return the pose EKF with states for steering bias and correlated GNSS error."""
        levels = Levels(
            position_walk=self.position_walk_m_rt_s,
            yaw_walk=radians(self.yaw_walk_deg_rt_s),
            bias_walk=radians(self.steer_bias_walk_deg_rt_s),
            correlated_share=sqrt(self.gnss_correlated_fraction),
            correlation_time=self.gnss_correlation_time_s,
        )
        return BiasEkf(tractor.wheelbase_m, levels)

    def beliefs(self) -> tuple[Array, Array]:
        """Return the initial means (all zero) and standard deviations of steering bias and correlated GNSS error."""
        return np.zeros(3), np.array((radians(self.initial_steer_bias_sigma_deg), 1.0, 1.0))

    def steer_bias(self, pose: Array) -> float:
        """Return the estimated steering bias [rad]: the measured steering angle minus the angle that corresponds to the
        path curvature."""
        return float(pose[BIAS])
