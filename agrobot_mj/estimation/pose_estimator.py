"""Base class of the paper's estimator and its variants: velocity filter, pose filter, and estimate of the CG.

SI units and radians, ENU. As in the paper, the antenna is assumed to be exactly above R, the ground point below the
rear axle, so that roll on a slope causes an unmodelled error. With `terrain_compensation`, the measured roll and pitch
are used to transform the fix to R and to compute the tilted position of the CG. The speed is the component of the
filtered velocity along the estimated heading: negative in reverse, and unbiased at standstill. Subclasses define their
keys and pose filter.
"""

from math import cos, exp, isfinite, isnan, nan, radians, sin, tan
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np

from agrobot_mj.core.calls import Linked
from agrobot_mj.core.contracts import is_compiled
from agrobot_mj.core.errors import import_extra
from agrobot_mj.core.geometry import wrap
from agrobot_mj.core.held import Held
from agrobot_mj.core.kernels import fetched, held, jit
from agrobot_mj.core.signals import NO_FIX, Array, Estimate, Fix, Matrix, Measurement, Quality, Vector
from agrobot_mj.core.spec import NonNegative, Positive
from agrobot_mj.estimation.base import CompiledEstimator, Health, Readings, largest_sigma
from agrobot_mj.estimation.kalman import filterpy_ekf, filterpy_kf
from agrobot_mj.estimation.lever_arm import UNKNOWN, Lever, at_foot, offset
from agrobot_mj.estimation.position_ekf import FixEkf
from agrobot_mj.estimation.velocity_kf import VelocityKf, rotate_velocity, velocity_step
from agrobot_mj.machine.tractor import TractorParameters

SOURCES = ("ekf", "kinematic", "gyro")  # Values of `yaw_rate_source`, in the order of their integer codes
KINEMATIC, GYRO = 1, 2
FIXED = Quality.FIX  # Quality of an RTK-fixed position, as a number for kernels


class PoseSettings(NamedTuple):
    """Parameters of a `PoseEstimator` as numbers for compiled kernels; fields without a comment are scenario values."""

    cg: tuple[float, float, float]  # Position of the CG relative to the rear-axle point R: ahead, left and up [m]
    antenna: tuple[float, float, float]  # Position of the antenna relative to the rear-axle point R in vehicle axes [m]
    wheelbase: float  # Wheelbase L [m]
    source: int  # Index of `yaw_rate_source` in `SOURCES`
    tilts: bool  # Whether measured roll and pitch are used (terrain compensation)
    turns: bool  # Whether the velocity estimate rotates with the yaw
    swing_filter_s: float
    yaw_rate_filter_s: float
    sigmas: tuple[float, float, float]
    """Standard deviations of RTK-fixed and RTK-float positions [m] and of the GNSS velocity [m/s]."""
    velocity_walk: float


class PoseState(NamedTuple):
    """Means, covariances and diagnostics of a `PoseEstimator`, updated in each tick."""

    motion: Vector  # Mean position and velocity (x, vx, y, vy) of the antenna, shape (4,) [m, m/s]
    motion_covariance: Matrix  # Covariance of `motion`, shape (4, 4)
    pose: Vector  # Mean x, y, yaw (not wrapped) of the rear axle and other pose-filter states, shape (n,) [m, rad, ...]
    pose_covariance: Matrix  # Covariance of `pose`, shape (n, n)
    yaw_rate: float = 0.0  # Low-pass filtered rate of the estimated yaw [rad/s]
    lever: Lever = UNKNOWN  # Lever arm of the tilted antenna, or NaN before the first tick and without compensation
    health: Health = Health()  # Diagnostics that do not need the true state


class EstimatorState(NamedTuple):
    """State of a `PoseEstimator` between two ticks."""

    settings: Held[PoseSettings]  # Parameters of the estimator
    law: Held[Any]  # Parameters of the compiled pose filter
    numbers: Held[PoseState]  # Means, covariances and diagnostics
    filters: tuple[VelocityKf, FixEkf] | None
    """Velocity filter and pose filter if they are evaluated in Python, or None if the tick is compiled."""


