"""The paper's estimator: velocity KF and pose EKF.

The steering angle is believed: whatever turns the tractor besides it - sideslip on a slope, a potentiometer off its
zero - is met by the yaw's random walk alone, and leaves the heading at a constant offset. The correlated part of
the GNSS error passes for motion, and the stated uncertainty covers the white part alone.
"""

from math import radians
from typing import Literal

from agrobot_mj.estimation.base import PoseEstimator
from agrobot_mj.estimation.pose_ekf import PoseEkf
from agrobot_mj.tractor import TractorParameters


class Ekf(PoseEstimator):
    """x, y and yaw; `[estimator] kind = "ekf"`."""

    kind: Literal["ekf"] = "ekf"

    def pose_filter(self, tractor: TractorParameters) -> PoseEkf:
        """The paper's EKF."""
        return PoseEkf(tractor.wheelbase_m, self.position_walk_m_rt_s, radians(self.yaw_walk_deg_rt_s))
