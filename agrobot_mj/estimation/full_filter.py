"""Filter of the estimator `ekf_full` at the time of a fix: one EKF tick with gates and alignment.

`Core` is the complete state of the filter. A tick predicts the state and then corrects it with all measurements at
once: gyro, wheel speed, steering angle, standstill, and position, velocity and heading of a fix that pass their gates.

Gates: The position or velocity of a fix is rejected if its innovation is both improbable (`gate_sigma`) and larger than
a minimum, which is the usual oscillation of the antenna. Consecutive rejections for `gate_patience_s` indicate a wrong
filter state: the position restarts from the fix, and rejected velocities restart the search for the yaw. Fixes then
count as accepted again after the same time without rejection. If wheel speed and fix speed differ by more than the
minimum, the wheels spin or slide and the wheel speed is ignored. After a jump of the fix speed the wheel speed is used,
because tyres cannot stop a tractor within a tick.

Alignment: Until the yaw is found, the position is the position of the fixes. The yaw correction is the argument of
sum(w (V_east + i V_north) exp(-i chi)), with fix velocities V, wheel speeds w and course chi. The correction is valid
for any initial yaw, forward and in reverse. Its standard deviation is the velocity noise divided by sqrt(sum(w^2)). A
two-antenna heading ends the search immediately, even at standstill; sideslip and heading are then both observable.
"""

from math import atan2, copysign, cos, exp, isfinite, nan, radians, sin, sqrt, tan
from typing import NamedTuple

from agrobot_mj.core.geometry import wrap
from agrobot_mj.core.kernels import jit
from agrobot_mj.core.signals import Fix, Matrix, Vector
from agrobot_mj.estimation.full_core import (
    FOUND,
    Core,
    Gates,
    Inputs,
    Rejections,
    Search,
    Seen,
    Smooth,
    at_fix,
    count_accepted_fix,
    forget_correlated,
    rotate_yaw,
    side_of,
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
    SideLoad,
    V,
    braking,
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
    correct_jointly,
    fix_rows,
    no_fix,
)
from agrobot_mj.estimation.lever_arm import Lever, at_foot, offset
from agrobot_mj.estimation.mounting import implausible, with_crab, with_mounting
from agrobot_mj.estimation.sideslip_noise import density
from agrobot_mj.estimation.wheel_slip import WheelSlip
from agrobot_mj.machine.tractor import GRAVITY

ALIGNMENT_SIGMA = radians(0.3)
"""Standard deviation of the yaw at which the yaw search ends [rad]. Assumed value, reached after 1.4 m at 1.2 m/s."""
ALIGNED_SIGMA = radians(1.0)
"""Standard deviation of the yaw after the yaw search [rad]. Assumed value for search errors and 2 s of gyro drift."""
UNALIGNED_SIGMA = radians(104.0)  # Standard deviation of an unknown yaw: uniform over the circle [rad]
SEARCH_SPEED = 0.1
"""Minimum wheel speed at which fix velocities determine the yaw [m/s]. Assumed value: 3 times the velocity noise."""
SLIPPING_SPEED = 0.3
"""Minimum speed at which a fix determines the wheel slip [m/s]. Assumed value: ten times the velocity noise."""
CRUISE_S = 1.0
"""Time constant of the low-pass filter of the speed [s]. Assumed value: the duration of 20 measurements, and half the
duration of an acceleration from standstill."""
BEND_S = 0.6
"""Time constant of the low-pass filter of the curvature [s]. Assumed value: the response time of the tyres, which is
long enough to filter steering-angle noise of 1 deg."""
STANDING_SPEED, STANDING_TICKS = 0.05, 10
"""Maximum wheel speed [m/s] and minimum duration [ticks] of a standstill. Assumed values: the speed noise and 0.5 s."""
SWAY, SWAY_S = 0.15, 5.0
"""Relative error of changes in modelled sideslip [-], and twice the correlation time of this error [s]. Assumed values
for ruts."""
STEADY_S = 20.0
"""Time constant of the low-pass filter of the modelled sideslip [s]. Assumed value: the duration of a half turn. The
uncertainty of the tyre compliance covers sideslip that lasts longer, for example on a contour line."""
LONGEST_GAP_S = 1.0  # Maximum time represented by one fix [s]. Assumed value: the period of a 1 Hz receiver.
JUMP_M_S2 = 15.0
"""Maximum plausible rate of change of the speed of GNSS fixes [m/s2]. Assumed value: twice the friction limit of the
tyres."""

Used = tuple[bool, bool, bool]  # Whether the filter uses the position, velocity and heading of a fix, in this order


