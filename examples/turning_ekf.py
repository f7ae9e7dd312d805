r"""Custom estimator on filterpy's `ExtendedKalmanFilter`, with constant speed and yaw rate between two fixes.

    agrobot-mj run figure_eight --plugin examples/turning_ekf.py --set estimator.kind=turning_ekf
    agrobot-mj compare figure_eight --plugin examples/turning_ekf.py --guidance lqr \
        --variant "paper: estimator.kind=ekf" --variant "own: estimator.kind=turning_ekf"

States: position of the rear-axle point R [m], yaw [rad], speed [m/s] and yaw rate [rad/s]. The antenna is assumed to be
above R. A plugin estimator is called from Python once per tick. filterpy needs about 0.1 ms per call.
"""

from math import cos, nan, radians, sin, tan
from typing import Literal, NamedTuple

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter

from agrobot_mj.core.geometry import wrap
from agrobot_mj.core.signals import Array, Estimate, Measurement
from agrobot_mj.core.spec import Positive
from agrobot_mj.estimation.base import StateEstimator, largest_sigma
from agrobot_mj.machine.tractor import TractorParameters


class Turning(NamedTuple):
    """State of the filter between two ticks."""

    mean: Array
    """Mean of the states x, y, yaw, speed and yaw rate, shape (5,) [SI, rad]."""
    covariance: Array
    """Covariance of the states, shape (5, 5)."""
    wheelbase: float
    """Wheelbase of the tractor [m]."""
    to_cg: float
    """Distance of the centre of gravity ahead of R [m]."""
    fix_t: float = 0.0
    """Time of the last fix [s]."""


class TurningEkf(StateEstimator):
    """Extended Kalman filter with constant speed and yaw rate, selected by `estimator.kind = "turning_ekf"`."""

    kind: Literal["turning_ekf"] = "turning_ekf"
    position_sigma_m: Positive = 0.02
    """Standard deviation of a GNSS position per axis [m]. Paper, section V-A."""
    velocity_sigma_m_s: Positive = 0.03
    """Standard deviation of a GNSS velocity per axis [m/s]. Assumed value, as for the receiver."""
    steer_sigma_deg_s: Positive = 2.0
    """Standard deviation of the yaw rate computed from the steering angle [deg/s]. Assumed value."""
    speed_walk_m_s_rt_s: Positive = 0.2
    """Intensity of the random walk of the speed [m/s/sqrt(s)]. Assumed value."""
    yaw_rate_walk_deg_s_rt_s: Positive = 5.0
    """Intensity of the random walk of the yaw rate [deg/s/sqrt(s)]. Assumed value."""

    def init(self, x: float, y: float, yaw: float, tractor: TractorParameters) -> Turning:
        """Return the filter state at standstill, with R at (x, y) [m] and the heading `yaw` [rad]."""
        sigmas = np.array([0.05, 0.05, radians(5.0), 0.1, radians(1.0)])
        start = np.array([x, y, yaw, 0.0, 0.0])
        return Turning(start, np.diag(sigmas**2), tractor.wheelbase_m, tractor.cg_to_rear_axle)

    def update(self, state: Turning, measurement: Measurement, dt: float) -> tuple[Turning, Estimate]:
        """Predict the state by one tick, then correct the state by the steering angle and, if available, by a new
        fix."""
        ekf = ExtendedKalmanFilter(dim_x=5, dim_z=1)
        ekf.F, ekf.Q = self._transition(state.mean, dt), self._noise(dt)
        ekf.x, ekf.P = self._moved(state.mean, dt), ekf.F @ state.covariance @ ekf.F.T + ekf.Q
        turning = tan(measurement.steer) / state.wheelbase
        by_steer = np.array([[0.0, 0.0, 0.0, -turning, 1.0]])  # 0 = yaw rate - v tan(delta) / L
        ekf.update(
            np.zeros(1), lambda x: by_steer, lambda x: by_steer @ x, np.array([[radians(self.steer_sigma_deg_s) ** 2]])
        )
        nis, fix_t = nan, state.fix_t
        if (fix := measurement.fix) is not None:
            noise = np.diag([self.position_sigma_m**2] * 2 + [self.velocity_sigma_m_s**2] * 2)
            ekf.update(np.array([fix.x, fix.y, fix.vx, fix.vy]), self._slopes, self._expected, noise)
            y, S = ekf.y[:2], ekf.S[:2, :2]
            nis, fix_t = float(y @ np.linalg.solve(S, y)), measurement.t
        state = state._replace(mean=ekf.x, covariance=ekf.P, fix_t=fix_t)
        return state, self._estimate(state, nis, measurement.t)

    def _moved(self, mean: Array, dt: float) -> Array:
        """Return the predicted mean after `dt` [s] at constant speed and yaw rate."""
        x, y, yaw, v, rate = mean
        middle = yaw + 0.5 * rate * dt
        return np.array([x + v * dt * cos(middle), y + v * dt * sin(middle), yaw + rate * dt, v, rate])

    def _transition(self, mean: Array, dt: float) -> Array:
        """Return the Jacobian of the predicted mean with respect to the current mean, shape (5, 5)."""
        _, _, yaw, v, rate = mean
        c, s = dt * cos(yaw + 0.5 * rate * dt), dt * sin(yaw + 0.5 * rate * dt)
        F = np.eye(5)
        F[0, 2:] = -v * s, c, -0.5 * dt * v * s
        F[1, 2:] = v * c, s, 0.5 * dt * v * c
        F[2, 4] = dt
        return F

    def _noise(self, dt: float) -> Array:
        """Return the covariance of the process noise in a tick, shape (5, 5)."""
        walks = np.array([0.01, 0.01, radians(0.3), self.speed_walk_m_s_rt_s, radians(self.yaw_rate_walk_deg_s_rt_s)])
        return np.diag(dt * walks**2)

    def _expected(self, mean: Array) -> Array:
        """Return the GNSS measurement expected from the mean: position and velocity, shape (4,)."""
        x, y, yaw, v, _ = mean
        return np.array([x, y, v * cos(yaw), v * sin(yaw)])

    def _slopes(self, mean: Array) -> Array:
        """Return the Jacobian of the expected GNSS measurement with respect to the mean, shape (4, 5)."""
        _, _, yaw, v, _ = mean
        H = np.zeros((4, 5))
        H[0, 0] = H[1, 1] = 1.0
        H[2, 2:4] = -v * sin(yaw), cos(yaw)
        H[3, 2:4] = v * cos(yaw), sin(yaw)
        return H

    def _estimate(self, state: Turning, nis: float, t: float) -> Estimate:
        x, y, yaw, speed, rate = state.mean.tolist()
        return Estimate(
            x=x + state.to_cg * cos(yaw),
            y=y + state.to_cg * sin(yaw),
            yaw=wrap(yaw),
            speed=speed,
            yaw_rate=rate,
            rear_x=x,
            rear_y=y,
            covariance=state.covariance[:3, :3],
            nis=nis,
            fix_age=t - state.fix_t,
            position_sigma=largest_sigma(state.covariance),
        )
