"""LQR on the linear bicycle model with steady-state slip, steering lag and delay, integral action and feed-forward.

Model at the speed u (negative in reverse), with the errors e_y (cross-track) and e_psi (heading) of the CG, the yaw
rate gamma, and the steering angle delta and its command delta_c, both minus the feed-forward angle:
  e_y' = u e_psi + a gamma,  e_psi' = gamma,  gamma = u delta / (L + K u^2),  tau delta' = delta_c(t - T) - delta,
with the mass m, wheelbase L, axle distances l_f and l_r from the CG, cornering stiffnesses C_f and C_r, lag tau and
delay T of the steering, understeer K = m (l_r C_r - l_f C_f) / (L C_f C_r), and distance a = l_r - m l_f u^2 / (L C_r)
from the CG to the point without sideslip [Snider2009], [Rajamani2012]. The model is discretised with the time
step of one tick; the delayed commands are additional states. The cost is
  (e_y / offset)^2 + (e_psi / heading)^2 + (delta' / rate)^2 + (delta_c / steer)^2 + (integral of e_y / integral)^2.
The gains follow from the discrete Riccati equation, solved once per process on a grid of speeds, and are interpolated.

The integral q is stored as  v = q + P_qx x / P_qq,  with the other states x and the solution P of the Riccati equation.
The cost x' P x + P_qq v^2 has no product of x and v. Hence v = 0 is the optimal initial value for any x, and the
integral does not wind up while the tractor acquires a line. v is stored as an angle. v is frozen while the command is
at its limit, during the approach to the path (at large distance or angle), at standstill, and until the heading is
known. Until then the supervisor steers.

The law works forward and in reverse at any speed within the grid. The law has no steady-state error under constant
disturbances (slope, steering bias, payload). After a step disturbance, the integral term converges with the time
constant `integral_m_s` / `offset_m`, 18.6 s by default. A side slope changes its direction relative to the tractor at
each turn of 180 deg, and thus causes a step disturbance: on a slope of 6 deg, the steering angle of the integral term
of `compact` changes from 3.1 to -3.5 deg within 17-19 s (63 % of the change) at 2 m/s. Disturbances that change faster
than the integral, such as a heading bias on each arc, cause transient errors. The law also does not correct errors of
the estimate, such as those due to an antenna tilted by a slope.
"""

from functools import lru_cache
from math import radians
from typing import Annotated, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field

from agrobot_mj.control.base import Situation
from agrobot_mj.control.deviation import (
    STEEP,
    CommandLimits,
    Followed,
    PathDeviation,
    Situated,
    deviated_on,
    integral_columns,
    limited_commands,
)
from agrobot_mj.control.following import Integrating
from agrobot_mj.core.held import Held
from agrobot_mj.core.kernels import copy_into, fetched, held, jit, shared, stage
from agrobot_mj.core.signals import TICK_S, Array, Matrix, Reference, Vector
from agrobot_mj.core.spec import Latency, Positive
from agrobot_mj.machine.tractor import TractorParameters

SPEEDS = (0.3, 0.5, 0.75, 1.0, 1.25, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0)
"""Absolute speeds [m/s] for which gains are computed, in both directions of travel."""
STANDING_M_S = 0.1  # Speed below which the integral is frozen [m/s]


class LqrState(NamedTuple):
    """State of `Lqr` between two ticks."""

    integral: float = 0.0  # Integral of the cross-track error, stored as a steering angle [rad]
    delayed: Vector = np.zeros(0)
    """Feedback parts of the steering commands issued during the last steering delay [rad], oldest first."""
    errors: Vector = np.zeros(0)
    """Path errors, steering angle and delayed commands at the last tick, or an empty array before the first tick."""
    table: Matrix = np.zeros((0, 0))  # Gains by speed, see `_table`, or an empty array before the first tick


class SteadySlip(NamedTuple):
    """Tractor parameters for the steady-state slip of the bicycle model."""

    l_r: float  # Distance from the CG to the rear axle [m]
    front_load: float  # Mass times distance from the CG to the front axle [kg m]
    stiffness: float  # Wheelbase times rear cornering stiffness [N m/rad]
    understeer: float  # Understeer K [s2/m]
    wheelbase: float  # Wheelbase L [m]


