"""Filter of the estimator `ekf_full` at the time of a fix: one tick of an EKF with gates and alignment.

All that the filter believes stands in `Core`. A tick predicts, then corrects by
all rows at once: gyro, wheel speed, steering, standstill, and position and velocity of a fix that pass their gates.

Gates: a pair of innovations is refused where it is both improbable (`gate_sigma`) and larger than a floor, below which
sway of the antenna is nothing unusual. Refusals in a row for `gate_patience_s` mean that the filter is wrong: the
position restarts from the fix, and after refused velocities the yaw is searched again. No fix counts as accepted then
until for that time none has been refused. Wheels whose speed is off the fix's by more than that floor spin or slide,
and are not heard, unless it was the fix's velocity that leapt: tyres cannot stop a tractor within a tick.

Alignment: until the yaw is found the position is that of the fixes. The correction of the yaw that fits the fixes'
velocities V to the wheel speeds w is the argument of sum(w (V_east + i V_north) exp(-i chi)), for any start and in
reverse too; its standard deviation is that of a velocity over sqrt(sum(w^2)). A heading from two antennas ends the
search at once, at a standstill too, and from the first one on sideslip and heading are told apart.
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
"""Uncertainty of the yaw after the search [rad]. Assumed value: that of the search, and a gyro bias for two seconds."""
UNALIGNED_SIGMA = radians(104.0)
"""Uncertainty of a yaw of which nothing is known: uniform over the circle [rad]."""
SEARCH_SPEED = 0.1
"""Wheel speed above which velocities are used to find the yaw [m/s]. Assumed value: three times their noise."""
SLIPPING_SPEED = 0.3
"""Speed above which a fix is used to observe wheel slip [m/s]. Assumed value: ten times the noise of its velocity."""
CRUISE_S = 1.0
"""Time constant of the speed without noise [s]. Assumed value: 20 readings, and a start takes two seconds."""
BEND_S = 0.6
"""Time constant of the curvature without noise [s]. Assumed value: readings are off by 1 deg; tyres answer within
it."""
STANDING_SPEED, STANDING_TICKS = 0.05, 10
"""Wheel speed [m/s] below which, for so many ticks, the tractor stands. Assumed value: noise of a reading, half a
second."""
SWAY, SWAY_S = 0.15, 5.0
"""Error of a change of the modelled sideslip over its value [-], and twice its correlation time [s]. Assumed value:
ruts, slopes."""
STEADY_S = 20.0
"""Time over which a change of the modelled sideslip counts [s]. Assumed value: half a turn. What lasts longer, as along
a contour line, is no sway: the compliance and its uncertainty hold it."""
LONGEST_GAP_S = 1.0
"""Longest time for which a fix stands [s]. Assumed value: a receiver of 1 Hz."""
LEAP_M_S2 = 15.0
"""Change of speed beyond which it is the fix that is wrong [m/s2]. Assumed value: twice what tyres give."""


class FullFilter(Filter):
    """The filter for one set of levels; `step` is a function of its arguments."""

    def __init__(
        self, levels: FullLevels, noises: dict[int, FixNoise], gates: Gates, antenna: float, swing_filter: float
    ) -> None:
        """`noises` by quality; height of the `antenna` [m]."""
        self.levels, self.noises, self.gates = levels, noises, gates
        self.antenna, self.swing_filter = (0.0, 0.0, antenna), swing_filter

    def step(self, core: Core, inputs: Inputs, fix: Fix | None, quality: int, dt: float) -> Core:
        """Core after a tick of length `dt` [s] with these inputs, given the fix of its end."""
        if fix is not None and quality != core.quality:
            core = forget_correlated(core._replace(quality=quality))
        if fix is not None and isfinite(fix.heading) and len(core.mean) == N:
            mean, covariance = with_sideslip(core.mean, core.covariance, self.levels.sideslip_sigma)
            core = core._replace(mean=mean, covariance=covariance)
        noise, crab = self.noises[core.quality], self._crab(core, inputs)
        sway = core.sway.density + SWAY_S * (SWAY * (crab - core.steady)) ** 2
        mean, covariance = self._predicted(core, inputs, noise, sway, dt)
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
            core, inputs = self._trusted(with_crab(core, fix, core.side_load(inputs.side), gap), inputs, fix)
        seen_t = core.seen_t if fix is None else inputs.t
        core = core._replace(slip=self._slip(core, inputs, fix, dt), seen_t=seen_t)
        rows = self._motion_rows(core, inputs)
        if fix is not None:
            core, more = self._judge(core, inputs, fix, noise, gap, sway)
            rows += more
        core = self._correct(core, rows)
        return with_mounting(core)

    def _curvature(self, mean: Array, inputs: Inputs) -> float:
        """Curvature that the steering angle asks for, or that the yaw rate shows where there is no angle [1/m]."""
        if isfinite(inputs.steer):
            return tan(inputs.steer - float(mean[B_S])) / self.levels.wheelbase
        v = float(mean[V])
        return float(mean[OMEGA]) * v / (v * v + SLOW * SLOW)

    def _predicted(self, core: Core, inputs: Inputs, noise: FixNoise, sway: float, dt: float) -> tuple[Array, Array]:
        """Prior mean and covariance; the course sways with the density `sway` [rad2 s]."""
        side, place = core.side_load(inputs.side), core.mean[:2]
        decay, Q = _process_noise(self.levels, dt, noise.correlation_time, len(core.mean))
        Q = Q.copy()
        Q[K, K] += dt * self._slip_walk(core, inputs) ** 2
        # a pull that changes the slip holds the turn back
        pulled = self.levels.wheelbase * core.slip.walk
        Q[D, D] += dt * (abs(float(core.mean[V])) * self.levels.turn_offset_walk**2 + pulled**2)
        _add_sway(Q, core, sway, course(core.mean, side), dt)
        F, x = transition(core.mean, side, dt, decay), propagate_mean(core.mean, side, dt, decay)
        if core.search is not None:  # a displacement in an unknown direction says nothing
            F[:2], x[:2] = np.eye(2, len(x)), place
        return x, prior(core.covariance, F, Q)

    def _trusted(self, core: Core, inputs: Inputs, fix: Fix) -> tuple[Core, Inputs]:
        """Core and inputs, without wheels that are far off the fix where it is not the fix that has leapt."""
        speed = self._ground_speed(core, inputs, fix)
        leap = abs(speed - core.fix_speed) > LEAP_M_S2 * (inputs.t - core.seen_t)
        apart = abs(speed - (abs(inputs.wheel) if core.search else inputs.wheel)) > self.gates.velocity
        core = core._replace(fix_speed=speed, leapt=apart and (leap or core.leapt))
        return core, inputs._replace(wheel=float("nan")) if apart and not core.leapt else inputs

    def _ground_speed(self, core: Core, inputs: Inputs, fix: Fix) -> float:
        """Speed of a fix [m/s], negative against the course, as on a tractor that slides backwards."""
        speed = hypot(fix.vx, fix.vy)
        if core.search is not None:
            return speed
        chi = course(core.mean, core.side_load(inputs.side))
        return copysign(speed, fix.vx * cos(chi) + fix.vy * sin(chi))

    def _moving(self, core: Core, velocity: list[MeasurementRow]) -> bool:
        """Whether the velocity of a fix passes its gate."""
        return squared_innovation(velocity, core.covariance) < self.gates.nis or _size(velocity) < self.gates.velocity

    def _lever(self, core: Core, inputs: Inputs, mean: Array, dt: float) -> Lever:
        """Lean of the antenna at the end of a tick with this mean, as measured and by the roll in a bend."""
        roll, pitch = inputs.lean
        now = offset(self.antenna, roll + self.levels.roll * float(mean[V]) ** 2 * core.bend, pitch, float(mean[PSI]))
        return core.lever.after(now, dt, self.swing_filter) if core.lever else Lever(now)

    def _crab(self, core: Core, inputs: Inputs) -> float:
        """Modelled sideslip, to the right positive [rad]."""
        return modelled_crab(core.mean, float(core.mean[V]), core.side_load(inputs.side))

    def _slip_walk(self, core: Core, inputs: Inputs) -> float:
        """Walk of the slip beyond that of firm level ground [1/sqrt(s)]."""
        return hypot(core.slip.walk, self.levels.lean_slip_walk * hypot(inputs.side, GRAVITY * sin(inputs.pitch)))

    def _slip(self, core: Core, inputs: Inputs, fix: Fix | None, dt: float) -> WheelSlip:
        """What the wheels and the fix of R say of the slip."""
        if fix is None:
            return core.slip.unseen()
        speed = self._ground_speed(core, inputs, fix)
        if abs(speed) < SLIPPING_SPEED or core.search or not isfinite(inputs.wheel):
            return WheelSlip(memory=core.slip.memory)
        scale, levels = wheel_scale(core.mean, inputs.pitch), self.levels
        variance = (levels.velocity_sigma**2 + levels.wheel_sigma**2) / speed**2
        return core.slip.after(inputs.wheel / (scale * speed) - 1.0, variance, float(core.covariance[K, K]), dt)

    def _motion_rows(self, core: Core, inputs: Inputs) -> list[MeasurementRow]:
        """What gyro, wheels and steering tell, as far as they do."""
        mean, levels = core.mean, self.levels
        rows = [steer_row(mean, inputs.steer, levels)] if isfinite(inputs.steer) else []
        if isfinite(inputs.gyro):
            rows.append(gyro_row(mean, inputs.gyro, levels))
        if isfinite(inputs.wheel):
            rows.append(wheel_row(mean, inputs.wheel, inputs.pitch, core.cruise, levels))
        return rows + standing_rows(mean) if core.standing >= STANDING_TICKS else rows

    def _judge(
        self, core: Core, inputs: Inputs, fix: Fix, noise: FixNoise, gap: float, sway: float
    ) -> tuple[Core, list[MeasurementRow]]:
        """Core and rows after a look at the fix of R, `gap` [s] after the last one, with the density of the `sway`."""
        if core.search is not None:
            return self._searched(core, core.search, inputs, fix, noise)
        position = position_rows(core.mean, fix, noise, core.lever.offset if core.lever else (0.0, 0.0))
        side = core.side_load(inputs.side)
        velocity = velocity_rows(core.mean, fix, self.levels, side, sway / gap)
        nis = squared_innovation(position, core.covariance)
        core = core._replace(nis=nis)
        good = nis < self.gates.nis or _size(position) < self.gates.position
        if good:
            core = accepted(core, inputs.t)
        else:
            refused = core.refused_position + 1
            core = core._replace(refused_position=refused, rejected_positions=core.rejected_positions + 1)
            core = core._replace(probation=self.gates.patience if core.probation else 0)
            if refused >= self.gates.patience:
                core = restarted(core, fix, noise)._replace(probation=self.gates.patience)
        moving = self._moving(core, velocity)
        if moving:
            core = core._replace(refused_velocity=0, sway=self._swayed(core, velocity[1], gap))
        else:
            refused = core.refused_velocity + 1
            core = core._replace(refused_velocity=refused, rejected_velocities=core.rejected_velocities + 1)
            if refused >= self.gates.patience:
                core = core._replace(search=Search(), refused_velocity=0, restarts=core.restarts + 1)
                core = core._replace(probation=self.gates.patience)
        return core, (position if good else []) + (velocity if moving else []) + self._heading(core, fix)

    def _swayed(self, core: Core, across: MeasurementRow, gap: float) -> SidewaysNoise:
        """Sway of the course after the cross-course velocity of a fix, `gap` [s] after the last one."""
        v = float(core.mean[V])
        if abs(v) < SLIPPING_SPEED or implausible(core):
            return core.sway
        return core.sway.after(across.innovation / v, (self.levels.velocity_sigma / v) ** 2, gap)

    def _heading(self, core: Core, fix: Fix) -> list[MeasurementRow]:
        """The heading of a fix, if it has one that is not improbable."""
        if not isfinite(fix.heading):
            return []
        row, P = heading_row(core.mean, fix, self.levels), core.covariance
        variance = float(P[PSI, PSI] + 2.0 * P[PSI, MOUNT] + P[MOUNT, MOUNT]) + row.variance
        return [row] if row.innovation**2 < self.gates.nis * variance else []

    def _searched(
        self, core: Core, search: Search, inputs: Inputs, fix: Fix, noise: FixNoise
    ) -> tuple[Core, list[MeasurementRow]]:
        """The position that of the fix, and the search one velocity further."""
        core = at_fix(core, fix, noise)
        core = core if core.probation else core._replace(accepted_t=inputs.t)
        if isfinite(fix.heading):
            return turned(core, heading_row(core.mean, fix, self.levels).innovation, self.levels.heading_sigma), []
        w = inputs.wheel
        if abs(w) > SEARCH_SPEED:  # false without a wheel speed: forward or in reverse is not known then
            chi = course(core.mean, core.side_load(inputs.side))
            search = Search(search.total + w * complex(fix.vx, fix.vy) * turn(-1j * chi), search.weight + w * w)
        if search.weight * ALIGNMENT_SIGMA**2 < self.levels.velocity_sigma**2:
            return core._replace(search=search), []
        return turned(core, phase(search.total), ALIGNED_SIGMA), []

    def _correct(self, core: Core, rows: list[MeasurementRow]) -> Core:
        """Mean and covariance corrected by all rows at once."""
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
    """Add to the process noise what the course sways about chi [rad] over `dt` [s], with this density [rad2 s]."""
    q = dt * density * float(core.mean[V]) ** 2
    s, c = sin(chi), cos(chi)
    Q[X, X] += q * s * s
    Q[Y, Y] += q * c * c
    Q[X, Y] -= q * s * c
    Q[Y, X] -= q * s * c


def _size(pair: list[MeasurementRow]) -> float:
    """Length of an innovation."""
    return hypot(pair[0].innovation, pair[1].innovation)


@lru_cache(maxsize=16)
def _process_noise(levels: FullLevels, dt: float, correlation_time: float, n: int) -> tuple[float, Array]:
    return process_noise(levels, dt, correlation_time, n)
