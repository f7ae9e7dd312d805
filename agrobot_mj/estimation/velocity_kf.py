"""Position-velocity Kalman filter of the antenna, which smooths the GNSS velocity.

State (x, vx, y, vy) in ENU [m, m/s]; the velocity is a random walk [Brown2012]. The receiver measures all four states.
The paper gives the transition `kinematicmodelKF` but no noise. The process noise here is continuous white acceleration,
so that the covariance is independent of the tick length.
"""

from functools import lru_cache
from math import cos, sin

import numpy as np

from agrobot_mj.core.signals import Array, Fix
from agrobot_mj.estimation.equations import applied
from agrobot_mj.estimation.kalman import Filter

ALL = np.eye(4)
"""Jacobian of the measured positions and velocities [-]."""


def transition(dt: float) -> Array:
    """Return the state transition matrix Phi for `dt` [s], shape (4, 4)."""
    T_s = dt
    Phi = [[1, T_s, 0, 0], [0, 1, 0, 0], [0, 0, 1, T_s], [0, 0, 0, 1]]  # [agrobots: kinematicmodelKF]
    return np.array(Phi, dtype=float)


def process_noise(velocity_walk: float, dt: float) -> Array:
    """Return the process-noise covariance for `dt` [s], shape (4, 4); `velocity_walk` in [m/s/sqrt(s)]."""
    axis = velocity_walk**2 * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    return np.asarray(np.kron(np.eye(2), axis), dtype=np.float64)


def turned(mean: Array, covariance: Array, angle: float) -> tuple[Array, Array]:
    """Return mean (4,) and covariance (4, 4) with the velocity rotated to the left by `angle` [rad]."""
    M = np.eye(4)
    M[1, 1] = M[3, 3] = cos(angle)
    M[3, 1], M[1, 3] = sin(angle), -sin(angle)
    return M @ mean, M @ covariance @ M.T


class VelocityKf(Filter):
    """Kalman filter of antenna position and velocity, with the process noise `velocity_walk` [m/s/sqrt(s)]."""

    def __init__(self, velocity_walk: float) -> None:
        self.velocity_walk = velocity_walk

    def step(self, mean: Array, covariance: Array, fix: Fix | None, noise: Array, dt: float) -> tuple[Array, Array]:
        """Return mean (4,) and covariance (4, 4) after `dt` [s], corrected by the fix at that time.

        `noise` (4, 4) is the covariance of the fix (x, vx, y, vy).
        """
        Phi, Q = _model(self.velocity_walk, dt)
        x = applied(Phi, mean)
        y = None if fix is None else np.array((fix.x, fix.vx, fix.y, fix.vy)) - x
        return self.tick(x, covariance, Phi, Q, y, ALL, noise)[:2]


@lru_cache(maxsize=8)
def _model(velocity_walk: float, dt: float) -> tuple[Array, Array]:
    return transition(dt), process_noise(velocity_walk, dt)
