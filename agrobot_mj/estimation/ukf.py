"""Unscented Kalman filter of the pose, based on `UnscentedKalmanFilter` of filterpy.

State, motion model, measurement and noise are the same as in `ekf`. Scaled sigma points [Merwe2004] replace the
Jacobian, so that the predicted mean includes the effect of a large yaw variance after a long time without fixes. Mean
and covariance agree with the results of `ekf` for a small standard deviation of the yaw.
"""

from math import nan, radians
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from agrobot_mj.core.errors import import_extra
from agrobot_mj.core.signals import Array, Fix
from agrobot_mj.estimation.ekf import PoseEkf, f
from agrobot_mj.estimation.pose_estimator import PoseEstimator
from agrobot_mj.machine.tractor import TractorParameters

GAUSSIAN = 2.0  # Parameter beta of the sigma points for a normal distribution [-] [Merwe2004]


class PoseUkf(PoseEkf):
    """Unscented pose filter for a given wheelbase [m], process noise and spread of the sigma points."""

    def __init__(self, wheelbase: float, position_walk: float, yaw_walk: float, spread: float) -> None:
        super().__init__(wheelbase, position_walk, yaw_walk)
        self.spread = spread

    def step(
        self, mean: Array, covariance: Array, inputs: tuple[float, float, float], fix: Fix | None, sigma: float
    ) -> tuple[Array, Array, float]:
        """Return the mean (3,), covariance (3, 3) and NIS [-] after a tick, corrected by a fix; see `FixEkf.step`."""
        from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

        speed, steer, dt = inputs
        points = MerweScaledSigmaPoints(3, self.spread, GAUSSIAN, 0.0)
        ukf = UnscentedKalmanFilter(
            dim_x=3,
            dim_z=2,
            dt=dt,
            hx=lambda x: x[:2],
            fx=lambda x, dt: f(x, speed, steer, self.law.wheelbase, dt),
            points=points,
        )
        ukf.x, ukf.P, ukf.Q, ukf.R = mean, covariance, dt * np.diag(np.square(self.law.walks)), sigma**2 * np.eye(2)
        ukf.predict()
        if fix is None:
            return ukf.x, ukf.P, nan
        ukf.update(np.array((fix.x, fix.y)))
        return ukf.x, ukf.P, float(ukf.y @ ukf.SI @ ukf.y)


class Ukf(PoseEstimator):
    """Unscented estimator of x, y and yaw, selected by `[estimator] kind = "ukf"`."""

    kind: Literal["ukf"] = "ukf"
    sigma_point_spread: Annotated[float, Field(gt=0, le=1)] = 0.5
    """Distance of the sigma points from the mean, divided by sqrt(3) standard deviations [-]. Assumed value (range
    0.1-1)."""

    def pose_filter(self, tractor: TractorParameters) -> PoseUkf:
        """Return the unscented pose filter for a `tractor`. Raises `ScenarioError` if filterpy is not installed."""
        import_extra("filterpy", "filters", 'estimator.kind = "ukf"')
        walks = self.position_walk_m_rt_s, radians(self.yaw_walk_deg_rt_s)
        return PoseUkf(tractor.wheelbase_m, *walks, self.sigma_point_spread)
