"""Estimator for guidance: one EKF of pose, motion and slow errors, using GNSS, gyro, wheel speed and steering angle.

`full_model` defines states and measurements, `full_filter` a tick with gates and alignment, `horizon` the use of
delayed fixes. The initial heading is ignored: the yaw is found after one or two metres of motion, as reported by
`Estimate.aligned`. `Estimate.yaw` is the course of R, the quantity that a path-following law controls; minus `sideslip`
it is the heading. Course and heading differ by the slip of the rear tyres, modelled from the side force; its gravity
component on a side slope requires the IMU (`terrain_compensation`). Without the IMU the heading estimate includes the
crab angle, unless two antennas measure the heading (`sensors.gnss.dual_antenna`); the filter then also estimates the
excess sideslip. Not in the paper.
"""

from math import isfinite, nan, radians, sqrt
from typing import Literal, NamedTuple

import numpy as np

from agrobot_mj.core.geometry import wrap
from agrobot_mj.core.levelling import SmoothedTilt
from agrobot_mj.core.signals import TICK_S, Column, Estimate, Measurement, Quality
from agrobot_mj.core.spec import Fraction, NonNegative, Positive
from agrobot_mj.estimation.base import HEALTH_COLUMNS, Health, StateEstimator, largest_sigma
from agrobot_mj.estimation.full_core import Core, Gates, Inputs
from agrobot_mj.estimation.full_filter import UNALIGNED_SIGMA, FullFilter
from agrobot_mj.estimation.full_model import AHEAD, B_G, B_S, MOUNT, C, D, FixNoise, FullLevels, K, N, S
from agrobot_mj.estimation.horizon import Horizon, Present, present
from agrobot_mj.estimation.lever_arm import offset
from agrobot_mj.estimation.wheel_slip import WheelSlip
from agrobot_mj.machine.tractor import TractorParameters

COLUMNS = (
    Column("aligned", "-", "whether the yaw has been found, 0 or 1"),
    Column("sideslip_hat", "rad", "estimated course of R minus heading"),
    Column("gyro_bias_hat", "rad/s", "estimated bias of the gyro"),
    Column("mounting_hat", "rad", "estimated mounting error of two antennas"),
    Column("wheel_scale_hat", "-", "estimated relative error of the wheel speed"),
    Column("rejected_positions", "-", "number of fix positions rejected by the gate since the start"),
    Column("rejected_velocities", "-", "number of fix velocities rejected by the gate since the start"),
    Column("estimator_restarts", "-", "number of restarts of the position or the alignment since the start"),
)


class FullState(NamedTuple):
    """State of the estimator between two ticks."""

    filter: FullFilter
    """Filter created by `init`; has no internal state."""
    cg: tuple[float, float, float]
    """Position of the CG relative to the rear-axle point R in vehicle axes: l_r, 0, height [m]."""
    horizon: Horizon
    """Filter state, and the newer measurements."""
    health: Health
    """Diagnostics that need no true state."""
    tilt: SmoothedTilt | None = None
    """Smoothed roll and pitch of the last tick; None before the first tick."""
    estimate: Estimate | None = None
    """Estimate of the last tick; None before the first tick."""


