"""Model of the estimator `ekf_full`: 14 states, their dynamics, and the measurement equations of the sensors.

  x, y      R, the point below the rear axle [m]          b_g  bias of the gyro [rad/s]
  psi       heading, not wrapped [rad]                    b_s  bias of the steering angle [rad]
  v         speed of R along its course [m/s]             g_e, g_n  correlated error of a fix [-]
  omega     yaw rate [rad/s]                              k    relative error of the wheel speed [-]
  c         compliance of the rear tyres [rad s2/m]       d    turn offset [m]
  s         slip of the driven wheels per pull [s2/m]     l    antenna ahead of R [m]

  x' = v cos(chi),  y' = v sin(chi),  psi' = omega,    chi = psi + beta
  beta = -c f (1 + 1.1 (f / g)^2) - d kappa,    f = v^2 kappa + a

chi is the course of R. The sideslip beta depends on the specific side force f and on the curvature kappa of the bend. a
is the gravity component on a side slope [m/s2], known only with an IMU; without IMU, the heading estimate includes the
crab angle. The resistance of the rear wheels to turning shifts the point without sideslip by the turn offset d.

kappa is computed from the smoothed steering angle; its effect fades at standstill. The yaw rate is unsuitable: bumps
turn the body about its centre, which would give d = 0.5 m and heading errors of 4 deg on rough ground. g_e and g_n are
first-order Gauss-Markov processes [Brown2012] in units of their standard deviation sigma. v, omega, the biases, k, c, s
and l are random walks in time. d changes with the ground and is a random walk in distance. l is the shift of the
antenna due to constant pitch or pitch error: an implement or soft soil pitches the tractor by half a degree, which
moves the antenna on a cab roof by 3 cm. Unmeasured roll is computed from the side force of the bend. The course also
has white noise, whose density `sideslip_noise` estimates from the fixes. The midpoint rule avoids the half-tick delay
of the paper's Euler step.

The first two-antenna heading adds two states: the unmodelled sideslip b, a random walk added to beta, and the mounting
error m, which is 0 until the sideslip is implausible (`mounting`). Each measurement is a row of innovation, Jacobian
and variance:

  gyro = omega + b_g,    wheel speed = (1 + k - s p (1 + 1.1 (f^2 + p^2) / g^2)) v / cos(pitch),
  p = (g sin(pitch) - l_r f kappa) / load,    0 = omega - v tan(delta - b_s) / L,
  fix = (x, y) + sigma (g_e, g_n) + l (cos(psi), sin(psi)),    its velocity = v along chi, l v kappa across,
  its heading = psi + m
  at a standstill 0 = v, 0 = omega
"""

from math import cos, exp, radians, sin, sqrt
from typing import NamedTuple

import numpy as np

from agrobot_mj.core.kernels import jit
from agrobot_mj.core.signals import Matrix, Vector
from agrobot_mj.estimation.equations import prior
from agrobot_mj.machine.tractor import GRAVITY

N = 14
X, Y, PSI, V, OMEGA, B_G, B_S, G_E, G_N, K, C, D, S, AHEAD = range(N)
BETA, MOUNT = N, N + 1
"""Indices of the additional states with a two-antenna heading: unmodelled sideslip and mounting error."""
SCALE_LIMIT = 0.3
"""Maximum estimated relative error of the wheel speed [-]. Assumed value; a larger error is wheel spin or sliding."""


Walks = tuple[float, float, float, float, float, float, float, float, float, float, float]


class FullLevels(NamedTuple):
    """Parameters of the filter: random walks of the states, standard deviations of the measurements, and geometry."""

    wheelbase: float  # Wheelbase of the tractor [m]
    walks: Walks
    """Random-walk coefficients in the units of the states per square root of a second.

    The order is east and north position, heading, speed, yaw rate, gyro bias, steering bias, wheel scale, tyre
    compliance, wheel slip on a climb, and antenna shift.
    """
    gyro_sigma: float  # Standard deviation of the gyro noise [rad/s]
    wheel_sigma: float  # Standard deviation of the wheel speed [m/s]
    steer_sigma: float  # Standard deviation of the yaw rate derived from the steering angle [rad/s]
    velocity_sigma: float  # Standard deviation of the GNSS velocity per axis [m/s]
    lean_slip_walk: float = 0.001
    """Random-walk coefficient of the relative wheel-speed error, divided by the gravity component along the ground
    [s2/m/sqrt(s)]."""
    heading_sigma: float = radians(0.25)  # Standard deviation of a two-antenna heading [rad]
    sideslip_walk: float = radians(0.1)  # Random-walk coefficient of the unmodelled sideslip [rad/sqrt(s)]
    sideslip_sigma: float = radians(2.0)
    """Standard deviation of the unmodelled sideslip [rad] at the first two-antenna heading."""
    turn_offset_walk: float = 0.004  # Random-walk coefficient of the turn offset over the distance [m/sqrt(m)]
    load_transfer: float = 0.0  # CG height divided by the distance of the CG from the front axle [-]
    cg_arm: float = 0.0  # Distance l_r of the CG ahead of the rear axle [m]
    roll: float = 0.0  # Outward roll in a bend divided by the specific side force [rad s2/m], or 0 with an IMU


