"""Measurements of the estimator `ekf_full` as matrix rows, their NIS, and the correction by all rows of a tick.

Each row has an innovation, its Jacobian and its variance; `full_model` lists the equations.
"""

from math import cos, isfinite, nan, pi, radians, sin, tan
from typing import NamedTuple

import numpy as np

from agrobot_mj.core.kernels import jit
from agrobot_mj.core.signals import Matrix, Vector
from agrobot_mj.estimation.equations import posterior
from agrobot_mj.estimation.full_model import (
    AHEAD,
    B_G,
    B_S,
    G_E,
    G_N,
    MOUNT,
    OMEGA,
    PSI,
    SCALE_LIMIT,
    C,
    FixNoise,
    K,
    S,
    SideLoad,
    V,
    X,
    Y,
    course,
    course_slopes,
    wheel_scale,
)

STANDING_SPEED_SIGMA, STANDING_TURN_SIGMA = 0.01, radians(0.3)
"""Standard deviations of speed [m/s] and yaw rate [rad/s] at standstill. Assumed values: due to tyre deflection, a
starting tractor turns at up to 0.4 deg/s before its wheels rotate."""


class FixRows(NamedTuple):
    """Linearised measurements of a fix: position (two rows), velocity along and across the course, and heading."""

    innovation: Vector  # Measured minus expected values, shape (5,)
    jacobian: Matrix  # Derivatives of the expected values with respect to the states, shape (5, n)
    variance: Vector  # Variances of the measurement noise, shape (5,)
    position_nis: float  # Normalised innovation squared (NIS) of the position [-]
    velocity_nis: float  # Normalised innovation squared (NIS) of the velocity [-]


class FixNumbers(NamedTuple):
    """Fix converted to the rear-axle point R, with the antenna's lever arm and the measurement variances."""

    x: float  # East position of the rear-axle point R [m]
    y: float  # North position of the rear-axle point R [m]
    vx: float  # East velocity of the rear-axle point R [m/s]
    vy: float  # North velocity of the rear-axle point R [m/s]
    heading: float  # Heading from two antennas [rad], or NaN if not measured
    lever_east: float  # East offset of the antenna from the rear-axle point R [m], which rotates with the yaw
    lever_north: float  # North offset of the antenna from the rear-axle point R [m]
    velocity_variance: float  # Variance of the velocity per axis [m2/s2]
    course_variance: float  # Variance of the course due to its random variation [rad2]
    heading_variance: float  # Variance of the heading [rad2]


class MotionReadings(NamedTuple):
    """Measurements of the tractor motion in one tick; a missing steering angle, yaw rate or wheel speed is NaN."""

    steer: float = nan  # Measured steering angle [rad]
    gyro: float = nan  # Yaw rate measured by the gyro [rad/s]
    wheel: float = nan  # Measured wheel speed along the ground [m/s]
    pitch: float = 0.0  # Pitch of the tractor [rad]
    braked: float = 0.0  # Relative braking force of the rear tyres [m/s2], see `braking`
    cruise: float = 0.0  # Low-pass filtered speed of the tractor [m/s]
    standing: bool = False  # Whether the tractor is at standstill


class MotionNoise(NamedTuple):
    """Noise variances of the motion measurements, and wheelbase of the tractor."""

    wheelbase: float  # Wheelbase of the tractor [m]
    steer: float  # Variance of the yaw rate derived from the steering angle [rad2/s2]
    gyro: float  # Variance of the yaw rate from the gyro [rad2/s2]
    wheel: float  # Variance of the wheel speed [m2/s2]


@jit
def motion_rows(mean: Vector, m: MotionReadings, noise: MotionNoise, y: Vector, H: Matrix, R: Matrix) -> int:
    """Write the rows of steering angle, gyro, wheel speed and standstill to innovation y, Jacobian H and covariance R.

    The result is the number of rows. The steering angle does not correct the speed, because the front tyres slip. The
    derivatives with respect to the wheel scale use the low-pass filtered speed. Due to the noise of v, speed and scale
    would otherwise appear to be separately observable during a loss of fixes.
    """
    v, omega, k = mean[V], mean[OMEGA], 0
    if isfinite(m.steer):
        slope = tan(m.steer - mean[B_S])
        H[k, OMEGA], H[k, B_S] = 1.0, v * (1.0 + slope * slope) / noise.wheelbase
        y[k], R[k, k], k = v * slope / noise.wheelbase - omega, noise.steer, k + 1
    if isfinite(m.gyro):
        H[k, OMEGA] = H[k, B_G] = 1.0
        y[k], R[k, k], k = m.gyro - (omega + mean[B_G]), noise.gyro, k + 1
    if isfinite(m.wheel):
        scale, along = wheel_scale(mean, m.pitch, m.braked), m.cruise / cos(m.pitch)
        H[k, V], H[k, K], H[k, S] = scale, along, -along * m.braked
        y[k], R[k, k], k = m.wheel - scale * v, noise.wheel, k + 1
    if m.standing:
        H[k, V] = H[k + 1, OMEGA] = 1.0
        y[k], y[k + 1] = -v, -omega
        R[k, k], R[k + 1, k + 1] = STANDING_SPEED_SIGMA**2, STANDING_TURN_SIGMA**2
        k += 2
    return k


