"""The inertial unit: its errors are those of its keys, and it moves no other sensor's noise."""

from math import exp, isnan, radians, sqrt

import numpy as np
import pytest

from agrobot_mj.core.signals import NOMINAL, Truth
from agrobot_mj.sensors import Imu, Sensors

DT = 0.05


def truth(roll=0.0, pitch=0.0):
    return Truth(
        *(0.0, 0.0, 0.0, 0.5, 0.3, pitch, roll, 1.2, 0.0, 0.1, 0.1, 0.5, 0.3, 0.3),
        antenna=(0.0, 0.0, 2.0),
        antenna_velocity=(1.1, 0.4, 0.0),
        steer_samples=np.full(25, 0.1),
        pedal_samples=np.full(25, 0.5),
    )


def readings(imu, ticks, seed=1, roll=0.0, pitch=0.0):
    state, found = imu.init(seed), []
    for _ in range(ticks):
        state, measured = imu.measure(state, truth(roll, pitch), NOMINAL, DT)
        found.append(measured)
    return np.degrees(found)


def test_without_one_roll_and_pitch_are_not_known():
    sensors = Sensors()
    _, measurement = sensors.measure(sensors.init(1), truth(), NOMINAL, DT)
    assert isnan(measurement.roll)
    assert isnan(measurement.pitch)


def test_a_perfect_unit_tells_the_truth():
    sensors = Sensors(imu=Imu(enabled=True, sigma_deg=0.0, wander_sigma_deg=0.0))
    _, measurement = sensors.measure(sensors.init(1), truth(roll=0.17, pitch=-0.05), NOMINAL, DT)
    assert (measurement.roll, measurement.pitch) == (0.17, -0.05)


def test_biases_add_to_their_own_axes():
    imu = Imu(enabled=True, sigma_deg=0.0, wander_sigma_deg=0.0, roll_bias_deg=0.4, pitch_bias_deg=-0.3)
    assert readings(imu, 1, roll=radians(10.0), pitch=radians(2.0))[0] == pytest.approx([10.4, 1.7])


@pytest.mark.parametrize("lag", [0, 1, 5])
def test_the_error_has_its_sigmas_and_its_correlation_time(lag):
    n, imu = 40_000, Imu(enabled=True, sigma_deg=0.1, wander_sigma_deg=0.2, wander_time_s=0.25)
    error = readings(imu, n)
    expected = 0.04 * exp(-lag * DT / 0.25) + 0.01 * (lag == 0)
    for axis in error.T:
        assert axis[: n - lag] @ axis[lag:] / (n - lag) == pytest.approx(expected, abs=5 * 0.05 * sqrt(10 / n))
    assert abs(np.corrcoef(error.T)[0, 1]) < 5 * sqrt(10 / n)


def test_the_wander_starts_in_its_stationary_distribution():
    imu, n = Imu(enabled=True, sigma_deg=0.0, wander_sigma_deg=0.2), 2000
    first = [readings(imu, 1, seed)[0, 0] for seed in range(n)]
    assert np.std(first) == pytest.approx(0.2, rel=5 / sqrt(2 * n))


def test_it_shifts_no_other_stream():
    with_it, without = Sensors(imu=Imu(enabled=True)), Sensors()
    states = [sensors.init(1) for sensors in (with_it, without)]
    for _ in range(20):
        states[0], one = with_it.measure(states[0], truth(), NOMINAL, DT)
        states[1], other = without.measure(states[1], truth(), NOMINAL, DT)
        assert one[:6] == other[:6]
        assert not isnan(one.roll)