class FixNoise(NamedTuple):
    """Position error of a fix of a given quality, as used by the filter."""

    correlated: float  # Standard deviation of the time-correlated position error [m]
    white: float  # Standard deviation of the white position error [m]
    correlation_time: float  # Correlation time of the correlated position error [s]


class SideLoad(NamedTuple):
    """Inputs of the sideslip model that are not filter states: gravity on a side slope, and curvature."""

    gravity: float = 0.0  # Gravity component of the specific side force [m/s2]
    bend: float = 0.0  # Curvature of the bend [1/m]


LEAST_LOAD = 0.1  # Minimum load of the rear axle on a slope, divided by its load on level ground [-]. Assumed value.
SOFTENING = 1.1
"""Coefficient of (side force / weight)^2 in the rear-tyre compliance [-]. Assumed value. For tyres of kind
`magic_formula` the coefficient is 1.0 on a slope of 12 deg, 1.2 at 20 deg and 1.4 at 25 deg."""
SLOW = 0.3
"""Speed [m/s] at which the effect of the curvature on the sideslip is halved; at standstill the effect is zero. Assumed
value: ten times the speed uncertainty."""


@jit
def sideslip(mean: Vector, v: float, side: SideLoad) -> float:
    """Return the sideslip at the speed `v` [m/s]: course of the rear axle minus heading of the tractor [rad]."""
    return (mean[BETA] if mean.size > BETA else 0.0) - modelled_crab(mean, v, side)


@jit
def modelled_crab(mean: Vector, v: float, side: SideLoad) -> float:
    """Return the modelled crab angle [rad], positive to the right, from side force and curvature at the speed `v`
    [m/s]."""
    return float(mean[C] * _side_force(v, side)[0] + mean[D] * side.bend * _moving(v)[0])


@jit
def _side_force(v: float, side: SideLoad) -> tuple[float, float]:
    """Return the specific side force times tyre softening [m/s2], and its derivative with respect to speed [1/s]."""
    force = v * v * side.bend + side.gravity
    ratio = force / GRAVITY
    square = SOFTENING * (ratio * ratio)
    return force * (1.0 + square), 2.0 * v * side.bend * (1.0 + 3.0 * square)


@jit
def course(mean: Vector, side: SideLoad) -> float:
    """Return the course [rad]: the direction of motion of the rear-axle point R."""
    return float(mean[PSI] + sideslip(mean, mean[V], side))


@jit
def course_slopes(mean: Vector, side: SideLoad) -> Vector:
    """Return the derivatives of the course with respect to the states, shape (n,)."""
    v, c, d = mean[V], mean[C], mean[D]
    weight, by_v = _moving(v)
    force, force_by_v = _side_force(v, side)
    slopes = np.zeros(mean.size)
    slopes[PSI] = 1.0
    slopes[V] = -c * force_by_v - d * by_v * side.bend
    slopes[C], slopes[D] = -force, -side.bend * weight
    if mean.size > BETA:
        slopes[BETA] = 1.0
    return slopes


@jit
def _moving(v: float) -> tuple[float, float]:
    """Return the weight of the curvature [-], 0.5 at the speed `SLOW` and 0 at standstill, and its derivative [s/m]."""
    square = v * v + SLOW * SLOW
    return v * v / square, 2 * v * SLOW * SLOW / (square * square)


@jit
def propagate_mean(mean: Vector, side: SideLoad, dt: float, decay: float) -> Vector:
    """Return the mean predicted over `dt` [s]; the time-correlated fix error is multiplied by `decay` [-]."""
    v, omega = mean[V], mean[OMEGA]
    chi = course(mean, side) + 0.5 * omega * dt
    after = mean.copy()
    after[X] += v * dt * cos(chi)
    after[Y] += v * dt * sin(chi)
    after[PSI] += omega * dt
    after[G_E] *= decay
    after[G_N] *= decay
    return after


