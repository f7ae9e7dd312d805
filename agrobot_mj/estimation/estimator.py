"""One tick of estimation: velocity filter, then pose filter, then what the controllers believe about the CG.

Measurement in, `Estimate` out; SI units and radians, ENU. The antenna is taken to stand straight above R, as
in the paper, so roll on a slope is an error that the estimator does not know of. So is the correlated part of
the GNSS error: it passes for motion, and the stated uncertainty covers the white part alone. Speed is the
filtered velocity along the estimated heading: signed, and unbiased at standstill where its magnitude would
not be.
"""

from functools import lru_cache
from math import cos, exp, radians, sin, tan
from typing import Literal, NamedTuple

import numpy as np

from agrobot_mj.estimation.pose_ekf import PoseEkf
from agrobot_mj.estimation.velocity_kf import VelocityKf
from agrobot_mj.geometry import wrap
from agrobot_mj.signals import Array, Estimate, Measurement, Quality
from agrobot_mj.spec import NonNegative, Positive, Spec
from agrobot_mj.tractor import TractorParameters


class EstimatorState(NamedTuple):
    """Beliefs after a tick, and the two filters, which remember nothing themselves."""

    velocity_kf: VelocityKf
    pose_ekf: PoseEkf
    cg_to_rear_axle: float
    """l_r [m]."""
    motion: Array
    """x, vx, y, vy of the antenna, shape (4,) [m, m/s]."""
    motion_covariance: Array
    """Shape (4, 4)."""
    pose: Array
    """x, y, yaw at R, yaw not wrapped, shape (3,) [m, rad]."""
    pose_covariance: Array
    """Shape (3, 3)."""
    yaw_rate: float
    """Low-passed difference of the estimated yaw [rad/s]."""


class Estimator(Spec):
    """Velocity KF and pose EKF; `[estimator]`."""

    kind: Literal["ekf"] = "ekf"
    yaw_rate_source: Literal["ekf", "kinematic", "gyro"] = "ekf"
    """Yaw rate: difference of the EKF's yaw, u tan(delta) / L, or the gyro (which must be enabled)."""
    yaw_rate_filter_s: NonNegative = 0.15
    """Low pass on the EKF's yaw difference, time constant, 0 for none [s]. Estimate: noise against lag."""
    gnss_sigma_m: Positive = 0.02
    """Believed error of a fixed solution, per axis [m]. Paper, section V-A."""
    gnss_float_sigma_m: Positive = 0.3
    """The same for a float solution [m]. Estimate."""
    gnss_velocity_sigma_m_s: Positive = 0.03
    """Believed error of the GNSS velocity, per axis [m/s]. Estimate."""
    velocity_walk_m_s_rt_s: Positive = 0.1
    """Random walk of the velocity, per axis [m/s/sqrt(s)]. Estimate (pedal and turns)."""
    position_walk_m_rt_s: Positive = 0.01
    """Random walk of the EKF's position [m/sqrt(s)]. Estimate: 0.007 from GNSS velocity, and sway."""
    yaw_walk_deg_rt_s: Positive = 0.3
    """Random walk of the EKF's yaw: slip and steering error [deg/sqrt(s)]. Estimate."""
    initial_position_sigma_m: Positive = 0.05
    """Of the position given to `init` [m]. Estimate."""
    initial_velocity_sigma_m_s: Positive = 1.0
    """Of standing still at the start [m/s]. Estimate."""
    initial_yaw_sigma_deg: Positive = 5.0
    """Of the yaw given to `init` [deg]. Estimate."""

    @property
    def needs_gyro(self) -> bool:
        """Whether the scenario must enable the gyro."""
        return self.yaw_rate_source == "gyro"

    def init(self, x: float, y: float, yaw: float, tractor: TractorParameters) -> EstimatorState:
        """Standing at R = (x, y) [m] with heading `yaw` [rad], give or take the initial sigmas."""
        s, v = self.initial_position_sigma_m, self.initial_velocity_sigma_m_s
        yaw_walk, s_yaw = radians(self.yaw_walk_deg_rt_s), radians(self.initial_yaw_sigma_deg)
        return EstimatorState(
            velocity_kf=VelocityKf(self.velocity_walk_m_s_rt_s),
            pose_ekf=PoseEkf(tractor.wheelbase_m, self.position_walk_m_rt_s, yaw_walk),
            cg_to_rear_axle=tractor.cg_to_rear_axle,
            motion=np.array((x, 0.0, y, 0.0)),
            motion_covariance=np.diag(np.square((s, v, s, v))),
            pose=np.array((x, y, yaw)),
            pose_covariance=np.diag(np.square((s, s, s_yaw))),
            yaw_rate=0.0,
        )

    def update(self, state: EstimatorState, measurement: Measurement, dt: float) -> tuple[EstimatorState, Estimate]:
        """Beliefs at the end of a tick of length `dt` [s], from what was measured in it."""
        fix, steer = measurement.fix, measurement.steer
        sigma = self.gnss_float_sigma_m if measurement.quality == Quality.FLOAT else self.gnss_sigma_m
        noise_motion, noise_pose = _fix_noise(sigma, self.gnss_velocity_sigma_m_s)
        motion, motion_covariance = state.velocity_kf.step(state.motion, state.motion_covariance, fix, noise_motion, dt)
        speed = _along(state.pose[2], motion)
        pose, pose_covariance = state.pose_ekf.step(
            state.pose, state.pose_covariance, (speed, steer, dt), fix, noise_pose
        )
        keep = exp(-dt / self.yaw_rate_filter_s) if self.yaw_rate_filter_s > 0.0 else 0.0
        yaw_rate = keep * state.yaw_rate + (1.0 - keep) * float(pose[2] - state.pose[2]) / dt
        state = state._replace(
            motion=motion,
            motion_covariance=motion_covariance,
            pose=pose,
            pose_covariance=pose_covariance,
            yaw_rate=yaw_rate,
        )
        return state, self._estimate(state, measurement)

    def _estimate(self, state: EstimatorState, measurement: Measurement) -> Estimate:
        x, y, psi = state.pose.tolist()
        l_r, u = state.cg_to_rear_axle, _along(psi, state.motion)
        match self.yaw_rate_source:
            case "ekf":
                gamma = state.yaw_rate
            case "kinematic":
                delta, L = measurement.steer, state.pose_ekf.wheelbase
                gamma = u * tan(delta) / L  # [agrobots: kinematicmodeltractor]
            case "gyro":
                gamma = measurement.gyro
        return Estimate(
            x=x + l_r * cos(psi),
            y=y + l_r * sin(psi),
            yaw=wrap(psi),
            speed=u,
            yaw_rate=gamma,
            rear_x=x,
            rear_y=y,
            covariance=state.pose_covariance,
        )


def _along(yaw: float, motion: Array) -> float:
    """Velocity of the belief `motion` along the heading [m/s]."""
    _, vx, _, vy = motion.tolist()
    return float(vx * cos(yaw) + vy * sin(yaw))


@lru_cache(maxsize=8)
def _fix_noise(position_sigma: float, velocity_sigma: float) -> tuple[Array, Array]:
    """Covariances of a fix as (x, vx, y, vy), shape (4, 4), and as (x, y), shape (2, 2)."""
    s, v = position_sigma, velocity_sigma
    return np.diag(np.square((s, v, s, v))), np.diag(np.square((s, s)))
