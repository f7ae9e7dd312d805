"""Model of the estimator `ekf_full`: fourteen states, their dynamics, and the measurement equations of the sensors.

    x, y      R, the point below the rear axle [m]          b_g  bias of the gyro [rad/s]
    psi       heading, not wrapped [rad]                    b_s  bias of the steering angle [rad]
    v         speed of R along its course [m/s]             g_e, g_n  correlated error of a fix [-]
    omega     yaw rate [rad/s]                              k    relative error of the wheel speed [-]
    c         compliance of the rear tyres [rad s2/m]       d    turn offset [m]
    s         slip of the driven wheels per pull [s2/m]     l    antenna ahead of R [m]

    x' = v cos(chi),  y' = v sin(chi),  psi' = omega,    chi = psi + beta
    beta = -c f (1 + 1.1 (f / g)^2) - d kappa,    f = v^2 kappa + a

chi is the course of R. The sideslip beta depends on the specific side force f and on the curvature kappa of the bend. a
is the gravity component on a side slope [m/s2], known only with an IMU; without a, the heading estimate includes the
crab angle of a slope. The resistance of the rear wheels against turning moves the point without sideslip by the turn
offset d. kappa is smoothed, from the steering angle, and fades at standstill, because a bump turns the body about its
centre and not about R. Taken as a bend, rough ground would give a d of half a metre and heading errors of 4 deg on
arcs. g is first-order Gauss-Markov [Brown2012] in units of its standard deviation. v, omega, the biases, k, c, s and l
are random walks with time; d, which changes with the ground, is a random walk with distance. l is the shift of the
antenna by a constant pitch or pitch error: an implement or soft soil pitches the tractor by half a degree, 3 cm at a
cab roof. Unmeasured roll follows from the side force of the bend. The course also varies about chi by white noise,
whose density `sideslip_noise` estimates from the fixes. The midpoint rule avoids the half-tick delay of the paper's
Euler step. After the first heading from two antennas there are two more states: the excess sideslip b, a random walk
added to beta, and the mounting error m, 0 until the sideslip is implausible (`mounting`). Measurements, each a row of
innovation, Jacobian and variance:

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
"""Indices of the excess sideslip and the mounting error, the last states of a mean of length 16."""
SCALE_LIMIT = 0.3
"""Maximum relative error of the wheel speed [-]. Assumed value: at larger errors the wheels spin or slide."""


class FullLevels(NamedTuple):
    """Noise of model and sensors: random walks per square root of a second, standard deviations per measurement."""

    wheelbase: float
    """Wheelbase L [m]."""
    walks: tuple[float, ...]
    """Random walk of x, y, psi, v, omega, b_g, b_s, k, c, s and l, in their units [.../sqrt(s)]."""
    gyro_sigma: float
    """Noise of the gyro [rad/s]."""
    wheel_sigma: float
    """Noise of the wheel speed [m/s]."""
    steer_sigma: float
    """Noise of the yaw rate derived from the steering angle [rad/s]."""
    velocity_sigma: float
    """Noise of the GNSS velocity, per axis [m/s]."""
    lean_slip_walk: float = 0.001
    """Random walk of k divided by the gravity component along the ground [s2/m/sqrt(s)]."""
    heading_sigma: float = radians(0.25)
    """Error of the heading from two antennas [rad]."""
    sideslip_walk: float = radians(0.1)
    """Random walk of the excess sideslip [rad/sqrt(s)]."""
    sideslip_sigma: float = radians(2.0)
    """Standard deviation of the excess sideslip at the first heading from two antennas [rad]."""
    turn_offset_walk: float = 0.004
    """Random walk of the turn offset d with distance [m/sqrt(m)]."""
    roll: float = 0.0
    """Unmeasured outward roll divided by the specific side force of a bend [rad s2/m]."""


class FixNoise(NamedTuple):
    """Modelled position error of a fix of one quality."""

    correlated: float
    """Standard deviation s of the time-correlated position error [m]."""
    white: float
    """Standard deviation of the white position error [m]."""
    correlation_time: float
    """Correlation time of the correlated position error [s]."""


class MeasurementRow(NamedTuple):
    """Linearised scalar measurement."""

    innovation: float
    """Measured minus expected value."""
    jacobian: dict[int, float]
    """Derivatives with respect to the states, by state index."""
    variance: float
    """Variance of the measurement noise."""


class SideLoad(NamedTuple):
    """Inputs of the sideslip model in addition to the states."""

    gravity: float = 0.0
    """Gravity component of the specific side force [m/s2]."""
    bend: float = 0.0
    """Curvature of the bend [1/m]."""


SOFTENING = 1.1
"""Growth of the compliance with the squared ratio of side force to load [-]. Assumed value: 1.0-1.2 for `magic_formula`
on slopes of 12 to 28 deg."""
SLOW = 0.3
"""Speed below which the bend fades out [m/s]. Assumed value: ten times its uncertainty."""
STANDING_SPEED_SIGMA, STANDING_TURN_SIGMA = 0.01, radians(0.02)
"""Standard deviations of speed [m/s] and yaw rate [rad/s] at standstill. Assumed value: compliant tyres."""


def sideslip(mean: Array, v: float, side: SideLoad) -> float:
    """Return the sideslip beta, rear-axle course minus heading [rad], at a speed [m/s]."""
    return (float(mean[BETA]) if len(mean) > BETA else 0.0) - modelled_crab(mean, v, side)


def modelled_crab(mean: Array, v: float, side: SideLoad) -> float:
    """Return the sideslip by side force and bend, positive to the right [rad], at a speed [m/s]."""
    return float(mean[C]) * _stretched(v, side)[0] + float(mean[D]) * side.bend * _moving(v)[0]


def _stretched(v: float, side: SideLoad) -> tuple[float, float]:
    """Return the specific side force scaled by tyre softening [m/s2], and its derivative with respect to v [1/s]."""
    force = v * v * side.bend + side.gravity
    square = SOFTENING * (force / GRAVITY) ** 2
    return force * (1.0 + square), 2.0 * v * side.bend * (1.0 + 3.0 * square)


def course(mean: Array, side: SideLoad) -> float:
    """Return the course chi, the direction of motion of the rear-axle point R [rad]."""
    return float(mean[PSI]) + sideslip(mean, float(mean[V]), side)


def course_slopes(mean: Array, side: SideLoad) -> dict[int, float]:
    """Return the derivatives of the course with respect to the states, by state index."""
    v, c, d = (float(mean[i]) for i in (V, C, D))
    weight, by_v = _moving(v)
    force, force_by_v = _stretched(v, side)
    slopes = {PSI: 1.0, V: -c * force_by_v - d * by_v * side.bend, C: -force, D: -side.bend * weight}
    return slopes | ({BETA: 1.0} if len(mean) > BETA else {})


def _moving(v: float) -> tuple[float, float]:
    """Return the weight of a bend at a speed, which fades below `SLOW` [-], and its derivative [s/m]."""
    square = v * v + SLOW * SLOW
    return v * v / square, 2 * v * SLOW * SLOW / (square * square)


def propagate_mean(mean: Array, side: SideLoad, dt: float, decay: float) -> Array:
    """Return the mean, of the same shape, after `dt` [s]; `decay` is the factor of the correlated fix error g [-]."""
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
    """Return the derivative of `propagate_mean` with respect to the mean, shape (n, n) for a mean (n,)."""
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
    """Return the decay factor of the correlated fix error g during `dt` [s] and the process noise (n, n)."""
    decay = exp(-dt / correlation_time)
    q = np.zeros(n)
    q[BETA : BETA + 1] = dt * levels.sideslip_walk**2
    q[[X, Y, PSI, V, OMEGA, B_G, B_S, K, C, S, AHEAD]] = dt * np.square(levels.walks)
    q[[G_E, G_N]] = 1.0 - decay * decay
    Q = np.diag(q)
    # the heading changes by half of the yaw-rate change in a tick, or it would lag in bends;
    # inertia keeps the change smooth, so that the noise of the heading does not grow
    turn = dt * levels.walks[OMEGA] ** 2
    Q[PSI, OMEGA] = Q[OMEGA, PSI] = 0.5 * dt * turn
    Q[PSI, PSI] += 0.25 * dt * dt * turn
    return decay, Q


def gyro_row(mean: Array, gyro: float, levels: FullLevels) -> MeasurementRow:
    """Return the measurement row of the gyro's yaw rate [rad/s]."""
    return MeasurementRow(gyro - float(mean[OMEGA] + mean[B_G]), {OMEGA: 1.0, B_G: 1.0}, levels.gyro_sigma**2)


