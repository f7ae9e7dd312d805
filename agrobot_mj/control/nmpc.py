"""Nonlinear model predictive control of the lateral motion, 2 s ahead; needs casadi (`pip install agrobot-mj[nmpc]`).

Model beside the path, in the frame of the heading: e_y the cross-track error of the CG, e the heading less the path's
tangent,
  e_y' = u sin e + v cos e + u b,  e' = gamma - kappa (u cos e - v sin e) / (1 - kappa e_y),
  gamma = u (tan(delta) / L + d),  v = l_r gamma,  tau delta' = delta_c(t - T) - delta,
at constant speed u (negative in reverse) on the curvature kappa of the path ahead. The disturbances d (curvature:
steering bias, slope, slip) and b (crab angle, bias of the estimated heading) come from a Kalman filter on e_y and e,
so that no offset rests. Unknowns are the rates of the steering command; minimised is the sum over the horizon of
  (e_y / offset)^2 + (course error / heading)^2 + (rate / rate_deg_s)^2
within the limits of angle and rate, by Gauss-Newton steps (sequential quadratic programming, warm-started)
[Rawlings2017]. Two steps a tick, always: the time is bounded and the result repeatable. In reverse, where the CG
first moves to the wrong side of any correction, the errors are those of the rear axle, which leads.
"""

from collections.abc import Sequence
from functools import lru_cache
from math import asin, cos, exp, hypot, radians, sin, tan
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field

from agrobot_mj.control.base import Situation
from agrobot_mj.control.following import DISTURBANCE_COLUMNS, STEEP, Beside, Following, FollowingState, sideslip
from agrobot_mj.control.pid import clip
from agrobot_mj.core.errors import required
from agrobot_mj.core.geometry import wrap
from agrobot_mj.core.signals import TICK_S, Array, Column
from agrobot_mj.core.spec import NonNegative, Positive

STEP_S = 2 * TICK_S
"""Step of the prediction [s]."""
STEPS = 20
"""Steps in the horizon of 2 s."""
HORIZON_S = STEPS * STEP_S
"""Length of the horizon [s]."""
APPROACH = 2 / 3
"""Longest way in which an error falls to 1/e, over that of the horizon; what lies beyond is not seen. Assumed value."""
ITERATIONS = 2
"""Gauss-Newton steps in a tick."""
DISTURBANCES = np.zeros(4)
"""e_y, e, b, d of a tractor on its path."""


class NmpcState(NamedTuple):
    """Memory of `Nmpc`."""

    rates: Array
    """Planned rates of the command, shape (STEPS,) [rad/s]."""
    under_way: tuple[float, float]
    """Last two commands, oldest first [rad]."""
    mean: Array = DISTURBANCES
    """Mean of e_y [m], e [rad], b [rad], d [1/m], shape (4,)."""
    covariance: Array = np.diag([1.0, 1.0, 0.0, 0.0])
    """Covariance of `mean`, shape (4, 4)."""
    started: bool = False
    """Whether there was a tick."""


