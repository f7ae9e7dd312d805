"""What the paper's estimator and its relatives share: velocity filter, pose filter, then the estimate of the CG.

Measurement in, `Estimate` out; SI units and radians, ENU. As in the paper the antenna is taken to stand straight
above R, so that roll on a slope is an unmodelled error; with `terrain_compensation` the measured roll and pitch move
the fix from the antenna down to R first, and lean the CG. Speed is the filtered velocity along the estimated heading:
signed, and unbiased at standstill where its magnitude would not be. A kind of estimator is a pose filter with its
keys.
"""

from functools import lru_cache
from math import cos, exp, isfinite, nan, radians, sin, tan
from typing import Literal, NamedTuple

import numpy as np

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
    """Beliefs after a tick, and what `init` prepares once: the filters, which keep nothing, and the lever arms."""

    velocity_kf: VelocityKf
    """Filter of the antenna's motion."""
    pose_filter: FixEkf
    """Filter of the pose."""
    cg: tuple[float, float, float]
    """CG from R in vehicle axes: l_r, 0, height [m]."""
    antenna: tuple[float, float, float]
    """Antenna from R in vehicle axes [m]."""
    motion: Array
    """Mean x, vx, y, vy of the antenna, shape (4,) [m, m/s]."""
    motion_covariance: Array
    """Covariance of `motion`, shape (4, 4)."""
    pose: Array
    """Mean x, y, yaw at R, yaw not wrapped, and the pose filter's further states, shape (n,) [m, rad, ...]."""
    pose_covariance: Array
    """Covariance of `pose`, shape (n, n)."""
    yaw_rate: float
    """Low-passed difference of the estimated yaw [rad/s]."""
    lever: Lever | None = None
    """Lean of the antenna; None before the first tick, and without compensation."""
    health: Health = Health()
    """Diagnostics without the truth."""