def wheel_scale(mean: Array, pitch: float) -> float:
    """Return wheel speed divided by horizontal rear-axle speed [-]: scale error, slip on a climb, slope."""
    return (1.0 + float(mean[K]) - float(mean[S]) * GRAVITY * sin(pitch)) / cos(pitch)


def wheel_row(mean: Array, wheel: float, pitch: float, cruise: float, levels: FullLevels) -> MeasurementRow:
    """Return the measurement row of the wheel speed along the ground [m/s] for a tractor with this pitch [rad].

    The derivatives with respect to the scale use the low-pass filtered speed `cruise` [m/s]. Derivatives with the noise
    of v would make speed and scale appear separately observable during a loss of fixes.
    """
    v, scale, along = float(mean[V]), wheel_scale(mean, pitch), cruise / cos(pitch)
    jacobian = {V: scale, K: along, S: -along * GRAVITY * sin(pitch)}
    return MeasurementRow(wheel - scale * v, jacobian, levels.wheel_sigma**2)


def steer_row(mean: Array, steer: float, levels: FullLevels) -> MeasurementRow:
    """Return the measurement row of the steering angle [rad], for the yaw rate only, since front tyres slip."""
    v, delta, L = float(mean[V]), steer - float(mean[B_S]), levels.wheelbase
    jacobian = {OMEGA: 1.0, B_S: v * (1.0 + tan(delta) ** 2) / L}
    return MeasurementRow(v * tan(delta) / L - float(mean[OMEGA]), jacobian, levels.steer_sigma**2)


