"""Adaptive steering loop: learned gain and dead band of a new and a worn valve, and its guards."""

from collections import deque
from math import copysign, pi, radians, sin

import numpy as np
import pytest

from agrobot_mj.control import SteeringLoop
from agrobot_mj.core.signals import NEUTRAL_V, TICK_S
from agrobot_mj.extensions.learners.adaptive_loop import GAIN_SHARES, WIDEST_V, AdaptiveLoop, Stretch

SOUND = ((0.12, 0.105), (0.4, 0.4))
WORN = ((0.06, 0.05), (1.0, 1.1))
NOISE = radians(0.08)


def steer(loop, seconds, valve=SOUND, wanted=None, noise=NOISE, state=None, stuck=False):
    """Return reference and true angles per tick, and the state. Delay and lag are 0.1 s; `valve` contains the gains and
    dead bands of both sides."""
    dt, angle, spool = 0.005, 0.0, 0.0
    state = state._replace(steer=None, piece=Stretch()) if state else loop.init()
    generator = np.random.default_rng(3)
    queue, angles, asked = deque([0.0] * round(0.1 / dt)), [], []
    for k in range(round(seconds / TICK_S)):
        t = k * TICK_S
        target = wanted(t) if wanted else radians(12 * sin(2 * pi * t / 14) + 4 * sin(2 * pi * t / 3.1))
        seen = 0.0 if stuck else angle + noise * generator.standard_normal()
        state, voltage = loop.update(state, target, seen, TICK_S)
        assert 0.0 <= voltage <= 2 * NEUTRAL_V
        for _ in range(round(TICK_S / dt)):
            queue.append(voltage - NEUTRAL_V)
            spool += dt / 0.1 * (queue.popleft() - spool)
            side = 0 if spool > 0 else 1
            angle += dt * copysign(min(max(abs(spool) - valve[1][side], 0.0) * valve[0][side], 0.48), spool)
        angles.append(angle)
        asked.append(target)
    return np.array(asked), np.array(angles), state


@pytest.mark.parametrize("valve", [SOUND, WORN], ids=["sound", "worn"])
def test_adaptive_loop_identifies_gain_and_dead_band_of_both_sides(valve) -> None:
    _, _, state = steer(AdaptiveLoop(), 120.0, valve)
    assert [side.gain for side in state.sides] == pytest.approx(valve[0], rel=0.15)
    assert [side.dead_band for side in state.sides] == pytest.approx(valve[1], abs=0.15)


def test_adaptive_loop_has_smaller_error_with_a_worn_valve_than_fixed_loop() -> None:
    late = round(60 / TICK_S)
    errors = {}
    for loop in (SteeringLoop(), AdaptiveLoop()):
        asked, angles, _ = steer(loop, 120.0, WORN)
        errors[loop.kind] = np.sqrt(np.mean((asked - angles)[late:] ** 2))
    assert errors["adaptive"] < 0.6 * errors["pid"]


@pytest.mark.parametrize("valve", [SOUND, WORN], ids=["sound", "worn"])
@pytest.mark.parametrize("step_deg", [-30.0, 2.0, 10.0])
def test_steering_step_response_settles_without_a_limit_cycle(step_deg: float, valve) -> None:
    _, _, state = steer(AdaptiveLoop(), 120.0, valve)
    _, angles, _ = steer(AdaptiveLoop(), 12.0, valve, lambda t: radians(step_deg), state=state)
    response = np.degrees(angles)
    assert response[-100:] == pytest.approx(step_deg, abs=0.4)
    assert np.ptp(response[-100:]) < 0.4
    assert np.abs(response).max() < 1.1 * abs(step_deg) + 0.3


def test_adaptive_loop_tracks_a_wearing_valve() -> None:
    _, _, state = steer(AdaptiveLoop(), 60.0, SOUND)
    _, _, state = steer(AdaptiveLoop(), 240.0, WORN, state=state)
    assert [side.dead_band for side in state.sides] == pytest.approx(WORN[1], abs=0.3)


def test_valve_parameter_estimates_stay_bounded_with_a_stuck_sensor() -> None:
    loop = AdaptiveLoop()
    _, _, state = steer(loop, 120.0, stuck=True)
    for side in state.sides:
        assert GAIN_SHARES[0] * radians(loop.gain_deg_s_v) <= side.gain <= GAIN_SHARES[1] * radians(loop.gain_deg_s_v)
        assert 0.0 <= side.dead_band <= WIDEST_V


def test_valve_model_worse_than_the_initial_model_is_discarded() -> None:
    loop = AdaptiveLoop(gain_deg_s_v=6.5, dead_band_v=0.4)
    sound = loop.init()
    wrong = sound._replace(
        sides=tuple(side._replace(offset=side.offset + 0.2, P=(0.0, 0.0, 0.0)) for side in sound.sides)
    )
    _, _, state = steer(loop, 60.0, state=wrong)
    assert state.resets >= 1
    assert [side.dead_band for side in state.sides] == pytest.approx(SOUND[1], abs=0.15)


def test_valve_parameters_stay_at_configured_values_without_learning() -> None:
    loop = AdaptiveLoop(learn=False)
    _, _, state = steer(loop, 30.0)
    assert state.sides == loop.init().sides


def test_mirrored_steering_angles_give_mirrored_voltages() -> None:
    alike = ((0.1, 0.1), (0.5, 0.5))
    ask = lambda t: radians(10 * sin(t))  # noqa: E731
    left = steer(AdaptiveLoop(), 20.0, alike, ask, noise=0.0)[1]
    right = steer(AdaptiveLoop(), 20.0, alike, lambda t: -ask(t), noise=0.0)[1]
    assert left == pytest.approx(-right, abs=1e-12)