@jit
def transition(mean: Vector, side: SideLoad, dt: float, decay: float) -> Matrix:
    """Return the Jacobian of `propagate_mean` with respect to the mean (n,), shape (n, n)."""
    v, omega = mean[V], mean[OMEGA]
    chi = course(mean, side) + 0.5 * omega * dt
    east, north = dt * cos(chi), dt * sin(chi)
    F, slopes = np.eye(mean.size), course_slopes(mean, side)
    for state in range(mean.size):
        F[X, state] += -v * north * slopes[state]
        F[Y, state] += v * east * slopes[state]
    F[X, OMEGA], F[Y, OMEGA] = -0.5 * dt * v * north, 0.5 * dt * v * east
    F[X, V] += east
    F[Y, V] += north
    F[PSI, OMEGA] = dt
    F[G_E, G_E] = F[G_N, G_N] = decay
    return F


@jit
def predict(
    mean: Vector, P: Matrix, Q: Matrix, side: SideLoad, density: float, dt: float, decay: float, known: bool
) -> tuple[Vector, Matrix]:
    """Return the predicted mean and covariance after `dt` [s]; the process noise `Q` (n, n) is modified in place.

    The course has white noise of the given `density` [rad2 s]. The position changes only if the yaw is `known`.
    """
    chi = course(mean, side)
    q, s, c = dt * density * (mean[V] * mean[V]), sin(chi), cos(chi)
    Q[X, X] += q * s * s
    Q[Y, Y] += q * c * c
    Q[X, Y] -= q * s * c
    Q[Y, X] -= q * s * c
    F, after = transition(mean, side, dt, decay), propagate_mean(mean, side, dt, decay)
    if not known:
        for i in range(2):
            after[i] = mean[i]
            for j in range(mean.size):
                F[i, j] = 1.0 if i == j else 0.0
    return after, prior(P, F, Q)


@jit
def process_noise(levels: FullLevels, dt: float, correlation_time: float, n: int = N) -> tuple[float, Matrix]:
    """Return the decay factor of the time-correlated fix error during `dt` [s], and the process noise (n, n)."""
    decay = exp(-dt / correlation_time)
    Q = np.zeros((n, n))
    for state, walk in zip((X, Y, PSI, V, OMEGA, B_G, B_S, K, C, S, AHEAD), levels.walks):  # noqa: B905
        Q[state, state] = dt * (walk * walk)
    Q[G_E, G_E] = Q[G_N, G_N] = 1.0 - decay * decay
    if n > BETA:
        Q[BETA, BETA] = dt * (levels.sideslip_walk * levels.sideslip_walk)
    # the heading changes by half of the yaw-rate change in a tick, otherwise it would lag in bends;
    # inertia keeps the change smooth, so that the noise of the heading is constant
    turn = dt * (levels.walks[OMEGA] * levels.walks[OMEGA])
    Q[PSI, OMEGA] = Q[OMEGA, PSI] = 0.5 * dt * turn
    Q[PSI, PSI] += 0.25 * dt * dt * turn
    return decay, Q


@jit
def braking(pitch: float, v: float, side: SideLoad, levels: FullLevels) -> float:
    """Return p (1 + 1.1 (f^2 + p^2) / g^2) [m/s2], the specific braking force of the rear tyres with tyre softening.

    p is the braking force per mass, divided by `load`, and f is the specific side force. The braking force balances
    gravity along the ground and the backward component l_r f kappa of the side force of the steered front tyres. `load`
    is the rear-axle load relative to level ground, cos(pitch) - load_transfer sin(pitch).
    """
    force = v * v * side.bend + side.gravity
    load = max(cos(pitch) - levels.load_transfer * sin(pitch), LEAST_LOAD)
    braked = (GRAVITY * sin(pitch) - levels.cg_arm * force * side.bend) / load
    return braked * (1.0 + SOFTENING * (force * force + braked * braked) / (GRAVITY * GRAVITY))


@jit
def wheel_scale(mean: Vector, pitch: float, braked: float) -> float:
    """Return the wheel speed divided by the horizontal speed of the rear axle [-], from scale error, slip and pitch."""
    return float((1.0 + mean[K] - mean[S] * braked) / cos(pitch))


@jit
def with_sideslip(mean: Vector, covariance: Matrix, sigma: float) -> tuple[Vector, Matrix]:
    """Return the mean (16,) and covariance with two added states: unmodelled sideslip and mounting error, both zero.

    The standard deviation of the unmodelled sideslip is `sigma` [rad].
    """
    longer, P = np.zeros(N + 2), np.zeros((N + 2, N + 2))
    for i in range(N):
        longer[i] = mean[i]
        for j in range(N):
            P[i, j] = covariance[i, j]
    P[BETA, BETA] = sigma * sigma
    return longer, P


@jit
def steady_gain(walk: float, sigma: float, dt: float) -> float:
    """Return the steady-state Kalman gain for a random walk (`walk` per sqrt(s)) measured with the noise `sigma`."""
    q = walk * walk * dt / (sigma * sigma)
    return 0.5 * (sqrt(q * q + 4.0 * q) - q)
