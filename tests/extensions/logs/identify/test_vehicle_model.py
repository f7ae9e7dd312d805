"""Vehicle model of the fit compared with SciPy's solver, closed forms, and a play computed by hand."""

from math import pi, radians

import numpy as np
import pytest
from machines import INERTIA, L_F, L_R, MASS
from scipy.integrate import solve_ivp

from agrobot_mj.extensions.logs.identify.model import (
    STEP_S,
    Chassis2,
    Lateral,
    simulate,
    understeer_gradient,
    wheel_angle,
)

TYRES = Lateral(12e3, 26e3, 0.4, 0.7)
L = L_F + L_R


def chassis(small=True):
    return Chassis2(MASS, INERTIA, L_F, L_R, small)


@pytest.mark.parametrize("small", [True, False])
@pytest.mark.parametrize("way", [1.0, -1.0])
def test_vehicle_model_agrees_with_a_general_ode_solver(small, way):
    """The motion includes reverse, angles of 20 deg, and a changing speed."""

    def delta(t):
        return radians(20) * np.sin(2 * pi * 0.3 * t)

    def u(t):
        return way * (2.0 + 0.8 * np.sin(t))

    def rate(t, s):
        v, r, a_f, a_r, psi, x, y = s
        d, V = delta(t), abs(u(t))
        c, n = (1.0, d) if small else (np.cos(d), np.sin(d))
        Y_f, Y_r = -TYRES.C_f * a_f * c, -TYRES.C_r * a_r
        side = v - L_R * r
        return [
            (Y_f + Y_r) / MASS - u(t) * r,
            (L_F * Y_f - L_R * Y_r) / INERTIA,
            ((v + L_F * r) * c - u(t) * n - V / c * a_f) / TYRES.sigma_f,
            (side - V * a_r) / TYRES.sigma_r,
            r,
            u(t) * np.cos(psi) - side * np.sin(psi),
            u(t) * np.sin(psi) + side * np.cos(psi),
        ]

    t = STEP_S * np.arange(800)
    exact = solve_ivp(rate, (0, t[-1]), np.zeros(7), t_eval=t, rtol=1e-9, atol=1e-11).y
    found = simulate(chassis(small), TYRES, u(t), delta(t), STEP_S)
    assert np.abs(found.yaw_rate - exact[1]).max() < 2e-3 * np.abs(exact[1]).max()
    assert found.yaw == pytest.approx(exact[4], abs=1e-3)
    assert np.hypot(found.rear_x - exact[5], found.rear_y - exact[6]).max() < 5e-3


def test_steady_state_yaw_gain_follows_from_the_understeer_gradient():
    u, delta = np.full(2000, 3.0), np.full(2000, radians(4))
    K = understeer_gradient(chassis(), 1 / TYRES.C_f, 1 / TYRES.C_r)
    found = simulate(chassis(), TYRES, u, delta, STEP_S)
    assert found.yaw_rate[-1] == pytest.approx(3.0 * radians(4) / (L + K * 9.0), rel=1e-6)


def test_model_stays_finite_at_standstill_and_without_relaxation_length():
    u = np.concatenate([np.full(500, 3.0), np.linspace(3.0, 0.0, 100), np.zeros(400)])
    found = simulate(chassis(), Lateral(12e3, 26e3, 0.0, 0.0), u, np.full(1000, 0.1), STEP_S)
    assert np.isfinite(found.yaw_rate).all()
    assert abs(found.yaw_rate[-1]) < 1e-3


def test_wheels_follow_the_cylinder_after_crossing_the_backlash():
    steer = np.array([0.0, 1.0, 2.0, 1.5, 1.2, 0.9, 0.0])
    assert wheel_angle(steer, 0.01, 1.0, 0.0) == pytest.approx([0.0, 0.5, 1.5, 1.5, 1.5, 1.4, 0.5])


def test_modelled_steering_lag_is_a_first_order_lag():
    found = wheel_angle(np.concatenate([[0.0], np.ones(200)]), 0.01, 0.0, 0.2)
    assert found[20] == pytest.approx(1 - np.exp(-1.0), abs=1e-3)
