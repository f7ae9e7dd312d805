"""Filter of the estimator `ekf_full` at the time of a fix: one EKF tick with gates and alignment.

`Core` is the complete state of the filter. A tick predicts and then corrects with all measurement rows at once: gyro,
wheel speed, steering, standstill, and position and velocity of a fix that pass their gates.

Gates: A pair of innovations is rejected if it is both improbable (`gate_sigma`) and larger than a floor, the usual
oscillation of the antenna. Consecutive rejections for `gate_patience_s` indicate a wrong filter state: the position
restarts from the fix, and rejected velocities restart the search for the yaw. Fixes then count as accepted again after
the same time without rejection. If wheel speed and fix speed differ by more than the floor, the wheels spin or slide
and are ignored, unless the fix speed jumped: tyres cannot stop a tractor within a tick.

Alignment: Until the yaw is found, the position is that of the fixes. The yaw correction is the argument of sum(w
(V_east + i V_north) exp(-i chi)), with fix velocities V and wheel speeds w. It is valid for any initial yaw, forward
and in reverse. Its standard deviation is that of a velocity divided by sqrt(sum(w^2)). A two-antenna heading ends the
search immediately, even at standstill; sideslip and heading are then separately observable.
"""

from cmath import exp as turn
from cmath import phase
from functools import lru_cache
from math import copysign, cos, exp, hypot, isfinite, radians, sin, tan

from agrobot_mj.core.geometry import wrap
from agrobot_mj.core.signals import Array, Fix
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
    SLOW,
    D,
    FixNoise,
    FullLevels,
    K,
    N,
    V,
    course,
    modelled_crab,
    predict,
    process_noise,
    wheel_scale,
    with_sideslip,
)
from agrobot_mj.estimation.full_rows import (
    FixNumbers,
    FixRows,
    MotionNoise,
    MotionReadings,
    corrected,
    fix_rows,
    no_fix,
)
from agrobot_mj.estimation.kalman import Filter
from agrobot_mj.estimation.lever_arm import Lever, at_foot, offset
from agrobot_mj.estimation.mounting import implausible, with_crab, with_mounting
from agrobot_mj.estimation.sideslip_noise import SidewaysNoise
from agrobot_mj.estimation.wheel_slip import WheelSlip
from agrobot_mj.machine.tractor import GRAVITY

ALIGNMENT_SIGMA = radians(0.3)
"""Standard deviation at which the search for the yaw ends [rad]. Assumed value, reached after 1.4 m at 1.2 m/s."""
ALIGNED_SIGMA = radians(1.0)
"""Standard deviation of the yaw after the search [rad]. Assumed value for the search error plus 2 s of gyro bias."""
UNALIGNED_SIGMA = radians(104.0)
"""Standard deviation of an unknown yaw: uniform over the circle [rad]."""
SEARCH_SPEED = 0.1
"""Minimum wheel speed for determining the yaw from velocities [m/s]. Assumed value, three times the velocity noise."""
SLIPPING_SPEED = 0.3
"""Minimum speed for determining wheel slip from a fix [m/s]. Assumed value, ten times the velocity noise."""
CRUISE_S = 1.0
"""Time constant for filtering the speed [s]. Assumed value, 20 measurements and half of the duration of a start."""
BEND_S = 0.6
"""Time constant for filtering the curvature [s]. Assumed value, the response time of the tyres; 1 deg of noise."""
STANDING_SPEED, STANDING_TICKS = 0.05, 10
"""Maximum wheel speed [m/s] and minimum number of ticks of a standstill. Assumed values for noise, and 0.5 s."""
SWAY, SWAY_S = 0.15, 5.0
"""Relative error of modelled sideslip changes [-] and twice its correlation time [s]. Assumed values for ruts and
slopes."""
STEADY_S = 20.0
"""Time constant for changes of the modelled sideslip [s]. Assumed value, half a turn. The uncertainty of the compliance
includes longer sideslip, as along a contour line."""
LONGEST_GAP_S = 1.0
"""Maximum time represented by one fix [s]. Assumed value, the period of a 1 Hz receiver."""
JUMP_M_S2 = 15.0
"""Maximum plausible rate of change of the fix speed [m/s2]. Assumed value, twice the limit of the tyres."""

Used = tuple[bool, bool, bool]
"""Whether position, velocity and heading of a fix are used."""
UNUSED = (False, False, False)


