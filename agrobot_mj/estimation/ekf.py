"""Estimator of the paper: velocity Kalman filter (KF) and extended Kalman filter (EKF) of the pose.

The pose (x, y, yaw) in ENU [m, m, rad] is the pose of R, the point on the ground below the centre of the rear axle. The
inputs are the speed [m/s] and the steering angle [rad] during the tick; the measurements are x and y from GNSS. The yaw
is estimated from the motion. The yaw is not wrapped, so that differences of yaw remain valid. With the explicit Euler
step of the paper, the estimated yaw leads by half a tick in a bend (0.2 deg at 0.13 rad/s).

The model assumes an exact steering angle. Other causes of rotation (sideslip on a slope, an offset of the
potentiometer) are covered by the random walk of the yaw and cause a constant heading error. The filter interprets the
correlated part of the GNSS error as motion; the pose covariance therefore includes only the white part.
"""

from math import cos, nan, radians, sin, tan
from typing import Literal, NamedTuple

import numpy as np

from agrobot_mj.core.held import Held
from agrobot_mj.core.kernels import fetched, held, jit, stage
from agrobot_mj.core.signals import Estimate, Fix, Matrix, Vector
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


class PoseEkfLaw(NamedTuple):
    """Parameters of `PoseEkf` as numbers for compiled kernels."""

    wheelbase: float  # Wheelbase L [m]
    walks: tuple[float, float, float]  # Random-walk coefficients of x, y [m/sqrt(s)] and yaw [rad/sqrt(s)]


@jit
def f(pose: Vector, speed: float, steer: float, wheelbase: float, dt: float) -> Vector:
    """Return the pose (x, y, yaw) after `dt` [s] at `speed` [m/s], steering angle `steer` [rad] and `wheelbase` [m]."""
    (x, y, psi), T_s, u, delta, L = (pose[0], pose[1], pose[2]), dt, speed, steer, wheelbase
    yaw = psi + T_s * u * tan(delta) / L
    return np.array((x + T_s * u * cos(psi), y + T_s * u * sin(psi), yaw))  # [agrobots: kinematicmodelEKF]


@jit
def jacobian(yaw: float, speed: float, dt: float) -> Matrix:
    """Return the derivative of the new pose `f` with respect to the old pose, shape (3, 3)."""
    psi, T_s, u = yaw, dt, speed
    return np.array(((1.0, 0.0, -T_s * u * sin(psi)), (0.0, 1.0, T_s * u * cos(psi)), (0.0, 0.0, 1.0)))


@jit
def linearise(p: PoseEkfLaw, mean: Vector, inputs: Inputs, sigma: float) -> Linearised:
    """Return the motion and measurement model linearised at the pose `mean` (3,); see `FixEkf.model`."""
    speed, steer, dt = inputs
    Q, R = np.zeros((3, 3)), np.zeros((2, 2))
    for k in range(3):
        Q[k, k] = dt * (p.walks[k] * p.walks[k])
    R[0, 0] = R[1, 1] = sigma * sigma
    x = f(mean, speed, steer, p.wheelbase, dt)  # [agrobots: generalmodelEKF]
    return Linearised(x, jacobian(mean[2], speed, dt), Q, np.eye(2, 3), R)


@stage
def _tick(
    s: Held[PoseSettings], p: Held[PoseEkfLaw], state: Held[PoseState], m: Readings, fix: Fix, quality: int, dt: float
) -> tuple[Held[PoseState], Held[Estimate], Vector]:
    """Return the new state and the estimate, by reference, after a tick of `dt` [s], and an empty array of log
    values."""
    s, p, state = fetched(s), fetched(p), fetched(state)
    now = update_velocity_filter(s, state, m, fix, quality, 0.0, dt)
    model = linearise(p, state.pose, (now.speed, m.steer, dt), now.sigma)
    after, estimate = state_and_estimate(s, state, now, correct(model, state.pose_covariance, now.fix), m, nan, dt)
    return held(after), held(estimate), np.empty(0)


class PoseEkf(FixEkf):
    """Pose EKF for a given wheelbase [m] and given random walks of position [m/sqrt(s)] and yaw [rad/sqrt(s)]."""

    model = staticmethod(linearise)

    def __init__(self, wheelbase: float, position_walk: float, yaw_walk: float) -> None:
        self.law = PoseEkfLaw(wheelbase, (position_walk, position_walk, yaw_walk))


class Ekf(PoseEstimator):
    """Estimator of the paper for x, y and yaw, selected by `[estimator] kind = "ekf"`."""

    kind: Literal["ekf"] = "ekf"
    compiled = staticmethod(_tick)

    def pose_filter(self, tractor: TractorParameters) -> PoseEkf:
        """Return the pose EKF of the paper for a `tractor`."""
        return PoseEkf(tractor.wheelbase_m, self.position_walk_m_rt_s, radians(self.yaw_walk_deg_rt_s))