class Nmpc(Following):
    """Predictive law with disturbance estimate."""

    kind: Literal["nmpc"] = "nmpc"
    label: ClassVar = "NMPC"
    steering_lag_s: Positive = 0.7
    """tau of the closed steering loop [s]. Assumed value: between 0.25 on a healthy valve and 1.3 on a worn one."""
    offset_m: Positive = 0.23
    """Cross-track error that costs 1 [m]. Assumed value (0.05-0.5), searched."""
    heading_deg: Positive = 5.2
    """Course error that costs 1 [deg], if more than `offset_m` over two thirds of the way in the horizon. Assumed value
    (1-10), searched."""
    rate_deg_s: Positive = 37.0
    """Steering rate that costs 1 [deg/s]. Assumed value (5-25 by hand), searched."""
    steer_rate_deg_s: Positive = 25.0
    """Fastest change of the steering command [deg/s]. Assumed value: 26 deg/s at full pump flow."""
    offset_noise_m: Positive = 0.03
    """Noise of the estimated cross-track error [m]. Assumed value: receiver and filter."""
    heading_noise_deg: Positive = 1.0
    """Noise of the estimated heading [deg]. Assumed value: the EKF's."""
    heading_walk_deg_rt_s: NonNegative = 0.3
    """How fast b may change [deg/sqrt(s)]. Assumed value (0.1-1): the EKF's bias comes with each arc."""
    curvature_walk_m_rt_s: NonNegative = 0.0008
    """How fast d may change [1/(m sqrt(s))]. Assumed value (0.0005-0.002): faster, it chases the lag of the steering
    and weaves at 4 m/s."""
    largest_curvature_m: Annotated[float, Field(gt=0, le=1)] = 0.15
    """Largest |d| [1/m]. Assumed value: 12 deg of steering."""
    tunable: ClassVar = {"offset_m": (0.02, 0.5), "heading_deg": (1.0, 20.0), "rate_deg_s": (3.0, 60.0)}
    """Ranges in which the gains are sought."""

    def memory(self) -> NmpcState:
        """At rest. Raises `ScenarioError` without casadi."""
        _solver()
        return NmpcState(np.zeros(STEPS), (0.0, 0.0))

    def steering(self, memory: NmpcState, beside: Beside, situation: Situation, dt: float) -> tuple[NmpcState, float]:
        """Disturbances, then the plan; its first rate is the command's."""
        delta = situation.steer - beside.bias
        if not memory.started:
            memory = memory._replace(under_way=(delta, delta), started=True)
        mean, covariance = self._observed(memory, beside, situation, delta, dt)
        rates = self._plan(memory, mean, beside, situation, delta)
        wanted = memory.under_way[-1] + float(rates[0]) * dt
        possible = clip(wanted, -beside.limit - beside.bias, beside.limit - beside.bias)
        later = np.append(rates[1:], 0.0)
        rates = rates + dt / STEP_S * (later - rates)
        return NmpcState(rates, (memory.under_way[-1], possible), mean, covariance, True), wanted

    def _plan(self, memory: NmpcState, mean: Array, beside: Beside, situation: Situation, delta: float) -> Array:
        """The rates of the command that cost least, shape (STEPS,) [rad/s]."""
        m, solver = situation.machine, _solver()
        ways = [min(beside.place.s + abs(beside.speed) * STEP_S * (k + 0.5), beside.leg[1]) for k in range(STEPS)]
        curvatures = situation.route.curvatures(ways).tolist()
        u, theta = abs(beside.speed), radians(self.approach_deg)
        way, r = u * HORIZON_S, situation.reference
        pace = max(u, hypot(r.vx, r.vy))  # a tractor that waits will be faster
        heading = max(radians(self.heading_deg), self.offset_m / (APPROACH * HORIZON_S * pace))
        far = max(way * sin(theta), theta * (self.offset_m / heading) ** 2 / way)
        e_y, e, last = clip(beside.cross_track, -far, far), _tangent_error(beside, situation), memory.under_way[-1]
        weights = 1 / self.offset_m, 1 / heading, 1 / radians(self.rate_deg_s)
        rear = float(beside.direction < 0)
        keep = exp(-STEP_S / self.steering_lag_s), exp(-STEP_S / 2 / self.steering_lag_s)
        now = e_y, e, delta, mean[2], mean[3], sum(memory.under_way) / 2, last
        model = beside.speed, m.wheelbase_m, m.cg_to_rear_axle, *keep
        p = np.array((*now, *model, *weights, rear, *curvatures, *self._sideslips(curvatures, beside, situation)))
        limit = max(beside.limit, abs(last))
        return solver.solve(memory.rates, p, radians(self.steer_rate_deg_s), (-limit - last, limit - last))

    def _sideslips(self, curvatures: list[float], beside: Beside, situation: Situation) -> list[float]:
        """Sideslip of the CG that the path asks for at the end of each step, in reverse [rad]."""
        if beside.direction > 0:
            return [0.0] * STEPS
        l_r, way = situation.machine.cg_to_rear_axle, abs(beside.speed) * STEP_S
        beta = sideslip(situation.route, beside.place.s + way * STEPS, -1.0, beside.leg, l_r)
        found = [beta]
        for kappa in reversed(curvatures[1:]):
            target = asin(clip(l_r * kappa, -0.95, 0.95))
            beta = target + (beta - target) * exp(-way / l_r)
            found.append(beta)
        return found[::-1]

    def _observed(
        self, memory: NmpcState, beside: Beside, situation: Situation, delta: float, dt: float
    ) -> tuple[Array, Array]:
        """Mean and covariance of e_y, e, b and d from those of the tick before; a Kalman filter."""
        if abs(beside.heading) > STEEP:  # tyres slip, and the lag of the steering counts
            place = beside.cross_track, _tangent_error(beside, situation)
            return np.array([*place, *memory.mean[2:]]), memory.covariance
        (e_y, e, b, d), u, m = memory.mean.tolist(), situation.estimate.speed, situation.machine
        gamma, kappa = u * (tan(delta) / m.wheelbase_m + d), beside.place.curvature
        v = m.cg_to_rear_axle * gamma
        along = (u * cos(e) - v * sin(e)) / max(1 - kappa * e_y, 0.1)
        mean = np.array([e_y + dt * (u * sin(e) + v * cos(e) + u * b), e + dt * (gamma - kappa * along), b, d])
        F = np.eye(4)
        F[0, 1:3] = F[1, 3] = u * dt
        noise = 0.01, radians(0.2), radians(self.heading_walk_deg_rt_s), self.curvature_walk_m_rt_s
        moved = min(abs(u), 1.0)  # a tractor at rest tells nothing
        P = F @ memory.covariance @ F.T + dt * moved * np.diag(np.square(noise))
        R = np.diag([self.offset_noise_m**2, radians(self.heading_noise_deg) ** 2])
        gain = P[:, :2] @ np.linalg.inv(P[:2, :2] + R)
        seen = np.array([beside.cross_track, mean[1] + wrap(_tangent_error(beside, situation) - mean[1])])
        mean = mean + gain @ (seen - mean[:2])
        mean[2] = clip(float(mean[2]), -radians(15), radians(15))
        mean[3] = clip(float(mean[3]), -self.largest_curvature_m, self.largest_curvature_m)
        return mean, P - gain @ P[:2]

    @property
    def columns(self) -> tuple[Column, ...]:
        """Columns of every path-following law, and the disturbances."""
        return (*super().columns, *DISTURBANCE_COLUMNS)

    def report(self, state: FollowingState) -> Sequence[float]:
        """Values of `columns`."""
        return (*super().report(state), float(state.memory.mean[2]), float(state.memory.mean[3]))


