"""Nonlinear model predictive control of the lateral motion; needs casadi (`pip install agrobot-mj[nmpc]`).

Model in the heading frame of the tractor, with cross-track error e_y of the CG and heading minus path tangent e:
  e_y' = u sin e + v cos e + u b,  e' = gamma - kappa (u cos e - v sin e) / (1 - kappa e_y),
  gamma = u (tan(delta) / L + d),  v = l_r gamma,  tau delta' = delta_c(t - T) - delta,
with the speed u (constant, negative in reverse), lateral velocity v, yaw rate gamma, steering angle delta, its command
delta_c, and curvature kappa of the path ahead. A Kalman filter on e_y and e estimates two disturbances, which removes
the steady-state error: d (curvature: steering bias, slope, slip) and b (crab angle, bias of the estimated heading). The
decision variables are the rates of the steering command. The cost, summed over the prediction horizon of 2 s, is
  (e_y / offset_m)^2 + (course error / heading_deg)^2 + (rate / rate_deg_s)^2
with scales from `Nmpc`, subject to limits of angle and rate. Warm-started Gauss-Newton steps (sequential quadratic
programming) minimise this cost [Rawlings2017]. Every tick has two steps, for bounded computing time and repeatable
results. In reverse the cost contains the errors of the leading rear axle, because a correction first moves the CG away
from the path.
"""

from collections.abc import Sequence
from functools import lru_cache
from math import asin, cos, exp, hypot, radians, sin, tan
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field

from agrobot_mj.control.base import Situation
from agrobot_mj.control.deviation import STEEP, PathDeviation, sideslip
from agrobot_mj.control.following import DISTURBANCE_COLUMNS, Following, FollowingState
from agrobot_mj.control.pid import clip
from agrobot_mj.core.errors import import_extra
from agrobot_mj.core.geometry import wrap
from agrobot_mj.core.signals import TICK_S, Array, Column
from agrobot_mj.core.spec import NonNegative, Positive

STEP_S = 2 * TICK_S  # Time step of the prediction [s]
STEPS = 20  # Number of steps in the 2 s horizon
HORIZON_S = STEPS * STEP_S  # Duration of the horizon [s]
APPROACH = 2 / 3
"""Maximum decay length (to 1/e) of a path error, divided by the predicted travel distance [-]. Assumed value."""
ITERATIONS = 2  # Number of Gauss-Newton steps per tick
DISTURBANCES = np.zeros(4)
"""Initial estimates of cross-track error, heading error, crab angle and curvature disturbance, all zero."""


class NmpcState(NamedTuple):
    """State of `Nmpc` between two ticks."""

    rates: Array  # Planned rates of change of the steering command [rad/s], shape (STEPS,)
    delayed: tuple[float, float]  # Last two steering commands [rad], oldest first
    mean: Array = DISTURBANCES
    """Estimated cross-track error [m], heading error, crab angle [rad] and curvature disturbance [1/m], shape (4,)."""
    covariance: Array = np.diag([1.0, 1.0, 0.0, 0.0])  # Covariance of `mean`, shape (4, 4)
    started: bool = False  # Whether the law has been evaluated before