def standing_rows(mean: Array) -> list[MeasurementRow]:
    """Return the measurement rows of a tractor at standstill: zero speed and zero yaw rate."""
    return [
        MeasurementRow(-float(mean[V]), {V: 1.0}, STANDING_SPEED_SIGMA**2),
        MeasurementRow(-float(mean[OMEGA]), {OMEGA: 1.0}, STANDING_TURN_SIGMA**2),
    ]


def position_rows(
    mean: Array, fix: Fix, noise: FixNoise, lever: tuple[float, float] = (0.0, 0.0)
) -> list[MeasurementRow]:
    """Return the measurement rows of the rear-axle position [m]; `lever`, east and north [m], turns with the yaw."""
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
    """Return the measurement rows of the rear-axle velocity along and across the course, of variance `sway` [rad2]."""
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
    """Return the measurement row of the heading from two antennas [rad], for a mean (16,)."""
    innovation = wrap(fix.heading - float(mean[PSI] + mean[MOUNT]))
    return MeasurementRow(innovation, {PSI: 1.0, MOUNT: 1.0}, levels.heading_sigma**2)


def with_sideslip(mean: Array, covariance: Array, sigma: float) -> tuple[Array, Array]:
    """Return mean (16,) and covariance (16, 16) with an excess sideslip of `sigma` [rad] and zero mounting error."""
    P = np.zeros((N + 2, N + 2))
    P[:N, :N], P[BETA, BETA] = covariance, sigma * sigma
    return np.append(mean, (0.0, 0.0)), P


def squared_innovation(pair: list[MeasurementRow], covariance: Array) -> float:
    """Return the normalised innovation squared (NIS) of two measurement rows, for the state covariance (n, n) [-]."""
    (a, b), P = pair, covariance
    s_aa = _quadratic(a.jacobian, a.jacobian, P) + a.variance
    s_bb = _quadratic(b.jacobian, b.jacobian, P) + b.variance
    s_ab = _quadratic(a.jacobian, b.jacobian, P)
    y_a, y_b = a.innovation, b.innovation
    return (s_bb * y_a * y_a - 2 * s_ab * y_a * y_b + s_aa * y_b * y_b) / (s_aa * s_bb - s_ab * s_ab)


def _quadratic(left: dict[int, float], right: dict[int, float], P: Array) -> float:
    return sum(h * k * float(P[i, j]) for i, h in left.items() for j, k in right.items())


def steady_gain(walk: float, sigma: float, dt: float) -> float:
    """Return the steady-state Kalman gain of a random walk, `walk` per square root of a second, for noise `sigma`."""
    q = walk * walk * dt / (sigma * sigma)
    return 0.5 * (sqrt(q * q + 4.0 * q) - q)
