"""Model of the fit: a linear bicycle model with relaxation of the tyre slip. Inputs are recorded steering and speed.

The model is independent of the plants, so that an error in a plant does not affect the fit. The state is x = (v, r,
a_f, a_r): lateral velocity of the CG, yaw rate, and relaxed slip of the tyres. With the velocity w of a wheel
perpendicular to its plane and its rolling speed V, the equations are

    sigma_f a_f' = w_f - V_f a_f,   w_f = (v + l_f r) cos d - u sin d,   V_f = |u| / cos d,
    sigma_r a_r' = w_r - |u| a_r,   w_r = v - l_r r,
    m (v' + u r) = -C_f cos d a_f - C_r a_r,   I r' = -l_f C_f cos d a_f + l_r C_r a_r.

These equations are also valid at standstill and in reverse. For small angles, cos d = 1 and sin d = d, as in the
paper's bicycle model. The integrator is the L-stable SDIRK2 [Hairer1996], which allows short relaxation lengths with
time constants sigma / u. The steering has a play of width b, and a first-order lag.
"""

from math import cos, exp, inf, sin
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from agrobot_mj.core.kernels import kernel
from agrobot_mj.core.signals import Array

STEP_S = 0.01  # Time step of the model [s]: with SDIRK2 the relative error of the yaw rate is 1e-4 at 1 Hz
GAMMA = 1.0 - 0.5 * 2.0**0.5  # Coefficient of SDIRK2 that makes it L-stable [-]
SHORTEST_RELAXATION_M = 1e-4  # Minimum relaxation length [m]


class Chassis2(NamedTuple):
    """Vehicle parameters that a fit treats as known."""

    mass: float  # Mass [kg]
    inertia: float  # Yaw inertia [kg m2]
    l_f: float  # Distance of the front axle ahead of the CG [m]
    l_r: float  # Distance of the rear axle behind the CG [m]
    small_angles: bool  # Whether the model assumes small steering angles: cos d = 1 and sin d = d


class Lateral(NamedTuple):
    """Tyre parameters that a fit estimates."""

    C_f: float  # Cornering stiffness of the front axle [N/rad]
    C_r: float  # Cornering stiffness of the rear axle [N/rad]
    sigma_f: float  # Relaxation length of the front tyres [m]
    sigma_r: float  # Relaxation length of the rear tyres [m]


class LateralMotion(NamedTuple):
    """Simulated motion of the vehicle. Each array has shape (n,), with one value per time step."""

    yaw_rate: Array  # Yaw rate [rad/s]
    yaw: Array  # Heading relative to the first step [rad]
    rear_x: Array  # Position of the rear-axle point R along the initial heading [m]
    rear_y: Array  # Position of the rear-axle point R to the left of the initial heading [m]
    side: Array  # Velocity of the rear-axle point R to the left of the heading [m/s]


def wheel_angle(steer: Array, dt: float, backlash: float, lag: float) -> Array:
    """Return the wheel angle [rad] for recorded angles `steer` [rad] at time steps `dt` [s]. The wheels follow the
    recorded angle with a play of width `backlash` [rad] and a first-order lag `lag` [s]."""
    angle, keep = np.empty_like(steer), exp(-dt / lag) if lag > 1e-4 else 0.0
    play(steer, 0.5 * max(backlash, 0.0), inf, angle)
    lagged: Array = lfilter([1.0 - keep], [1.0, -keep], angle, zi=[keep * angle[0]])[0]
    return lagged


@kernel
def play(angle: Array, half: float, centred: float, out: Array) -> None:
    """Apply a play of half width `half` [rad] to `angle` (n,) [rad]. Write the result to `out` (n,), which is constant
    within the play.

    Before each step, an absolute output above `centred` [rad] returns to `centred`, as far as the play allows.
    """
    out[0] = angle[0]
    for k in range(1, angle.shape[0]):
        held = min(max(out[k - 1], -centred), centred)
        out[k] = min(max(held, angle[k] - half), angle[k] + half)


def simulate(chassis: Chassis2, tyres: Lateral, u: Array, delta: Array, dt: float) -> LateralMotion:
    """Simulate the motion for speed `u` [m/s] and wheel angle `delta` [rad], both (n,), starting without slip."""
    out = np.zeros((5, len(u)))
    advance(chassis, tyres, u, delta, dt, out)
    return LateralMotion(*out)