class FullFilter(NamedTuple):
    """Parameters of the filter of `ekf_full`: noise levels, gate limits and antenna position."""

    levels: FullLevels  # Noise levels of states and measurements
    noises: tuple[FixNoise, FixNoise, FixNoise, FixNoise]  # Position error of a fix for each constant of `Quality`
    gates: Gates  # Limits for rejecting a fix as an outlier
    antenna: tuple[float, float, float]  # Position of the antenna relative to the rear-axle point R in vehicle axes [m]
    swing_filter: float  # Time constant for filtering the antenna velocity due to tilting; 0 disables the filter [s]


@jit
def step(f: FullFilter, core: Core, inputs: Inputs, fix: Fix, quality: int, dt: float) -> Core:
    """Return the filter state after a tick of `dt` [s], corrected by `inputs` and by a fix, which is NaN if missing."""
    seen = isfinite(fix.x)
    if seen:
        core = _prepare_for_fix(f, core, fix, quality)
    noise, unsteady = f.noises[core.seen.quality], SWAY * (_crab(core, inputs) - core.smooth.steady)
    sway = density(core.sway) + SWAY_S * (unsteady * unsteady)
    core = _predict_tick(f, core, inputs, noise, sway, dt)
    smooth, wheel, rows, used = core.smooth, inputs.wheel, no_fix(core.mean.size), (False, False, False)
    slip = core.slip.without_fix()
    if seen:
        core, wheel, rows, used = _with_fix(f, core, inputs, at_foot(fix, core.lever), sway, dt)
        slip = core.slip
    standing = smooth.standing >= STANDING_TICKS
    braked = braking(inputs.pitch, core.mean[V], SideLoad(side_of(inputs), smooth.bend), f.levels)
    motion = MotionReadings(inputs.steer, inputs.gyro, wheel, inputs.pitch, braked, smooth.cruise, standing)
    s, g, w = f.levels.steer_sigma, f.levels.gyro_sigma, f.levels.wheel_sigma
    mean, P = correct_jointly(
        core.mean, core.covariance, motion, MotionNoise(f.levels.wheelbase, s * s, g * g, w * w), rows, used
    )
    mean, P, crab = with_mounting(mean, P, core.crab, smooth.bend)
    r, nis = core.rejections, rows.position_nis
    return Core(mean, P, core.search, core.lever, r, core.seen, smooth, slip, core.sway, crab, nis)


@jit
def _prepare_for_fix(f: FullFilter, core: Core, fix: Fix, quality: int) -> Core:
    """Return the filter state prepared for a fix; the first two-antenna heading adds two states. A change of the
    quality resets the correlated fix error."""
    mean, P, last = core.mean, core.covariance, core.seen
    if quality != last.quality:
        mean, P = forget_correlated(mean, P)
    if isfinite(fix.heading) and mean.size == N:
        mean, P = with_sideslip(mean, P, f.levels.sideslip_sigma)
    last = Seen(last.t, quality, last.speed, last.jumped)
    r, smooth = core.rejections, core.smooth
    return Core(mean, P, core.search, core.lever, r, last, smooth, core.slip, core.sway, core.crab, core.nis)


@jit
def _predict_tick(f: FullFilter, core: Core, inputs: Inputs, noise: FixNoise, sway: float, dt: float) -> Core:
    """Return the filter state predicted to the end of the tick; `sway` is the density of the course noise [rad2 s]."""
    old, L, walk = core.smooth, f.levels.wheelbase, f.levels.turn_offset_walk
    decay, Q = process_noise(f.levels, dt, noise.correlation_time, core.mean.size)
    side, pull, per_pull = side_of(inputs), GRAVITY * sin(inputs.pitch), f.levels.lean_slip_walk
    Q[K, K] += dt * (core.slip.change + per_pull * per_pull * (side * side + pull * pull))
    # a pull of an implement that changes the slip also resists turning
    Q[D, D] += dt * (abs(core.mean[V]) * (walk * walk) + L * L * core.slip.change)
    load = SideLoad(side, old.bend)
    mean, P = predict(core.mean, core.covariance, Q, load, sway, dt, decay, not core.search.active)
    still = isfinite(inputs.wheel) and abs(inputs.wheel) < STANDING_SPEED
    smooth = Smooth(
        old.standing + 1 if still else 0,
        old.cruise + (mean[V] - old.cruise) * (1.0 - exp(-dt / CRUISE_S)),
        old.steady + (_crab(core, inputs) - old.steady) * (1.0 - exp(-dt / STEADY_S)),
        old.bend + (_curvature(f, mean, inputs) - old.bend) * (1.0 - exp(-dt / BEND_S)),
    )
    lever, r = _lever(f, core, inputs, mean, dt), core.rejections
    return Core(mean, P, core.search, lever, r, core.seen, smooth, core.slip, core.sway, core.crab, core.nis)


