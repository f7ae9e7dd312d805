"""Estimator of the paper: velocity Kalman filter (KF) and extended Kalman filter (EKF) of the pose.

The pose (x, y, yaw) in ENU [m, m, rad] is the pose of R, the point on the ground below the centre of the rear axle.
Inputs are the speed [m/s] and the steering angle [rad] during the tick; measurements are x and y from GNSS. The yaw is
estimated from the motion. It is not wrapped, so that differences of yaw remain valid. The explicit Euler step of the
paper advances the yaw by half a tick in a turn (0.2 deg at 0.13 rad/s).

The model assumes an exact steering angle. Other causes of rotation (sideslip on a slope, an offset of the
potentiometer) appear in the random walk of the yaw and cause a constant heading error. The filter interprets the
correlated part of the GNSS error as motion, so that its covariance includes only the white part.
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
"""Jacobian of the measured x and y with respect to the pose [-]."""


def f(pose: Array, speed: float, steer: float, wheelbase: float, dt: float) -> Array:
    """Return the pose (3,) after `dt` [s] at `speed` [m/s] and steering angle `steer` [rad]; `wheelbase` in [m]."""
    (x, y, psi), T_s, u, delta, L = pose.tolist(), dt, speed, steer, wheelbase
    yaw = psi + T_s * u * tan(delta) / L
    return np.array((x + T_s * u * cos(psi), y + T_s * u * sin(psi), yaw))  # [agrobots: kinematicmodelEKF]


def jacobian(yaw: float, speed: float, dt: float) -> Array:
    """Return the derivative of `f` with respect to the pose, shape (3, 3)."""
    psi, T_s, u = yaw, dt, speed
    return np.array(((1.0, 0.0, -T_s * u * sin(psi)), (0.0, 1.0, T_s * u * cos(psi)), (0.0, 0.0, 1.0)))


class PoseEkf(FixEkf):
    """Pose EKF for a given wheelbase [m] and given process noise of position and yaw [m/sqrt(s), rad/sqrt(s)]."""

    def __init__(self, wheelbase: float, position_walk: float, yaw_walk: float) -> None:
        super().__init__(wheelbase)
        self.walk = np.diag(np.square((position_walk, position_walk, yaw_walk)))

    def step(
        self, mean: Array, covariance: Array, inputs: tuple[float, float, float], fix: Fix | None, sigma: float
    ) -> tuple[Array, Array, float]:
        """Return mean (3,), covariance (3, 3) and NIS; see `FixEkf.step`."""
        speed, steer, dt = inputs
        F, Q = jacobian(float(mean[2]), speed, dt), dt * self.walk
        x = f(mean, speed, steer, self.wheelbase, dt)  # [agrobots: generalmodelEKF]
        return self.corrected(x, covariance, F, Q, fix, x[:2], H, _noise(sigma))


@lru_cache(maxsize=8)
def _noise(sigma: float) -> Array:
    """Return the covariance of a fix, shape (2, 2) [m2]."""
    return np.diag(np.square((sigma, sigma)))


class Ekf(PoseEstimator):
    """Estimator of the paper for x, y and yaw; `[estimator] kind = "ekf"`."""

    kind: Literal["ekf"] = "ekf"

    def pose_filter(self, tractor: TractorParameters) -> PoseEkf:
        """Return the pose EKF of the paper."""
        return PoseEkf(tractor.wheelbase_m, self.position_walk_m_rt_s, radians(self.yaw_walk_deg_rt_s))
