"""Gyro and wheel speed: errors as configured by their keys."""

from math import exp, isnan, radians, sqrt

import numpy as np
import pytest

from agrobot_mj import load_scenario
from agrobot_mj.core.signals import NOMINAL, Truth
from agrobot_mj.sensors import Gyro, RadarSpeed, WheelSpeed
from agrobot_mj.simulation.loop import Loop

DT = 0.05


def truth(wheel_speed=1.2, yaw_rate=0.1, speed=1.2):
    return Truth(
        *(0.0, 0.0, 0.0, 0.5, 0.3, 0.0, 0.0, speed, 0.0, yaw_rate, 0.1, 0.5, 0.3, 0.3),
        antenna=(0.0, 0.0, 2.0),
        antenna_velocity=(1.1, 0.4, 0.0),
        steer_samples=np.full(25, 0.1),
        pedal_samples=np.full(25, 0.5),
        wheel_speed=wheel_speed,
    )


def readings(sensor, ticks, seed=1, **now):
    state, found = sensor.init(seed), []
    for _ in range(ticks):
        state, reading = sensor.measure(state, truth(**now), NOMINAL, DT)
        found.append(reading)
    return np.array(found)


def test_measurement_is_missing_if_its_sensor_is_disabled():
    assert isnan(readings(WheelSpeed(), 1)[0])


@pytest.mark.parametrize("speed", [1.2, -0.8])
def test_sensor_scale_and_noise_match_the_keys(speed):
    n, sensor = 4000, WheelSpeed(enabled=True, scale_error=0.03, slip_sigma=0.0, sigma_m_s=0.02)
    found = readings(sensor, n, wheel_speed=speed)
    assert found.mean() == pytest.approx(1.03 * speed, abs=5 * 0.02 / sqrt(n))
    assert found.std() == pytest.approx(0.02, rel=5 / sqrt(2 * n))


@pytest.mark.parametrize("lag", [0, 2, 10])
def test_wheel_slip_error_has_the_configured_sigma_and_correlation_time(lag):
    n, sensor = 40_000, WheelSpeed(enabled=True, scale_error=0.0, slip_sigma=0.01, slip_time_s=0.25, sigma_m_s=0.0)
    slip = readings(sensor, n, wheel_speed=1.0) - 1.0
    expected = 1e-4 * exp(-lag * DT / 0.25)
    assert slip[: n - lag] @ slip[lag:] / (n - lag) == pytest.approx(expected, abs=5 * 1e-4 * sqrt(10 / n))


def test_wheel_speed_of_stationary_wheels_is_exactly_zero():
    assert (readings(WheelSpeed(enabled=True), 20, wheel_speed=0.02) == 0.0).all()
    assert (readings(WheelSpeed(enabled=True), 20, wheel_speed=0.04) != 0.0).all()


def test_gyro_bias_is_a_random_walk_of_the_configured_size():
    """After 10 s, the standard deviation over seeds is the random-walk intensity times the root of the time."""
    gyro, runs = Gyro(enabled=True, sigma_deg_s=0.0, bias_deg_s=0.5, bias_walk_deg_s_rt_s=0.01), 300
    last = np.degrees([readings(gyro, 200, seed)[-1] for seed in range(runs)]) - np.degrees(0.1)
    assert last.mean() == pytest.approx(0.5, abs=5 * 0.032 / sqrt(runs))
    assert last.std() == pytest.approx(0.01 * sqrt(10.0), rel=5 / sqrt(2 * runs))


def test_gyro_bias_walk_does_not_change_the_white_noise():
    still, walking = (Gyro(enabled=True, bias_walk_deg_s_rt_s=walk) for walk in (0.0, 1e-9))
    assert readings(walking, 50) == pytest.approx(readings(still, 50), abs=radians(1e-7))


@pytest.mark.parametrize("plant", ["bicycle", "mujoco"])
def test_wheel_speed_exceeds_ground_speed_only_on_the_mujoco_plant(plant):
    """The rolling radius of a loaded tyre is below its free radius, and rolling resistance causes a little slip."""
    loop = Loop(load_scenario("straight_line", {"plant.kind": plant}))
    assert loop.truth.wheel_speed == pytest.approx(0.0, abs=1e-3)
    for _ in range(200):
        loop.advance(loop.tick().drive)
    ratio = loop.truth.wheel_speed / loop.truth.speed
    assert ratio == 1.0 if plant == "bicycle" else 1.0 < ratio < 1.08


@pytest.mark.parametrize("speed", [1.2, -0.8])
def test_radar_measures_the_magnitude_of_the_speed(speed):
    n, radar = 4000, RadarSpeed(enabled=True, scale_error=0.03, ground_sigma=0.0, sigma_m_s=0.02)
    found = readings(radar, n, speed=speed)
    assert found.mean() == pytest.approx(1.03 * abs(speed), abs=5 * 0.02 / sqrt(n))
    assert found.std() == pytest.approx(0.02, rel=5 / sqrt(2 * n))
    assert isnan(readings(RadarSpeed(), 1)[0])


def test_radar_ignores_wheel_slip_and_is_zero_below_minimum_speed():
    radar = RadarSpeed(enabled=True, scale_error=0.0, ground_sigma=0.0, sigma_m_s=0.0)
    assert readings(radar, 3, speed=1.0, wheel_speed=2.0) == pytest.approx(1.0)
    assert (readings(radar, 3, speed=0.15) == 0.0).all()


@pytest.mark.parametrize("lag", [0, 2, 10])
def test_ground_dependent_radar_error_is_correlated_in_time(lag):
    n = 40_000
    radar = RadarSpeed(enabled=True, scale_error=0.0, ground_sigma=0.01, ground_time_s=0.25, sigma_m_s=0.0)
    error = readings(radar, n, speed=1.0) - 1.0
    expected = 1e-4 * exp(-lag * DT / 0.25)
    assert error[: n - lag] @ error[lag:] / (n - lag) == pytest.approx(expected, abs=5 * 1e-4 * sqrt(10 / n))


def test_body_fixed_gyro_measures_the_rate_about_the_body_axis():
    """On a side slope of 15 deg, the rate about the vertical is the rate about the normal times cos(15 deg)."""
    perfect = {"enabled": True, "sigma_deg_s": 0.0, "bias_walk_deg_s_rt_s": 0.0}
    changes = {"terrain.kind": "slope", "terrain.grade_deg": 15, "controller.kind": "open_loop"}
    changes |= {"controller.steer_deg": 20, "controller.at_s": 0.0}
    scenario = load_scenario("circle", changes)
    loop, level, body = Loop(scenario), Gyro(**perfect), Gyro(**perfect, axes="body")
    vertical, own, lean = [], [], []
    for _ in range(300):
        loop.advance(loop.tick().drive)
        t = loop.truth
        vertical.append(level.measure(level.init(1), t, NOMINAL, DT)[1])
        own.append(body.measure(body.init(1), t, NOMINAL, DT)[1])
        lean.append(np.cos(t.roll) * np.cos(t.pitch))
    vertical, own, lean = np.array(vertical[150:]), np.array(own[150:]), np.array(lean[150:])
    assert np.mean(vertical) / np.mean(own) == pytest.approx(np.mean(lean), abs=0.01)
    assert np.mean(lean) < 0.98