class Prepared(NamedTuple):
    """Inputs of the pose filter for one tick."""

    fix: Fix  # Fix of the rear-axle point R, or NaN if there is no fix
    sigma: float  # Standard deviation of the position of the fix [m]
    lever: Lever  # New lever arm of the antenna, as in `PoseState.lever`
    motion: Vector  # New mean of the velocity filter, as in `PoseState.motion`
    motion_covariance: Matrix  # New covariance of the velocity filter, as in `PoseState.motion_covariance`
    speed: float  # Velocity along the estimated heading [m/s]


@jit
def filter_inputs(
    s: PoseSettings, state: PoseState, m: Readings, fix: Fix, quality: int, bias: float, dt: float
) -> tuple[Prepared, Matrix]:
    """Return the inputs of the velocity filter, and the noise covariance (4, 4) of the fix (x, vx, y, vy)."""
    sigma, v = s.sigmas[0] if quality == FIXED else s.sigmas[1], s.sigmas[2]
    lever, noise = state.lever, np.zeros((4, 4))
    if s.tilts and isfinite(m.roll + m.pitch):
        lever = lever.after(offset(s.antenna, m.roll, m.pitch, state.pose[2]), dt, s.swing_filter_s)
    if not (isnan(fix.x) or isnan(lever.offset[0])):
        fix = at_foot(fix, lever)
    for place in (0, 2):
        noise[place, place], noise[place + 1, place + 1] = sigma * sigma, v * v
    motion, P, speed = state.motion, state.motion_covariance, along(state.pose[2], state.motion)
    if s.turns:
        motion, P = rotate_velocity(motion, P, speed * tan(m.steer - bias) / s.wheelbase * dt)
    return Prepared(fix, sigma, lever, motion, P, speed), noise


@jit
def update_velocity_filter(
    s: PoseSettings, state: PoseState, m: Readings, fix: Fix, quality: int, bias: float, dt: float
) -> Prepared:
    """Update the velocity filter and return the inputs of the pose filter.

    `bias` is the steering bias [rad]. A missing fix is NaN.
    """
    now, noise = filter_inputs(s, state, m, fix, quality, bias, dt)
    motion, P = velocity_step(s.velocity_walk, now.motion, now.motion_covariance, now.fix, noise, dt)
    return Prepared(now.fix, now.sigma, now.lever, motion, P, along(state.pose[2], motion))


@jit
def state_and_estimate(
    s: PoseSettings, state: PoseState, now: Prepared, found: tuple[Vector, Matrix, float], m: Readings, bias: float,
    dt: float,
) -> tuple[PoseState, Estimate]:  # fmt: skip
    """Return state and estimate from the result `found` of the pose filter; an unknown steering `bias` [rad] is NaN."""
    pose, P, nis = found
    x, y, psi = pose[0], pose[1], pose[2]
    keep = exp(-dt / s.yaw_rate_filter_s) if s.yaw_rate_filter_s > 0.0 else 0.0
    yaw_rate = keep * state.yaw_rate + (1.0 - keep) * (psi - state.pose[2]) / dt
    accepted = nan if isnan(now.fix.x) else now.fix.t if isfinite(now.fix.t) else m.t
    health, covariance = state.health.after(nis, accepted, dt), np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            covariance[i, j] = P[i, j]
    u, gamma = along(psi, now.motion), yaw_rate
    if s.source == KINEMATIC:
        delta, L = m.steer - (0.0 if isnan(bias) else bias), s.wheelbase
        gamma = u * tan(delta) / L  # [agrobots: kinematicmodeltractor]
    elif s.source == GYRO and isfinite(m.gyro):
        gamma = m.gyro
    known = s.tilts and isfinite(m.roll + m.pitch)
    roll, pitch = (m.roll, m.pitch) if known else (0.0, 0.0)
    east, north = offset(s.cg, roll, pitch, psi)
    age, sigma = m.t - health.fix_t, largest_sigma(P)
    return PoseState(now.motion, now.motion_covariance, pose, P, yaw_rate, now.lever, health), Estimate(
        x + east, y + north, wrap(psi), u, gamma, x, y, covariance, nis, bias, 0.0, True, age, sigma, health.nis
    )


