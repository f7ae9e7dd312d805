"""Model of the estimator `ekf_full`: fourteen states, how they move, and what the sensors see of them.

    x, y      R, the point below the rear axle [m]          b_g  bias of the gyro [rad/s]
    psi       heading, not wrapped [rad]                    b_s  bias of the steering angle [rad]
    v         speed of R along its course [m/s]             g_e, g_n  correlated error of a fix [-]
    omega     yaw rate [rad/s]                              k    relative error of the wheel speed [-]
    c         compliance of the rear tyres [rad s2/m]       d    offset of the turn [m]
    s         slip of the driven wheels per pull [s2/m]      l    antenna ahead of R [m]

    x' = v cos(chi),  y' = v sin(chi),  psi' = omega,    chi = psi + beta
    beta = -c f (1 + 1.1 (f / g)^2) - d kappa,    f = v^2 kappa + a

chi is the course of R; the sideslip beta follows from the specific side force, in which a is the part of gravity on a
side slope [m/s2], known with an IMU only, and from the curvature kappa of the bend: what resists the turn of the rear
wheels moves the point that rolls straight by d. Without a the heading takes up the crab of a slope. kappa is the
smoothed one of the steering angle and fades at a standstill: a bump turns the body about its centre, not about R; taken
for a bend, rough ground would show a d of half a metre, and every arc a heading off by 4 deg.
g is first-order Gauss-Markov [Brown2012] in units of its standard deviation; v, omega, the biases, k, c, s and l are
random walks over time, and d, which changes with the ground, one along the way. l is the shift of the antenna by a
constant pitch, or by a constant error of the measured one: under an implement or in soft soil a tractor pitches by half
a degree, 3 cm at the roof of a cab. Roll that is not measured follows from the side force of the bend. The course also
sways about chi, by white noise whose density `sideslip_noise` learns from the fixes. A step is the midpoint rule, where
the Euler step of the paper's EKF turns half a tick too late.
After the first heading from two antennas there are two more states: the sideslip b beyond the modelled one, a random
walk by which beta is larger, and the mounting error m, 0 until the sideslip is implausible (`mounting`).
Measurements, each a row of innovation, Jacobian and variance:

    gyro = omega + b_g,    wheel speed = (1 + k - s g sin(pitch)) v / cos(pitch),
    0 = omega - v tan(delta - b_s) / L,
    fix = (x, y) + s g + l (cos(psi), sin(psi)),    its velocity = v along chi, l v kappa across,
    its heading = psi + m
    at a standstill 0 = v, 0 = omega
"""

from math import cos, exp, radians, sin, sqrt, tan
from typing import NamedTuple

import numpy as np

from agrobot_mj.core.geometry import wrap
from agrobot_mj.core.signals import Array, Fix
from agrobot_mj.machine.tractor import GRAVITY

N = 14
X, Y, PSI, V, OMEGA, B_G, B_S, G_E, G_N, K, C, D, S, AHEAD = range(N)
BETA, MOUNT = N, N + 1
"""Indices of the sideslip beyond the modelled one and of the mounting error, where the mean has these last states."""
SCALE_LIMIT = 0.3
"""Largest relative error of the wheel speed [-]. Assumed value: beyond it wheels spin or slide."""


class FullLevels(NamedTuple):
    """Noise of the model and of the sensors; walks per root of a second, sigmas per reading."""

    wheelbase: float
    """Wheelbase L [m]."""
    walks: tuple[float, ...]
    """Random walk of x, y, psi, v, omega, b_g, b_s, k, c, s and l, in their units [.../sqrt(s)]."""
    gyro_sigma: float
    """Noise of the gyro [rad/s]."""
    wheel_sigma: float
    """Noise of the wheel speed [m/s]."""
    steer_sigma: float
    """Noise of the yaw rate that follows from the steering angle [rad/s]."""
    velocity_sigma: float
    """Noise of the GNSS velocity, per axis [m/s]."""
    lean_slip_walk: float = 0.001
    """Random walk of k per specific force of gravity along the ground [s2/m/sqrt(s)]."""
    heading_sigma: float = radians(0.25)
    """Error of the heading from two antennas [rad]."""
    sideslip_walk: float = radians(0.1)
    """Random walk of the sideslip beyond the modelled one [rad/sqrt(s)]."""
    sideslip_sigma: float = radians(2.0)
    """Standard deviation of that sideslip at the first heading from two antennas [rad]."""
    turn_offset_walk: float = 0.004
    """Random walk of d along the way [m/sqrt(m)]."""
    roll: float = 0.0
    """Roll, outwards, per specific side force of a bend, where it is not measured [rad s2/m]."""