@jit
def _crab(core: Core, inputs: Inputs) -> float:
    """Return the sideslip of the rear axle modelled from side force and curvature [rad], positive to the right."""
    return modelled_crab(core.mean, core.mean[V], SideLoad(side_of(inputs), core.smooth.bend))


@jit
def _curvature(f: FullFilter, mean: Vector, inputs: Inputs) -> float:
    """Return the path curvature [1/m] from the steering angle or, without steering angle, from the yaw rate."""
    if isfinite(inputs.steer):
        return tan(inputs.steer - mean[B_S]) / f.levels.wheelbase
    v = mean[V]
    return float(mean[OMEGA] * v / (v * v + SLOW * SLOW))


@jit
def _lever(f: FullFilter, core: Core, inputs: Inputs, mean: Vector, dt: float) -> Lever:
    """Return the antenna's lever arm at the end of a tick, from the measured tilt and the modelled roll in a bend."""
    roll, pitch = inputs.lean
    roll += f.levels.roll * (mean[V] * mean[V]) * core.smooth.bend
    return core.lever.after(offset(f.antenna, roll, pitch, mean[PSI]), dt, f.swing_filter)


@jit
def _with_fix(
    f: FullFilter, core: Core, inputs: Inputs, fix: Fix, sway: float, dt: float
) -> tuple[Core, float, FixRows, Used]:
    """Apply the gates to a fix. Return the filter state, the wheel speed (NaN if rejected), the measurement rows of the
    fix, and which rows are used."""
    mean, P, search, r, variation = core.mean, core.covariance, core.search, core.rejections, core.sway
    noise, side, t = f.noises[core.seen.quality], SideLoad(side_of(inputs), core.smooth.bend), core.seen.t
    gap = min(inputs.t - t, LONGEST_GAP_S) if t >= 0.0 else dt
    crab = with_crab(core, fix, side, gap)
    seen, wheel = _checked_wheels(f, core, inputs, fix, side)
    slip = _slip(f, core, inputs.pitch, side, seen.speed, wheel, dt)
    rows, used = no_fix(mean.size), (False, False, False)
    if search.active:
        mean, P = at_fix(mean, P, fix, noise)
        since = r.accepted_t if r.probation else inputs.t
        r = Rejections(since, r.probation, r.position, r.velocity, r.positions, r.velocities, r.restarts)
        mean, P, search = _update_yaw_search(f, mean, P, search, wheel, fix, side)
    else:
        rows = _rows(f, core, fix, gap, sway, side)
        consistent, restart, r = _gated_position(f.gates, rows, r, inputs.t)
        if restart:
            mean, P = at_fix(mean, P, fix, noise)
        moving, lost, r = _gated_velocity(f.gates, rows, r)
        if lost:
            search = Search(True, 0.0, 0.0, 0.0)
        if moving and abs(mean[V]) >= SLIPPING_SPEED and not implausible(crab, core.smooth.bend):
            sigma = f.levels.velocity_sigma / mean[V]
            variation = variation.after(rows.innovation[3] / mean[V], sigma * sigma, gap)
        used = consistent, moving, _is_probable(f.gates, P, rows)
    core = Core(mean, P, search, core.lever, r, seen, core.smooth, slip, variation, crab, core.nis)
    return core, wheel, rows, used


@jit
def _checked_wheels(f: FullFilter, core: Core, inputs: Inputs, fix: Fix, side: SideLoad) -> tuple[Seen, float]:
    """Return the properties of the fix, and the wheel speed [m/s], which is NaN if the wheels spin or slide. Wheels
    spin or slide if their speed differs from a fix speed that has not jumped."""
    speed, last, searching = _ground_speed(core, fix, side), core.seen, core.search.active
    jump = abs(speed - last.speed) > JUMP_M_S2 * (inputs.t - last.t)
    apart = abs(speed - (abs(inputs.wheel) if searching else inputs.wheel)) > f.gates.velocity
    jumped = apart and (jump or last.jumped)
    return Seen(inputs.t, last.quality, speed, jumped), nan if apart and not jumped else inputs.wheel


@jit
def _ground_speed(core: Core, fix: Fix, side: SideLoad) -> float:
    """Return the speed of a fix [m/s], negative if the tractor moves against its course (slides backwards)."""
    speed = sqrt(fix.vx * fix.vx + fix.vy * fix.vy)
    if core.search.active:
        return speed
    chi = course(core.mean, side)
    return copysign(speed, fix.vx * cos(chi) + fix.vy * sin(chi))


