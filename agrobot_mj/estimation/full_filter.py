"""Filter of the estimator `ekf_full` at the time of a fix: one EKF tick with gates and alignment.

`Core` has the complete state of the filter. A tick predicts, then corrects by all rows at once: gyro, wheel speed,
steering, standstill, and position and velocity of a fix that pass their gates.

Gates: A pair of innovations is rejected if it is both improbable (`gate_sigma`) and larger than a floor, the usual
oscillation of the antenna. Rejections during `gate_patience_s` without interruption indicate a wrong filter state: the
position restarts from the fix, and rejected velocities restart the search for the yaw. Afterwards a fix counts as
accepted only if none was rejected for that time. If the wheel speed differs from the fix speed by more than the floor,
the wheels spin or slide and are ignored, unless the fix speed jumped: tyres cannot stop a tractor within a tick.

Alignment: Until the yaw is found, the position is that of the fixes. The yaw correction that fits the fix velocities V
to the wheel speeds w is the argument of sum(w (V_east + i V_north) exp(-i chi)), for any initial yaw, forward and in
reverse. Its standard deviation is that of a velocity divided by sqrt(sum(w^2)). A heading from two antennas ends the
search at once, even at standstill; afterwards sideslip and heading are separately observable.
"""

from cmath import exp as turn
from cmath import phase
from functools import lru_cache
from math import copysign, cos, exp, hypot, isfinite, radians, sin, tan

import numpy as np

from agrobot_mj.core.signals import Array, Fix
from agrobot_mj.estimation.equations import posterior, prior
from agrobot_mj.estimation.full_core import (
    Core,
    Gates,
    Inputs,
    Search,
    accepted,
    at_fix,
    forget_correlated,
    restarted,
    turned,
)
from agrobot_mj.estimation.full_model import (
    B_S,
    MOUNT,
    OMEGA,
    PSI,
    SCALE_LIMIT,
    SLOW,
    D,
    FixNoise,
    FullLevels,
    K,
    MeasurementRow,
    N,
    V,
    X,
    Y,
    course,
    gyro_row,
    heading_row,
    modelled_crab,
    position_rows,
    process_noise,
    propagate_mean,
    squared_innovation,
    standing_rows,
    steer_row,
    transition,
    velocity_rows,
    wheel_row,
    wheel_scale,
    with_sideslip,
)
from agrobot_mj.estimation.kalman import Filter
from agrobot_mj.estimation.lever_arm import Lever, at_foot, offset
from agrobot_mj.estimation.mounting import implausible, with_crab, with_mounting
from agrobot_mj.estimation.sideslip_noise import SidewaysNoise
from agrobot_mj.estimation.wheel_slip import WheelSlip
from agrobot_mj.machine.tractor import GRAVITY

ALIGNMENT_SIGMA = radians(0.3)
"""Standard deviation at which the search for the yaw ends [rad]. Assumed value: 1.4 m of travel at 1.2 m/s."""
ALIGNED_SIGMA = radians(1.0)
"""Standard deviation of the yaw after the search [rad]. Assumed value: search error plus two seconds of gyro bias."""
UNALIGNED_SIGMA = radians(104.0)
"""Standard deviation of an unknown yaw: uniform over the circle [rad]."""
SEARCH_SPEED = 0.1
"""Minimum wheel speed for finding the yaw from velocities [m/s]. Assumed value: three times their noise."""
SLIPPING_SPEED = 0.3
"""Minimum speed for observing wheel slip by a fix [m/s]. Assumed value: ten times the noise of its velocity."""
CRUISE_S = 1.0
"""Time constant of the low-pass filtered speed [s]. Assumed value: 20 measurements; a start takes two seconds."""
BEND_S = 0.6
"""Time constant of the low-pass filtered curvature [s]. Assumed value: noise of 1 deg; response time of the tyres."""
STANDING_SPEED, STANDING_TICKS = 0.05, 10
"""Standstill: maximum wheel speed [m/s] and minimum number of ticks. Assumed value: measurement noise, 0.5 s."""
SWAY, SWAY_S = 0.15, 5.0
"""Relative error of modelled sideslip changes [-], and twice its correlation time [s]. Assumed value, for ruts and
slopes."""
STEADY_S = 20.0
"""Time constant for changes of the modelled sideslip [s]. Assumed value: half a turn. Longer-lasting sideslip, as along
a contour line, is covered by the compliance and its uncertainty."""
LONGEST_GAP_S = 1.0
"""Maximum time represented by one fix [s]. Assumed value: a receiver with 1 Hz."""
JUMP_M_S2 = 15.0
"""Maximum plausible rate of change of the fix speed [m/s2]. Assumed value: twice the limit of the tyres."""


