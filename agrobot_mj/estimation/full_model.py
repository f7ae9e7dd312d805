"""Model of the estimator `ekf_full`: thirteen states, how they move, and what the sensors see of them.

    x, y      R, the point below the rear axle [m]          b_g  bias of the gyro [rad/s]
    psi       heading, not wrapped [rad]                    b_s  bias of the steering angle [rad]
    v         speed of R along its course [m/s]             g_e, g_n  correlated error of a fix [-]
    omega     yaw rate [rad/s]                              k    relative error of the wheel speed [-]
    c         compliance of the rear tyres [rad s2/m]       d    offset of the turn [m]
    s         slip of the driven wheels per pull [s2/m]

    x' = v cos(chi),  y' = v sin(chi),  psi' = omega,    chi = psi + beta,    beta = -c (v omega + a) - d kappa

chi is the course of R; the sideslip beta follows from the specific side force, in which a is the part of gravity on a
side slope [m/s2], known with an IMU only, and from the curvature kappa of the bend: what resists the turn of the rear
wheels moves the point that rolls straight by d. Without a the heading takes up the crab of a slope. kappa is the
smoothed one of the steering angle and fades at a standstill: a bump turns the body about its centre, not about R; taken
for a bend, rough ground would show a d of half a metre, and every arc a heading off by 4 deg.
g is first-order Gauss-Markov [Brown2012] in units of its standard deviation; v, omega, the biases, k, c, d and s are
random walks. A step is the midpoint rule, where the Euler step of the paper's EKF turns half a tick too late.
Once a heading from two antennas has been heard there is a fourteenth state, the sideslip b beyond the modelled one, a
random walk: beta is larger by b. Measurements, each a row of innovation, Jacobian and variance:

    gyro = omega + b_g,    wheel speed = (1 + k - s g sin(pitch)) v / cos(pitch),    0 = omega - v tan(delta - b_s) / L,
    fix = (x, y) + s g,    its velocity = v (cos(chi), sin(chi)),    its heading = psi
    at a standstill 0 = v, 0 = omega
"""

from math import cos, exp, radians, sin, sqrt, tan
from typing import NamedTuple

import numpy as np

from agrobot_mj.core.geometry import wrap
from agrobot_mj.core.signals import Array, Fix
from agrobot_mj.machine.tractor import GRAVITY

N = 13
X, Y, PSI, V, OMEGA, B_G, B_S, G_E, G_N, K, C, D, S = range(N)
BETA = N
"""Index of the sideslip beyond the modelled one, where the mean has this last state."""


class FullLevels(NamedTuple):
    """Noise of the model and of the sensors; walks per root of a second, sigmas per reading."""

    wheelbase: float
    """Wheelbase L [m]."""
    walks: tuple[float, ...]
    """Random walk of x, y, psi, v, omega, b_g, b_s, k, c, d and s, in their units [.../sqrt(s)]."""
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


SLOW = 0.3
"""Speed below which there is no bend [m/s]. Estimate: ten times its uncertainty."""
STANDING_SPEED_SIGMA, STANDING_TURN_SIGMA = 0.01, radians(0.02)
"""How far from zero a tractor that stands may move [m/s] and turn [rad/s]. Estimate: it rocks on its tyres."""


def sideslip(mean: Array, v: float, omega: float, side: SideLoad) -> float:
    """Course less heading, beta [rad], at a speed [m/s] and yaw rate [rad/s]."""
    modelled = float(mean[C]) * (v * omega + side.gravity) + float(mean[D]) * side.bend * _moving(v)[0]
    return (float(mean[BETA]) if len(mean) > BETA else 0.0) - modelled


def course(mean: Array, side: SideLoad) -> float:
    """Direction in which R moves, chi [rad]."""
    v, omega = float(mean[V]), float(mean[OMEGA])
    return float(mean[PSI]) + sideslip(mean, v, omega, side)


def course_slopes(mean: Array, side: SideLoad) -> dict[int, float]:
    """Derivatives of the course by the states that it depends on."""
    v, omega, c, d = (float(mean[i]) for i in (V, OMEGA, C, D))
    share, by_v = _moving(v)
    by_speed, by_offset = -c * omega - d * side.bend * by_v, -side.bend * share
    slopes = {PSI: 1.0, V: by_speed, OMEGA: -c * v, C: -v * omega - side.gravity, D: by_offset}
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
        slope += 0.5 * dt if state == OMEGA else 0.0
        F[X, state], F[Y, state] = -v * north * slope, v * east * slope
    F[X, V] += east
    F[Y, V] += north
    F[PSI, OMEGA] = dt
    F[G_E, G_E] = F[G_N, G_N] = decay
    return F


def process_noise(levels: FullLevels, dt: float, correlation_time: float, n: int = N) -> tuple[float, Array]:
    """Decay of g over `dt` [s] and covariance (n, n) of what moves the states besides."""
    decay = exp(-dt / correlation_time)
    q = np.zeros(n)
    q[BETA:] = dt * levels.sideslip_walk**2
    q[[X, Y, PSI, V, OMEGA, B_G, B_S, K, C, D, S]] = dt * np.square(levels.walks)
    q[[G_E, G_N]] = 1.0 - decay * decay
    Q = np.diag(q)
    # a yaw rate that changes within the tick turns by half of the change: without that the heading lags in every bend
    turn = dt * levels.walks[OMEGA] ** 2
    Q[PSI, OMEGA] = Q[OMEGA, PSI] = 0.5 * dt * turn
    Q[PSI, PSI] += dt * dt * turn / 3.0
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
    s, r = noise.correlated, noise.white**2
    east, north = lever
    return [
        MeasurementRow(fix.x - float(mean[X] + s * mean[G_E]), {X: 1.0, G_E: s, PSI: -north}, r),
        MeasurementRow(fix.y - float(mean[Y] + s * mean[G_N]), {Y: 1.0, G_N: s, PSI: east}, r),
    ]


def velocity_rows(mean: Array, fix: Fix, levels: FullLevels, side: SideLoad) -> list[MeasurementRow]:
    """Velocity of a fix at R [m/s]."""
    v, chi, slopes = float(mean[V]), course(mean, side), course_slopes(mean, side)
    east, north, r = cos(chi), sin(chi), levels.velocity_sigma**2
    by_east = {state: -v * north * slope for state, slope in slopes.items()}
    by_north = {state: v * east * slope for state, slope in slopes.items()}
    by_east[V] += east
    by_north[V] += north
    return [MeasurementRow(fix.vx - v * east, by_east, r), MeasurementRow(fix.vy - v * north, by_north, r)]


def heading_row(mean: Array, fix: Fix, levels: FullLevels) -> MeasurementRow:
    """Heading of a fix from two antennas [rad]."""
    return MeasurementRow(wrap(fix.heading - float(mean[PSI])), {PSI: 1.0}, levels.heading_sigma**2)


def with_sideslip(mean: Array, covariance: Array, sigma: float) -> tuple[Array, Array]:
    """Mean (14,) and covariance (14, 14) of thirteen states and the sideslip beyond the modelled one, `sigma` [rad]."""
    P = np.zeros((N + 1, N + 1))
    P[:N, :N], P[BETA, BETA] = covariance, sigma * sigma
    return np.append(mean, 0.0), P


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
