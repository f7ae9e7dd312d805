"""Estimator for guidance: one EKF over pose, motion and all slow errors, fed by GNSS, gyro, wheel speed and steering.

`full_model` holds the states and the measurements, `full_filter` a tick with gates and alignment, `horizon` the use of
late fixes. The start heading is not trusted: the yaw counts as found once the tractor has moved a metre or two, and
`Estimate.aligned` says so. `Estimate.yaw` is the course of R, which a path follower steers; less `sideslip` it is the
heading. The two differ by the slip of the rear tyres, modelled from the side force, whose part from gravity on a
side slope needs the IMU (`terrain_compensation`). Without it the heading takes up the crab, unless two antennas measure
it (`sensors.gnss.dual_antenna`): then the sideslip beyond the model is estimated too. Not in the paper.
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
    Column("sideslip_hat", "rad", "estimated course of R less heading"),
    Column("gyro_bias_hat", "rad/s", "estimated bias of the gyro"),
    Column("mounting_hat", "rad", "estimated mounting error of two antennas"),
    Column("wheel_scale_hat", "-", "estimated relative error of the wheel speed"),
    Column("rejected_positions", "-", "positions of fixes refused by the gate since the start"),
    Column("rejected_velocities", "-", "velocities of fixes refused by the gate since the start"),
    Column("estimator_restarts", "-", "restarts of the position or the alignment since the start"),
)


class FullState(NamedTuple):
    """The estimator between two ticks."""

    filter: FullFilter
    """Filter that `init` prepares; keeps nothing between ticks."""
    cg: tuple[float, float, float]
    """CG from R in vehicle axes: l_r, 0, height [m]."""
    horizon: Horizon
    """Beliefs, and the readings newer than they."""
    health: Health
    """Diagnostics without the truth."""
    tilt: SmoothedTilt | None = None
    """Roll and pitch of the last tick, None before the first."""
    estimate: Estimate | None = None
    """Estimate of the last tick, None before the first."""


class EkfFull(StateEstimator):
    """Fourteen states, gates, alignment and late fixes; `[estimator] kind = "ekf_full"`."""

    kind: Literal["ekf_full"] = "ekf_full"
    terrain_compensation: bool = False
    """Whether measured roll and pitch move the fix from the antenna to R (needs the IMU)."""
    swing_filter_s: NonNegative = 0.1
    """Low pass on the antenna's swing, for the compensation, 0 for none [s]. Assumed value (0-0.2): noise against
    lag."""
    gyro_axes: Literal["vertical", "body"] = "vertical"
    """Axis that the gyro is believed to have; one of the `body` is levelled by roll and pitch, with compensation."""
    imu_wander_sigma_deg: NonNegative = 0.14
    """Believed slow error of roll and pitch, for the compensation [deg]. Assumed value, the sensor's."""
    lean_sigma_deg: NonNegative = 0.1
    """Believed lean of the tractor on level ground, without compensation [deg]. Assumed value: 0.1-0.3, roll in
    bends."""
    roll_deg_s2_m: NonNegative = 0.25
    """Roll per specific side force in a bend, without compensation [deg s2/m]. Assumed value: 0.2-0.3 on firm ground
    and tilled soil, 0.5 in ruts."""
    pitch_deg: float = -0.3
    """Mean pitch on level ground, nose down positive, without compensation [deg]. Assumed value: rear wheels and
    implements let the tail sink by 0.03 deg (firm ground), 0.3 deg (carried implement) or 0.6 deg (ruts)."""
    pitch_sigma_deg: NonNegative = 0.3
    """Believed error of that pitch, or of the measured one, as long as it is constant [deg]. Assumed value, as
    above."""
    pitch_walk_deg_rt_s: NonNegative = 0.015
    """Random walk of that pitch [deg/sqrt(s)]. Assumed value: 0.1 in the ruts of a bend."""
    gnss_sigma_m: Positive = 0.02
    """Believed error of a fixed solution, per axis [m]. Paper, section V-A."""
    gnss_correlated_fraction: Fraction = 0.3
    """Believed share of the correlated part in the variance of a fixed solution [-]. Assumed value, the receiver's."""
    gnss_correlation_time_s: Positive = 30.0
    """Believed correlation time of that part [s]. Assumed value, the receiver's."""
    gnss_float_sigma_m: Positive = 0.3
    """Believed error of a float solution, per axis [m]. Assumed value: the receiver's."""
    gnss_float_correlated_fraction: Fraction = 0.9
    """Believed share of the correlated part in the variance of a float solution [-]. Assumed value, the receiver's."""
    gnss_float_correlation_time_s: Positive = 60.0
    """Believed correlation time of that part [s]. Assumed value: half the receiver's, for the jumps between
    ambiguities."""
    gnss_velocity_sigma_m_s: Positive = 0.03
    """Believed error of the GNSS velocity, per axis [m/s]. Assumed value: the receiver's."""
    heading_sigma_deg: Positive = 0.25
    """Believed error of the heading from two antennas [deg]. Assumed value, the sensor's (4 mm over a metre)."""
    gyro_sigma_deg_s: Positive = 0.1
    """Believed noise of the gyro [deg/s]. Assumed value, the sensor's."""
    wheel_sigma_m_s: Positive = 0.02
    """Believed noise of the wheel speed [m/s]. Assumed value, the sensor's."""
    steer_sigma_deg_s: Positive = 1.0
    """Believed error of the yaw rate that follows from the steering angle [deg/s]. Assumed value (0.5-3): lag of
    tyres."""
    rear_compliance_deg_s2_m: NonNegative = 0.7
    """Sideslip of R per specific side force [deg s2/m]. Assumed value: `magic_formula` 0.6-0.8, `soil` 0.5."""
    position_walk_m_rt_s: Positive = 0.003
    """Random walk of the position [m/sqrt(s)]. Assumed value (0.002-0.01): sway."""
    yaw_walk_deg_rt_s: Positive = 0.012
    """Random walk of the heading beside the gyro's noise [deg/sqrt(s)]. Assumed value (0.005-0.05): levelling,
    scale."""
    speed_walk_m_s_rt_s: Positive = 0.1
    """Random walk of the speed [m/s/sqrt(s)]. Assumed value (0.05-0.3): pedal."""
    yaw_rate_walk_deg_s_rt_s: Positive = 3.0
    """Random walk of the yaw rate [deg/s/sqrt(s)]. Assumed value (1-10): steering at its rate."""
    gyro_bias_walk_deg_s_rt_s: Positive = 0.002
    """Random walk of the gyro's bias [deg/s/sqrt(s)]. Assumed value, the sensor's."""
    sideslip_walk_deg_rt_s: Positive = 0.1
    """Random walk of the sideslip beyond the modelled one, with two antennas [deg/sqrt(s)]. Assumed value, as the bias
    of the steering."""
    steer_bias_walk_deg_rt_s: Positive = 0.1
    """Random walk of the steering bias [deg/sqrt(s)]. Assumed value (0.05-0.4): a degree in half a turn on a slope."""
    wheel_scale_walk_rt_s: Positive = 0.001
    """Random walk of the wheel speed's relative error [1/sqrt(s)]. Assumed value (0.0005-0.003): slip by ground."""
    compliance_walk_deg_s2_m_rt_s: Positive = 0.005
    """Random walk of the compliance [deg s2/m/sqrt(s)]. Assumed value: doubles on a slope where tyres begin to
    slide."""
    turn_offset_walk_m_rt_m: Positive = 0.004
    """Random walk of the offset of the turn along the way [m/sqrt(m)]. Assumed value: 0.05 from one bend to the next in
    ruts and on tilled soil."""
    turn_offset_m: float = -0.015
    """Distance by which R lies ahead of the point that moves straight ahead in a slow bend [m]. Assumed value: -0.02 to
    -0.01 on firm ground, 0.1 under a pull, 0.35 in deep ruts."""
    lean_slip_walk_s2_m_rt_s: NonNegative = 0.0005
    """Random walk of the wheel speed's relative error per specific force of gravity along the ground [s2/m/sqrt(s)].
    Assumed value: slip that climb alone does not explain."""
    unseen_slip_walk_rt_s: NonNegative = 0.008
    """Random walk of the wheel speed's relative error beside that while there are no fixes, until fixes have shown how
    calm it is [1/sqrt(s)]. Assumed value: an implement of 600-1500 N goes into tilled soil, or leaves it, every 45 s.
    Default: 0 without an implement in the soil or a drawbar pull."""
    slip_s2_m: NonNegative = 0.0175
    """Slip of the driven wheels per specific pull of gravity on a climb [s2/m]. Assumed value: firm ground; more on
    soil."""
    slip_walk_s2_m_rt_s: Positive = 0.0005
    """Random walk of that slip [s2/m/sqrt(s)]. Assumed value: changes with soil and load."""
    initial_compliance_sigma_deg_s2_m: Positive = 0.09
    """Standard deviation of the compliance at the start [deg s2/m]. Assumed value: firm ground, level to steep."""
    initial_turn_offset_sigma_m: Positive = 0.12
    """Standard deviation of the offset of the turn at the start [m]. Assumed value: 0.05 for firm ground alone, 0.2 for
    deep ruts; broader costs a loss in the first bend twice as much."""
    initial_slip_sigma_s2_m: Positive = 0.005
    """Standard deviation of the slip on a climb at the start [s2/m]. Assumed value: firm ground to tilled soil."""
    initial_position_sigma_m: Positive = 0.05
    """Standard deviation of the position given to `init` [m]. Assumed value: a fix or two."""
    initial_gyro_bias_sigma_deg_s: Positive = 0.5
    """Standard deviation of the gyro's bias at the start [deg/s]. Assumed value (0.1-1): a cold MEMS unit."""
    initial_sideslip_sigma_deg: Positive = 2.0
    """Standard deviation of the sideslip beyond the model at the first heading [deg]. Assumed value: crab on 10-15
    deg."""
    initial_steer_bias_sigma_deg: Positive = 1.0
    """Standard deviation of the steering bias at the start [deg]. Assumed value: the potentiometer's resolution."""
    initial_wheel_scale_sigma: Positive = 0.05
    """Standard deviation of the wheel speed's relative error at the start [-]. Assumed value: wear, pressure, slip."""
    initial_yaw_error_deg: float = 0.0
    """Error put on the heading given to `init`, to see it found [deg]."""
    gate_sigma: Positive = 5.0
    """Innovation above which a fix is improbable, in standard deviations [-]. Assumed value (4-6)."""
    gate_position_m: NonNegative = 0.25
    """Innovation of the position that is never refused [m]. Assumed value: sway of the antenna by 7 deg."""
    gate_velocity_m_s: NonNegative = 0.5
    """Innovation of the velocity that is never refused [m/s]. Assumed value: sway of the antenna at 15 deg/s."""
    gate_patience_s: Positive = 2.0
    """Time of refusals in a row after which the filter restarts from the fixes [s]. Assumed value (1-5)."""

    @property
    def needs(self) -> dict[str, str]:
        """Gyro and wheel speed, and the inertial unit for the compensation."""
        own = {"gyro": 'kind: "ekf_full"', "wheel_speed": 'kind: "ekf_full"'}
        return own | ({"imu": "terrain_compensation:"} if self.terrain_compensation else {})

    @property
    def columns(self) -> tuple[Column, ...]:
        """Health, gates and slow errors."""
        return HEALTH_COLUMNS + COLUMNS

    def init(self, x: float, y: float, yaw: float, tractor: TractorParameters) -> FullState:
        """Standing at R = (x, y) [m]; the heading `yaw` [rad] is only where the search for it begins."""
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
        """Noise in SI units."""
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
        """Error at R of a fix by its quality, for an `antenna` of that height [m] with a slow error of its lean."""
        lean = radians(self.imu_wander_sigma_deg if self.terrain_compensation else self.lean_sigma_deg) * antenna
        fixed, floating = self.gnss_correlated_fraction, self.gnss_float_correlated_fraction
        s, s_float = self.gnss_sigma_m, self.gnss_float_sigma_m
        loose = _fix_noise(s_float, floating, lean, self.gnss_float_correlation_time_s)
        tight = _fix_noise(s, fixed, lean, self.gnss_correlation_time_s)
        return {Quality.FIX: tight, Quality.FLOAT: loose, Quality.DGPS: loose}

    def update(self, state: FullState, measurement: Measurement, dt: float) -> tuple[FullState, Estimate]:
        """Beliefs at the end of a tick of length `dt` [s], from what was measured in it."""
        m, last = measurement, state.tilt or SmoothedTilt(0.0, 0.0)
        roll, pitch = (m.roll, m.pitch) if self.terrain_compensation else (0.0, 0.0)
        if not isfinite(roll + pitch):  # missing: the tractor leans as before
            roll, pitch = last.roll, last.pitch
        leans = state.tilt.after(roll, pitch, dt) if state.tilt else SmoothedTilt(roll, pitch)
        gyro = leans.heading_rate(m.gyro, self.gyro_axes == "body")
        inputs = Inputs(m.t, gyro, m.wheel_speed, m.steer, leans.roll, leans.pitch, (roll, pitch))
        horizon = state.horizon.after(state.filter, inputs, m.fix, m.quality, dt)
        health = state.health.after(horizon.core.nis, horizon.core.accepted_t, dt)
        now = present(horizon, state.filter.levels, inputs.side, dt)
        estimate = self._estimate(state.cg, inputs, horizon.core, health, now)
        return FullState(state.filter, state.cg, horizon, health, leans, estimate), estimate

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
        """Values of `columns` after a tick."""
        core, e = state.horizon.core, state.estimate
        if e is None:
            return (nan,) * len(self.columns)
        return (
            *(e.fix_age, e.position_sigma, e.nis_mean, float(e.aligned), e.sideslip),
            *(float(core.mean[B_G]), float(core.mean[MOUNT]) if len(core.mean) > N else nan, float(core.mean[K])),
            *(float(core.rejected_positions), float(core.rejected_velocities), float(core.restarts)),
        )


def _fix_noise(sigma: float, share: float, lean: float, correlation_time: float) -> FixNoise:
    """Split of the error of a fix, `sigma` [m], at a `share` of its variance; `lean` [m] is slow, too."""
    return FixNoise(sqrt(sigma * sigma * share + lean * lean), sigma * sqrt(1.0 - share), correlation_time)