@jit
def along(yaw: float, motion: Vector) -> float:
    """Return the component of the estimated velocity along the heading `yaw` [rad], in m/s."""
    return float(motion[1] * cos(yaw) + motion[3] * sin(yaw))


class PoseEstimator(CompiledEstimator):
    """Base class of estimators with velocity filter and pose filter.

    Subclasses define `pose_filter` and, for additional states, `beliefs`.
    """

    sized: ClassVar = {"yaw_walk_deg_rt_s": {"length": -1}}
    compiled: ClassVar[Any] = None
    """Compiled function that computes a tick, or None if the filters are evaluated in Python."""

    backend: Literal["compiled", "filterpy"] = "compiled"
    """Implementation of both Kalman filters: `compiled`, or the classes of the package `filterpy`."""
    yaw_rate_source: Literal["ekf", "kinematic", "gyro"] = "ekf"
    """Source of the yaw rate: estimated yaw (`ekf`), speed and steering angle (`kinematic`), or an enabled `gyro`."""
    terrain_compensation: bool = False
    """Whether roll and pitch from the IMU are used to transform fixes from the antenna to the rear axle."""
    swing_filter_s: NonNegative = 0.1
    """Time constant for filtering the antenna velocity caused by tilting [s]; 0 disables the filter. Assumed value
    (range 0-0.2)."""
    turning_velocity: bool = False
    """Whether the velocity estimate rotates with the yaw. Default: false (constant direction), as in the paper."""
    yaw_rate_filter_s: NonNegative = 0.15
    """Time constant for filtering the EKF's yaw rate [s]; 0 disables the filter. Assumed value (range 0.1-0.3)."""
    gnss_sigma_m: Positive = 0.02
    """Standard deviation of RTK-fixed positions per axis in the filter [m]. Paper, section V-A."""
    gnss_float_sigma_m: Positive = 0.3
    """Standard deviation of RTK-float positions per axis in the filter [m]. Assumed value, equal to the value of the
    receiver model."""
    gnss_velocity_sigma_m_s: Positive = 0.03
    """Standard deviation of the GNSS velocity per axis in the filter [m/s]. Assumed value, equal to the value of the
    receiver model."""
    velocity_walk_m_s_rt_s: Positive = 0.1
    """Random-walk coefficient of the velocity per axis [m/s/sqrt(s)]. Assumed value (range 0.05-0.3) for changes of
    pedal position and heading."""
    position_walk_m_rt_s: Positive = 0.01
    """Random-walk coefficient of the EKF's position [m/sqrt(s)]. Assumed value: 0.007 for velocity noise, plus antenna
    oscillation."""
    yaw_walk_deg_rt_s: Positive = 0.3
    """Random-walk coefficient of the EKF's yaw [deg/sqrt(s)]. Assumed value (range 0.1-1) for sideslip and steering
    errors, whose effect decreases with increasing wheelbase."""
    initial_position_sigma_m: Positive = 0.05
    """Standard deviation of the initial position [m]. Assumed value for the mean of one or two fixes."""
    initial_velocity_sigma_m_s: Positive = 1.0
    """Standard deviation of the initial velocity [m/s], whose mean is zero. Assumed value for a start at rest."""
    initial_yaw_sigma_deg: Positive = 5.0
    """Standard deviation of the initial yaw [deg]. Assumed value for a tractor aligned by eye."""

    @property
    def needs(self) -> dict[str, str]:
        """Required sensors: the gyro if it is the source of the yaw rate, and the IMU for terrain compensation."""
        gyro = {"gyro": 'yaw_rate_source: "gyro"'} if self.yaw_rate_source == "gyro" else {}
        return gyro | ({"imu": "terrain_compensation:"} if self.terrain_compensation else {})

    def pose_filter(self, tractor: TractorParameters) -> FixEkf:
        """Return the pose filter, whose states are x, y, yaw and any additional states of the estimator."""
        raise NotImplementedError

    def beliefs(self) -> tuple[Array, Array]:
        """Return initial means and standard deviations of the n - 3 additional states that follow x, y and yaw."""
        return np.empty(0), np.empty(0)

    def steer_bias(self, pose: Array) -> float | None:
        """Return the estimated steering bias [rad], or None if the filter does not estimate a steering bias."""
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
            import_extra("filterpy", "filters", 'estimator.backend = "filterpy"')
            velocity_kf.tick, pose_filter.tick = filterpy_kf, filterpy_ekf
        numbers = PoseState(
            motion=np.array((x, 0.0, y, 0.0)),
            motion_covariance=np.diag(np.square((s, v, s, v))),
            pose=np.array((x, y, yaw, *further)),
            pose_covariance=np.diag(np.square((s, s, s_yaw, *sigmas))),
        )
        law = getattr(pose_filter, "law", None)
        filters = None if self._filters_compiled else (velocity_kf, pose_filter)
        return EstimatorState(held(self._settings(tractor)), law and held(law), held(numbers), filters)

    def _settings(self, tractor: TractorParameters) -> PoseSettings:
        return PoseSettings(
            cg=(tractor.cg_to_rear_axle, 0.0, tractor.cg_height_m),
            antenna=(0.0, 0.0, tractor.antenna_height_m),
            wheelbase=tractor.wheelbase_m,
            source=SOURCES.index(self.yaw_rate_source),
            tilts=self.terrain_compensation,
            turns=self.turning_velocity,
            swing_filter_s=self.swing_filter_s,
            yaw_rate_filter_s=self.yaw_rate_filter_s,
            sigmas=(self.gnss_sigma_m, self.gnss_float_sigma_m, self.gnss_velocity_sigma_m_s),
            velocity_walk=self.velocity_walk_m_s_rt_s,
        )

    @property
    def interpreted(self) -> bool:
        """Whether compiled ticks must call the methods of the estimator."""
        return not (self._filters_compiled and is_compiled(self, "report", "columns"))

    @property
    def _filters_compiled(self) -> bool:
        return self.backend == "compiled" and is_compiled(self, "update_held", "pose_filter", "steer_bias")

    def compiled_tick(self, state: EstimatorState) -> Linked:
        """Return the compiled tick function, its parameters and its state."""
        return Linked(self.compiled, state.settings, state.numbers, state.law)

    def state_after_ticks(self, state: EstimatorState, found: Held[PoseState], shown: Vector) -> EstimatorState:
        """Return the state of the estimator after ticks in compiled code, which ended in the state `found`."""
        return state._replace(numbers=found)

    def update_held(self, state: EstimatorState, measurement: Measurement, dt: float) -> tuple[Any, Held[Estimate]]:
        """Return the new state, and a native reference (`Held`) to the estimate at the end of a tick of `dt` [s]."""
        settings, law, numbers, filters = state
        m, fix, quality = Readings.of(measurement), measurement.fix or NO_FIX, measurement.quality
        if filters is None:
            numbers, estimate, _ = self.compiled(settings, law, numbers, m, fix, quality, dt)
            return EstimatorState(settings, law, numbers, None), estimate
        s, before, (velocity_kf, pose_filter) = fetched(settings), fetched(numbers), filters
        now, noise = filter_inputs(s, before, m, fix, quality, self.steer_bias(before.pose) or 0.0, dt)
        foot = measurement.fix and now.fix
        motion: Any = velocity_kf.step(now.motion, now.motion_covariance, foot, noise, dt)
        now = Prepared(now.fix, now.sigma, now.lever, motion[0], motion[1], along(before.pose[2], motion[0]))
        found: Any = pose_filter.step(before.pose, before.pose_covariance, (now.speed, m.steer, dt), foot, now.sigma)
        bias = self.steer_bias(found[0])
        after, estimate = state_and_estimate(s, before, now, found, m, nan if bias is None else bias, dt)
        return EstimatorState(settings, law, held(after), filters), held(estimate)
