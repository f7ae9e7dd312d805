"""PI controller of the yaw rate, alone and with feed-forward."""

from math import radians

import numpy as np
import pytest
from drives import MACHINE, Bend

from agrobot_mj.control import Feedforward, Pd, Pi, Situation
from agrobot_mj.core.signals import TICK_S, Estimate
from agrobot_mj.paths.route import SampledRoute

LIMIT = radians(45)


def test_command_is_proportional_plus_integral_term() -> None:
    law, state = Pi(kp=0.5, ki=0.2), Pi().init()
    for _ in range(20):
        state, command = law.update(state, 0.0, 0.1, TICK_S, LIMIT)
    assert command.tau_c == pytest.approx(0.05)
    assert command.steer == pytest.approx(0.05 + 0.2 * 0.1 * 20 * TICK_S)


def test_pi_controller_with_zero_integral_gain_equals_a_p_controller() -> None:
    errors, pi, pd = np.sin(np.arange(50.0)), Pi(kp=0.4, ki=0.0), Pd(kp=0.4)
    a, b = pi.init(), pd.init()
    for e in errors.tolist():
        a, one = pi.update(a, 0.0, e, TICK_S, LIMIT)
        b, other = pd.update(b, 0.0, e, TICK_S, LIMIT)
        assert one.steer == other.steer


def integral_after(kappa: float, yaw_rate: float, seconds: float = 60.0) -> float:
    """Return the integral [rad] after a drive with feed-forward at a constant yaw rate."""
    path = Bend(1.0, kappa, 0.0)
    route, law = SampledRoute(path), Feedforward().using(Pi(kp=0.1, ki=0.2))
    state, steer = law.init(), 0.0
    for k in range(round(seconds / TICK_S)):
        t = k * TICK_S
        r = path.at(t)
        e = Estimate(r.x, r.y, r.yaw, 1.0, yaw_rate, r.x, r.y, np.eye(3))
        state, command = law.update(state, Situation(t, e, r, route, MACHINE, steer), TICK_S)
        steer = command.steer
        assert abs(command.steer) <= MACHINE.steer_limit
    return float(state.controller.integral)


def test_pi_integral_is_limited_to_steering_limit_minus_feedforward() -> None:
    """On an arc that needs most of the steering angle, the integral is limited to the remaining angle."""
    kappa = 0.6
    ahead = np.arctan(MACHINE.wheelbase_m * kappa)
    assert integral_after(kappa, -0.25) == pytest.approx(MACHINE.steer_limit - ahead, abs=0.1)
    assert integral_after(0.0, -0.25) > 2 * integral_after(kappa, -0.25)


def test_integral_is_frozen_during_acquisition_and_steering_lag() -> None:
    assert integral_after(0.0, -0.4) == 0.0
    law, path = Feedforward().using(Pi(kp=0.1, ki=0.2)), Bend(1.0, 0.0, 0.0)
    r = path.at(0.0)
    e = Estimate(r.x, r.y, r.yaw, 1.0, -0.25, r.x, r.y, np.eye(3))
    for steer, moves in ((0.0, True), (-0.2, False)):
        situation = Situation(0.0, e, r, SampledRoute(path), MACHINE, steer)
        assert (law.update(law.init(), situation, TICK_S)[0].controller.integral > 0.0) == moves