class FullFilter(Filter):
    """EKF for one set of noise levels; `step` is a pure function of its arguments."""

    def __init__(
        self, levels: FullLevels, noises: dict[int, FixNoise], gates: Gates, antenna: float, swing_filter: float
    ) -> None:
        """Create the filter; `noises` by fix quality, height of the `antenna` [m]."""
        self.levels, self.noises, self.gates = levels, noises, gates
        self.antenna, self.swing_filter = (0.0, 0.0, antenna), swing_filter

    def step(self, core: Core, inputs: Inputs, fix: Fix | None, quality: int, dt: float) -> Core:
        """Return the core after a tick of length `dt` [s] with these inputs and the fix at its end."""
        if fix is not None and quality != core.quality:
            core = forget_correlated(core._replace(quality=quality))
        if fix is not None and isfinite(fix.heading) and len(core.mean) == N:
            mean, covariance = with_sideslip(core.mean, core.covariance, self.levels.sideslip_sigma)
            core = core._replace(mean=mean, covariance=covariance)
        noise, crab = self.noises[core.quality], self._crab(core, inputs)
        sway = core.sway.density + SWAY_S * (SWAY * (crab - core.steady)) ** 2
        mean, covariance = self._predict(core, inputs, noise, sway, dt)
        still = isfinite(inputs.wheel) and abs(inputs.wheel) < STANDING_SPEED
        core = core._replace(
            mean=mean,
            covariance=covariance,
            lever=self._lever(core, inputs, mean, dt),
            standing=core.standing + 1 if still else 0,
            cruise=core.cruise + (float(mean[V]) - core.cruise) * (1.0 - exp(-dt / CRUISE_S)),
            steady=core.steady + (crab - core.steady) * (1.0 - exp(-dt / STEADY_S)),
            bend=core.bend + (self._curvature(mean, inputs) - core.bend) * (1.0 - exp(-dt / BEND_S)),
            nis=float("nan"),
        )
        if fix is not None:
            fix = fix if core.lever is None else at_foot(fix, core.lever)
            gap = min(inputs.t - core.seen_t, LONGEST_GAP_S) if core.seen_t >= 0.0 else dt
            core, inputs = self._check_wheels(with_crab(core, fix, core.side_load(inputs.side), gap), inputs, fix)
        seen_t = core.seen_t if fix is None else inputs.t
        core = core._replace(slip=self._slip(core, inputs, fix, dt), seen_t=seen_t)
        rows = self._motion_rows(core, inputs)
        if fix is not None:
            core, more = self._gate_fix(core, inputs, fix, noise, gap, sway)
            rows += more
        core = self._correct(core, rows)
        return with_mounting(core)

    def _curvature(self, mean: Array, inputs: Inputs) -> float:
        """Return the path curvature, from the steering angle or else from the yaw rate [1/m]."""
        if isfinite(inputs.steer):
            return tan(inputs.steer - float(mean[B_S])) / self.levels.wheelbase
        v = float(mean[V])
        return float(mean[OMEGA]) * v / (v * v + SLOW * SLOW)

    def _predict(self, core: Core, inputs: Inputs, noise: FixNoise, sway: float, dt: float) -> tuple[Array, Array]:
        """Return prior mean and covariance; the course varies with the density `sway` [rad2 s]."""
        side, place = core.side_load(inputs.side), core.mean[:2]
        decay, Q = _process_noise(self.levels, dt, noise.correlation_time, len(core.mean))
        Q = Q.copy()
        Q[K, K] += dt * self._slip_walk(core, inputs) ** 2
        # a pull that changes the slip also resists turning
        pulled = self.levels.wheelbase * core.slip.walk
        Q[D, D] += dt * (abs(float(core.mean[V])) * self.levels.turn_offset_walk**2 + pulled**2)
        _add_sway(Q, core, sway, course(core.mean, side), dt)
        F, x = transition(core.mean, side, dt, decay), propagate_mean(core.mean, side, dt, decay)
        if core.search is not None:  # the direction of the displacement is unknown
            F[:2], x[:2] = np.eye(2, len(x)), place
        return x, prior(core.covariance, F, Q)

    def _check_wheels(self, core: Core, inputs: Inputs, fix: Fix) -> tuple[Core, Inputs]:
        """Return core and inputs; the wheel speed is removed if it contradicts a fix whose speed has not jumped."""
        speed = self._ground_speed(core, inputs, fix)
        jump = abs(speed - core.fix_speed) > JUMP_M_S2 * (inputs.t - core.seen_t)
        apart = abs(speed - (abs(inputs.wheel) if core.search else inputs.wheel)) > self.gates.velocity
        core = core._replace(fix_speed=speed, jumped=apart and (jump or core.jumped))
        return core, inputs._replace(wheel=float("nan")) if apart and not core.jumped else inputs

    def _ground_speed(self, core: Core, inputs: Inputs, fix: Fix) -> float:
        """Return the speed of a fix [m/s]; negative against the course, as for a tractor that slides backwards."""
        speed = hypot(fix.vx, fix.vy)
        if core.search is not None:
            return speed
        chi = course(core.mean, core.side_load(inputs.side))
        return copysign(speed, fix.vx * cos(chi) + fix.vy * sin(chi))

    def _moving(self, core: Core, velocity: list[MeasurementRow]) -> bool:
        """Return whether the velocity of a fix passes its gate."""
        return squared_innovation(velocity, core.covariance) < self.gates.nis or _size(velocity) < self.gates.velocity

    def _lever(self, core: Core, inputs: Inputs, mean: Array, dt: float) -> Lever:
        """Return the antenna's lever arm after a tick with this mean, for measured tilt and roll in a bend."""
        roll, pitch = inputs.lean
        now = offset(self.antenna, roll + self.levels.roll * float(mean[V]) ** 2 * core.bend, pitch, float(mean[PSI]))
        return core.lever.after(now, dt, self.swing_filter) if core.lever else Lever(now)

    def _crab(self, core: Core, inputs: Inputs) -> float:
        """Return the modelled sideslip, positive to the right [rad]."""
        return modelled_crab(core.mean, float(core.mean[V]), core.side_load(inputs.side))

    def _slip_walk(self, core: Core, inputs: Inputs) -> float:
        """Return the random walk of the slip in addition to that on firm level ground [1/sqrt(s)]."""
        return hypot(core.slip.walk, self.levels.lean_slip_walk * hypot(inputs.side, GRAVITY * sin(inputs.pitch)))

    def _slip(self, core: Core, inputs: Inputs, fix: Fix | None, dt: float) -> WheelSlip:
        """Return the slip variation updated by the wheels and the fix of R."""
        if fix is None:
            return core.slip.unseen()
        speed = self._ground_speed(core, inputs, fix)
        if abs(speed) < SLIPPING_SPEED or core.search or not isfinite(inputs.wheel):
            return WheelSlip(memory=core.slip.memory)
        scale, levels = wheel_scale(core.mean, inputs.pitch), self.levels
        variance = (levels.velocity_sigma**2 + levels.wheel_sigma**2) / speed**2
        return core.slip.after(inputs.wheel / (scale * speed) - 1.0, variance, float(core.covariance[K, K]), dt)

    def _motion_rows(self, core: Core, inputs: Inputs) -> list[MeasurementRow]:
        """Return the available measurement rows of gyro, wheels, steering angle and standstill."""
        mean, levels = core.mean, self.levels
        rows = [steer_row(mean, inputs.steer, levels)] if isfinite(inputs.steer) else []
        if isfinite(inputs.gyro):
            rows.append(gyro_row(mean, inputs.gyro, levels))
        if isfinite(inputs.wheel):
            rows.append(wheel_row(mean, inputs.wheel, inputs.pitch, core.cruise, levels))
        return rows + standing_rows(mean) if core.standing >= STANDING_TICKS else rows

    def _gate_fix(
        self, core: Core, inputs: Inputs, fix: Fix, noise: FixNoise, gap: float, sway: float
    ) -> tuple[Core, list[MeasurementRow]]:
        """Return the core and the measurement rows accepted from a rear-axle fix, `gap` [s] after the last fix."""
        if core.search is not None:
            return self._search_step(core, core.search, inputs, fix, noise)
        position = position_rows(core.mean, fix, noise, core.lever.offset if core.lever else (0.0, 0.0))
        side = core.side_load(inputs.side)
        velocity = velocity_rows(core.mean, fix, self.levels, side, sway / gap)
        nis = squared_innovation(position, core.covariance)
        core = core._replace(nis=nis)
        consistent = nis < self.gates.nis or _size(position) < self.gates.position
        if consistent:
            core = accepted(core, inputs.t)
        else:
            refused = core.refused_position + 1
            core = core._replace(refused_position=refused, rejected_positions=core.rejected_positions + 1)
            core = core._replace(probation=self.gates.patience if core.probation else 0)
            if refused >= self.gates.patience:
                core = restarted(core, fix, noise)._replace(probation=self.gates.patience)
        moving = self._moving(core, velocity)
        if moving:
            core = core._replace(refused_velocity=0, sway=self._course_variation(core, velocity[1], gap))
        else:
            refused = core.refused_velocity + 1
            core = core._replace(refused_velocity=refused, rejected_velocities=core.rejected_velocities + 1)
            if refused >= self.gates.patience:
                core = core._replace(search=Search(), refused_velocity=0, restarts=core.restarts + 1)
                core = core._replace(probation=self.gates.patience)
        return core, (position if consistent else []) + (velocity if moving else []) + self._heading(core, fix)

    def _course_variation(self, core: Core, across: MeasurementRow, gap: float) -> SidewaysNoise:
        """Return the course variation updated by the cross-course velocity of a fix, `gap` [s] after the last one."""
        v = float(core.mean[V])
        if abs(v) < SLIPPING_SPEED or implausible(core):
            return core.sway
        return core.sway.after(across.innovation / v, (self.levels.velocity_sigma / v) ** 2, gap)

    def _heading(self, core: Core, fix: Fix) -> list[MeasurementRow]:
        """Return the measurement row of the fix's heading if the heading exists and is probable."""
        if not isfinite(fix.heading):
            return []
        row, P = heading_row(core.mean, fix, self.levels), core.covariance
        variance = float(P[PSI, PSI] + 2.0 * P[PSI, MOUNT] + P[MOUNT, MOUNT]) + row.variance
        return [row] if row.innovation**2 < self.gates.nis * variance else []

    def _search_step(
        self, core: Core, search: Search, inputs: Inputs, fix: Fix, noise: FixNoise
    ) -> tuple[Core, list[MeasurementRow]]:
        """Set the position to that of the fix and update the search by its velocity or heading."""
        core = at_fix(core, fix, noise)
        core = core if core.probation else core._replace(accepted_t=inputs.t)
        if isfinite(fix.heading):
            return turned(core, heading_row(core.mean, fix, self.levels).innovation, self.levels.heading_sigma), []
        w = inputs.wheel
        if abs(w) > SEARCH_SPEED:  # false without a wheel speed, as the direction is unknown
            chi = course(core.mean, core.side_load(inputs.side))
            search = Search(search.total + w * complex(fix.vx, fix.vy) * turn(-1j * chi), search.weight + w * w)
        if search.weight * ALIGNMENT_SIGMA**2 < self.levels.velocity_sigma**2:
            return core._replace(search=search), []
        return turned(core, phase(search.total), ALIGNED_SIGMA), []

    def _correct(self, core: Core, rows: list[MeasurementRow]) -> Core:
        """Return the core with mean and covariance corrected by all measurement rows at once."""
        if not rows:
            return core
        H, R = np.zeros((len(rows), len(core.mean))), np.zeros((len(rows), len(rows)))
        for i, row in enumerate(rows):
            R[i, i] = row.variance
            for j, value in row.jacobian.items():
                H[i, j] = value
        innovations = np.array([row.innovation for row in rows])
        mean, covariance, _ = posterior(core.mean, core.covariance, H, innovations, R)
        mean[K] = min(max(mean[K], -SCALE_LIMIT), SCALE_LIMIT)
        return core._replace(mean=mean, covariance=covariance)


def _add_sway(Q: Array, core: Core, density: float, chi: float, dt: float) -> None:
    """Add the course variation about chi [rad] during `dt` [s], with this density [rad2 s], to the process noise."""
    q = dt * density * float(core.mean[V]) ** 2
    s, c = sin(chi), cos(chi)
    Q[X, X] += q * s * s
    Q[Y, Y] += q * c * c
    Q[X, Y] -= q * s * c
    Q[Y, X] -= q * s * c


def _size(pair: list[MeasurementRow]) -> float:
    """Return the magnitude of an innovation pair."""
    return hypot(pair[0].innovation, pair[1].innovation)


@lru_cache(maxsize=16)
def _process_noise(levels: FullLevels, dt: float, correlation_time: float, n: int) -> tuple[float, Array]:
    return process_noise(levels, dt, correlation_time, n)