class Nmpc(Following):
    """Model predictive path-following law with a disturbance estimator."""

    kind: Literal["nmpc"] = "nmpc"
    label: ClassVar = "NMPC"
    steering_lag_s: Positive = 0.7
    """Time constant tau of the closed steering loop [s]. Assumed value (0.25 with a new valve, 1.3 with a worn one)."""
    offset_m: Positive = 0.23
    """Cross-track error that contributes 1 to the cost [m]. Assumed value (range 0.05-0.5) from tuning."""
    heading_deg: Positive = 5.2
    """Course error that contributes 1 to the cost [deg]. The minimum is `offset_m` divided by two thirds of the
    distance covered in the prediction horizon. Assumed value (range 1-10) from tuning."""
    rate_deg_s: Positive = 37.0
    """Steering rate that contributes 1 to the cost [deg/s]. Assumed value from tuning; manual tuning gives 5-25."""
    steer_rate_deg_s: Positive = 25.0
    """Maximum rate of the steering command [deg/s]. Assumed value; the wheels turn at 26 deg/s with full pump flow."""
    offset_noise_m: Positive = 0.03
    """Standard deviation of the estimated cross-track error [m]. Assumed value for the noise of receiver and filter."""
    heading_noise_deg: Positive = 1.0
    """Standard deviation of the estimated heading [deg]. Assumed value for the noise of the EKF."""
    heading_walk_deg_rt_s: NonNegative = 0.3
    """Random walk of the crab angle [deg/sqrt(s)]. Assumed value (range 0.1-1): the heading bias changes on each
    arc."""
    curvature_walk_m_rt_s: NonNegative = 0.0008
    """Random walk of the curvature disturbance [1/(m sqrt(s))]. Assumed value (range 0.0005-0.002); higher values cause
    oscillation."""
    largest_curvature_m: Annotated[float, Field(gt=0, le=1)] = 0.15
    """Maximum magnitude of the curvature disturbance [1/m]. Assumed value, equivalent to 12 deg of steering."""
    tunable: ClassVar = {"offset_m": (0.02, 0.5), "heading_deg": (1.0, 20.0), "rate_deg_s": (3.0, 60.0)}
    """Search ranges for tuning the gains."""

    def memory(self) -> NmpcState:
        """Return the initial state. Raise `ScenarioError` if casadi is not installed."""
        _solver()
        return NmpcState(np.zeros(STEPS), (0.0, 0.0))

    def steering(
        self, memory: NmpcState, deviation: PathDeviation, situation: Situation, dt: float
    ) -> tuple[NmpcState, float]:
        """Estimate the disturbances and plan the steering rates. Return the new state and the steering angle [rad]."""
        delta = situation.steer - deviation.bias
        if not memory.started:
            memory = memory._replace(delayed=(delta, delta), started=True)
        mean, covariance = self._observe(memory, deviation, situation, delta, dt)
        rates = self._plan(memory, mean, deviation, situation, delta)
        wanted = memory.delayed[-1] + float(rates[0]) * dt
        possible = clip(wanted, -deviation.limit - deviation.bias, deviation.limit - deviation.bias)
        later = np.append(rates[1:], 0.0)
        rates = rates + dt / STEP_S * (later - rates)
        return NmpcState(rates, (memory.delayed[-1], possible), mean, covariance, True), wanted

    def _plan(
        self, memory: NmpcState, mean: Array, deviation: PathDeviation, situation: Situation, delta: float
    ) -> Array:
        """Return the steering rates over the horizon that minimise the cost [rad/s], shape (STEPS,)."""
        m, solver = situation.machine, _solver()
        distances = [
            min(deviation.place.s + abs(deviation.speed) * STEP_S * (k + 0.5), deviation.leg[1]) for k in range(STEPS)
        ]
        curvatures = situation.route.curvatures(distances).tolist()
        u, theta = abs(deviation.speed), radians(self.approach_deg)
        way, r = u * HORIZON_S, situation.reference
        pace = max(u, hypot(r.vx, r.vy))  # a tractor that waits for its reference accelerates later
        heading = max(radians(self.heading_deg), self.offset_m / (APPROACH * HORIZON_S * pace))
        far = max(way * sin(theta), theta * (self.offset_m / heading) ** 2 / way)
        e_y, e, last = clip(deviation.cross_track, -far, far), _tangent_error(deviation, situation), memory.delayed[-1]
        weights = 1 / self.offset_m, 1 / heading, 1 / radians(self.rate_deg_s)
        rear = float(deviation.direction < 0)
        keep = exp(-STEP_S / self.steering_lag_s), exp(-STEP_S / 2 / self.steering_lag_s)
        now = e_y, e, delta, mean[2], mean[3], sum(memory.delayed) / 2, last
        model = deviation.speed, m.wheelbase_m, m.cg_to_rear_axle, *keep
        p = np.array((*now, *model, *weights, rear, *curvatures, *self._sideslips(curvatures, deviation, situation)))
        limit = max(deviation.limit, abs(last))
        return solver.solve(memory.rates, p, radians(self.steer_rate_deg_s), (-limit - last, limit - last))

    def _sideslips(self, curvatures: list[float], deviation: PathDeviation, situation: Situation) -> list[float]:
        """Return the sideslips of the CG [rad] after each prediction step in reverse, or zeros in forward travel."""
        if deviation.direction > 0:
            return [0.0] * STEPS
        l_r, way = situation.machine.cg_to_rear_axle, abs(deviation.speed) * STEP_S
        beta = sideslip(situation.route, deviation.place.s + way * STEPS, -1.0, deviation.leg, l_r)
        found = [beta]
        for kappa in reversed(curvatures[1:]):
            target = asin(clip(l_r * kappa, -0.95, 0.95))
            beta = target + (beta - target) * exp(-way / l_r)
            found.append(beta)
        return found[::-1]

    def _observe(
        self, memory: NmpcState, deviation: PathDeviation, situation: Situation, delta: float, dt: float
    ) -> tuple[Array, Array]:
        """Return the estimates of `NmpcState.mean` and their covariance after one step of the Kalman filter."""
        if abs(deviation.heading) > STEEP:  # large slip and steering lag: the model is invalid
            place = deviation.cross_track, _tangent_error(deviation, situation)
            return np.array([*place, *memory.mean[2:]]), memory.covariance
        (e_y, e, b, d), u, m = memory.mean.tolist(), situation.estimate.speed, situation.machine
        gamma, kappa = u * (tan(delta) / m.wheelbase_m + d), deviation.place.curvature
        v = m.cg_to_rear_axle * gamma
        along = (u * cos(e) - v * sin(e)) / max(1 - kappa * e_y, 0.1)
        mean = np.array([e_y + dt * (u * sin(e) + v * cos(e) + u * b), e + dt * (gamma - kappa * along), b, d])
        F = np.eye(4)
        F[0, 1:3] = F[1, 3] = u * dt
        noise = 0.01, radians(0.2), radians(self.heading_walk_deg_rt_s), self.curvature_walk_m_rt_s
        moved = min(abs(u), 1.0)  # no information at standstill
        P = F @ memory.covariance @ F.T + dt * moved * np.diag(np.square(noise))
        R = np.diag([self.offset_noise_m**2, radians(self.heading_noise_deg) ** 2])
        gain = P[:, :2] @ np.linalg.inv(P[:2, :2] + R)
        observed = np.array([deviation.cross_track, mean[1] + wrap(_tangent_error(deviation, situation) - mean[1])])
        mean = mean + gain @ (observed - mean[:2])
        mean[2] = clip(float(mean[2]), -radians(15), radians(15))
        mean[3] = clip(float(mean[3]), -self.largest_curvature_m, self.largest_curvature_m)
        return mean, P - gain @ P[:2]

    @property
    def columns(self) -> tuple[Column, ...]:
        """Log columns of `Following` and of the estimated disturbances."""
        return (*super().columns, *DISTURBANCE_COLUMNS)

    def report(self, state: FollowingState) -> Sequence[float]:
        """Return the values of the log columns for a state of the law."""
        return (*super().report(state), float(state.memory.mean[2]), float(state.memory.mean[3]))