@jit
def fix_rows(mean: Vector, P: Matrix, fix: FixNumbers, noise: FixNoise, side: SideLoad) -> FixRows:
    """Return the measurement rows of a fix, with the NIS of its position and velocity."""
    y, H, R = np.zeros(5), np.zeros((5, mean.size)), np.zeros(5)
    s, ahead, c_psi, s_psi = noise.correlated, mean[AHEAD], cos(mean[PSI]), sin(mean[PSI])
    H[0, X], H[0, G_E], H[0, PSI], H[0, AHEAD] = 1.0, s, -(fix.lever_north + ahead * s_psi), c_psi
    H[1, Y], H[1, G_N], H[1, PSI], H[1, AHEAD] = 1.0, s, fix.lever_east + ahead * c_psi, s_psi
    y[0] = fix.x - (mean[X] + s * mean[G_E]) - ahead * c_psi
    y[1] = fix.y - (mean[Y] + s * mean[G_N]) - ahead * s_psi
    R[0] = R[1] = noise.white * noise.white
    v, chi, slopes = mean[V], course(mean, side), course_slopes(mean, side)
    aside = ahead * v * side.bend
    for state in range(mean.size):
        H[2, state], H[3, state] = -aside * slopes[state], v * slopes[state]
    H[2, V] += 1.0
    H[3, V] += ahead * side.bend
    H[3, AHEAD] = v * side.bend
    y[2] = fix.vx * cos(chi) + fix.vy * sin(chi) - v
    y[3] = fix.vy * cos(chi) - fix.vx * sin(chi) - aside
    R[2], R[3] = fix.velocity_variance, fix.velocity_variance + v * v * fix.course_variance
    if mean.size > MOUNT:
        H[4, PSI] = H[4, MOUNT] = 1.0
        y[4], R[4] = pi - (pi - (fix.heading - (mean[PSI] + mean[MOUNT]))) % (2.0 * pi), fix.heading_variance
    return FixRows(y, H, R, _squared_innovation(0, y, H, R, P), _squared_innovation(2, y, H, R, P))


@jit
def _squared_innovation(a: int, y: Vector, H: Matrix, R: Vector, P: Matrix) -> float:
    """Return the NIS [-] of the two rows `a` and `a` + 1; `P` (n, n) is the covariance of the states."""
    s_aa, s_ab, s_bb = R[a], 0.0, R[a + 1]
    for i in range(P.shape[0]):
        if H[a, i] == 0.0 and H[a + 1, i] == 0.0:
            continue
        for j in range(P.shape[0]):
            s_aa += H[a, i] * H[a, j] * P[i, j]
            s_ab += H[a, i] * H[a + 1, j] * P[i, j]
            s_bb += H[a + 1, i] * H[a + 1, j] * P[i, j]
    y_a, y_b = y[a], y[a + 1]
    return float((s_bb * y_a * y_a - 2 * s_ab * y_a * y_b + s_aa * y_b * y_b) / (s_aa * s_bb - s_ab * s_ab))


@jit
def correct_jointly(
    mean: Vector, P: Matrix, motion: MotionReadings, noise: MotionNoise, fix: FixRows, used: tuple[bool, bool, bool]
) -> tuple[Vector, Matrix]:
    """Return the mean and covariance after a joint correction by the motion measurements and the fix.

    `used` selects position, velocity and heading of the fix. The wheel scale is limited to SCALE_LIMIT. Compliance and
    wheel slip remain positive or zero, because negative values, which cancel other errors in long oscillations, would
    increase.
    """
    y, H, R = np.zeros(10), np.zeros((10, mean.size)), np.zeros((10, 10))
    k = motion_rows(mean, motion, noise, y, H, R)
    for i in range(5):
        if used[i // 2]:
            y[k], R[k, k] = fix.innovation[i], fix.variance[i]
            for j in range(mean.size):
                H[k, j] = fix.jacobian[i, j]
            k += 1
    if k == 0:
        return mean, P
    mean, P, _ = posterior(mean, P, H[:k], y[:k], R[:k, :k].copy())
    mean[K] = min(max(mean[K], -SCALE_LIMIT), SCALE_LIMIT)
    mean[C], mean[S] = max(mean[C], 0.0), max(mean[S], 0.0)
    return mean, P


@jit
def no_fix(n: int) -> FixRows:
    """Return measurement rows that stand for a missing fix, for a filter with `n` states."""
    return FixRows(np.zeros(5), np.zeros((5, n)), np.ones(5), nan, nan)