@jit
def _slip(f: FullFilter, core: Core, pitch: float, side: SideLoad, speed: float, wheel: float, dt: float) -> WheelSlip:
    if abs(speed) < SLIPPING_SPEED or core.search.active or not isfinite(wheel):
        return WheelSlip(0.0, 0.0, core.slip.memory)
    scale = wheel_scale(core.mean, pitch, braking(pitch, core.mean[V], side, f.levels))
    s_v, s_w = f.levels.velocity_sigma, f.levels.wheel_sigma
    variance = (s_v * s_v + s_w * s_w) / (speed * speed)
    return core.slip.after(wheel / (scale * speed) - 1.0, variance, core.covariance[K, K], dt)


@jit
def _rows(f: FullFilter, core: Core, fix: Fix, gap: float, sway: float, side: SideLoad) -> FixRows:
    (east, north), s_v, s_h = core.lever.offset, f.levels.velocity_sigma, f.levels.heading_sigma
    course_variance = sway / gap
    numbers = FixNumbers(fix.x, fix.y, fix.vx, fix.vy, fix.heading, east, north, s_v * s_v, course_variance, s_h * s_h)
    return fix_rows(core.mean, core.covariance, numbers, f.noises[core.seen.quality], side)


@jit
def _gated_position(gates: Gates, rows: FixRows, r: Rejections, t: float) -> tuple[bool, bool, Rejections]:
    """Return whether a position passes its gate, whether the position restarts from the fix, and the new rejection
    counts."""
    y = rows.innovation
    if rows.position_nis < gates.nis or sqrt(y[0] * y[0] + y[1] * y[1]) < gates.position:
        return True, False, count_accepted_fix(r, t)
    restart = r.position + 1 >= gates.patience
    refused, restarts = 0 if restart else r.position + 1, r.restarts + 1 if restart else r.restarts
    probation = gates.patience if restart or r.probation else 0
    return (
        False,
        restart,
        Rejections(r.accepted_t, probation, refused, r.velocity, r.positions + 1, r.velocities, restarts),
    )


@jit
def _gated_velocity(gates: Gates, rows: FixRows, r: Rejections) -> tuple[bool, bool, Rejections]:
    """Return whether a velocity passes its gate, whether the search for the yaw restarts, and the new rejection
    counts."""
    y, t = rows.innovation, r.accepted_t
    if rows.velocity_nis < gates.nis or sqrt(y[2] * y[2] + y[3] * y[3]) < gates.velocity:
        return True, False, Rejections(t, r.probation, r.position, 0, r.positions, r.velocities, r.restarts)
    lost = r.velocity + 1 >= gates.patience
    refused, restarts = 0 if lost else r.velocity + 1, r.restarts + 1 if lost else r.restarts
    probation = gates.patience if lost else r.probation
    return False, lost, Rejections(t, probation, r.position, refused, r.positions, r.velocities + 1, restarts)


@jit
def _is_probable(gates: Gates, P: Matrix, rows: FixRows) -> bool:
    """Return whether a fix has a two-antenna heading that passes its gate."""
    innovation = rows.innovation[4]
    if P.shape[0] == N or not isfinite(innovation):
        return False
    variance = P[PSI, PSI] + 2.0 * P[PSI, MOUNT] + P[MOUNT, MOUNT] + rows.variance[4]
    return bool(innovation * innovation < gates.nis * variance)


@jit
def _update_yaw_search(
    f: FullFilter, mean: Vector, P: Matrix, search: Search, wheel: float, fix: Fix, side: SideLoad
) -> tuple[Vector, Matrix, Search]:
    """Return the mean, the covariance and the state of the yaw search after a fix. A two-antenna heading ends the
    search."""
    if isfinite(fix.heading):
        innovation = wrap(fix.heading - (mean[PSI] + mean[MOUNT]))
        mean, P = rotate_yaw(mean, P, innovation, f.levels.heading_sigma)
        return mean, P, FOUND
    if abs(wheel) > SEARCH_SPEED:  # false for a missing wheel speed, whose sign is unknown
        chi = course(mean, side)
        c, s, east, north = cos(chi), sin(chi), wheel * fix.vx, wheel * fix.vy
        along, across = search.along + (east * c + north * s), search.across + (north * c - east * s)
        search = Search(True, along, across, search.weight + wheel * wheel)
    s_v = f.levels.velocity_sigma
    if search.weight * (ALIGNMENT_SIGMA * ALIGNMENT_SIGMA) < s_v * s_v:
        return mean, P, search
    mean, P = rotate_yaw(mean, P, atan2(search.across, search.along), ALIGNED_SIGMA)
    return mean, P, FOUND