def _tangent_error(deviation: PathDeviation, situation: Situation) -> float:
    return wrap(situation.estimate.yaw - deviation.place.yaw)


class _Solver:
    """Solver of the optimal control problem: linearised residuals, and a quadratic program per Gauss-Newton step."""

    def __init__(self, ca: Any) -> None:
        rates, p = ca.SX.sym("rates", STEPS), ca.SX.sym("p", 16 + 2 * STEPS)
        r = _residuals(ca, rates, p)
        self.linear = ca.Function("linear", [rates, p], [r, ca.jacobian(r, rates)])
        self.sums = STEP_S * np.tril(np.ones((STEPS, STEPS)))
        dense = {"h": ca.Sparsity.dense(STEPS, STEPS), "a": ca.Sparsity.lower(STEPS)}
        options = {
            "print_iter": False,
            "print_header": False,
            "print_info": False,
            "error_on_fail": False,
            "max_iter": 200,
        }
        self.program = ca.conic("plan", "qrqp", dense, options)

    def solve(self, rates: Array, p: Array, fastest: float, bounds: tuple[float, float]) -> Array:
        """Return the steering rates [rad/s] after the Gauss-Newton steps.

        The magnitudes of the rates are at most `fastest` [rad/s]; the angle changes are within `bounds` [rad].
        """
        for _ in range(ITERATIONS):
            residual, J = (np.array(part) for part in self.linear(rates, p))
            angle = self.sums @ rates
            step = self.program(
                h=J.T @ J + 1e-6 * np.eye(STEPS),
                g=J.T @ residual[:, 0],
                a=self.sums,
                lbx=-fastest - rates,
                ubx=fastest - rates,
                lba=bounds[0] - angle,
                uba=bounds[1] - angle,
            )
            rates = np.clip(rates + np.array(step["x"])[:, 0], -fastest, fastest)
        return rates


def _residuals(ca: Any, rates: Any, p: Any) -> Any:
    """Return the weighted errors over the horizon as casadi expressions; `p` are the parameters from `Nmpc._plan`."""
    e_y, e, delta, b, d, answered, command, u, L, l_r, keep, keep_half, w_y, w_e, w_r, rear = (p[k] for k in range(16))
    found = []
    for k in range(STEPS):
        middle, delta = answered + (delta - answered) * keep_half, answered + (delta - answered) * keep
        gamma, kappa = u * (ca.tan(middle) / L + d), p[16 + k]
        v = l_r * gamma
        half = e + STEP_S / 2 * (gamma - kappa * u)
        along = (u * ca.cos(half) - v * ca.sin(half)) / (1 - kappa * e_y)
        e_y += STEP_S * (u * (ca.sin(half) + b) + v * ca.cos(half))
        e += STEP_S * (gamma - kappa * along)
        course = half + v / u * ca.cos(half) + b  # the angle itself, because its sine is also small at 180 deg
        answered = command = command + STEP_S * rates[k]
        askew = e + p[16 + STEPS + k]  # heading error of the rear axle
        offset = e_y - rear * l_r * askew
        found += [w_y * offset, w_e * (course + rear * (askew + b - course)), w_r * rates[k]]
    return ca.vertcat(*found, 2 * w_y * offset)


@lru_cache(maxsize=1)
def _solver() -> _Solver:
    return _Solver(import_extra("casadi", "nmpc", 'guidance.kind: "nmpc"'))
