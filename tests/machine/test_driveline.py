"""Pedal and hydrostat: rate, limits and lag."""

from math import exp

import numpy as np
import pytest

from agrobot_mj.machine.driveline import Driveline, drive_law, drive_step
from agrobot_mj.machine.hydraulics import NEUTRAL_V

DT = 0.002


def respond(voltages, driveline=Driveline(), dt=DT):
    """Return pedal and speed after each step, shape (n, 2)."""
    law, memory = drive_law(driveline, dt)
    return np.array([(drive_step(law, memory, v), memory.pedal[0])[::-1] for v in voltages])


@pytest.mark.parametrize("voltage", [5.7, 5.9, 6.0, 6.29])
def test_pedal_does_not_move_for_voltages_inside_the_dead_band(voltage):
    assert not respond([voltage] * 500).any()


@pytest.mark.parametrize(
    ("voltage", "rate"), [(7.3, 0.5), (4.7, -0.5), (6.5, 0.1), (9.3, 1.5), (12.0, 1.5), (0.0, -1.5), (50.0, 1.5)]
)
@pytest.mark.parametrize("dt", [0.001, 0.005])
def test_pedal_rate_is_proportional_to_voltage_up_to_its_limit(voltage, rate, dt):
    pedal = respond([voltage] * round(0.4 / dt), dt=dt)[:, 0]
    assert pedal[-1] == pytest.approx(rate * 0.4, rel=1e-9)
    assert np.diff(pedal) == pytest.approx(rate * dt)


@pytest.mark.parametrize(("voltage", "end"), [(12.0, 1.0), (0.0, -1.0)])
def test_pedal_stops_at_its_limits_and_leaves_them_without_delay(voltage, end):
    back = 12.0 - voltage
    pedal = respond([voltage] * 5000 + [back] * 10)[:, 0]
    assert np.abs(pedal).max() == 1.0
    assert pedal[4999] == end
    assert pedal[5000] == pytest.approx(end * (1 - 1.5 * DT))


def test_pedal_keeps_its_position_at_neutral_voltage():
    pedal = respond([7.3] * 300 + [NEUTRAL_V] * 300)[:, 0]
    assert (pedal[300:] == pedal[299]).all()
    assert pedal[-1] == pytest.approx(0.3)


@pytest.mark.parametrize("dt", [0.001, 0.002, 0.005])
def test_speed_follows_the_pedal_with_the_lag_of_the_pump(dt):
    law, memory = drive_law(Driveline(full_speed_m_s=4.0, pump_time_constant_s=0.5), dt)
    memory.pedal[0] = 0.6
    speed = np.array([drive_step(law, memory, NEUTRAL_V) for _ in range(round(2.0 / dt))])
    assert speed == pytest.approx(2.4 * (1 - np.exp(-dt * np.arange(1, len(speed) + 1) / 0.5)), abs=1e-9)
    assert speed[round(0.5 / dt) - 1] / 2.4 == pytest.approx(1 - exp(-1), abs=1e-3)


def test_full_pedal_gives_maximum_speed_in_both_directions():
    assert respond([12.0] * 5000)[-1] == pytest.approx((1.0, 5.0), rel=1e-6)
    assert respond([0.0] * 5000)[-1] == pytest.approx((-1.0, -5.0), rel=1e-6)