class FullFilter(Filter):
    """EKF for one set of noise levels; `step` is a pure function."""

    def __init__(
        self, levels: FullLevels, noises: dict[int, FixNoise], gates: Gates, antenna: float, swing_filter: float
    ) -> None:
        """Create the filter, with `noises` by fix quality and the height of the `antenna` [m]."""
        self.levels, self.noises, self.gates = levels, noises, gates
        self.antenna, self.swing_filter = (0.0, 0.0, antenna), swing_filter
        sigmas = levels.steer_sigma, levels.gyro_sigma, levels.wheel_sigma
        self.motion_noise = MotionNoise(levels.wheelbase, *(sigma * sigma for sigma in sigmas))

    def step(self, core: Core, inputs: Inputs, fix: Fix | None, quality: int, dt: float) -> Core:
        """Return the core after a tick of `dt` [s] with these inputs and the fix at its end."""
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
        standing = core.standing >= STANDING_TICKS
        motion = MotionReadings(inputs.steer, inputs.gyro, inputs.wheel, inputs.pitch, core.cruise, standing)
        rows, used = no_fix(len(core.mean)), UNUSED
        if fix is not None and core.search is not None:
            core = self._search_step(core, core.search, inputs, fix, noise)
        elif fix is not None:
            core, rows, used = self._gate_fix(core, inputs, fix, noise, gap, sway)
        mean, covariance = corrected(core.mean, core.covariance, motion, self.motion_noise, rows, used)
        return with_mounting(core._replace(mean=mean, covariance=covariance))

    def _curvature(self, mean: Array, inputs: Inputs) -> float:
        """Return the path curvature from the steering angle or, if missing, from the yaw rate [1/m]."""
        if isfinite(inputs.steer):
            return tan(inputs.steer - float(mean[B_S])) / self.levels.wheelbase
        v = float(mean[V])
        return float(mean[OMEGA]) * v / (v * v + SLOW * SLOW)

    def _predict(self, core: Core, inputs: Inputs, noise: FixNoise, sway: float, dt: float) -> tuple[Array, Array]:
        """Return prior mean and covariance; the course varies with the density `sway` [rad2 s]."""
        decay, Q = _process_noise(self.levels, dt, noise.correlation_time, len(core.mean))
        Q = Q.copy()
        Q[K, K] += dt * self._slip_walk(core, inputs) ** 2
        # a pull that changes the slip also resists turning
        pulled = self.levels.wheelbase * core.slip.walk
        Q[D, D] += dt * (abs(float(core.mean[V])) * self.levels.turn_offset_walk**2 + pulled**2)
        side, known = core.side_load(inputs.side), core.search is None
        return predict(core.mean, core.covariance, Q, side, sway, dt, decay, known)

    def _check_wheels(self, core: Core, inputs: Inputs, fix: Fix) -> tuple[Core, Inputs]:
        """Return core and inputs, without the wheel speed if it contradicts a fix whose speed has not jumped."""
        speed = self._ground_speed(core, inputs, fix)
        jump = abs(speed - core.fix_speed) > JUMP_M_S2 * (inputs.t - core.seen_t)
        apart = abs(speed - (abs(inputs.wheel) if core.search else inputs.wheel)) > self.gates.velocity
        core = core._replace(fix_speed=speed, jumped=apart and (jump or core.jumped))
        return core, inputs._replace(wheel=float("nan")) if apart and not core.jumped else inputs

    def _ground_speed(self, core: Core, inputs: Inputs, fix: Fix) -> float:
        """Return the speed of a fix [m/s], negative for motion against the course, as when sliding backwards."""
        speed = hypot(fix.vx, fix.vy)
        if core.search is not None:
            return speed
        chi = course(core.mean, core.side_load(inputs.side))
        return copysign(speed, fix.vx * cos(chi) + fix.vy * sin(chi))

    def _lever(self, core: Core, inputs: Inputs, mean: Array, dt: float) -> Lever:
        """Return the antenna's lever arm after a tick with this mean, for measured tilt and modelled roll in a bend."""
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
        """Return the slip variation updated with the wheel speed and the fix of R."""
        if fix is None:
            return core.slip.unseen()
        speed = core.fix_speed
        if abs(speed) < SLIPPING_SPEED or core.search or not isfinite(inputs.wheel):
            return WheelSlip(memory=core.slip.memory)
        scale, levels = wheel_scale(core.mean, inputs.pitch), self.levels
        variance = (levels.velocity_sigma**2 + levels.wheel_sigma**2) / speed**2
        return core.slip.after(inputs.wheel / (scale * speed) - 1.0, variance, float(core.covariance[K, K]), dt)

    def _gate_fix(
        self, core: Core, inputs: Inputs, fix: Fix, noise: FixNoise, gap: float, sway: float
    ) -> tuple[Core, FixRows, Used]:
        """Return the core, the rows of a rear-axle fix, `gap` [s] after the last fix, and which of them are used."""
        east, north = core.lever.offset if core.lever else (0.0, 0.0)
        variances = self.levels.velocity_sigma**2, sway / gap, self.levels.heading_sigma**2
        numbers = FixNumbers(fix.x, fix.y, fix.vx, fix.vy, fix.heading, east, north, *variances)
        rows = fix_rows(core.mean, core.covariance, numbers, noise, core.side_load(inputs.side))
        y = rows.innovation.tolist()
        core = core._replace(nis=rows.position_nis)
        consistent = rows.position_nis < self.gates.nis or hypot(y[0], y[1]) < self.gates.position
        if consistent:
            core = accepted(core, inputs.t)
        else:
            refused = core.refused_position + 1
            core = core._replace(refused_position=refused, rejected_positions=core.rejected_positions + 1)
            core = core._replace(probation=self.gates.patience if core.probation else 0)
            if refused >= self.gates.patience:
                core = restarted(core, fix, noise)._replace(probation=self.gates.patience)
        moving = rows.velocity_nis < self.gates.nis or hypot(y[2], y[3]) < self.gates.velocity
        if moving:
            core = core._replace(refused_velocity=0, sway=self._course_variation(core, y[3], gap))
        else:
            refused = core.refused_velocity + 1
            core = core._replace(refused_velocity=refused, rejected_velocities=core.rejected_velocities + 1)
            if refused >= self.gates.patience:
                core = core._replace(search=Search(), refused_velocity=0, restarts=core.restarts + 1)
                core = core._replace(probation=self.gates.patience)
        return core, rows, (consistent, moving, self._is_probable(core, rows))

    def _course_variation(self, core: Core, across: float, gap: float) -> SidewaysNoise:
        """Return the course variation updated by the cross-course velocity of a fix, `gap` [s] after the last one."""
        v = float(core.mean[V])
        if abs(v) < SLIPPING_SPEED or implausible(core):
            return core.sway
        return core.sway.after(across / v, (self.levels.velocity_sigma / v) ** 2, gap)

    def _is_probable(self, core: Core, rows: FixRows) -> bool:
        """Return whether a fix has a heading, and a probable one."""
        if len(core.mean) == N or not isfinite(innovation := float(rows.innovation[4])):
            return False
        P = core.covariance
        variance = float(P[PSI, PSI] + 2.0 * P[PSI, MOUNT] + P[MOUNT, MOUNT] + rows.variance[4])
        return innovation**2 < self.gates.nis * variance

    def _search_step(self, core: Core, search: Search, inputs: Inputs, fix: Fix, noise: FixNoise) -> Core:
        """Set the position to that of the fix and update the search by its velocity or heading."""
        core = at_fix(core, fix, noise)
        core = core if core.probation else core._replace(accepted_t=inputs.t)
        if isfinite(fix.heading):
            innovation = wrap(fix.heading - float(core.mean[PSI] + core.mean[MOUNT]))
            return turned(core, innovation, self.levels.heading_sigma)
        w = inputs.wheel
        if abs(w) > SEARCH_SPEED:  # false for a missing wheel speed, whose sign is unknown
            chi = course(core.mean, core.side_load(inputs.side))
            search = Search(search.total + w * complex(fix.vx, fix.vy) * turn(-1j * chi), search.weight + w * w)
        if search.weight * ALIGNMENT_SIGMA**2 < self.levels.velocity_sigma**2:
            return core._replace(search=search)
        return turned(core, phase(search.total), ALIGNED_SIGMA)


@lru_cache(maxsize=16)
def _process_noise(levels: FullLevels, dt: float, correlation_time: float, n: int) -> tuple[float, Array]:
    return process_noise(levels, dt, correlation_time, n)