class FixNoise(NamedTuple):
    """Believed error of the position of a fix of one quality."""

    correlated: float
    """Standard deviation of the correlated part, s [m]."""
    white: float
    """Standard deviation of the white part [m]."""
    correlation_time: float
    """Correlation time of the correlated part [s]."""


class MeasurementRow(NamedTuple):
    """One scalar measurement, linearised."""

    innovation: float
    """Measured less expected."""
    jacobian: dict[int, float]
    """Derivatives by the states that it depends on."""
    variance: float
    """Variance of its noise."""


class SideLoad(NamedTuple):
    """What the sideslip follows from besides the states."""

    gravity: float = 0.0
    """Part of gravity in the specific side force [m/s2]."""
    bend: float = 0.0
    """Curvature of the bend [1/m]."""


SOFTENING = 1.1
"""Growth of the compliance with the square of the side force over the load [-]. Assumed value: 1.0-1.2 for
`magic_formula` on slopes of 12 to 28 deg."""
SLOW = 0.3
"""Speed below which there is no bend [m/s]. Assumed value: ten times its uncertainty."""
STANDING_SPEED_SIGMA, STANDING_TURN_SIGMA = 0.01, radians(0.02)
"""How far from zero a tractor that stands may move [m/s] and turn [rad/s]. Assumed value: it rocks on its tyres."""


def sideslip(mean: Array, v: float, side: SideLoad) -> float:
    """Course less heading, beta [rad], at a speed [m/s]."""
    return (float(mean[BETA]) if len(mean) > BETA else 0.0) - modelled_crab(mean, v, side)


def modelled_crab(mean: Array, v: float, side: SideLoad) -> float:
    """Sideslip that side force and bend explain, to the right positive [rad], at a speed [m/s]."""
    return float(mean[C]) * _stretched(v, side)[0] + float(mean[D]) * side.bend * _moving(v)[0]


def _stretched(v: float, side: SideLoad) -> tuple[float, float]:
    """Specific side force as the tyres answer it, softer towards their grip [m/s2], and its derivative by v [1/s]."""
    force = v * v * side.bend + side.gravity
    square = SOFTENING * (force / GRAVITY) ** 2
    return force * (1.0 + square), 2.0 * v * side.bend * (1.0 + 3.0 * square)


def course(mean: Array, side: SideLoad) -> float:
    """Direction in which R moves, chi [rad]."""
    return float(mean[PSI]) + sideslip(mean, float(mean[V]), side)


def course_slopes(mean: Array, side: SideLoad) -> dict[int, float]:
    """Derivatives of the course by the states that it depends on."""
    v, c, d = (float(mean[i]) for i in (V, C, D))
    share, by_v = _moving(v)
    force, force_by_v = _stretched(v, side)
    slopes = {PSI: 1.0, V: -c * force_by_v - d * by_v * side.bend, C: -force, D: -side.bend * share}
    return slopes | ({BETA: 1.0} if len(mean) > BETA else {})


def _moving(v: float) -> tuple[float, float]:
    """Share of a bend that counts at a speed, which fades below `SLOW` [-], and its derivative [s/m]."""
    square = v * v + SLOW * SLOW
    return v * v / square, 2 * v * SLOW * SLOW / (square * square)


def propagate_mean(mean: Array, side: SideLoad, dt: float, decay: float) -> Array:
    """Mean, of the same shape, after `dt` [s]; `decay` is that of g [-]."""
    v, omega = float(mean[V]), float(mean[OMEGA])
    chi = course(mean, side) + 0.5 * omega * dt
    after = mean.copy()
    after[X] += v * dt * cos(chi)
    after[Y] += v * dt * sin(chi)
    after[PSI] += omega * dt
    after[G_E] *= decay
    after[G_N] *= decay
    return after


