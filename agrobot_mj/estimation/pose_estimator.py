"""Base class of the paper's estimator and its variants: velocity filter, pose filter, and estimate of the CG.

SI units and radians, ENU. As in the paper, the antenna is assumed to be exactly above R, the ground point below the
rear axle, so that roll on a slope causes an unmodelled error. With `terrain_compensation`, the measured roll and pitch
are used to transform the fix to R and to compute the tilted position of the CG. The speed is the filtered velocity
along the estimated heading, which has a sign, and no bias at standstill. Subclasses define their keys and pose filter.
"""

from functools import lru_cache
from math import cos, exp, isfinite, nan, radians, sin, tan
from typing import ClassVar, Literal, NamedTuple

import numpy as np

from agrobot_mj.core.errors import required
from agrobot_mj.core.geometry import wrap
from agrobot_mj.core.signals import Array, Estimate, Fix, Measurement, Quality
from agrobot_mj.core.spec import NonNegative, Positive
from agrobot_mj.estimation.base import Health, StateEstimator, largest_sigma
from agrobot_mj.estimation.kalman import filterpy_ekf, filterpy_kf
from agrobot_mj.estimation.lever_arm import Lever, at_foot, offset
from agrobot_mj.estimation.position_ekf import FixEkf
from agrobot_mj.estimation.velocity_kf import VelocityKf, turned
from agrobot_mj.machine.tractor import TractorParameters


class EstimatorState(NamedTuple):
    """State of a `PoseEstimator`, with the filters (which have no internal state) and the constant lever arms."""

    velocity_kf: VelocityKf
    """Filter of the antenna's position and velocity."""
    pose_filter: FixEkf
    """Filter of the pose."""
    cg: tuple[float, float, float]
    """Position of the CG relative to the rear-axle point R in vehicle axes: l_r, 0, height [m]."""
    antenna: tuple[float, float, float]
    """Position of the antenna relative to the rear-axle point R in vehicle axes [m]."""
    motion: Array
    """Mean position and velocity (x, vx, y, vy) of the antenna, shape (4,) [m, m/s]."""
    motion_covariance: Array
    """Covariance of `motion`, shape (4, 4)."""
    pose: Array
    """Mean x, y, yaw (not wrapped) of the rear axle and other pose-filter states, shape (n,) [m, rad, ...]."""
    pose_covariance: Array
    """Covariance of `pose`, shape (n, n)."""
    yaw_rate: float
    """Low-pass filtered rate of the estimated yaw [rad/s]."""
    lever: Lever | None = None
    """Lever arm of the tilted antenna; None before the first tick and without compensation."""
    health: Health = Health()
    """Diagnostics that do not need the true state."""


