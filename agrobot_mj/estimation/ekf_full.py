"""Guidance estimator: EKF of pose, motion and slowly varying errors from GNSS, gyro, wheel speed and steering angle.

`full_model` defines the states and measurements, `full_filter` one tick with gates and alignment, and `horizon` the use
of delayed fixes. The initial heading is ignored: the yaw is determined after one or two metres of motion, as reported
by `Estimate.aligned`. `Estimate.yaw` is the course of R, the ground point below the rear axle; a path-following law
controls this course. The heading is the course minus `sideslip`, the slip of the rear tyres modelled from the side
force. The side force on a slope requires the IMU (`terrain_compensation`). Without the IMU the heading estimate
includes the crab angle, unless two antennas measure the heading (`sensors.gnss.dual_antenna`); the filter then also
estimates the unmodelled sideslip. The paper does not contain this estimator.
"""

from math import nan, radians, sqrt
from typing import ClassVar, Literal, NamedTuple

import numpy as np

from agrobot_mj.core.calls import Linked
from agrobot_mj.core.contracts import is_compiled
from agrobot_mj.core.held import Held
from agrobot_mj.core.kernels import held
from agrobot_mj.core.signals import NO_FIX, TICK_S, Column, Estimate, Measurement, Quality, Vector
from agrobot_mj.core.spec import Fraction, NonNegative, Positive
from agrobot_mj.estimation.base import HEALTH_COLUMNS, CompiledEstimator, Readings
from agrobot_mj.estimation.full_core import Core, Gates
from agrobot_mj.estimation.full_filter import UNALIGNED_SIGMA, FullFilter
from agrobot_mj.estimation.full_model import AHEAD, C, D, FixNoise, FullLevels, N, S
from agrobot_mj.estimation.horizon import FullNumbers, Horizon, Settings, Waiting, estimate_tick
from agrobot_mj.estimation.wheel_slip import WheelSlip
from agrobot_mj.machine.tractor import TractorParameters

COLUMNS = (
    Column("aligned", "-", "1 once the heading is initialised, else 0"),
    Column("sideslip_hat", "rad", "estimated course of R minus heading"),
    Column("gyro_bias_hat", "rad/s", "estimated bias of the gyro"),
    Column("mounting_hat", "rad", "estimated mounting error of two antennas"),
    Column("wheel_scale_hat", "-", "estimated relative error of the wheel speed"),
    Column("rejected_positions", "-", "number of fix positions rejected by the gate since the start"),
    Column("rejected_velocities", "-", "number of fix velocities rejected by the gate since the start"),
    Column("estimator_restarts", "-", "number of restarts of the position or the alignment since the start"),
)


class FullState(NamedTuple):
    """State of the estimator `EkfFull` between two ticks."""

    settings: Held[Settings]  # Constant parameters of the estimator, computed by `init`
    horizon: Horizon  # Filter state at the newest fix, and newer measurements
    nothing: Held[Waiting]  # Input of the filter in a tick without latency: an empty queue of measurements
    logged: Vector  # Values of the columns after the last tick, or NaN before the first tick, shape (11,)


