"""Extended Kalman filter of position and course at R, steering bias, and correlated GNSS error.

State x, y [m], course chi [rad, not wrapped], bias b [rad], g_x, g_y [-]: the correlated error of the fix, a
first-order Gauss-Markov process [Brown2012] in units of its standard deviation. Inputs and measurement as in
`pose_ekf`:

    chi' = u tan(delta - b) / L,    x' = u cos(chi),  y' = u sin(chi),    b and g wander,    z = (x, y) + s g

with s the standard deviation of the correlated part. The bias is what the steering angle reads beyond the curvature
of the path: an error of the potentiometer, or the difference of front and rear slip angles that holds a course
across a slope. It shows as soon as the tractor moves. Without walk and initial variance of b, and without a
correlated share, this is `pose_ekf`. Runs on filterpy, whose object is a workspace only, as there.
"""

from functools import lru_cache
from math import cos, exp, sin, sqrt, tan
from typing import NamedTuple

import numpy as np

from agrobot_mj.estimation.fix_ekf import FixEkf
from agrobot_mj.signals import Array, Fix

BIAS = 3
"""Where the steering bias stands in the state."""


class Levels(NamedTuple):
    """What moves the states by itself, and how the error of a fix splits."""

    position_walk: float
    """[m/sqrt(s)]."""
    yaw_walk: float
    """[rad/sqrt(s)]."""
    bias_walk: float
    """[rad/sqrt(s)]."""
    correlated_share: float
    """Of the standard deviation of a fix [-]."""
    correlation_time: float
    """[s]."""


def f(state: Array, speed: float, steer: float, wheelbase: float, dt: float, phi: float) -> Array:
    """State (6,) after `dt` [s] at `speed` [m/s] and `steer` [rad]; `phi` is what is left of g [-]."""
    (x, y, chi, b, g_x, g_y), T_s, u, L = state.tolist(), dt, speed, wheelbase
    turned = chi + T_s * u * tan(steer - b) / L
    return np.array((x + T_s * u * cos(chi), y + T_s * u * sin(chi), turned, b, phi * g_x, phi * g_y))


def jacobian(state: Array, speed: float, steer: float, wheelbase: float, dt: float, phi: float) -> Array:
    """Derivative of `f` by the state, shape (6, 6)."""
    chi, b, T_s, u, L = state[2], state[BIAS], dt, speed, wheelbase
    F = np.diag((1.0, 1.0, 1.0, 1.0, phi, phi))
    F[0, 2], F[1, 2] = -T_s * u * sin(chi), T_s * u * cos(chi)
    F[2, BIAS] = -T_s * u / (L * cos(steer - b) ** 2)
    return F


class BiasEkf(FixEkf):
    """The filter for one wheelbase [m] and one set of levels."""

    def __init__(self, wheelbase: float, levels: Levels) -> None:
        super().__init__(6)
        self.wheelbase, self.levels = wheelbase, levels

    def predict_x(self, u: tuple[float, float, float]) -> None:
        """Prior mean, and the matching F and Q, for the inputs (speed, steer, dt); filterpy's hook."""
        speed, steer, dt = u
        phi, self.Q = _noise(self.levels, dt)
        self.F = jacobian(self.x, speed, steer, self.wheelbase, dt, phi)
        self.x = f(self.x, speed, steer, self.wheelbase, dt, phi)

    def step(
        self, mean: Array, covariance: Array, inputs: tuple[float, float, float], fix: Fix | None, sigma: float
    ) -> tuple[Array, Array]:
        """Mean (6,) and covariance (6, 6) after a tick, given the fix at its end, of standard deviation `sigma` [m].

        `inputs` are speed [m/s], steer [rad] and dt [s].
        """
        H, R = _measuring(self.levels.correlated_share, sigma)
        return self.tick((mean, covariance), inputs, fix, (lambda x: H, lambda x: H @ x), R)


@lru_cache(maxsize=8)
def _noise(levels: Levels, dt: float) -> tuple[float, Array]:
    """What is left of g after `dt` [s], and the covariance (6, 6) of the states' own motion in it."""
    phi = exp(-dt / levels.correlation_time)
    p, yaw, b, g = levels.position_walk, levels.yaw_walk, levels.bias_walk, sqrt((1.0 - phi * phi) / dt)
    return phi, dt * np.diag(np.square((p, p, yaw, b, g, g)))


@lru_cache(maxsize=8)
def _measuring(share: float, sigma: float) -> tuple[Array, Array]:
    """Jacobian (2, 6) of a fix and the covariance (2, 2) of its white part."""
    H = np.hstack([np.eye(2, 4), share * sigma * np.eye(2)])
    return H, sigma**2 * (1.0 - share**2) * np.eye(2)