def _tangent_error(beside: Beside, situation: Situation) -> float:
    """Heading less the path's tangent [rad]."""
    return wrap(situation.estimate.yaw - beside.place.yaw)


class _Solver:
    """Residuals of the plan and the quadratic program of a Gauss-Newton step, built once a process."""

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

    def solve(self, rates: Array, p: Array, fastest: float, room: tuple[float, float]) -> Array:
        """Rates [rad/s], at most `fastest`, whose sums stay in `room` [rad]."""
        for _ in range(ITERATIONS):
            residual, J = (np.array(part) for part in self.linear(rates, p))
            angle = self.sums @ rates
            step = self.program(
                h=J.T @ J + 1e-6 * np.eye(STEPS),
                g=J.T @ residual[:, 0],
                a=self.sums,
                lbx=-fastest - rates,
                ubx=fastest - rates,
                lba=room[0] - angle,
                uba=room[1] - angle,
            )
            rates = np.clip(rates + np.array(step["x"])[:, 0], -fastest, fastest)
        return rates


def _residuals(ca: Any, rates: Any, p: Any) -> Any:
    """Weighted errors over the horizon; `p` as in `Nmpc._plan`."""
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
        course = (
            half + v / u * ca.cos(half) + b
        )  # the angle: its sine would be small of a tractor that turned round, too
        answered = command = command + STEP_S * rates[k]
        askew = e + p[16 + STEPS + k]  # of the rear axle
        offset = e_y - rear * l_r * askew
        found += [w_y * offset, w_e * (course + rear * (askew + b - course)), w_r * rates[k]]
    return ca.vertcat(*found, 2 * w_y * offset)


@lru_cache(maxsize=1)
def _solver() -> _Solver:
    return _Solver(required("casadi", "nmpc", 'guidance.kind: "nmpc"'))