class LqrLaw(NamedTuple):
    """Parameters of `Lqr` as numbers for compiled kernels."""

    limits: CommandLimits
    approach: float
    integral: float  # Limits of the angles of approach and integral term [rad]
    slip: SteadySlip


@shared
def rolling(p: SteadySlip, speed: float) -> tuple[float, float]:
    """Return the distance a from the CG to the point without sideslip and the effective wheelbase L + K u^2 [m]."""
    u2 = speed * speed
    a = p.l_r - p.front_load * u2 / p.stiffness
    return max(a, 0.1 * p.l_r), max(p.wheelbase + p.understeer * u2, 0.5 * p.wheelbase)


@jit
def steering(
    limits: tuple[float, float], memory: LqrState, deviation: PathDeviation, speed: float, aligned: bool,
    steer: float, dt: float,
) -> tuple[LqrState, float]:  # fmt: skip
    """Return the new state and steering angle [rad]; `limits` [rad] are the maximum approach and integral angles."""
    row = _gains_at_speed(memory.table, deviation.speed)
    n = (row.size + 1) // 2
    k, transient, first = row[:n], row[n:], memory.errors.size == 0
    errors, delayed = np.zeros(n - 1), np.zeros(memory.delayed.size)
    direct = k[:-1] - k[-1] * transient
    far = abs(limits[0] * direct[1] / direct[0])
    errors[0] = min(max(deviation.cross_track, -far), far)
    errors[1], errors[2] = deviation.heading, steer - deviation.bias - deviation.steer_here
    copy_into(errors[3:], memory.delayed)
    feedback = moved = 0.0
    for i in range(n - 1):
        feedback += direct[i] * errors[i]
        moved += 0.0 if first else transient[i] * (errors[i] - memory.errors[i])
    wanted, most = deviation.steer_ahead + memory.integral - feedback, deviation.limit
    possible = min(max(wanted, -most - deviation.bias), most - deviation.bias)
    near = errors[0] == deviation.cross_track and abs(deviation.heading) < STEEP and aligned
    integral = memory.integral
    if wanted == possible and abs(speed) >= STANDING_M_S:
        step = -k[-1] * (errors[0] * dt + moved) if near else 0.0
        integral = min(max(integral + step, -limits[1]), limits[1])
    for i in range(delayed.size):
        delayed[i] = memory.delayed[i + 1] if i + 1 < delayed.size else possible - deviation.steer_ahead
    return LqrState(integral, delayed, errors, memory.table), wanted


@jit
def _gains_at_speed(table: Matrix, speed: float) -> Vector:
    """Return the gains and ratios P_qx / P_qq of `_gains`, interpolated at `speed` [m/s] (negative in reverse)."""
    n = len(SPEEDS)
    u, first = min(max(abs(speed), SPEEDS[0]), SPEEDS[-1]), n if speed < 0 else 0
    k = 1
    while k < n - 1 and SPEEDS[k] <= u:
        k += 1
    weight = (u - SPEEDS[k - 1]) / (SPEEDS[k] - SPEEDS[k - 1])
    low, high = table[first + k - 1], table[first + k]
    row: Vector = low + weight * (high - low)
    return row


@stage
def _tick(
    p: Held[LqrLaw],
    memory: Held[LqrState],
    last: tuple[float, float],
    samples: Matrix,
    seen: Situated,
    r: Reference,
    dt: float,
) -> tuple[Held[LqrState], Followed, float, Vector]:
    """Return the new state, the command, the arc length [m] up to which the path must be sampled, and log values.
    `last` contains the last direction of travel and the last speed command [m/s]."""
    p, e = fetched(p), fetched(seen.estimate)
    deviation, most = deviated_on(p.limits, last[0], samples, seen, r, rolling(p.slip, e.speed))
    limits = p.approach, p.integral
    after, wanted = steering(limits, fetched(memory), deviation, e.speed, e.aligned, seen.steer, dt)
    found = limited_commands(p.limits, deviation, r, seen, wanted, last[1], dt)
    return held(after), found, most, integral_columns(found, after.integral)


