"""Disturbance-aware estimator: velocity KF, and an EKF that also learns a steering bias and the slow GNSS error.

A turned potentiometer, and on a side slope the steering that merely holds the course, both show as a steering angle
without a turn. The paper's EKF spreads them over its heading; here they have a state. What is called yaw is really
the course of R, the direction in which the rear axle moves: without a sensor of the heading itself only the sum of
heading and sideslip is observable, whatever the path, since adding to the one what is taken from the other changes
no measurement. On level ground the two differ by the slip of the rear tyres, in a bend of 10 m by a few tenths of a
degree; on a side slope by the crab.
"""

from math import radians, sqrt
from typing import Literal

import numpy as np

from agrobot_mj.estimation.base import PoseEstimator
from agrobot_mj.estimation.bias_ekf import BIAS, BiasEkf, Levels
from agrobot_mj.signals import Array
from agrobot_mj.spec import Fraction, NonNegative, Positive
from agrobot_mj.tractor import TractorParameters


class EkfBias(PoseEstimator):
    """x, y, course, steering bias and correlated GNSS error; `[estimator] kind = "ekf_bias"`."""

    kind: Literal["ekf_bias"] = "ekf_bias"
    turning_velocity: bool = True
    """Whether the velocity belief turns with the yaw from tick to tick: without a fix the speed holds in a bend."""
    steer_bias_walk_deg_rt_s: NonNegative = 0.1
    """Random walk of the steering bias [deg/sqrt(s)]. Estimate: half a turn across a slope changes it by a degree."""
    initial_steer_bias_sigma_deg: NonNegative = 1.0
    """Of no bias at the start [deg]. Estimate: the potentiometer's resolution."""
    gnss_correlated_fraction: Fraction = 0.3
    """Believed share of the correlated part in the variance of a fix [-]. Estimate, the receiver's."""
    gnss_correlation_time_s: Positive = 30.0
    """Believed correlation time of that part [s]. Estimate, the receiver's."""

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
        """No bias, give or take its initial sigma; the slow error in its stationary distribution."""
        return np.zeros(3), np.array((radians(self.initial_steer_bias_sigma_deg), 1.0, 1.0))

    def steer_bias(self, pose: Array) -> float:
        """What the steering angle reads beyond what the motion shows, left positive [rad]."""
        return float(pose[BIAS])