@kernel
def advance(chassis: Chassis2, tyres: Lateral, u: Array, delta: Array, dt: float, out: Array) -> None:
    """Integrate the vehicle model with time step `dt` [s]. Write yaw rate, yaw, x, y and lateral velocity of the
    rear-axle point R to the rows of `out` (5, n)."""
    m, I_z, l_f, l_r = chassis.mass, chassis.inertia, chassis.l_f, chassis.l_r
    C_f, C_r = tyres.C_f, tyres.C_r
    s_f, s_r = max(tyres.sigma_f, SHORTEST_RELAXATION_M), max(tyres.sigma_r, SHORTEST_RELAXATION_M)
    r = u[0] * delta[0] / (l_f + l_r)
    v, a_f, a_r = l_r * r, 0.0, 0.0
    psi, x, y, h = 0.0, 0.0, 0.0, GAMMA * dt
    for k in range(u.shape[0]):
        out[0, k], out[1, k], out[2, k], out[3, k], out[4, k] = r, psi, x, y, v - l_r * r
        if k + 1 == u.shape[0]:
            break
        r0, psi0, side0 = r, psi, v - l_r * r
        kv1, kr1, kf1, kb1 = 0.0, 0.0, 0.0, 0.0
        vs, rs, fs, bs = v, r, a_f, a_r
        for stage in range(2):
            # state plus the part of the first stage, and inputs at the time of the stage: gamma dt, then dt
            share = GAMMA if stage == 0 else 1.0
            U = u[k] + share * (u[k + 1] - u[k])
            d = delta[k] + share * (delta[k + 1] - delta[k])
            c, s = (1.0, d) if chassis.small_angles else (cos(d), sin(d))
            V = abs(U)
            if stage == 1:
                w = (1.0 - GAMMA) * dt
                vs, rs, fs, bs = v + w * kv1, r + w * kr1, a_f + w * kf1, a_r + w * kb1
            # implicit: a_f = (s_f fs + h w_f) / (s_f + h V_f), linear in v and r; then a 2 x 2 system for v and r
            g_f, g_r = 1.0 / (s_f + h * V / c), 1.0 / (s_r + h * V)
            e_f, e_r = C_f * c * h * g_f, C_r * h * g_r
            # forces: Y_f = -C_f c a_f = -(p_f + e_f (c (v + l_f r) - U s)), Y_r likewise
            p_f, p_r = C_f * c * s_f * g_f * fs, C_r * s_r * g_r * bs
            f0, q = -p_f + e_f * U * s, h / m
            z = h / I_z
            A11 = 1.0 + q * (e_f * c + e_r)
            A12 = q * (e_f * c * l_f - e_r * l_r + m * U)
            A21 = z * (l_f * e_f * c - l_r * e_r)
            A22 = 1.0 + z * (l_f * l_f * e_f * c + l_r * l_r * e_r)
            b1, b2 = vs + q * (f0 - p_r), rs + z * (l_f * f0 + l_r * p_r)
            det = A11 * A22 - A12 * A21
            vn, rn = (b1 * A22 - A12 * b2) / det, (A11 * b2 - A21 * b1) / det
            fn = g_f * (s_f * fs + h * ((vn + l_f * rn) * c - U * s))
            bn = g_r * (s_r * bs + h * (vn - l_r * rn))
            if stage == 0:
                kv1, kr1, kf1, kb1 = (vn - vs) / h, (rn - rs) / h, (fn - fs) / h, (bn - bs) / h
            else:
                v, r, a_f, a_r = vn, rn, fn, bn
        psi += 0.5 * dt * (r0 + r)
        middle = 0.5 * (psi0 + psi)
        U, side = 0.5 * (u[k] + u[k + 1]), 0.5 * (side0 + v - l_r * r)
        x += dt * (U * cos(middle) - side * sin(middle))
        y += dt * (U * sin(middle) + side * cos(middle))


def understeer_gradient(chassis: Chassis2, compliance_f: float, compliance_r: float) -> float:
    """Return the understeer gradient [rad s2/m] for the axle compliances 1/C_f and 1/C_r."""
    m, L = chassis.mass, chassis.l_f + chassis.l_r
    return m / L * (chassis.l_r * compliance_f - chassis.l_f * compliance_r)
