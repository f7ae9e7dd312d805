from collections import deque
from math import copysign, degrees, radians

import numpy as np
import pytest

from agrobot_mj.control.pid import (
    NEUTRAL_V,
    FilteredRate,
    Pid,
    PidState,
    SpeedLoop,
    SteeringLoop,
    over_dead_band,
    pedal_step,
    speed_step,
)

TICK = 0.05


def _run(pid: Pid, errors: list[float], low: float = -10.0, high: float = 10.0) -> list[float]:
    state, outputs = pid.init(), []
    for error in errors:
        state, output = pid.update(state, error, TICK, low, high)
        outputs.append(output)
    return outputs


def test_pid_output_is_the_sum_of_its_terms_on_a_ramp() -> None:
    errors = [0.1 * k for k in range(30)]
    outputs = _run(Pid(kp=2.0, ki=0.5, kd=0.3, derivative_filter_s=0.0), errors)
    integrals = 0.5 * TICK * np.cumsum(errors)
    expected = [2 * e + i + 0.3 * 0.1 / TICK for e, i in zip(errors, integrals, strict=True)]
    assert outputs[0] == 0
    assert outputs[1:] == pytest.approx(expected[1:])


def test_derivative_term_is_zero_for_the_first_error() -> None:
    assert _run(Pid(kp=0.0, kd=5.0), [3.0]) == [0.0]


def test_derivative_filter_has_the_configured_time_constant() -> None:
    slope = FilteredRate().after(0.0, 0.001, 0.2)
    for k in range(200):
        slope = slope.after(0.001 * (k + 1), 0.001, 0.2)
    assert slope.rate == pytest.approx(1 - np.exp(-1), rel=0.01)


def test_integral_is_held_at_the_output_limit_and_does_not_wind_up() -> None:
    pid = Pid(kp=1.0, ki=1.0)
    outputs = _run(pid, [5.0] * 400 + [-0.5], low=-1.0, high=1.0)
    assert outputs[399] == 1.0
    assert outputs[400] < 0


def test_pid_output_stays_within_its_limits() -> None:
    outputs = _run(Pid(kp=3.0, ki=5.0, kd=1.0), [4.0, -4.0] * 50, low=-0.2, high=0.7)
    assert min(outputs) == -0.2
    assert max(outputs) == 0.7


def test_dead_band_compensation_is_odd_and_continuous() -> None:
    assert over_dead_band(0.9, 0.3, 1.0) == 0
    assert over_dead_band(1.5, 0.3, 1.0) == pytest.approx(0.15)
    assert over_dead_band(9.0, 0.3, 1.0) == pytest.approx(0.3)
    errors = np.linspace(-4, 4, 8001)
    jumps = np.array([over_dead_band(e, 0.3, 1.0) for e in errors])
    assert jumps == pytest.approx(-jumps[::-1])
    assert np.abs(np.diff(jumps)).max() < 0.001


def _valve_rate(v: float, dead: float, gain: float, limit: float) -> float:
    return copysign(min(max(abs(v) - dead, 0) * gain, limit), v)


def _steer_step(loop: SteeringLoop, target: float, seconds: float = 8.0) -> np.ndarray:
    """Return the wheel angle per tick [rad]: 0.1 s delay and lag, 0.4 V dead band, and 0.12 rad/s per V."""
    dt, steer, spool, state = 0.005, 0.0, 0.0, loop.init()
    queue, angles = deque([0.0] * round(0.1 / dt)), []
    for _ in range(round(seconds / TICK)):
        state, voltage = loop.update(state, target, steer, TICK)
        assert 0 <= voltage <= 12
        for _ in range(round(TICK / dt)):
            queue.append(voltage - NEUTRAL_V)
            spool += dt / 0.1 * (queue.popleft() - spool)
            steer += dt * _valve_rate(spool, 0.4, 0.12, 0.48)
        angles.append(steer)
    return np.array(angles)


@pytest.mark.parametrize("step_deg", [-30.0, -10.0, 2.0, 10.0, 30.0])
def test_steering_step_response_is_fast_and_well_damped(step_deg: float) -> None:
    response = _steer_step(SteeringLoop(), radians(step_deg)) / radians(step_deg)
    assert response.max() < 1.15
    assert response[round(1.6 / TICK) :] == pytest.approx(1.0, abs=0.03 + 0.15 / abs(step_deg))
    assert np.ptp(response[-40:]) * abs(step_deg) < 0.1


def test_steering_error_below_tolerance_gives_neutral_voltage() -> None:
    loop = SteeringLoop(pid=Pid(kp=0.0))
    for error_deg, voltage in ((0.09, 6.0), (-0.09, 6.0), (1.0, 6.3), (-1.0, 5.7)):
        assert loop.update(loop.init(), radians(error_deg), 0.0, TICK)[1] == pytest.approx(voltage)