def transition(mean: Array, side: SideLoad, dt: float, decay: float) -> Array:
    """Derivative of `propagate_mean` by the mean, shape (n, n) for a mean (n,)."""
    v, omega = float(mean[V]), float(mean[OMEGA])
    chi = course(mean, side) + 0.5 * omega * dt
    east, north = dt * cos(chi), dt * sin(chi)
    F = np.eye(len(mean))
    for state, slope in course_slopes(mean, side).items():
        F[X, state], F[Y, state] = -v * north * slope, v * east * slope
    F[X, OMEGA], F[Y, OMEGA] = -0.5 * dt * v * north, 0.5 * dt * v * east
    F[X, V] += east
    F[Y, V] += north
    F[PSI, OMEGA] = dt
    F[G_E, G_E] = F[G_N, G_N] = decay
    return F


def process_noise(levels: FullLevels, dt: float, correlation_time: float, n: int = N) -> tuple[float, Array]:
    """Decay of g over `dt` [s] and covariance (n, n) of what moves the states besides."""
    decay = exp(-dt / correlation_time)
    q = np.zeros(n)
    q[BETA : BETA + 1] = dt * levels.sideslip_walk**2
    q[[X, Y, PSI, V, OMEGA, B_G, B_S, K, C, S, AHEAD]] = dt * np.square(levels.walks)
    q[[G_E, G_N]] = 1.0 - decay * decay
    Q = np.diag(q)
    # a yaw rate that changes within the tick turns by half of the change: without that the heading lags in every bend;
    # inertia keeps the change smooth, so that it adds nothing to the noise of the heading
    turn = dt * levels.walks[OMEGA] ** 2
    Q[PSI, OMEGA] = Q[OMEGA, PSI] = 0.5 * dt * turn
    Q[PSI, PSI] += 0.25 * dt * dt * turn
    return decay, Q


def gyro_row(mean: Array, gyro: float, levels: FullLevels) -> MeasurementRow:
    """The gyro's yaw rate [rad/s]."""
    return MeasurementRow(gyro - float(mean[OMEGA] + mean[B_G]), {OMEGA: 1.0, B_G: 1.0}, levels.gyro_sigma**2)


def wheel_scale(mean: Array, pitch: float) -> float:
    """Wheel speed over the speed of R in the horizontal plane [-]: scale error, slip on a climb, slope."""
    return (1.0 + float(mean[K]) - float(mean[S]) * GRAVITY * sin(pitch)) / cos(pitch)


def wheel_row(mean: Array, wheel: float, pitch: float, cruise: float, levels: FullLevels) -> MeasurementRow:
    """The wheels' speed along the ground [m/s] on a tractor with this pitch [rad].

    The slopes by the scale are those at the speed `cruise` [m/s], which must not share the noise of v: speed and scale
    are told apart by nothing in a loss of fixes, and slopes that change with every reading would pretend they were.
    """
    v, scale, along = float(mean[V]), wheel_scale(mean, pitch), cruise / cos(pitch)
    jacobian = {V: scale, K: along, S: -along * GRAVITY * sin(pitch)}
    return MeasurementRow(wheel - scale * v, jacobian, levels.wheel_sigma**2)


def steer_row(mean: Array, steer: float, levels: FullLevels) -> MeasurementRow:
    """The steering angle [rad] as a statement on the yaw rate; on the speed it is none, since front tyres slip."""
    v, delta, L = float(mean[V]), steer - float(mean[B_S]), levels.wheelbase
    jacobian = {OMEGA: 1.0, B_S: v * (1.0 + tan(delta) ** 2) / L}
    return MeasurementRow(v * tan(delta) / L - float(mean[OMEGA]), jacobian, levels.steer_sigma**2)


def standing_rows(mean: Array) -> list[MeasurementRow]:
    """A tractor that stands neither moves nor turns."""
    return [
        MeasurementRow(-float(mean[V]), {V: 1.0}, STANDING_SPEED_SIGMA**2),
        MeasurementRow(-float(mean[OMEGA]), {OMEGA: 1.0}, STANDING_TURN_SIGMA**2),
    ]