class EkfFull(StateEstimator):
    """Estimator with fourteen states, gates, alignment and delayed fixes; `[estimator] kind = "ekf_full"`."""

    kind: Literal["ekf_full"] = "ekf_full"
    terrain_compensation: bool = False
    """Whether measured roll and pitch transform the fix from the antenna to the rear axle (needs the IMU)."""
    swing_filter_s: NonNegative = 0.1
    """Low-pass time constant of the antenna's tilting velocity, 0: none [s]. Assumed value (0-0.2): noise or lag."""
    gyro_axes: Literal["vertical", "body"] = "vertical"
    """Modelled axis of the gyro; the rate about a `body` axis is levelled by roll and pitch, with compensation."""
    imu_wander_sigma_deg: NonNegative = 0.14
    """Modelled slow error of roll and pitch, for the compensation [deg]. Assumed value, the sensor's."""
    lean_sigma_deg: NonNegative = 0.1
    """Modelled tilt on level ground, without compensation [deg]. Assumed value: 0.1-0.3, roll in bends."""
    roll_deg_s2_m: NonNegative = 0.25
    """Roll divided by the specific side force in a bend, without compensation [deg s2/m]. Assumed value: 0.2-0.3 on
    firm ground and tilled soil, 0.5 in ruts."""
    pitch_deg: float = -0.3
    """Mean pitch on level ground, positive nose down, without compensation [deg]. Assumed value: rear wheels and
    implements lower the rear by 0.03 deg (firm ground), 0.3 deg (carried implement) or 0.6 deg (ruts)."""
    pitch_sigma_deg: NonNegative = 0.3
    """Modelled constant error of `pitch_deg`, or of the measured pitch [deg]. Assumed value, as for `pitch_deg`."""
    pitch_walk_deg_rt_s: NonNegative = 0.015
    """Random walk of the pitch error [deg/sqrt(s)]. Assumed value: 0.1 in the ruts of a bend."""
    gnss_sigma_m: Positive = 0.02
    """Modelled error of a fixed solution, per axis [m]. Paper, section V-A."""
    gnss_correlated_fraction: Fraction = 0.3
    """Modelled correlated fraction of the variance of a fixed solution [-]. Assumed value, the receiver's."""
    gnss_correlation_time_s: Positive = 30.0
    """Modelled correlation time of the error of a fixed solution [s]. Assumed value, the receiver's."""
    gnss_float_sigma_m: Positive = 0.3
    """Modelled error of a float solution, per axis [m]. Assumed value: the receiver's."""
    gnss_float_correlated_fraction: Fraction = 0.9
    """Modelled correlated fraction of the variance of a float solution [-]. Assumed value, the receiver's."""
    gnss_float_correlation_time_s: Positive = 60.0
    """Modelled correlation time of the error of a float solution [s]. Assumed value: half the receiver's, for the jumps
    between ambiguities."""
    gnss_velocity_sigma_m_s: Positive = 0.03
    """Standard deviation assumed for the GNSS velocity, per axis [m/s]. Assumed value: that of the simulated
    receiver."""
    heading_sigma_deg: Positive = 0.25
    """Modelled error of the heading from two antennas [deg]. Assumed value, the sensor's (4 mm at 1 m)."""
    gyro_sigma_deg_s: Positive = 0.1
    """Modelled noise of the gyro [deg/s]. Assumed value, the sensor's."""
    wheel_sigma_m_s: Positive = 0.02
    """Modelled noise of the wheel speed [m/s]. Assumed value, the sensor's."""
    steer_sigma_deg_s: Positive = 1.0
    """Modelled error of the yaw rate from the steering angle [deg/s]. Assumed value (0.5-3): lag of tyres."""
    rear_compliance_deg_s2_m: NonNegative = 0.7
    """Rear sideslip per specific side force [deg s2/m]. Assumed value: `magic_formula` 0.6-0.8, `soil` 0.5."""
    position_walk_m_rt_s: Positive = 0.003
    """Random walk of the position [m/sqrt(s)]. Assumed value (0.002-0.01): antenna oscillation."""
    yaw_walk_deg_rt_s: Positive = 0.012
    """Random walk of the heading, added to gyro noise [deg/sqrt(s)]. Assumed value (0.005-0.05): tilt, scale errors."""
    speed_walk_m_s_rt_s: Positive = 0.1
    """Random walk of the speed [m/s/sqrt(s)]. Assumed value (0.05-0.3): changes of the pedal."""
    yaw_rate_walk_deg_s_rt_s: Positive = 3.0
    """Random walk of the yaw rate [deg/s/sqrt(s)]. Assumed value (1-10): maximum steering rate."""
    gyro_bias_walk_deg_s_rt_s: Positive = 0.002
    """Random walk of the gyro's bias [deg/s/sqrt(s)]. Assumed value, the sensor's."""
    sideslip_walk_deg_rt_s: Positive = 0.1
    """Random walk of the excess sideslip, with two antennas [deg/sqrt(s)]. Assumed value, as for the steering bias."""
    steer_bias_walk_deg_rt_s: Positive = 0.1
    """Random walk of the steering bias [deg/sqrt(s)]. Assumed value (0.05-0.4): 1 deg in half a turn on a slope."""
    wheel_scale_walk_rt_s: Positive = 0.001
    """Random walk of the relative wheel-speed error [1/sqrt(s)]. Assumed value (0.0005-0.003): slip varies."""
    compliance_walk_deg_s2_m_rt_s: Positive = 0.005
    """Random walk of the compliance [deg s2/m/sqrt(s)]. Assumed value: doubles on a slope at the onset of sliding."""
    turn_offset_walk_m_rt_m: Positive = 0.004
    """Random walk of the turn offset with distance [m/sqrt(m)]. Assumed value: 0.05 from one bend to the next in ruts
    and on tilled soil."""
    turn_offset_m: float = -0.015
    """Turn offset: distance of R ahead of the point without sideslip in a slow bend [m]. Assumed value: -0.02 to -0.01
    on firm ground, 0.1 under a pull, 0.35 in deep ruts."""
    lean_slip_walk_s2_m_rt_s: NonNegative = 0.0005
    """Random walk of the relative wheel-speed error, divided by the gravity component along the ground [s2/m/sqrt(s)].
    Assumed value: slip that the climb does not explain."""
    unseen_slip_walk_rt_s: NonNegative = 0.008
    """Further random walk of the relative wheel-speed error during a loss of fixes, until fixes have shown the
    variation [1/sqrt(s)]. Assumed value: an implement of 600-1500 N enters or leaves tilled soil every 45 s. Default: 0
    without an implement in the soil or a drawbar pull."""
    slip_s2_m: NonNegative = 0.0175
    """Slip of the driven wheels per gravity component of a climb [s2/m]. Assumed value, for firm ground; more on
    soil."""
    slip_walk_s2_m_rt_s: Positive = 0.0005
    """Random walk of the slip on a climb [s2/m/sqrt(s)]. Assumed value: changes with soil and load."""
    initial_compliance_sigma_deg_s2_m: Positive = 0.09
    """Initial standard deviation of the compliance [deg s2/m]. Assumed value: firm ground, level to steep."""
    initial_turn_offset_sigma_m: Positive = 0.12
    """Initial standard deviation of the turn offset [m]. Assumed value: between 0.05 (firm ground only) and 0.2 (deep
    ruts); a larger value doubles the effect of a loss of fixes in the first bend."""
    initial_slip_sigma_s2_m: Positive = 0.005
    """Initial standard deviation of the slip on a climb [s2/m]. Assumed value: firm ground to tilled soil."""
    initial_position_sigma_m: Positive = 0.05
    """Standard deviation of the initial position [m]. Assumed value: one or two fixes."""
    initial_gyro_bias_sigma_deg_s: Positive = 0.5
    """Initial standard deviation of the gyro bias [deg/s]. Assumed value (0.1-1): a cold MEMS unit."""
    initial_sideslip_sigma_deg: Positive = 2.0
    """Standard deviation of the excess sideslip at the first heading [deg]. Assumed value: crab angle on slopes."""
    initial_steer_bias_sigma_deg: Positive = 1.0
    """Initial standard deviation of the steering bias [deg]. Assumed value: the potentiometer's resolution."""
    initial_wheel_scale_sigma: Positive = 0.05
    """Initial standard deviation of the relative wheel-speed error [-]. Assumed value: wear, tyre pressure and slip."""
    initial_yaw_error_deg: float = 0.0
    """Error added to the initial heading, to demonstrate the alignment [deg]."""
    gate_sigma: Positive = 5.0
    """Innovation in standard deviations above which a fix is rejected as improbable [-]. Assumed value (4-6)."""
    gate_position_m: NonNegative = 0.25
    """Position innovation up to which a fix is always accepted [m]. Assumed value: antenna oscillation by 7 deg."""
    gate_velocity_m_s: NonNegative = 0.5
    """Velocity innovation up to which a fix is always accepted [m/s]. Assumed value: oscillation at 15 deg/s."""
    gate_patience_s: Positive = 2.0
    """Duration of uninterrupted rejections after which the filter restarts from the fixes [s]. Assumed value (1-5)."""

    @property
    def needs(self) -> dict[str, str]:
        """Gyro and wheel speed; the IMU for the terrain compensation."""
        own = {"gyro": 'kind: "ekf_full"', "wheel_speed": 'kind: "ekf_full"'}
        return own | ({"imu": "terrain_compensation:"} if self.terrain_compensation else {})

    @property
    def columns(self) -> tuple[Column, ...]:
        """Columns of health, gates and slow errors."""
        return HEALTH_COLUMNS + COLUMNS

    def init(self, x: float, y: float, yaw: float, tractor: TractorParameters) -> FullState:
        """Return the state at standstill with R = (x, y) [m]; the search for the heading starts at `yaw` [rad]."""
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
        return FullState(
            filter=FullFilter(
                self._levels(tractor),
                self._fix_noises(tractor.antenna_height_m),
                gates,
                tractor.antenna_height_m,
                self.swing_filter_s,
            ),
            cg=(tractor.cg_to_rear_axle, 0.0, tractor.cg_height_m),
            horizon=Horizon(
                Core(mean, np.diag(np.square(sigmas)), slip=WheelSlip(memory=self.unseen_slip_walk_rt_s**2))
            ),
            health=Health(),
        )

    def _levels(self, tractor: TractorParameters) -> FullLevels:
        """Return the noise levels in SI units."""
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
            turn_offset_walk=self.turn_offset_walk_m_rt_m,
            roll=0.0 if self.terrain_compensation else radians(self.roll_deg_s2_m),
        )

    def _fix_noises(self, antenna: float) -> dict[int, FixNoise]:
        """Return the rear-axle position error by fix quality, for the antenna height [m] and the slow tilt error."""
        lean = radians(self.imu_wander_sigma_deg if self.terrain_compensation else self.lean_sigma_deg) * antenna
        fixed, floating = self.gnss_correlated_fraction, self.gnss_float_correlated_fraction
        s, s_float = self.gnss_sigma_m, self.gnss_float_sigma_m
        loose = _fix_noise(s_float, floating, lean, self.gnss_float_correlation_time_s)
        tight = _fix_noise(s, fixed, lean, self.gnss_correlation_time_s)
        return {Quality.FIX: tight, Quality.FLOAT: loose, Quality.DGPS: loose}

    def update(self, state: FullState, measurement: Measurement, dt: float) -> tuple[FullState, Estimate]:
        """Return the state and the estimate at the end of a tick of length `dt` [s] with this measurement."""
        m, last = measurement, state.tilt or SmoothedTilt(0.0, 0.0)
        roll, pitch = (m.roll, m.pitch) if self.terrain_compensation else (0.0, 0.0)
        if not isfinite(roll + pitch):  # missing: keep the last tilt
            roll, pitch = last.roll, last.pitch
        tilt = state.tilt.after(roll, pitch, dt) if state.tilt else SmoothedTilt(roll, pitch)
        gyro = tilt.heading_rate(m.gyro, self.gyro_axes == "body")
        inputs = Inputs(m.t, gyro, m.wheel_speed, m.steer, tilt.roll, tilt.pitch, (roll, pitch))
        horizon = state.horizon.after(state.filter, inputs, m.fix, m.quality, dt)
        health = state.health.after(horizon.core.nis, horizon.core.accepted_t, dt)
        now = present(horizon, state.filter.levels, inputs.side, dt)
        estimate = self._estimate(state.cg, inputs, horizon.core, health, now)
        return FullState(state.filter, state.cg, horizon, health, tilt, estimate), estimate

    def _estimate(
        self, cg: tuple[float, float, float], inputs: Inputs, core: Core, health: Health, now: Present
    ) -> Estimate:
        east, north = offset(cg, *inputs.lean, now.heading)
        return Estimate(
            x=now.x + east,
            y=now.y + north,
            yaw=wrap(now.heading + now.sideslip),
            speed=now.speed,
            yaw_rate=now.yaw_rate,
            rear_x=now.x,
            rear_y=now.y,
            covariance=now.covariance,
            nis=core.nis,
            steer_bias=float(core.mean[B_S]),
            sideslip=now.sideslip,
            aligned=core.search is None,
            fix_age=inputs.t - health.fix_t,
            position_sigma=largest_sigma(now.covariance),
            nis_mean=health.nis,
        )

    def report(self, state: FullState) -> tuple[float, ...]:
        """Return the values of `columns` after a tick."""
        core, e = state.horizon.core, state.estimate
        if e is None:
            return (nan,) * len(self.columns)
        return (
            *(e.fix_age, e.position_sigma, e.nis_mean, float(e.aligned), e.sideslip),
            *(float(core.mean[B_G]), float(core.mean[MOUNT]) if len(core.mean) > N else nan, float(core.mean[K])),
            *(float(core.rejected_positions), float(core.rejected_velocities), float(core.restarts)),
        )


def _fix_noise(sigma: float, fraction: float, lean: float, correlation_time: float) -> FixNoise:
    """Split the fix error `sigma` [m] into a correlated part, a `fraction` of its variance, and a white part.

    `lean` [m] is the additional error by antenna tilt, which belongs to the correlated part.
    """
    return FixNoise(sqrt(sigma * sigma * fraction + lean * lean), sigma * sqrt(1.0 - fraction), correlation_time)