def _drive(loop: SpeedLoop, target: float, seconds: float = 15.0) -> tuple[np.ndarray, np.ndarray]:
    """Return speed [m/s] and pedal [-] per tick: 0.3 V dead band, 0.5 1/s per V, 5 m/s full speed, and 0.4 s lag."""
    dt, pedal, speed, state = 0.005, 0.0, 0.0, loop.init()
    speeds, pedals = [], []
    for _ in range(round(seconds / TICK)):
        state, voltage = speed_step(loop.parameters(), state, target, speed, pedal, TICK)
        assert -1 <= state.reference <= 1
        assert 0 <= voltage <= 12
        for _ in range(round(TICK / dt)):
            pedal += dt * _valve_rate(voltage - NEUTRAL_V, 0.3, 0.5, 1.5)
            pedal = min(max(pedal, -1.0), 1.0)
            speed += dt / 0.4 * (5.0 * pedal - speed)
        speeds.append(speed)
        pedals.append(pedal)
    return np.array(speeds), np.array(pedals)


@pytest.mark.parametrize("target", [-1.0, 0.5, 1.2, 3.0])
def test_speed_step_response_settles_with_limited_overshoot(target: float) -> None:
    speeds, _ = _drive(SpeedLoop(), target, seconds=25.0)
    assert (speeds / target).max() < 1.25, "overshoot of a step"
    assert abs(speeds[round(2 / TICK)] / target - 1) < 0.2, "feed-forward responds immediately"
    assert speeds[round(15 / TICK) :] == pytest.approx(target, abs=0.03 * abs(target) + 0.02)
    assert np.std(speeds[-100:]) < 0.01


def test_speed_loop_settles_without_feedforward() -> None:
    speeds, _ = _drive(SpeedLoop(feedforward_s_m=0.0), 1.2, seconds=40.0)
    assert speeds[-100:] == pytest.approx(1.2, abs=0.05)


def test_unreachable_speed_does_not_wind_up_the_integral() -> None:
    loop = SpeedLoop()
    state = loop.init()
    for _ in range(1000):
        state, _ = speed_step(loop.parameters(), state, 9.0, 5.0, 1.0, TICK)
    assert state.reference == 1.0
    assert speed_step(loop.parameters(), state, 2.0, 5.0, 1.0, TICK)[0].reference < 0.7


def test_steering_reference_respects_its_rate_limit() -> None:
    loop, references = SteeringLoop(reference_rate_deg_s=20.0), []
    state = loop.init()._replace(reference=0.1)
    for wanted in (0.1, 0.2, 0.2, 0.2, 0.2, 0.2, 0.2, 0.15, -1.0):
        state, _ = loop.update(state, wanted, 0.1, TICK)
        references.append(degrees(state.reference - 0.1))
    there = degrees(0.1)
    assert references == pytest.approx([0, 1, 2, 3, 4, 5, there, there - 1, there - 2])
    free = SteeringLoop()
    assert free.update(free.init(), -1.0, 0.1, TICK)[0].reference == -1.0


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("saturated", [False, True])
def test_integral_does_not_wind_up_at_either_limit(side: int, saturated: bool) -> None:
    """If the error or the feed-forward saturates the output, the integral is held until the error reverses."""
    pid, state = Pid(kp=0.0, ki=1.0), PidState(integral=0.3 * side)
    for _ in range(200):
        state, output = pid.update(state, 2.0 * side, TICK, -1.0, 1.0, ahead=5.0 * side if saturated else 0.0)
    assert output == pytest.approx(side)
    assert side * state.integral <= 1.0
    if saturated:
        assert state.integral == pytest.approx(0.3 * side)
    before = state.integral
    state, _ = pid.update(state, -2.0 * side, TICK, -1.0, 1.0, ahead=5.0 * side)
    assert state.integral == pytest.approx(before - side * 2.0 * TICK), "the integral moves away from the limit"


def test_outer_loop_state_is_unchanged_by_steps_of_the_inner_loop() -> None:
    loop = SpeedLoop()
    law = loop.parameters()
    state, _ = speed_step(law, loop.init(), 1.2, 0.7, 0.2, TICK)
    held, voltage = pedal_step(law, state, 0.5, 0.4, TICK)
    assert held.outer == state.outer
    assert held.reference == 0.5
    assert voltage == pytest.approx(NEUTRAL_V + 6.0 * 0.1 + 0.25)
    assert pedal_step(law, state, 0.4, 0.5, TICK)[1] == pytest.approx(NEUTRAL_V - 6.0 * 0.1 - 0.25)