_steering = stage(steering)


class Lqr(Integrating):
    """Linear-quadratic regulator of cross-track error, heading error and steering angle."""

    sized: ClassVar = {
        "front_cornering_stiffness_n_rad": {"front_load": 1},
        "rear_cornering_stiffness_n_rad": {"rear_load": 1},
    }

    kind: Literal["lqr"] = "lqr"
    label: ClassVar = "LQR"
    compiled = staticmethod(_tick)
    front_cornering_stiffness_n_rad: Positive = 14_800.0
    """Cornering stiffness C_f of the front axle [N/rad]. Assumed value, equal to the value of the bicycle plant."""
    rear_cornering_stiffness_n_rad: Positive = 30_000.0
    """Cornering stiffness C_r of the rear axle [N/rad]. Assumed value, equal to the value of the bicycle plant."""
    steering_lag_s: Positive = 0.7
    """Time constant tau of the closed steering loop [s]. Assumed value (0.25 with a new valve, 1.3 with a worn one)."""
    steering_delay_s: Latency = 0.1
    """Delay T of the valve, a multiple of the tick [s]. Assumed value, equal to the default of `steering.valve`."""
    offset_m: Positive = 0.14
    """Cross-track error that contributes 1 to the cost [m]. Assumed value (range 0.1-0.4) from tuning."""
    heading_deg: Positive = 3.9
    """Heading error that contributes 1 to the cost [deg]. Assumed value (range 3-15) from tuning."""
    rate_deg_s: Positive = 35.0
    """Steering rate that contributes 1 to the cost [deg/s]. Assumed value from tuning; manual tuning gives 4-15."""
    steer_deg: Positive = 6.0
    """Deviation from the feed-forward angle that contributes 1 to the cost [deg]. Assumed value (range 3-15)
    from tuning."""
    integral_m_s: Positive | None = 2.6
    """Integral of the cross-track error that contributes 1 to the cost [m s]; null disables integral action. Assumed
    value (range 1-5), with which the integral term has a time constant of 18.6 s."""
    integral_limit_deg: Annotated[float, Field(gt=0, le=45)] = 15.0
    """Maximum steering angle of the integral term [deg]. Assumed value, sufficient for a side slope of 20 deg."""
    tunable: ClassVar = {
        "offset_m": (0.02, 0.5),
        "heading_deg": (2.0, 30.0),
        "rate_deg_s": (3.0, 60.0),
        "integral_m_s": (0.1, 3.0),
    }
    """Search ranges for tuning the gains."""

    def memory(self) -> LqrState:
        """Return the initial state; the delayed commands are zero and the gains are not yet computed."""
        return LqrState(delayed=np.zeros(round(self.steering_delay_s / TICK_S)))

    def steering(
        self, memory: LqrState, deviation: PathDeviation, situation: Situation, dt: float
    ) -> tuple[LqrState, float]:
        """Return the new state and the steering angle [rad], the sum of feed-forward, feedback and integral term."""
        if not memory.table.size:
            memory = self.begin(memory, situation.machine)
        e = situation.estimate
        return _steering(self._limits, memory, deviation, e.speed, e.aligned, situation.steer, dt)

    def begin(self, memory: LqrState, machine: TractorParameters) -> LqrState:
        """Return the initial state `memory` with the table of feedback gains for a tractor."""
        return memory._replace(table=_table(self, machine))

    def parameters(self, limits: CommandLimits, machine: TractorParameters) -> LqrLaw:
        """Return the parameters of the law for a tractor, as numbers for the compiled tick function."""
        return LqrLaw(limits, *self._limits, slip_of(self, machine))

    @property
    def _limits(self) -> tuple[float, float]:
        return radians(self.approach_deg), radians(self.integral_limit_deg)

    def gains(self, machine: TractorParameters, speed: float) -> list[float]:
        """Return the feedback gains for path errors, steering angle, delayed commands and integral at a speed [m/s]."""
        found = _gains_at_speed(_table(self, machine), speed)
        return [float(gain) for gain in found[: (found.size + 1) // 2]]

    def rolling(self, situation: Situation) -> tuple[float, float]:
        """Return the distance [m] from the CG to the point without sideslip, and the effective wheelbase [m]."""
        return rolling(slip_of(self, situation.machine), situation.estimate.speed)


def slip_of(law: Lqr, machine: TractorParameters) -> SteadySlip:
    """Return the parameters of the steady-state slip of a tractor with the cornering stiffnesses of a law."""
    m, L, l_f, l_r = machine.mass_kg, machine.wheelbase_m, machine.cg_to_front_axle, machine.cg_to_rear_axle
    C_f, C_r = law.front_cornering_stiffness_n_rad, law.rear_cornering_stiffness_n_rad
    return SteadySlip(l_r, m * l_f, L * C_r, m * (l_r * C_r - l_f * C_f) / (L * C_f * C_r), L)


@lru_cache(maxsize=64)
def _table(law: Lqr, machine: TractorParameters) -> Matrix:
    """Return the gains and ratios P_qx / P_qq (see `_gains`): a row per forward speed, then a row per reverse speed."""
    return np.array([np.concatenate(_gains(law, machine, sign * u)) for sign in (1, -1) for u in SPEEDS])


def _gains(law: Lqr, machine: TractorParameters, u: float) -> tuple[Array, Array]:
    """Return the gains at the speed `u` [m/s], shape (4 + n,), and the ratios P_qx / P_qq, shape (3 + n,).

    P is the solution of the Riccati equation, q is the integral, and x are the other states with n delayed commands.
    The gain of q is last.
    """
    from scipy.linalg import solve_discrete_are  # slow import (0.1 s), needed only by this law

    a, wheelbase = rolling(slip_of(law, machine), u)
    n = round(law.steering_delay_s / TICK_S)
    A, B = _discrete_model(a, u / wheelbase, u, law.steering_lag_s, n)
    rate = np.zeros(4 + n)
    rate[2], answered = -1 / law.steering_lag_s, 1 / law.steering_lag_s
    if n:
        rate[3] = answered
    Q = np.outer(rate, rate) / radians(law.rate_deg_s) ** 2
    Q[0, 0] += law.offset_m**-2
    Q[1, 1] += radians(law.heading_deg) ** -2
    R = np.array([[radians(law.steer_deg) ** -2 + (0 if n else (answered / radians(law.rate_deg_s)) ** 2)]])
    size = 4 + n if law.integral_m_s else 3 + n
    if law.integral_m_s:
        Q[-1, -1] += law.integral_m_s**-2
    A, B, Q = A[:size, :size], B[:size], Q[:size, :size]
    P = solve_discrete_are(A, B, Q, R)
    K = np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A)[0]
    return (K, P[-1, :-1] / P[-1, -1]) if law.integral_m_s else (np.append(K, 0.0), np.zeros(3 + n))


def _discrete_model(a: float, turn: float, u: float, lag: float, n: int) -> tuple[Array, Array]:
    """Return the discrete state and input matrices of the lateral motion for a time step of one tick.

    States: cross-track error, heading error, steering angle, n delayed commands, integral of the cross-track error. `a`
    is the distance from the CG to the point without sideslip [m]; `turn` is the yaw rate per steering angle [1/s].
    """
    from scipy.linalg import expm

    continuous = np.zeros((5, 5))  # e_y, e_psi, delta, integral, command (constant over the tick)
    continuous[0, 1:3] = u, a * turn
    continuous[1, 2] = turn
    continuous[2, 2], continuous[2, 4] = -1 / lag, 1 / lag
    continuous[3, 0] = 1.0
    step = expm(continuous * TICK_S)
    A, B = np.zeros((4 + n, 4 + n)), np.zeros((4 + n, 1))
    places = [0, 1, 2, 3 + n]
    A[np.ix_(places, places)] = step[:4, :4]
    if n:
        A[places, 3] = step[:4, 4]
        A[range(3, 2 + n), range(4, 3 + n)] = 1.0
        B[2 + n, 0] = 1.0
    else:
        B[places, 0] = step[:4, 4]
    return A, B
