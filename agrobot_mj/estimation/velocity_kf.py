"""Position-velocity Kalman filter of the antenna, which smooths the GNSS velocity.

The state is (x, vx, y, vy) in ENU [m, m/s]; the velocity is a random walk [Brown2012]. The receiver measures all four
states. The paper gives the transition `kinematicmodelKF` but no noise. The process noise here is white acceleration in
continuous time, so that the covariance is independent of the tick length.
"""

from math import cos, isnan, sin

import numpy as np

from agrobot_mj.core.kernels import jit
from agrobot_mj.core.signals import NO_FIX, Array, Fix, Matrix, Vector
from agrobot_mj.estimation.equations import prior, product, tick, times
from agrobot_mj.estimation.kalman import Filter


@jit
def transition(dt: float) -> Matrix:
    """Return the state transition matrix for `dt` [s], shape (4, 4)."""
    T_s = dt
    Phi = np.eye(4)
    Phi[0, 1] = Phi[2, 3] = T_s  # [agrobots: kinematicmodelKF]
    return Phi


@jit
def process_noise(velocity_walk: float, dt: float) -> Matrix:
    """Return the process-noise covariance for `dt` [s] and `velocity_walk` [m/s/sqrt(s)], shape (4, 4)."""
    Q, variance = np.zeros((4, 4)), velocity_walk * velocity_walk
    for place in (0, 2):
        Q[place, place], Q[place + 1, place + 1] = variance * (dt * dt * dt / 3), variance * dt
        Q[place, place + 1] = Q[place + 1, place] = variance * (dt * dt / 2)
    return Q


@jit
def rotate_velocity(mean: Vector, covariance: Matrix, angle: float) -> tuple[Vector, Matrix]:
    """Return the mean (4,) and covariance (4, 4) after rotating the velocity to the left by `angle` [rad]."""
    M = np.eye(4)
    M[1, 1] = M[3, 3] = cos(angle)
    M[3, 1], M[1, 3] = sin(angle), -sin(angle)
    return product(M, mean), times(times(M, covariance), M.T.copy())


@jit
def predict_with_innovation(mean: Vector, fix: Fix, dt: float) -> tuple[Vector, Vector]:
    """Return the mean (4,) predicted over `dt` [s], and the innovation of a fix, which is NaN without a fix."""
    x = product(transition(dt), mean)
    return x, np.array((fix.x, fix.vx, fix.y, fix.vy)) - x


@jit
def velocity_step(
    velocity_walk: float, mean: Vector, covariance: Matrix, fix: Fix, noise: Matrix, dt: float
) -> tuple[Vector, Matrix]:
    """Return the mean (4,) and covariance (4, 4) after `dt` [s], corrected by the fix in this tick (NaN if missing)."""
    (x, y), Phi, Q = predict_with_innovation(mean, fix, dt), transition(dt), process_noise(velocity_walk, dt)
    if isnan(fix.x):
        return x, prior(covariance, Phi, Q)
    x, P, _ = tick(x, covariance, Phi, Q, y, np.eye(4), noise)
    return x, P


class VelocityKf(Filter):
    """Kalman filter of antenna position and velocity, with the process noise `velocity_walk` [m/s/sqrt(s)]."""

    def __init__(self, velocity_walk: float) -> None:
        self.velocity_walk = velocity_walk

    def step(self, mean: Vector, covariance: Array, fix: Fix | None, noise: Array, dt: float) -> tuple[Array, Array]:
        """Return the mean (4,) and covariance (4, 4) after `dt` [s], corrected by the fix in this tick.

        `noise` (4, 4) is the covariance of the fix (x, vx, y, vy).
        """
        (x, y), Q = predict_with_innovation(mean, fix or NO_FIX, dt), process_noise(self.velocity_walk, dt)
        return self.tick(x, covariance, transition(dt), Q, y if fix else None, np.eye(4), noise)[:2]