def position_rows(
    mean: Array, fix: Fix, noise: FixNoise, lever: tuple[float, float] = (0.0, 0.0)
) -> list[MeasurementRow]:
    """Position of a fix at R [m], to which the antenna's `lever`, east and north [m], led; it turns with the yaw."""
    s, r, ahead = noise.correlated, noise.white**2, float(mean[AHEAD])
    c_psi, s_psi = cos(float(mean[PSI])), sin(float(mean[PSI]))
    east, north = lever[0] + ahead * c_psi, lever[1] + ahead * s_psi
    off_x = fix.x - float(mean[X] + s * mean[G_E]) - ahead * c_psi
    off_y = fix.y - float(mean[Y] + s * mean[G_N]) - ahead * s_psi
    return [
        MeasurementRow(off_x, {X: 1.0, G_E: s, PSI: -north, AHEAD: c_psi}, r),
        MeasurementRow(off_y, {Y: 1.0, G_N: s, PSI: east, AHEAD: s_psi}, r),
    ]


def velocity_rows(mean: Array, fix: Fix, levels: FullLevels, side: SideLoad, sway: float = 0.0) -> list[MeasurementRow]:
    """Velocity of a fix at R [m/s], along the course and across; the course sways with a variance `sway` [rad2]."""
    v, chi, slopes = float(mean[V]), course(mean, side), course_slopes(mean, side)
    aside, r = float(mean[AHEAD]) * v * side.bend, levels.velocity_sigma**2
    along, across = fix.vx * cos(chi) + fix.vy * sin(chi), fix.vy * cos(chi) - fix.vx * sin(chi)
    by_along = {state: -aside * slope for state, slope in slopes.items()}
    by_across = {state: v * slope for state, slope in slopes.items()}
    by_along[V] += 1.0
    by_across[V] += float(mean[AHEAD]) * side.bend
    by_across[AHEAD] = v * side.bend
    return [
        MeasurementRow(along - v, by_along, r),
        MeasurementRow(across - aside, by_across, r + v * v * sway),
    ]


def heading_row(mean: Array, fix: Fix, levels: FullLevels) -> MeasurementRow:
    """Heading of a fix from two antennas [rad], for a mean (16,)."""
    innovation = wrap(fix.heading - float(mean[PSI] + mean[MOUNT]))
    return MeasurementRow(innovation, {PSI: 1.0, MOUNT: 1.0}, levels.heading_sigma**2)


def with_sideslip(mean: Array, covariance: Array, sigma: float) -> tuple[Array, Array]:
    """Mean (16,) and covariance (16, 16) with a sideslip beyond the model of `sigma` [rad] and no mounting error."""
    P = np.zeros((N + 2, N + 2))
    P[:N, :N], P[BETA, BETA] = covariance, sigma * sigma
    return np.append(mean, (0.0, 0.0)), P


def squared_innovation(pair: list[MeasurementRow], covariance: Array) -> float:
    """NIS of a pair of rows against the covariance (n, n) of the states [-]."""
    (a, b), P = pair, covariance
    s_aa = _quadratic(a.jacobian, a.jacobian, P) + a.variance
    s_bb = _quadratic(b.jacobian, b.jacobian, P) + b.variance
    s_ab = _quadratic(a.jacobian, b.jacobian, P)
    y_a, y_b = a.innovation, b.innovation
    return (s_bb * y_a * y_a - 2 * s_ab * y_a * y_b + s_aa * y_b * y_b) / (s_aa * s_bb - s_ab * s_ab)


def _quadratic(left: dict[int, float], right: dict[int, float], P: Array) -> float:
    return sum(h * k * float(P[i, j]) for i, h in left.items() for j, k in right.items())


def steady_gain(walk: float, sigma: float, dt: float) -> float:
    """Gain of the steady Kalman filter of a random walk, `walk` per root of a second, seen with `sigma` [-]."""
    q = walk * walk * dt / (sigma * sigma)
    return 0.5 * (sqrt(q * q + 4.0 * q) - q)