class EkfFull(CompiledEstimator):
    """Estimator with 14 states, outlier gates, yaw alignment and delayed fixes (`[estimator] kind = "ekf_full"`)."""

    kind: Literal["ekf_full"] = "ekf_full"
    compiled: ClassVar = staticmethod(estimate_tick)
    terrain_compensation: bool = False
    """Whether roll and pitch from the IMU are used to transform fixes from the antenna to the rear axle."""
    swing_filter_s: NonNegative = 0.1
    """Time constant for filtering the antenna velocity caused by tilting [s]; 0 disables the filter. Assumed value
    (range 0-0.2)."""
    gyro_axes: Literal["vertical", "body"] = "vertical"
    """Gyro axis assumed by the filter: `vertical`, or `body` for an axis fixed to the chassis. With terrain
    compensation, the rate about a `body` axis is converted to a heading rate."""
    imu_wander_sigma_deg: NonNegative = 0.14
    """Standard deviation of the slow error of measured roll and pitch [deg]. Assumed value, below the 0.2 deg of the
    sensor model."""
    lean_sigma_deg: NonNegative = 0.1
    """Standard deviation of the unmeasured tilt on level ground [deg]. Assumed value (range 0.1-0.3) for the roll in
    bends."""
    roll_deg_s2_m: NonNegative = 0.4
    """Roll in a bend, divided by the specific side force [deg s2/m], used without terrain compensation. Assumed value:
    0.4 on firm ground and tilled soil, 0.6 in ruts."""
    pitch_deg: float = -0.3
    """Mean pitch on level ground [deg], positive nose down, used without terrain compensation. Assumed value: the rear
    is lower by 0.05 deg (firm ground), 0.15 deg (ruts) or 0.9 deg (carried implement)."""
    pitch_sigma_deg: NonNegative = 0.3
    """Standard deviation of the error of `pitch_deg` or of measured pitch [deg]. Assumed value, equal to the magnitude
    of `pitch_deg`."""
    pitch_walk_deg_rt_s: NonNegative = 0.015
    """Random-walk coefficient of the pitch error [deg/sqrt(s)]. Assumed value for changes of 0.1 deg in a bend with
    ruts."""
    gnss_sigma_m: Positive = 0.02
    """Standard deviation of RTK-fixed positions per axis in the filter [m]. Paper, section V-A."""
    gnss_correlated_fraction: Fraction = 0.3
    """Time-correlated fraction of the RTK-fixed position variance [-]. Assumed value, equal to the value of the
    receiver model."""
    gnss_correlation_time_s: Positive = 30.0
    """Correlation time of the error of an RTK-fixed position [s]. Assumed value, equal to the value of the receiver
    model."""
    gnss_float_sigma_m: Positive = 0.3
    """Standard deviation of RTK-float positions per axis in the filter [m]. Assumed value, equal to the value of the
    receiver model."""
    gnss_float_correlated_fraction: Fraction = 0.9
    """Time-correlated fraction of the RTK-float position variance [-]. Assumed value, equal to the value of the
    receiver model."""
    gnss_float_correlation_time_s: Positive = 60.0
    """Correlation time of RTK-float position errors [s]. Assumed value: half the receiver's value, because of jumps."""
    gnss_velocity_sigma_m_s: Positive = 0.03
    """Standard deviation of the GNSS velocity per axis in the filter [m/s]. Assumed value, equal to the value of the
    receiver model."""
    heading_sigma_deg: Positive = 0.25
    """Standard deviation of the two-antenna heading [deg]. Assumed value for errors of 4 mm with antennas 1 m apart."""
    gyro_sigma_deg_s: Positive = 0.1
    """Standard deviation of the gyro noise in the filter [deg/s]. Assumed value, equal to the value of the sensor
    model."""
    wheel_sigma_m_s: Positive = 0.02
    """Standard deviation of the wheel-speed noise in the filter [m/s]. Assumed value, equal to the value of the sensor
    model."""
    steer_sigma_deg_s: Positive = 1.0
    """Standard deviation of the yaw rate derived from the steering angle [deg/s]. Assumed value (range 0.5-3) for the
    error caused by tyre lag."""
    rear_compliance_deg_s2_m: NonNegative = 0.7
    """Rear sideslip divided by specific side force [deg s2/m]. Assumed value (`magic_formula` 0.6-0.8, `soil` 0.5)."""
    position_walk_m_rt_s: Positive = 0.003
    """Random-walk coefficient of the position [m/sqrt(s)]. Assumed value (range 0.002-0.01) for oscillations of the
    antenna."""
    yaw_walk_deg_rt_s: Positive = 0.012
    """Random-walk coefficient of the heading, excluding gyro noise [deg/sqrt(s)]. Assumed value (range 0.005-0.05) for
    errors of gyro scale and tilt."""
    speed_walk_m_s_rt_s: Positive = 0.1
    """Random-walk coefficient of the speed [m/s/sqrt(s)]. Assumed value (range 0.05-0.3) for changes of the pedal
    position."""
    yaw_rate_walk_deg_s_rt_s: Positive = 3.0
    """Random-walk coefficient of the yaw rate [deg/s/sqrt(s)]. Assumed value (range 1-10) for steering at the maximum
    rate."""
    gyro_bias_walk_deg_s_rt_s: Positive = 0.002
    """Random-walk coefficient of the gyro bias [deg/s/sqrt(s)]. Assumed value, equal to the value of the sensor
    model."""
    sideslip_walk_deg_rt_s: Positive = 0.1
    """Random-walk coefficient of unmodelled sideslip with two antennas [deg/sqrt(s)]. Assumed value, equal to
    `steer_bias_walk_deg_rt_s`."""
    steer_bias_walk_deg_rt_s: Positive = 0.1
    """Random-walk coefficient of the steering bias [deg/sqrt(s)]. Assumed value (range 0.05-0.4) for changes of 1 deg
    in a half turn on a slope."""
    wheel_scale_walk_rt_s: Positive = 0.001
    """Random-walk coefficient of the relative wheel-speed error [1/sqrt(s)]. Assumed value (range 0.0005-0.003) for
    slip changes."""
    compliance_walk_deg_s2_m_rt_s: Positive = 0.005
    """Random-walk coefficient of the rear-tyre compliance [deg s2/m/sqrt(s)]. Assumed value: the compliance doubles in
    slides."""
    turn_offset_walk_m_rt_m: Positive = 0.004
    """Random-walk coefficient of the turn offset (see `turn_offset_m`) over the distance [m/sqrt(m)]. Assumed value for
    changes of 0.05 m between bends in ruts and on tilled soil."""
    turn_offset_m: float = -0.015
    """Turn offset [m]: distance of the rear axle ahead of the point without sideslip in a slow bend. Assumed value:
    -0.02 to -0.01 on firm ground, 0.1 with a towed load, 0.35 in deep ruts."""
    lean_slip_walk_s2_m_rt_s: NonNegative = 0.0005
    """Random-walk coefficient of the relative wheel-speed error, divided by the gravity component along the ground
    [s2/m/sqrt(s)]. Assumed value for slip that is not proportional to the slope."""
    unseen_slip_walk_rt_s: NonNegative = 0.008
    """Additional random-walk coefficient of the relative wheel-speed error without fixes [1/sqrt(s)], used until fixes
    have determined the slip variation. Assumed value: an implement with a pull of 600-1500 N enters or leaves tilled
    soil every 45 s. Default: 0.008, or 0 if there is neither a lowered implement nor a drawbar pull."""
    slip_s2_m: NonNegative = 0.0175
    """Wheel slip on a climb, divided by the gravity component along the ground [s2/m]. Assumed value for firm ground;
    soil causes higher values."""
    slip_walk_s2_m_rt_s: Positive = 0.0005
    """Random-walk coefficient of the wheel slip on a climb [s2/m/sqrt(s)]. Assumed value for changes of soil and
    load."""
    initial_compliance_sigma_deg_s2_m: Positive = 0.09
    """Initial standard deviation of rear-tyre compliance [deg s2/m]. Assumed value for level or steep firm ground."""
    initial_turn_offset_sigma_m: Positive = 0.12
    """Initial standard deviation of the turn offset (see `turn_offset_m`) [m]. Assumed value (0.05 for firm ground to
    0.2 for deep ruts); higher values double the error caused by missing fixes in the first bend."""
    initial_slip_sigma_s2_m: Positive = 0.005
    """Initial standard deviation of the wheel slip on a climb [s2/m]. Assumed value for firm ground and tilled soil."""
    initial_position_sigma_m: Positive = 0.05
    """Standard deviation of the initial position [m]. Assumed value for the mean of one or two fixes."""
    initial_gyro_bias_sigma_deg_s: Positive = 0.5
    """Initial standard deviation of the gyro bias [deg/s]. Assumed value (range 0.1-1) for a cold MEMS unit."""
    initial_sideslip_sigma_deg: Positive = 2.0
    """Standard deviation of unmodelled sideslip [deg] at the first two-antenna heading. Assumed value on slopes."""
    initial_steer_bias_sigma_deg: Positive = 1.0
    """Initial standard deviation of the steering bias [deg]. Assumed value: the resolution of the potentiometer."""
    initial_wheel_scale_sigma: Positive = 0.05
    """Initial standard deviation of the relative wheel-speed error [-]. Assumed value for wear, pressure and slip."""
    initial_yaw_error_deg: float = 0.0
    """Error added to the initial heading [deg], to demonstrate the yaw alignment."""
    gate_sigma: Positive = 5.0
    """Number of standard deviations [-] above which an innovation is rejected as an outlier. Assumed value (range
    4-6)."""
    gate_position_m: NonNegative = 0.25
    """Position innovation up to which every fix is accepted [m]. Assumed value: a 2 m high antenna tilted by 7 deg."""
    gate_velocity_m_s: NonNegative = 0.5
    """Velocity innovation up to which every fix is accepted [m/s]. Assumed value for an antenna oscillation of 15
    deg/s."""
    gate_patience_s: Positive = 2.0
    """Duration of consecutive rejections [s] before the filter restarts from the fixes. Assumed value (range 1-5)."""

    @property
    def needs(self) -> dict[str, str]:
        """Required sensors: gyro and wheel speed, and the IMU for terrain compensation."""
        own = {"gyro": 'kind: "ekf_full"', "wheel_speed": 'kind: "ekf_full"'}
        return own | ({"imu": "terrain_compensation:"} if self.terrain_compensation else {})

    @property
    def columns(self) -> tuple[Column, ...]:
        """Log columns of the diagnostics, the outlier gates and the slowly varying errors."""
        return HEALTH_COLUMNS + COLUMNS

    def init(self, x: float, y: float, yaw: float, tractor: TractorParameters) -> FullState:
        """Return the state at rest with the rear axle at (x, y) [m]; the search for the yaw starts at `yaw` [rad]."""
        s, v, gamma = self.initial_position_sigma_m, 0.2, radians(1.0)
        sigmas = (
            *(s, s, UNALIGNED_SIGMA, v, gamma, radians(self.initial_gyro_bias_sigma_deg_s)),
            *(radians(self.initial_steer_bias_sigma_deg), 1.0, 1.0, self.initial_wheel_scale_sigma),
            *(radians(self.initial_compliance_sigma_deg_s2_m), self.initial_turn_offset_sigma_m),
            self.initial_slip_sigma_s2_m,
            radians(self.pitch_sigma_deg) * tractor.antenna_height_m,
        )
        mean = np.zeros(N)
        mean[[C, D, S]] = radians(self.rear_compliance_deg_s2_m), self.turn_offset_m, self.slip_s2_m
        mean[AHEAD] = 0.0 if self.terrain_compensation else radians(self.pitch_deg) * tractor.antenna_height_m
        mean[:3] = x, y, yaw + radians(self.initial_yaw_error_deg)
        patience = max(1, round(self.gate_patience_s / TICK_S))
        gates = Gates(self.gate_sigma**2, self.gate_position_m, self.gate_velocity_m_s, patience)
        antenna = tractor.antenna_height_m
        full = FullFilter(
            self._levels(tractor), self._fix_noises(antenna), gates, (0.0, 0.0, antenna), self.swing_filter_s
        )
        cg = tractor.cg_to_rear_axle, 0.0, tractor.cg_height_m
        slip = WheelSlip(memory=self.unseen_slip_walk_rt_s**2)
        return FullState(
            settings=held(Settings(full, cg, self.terrain_compensation, self.gyro_axes == "body")),
            horizon=Horizon(held(FullNumbers(Core(mean, np.diag(np.square(sigmas)), slip=slip), np.zeros((0, 8))))),
            nothing=held(Waiting(np.zeros((0, 8)), 1)),
            logged=np.full(11, nan),
        )

    def _levels(self, tractor: TractorParameters) -> FullLevels:
        return FullLevels(
            wheelbase=tractor.wheelbase_m,
            walks=(
                *(self.position_walk_m_rt_s, self.position_walk_m_rt_s, radians(self.yaw_walk_deg_rt_s)),
                *(self.speed_walk_m_s_rt_s, radians(self.yaw_rate_walk_deg_s_rt_s)),
                *(radians(self.gyro_bias_walk_deg_s_rt_s), radians(self.steer_bias_walk_deg_rt_s)),
                *(self.wheel_scale_walk_rt_s, radians(self.compliance_walk_deg_s2_m_rt_s)),
                self.slip_walk_s2_m_rt_s,
                radians(self.pitch_walk_deg_rt_s) * tractor.antenna_height_m,
            ),
            lean_slip_walk=self.lean_slip_walk_s2_m_rt_s,
            gyro_sigma=radians(self.gyro_sigma_deg_s),
            wheel_sigma=self.wheel_sigma_m_s,
            steer_sigma=radians(self.steer_sigma_deg_s),
            velocity_sigma=self.gnss_velocity_sigma_m_s,
            heading_sigma=radians(self.heading_sigma_deg),
            sideslip_walk=radians(self.sideslip_walk_deg_rt_s),
            sideslip_sigma=radians(self.initial_sideslip_sigma_deg),
            cg_arm=tractor.cg_to_rear_axle,
            load_transfer=tractor.cg_height_m / (tractor.wheelbase_m - tractor.cg_to_rear_axle),
            turn_offset_walk=self.turn_offset_walk_m_rt_m,
            roll=0.0 if self.terrain_compensation else radians(self.roll_deg_s2_m),
        )

    def _fix_noises(self, antenna: float) -> tuple[FixNoise, FixNoise, FixNoise, FixNoise]:
        """Return the rear-axle position error for each GNSS quality (constants of `Quality`); `antenna` is the antenna
        height [m]."""
        lean = radians(self.imu_wander_sigma_deg if self.terrain_compensation else self.lean_sigma_deg) * antenna
        fixed, floating = self.gnss_correlated_fraction, self.gnss_float_correlated_fraction
        s, s_float = self.gnss_sigma_m, self.gnss_float_sigma_m
        loose = _fix_noise(s_float, floating, lean, self.gnss_float_correlation_time_s)
        tight = _fix_noise(s, fixed, lean, self.gnss_correlation_time_s)
        return tuple(tight if quality == Quality.FIX else loose for quality in range(4))  # type: ignore[return-value]

    def update_held(self, state: FullState, measurement: Measurement, dt: float) -> tuple[FullState, Held[Estimate]]:
        """Return the new state, and a native reference (`Held`) to the estimate at the end of a tick of `dt` [s]."""
        m, horizon, ticks, fix = measurement, state.horizon, 1, measurement.fix or NO_FIX
        if measurement.fix is not None:
            horizon, ticks, fix = horizon.at(m.t, fix, dt)
        waiting = held(Waiting(horizon.waiting, ticks)) if len(horizon.waiting) or ticks != 1 else state.nothing
        found = estimate_tick(state.settings, waiting, horizon.held, Readings.of(m), fix, m.quality, dt)
        return FullState(state.settings, horizon.after(found[0], ticks), state.nothing, found[2]), found[1]

    @property
    def interpreted(self) -> bool:
        """Whether compiled ticks must call the methods of the estimator."""
        return not is_compiled(self, "update_held", "report", "columns")

    def compiled_tick(self, state: FullState) -> Linked | None:
        """Return the compiled tick function, its parameters and its state, or None while stored measurements await a
        fix."""
        if len(state.horizon.waiting):
            return None
        return Linked(self.compiled, state.settings, state.horizon.held, state.nothing)

    def state_after_ticks(self, state: FullState, found: Held[FullNumbers], shown: Vector) -> FullState:
        """Return the state after ticks in compiled code. At their end, the state is `found` and the log values are
        `shown`."""
        return state._replace(horizon=Horizon(found).after(found, 1)._replace(history=((),)), logged=shown)

    def report(self, state: FullState) -> tuple[float, ...]:
        """Return the values of the log columns after the last tick."""
        return tuple(state.logged.tolist())


def _fix_noise(sigma: float, fraction: float, lean: float, correlation_time: float) -> FixNoise:
    """Return the position error of a fix, split into a correlated and a white part.

    The standard deviation is `sigma` [m], and the correlated part is the `fraction` [-] of the variance. `lean` [m] is
    the error due to antenna tilt, which is added to the correlated part.
    """
    return FixNoise(sqrt(sigma * sigma * fraction + lean * lean), sigma * sqrt(1.0 - fraction), correlation_time)
