"""The paper's estimator: velocity KF and pose EKF.

The steering angle is taken as exact: whatever else turns the tractor - sideslip on a slope, a potentiometer off its
zero - is left to the yaw's random walk, which leaves the heading at a constant offset. The correlated part of the
GNSS error is taken for motion, and the stated uncertainty covers the white part alone.

Extended Kalman filter of the pose (x, y, yaw) at R, the point below the centre of the rear axle.

ENU [m, m, rad]; inputs speed [m/s] and steering angle [rad] of the interval, measurement x, y from GNSS. The
yaw is not measured: motion reveals it. It stays unwrapped inside, so that differences of yaw mean what they
say; the residual holds positions only and needs no wrapping. The model is the paper's explicit Euler step: in
a turn it puts the yaw half a tick ahead (0.2 deg at 0.13 rad/s).
"""

from functools import lru_cache
from math import cos, radians, sin, tan
from typing import Literal

import numpy as np

from agrobot_mj.core.signals import Array, Fix
from agrobot_mj.estimation.pose_estimator import PoseEstimator
from agrobot_mj.estimation.position_ekf import FixEkf
from agrobot_mj.machine.tractor import TractorParameters

H = np.eye(2, 3)
"""Jacobian of the measurement x, y [-]."""


def f(pose: Array, speed: float, steer: float, wheelbase: float, dt: float) -> Array:
    """Pose (3,) after `dt` [s] at `speed` [m/s] and `steer` [rad]; `wheelbase` [m]."""
    (x, y, psi), T_s, u, delta, L = pose.tolist(), dt, speed, steer, wheelbase
    yaw = psi + T_s * u * tan(delta) / L
    return np.array((x + T_s * u * cos(psi), y + T_s * u * sin(psi), yaw))  # [agrobots: kinematicmodelEKF]


def jacobian(yaw: float, speed: float, dt: float) -> Array:
    """Derivative of `f` by the pose, shape (3, 3)."""
    psi, T_s, u = yaw, dt, speed
    return np.array(((1.0, 0.0, -T_s * u * sin(psi)), (0.0, 1.0, T_s * u * cos(psi)), (0.0, 0.0, 1.0)))


class PoseEkf(FixEkf):
    """The filter for one wheelbase [m] and one level of process noise [m/sqrt(s), rad/sqrt(s)]."""

    def __init__(self, wheelbase: float, position_walk: float, yaw_walk: float) -> None:
        super().__init__(wheelbase)
        self.walk = np.diag(np.square((position_walk, position_walk, yaw_walk)))

    def step(
        self, mean: Array, covariance: Array, inputs: tuple[float, float, float], fix: Fix | None, sigma: float
    ) -> tuple[Array, Array, float]:
        """As `FixEkf.step`, with n = 3."""
        speed, steer, dt = inputs
        F, Q = jacobian(float(mean[2]), speed, dt), dt * self.walk
        x = f(mean, speed, steer, self.wheelbase, dt)  # [agrobots: generalmodelEKF]
        return self.corrected(x, covariance, F, Q, fix, x[:2], H, _noise(sigma))


@lru_cache(maxsize=8)
def _noise(sigma: float) -> Array:
    """Covariance (2, 2) of a fix."""
    return np.diag(np.square((sigma, sigma)))


class Ekf(PoseEstimator):
    """x, y and yaw; `[estimator] kind = "ekf"`."""

    kind: Literal["ekf"] = "ekf"

    def pose_filter(self, tractor: TractorParameters) -> PoseEkf:
        """The paper's EKF."""
        return PoseEkf(tractor.wheelbase_m, self.position_walk_m_rt_s, radians(self.yaw_walk_deg_rt_s))