class PoseEstimator(StateEstimator):
    """Velocity KF and pose filter; subclasses define `pose_filter`, and `beliefs` for additional states."""

    sized: ClassVar = {"yaw_walk_deg_rt_s": {"length": -1}}

    backend: Literal["compiled", "filterpy"] = "compiled"
    """Implementation of both filters: compiled, or `KalmanFilter` and `ExtendedKalmanFilter` of filterpy."""
    yaw_rate_source: Literal["ekf", "kinematic", "gyro"] = "ekf"
    """Source of the yaw rate: yaw estimate (`ekf`), u tan(delta) / L (`kinematic`), or gyro, which must be enabled."""
    terrain_compensation: bool = False
    """Whether fixes are transformed from the antenna to the rear axle with measured roll and pitch; needs the IMU."""
    swing_filter_s: NonNegative = 0.1
    """Filter time constant of the antenna velocity due to tilting; 0 for no filter [s]. Assumed value (0-0.2)."""
    turning_velocity: bool = False
    """Whether the velocity estimate rotates with the yaw. Default: false (constant direction), as in the paper."""
    yaw_rate_filter_s: NonNegative = 0.15
    """Time constant of the low-pass filter of the EKF's yaw rate; 0 for none [s]. Assumed value (0.1-0.3)."""
    gnss_sigma_m: Positive = 0.02
    """Standard deviation of an RTK-fixed position per axis, as used by the filter [m]. Paper, section V-A."""
    gnss_float_sigma_m: Positive = 0.3
    """Standard deviation of an RTK-float position per axis in the filter [m]. Assumed value, as for the receiver."""
    gnss_velocity_sigma_m_s: Positive = 0.03
    """Standard deviation of the GNSS velocity per axis in the filter [m/s]. Assumed value, as for the receiver."""
    velocity_walk_m_s_rt_s: Positive = 0.1
    """Random walk of the velocity per axis [m/s/sqrt(s)]. Assumed value (0.05-0.3) for changes of pedal and heading."""
    position_walk_m_rt_s: Positive = 0.01
    """Random walk of the EKF's position [m/sqrt(s)]. Assumed value: 0.007 from velocity noise, plus oscillation."""
    yaw_walk_deg_rt_s: Positive = 0.3
    """Random walk of the EKF's yaw [deg/sqrt(s)]. Assumed value (0.1-1) for slip and steering errors, whose effect
    decreases with the wheelbase."""
    initial_position_sigma_m: Positive = 0.05
    """Standard deviation of the initial position [m]. Assumed value for one or two fixes."""
    initial_velocity_sigma_m_s: Positive = 1.0
    """Standard deviation of the initial velocity, which is zero [m/s]. Assumed value; the tractor starts at rest."""
    initial_yaw_sigma_deg: Positive = 5.0
    """Standard deviation of the initial yaw [deg]. Assumed value for a tractor aligned by eye."""

    @property
    def needs(self) -> dict[str, str]:
        """Required sensors: gyro if it is the source of the yaw rate, and IMU for terrain compensation."""
        gyro = {"gyro": 'yaw_rate_source: "gyro"'} if self.yaw_rate_source == "gyro" else {}
        return gyro | ({"imu": "terrain_compensation:"} if self.terrain_compensation else {})

    def pose_filter(self, tractor: TractorParameters) -> FixEkf:
        """Return the filter of x, y, yaw and the additional states of the estimator."""
        raise NotImplementedError

    def beliefs(self) -> tuple[Array, Array]:
        """Return the initial mean and standard deviation of the states after x, y and yaw, each of shape (n - 3,)."""
        return np.empty(0), np.empty(0)

    def steer_bias(self, pose: Array) -> float | None:
        """Return the estimated steering bias [rad], or None if the filter has no such state."""
        return None

    def init(self, x: float, y: float, yaw: float, tractor: TractorParameters) -> EstimatorState:
        """Return the initial state at standstill, with the rear axle at (x, y) [m] and heading `yaw` [rad]."""
        s, v, s_yaw = (
            self.initial_position_sigma_m,
            self.initial_velocity_sigma_m_s,
            radians(self.initial_yaw_sigma_deg),
        )
        further, sigmas = self.beliefs()
        velocity_kf, pose_filter = VelocityKf(self.velocity_walk_m_s_rt_s), self.pose_filter(tractor)
        if self.backend == "filterpy":
            required("filterpy", "filters", 'estimator.backend = "filterpy"')
            velocity_kf.tick, pose_filter.tick = filterpy_kf, filterpy_ekf
        return EstimatorState(
            velocity_kf=velocity_kf,
            pose_filter=pose_filter,
            cg=(tractor.cg_to_rear_axle, 0.0, tractor.cg_height_m),
            antenna=(0.0, 0.0, tractor.antenna_height_m),
            motion=np.array((x, 0.0, y, 0.0)),
            motion_covariance=np.diag(np.square((s, v, s, v))),
            pose=np.array((x, y, yaw, *further)),
            pose_covariance=np.diag(np.square((s, s, s_yaw, *sigmas))),
            yaw_rate=0.0,
        )

    def update(self, state: EstimatorState, measurement: Measurement, dt: float) -> tuple[EstimatorState, Estimate]:
        """Return the new state and the estimate at the end of a tick of `dt` [s] with this measurement."""
        sigma = self.gnss_sigma_m if measurement.quality == Quality.FIX else self.gnss_float_sigma_m
        lever = self._lever(state, measurement, dt)
        fix = measurement.fix if measurement.fix is None or lever is None else at_foot(measurement.fix, lever)
        noise = _fix_noise(sigma, self.gnss_velocity_sigma_m_s)
        motion, motion_covariance = state.motion, state.motion_covariance
        if self.turning_velocity:
            motion, motion_covariance = turned(motion, motion_covariance, self._turn(state, measurement.steer, dt))
        motion, motion_covariance = state.velocity_kf.step(motion, motion_covariance, fix, noise, dt)
        yaw = float(state.pose[2])
        inputs = (_along(yaw, motion), measurement.steer, dt)
        pose, pose_covariance, nis = state.pose_filter.step(state.pose, state.pose_covariance, inputs, fix, sigma)
        keep = exp(-dt / self.yaw_rate_filter_s) if self.yaw_rate_filter_s > 0.0 else 0.0
        yaw_rate = keep * state.yaw_rate + (1.0 - keep) * (float(pose[2]) - yaw) / dt
        state = EstimatorState(
            velocity_kf=state.velocity_kf,
            pose_filter=state.pose_filter,
            cg=state.cg,
            antenna=state.antenna,
            motion=motion,
            motion_covariance=motion_covariance,
            pose=pose,
            pose_covariance=pose_covariance,
            yaw_rate=yaw_rate,
            lever=lever,
            health=state.health.after(nis, nan if fix is None else _time_of(fix, measurement), dt),
        )
        return state, self._estimate(state, measurement, nis)

    def _turn(self, state: EstimatorState, steer: float, dt: float) -> float:
        """Return the change of yaw in `dt` [s] computed from the measured steering angle [rad]."""
        delta, u = steer - (self.steer_bias(state.pose) or 0.0), _along(state.pose[2], state.motion)
        return u * tan(delta) / state.pose_filter.wheelbase * dt

    def _attitude(self, measurement: Measurement) -> tuple[float, float]:
        """Return roll and pitch [rad]; zero without compensation or measurement."""
        known = self.terrain_compensation and isfinite(measurement.roll + measurement.pitch)
        return (measurement.roll, measurement.pitch) if known else (0.0, 0.0)

    def _lever(self, state: EstimatorState, measurement: Measurement, dt: float) -> Lever | None:
        """Return the lever arm of the tilted antenna at the end of a tick; None without compensation."""
        if not self.terrain_compensation:
            return None
        if not isfinite(measurement.roll + measurement.pitch):
            return state.lever
        now = offset(state.antenna, measurement.roll, measurement.pitch, state.pose[2])
        return state.lever.after(now, dt, self.swing_filter_s) if state.lever else Lever(now)

    def _estimate(self, state: EstimatorState, measurement: Measurement, nis: float) -> Estimate:
        x, y, psi = state.pose[:3].tolist()
        covariance = state.pose_covariance[:3, :3]  # view of the filter's array: read-only
        covariance.flags.writeable = False
        bias, u = self.steer_bias(state.pose), _along(psi, state.motion)
        match self.yaw_rate_source:
            case "ekf":
                gamma = state.yaw_rate
            case "kinematic":
                delta, L = measurement.steer - (bias or 0.0), state.pose_filter.wheelbase
                gamma = u * tan(delta) / L  # [agrobots: kinematicmodeltractor]
            case "gyro":
                gamma = measurement.gyro if isfinite(measurement.gyro) else state.yaw_rate
        east, north = offset(state.cg, *self._attitude(measurement), psi)
        return Estimate(
            x=x + east,
            y=y + north,
            yaw=wrap(psi),
            speed=u,
            yaw_rate=gamma,
            rear_x=x,
            rear_y=y,
            covariance=covariance,
            nis=nis,
            steer_bias=nan if bias is None else bias,
            fix_age=measurement.t - state.health.fix_t,
            position_sigma=largest_sigma(state.pose_covariance),
            nis_mean=state.health.nis,
        )


def _time_of(fix: Fix, measurement: Measurement) -> float:
    """Return the time of a fix, or its arrival time if the receiver reports no time [s]."""
    return fix.t if isfinite(fix.t) else measurement.t


def _along(yaw: float, motion: Array) -> float:
    """Return the component of the estimated velocity along the heading [m/s]."""
    _, vx, _, vy = motion.tolist()
    return float(vx * cos(yaw) + vy * sin(yaw))


@lru_cache(maxsize=8)
def _fix_noise(position_sigma: float, velocity_sigma: float) -> Array:
    """Return the covariance of a fix (x, vx, y, vy), shape (4, 4)."""
    s, v = position_sigma, velocity_sigma
    return np.diag(np.square((s, v, s, v)))