class PoseEstimator(StateEstimator):
    """Velocity KF and a pose filter; a kind overrides `pose_filter`, and `beliefs` if it has states of its own."""

    backend: Literal["compiled", "filterpy"] = "compiled"
    """Implementation of both filters: compiled, or filterpy's `KalmanFilter` and `ExtendedKalmanFilter` in Python."""
    yaw_rate_source: Literal["ekf", "kinematic", "gyro"] = "ekf"
    """Yaw rate: difference of the EKF's yaw, u tan(delta) / L, or the gyro (which must be enabled)."""
    terrain_compensation: bool = False
    """Whether measured roll and pitch move the fix from the antenna to R (needs the IMU); not in the paper."""
    swing_filter_s: NonNegative = 0.1
    """Low pass on the antenna's swing, for the compensation, 0 for none [s]. Assumed value (0-0.2): noise against
    lag."""
    turning_velocity: bool = False
    """Whether the velocity belief turns with the yaw from tick to tick, or goes straight on as in the paper."""
    yaw_rate_filter_s: NonNegative = 0.15
    """Low pass on the EKF's yaw difference, time constant, 0 for none [s]. Assumed value (0.1-0.3): noise against
    lag."""
    gnss_sigma_m: Positive = 0.02
    """Believed error of a fixed solution, per axis [m]. Paper, section V-A."""
    gnss_float_sigma_m: Positive = 0.3
    """Believed error of a float solution, per axis [m]. Assumed value: the receiver's."""
    gnss_velocity_sigma_m_s: Positive = 0.03
    """Believed error of the GNSS velocity, per axis [m/s]. Assumed value: the receiver's."""
    velocity_walk_m_s_rt_s: Positive = 0.1
    """Random walk of the velocity, per axis [m/s/sqrt(s)]. Assumed value (0.05-0.3): pedal and turns."""
    position_walk_m_rt_s: Positive = 0.01
    """Random walk of the EKF's position [m/sqrt(s)]. Assumed value: 0.007 from GNSS velocity, and sway."""
    yaw_walk_deg_rt_s: Positive = 0.3
    """Random walk of the EKF's yaw: slip and steering error [deg/sqrt(s)]. Assumed value (0.1-1)."""
    initial_position_sigma_m: Positive = 0.05
    """Standard deviation of the position given to `init` [m]. Assumed value: a fix or two."""
    initial_velocity_sigma_m_s: Positive = 1.0
    """Standard deviation of the velocity at the start, which is taken as none [m/s]. Assumed value: it stands."""
    initial_yaw_sigma_deg: Positive = 5.0
    """Standard deviation of the yaw given to `init` [deg]. Assumed value: placed by eye."""

    @property
    def needs(self) -> dict[str, str]:
        """The gyro as source of the yaw rate, the inertial unit for the compensation."""
        gyro = {"gyro": 'yaw_rate_source: "gyro"'} if self.yaw_rate_source == "gyro" else {}
        return gyro | ({"imu": "terrain_compensation:"} if self.terrain_compensation else {})

    def pose_filter(self, tractor: TractorParameters) -> FixEkf:
        """The filter of x, y, yaw and what else this kind estimates."""
        raise NotImplementedError

    def beliefs(self) -> tuple[Array, Array]:
        """Mean and standard deviation of the states beyond the pose at the start, each of shape (n - 3,)."""
        return np.empty(0), np.empty(0)

    def steer_bias(self, pose: Array) -> float | None:
        """Steering bias [rad], None if this kind does not estimate it."""
        return None

    def init(self, x: float, y: float, yaw: float, tractor: TractorParameters) -> EstimatorState:
        """Standing at R = (x, y) [m] with heading `yaw` [rad], give or take the initial sigmas."""
        s, v, s_yaw = (
            self.initial_position_sigma_m,
            self.initial_velocity_sigma_m_s,
            radians(self.initial_yaw_sigma_deg),
        )
        further, sigmas = self.beliefs()
        velocity_kf, pose_filter = VelocityKf(self.velocity_walk_m_s_rt_s), self.pose_filter(tractor)
        if self.backend == "filterpy":
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
        """Beliefs at the end of a tick of length `dt` [s], from what was measured in it."""
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
            health=state.health.after(nis, None if fix is None else _time_of(fix, measurement), dt),
        )
        return state, self._estimate(state, measurement, nis)

    def _turn(self, state: EstimatorState, steer: float, dt: float) -> float:
        """Turn of the yaw in `dt` [s] at a measured steering angle [rad]."""
        delta, u = steer - (self.steer_bias(state.pose) or 0.0), _along(state.pose[2], state.motion)
        return u * tan(delta) / state.pose_filter.wheelbase * dt

    def _attitude(self, measurement: Measurement) -> tuple[float, float]:
        """Roll and pitch, zero without compensation or reading [rad]."""
        heard = self.terrain_compensation and isfinite(measurement.roll + measurement.pitch)
        return (measurement.roll, measurement.pitch) if heard else (0.0, 0.0)

    def _lever(self, state: EstimatorState, measurement: Measurement, dt: float) -> Lever | None:
        """Lean of the antenna at the end of a tick, with compensation."""
        if not self.terrain_compensation:
            return None
        if not isfinite(measurement.roll + measurement.pitch):
            return state.lever
        now = offset(state.antenna, measurement.roll, measurement.pitch, state.pose[2])
        return state.lever.after(now, dt, self.swing_filter_s) if state.lever else Lever(now)

    def _estimate(self, state: EstimatorState, measurement: Measurement, nis: float) -> Estimate:
        x, y, psi = state.pose[:3].tolist()
        covariance = state.pose_covariance[:3, :3]  # a view of the filter's own, which nobody else may write
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
    """Time of a fix, that of its arrival where the receiver does not say [s]."""
    return fix.t if isfinite(fix.t) else measurement.t


def _along(yaw: float, motion: Array) -> float:
    """Velocity of the belief `motion` along the heading [m/s]."""
    _, vx, _, vy = motion.tolist()
    return float(vx * cos(yaw) + vy * sin(yaw))


@lru_cache(maxsize=8)
def _fix_noise(position_sigma: float, velocity_sigma: float) -> Array:
    """Covariance of a fix as (x, vx, y, vy), shape (4, 4)."""
    s, v = position_sigma, velocity_sigma
    return np.diag(np.square((s, v, s, v)))
